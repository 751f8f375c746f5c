"""Navigation by several stations: found from nothing, tracked, consistent, robust against false photodiodes."""

import numpy as np
import pytest
from rows_made import BODY, DECK, room, seen, still
from scipy.stats import chi2

from estimators import rotation as rot
from estimators.lighthouse.innovation import RowBatch
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import Rows
from estimators.state import State
from swarm.hardware import pad
from swarm.onboard.settings import Coupling, NavigationSettings, Status
from swarm.onboard.stations import RowLight, StationNavigator

T = 1 / 50
NOISE = AngleNoise(2e-5, 3e-5)
SETTINGS = NavigationSettings(T, 1e-4, 0.5, acceleration_noise_m_s2=0.5, angular_acceleration_noise_rad_s2=0.5)
COLUMNS = [0, 1, 2, 6, 7, 8]


def light(rows: RowBatch) -> RowLight:
    none = np.zeros(len(rows.first) - 1, dtype=np.int64)
    return RowLight(rows, none, none)


def navigator(generations, point_m=BODY, craft=1, **changes) -> StationNavigator:
    layout = pad([point_m] * craft, [np.tile([0.0, 0.0, 1.0], (len(point_m), 1))] * craft)
    settings = NavigationSettings(**{**SETTINGS.__dict__, **changes})
    return StationNavigator(layout, settings, room(generations), [NOISE] * len(generations))


def moving(craft: int, seed: int) -> State:
    rng = np.random.default_rng(seed)
    start = still(rot.exp(0.8 * rng.normal(size=(craft, 3))), 0.3 * rng.normal(size=(craft, 3)))
    return start._replace(velocity=0.1 * rng.normal(size=(craft, 3)), angular_rate=0.3 * rng.normal(size=(craft, 3)))


@pytest.mark.parametrize("generations", [(1, 1), (2, 2), (1, 2, 2)])
def test_found_from_nothing_and_consistent(generations):
    """Craft with accelerations as the filter takes them to have, sweeps all over the period: NEES in its band."""
    craft, periods, rng = 12, 25, np.random.default_rng(21)
    state, stations, one = moving(craft, 22), room(generations), navigator(generations, craft=12)
    error = np.empty((craft, 6))
    for _ in range(periods):
        push, torque = (0.5 * rng.normal(size=(craft, 3)) for _ in range(2))
        state = State(
            rot.exp(state.angular_rate * T + torque * T**2 / 2) @ state.rotation,
            state.position + state.velocity * T + push * T**2 / 2,
            state.velocity + push * T,
            state.angular_rate + torque * T,
        )
        estimate = one.step(light(seen(stations, BODY, state, [NOISE] * len(stations), rng, spread_s=0.8 * T)))
    assert (estimate.status == Status.TRACKING).all()
    assert (estimate.coupling == Coupling.TIGHT).all()
    assert np.all(estimate.stations == len(generations))
    assert (estimate.rows == 2 * len(generations) * len(BODY)).all()
    error[:, :3] = rot.log(state.rotation @ np.swapaxes(estimate.rotation, 1, 2))
    error[:, 3:] = state.position - estimate.position
    covariance = estimate.covariance[:, COLUMNS][:, :, COLUMNS]
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error).sum()
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 6 * craft)
    assert low < nees < high
    assert np.all(np.linalg.norm(error[:, 3:], axis=1) < estimate.integrity.position_m)


def test_a_plane_before_one_station_is_ambiguous_until_a_second_one_is_seen():
    state, stations, rng = (
        still(rot.exp(np.array([[0.5, 0.2, 0.3]])), np.zeros((1, 3))),
        room((2, 2)),
        np.random.default_rng(2),
    )
    one = navigator((2, 2), DECK, place_sigma_m=1e-4)
    for _ in range(8):
        rows = seen(stations, DECK, state, [NOISE] * 2, rng)
        estimate = one.step(light(rows.where(rows.station == 0)))
        assert estimate.status[0] == Status.AMBIGUOUS
        assert np.isnan(estimate.position).all()
    for _ in range(3):
        estimate = one.step(light(seen(stations, DECK, state, [NOISE] * 2, rng)))
    assert estimate.status[0] == Status.TRACKING
    assert rot.angle_between(estimate.rotation, state.rotation)[0] < 0.1


def test_a_reflection_before_one_station_is_dropped_there_only():
    state, stations, rng = still(np.eye(3)[None], np.zeros((1, 3))), room((1, 2)), np.random.default_rng(3)
    one = navigator((1, 2))
    for i in range(12):
        rows = seen(stations, BODY, state, [NOISE] * 2, rng)
        if i == 11:
            rows.angle[(rows.station == 0) & (rows.fan == 1) & (rows.photodiode == 3)] += 5e-3
        estimate = one.step(light(rows))
    assert estimate.integrity.dropped[0] == 1
    assert estimate.rows[0] == 2 * 2 * len(BODY) - 2
    # Five sigma: the false photodiode is out, not averaged in.
    assert np.linalg.norm(estimate.position[0]) < 5 * np.sqrt(np.trace(estimate.covariance[0][6:9, 6:9]))


def test_a_station_that_contradicts_all_is_left_out():
    state, stations, rng = still(np.eye(3)[None], np.zeros((1, 3))), room((2, 2, 2)), np.random.default_rng(4)
    one = navigator((2, 2, 2))
    for i in range(12):
        rows = seen(stations, BODY, state, [NOISE] * 3, rng)
        if i == 11:
            rows.angle[rows.station == 1] += 4e-3
        estimate = one.step(light(rows))
    assert estimate.stations is not None
    assert estimate.stations[0] == 2
    assert estimate.integrity.dropped[0] == len(BODY)


def test_of_two_hits_of_a_sweep_the_expected_one_is_taken():
    state, stations, rng = still(np.eye(3)[None], np.zeros((1, 3))), room((2, 2)), np.random.default_rng(5)
    one = navigator((2, 2))
    for i in range(6):
        rows = seen(stations, BODY, state, [NOISE] * 2, rng)
        if i == 5:
            first = Rows._make(part[:1] for part in rows[1:])
            twin = first._replace(angle=first.angle + 0.03)
            rows = RowBatch._make(
                (
                    rows.first + np.array([0, 1]),
                    *(np.concatenate([a[:1], b]) for a, b in zip(twin, rows[1:], strict=True)),
                )
            )
        estimate = one.step(light(rows))
    assert estimate.rows[0] == 2 * 2 * len(BODY)
    assert estimate.rejected[0] == 1
    # Without a track, neither is believed.
    assert navigator((2, 2)).step(light(rows)).rejected[0] == 2


def test_dark_periods_are_coasted_and_end():
    state, stations, rng = still(np.eye(3)[None], np.zeros((1, 3))), room((2,)), np.random.default_rng(6)
    one = navigator((2,), coast_limit_s=0.2)
    rows = seen(stations, BODY, state, [NOISE], rng)
    for _ in range(3):
        estimate = one.step(light(rows))
    assert estimate.status[0] == Status.TRACKING
    nothing = rows.where(np.zeros(len(rows.angle), dtype=np.bool_))
    for i in range(14):
        estimate = one.step(light(nothing))
        # One step more or less, by rounding of the sum of periods.
        if i < 8:
            assert estimate.status[0] == Status.COASTING
    assert estimate.status[0] == Status.SEARCHING
    one.forget(np.ones(1, dtype=np.bool_))
    assert np.isnan(one.step(light(nothing)).position).all()
