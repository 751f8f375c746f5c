"""Profile of a pose along what ranges determine least."""

import numpy as np
from lidar_target import box, joined, scan_of

from estimators import rotation as rot
from estimators.lidar.profile import profiled
from estimators.lidar.shape import Shape


def test_rays_beside_a_plate_tell_its_turn():
    """Square on, ranges do not tell the turn of a plate within its plane; rays that pass it do, 7 degrees away."""
    plate = Shape(*box((-0.03, -0.7, -0.45), (0.03, 0.7, 0.45)), points=600)
    truth, place = rot.exp(np.radians([8.0, 0.0, 0.0])), np.array([4.0, 0.05, -0.03])
    scan = scan_of(plate, truth, place, np.random.default_rng(0))
    found = profiled(scan, plate, rot.exp(np.radians([7.0, 0.0, 0.0])) @ truth, place)
    assert found is not None
    off = rot.log(truth @ found.rotation.T)
    assert np.degrees(np.linalg.norm(off)) < 1.0
    assert found.overlap > 0.97
    error = np.concatenate([off, place - found.position])
    assert error @ np.linalg.solve(found.covariance, error) < 22.5, "99.9 % of six degrees of freedom"


def test_a_prism_finds_its_turn_and_its_place_along_the_axis() -> None:
    """Of its many sides each is like the next, and along its axis it slides: one mast tells the turn, its ends the
    place.
    """
    angle = 2 * np.pi * np.arange(16) / 16
    ring = np.stack([0.5 * np.cos(angle), 0.5 * np.sin(angle)], axis=1)
    vertex = np.concatenate([np.column_stack([ring, np.full(16, z)]) for z in (-1.0, 1.0)])
    i, after = np.arange(16), (np.arange(16) + 1) % 16
    sides = np.concatenate([np.stack([i, after, 16 + after], axis=1), np.stack([i, 16 + after, 16 + i], axis=1)])
    low = np.stack([np.zeros(14, dtype=int), i[2:], i[1:-1]], axis=1)
    face = np.concatenate([sides, low, low[:, ::-1] + 16])
    prism = Shape(*joined((vertex, face), box((-0.05, 0.45, -0.1), (0.05, 1.1, 0.1))), points=1500)
    truth, place = rot.exp(np.array([0.0, 0.25, 0.0])) @ rot.exp(np.array([0.0, 0.0, 0.3])), np.array([5.0, 0.1, 0.0])
    scan = scan_of(prism, truth, place, np.random.default_rng(1))
    axis = truth[:, 2]
    turn = rot.exp(np.radians(8.0) * axis)
    found = profiled(scan, prism, turn @ truth, place + 0.12 * axis)
    assert found is not None
    off = rot.log(truth @ found.rotation.T)
    assert np.degrees(np.linalg.norm(off)) < 1.5
    assert np.linalg.norm(place - found.position) < 0.03
    error = np.concatenate([off, place - found.position])
    assert error @ np.linalg.solve(found.covariance, error) < 22.5, "99.9 % of six degrees of freedom"
