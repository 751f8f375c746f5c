"""Relative navigation: shared errors step by step, the message, gaps, a pair in flight, and a reference craft."""

from dataclasses import replace

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from estimators import rotation as rot
from estimators.filter.filterpy_bank import PoseFilterBank
from estimators.free_rotation import free_turns
from estimators.lighthouse.innovation import gathered, light_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import Rows, Station, linearise, packed
from estimators.lighthouse.shared import Common, considered_errors, pose_sensitivity, shared_sums
from estimators.lighthouse.sweep import FanErrors, lighthouse_1, lighthouse_2, measured_angles, measured_theta
from estimators.lighthouse.tilted import TiltedErrors
from estimators.relative.cross import cross_covariance
from estimators.relative.error_step import ErrorStep, predicted, started, sums_of_pose, updated
from estimators.relative.pose import covariance_between, covariance_bound, relative
from estimators.state import State
from swarm.errors import SwarmError
from swarm.flight.flight import Flight
from swarm.flight.simulate import simulate
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.pose_message import PoseMessage, bytes_per_second, decoded, encoded
from swarm.onboard.reference_craft import ReferenceCraft, ReferencePlace, ReferenceRows
from swarm.onboard.relative import FORGOTTEN, RelativeNavigation
from swarm.onboard.shared_errors import Relations, SharedErrors
from swarm.onboard.tracks import TrackLimits, Tracks
from swarm.report.sections.relative import section
from swarm.report.subject import Subject
from swarm.results.columns.pairs import pairs, relative_error
from swarm.scenario import load

POSE = np.array([0, 1, 2, 6, 7, 8])
FANS = {
    1: lighthouse_1(FanErrors(0.05, -0.002, -0.003, 1.0, 0.004), FanErrors(0.03, 0.003, 0.002, 2.0, 0.0)),
    2: lighthouse_2(
        TiltedErrors(0.0, 0.05, 0.3, 1.0, 0.003, 0.5, -0.3), TiltedErrors(-0.007, -0.046, 0.3, 2.0, 0.0, 0.9, -0.2)
    ),
}
POINT = np.random.default_rng(3).normal(size=(8, 3)) * 0.05
NOISE = AngleNoise(1.5e-5, 4e-5)
PAIR = [
    "duration_s=1",
    "swarm.count=0",
    'craft=[{name="a",motion={kind="hold",position_m=[0.0,0.0,3.0]}},'
    '{name="b",motion={kind="hold",position_m=[0.4,0.0,3.0]}}]',
    'pair=[{craft="a",to="b"}]',
    "recording.enabled=false",
]


def spread(rng, size=12, scale=1e-4):
    a = rng.standard_normal((size, size))
    return scale * (a @ a.T / size + 0.1 * np.eye(size))


def state(rng, craft=()):
    vector = (rng.uniform(-0.3, 0.3, (*craft, 3)) for _ in range(3))
    place, speed, rate = vector
    return State(rot.exp(rng.uniform(-2, 2, (*craft, 3))), place + np.array([0.0, 0.0, 3.0]), speed, rate)


def moved(at, x):
    return State(rot.exp(x[:3]) @ at.rotation, at.position + x[6:9], at.velocity + x[9:], at.angular_rate + x[3:6])


def test_derivatives_of_a_relative_state_are_those_of_finite_differences():
    rng = np.random.default_rng(0)
    a, b = state(rng), state(rng)
    there = relative(a, b)

    def error(x, y):
        other = relative(moved(a, x), moved(b, y))
        turn = rot.log(other.rotation @ there.rotation.T)
        rest = (getattr(other, n) - getattr(there, n) for n in ("angular_rate", "position", "velocity"))
        return np.concatenate([turn, *rest])

    step = 1e-6 * np.eye(12)
    zero = np.zeros(12)
    by_a = np.stack([(error(x, zero) - error(-x, zero)) / 2e-6 for x in step], axis=1)
    by_b = np.stack([(error(zero, x) - error(zero, -x)) / 2e-6 for x in step], axis=1)
    assert there.by_a == pytest.approx(by_a, abs=1e-8)
    assert there.by_b == pytest.approx(by_b, abs=1e-8)


@pytest.mark.parametrize("generation", [1, 2])
def test_sums_are_those_of_the_whole_noise_and_of_fans_that_are_off(generation):
    rng = np.random.default_rng(1)
    station = Station(rot.exp(np.array([0.1, -0.2, 0.3])), np.array([0.3, -0.1, 0.2]), FANS[generation])
    at = state(rng)
    index = np.array([(f, k) for f in (0, 1) for k in range(8) if f or k < 7])
    count = len(index)
    zero = np.zeros(count, dtype=np.int64)
    rows = Rows(zero, index[:, 0], index[:, 1], zero, rng.uniform(-4e-3, 4e-3, count), rng.uniform(-0.2, 0.2, count))
    batch = gathered(zero, rows, 1)
    errors = considered_errors([station])
    common, light = (
        Common(np.array([3e-5]), np.array([1 / 60]), np.zeros((2, len(errors.terms)))),
        light_of(packed([station]), [NOISE]),
    )
    state_of = State._make(part[None] for part in at)
    kept, mask = np.ones(count, dtype=np.bool_), np.ones(1, dtype=np.bool_)
    args = (batch, kept, mask, light, common, errors, POINT[None], state_of)
    own = batch.of(0)
    straight = linearise(own, packed([station]), POINT, at.rotation, at.position, at.velocity, at.angular_rate)
    h = straight.matrix
    fan = np.eye(2)[own.fan]
    r = NOISE.own_rad**2 * np.eye(count) + NOISE.shared_rad**2 * fan @ fan.T
    # The step of a derivative of its own, not that of the module.
    by, at_rest = 1e-5, station.fans
    d = np.zeros((count, len(errors.terms)))
    for column, (term, f) in enumerate(zip(errors.terms, errors.owner, strict=True)):
        part = [c for c in range(column + 1) if errors.owner[c] == f and errors.terms[c] == term].index(column)
        off = (_off(at_rest[f].errors, term, part, s * by) for s in (1, -1))
        both = [
            linearise(
                own,
                packed([station._replace(fans=[x._replace(errors=e) if i == f else x for i, x in enumerate(at_rest)])]),
                POINT,
                at.rotation,
                at.position,
                at.velocity,
                at.angular_rate,
            ).residual
            for e in off
        ]
        d[:, column] = -(both[0] - both[1]) / (2 * by)
    weighted = shared_sums(*args, weighted=True)
    inverse = np.linalg.inv(r)
    assert weighted.information[0] == pytest.approx(h.T @ inverse @ h, rel=1e-9)
    assert weighted.sweeps[0][:, [0, 2]] == pytest.approx(3e-5 * h.T @ inverse @ fan, rel=1e-9)
    assert not weighted.sweeps[0][:, [1, 3]].any()
    scale = np.abs(h.T @ inverse @ d).max(axis=0)
    assert weighted.considered[0] / scale == pytest.approx(h.T @ inverse @ d / scale, abs=1e-4)
    j = h[:, POSE]
    by_rotor, by_fans = pose_sensitivity(shared_sums(*args, weighted=False), mask)
    assert by_rotor[0][:, [0, 2]] == pytest.approx(3e-5 * np.linalg.lstsq(j, fan, rcond=None)[0], rel=1e-7)
    solved = np.linalg.lstsq(j, d, rcond=None)[0]
    assert by_fans[0] == pytest.approx(solved, rel=1e-3, abs=1e-3 * np.abs(solved).max())
    assert np.isnan(weighted.instant[0][[1, 3]]).all()


def _off(errors, term, part, by):
    if term in ("gibbous", "ogee"):
        phase, size = f"{term}_phase_rad", f"{term}_magnitude"
        wave = getattr(errors, size) * np.exp(1j * getattr(errors, phase)) + (by, 1j * by)[part]
        return errors._replace(**{phase: float(np.angle(wave)), size: float(np.abs(wave))})
    name = term if term == "curve" else f"{term}_rad"
    return errors._replace(**{name: getattr(errors, name) + by})


def test_a_period_of_two_filters_is_that_of_a_filter_of_both():
    """Gains of each alone, covariance of both together: F P F^T, (I - K H) P (I - K H)^T + K (G G^T) K^T."""
    rng = np.random.default_rng(2)
    f, h = rng.standard_normal((2, 2, 12, 12))
    h = h[:, :6]
    b = rng.standard_normal((2, 6, 6))
    h = np.zeros((2, 6, 12))
    h[:, np.arange(6), POSE], h[:, :, [3, 4, 5, 9, 10, 11]] = 1.0, b
    g, d = 1e-2 * rng.standard_normal((2, 6, 4)), rng.standard_normal((2, 6, 3))
    g[1, :, 3] = 0.0
    own = np.stack([spread(rng, 6, 1e-3) for _ in range(2)])
    before = spread(rng, 24)
    r = own + g @ np.swapaxes(g, 1, 2)
    both = np.zeros((24, 24))
    for i in (0, 1):
        part = slice(12 * i, 12 * i + 12)
        both[part, part] = f[i]
    p = both @ before @ both.T
    alone = np.stack([p[:12, :12], p[12:, 12:]]) + np.stack([spread(rng) for _ in range(2)])
    p[:12, :12], p[12:, 12:] = alone
    gain = [x @ m.T @ np.linalg.inv(m @ x @ m.T + n) for x, m, n in zip(alone, h, r, strict=True)]
    left = np.zeros((24, 24))
    k = np.zeros((24, 12))
    for i in (0, 1):
        left[12 * i : 12 * i + 12, 12 * i : 12 * i + 12] = np.eye(12) - gain[i] @ h[i]
        k[12 * i : 12 * i + 12, 6 * i : 6 * i + 6] = gain[i]
    noise = np.block([[r[0], g[0] @ g[1].T], [g[1] @ g[0].T, r[1]]])
    wanted = left @ p @ left.T + k @ noise @ k.T
    after = np.stack([(np.eye(12) - gain[i] @ h[i]) @ alone[i] for i in (0, 1)])
    yes = np.ones(2, dtype=np.bool_)
    instant = np.tile([-4e-3, np.nan, 4e-3, np.nan], (2, 1))
    # Draws 0 and 2 are common; what only one has in its slots 1 and 3 is without an instant.
    g_common = g.copy()
    step = predicted(f, yes, 4, 3)
    pose = np.broadcast_to(np.eye(6), (2, 6, 6))
    step = updated(step, yes, after, sums_of_pose(pose, b, (g_common, d, instant), yes, r))
    assert step.kept == pytest.approx(np.stack([(np.eye(12) - gain[i] @ h[i]) @ f[i] for i in (0, 1)]), rel=1e-6)
    assert step.considered == pytest.approx(np.stack([gain[i] @ d[i] for i in (0, 1)]), rel=1e-6)
    cross = cross_covariance(before[:12, 12:], step.of(0), step.of(1))
    apart = gain[0] @ g[0][:, [1, 3]] @ g[1][:, [1, 3]].T @ gain[1].T
    assert cross == pytest.approx(wanted[:12, 12:] - apart, rel=1e-6, abs=1e-12)
    begun = started(step, np.array([True, False]), g, d, instant)
    assert not begun.kept[0].any()
    assert begun.drawn[0][POSE] == pytest.approx(g[0])
    assert begun.kept[1] == pytest.approx(step.kept[1])


def test_the_bound_holds_for_every_correlation():
    rng = np.random.default_rng(4)
    there = relative(state(rng), state(rng))
    for _ in range(20):
        both = spread(rng, 24)
        own, other, cross = both[:12, :12], both[12:, 12:], both[:12, 12:]
        bound = covariance_bound(there, own, other)
        least = np.linalg.eigvalsh(bound - covariance_between(there, own, other, cross)).min()
        assert least > -1e-12


def message(rng, craft=3, period=7):
    step = ErrorStep(
        rng.standard_normal((12, 12)), 1e-4 * rng.standard_normal((12, 4)), np.zeros((12, 10)), rng.uniform(-1, 1, 4)
    )
    return PoseMessage(
        craft, period, state(rng), spread(rng), step, rng.standard_normal((12, 10)), np.array([0.01, 0.02])
    )


def test_a_message_is_read_as_it_was_sent_to_single_precision():
    sent = message(np.random.default_rng(5))
    data = encoded(sent)
    read = decoded(data)
    assert len(data) == bytes_per_second(4, 10, 1.0) == 1657
    assert (read.craft, read.period) == (3, 7)
    assert read.state.position.tolist() == sent.state.position.tolist()
    assert read.state.rotation == pytest.approx(sent.state.rotation, abs=1e-6)
    for name in ("covariance", "sensitivity", "fault"):
        assert getattr(read, name) == pytest.approx(getattr(sent, name), rel=1e-6)
    for name in ("kept", "drawn", "instant"):
        assert getattr(read.step, name) == pytest.approx(getattr(sent.step, name), rel=1e-6)
    for wrong in (data[:5], data[:-4], data + b"0"):
        with pytest.raises(ValueError, match="bytes"):
            decoded(wrong)


def test_after_a_gap_any_correlation_is_allowed_for_until_it_is_forgotten():
    station = Station(np.eye(3), np.zeros(3), FANS[1])
    relations = Relations(((0, 1),), ((0.05, np.inf),), (3e-5,), (1 / 60,))
    errors = SharedErrors(relations, [station], [NOISE], np.zeros((2, 8, 3)))
    navigation = RelativeNavigation(relations, errors)
    rng = np.random.default_rng(6)
    at, p, yes = state(rng, (2,)), np.stack([spread(rng), spread(rng)]), np.ones(2, dtype=np.bool_)

    def step(keeps, active=yes):
        kept, drawn = np.tile(keeps * np.eye(12), (2, 1, 1)), np.full((2, 12, 4), 1e-3)
        errors.step = ErrorStep(kept, drawn, np.zeros((2, 12, 0)), np.tile([-4e-3, np.nan, 4e-3, np.nan], (2, 1)))
        return navigation.step(active, at, p, np.zeros((2, 2)))

    assert step(0.0).correlated[0]  # both filters start: nothing is missing
    assert step(0.9).correlated[0]
    silent = step(0.9, np.array([True, False]))
    assert not silent.correlated[0]
    assert np.isnan(silent.covariance).all()
    assert silent.alert[0]
    back = step(0.5)
    assert not back.correlated[0]
    assert back.covariance[0] == pytest.approx(back.bound[0])
    periods = int(np.ceil(np.log(FORGOTTEN) / np.log(0.25)))
    known = [step(0.5).correlated[0] for _ in range(periods)]
    assert known == [False] * (periods - 1) + [True]


def flown(overrides, periods):
    flight = Flight(load("static", overrides))
    return flight, [flight.period(frame) for frame in range(periods)]


def test_a_pair_in_flight_knows_more_across_the_light_than_of_independent_errors():
    flight, flown_periods = flown(PAIR, 40)
    last = flown_periods[-1]
    found, truth = last.estimate.relative, last.truth
    turn = last.estimate.rotation[0]
    own, apart = (turn @ part[0, 6:9, 6:9] @ turn.T for part in (found.covariance, found.independent))
    assert found.correlated.all()
    assert 1.3 < np.sqrt(np.trace(apart[:2, :2]) / np.trace(own[:2, :2])) < 2.0
    assert own[2, 2] == pytest.approx(apart[2, 2], rel=0.05)
    group = pairs(flight.world.names, [(0, 1)])
    out = np.empty((len(group.columns), 2))
    group.fill(last, out)
    named = dict(zip([column.name for column in group.columns], out[:, 0], strict=True))
    error = relative_error(found.rotation[0], found.position[0], truth, 0, 1)
    assert np.isnan(out[:, 1]).all()
    assert named["to_b_position_error_m"] == pytest.approx(np.linalg.norm(error[3:]))
    assert named["to_b_position_error_m"] < 4 * named["to_b_position_sigma_m"]
    pose = found.covariance[0][np.ix_(POSE, POSE)]
    assert named["to_b_nees"] == pytest.approx(error @ np.linalg.solve(pose, error))
    assert named["to_b_position_sigma_m"] < named["to_b_independent_sigma_m"] < named["to_b_bound_sigma_m"]


def test_the_summary_tells_of_every_pair_and_what_its_messages_cost(tmp_path):
    run = simulate(load("static", [*PAIR, "duration_s=0.5"]), out=tmp_path / "run", record=False)
    craft, table = run.summary["craft"], pq.read_table(tmp_path / "run" / "telemetry.parquet")
    assert "relative" not in craft["b"]
    said, of = craft["a"]["relative"]["b"], table.filter(pc.equal(table["craft"], "a"))
    error, sigma = (of[f"to_b_position_{name}_m"].drop_null().to_numpy() for name in ("error", "sigma"))
    assert said["samples"] == len(sigma) > 20
    assert said["position_rms_m"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert said["position_sigma_m"] == pytest.approx(np.sqrt(np.mean(sigma**2)))
    assert said["bytes_per_second"] == pytest.approx(bytes_per_second(4, 0, 60.0)) == 60 * 1177
    told = section(Subject(run))
    assert told is not None
    assert told.paragraphs[0].startswith("a knows b, from messages of 1177 bytes, 70.6 kB/s, with a position sigma of")


def test_levels_count_the_faults_of_both_and_raise_the_alert_of_the_pair():
    limited = [x.replace('to="b"', 'to="b",alert_position_mm=1.0') for x in PAIR]
    flight, run = flown(limited, 5)
    last = run[-1].estimate
    found, levels = last.relative, last.integrity.levels
    k = flight.computer.navigator._relative.quantile
    place, turn = ([np.sqrt(np.trace(p[i : i + 3, i : i + 3])) for p in last.covariance] for i in (6, 0))
    faults = levels - k * np.array([place, turn])
    assert (faults > 0).all()
    own = [np.sqrt(np.trace(found.covariance[0, i : i + 3, i : i + 3])) for i in (6, 0)]
    apart = np.linalg.norm(found.position[0])
    wanted = k * own[0] + faults[0].sum() + apart * faults[1, 0], k * own[1] + faults[1].sum()
    assert (found.position_level_m[0], found.attitude_level_rad[0]) == pytest.approx(wanted, rel=1e-5)
    group = pairs(flight.world.names, [(0, 1)])
    out = np.empty((len(group.columns), 2))
    group.fill(run[-1], out)
    assert out[-1, 0] == found.alert[0] == 1.0
    _, calm = flown([x.replace('to="b"', 'to="b",alert_position_mm=1000.0') for x in PAIR], 5)
    assert not calm[-1].estimate.relative.alert[0]


def test_turns_without_torque_are_in_what_a_period_keeps():
    station = Station(np.eye(3), np.zeros(3), FANS[1])
    relations = Relations(((0, 1),), (), (3e-5,), (1 / 60,))
    errors = SharedErrors(relations, [station], [NOISE], np.zeros((2, 8, 3)))
    bank, yes = PoseFilterBank(2), np.ones(2, dtype=np.bool_)
    bank.start(yes, np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), 1e-6 * np.tile(np.eye(6), (2, 1, 1)), (0.1, 0.1))
    turning = bank.state._replace(angular_rate=np.tile([0.2, -0.1, 0.3], (2, 1)))
    bank.adopt(yes, turning, bank.covariance)
    before = bank.transition(0.02)
    # The first craft turns freely; of the other one the torque is not known.
    inertia = np.stack([np.diag([1.0, 2.0, 2.5]), np.full((3, 3), np.nan)])
    tracks = Tracks(bank, 0.02, TrackLimits(2.0, 6), None, inertia)
    errors.predict(tracks, None, 0.02, history=False)
    free = np.array([True, False])
    coupling = free_turns(free, turning.rotation, turning.angular_rate, inertia, np.linalg.inv(inertia), 0.02).coupling
    assert errors.step.kept[0, :6] == pytest.approx(coupling[0] @ before[0, :6])
    assert errors.step.kept[0, 6:].tolist() == before[0, 6:].tolist()
    assert errors.step.kept[1].tolist() == before[1].tolist()


def test_considered_fan_errors_widen_what_a_craft_knows_of_itself_only():
    _, without = flown(PAIR, 30)
    _, considered = flown([*PAIR, "navigation.fan_sigma={phase_rad=1e-3,gibbous_magnitude=2e-4}"], 30)
    sizes = [
        [np.sqrt(np.trace(p[0, 6:9, 6:9])) for p in (run[-1].estimate.covariance, run[-1].estimate.relative.covariance)]
        for run in (without, considered)
    ]
    # The filter itself is the same; a phase of 1 mrad is a shift of 3 mm at 3 m in either axis.
    assert considered[-1].estimate.position == pytest.approx(without[-1].estimate.position, abs=1e-12)
    assert sizes[1][0] == pytest.approx(np.sqrt(2) * 3e-3, rel=0.1)
    assert sizes[1][1] < 1.1 * sizes[0][1]


@pytest.mark.parametrize("kind", ["lighthouse-1", "lighthouse-2"])
def test_a_pair_before_two_stations(kind):
    stations = ",".join(
        f'{{name="{name}",kind="{kind}",position_m=[{x},0.0,0.0],attitude={{towards_m=[0.2,0.0,3.0]}}}}'
        for name, x in (("s", -1.0), ("t", 1.0))
    )
    _, run = flown([*PAIR, f"station=[{stations}]"], 30)
    found = run[-1].estimate.relative
    assert found.correlated.all()
    error = relative_error(found.rotation[0], found.position[0], run[-1].truth, 0, 1)
    pose = found.covariance[0][np.ix_(POSE, POSE)]
    assert error @ np.linalg.solve(pose, error) < 30
    assert np.trace(found.covariance[0][6:9, 6:9]) < np.trace(found.independent[0][6:9, 6:9])


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ('{craft="a",to="c"}', "no craft has this name"),
        ('{craft="a",to="a"}', "a craft has no pose relative to itself"),
        ('{craft="a",to="b"},{craft="a",to="b"}', "another pair is of the same two craft"),
    ],
)
def test_pairs_that_are_none(table, message):
    with pytest.raises(SwarmError, match=message):
        load("static", [*PAIR, f"pair=[{table}]"])


def test_poses_of_a_bank_make_the_step_that_the_bank_made():
    """The gain read off a filter's covariances is the one with which its state has moved."""
    rng = np.random.default_rng(8)
    bank, yes = PoseFilterBank(1), np.ones(1, dtype=np.bool_)
    bank.start(yes, np.eye(3)[None], np.zeros((1, 3)), 1e-6 * np.eye(6)[None], (0.1, 0.1), np.zeros((1, 6, 6)))
    step = predicted(bank.transition(0.02), bank.active, 0, 6)
    bank.predict(0.02, yes)
    shift, r, b = 1e-4 * rng.standard_normal(6), spread(rng, 6, 1e-6)[None], 1e-3 * rng.standard_normal((1, 6, 6))
    before = bank.state
    bank.update_pose(yes, rot.exp(shift[:3])[None], shift[None, 3:], r, b)
    d = np.eye(6)[None]
    nothing = np.zeros((1, 6, 0)), d, np.zeros((1, 0))
    step = updated(step, yes, bank.covariance, sums_of_pose(d, b, nothing, yes, r))
    went = np.concatenate([rot.log(bank.rotation[0] @ before.rotation[0].T), bank.angular_rate[0]])
    went = np.concatenate([went, bank.position[0] - before.position[0], bank.velocity[0]])
    assert step.considered[0] @ shift == pytest.approx(went, rel=1e-4, abs=1e-9)


def test_settings_without_pairs_cost_nothing():
    flight = Flight(load("static", ["duration_s=1"]))
    assert not flight.computer.navigator._shared.wanted
    assert flight.period(0).estimate.relative is None
    assert not replace(flight.computer.navigator.settings).relations.any


def reference_of(rng, errors):
    """A reference craft and the angles of three craft, of which it is the second, with these errors of the sweeps."""
    place = ReferencePlace(1, rot.exp(np.array([0.1, 0.2, -0.3])), np.array([0.4, -0.2, 3.0]))
    fans = FanErrors(0.02, 0.001, 0.002, 0.3, 0.004), FanErrors(-0.01, 0.002, 0.001, 1.3, 0.004)
    craft = ReferenceCraft([place], np.stack([POINT] * 3), fans, NOISE, 3.9e-5)
    theta = np.full((3, 8, 2), 1.5)
    there = POINT @ place.rotation.T + place.position
    theta[1] = measured_theta(there, fans) + errors + NOISE.own_rad * rng.standard_normal((8, 2))
    none = np.zeros(3, dtype=np.int64)
    return craft, SweepAngles(theta, np.zeros_like(theta), np.isfinite(theta).all(axis=2), none, none, none)


def test_a_reference_craft_finds_what_all_angles_of_a_sweep_are_off_by():
    rng, errors = np.random.default_rng(9), np.array([1.2e-4, -4e-5])
    craft, angles = reference_of(rng, errors)
    angles.theta[1, 2, 0] += 2e-3  # a reflection
    angles.theta[1, 5] = np.nan
    found = craft.observe(angles)
    assert found.used.sum(axis=1).tolist() == [6, 7]
    assert found.error == pytest.approx(errors, abs=4 * NOISE.own_rad / np.sqrt(6))
    rounding = NOISE.shared_rad**2 - 3.9e-5**2
    assert found.common_rad**2 == pytest.approx(rounding + NOISE.own_rad**2 / 6)
    assert found.noise.shared_rad**2 == pytest.approx(found.common_rad**2 + rounding)
    assert found.taken_off(angles).theta[0, 0] == pytest.approx(1.5 - found.error)
    angles.theta[1, :, 1] = np.nan
    assert craft.observe(angles) is None


def test_two_references_are_one_of_all_their_photodiodes():
    """Their noise is that of the mean of both, and of the rounding of two flashes."""
    rng, errors = np.random.default_rng(10), np.array([1.2e-4, -4e-5])
    places = [
        ReferencePlace(c, rot.exp(np.array([0.1, 0.2, -0.3 * c])), np.array([0.4 * c, -0.2, 3.0])) for c in (0, 2)
    ]
    fans, none = (FanErrors(), FanErrors()), np.zeros(3, dtype=np.int64)
    craft = ReferenceCraft(places, np.stack([POINT] * 3), fans, NOISE, 3.9e-5)
    found = []
    for _ in range(400):
        theta = np.full((3, 8, 2), 1.5)
        for place in places:
            flash = np.sqrt(NOISE.shared_rad**2 - 3.9e-5**2) * rng.standard_normal(2)
            own = NOISE.own_rad * rng.standard_normal((8, 2))
            theta[place.craft] = measured_theta(place.points(np.stack([POINT] * 3)), fans) + errors + flash + own
        theta[0, :2] = np.nan
        one = craft.observe(SweepAngles(theta, np.zeros_like(theta), np.isfinite(theta[..., 0]), none, none, none))
        assert one is not None
        found.append(one)
    off = np.array([one.error for one in found]) - errors
    rounding = NOISE.shared_rad**2 - 3.9e-5**2
    assert found[0].common_rad ** 2 == pytest.approx(rounding * (6**2 + 8**2) / 14**2 + NOISE.own_rad**2 / 14)
    assert off.std() == pytest.approx(found[0].common_rad, rel=0.1)
    theta[2, :, 0] = np.nan
    alone = craft.observe(SweepAngles(theta, np.zeros_like(theta), np.isfinite(theta[..., 0]), none, none, none))
    assert alone is not None
    assert alone.used[:, :8].sum(axis=1).tolist() == [6, 6]
    assert not alone.used[:, 8:].any()


def test_rows_of_stations_are_without_the_errors_that_a_reference_has_found():
    rng, turn = np.random.default_rng(11), 1 / 60
    place = ReferencePlace(1, rot.exp(np.array([0.1, 0.2, -0.3])), np.array([0.4, -0.2, 3.0]))
    known = [Station(np.eye(3), np.array([x, 0.0, 0.0]), FANS[2]) for x in (-1.0, 1.0, 3.0)]
    point = np.stack([POINT] * 2)
    craft = ReferenceRows([place], point, known, [NOISE] * 3, [NOISE.shared_rad] * 3, [turn] * 3)
    loose, errors = [], 1e-4 * rng.standard_normal((3, 2))
    # The reference sees both fans of the first station, one of the second, and none of the third.
    for c, s, fan in [(c, s, f) for c in (0, 1) for s in range(3) for f in (0, 1) if c == 0 or 2 * s + f < 3]:
        there = (place.points(point) - known[s].position) @ known[s].rotation
        angle = measured_angles(there, known[s].fans)[:, fan]
        at = -0.002 * (1 + 2 * s + fan) + angle * turn / (2 * np.pi)
        loose += [(c, s, fan, k, at[k], angle[k] + errors[s, fan]) for k in range(8)]
    who, station, plane, photodiode, instant, measured = (np.array(part) for part in zip(*loose, strict=True))
    measured[(who == 1) & (station == 0) & (plane == 0) & (photodiode == 3)] += 3e-3
    rows = gathered(who, Rows(station, plane, photodiode, np.zeros_like(station), instant, measured), 2)
    found = craft.observe(rows)
    own = found.rows.of(0)
    assert np.bincount(2 * own.station + own.fan, minlength=6).tolist() == [8, 8, 8, 0, 8, 8]
    for s, fan, left in ((0, 0, 0.0), (0, 1, 0.0), (1, 0, 0.0), (2, 0, errors[2, 0]), (2, 1, errors[2, 1])):
        there = (place.points(point) - known[s].position) @ known[s].rotation
        of = (own.station == s) & (own.fan == fan)
        assert own.angle[of] == pytest.approx(measured_angles(there, known[s].fans)[:, fan] + left, abs=1e-12)
    assert found.noise[0].shared_rad ** 2 == pytest.approx(NOISE.own_rad**2 / 7)
    assert found.noise[1].shared_rad ** 2 == pytest.approx(NOISE.own_rad**2 / 8)
    assert found.noise[2] == NOISE


def test_before_a_station_a_reference_is_worth_what_it_is_before_the_lighthouse():
    light = 'station=[{name="light",kind="lighthouse-1",position_m=[0.0,0.0,0.0]}]'
    lateral, sigma = [], []
    for more in ([], ['navigation.reference="base"']):
        _, run = flown([*REFERRED, light, *more], 90)
        error = np.array([p.truth.position[0] - p.estimate.position[0] for p in run[40:]])
        covariance = np.mean([p.estimate.covariance[0, 6:8, 6:8] for p in run[40:]], axis=0)
        lateral.append(np.sqrt(np.mean(error[:, :2] ** 2)))
        sigma.append(np.sqrt(np.trace(covariance) / 2))
    assert lateral[1] < 0.4 * lateral[0]
    assert sigma[1] < 0.35 * sigma[0]
    assert lateral[1] == pytest.approx(sigma[1], rel=0.3)


REFERRED = [
    "duration_s=2",
    "swarm.count=0",
    "recording.enabled=false",
    'craft=[{name="probe",motion={kind="drift",position_m=[0.0,0.0,3.0]}},'
    '{name="base",motion={kind="hold",position_m=[-0.5,0.0,3.0]}}]',
]


def test_with_a_reference_craft_errors_across_the_light_are_a_third_and_promised():
    lateral, along, sigma = {}, {}, {}
    for name, more in (("without", []), ("with", ['navigation.reference="base"'])):
        _, run = flown([*REFERRED, *more], 100)
        error = np.array([p.truth.position[0] - p.estimate.position[0] for p in run[40:]])
        covariance = np.mean([p.estimate.covariance[0, 6:9, 6:9] for p in run[40:]], axis=0)
        lateral[name], along[name] = np.sqrt(np.mean(error[:, :2] ** 2)), np.sqrt(np.mean(error[:, 2] ** 2))
        sigma[name] = np.sqrt(np.trace(covariance[:2, :2]) / 2)
    assert lateral["with"] < 0.4 * lateral["without"]
    assert along["with"] == pytest.approx(along["without"], rel=0.05)
    assert sigma["with"] < 0.35 * sigma["without"]
    assert lateral["with"] == pytest.approx(sigma["with"], rel=0.3)


def test_what_a_reference_takes_off_is_not_considered_any_more():
    """A constant error of a fan is the same at the reference: it leaves next to nothing in a covariance."""
    considered = [*PAIR, "navigation.fan_sigma={phase_rad=1e-3}"]
    _, run = flown(considered, 30)
    _, referred = flown([*considered, 'navigation.reference="b"'], 30)
    own = [np.sqrt(np.trace(p[-1].estimate.covariance[0, 6:9, 6:9])) for p in (run, referred)]
    assert own[0] > 4e-3
    assert own[1] < 1e-3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ('navigation.reference="nobody"', "no craft has this name"),
        ('navigation.reference="probe"', "must hold its position without spin"),
    ],
)
def test_references_that_are_none(change, message):
    with pytest.raises(SwarmError, match=message):
        load("static", [*REFERRED, change])
