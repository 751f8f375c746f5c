"""Alignment of truth in time and space: the transformation, clocks and marker that a synthetic truth was made with."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimators.arrays import Floats
from swarm.errors import SwarmError
from swarm.flight.recordings.alignment import align, clock_of_marks, interpolated, rigid, true_positions
from swarm.flight.recordings.trajectory import Trajectory

LEVER = np.array([0.004, -0.011, 0.03])
TURN, SHIFT = Rotation.from_euler("zyx", [130, -20, 40], degrees=True), np.array([2.0, -1.0, 0.5])
OFFSET, RATE = 817.31, 1 + 140e-6
NOISE_M = 0.002


def path_(t: Floats) -> Floats:
    return np.stack([np.sin(0.7 * t) + 0.2 * np.sin(2.9 * t), np.cos(0.5 * t), 0.4 * np.sin(1.3 * t + 1)], axis=1)


def attitude(t: Floats) -> Rotation:
    return Rotation.from_rotvec(np.stack([0.5 * np.sin(t), 0.6 * np.cos(0.8 * t), 2 * np.sin(0.3 * t)], axis=1))


def flight(lever: Floats = LEVER) -> tuple[Floats, Floats, Floats, Trajectory]:
    """Estimates at 20 Hz with noise, and a truth at 300 Hz on another clock, with gaps."""
    rng = np.random.default_rng(4)
    t = np.arange(3.0, 43.0, 0.1)
    p = path_(t) + rng.normal(0, NOISE_M, (len(t), 3))
    p[::19] += rng.normal(0, 0.5, (len(p[::19]), 3))
    own = np.arange(5.0, 41.0, 1 / 300)
    own = own[(np.floor(own) % 7) != 3]
    marker = TURN.apply(path_(own) + attitude(own).apply(lever)) + SHIFT
    truth = Trajectory(Path("truth.npy"), OFFSET + RATE * own, "s", marker, np.full((len(own), 4), np.nan), 0, 0)
    return t, p, attitude(t).as_matrix(), truth


@pytest.mark.parametrize("marks", [np.array([5.0 + 0.004, 41.0 - 0.003]), None])
def test_clock_frame_and_marker_are_found(marks: Floats | None) -> None:
    t, p, r, truth = flight()
    found = align(t, p, r, truth, marks)
    # 300 samples of 2 mm: 0.1 mm; the speed of 1 m/s makes of it 0.1 ms. Five standard deviations.
    assert abs(found.clock.of(np.array(20.0)) - (OFFSET + RATE * 20)) < 5e-4
    assert abs(found.clock.rate - RATE) < 40e-6
    assert np.degrees(np.linalg.norm((Rotation.from_matrix(found.rotation) * TURN.inv()).as_rotvec())) < 0.05
    assert found.lever is not None
    np.testing.assert_allclose(found.lever, LEVER, atol=1e-3)
    assert np.median(found.residual_m) < 1.2 * 1.54 * NOISE_M  # the median of three normal components' norm
    places, seen = true_positions(found, truth, t, r)
    inside = seen & (np.arange(len(t)) % 19 != 0)
    np.testing.assert_allclose(places[inside], path_(t[inside]), atol=2e-3)
    words = " ".join(found.sentences())
    assert f"{OFFSET:+.1f}"[:5] in words
    assert found.summary()["samples"] == found.samples


def test_without_attitudes_there_is_no_marker() -> None:
    t, p, _, truth = flight(np.zeros(3))
    found = align(t, p, None, truth)
    assert found.lever is None
    assert np.median(found.residual_m) < 1.2 * 1.54 * NOISE_M
    np.testing.assert_allclose(found.translation, SHIFT, atol=1e-3)


def test_marks_tell_rate_and_offset_or_nothing() -> None:
    *_, truth = flight()
    clock = clock_of_marks(np.array([5.0, 12.0, truth.time_s[-1] / RATE - OFFSET / RATE]), truth)
    assert clock is not None
    assert clock.rate == pytest.approx(RATE, abs=1e-9)
    assert clock.of(np.array([5.0]))[0] == pytest.approx(truth.time_s[0])
    assert clock_of_marks(np.array([5.0]), truth) is None
    assert clock_of_marks(np.array([5.0, 25.0]), truth) is None


def test_gaps_and_ends_have_no_truth() -> None:
    *_, truth = flight()
    at = OFFSET + RATE * np.array([4.9, 5.5, 10.5, 41.1])
    assert np.isfinite(interpolated(truth, at)).all(axis=1).tolist() == [False, True, False, False]


def test_kabsch_is_the_rotation_of_align_vectors() -> None:
    rng = np.random.default_rng(1)
    a = rng.normal(size=(20, 3))
    b = TURN.apply(a) + SHIFT + rng.normal(0, 0.01, a.shape)
    turn, shift = rigid(a, b)
    peer = Rotation.align_vectors(b - b.mean(axis=0), a - a.mean(axis=0))[0].as_matrix()
    np.testing.assert_allclose(turn, peer, atol=1e-12)
    np.testing.assert_allclose(shift, b.mean(axis=0) - peer @ a.mean(axis=0), atol=1e-12)


def test_what_cannot_be_aligned_is_said() -> None:
    t, p, r, truth = flight()
    with pytest.raises(SwarmError, match=r"truth\.npy.*moves by \d+ mm"):
        align(t, np.zeros_like(p), r, truth)
    with pytest.raises(SwarmError, match=r"truth\.npy: only 3 estimates"):
        align(t[:3], p[:3], r[:3], truth)
    rng = np.random.default_rng(2)
    with pytest.raises(SwarmError, match="does not fit"):
        align(t, rng.normal(0, 1, p.shape), r, truth)
    short = truth._replace(time_s=truth.time_s[:1], position=truth.position[:1])
    with pytest.raises(SwarmError, match="overlaps nowhere"):
        align(t, p, r, short)
