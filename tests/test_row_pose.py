"""Pose from rows of any stations: consistency by Monte Carlo, every start, mirror images, flat planes, faults."""

import numpy as np
import pytest
from rows_made import BODY, DECK, room, seen, still
from scipy.optimize import least_squares
from scipy.stats import chi2

from estimators import rotation as rot
from estimators.lighthouse.innovation import innovations, light_of, noise_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.row_faults import FORGOTTEN, OVERSHOOT, row_faults
from estimators.lighthouse.row_pose import solve_rows
from estimators.lighthouse.row_start import directions, row_starts, trimmed
from estimators.lighthouse.rows import linearise, packed
from estimators.lighthouse.sweep import measured_angles
from estimators.state import State

NOISE = AngleNoise(2e-5, 3e-5)


def drawn(count: int, seed: int, tilt: float = 1.5) -> State:
    rng = np.random.default_rng(seed)
    return still(rot.exp(tilt * rng.normal(size=(count, 3))), 0.4 * rng.normal(size=(count, 3)))


def near(state: State, rng: np.random.Generator) -> State:
    turn = rot.exp(0.02 * rng.normal(size=state.position.shape))
    return state._replace(
        rotation=turn @ state.rotation, position=state.position + 0.01 * rng.normal(size=(len(turn), 3))
    )


@pytest.mark.parametrize("generations", [(1,), (2,), (1, 1), (2, 2, 2), (1, 2)])
def test_errors_are_as_large_as_the_covariance_says(generations):
    """NEES of 6 degrees of freedom over independent poses, which move, in the chi-square band of 99.9 %."""
    rng, stations, count = np.random.default_rng(5), room(generations), 200
    noise = [AngleNoise(2e-5, 3e-5) if g == 1 else AngleNoise(1e-5, 0.5e-5) for g in generations]
    state = drawn(count, 6)._replace(
        velocity=0.5 * rng.normal(size=(count, 3)), angular_rate=rng.normal(size=(count, 3))
    )
    rows = seen(stations, BODY, state, noise, rng, spread_s=0.015)
    start = near(state, rng)._replace(velocity=state.velocity, angular_rate=state.angular_rate)
    point = np.tile(BODY, (count, 1, 1))
    every = np.ones(count, dtype=np.bool_)
    kept = np.ones(len(rows.angle), dtype=np.bool_)
    found = solve_rows(rows, kept, every, light_of(packed(stations), noise), point, start)
    assert found.solved.all()
    error = np.concatenate(
        [rot.log(state.rotation @ np.swapaxes(found.rotation, 1, 2)), state.position - found.position], axis=1
    )
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error).sum()
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 6 * count)
    assert low < nees < high
    freedom = (found.rows - 6).sum()
    assert chi2.ppf(5e-4, freedom) < found.cost.sum() < chi2.ppf(1 - 5e-4, freedom)


def test_solution_is_that_of_a_general_least_squares_solver():
    stations, noise = room((1, 2)), [NOISE, AngleNoise(1e-5, 2e-5)]
    rng = np.random.default_rng(8)
    state = drawn(1, 9)
    rows = seen(stations, BODY, state, noise, rng)
    found = solve_rows(
        rows,
        np.ones(len(rows.angle), dtype=np.bool_),
        np.ones(1, dtype=np.bool_),
        light_of(packed(stations), noise),
        BODY[None],
        near(state, rng),
    )
    root = np.linalg.cholesky(np.linalg.inv(noise_of(rows.of(0), noise))).T

    def residual(x):
        turned = rot.exp(x[:3]) @ state.rotation[0]
        still_there = np.zeros(3)
        return (
            root
            @ linearise(
                rows.of(0), packed(stations), BODY, turned, state.position[0] + x[3:], still_there, still_there
            )[0]
        )

    # Of numerical derivatives: 1e-8 of the step, against sigmas of some 1e-4.
    other = least_squares(residual, np.zeros(6), x_scale=1e-3, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert np.allclose(rot.exp(other.x[:3]) @ state.rotation[0], found.rotation[0], atol=1e-7)
    assert np.allclose(state.position[0] + other.x[3:], found.position[0], atol=1e-7)
    assert found.cost[0] == pytest.approx(2 * other.cost, rel=1e-6)


def test_directions_give_their_angles_again():
    for station in room((1, 2)):
        rng = np.random.default_rng(1)
        uv = rng.uniform(-1.2, 1.2, size=(200, 2))
        angles = measured_angles(np.concatenate([uv, np.ones((200, 1))], axis=1), station.fans)
        known = np.isfinite(angles).all(axis=1)
        # Newton ends at a step of 1e-10.
        assert np.allclose(directions(angles, station)[known], uv[known], atol=1e-9)
        assert np.isnan(directions(np.array([[0.1, np.nan]]), station)).all()


@pytest.mark.parametrize("generations", [(1,), (2,), (1, 2), (2, 2, 2)])
@pytest.mark.parametrize("point_m", [BODY, DECK], ids=["body", "deck"])
def test_the_true_pose_is_among_the_starts(generations, point_m):
    stations, noise = room(generations), [NOISE] * len(generations)
    rng, poses = np.random.default_rng(11), drawn(8, 12, tilt=0.7)
    for c in range(8):
        state = State._make(part[c : c + 1] for part in poses)
        rows = seen(stations, point_m, state, noise, rng).of(0)
        found = row_starts(rows, stations, point_m, noise)
        away = rot.angle_between(found.pose.rotation, state.rotation[0])
        best = int(np.argmin(away))
        # Six sigmas of the most uncertain axis.
        assert away[best] < 6 * np.sqrt(np.trace(found.pose.covariance[best][:3, :3]))
        if len(generations) > 1:
            assert best == 0


@pytest.mark.parametrize("generations", [(1, 2), (2, 2, 2)])
def test_reflections_are_left_out_of_a_start_and_motion_is_not_taken_for_them(generations):
    stations, noise = room(generations), [NOISE] * len(generations)
    rng, poses, turned = np.random.default_rng(13), drawn(8, 14, tilt=0.7), 0
    for c in range(8):
        state = State._make(part[c : c + 1] for part in poses)
        honest = seen(stations, BODY, state, noise, rng).of(0)
        angle = honest.angle.copy()
        struck = rng.choice(len(angle), len(angle) // 16, replace=False)
        angle[struck] += np.radians(rng.uniform(1.0, 5.0, len(struck)) * rng.choice([-1, 1], len(struck)))
        rows = honest._replace(angle=angle)
        starts = row_starts(rows, stations, BODY, noise)
        if not len(starts):
            continue
        found = trimmed(rows, stations, BODY, noise, starts)
        sigma = np.sqrt(np.trace(found.pose.covariance[0][:3, :3]))
        assert rot.angle_between(found.pose.rotation[0], state.rotation[0]) < 6 * sigma
        turned += bool(rot.angle_between(starts.pose.rotation[0], state.rotation[0]) > 20 * sigma)
        moves = state._replace(velocity=np.array([[0.5, -0.3, 0.4]]), angular_rate=np.array([[0.2, 0.5, -0.4]]))
        for fine in (honest, seen(stations, BODY, moves, noise, rng, spread_s=0.015).of(0)):
            clean = row_starts(fine, stations, BODY, noise)
            assert trimmed(fine, stations, BODY, noise, clean) is clean
    assert turned > 4


def test_a_plane_before_one_station_keeps_its_mirror_image_and_a_second_station_refutes_it():
    noise = [AngleNoise(1e-5, 1e-5)] * 2
    state = still(rot.exp(np.array([[0.5, 0.2, 0.3]])), np.zeros((1, 3)))
    rng = np.random.default_rng(2)
    one = row_starts(seen(room((2,)), DECK, state, noise, rng).of(0), room((2,)), DECK, noise[:1])
    assert len(one) == 2
    assert one.pose.cost[1] - one.pose.cost[0] < 25
    two = row_starts(seen(room((2, 2)), DECK, state, noise, rng).of(0), room((2, 2)), DECK, noise)
    assert len(two) == 1 or two.pose.cost[1] - two.pose.cost[0] > 25
    assert rot.angle_between(two.pose.rotation[0], state.rotation[0]) < 0.1


def test_few_photodiodes_before_each_of_two_stations_are_enough():
    """Three before either, none by four: found by crossing rays, or among attitudes all over."""
    stations, noise = room((1, 2)), [NOISE] * 2
    state = still(rot.exp(np.array([[0.3, -0.4, 0.2]])), np.array([[0.1, 0.0, -0.1]]))
    rows = seen(stations, BODY, state, noise, np.random.default_rng(4))
    for first, second in (((0, 1, 2), (0, 1, 2)), ((0, 1, 2), (3, 4, 5))):
        kept = np.where(rows.station == 0, np.isin(rows.photodiode, first), np.isin(rows.photodiode, second))
        found = row_starts(rows.where(kept).of(0), stations, BODY, noise)
        away = rot.angle_between(found.pose.rotation, state.rotation[0])
        assert away.min() < 0.02
    assert not len(
        row_starts(
            rows.where(rows.station == 0).of(0)._replace(photodiode=np.zeros(16, dtype=np.int64)), stations, BODY, noise
        )
    )


def test_the_tilt_of_a_plane_that_is_face_on_is_as_uncertain_as_its_fit_says():
    """At the widened covariance's edge along the weakest axis the cost has risen by one at least, on both sides."""
    stations, noise = room((2,)), [AngleNoise(1e-5, 1e-5)]
    rng = np.random.default_rng(7)
    # The deck's normal looks at the station, up to a few degrees.
    facing = np.stack([stations[0].rotation[:, 0], -stations[0].rotation[:, 1], -stations[0].rotation[:, 2]], axis=1)
    state = still(rot.exp(0.02 * rng.normal(size=(40, 3))) @ facing, np.zeros((40, 3)))
    rows = seen(stations, DECK, state, noise, rng)
    light, point = light_of(packed(stations), noise), np.tile(DECK, (40, 1, 1))
    every, kept = np.ones(40, dtype=np.bool_), np.ones(len(rows.angle), dtype=np.bool_)
    found = solve_rows(rows, kept, every, light, point, state)
    error = rot.log(state.rotation @ np.swapaxes(found.rotation, 1, 2))
    sigma = np.sqrt(np.trace(found.covariance[:, :3, :3], axis1=1, axis2=2))
    solved = found.solved
    assert np.count_nonzero(solved) > 30
    # Chi-square of about two effective degrees of freedom: within three of these sigmas but for one in a hundred.
    assert np.mean(np.linalg.norm(error[solved], axis=1) > 3 * sigma[solved]) <= 0.05


@pytest.mark.parametrize("shown", [2, 12])
def test_fault_slopes_are_those_of_the_covariance_form(shown):
    """Of one station, whose photodiodes are all false before the same one."""
    noise, stations = [NOISE], room((1,))
    rng = np.random.default_rng(13)
    state = drawn(2, 14)
    rows = seen(stations, BODY, state, noise, rng)
    root = rng.normal(size=(2, 12, 12)) * np.repeat([1e-3, 0.1, 1e-3, 0.05], 3)[:, None]
    covariance, open_s = root @ np.swapaxes(root, 1, 2), np.array([0.0, 2.0])
    kept, point = (rng.random(len(rows.angle)) < 0.9) & (rows.photodiode < shown), np.tile(BODY, (2, 1, 1))
    both, known = np.ones(2, dtype=np.bool_), packed(stations)
    inner = innovations(rows, kept, both, light_of(known, noise), point, state)
    found = row_faults(rows, kept, both, inner, light_of(known, noise), covariance, open_s)
    for c in range(2):
        one, own = rows.where(kept).of(c), state.of(c)
        h = linearise(one, known, BODY, own.rotation, own.position, own.velocity, own.angular_rate).matrix
        r = noise_of(one, noise)
        shown_to_gate = np.linalg.inv(h @ covariance[c] @ h.T + r)
        gain = FORGOTTEN * covariance[c] @ h.T @ np.linalg.inv(FORGOTTEN * h @ covariance[c] @ h.T + r)
        worst = np.zeros(2)
        for photodiode in np.unique(one.photodiode):
            false = np.flatnonzero(one.photodiode == photodiode)
            root = np.linalg.cholesky(shown_to_gate[np.ix_(false, false)])
            moved = np.linalg.norm((gain[:, false] @ np.linalg.inv(root).T).reshape(4, 3, -1), ord=2, axis=(1, 2))
            worst = np.maximum(worst, OVERSHOOT * (moved[[2, 0]] + open_s[c] * moved[[3, 1]]))
        # Two orders of inverting matrices of condition 1e6.
        assert found[:, c] == pytest.approx(worst, rel=1e-6)
