"""Profile of a pose along what ranges determine least."""

import numpy as np
from lidar_target import box, scan_of

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
