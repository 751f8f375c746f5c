"""Separation of solutions: against poses solved anew, against filters that never saw a photodiode, and in flight."""

import numpy as np
import pytest
from convex_target import angles, draw

from estimators import rotation as rot
from estimators.lighthouse.integrity import Sweeps, linearised
from estimators.lighthouse.pnp import refine
from estimators.lighthouse.separation import Linear, separate, sets_of, worst_levels
from swarm.errors import SwarmError
from swarm.flight.flight import Flight
from swarm.scenario import load

SIGMA = 1e-6
"""Noise of an angle [rad]: so small that poses follow it to first order."""
ONE = np.eye(12)[None]


def scene():
    """Poses of twelve craft at rest from noisy angles, and their sweeps."""
    rng = np.random.default_rng(4)
    truth = draw(rng, 12, 1.0, 4.0, 8)
    theta = noisy_angles(rng, truth)
    rest = np.zeros((len(truth.lit), 3))
    return truth, Sweeps(theta, truth.lit, truth.point, np.zeros_like(theta), rest, rest)


def noisy_angles(rng, truth):
    shape, rest = (*truth.lit.shape, 2), np.zeros((len(truth.lit), 3))
    exact = angles(truth.rotation, truth.position, truth.point, np.zeros(shape), rest, rest)
    return exact + SIGMA * rng.standard_normal(shape)


def solved(sweeps, truth):
    motion = sweeps.offset_s, sweeps.angular_rate, sweeps.velocity
    return refine(sweeps.theta, sweeps.lit, sweeps.point_m, truth.rotation, truth.position, *motion)


def step(linear, sets, fresh, kept, gain, weight, delta, added, memory=0.0):
    craft = len(fresh)
    wide = np.full((craft, 2), memory)
    kept, gain, weight = (
        np.ascontiguousarray(np.broadcast_to(part, (craft, *part.shape[1:]))) for part in (kept, gain, weight)
    )
    j, r, lit = linear
    separate(j, r, lit, fresh, sets, kept, gain, weight, SIGMA**2, wide, delta, added)


def test_down_dates_are_the_poses_solved_without_the_photodiodes():
    truth, sweeps = scene()
    full = solved(sweeps, truth)
    j, r, _ = linearised(sweeps, full.rotation, full.position)
    craft, photodiodes = truth.lit.shape
    sets = sets_of(photodiodes, 2)
    delta, added = np.zeros((craft, len(sets), 12)), np.zeros((craft, len(sets), 2))
    gain, weight = np.zeros((1, 12, 6)), np.zeros((1, 2, 6, 6))
    gain[0, :3, :3] = gain[0, 6:9, 3:] = np.eye(3)
    weight[0, 0, 3:, 3:] = weight[0, 1, :3, :3] = np.eye(3)
    step(Linear(j, r, truth.lit), sets, np.ones(craft, dtype=np.bool_), 0 * ONE, gain, weight, delta, added)
    for c in range(craft):
        lit = np.flatnonzero(truth.lit[c])
        for pick in ((int(lit[1]), -1), (int(lit[0]), int(lit[-1]))):
            s = int(np.flatnonzero((sets == pick).all(axis=1))[0])
            kept = truth.lit.copy()
            kept[c, [k for k in pick if k >= 0]] = False
            other = solved(sweeps._replace(lit=kept), truth)
            moved = np.concatenate(
                [
                    rot.log(full.rotation[c] @ other.rotation[c].T),
                    full.position[c] - other.position[c],
                ]
            )
            got = delta[c, s][[0, 1, 2, 6, 7, 8]]
            # First order: of second order is what some 1e-6 of noise times a lever of 40 makes.
            assert got == pytest.approx(moved, abs=2e-3 * np.abs(moved).max())
            matrices = []
            for mask in (truth.lit[c], kept[c]):
                rows = j[c][:, mask].reshape(-1, 6)
                matrices.append(SIGMA**2 * np.linalg.inv(rows.T @ rows))
            more = matrices[1] - matrices[0]
            assert added[c, s] == pytest.approx([np.trace(more[3:, 3:]), np.trace(more[:3, :3])], rel=1e-6)


def test_a_false_photodiode_is_within_the_level_and_a_filter_without_it_is_what_is_told():
    rng = np.random.default_rng(9)
    truth, sweeps = scene()
    craft, photodiodes = truth.lit.shape
    sets = sets_of(photodiodes, 1)
    delta, added = np.zeros((craft, len(sets), 12)), np.zeros((craft, len(sets), 2))
    kept = 0.8 * np.eye(12)[None]
    gain = np.zeros((1, 12, 6))
    gain[0, :3, :3] = gain[0, 6:9, 3:] = 0.2 * np.eye(3)
    reach = np.zeros((2, 12, 12))
    for _ in range(200):
        reach[0], reach[1] = 0.64 * reach[0], 0.64 * reach[1]
        reach[0, 6:9, 6:9] += np.eye(3)
        reach[1, :3, :3] += np.eye(3)
    weight = (np.swapaxes(gain, 1, 2) @ reach @ gain)[None]
    liar = np.array([int(np.flatnonzero(lit)[2]) for lit in truth.lit])
    running, without = np.zeros((2, craft, 6))
    honest = truth.lit.copy()
    honest[np.arange(craft), liar] = False
    for _ in range(60):
        noisy = noisy_angles(rng, truth)
        noisy[np.arange(craft), liar] += 5 * SIGMA
        now = sweeps._replace(theta=noisy)
        full, other = solved(now, truth), solved(now._replace(lit=honest), truth)
        j, r, _ = linearised(now, full.rotation, full.position)
        step(Linear(j, r, truth.lit), sets, np.ones(craft, dtype=np.bool_), kept, gain, weight, delta, added, 0.8)
        for filtered, pose in ((running, full), (without, other)):
            off = np.concatenate(
                [rot.log(pose.rotation @ np.swapaxes(truth.rotation, 1, 2)), pose.position - truth.position], axis=1
            )
            filtered[:] = 0.8 * filtered + 0.2 * off
    own = delta[np.arange(craft), liar][:, [0, 1, 2, 6, 7, 8]]
    scale = np.abs(running - without).max(axis=0)
    assert own / scale == pytest.approx((running - without) / scale, abs=5e-3)
    rows = [part[:, lit].reshape(-1, 6) for part, lit in zip(j, truth.lit, strict=True)]
    # The variance of a settled filter of gain 0.2 that keeps 0.8.
    variance = [0.04 / 0.36 * SIGMA**2 * np.diag(np.linalg.inv(part.T @ part)) for part in rows]
    levels = np.empty((2, craft))
    worst_levels(delta, added, np.array([[v[3:].sum(), v[:3].sum()] for v in variance]).T.copy(), 3.0, levels)
    assert (np.linalg.norm(running[:, 3:], axis=1) <= levels[0]).all()
    assert (np.linalg.norm(running[:, :3], axis=1) <= levels[1]).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (("navigation.integrity.false_stations=1",), "leaves no light without a false station"),
        (("navigation.integrity.unseen_acceleration_m_s2=0.1",), "no effect without levels by separation"),
        (("navigation.integrity.false_photodiodes=3",), "three at once are more"),
    ],
)
def test_what_cannot_be_separated_is_said(changes, message):
    with pytest.raises(SwarmError, match=message):
        load("drift", changes)


TWO = [
    "duration_s=2",
    "swarm.count=0",
    "recording.enabled=false",
    "navigation.quiet.craft=none",
    'craft=[{name="probe",motion={kind="drift",position_m=[0.0,0.0,3.0]}}]',
]


def stations(error_mm):
    said = ",".join(
        f'{{name="{name}",kind="lighthouse-2",position_m=[{x},0.0,0.0],attitude={{towards_m=[0.0,0.0,3.0]}}{more}}}'
        for name, x, more in (("s", -2.5, ""), ("t", 2.5, f",position_error_mm={error_mm}"))
    )
    return f"station=[{said}]"


def levels_of(overrides, periods=45):
    """Errors [m], levels [m] and the estimates of a flight from its 20th period on."""
    flight = Flight(load("static", overrides))
    flown = [flight.period(frame) for frame in range(periods)][20:]
    error = [np.linalg.norm(p.truth.position[0] - p.estimate.position[0]) for p in flown if p.truth is not None]
    return np.array(error), np.array([p.estimate.integrity.position_m[0] for p in flown]), flown


@pytest.mark.parametrize("error_mm", [0.0, 20.0])
def test_a_station_that_is_not_where_it_should_be_is_within_the_level(error_mm):
    error, level, _ = levels_of([*TWO, stations(error_mm), "navigation.integrity.false_stations=1"])
    _, alone, _ = levels_of([*TWO, stations(error_mm)])
    # Before two stations that contradict each other the filter starts again and again.
    known = np.isfinite(error)
    assert known.sum() > 20
    assert (error < level)[known].all()
    if error_mm:
        assert (error > alone)[known].any()
    else:
        assert known.all()
        # What one station of two may do is more than what a photodiode may, and known to some millimetres.
        assert (alone <= level + 1e-12).all()
        assert level.max() < 0.03


def test_a_filter_beside_is_one_that_never_saw_the_station():
    """Before the other station alone the same light gives the same estimate."""
    one = stations(0.0).split(',{name="t"')[0] + "]"
    changes = [*TWO, "navigation.integrity.false_stations=1"]
    flight = Flight(load("static", [*changes, stations(0.0)]))
    alone = Flight(load("static", [*TWO, one]))
    for frame in range(60):
        flight.period(frame)
        last = alone.period(frame).estimate
    # Sets are in the order of the stations: the second one is missing in the second.
    beside = flight.computer.navigator._beside._tracks.bank
    assert beside.position[1] == pytest.approx(last.position[0], abs=2e-5)
    scale = np.sqrt(np.diag(last.covariance[0]))
    assert np.abs((beside.covariance[1] - last.covariance[0]) / np.outer(scale, scale)).max() < 0.02


def test_single_sweeps_without_a_pose_have_levels_by_separation():
    tight = [*TWO, "navigation.coupling=tight", "navigation.integrity.false_photodiodes=1"]
    stuck = 'fault=[{kind="photodiode-stuck",craft="probe",photodiodes=[0],at_s=0.0}]'
    for more in ([], [stuck]):
        error, level, flown = levels_of([*tight, *more], 40)
        assert flown[-1].estimate.rows[0] > 8
        assert (error < level).all()
        assert level.max() < 0.02
