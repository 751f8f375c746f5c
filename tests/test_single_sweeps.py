"""Navigation by single sweeps: the rows' noise, corrections about a pivot, two models of motion, few photodiodes."""

from dataclasses import replace

import numpy as np
import pytest

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank
from estimators.filter.compiled import CompiledFilterBank
from estimators.filter.compiled_interacting import CompiledInteractingBank
from estimators.filter.error_state import (
    DEFAULT_ACCELERATION_NOISE_M_S2,
    DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2,
    POSE_COLUMNS,
)
from estimators.filter.filterpy_bank import PoseFilterBank
from estimators.filter.filterpy_interacting import FilterpyInteractingBank
from estimators.filter.interacting import InteractingBank
from estimators.free_rotation import free_turns
from estimators.lighthouse.innovation import RowBatch, innovations, light_of, rows_of_sweeps
from estimators.lighthouse.integrity import AngleNoise, shown_to_gate
from estimators.lighthouse.row_faults import row_faults
from estimators.lighthouse.row_screen import agreeing
from estimators.lighthouse.row_sums import _root_of_sums, _solve_pose, condense, pose_sums
from estimators.lighthouse.rows import AT_ORIGIN, linearise, packed
from estimators.lighthouse.sweep import ideal_theta
from estimators.pivot import ARMS, PIVOT, shear_into, turn_about
from estimators.state import STATES, State
from swarm.hardware import pad
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.navigation import Navigator
from swarm.onboard.settings import Coupling, NavigationSettings, QuietModel, Status
from swarm.onboard.single_sweeps import SingleSweeps
from swarm.onboard.tracks import PoseFix, TrackLimits, Tracks

T, CRAFT = 1 / 60, 4
STATION = packed([AT_ORIGIN])
NOISE = AngleNoise(1.5e-5, 4.0e-5)
SIGMA = float(np.hypot(*NOISE))
SETTINGS = NavigationSettings(T, SIGMA, (NOISE.shared_rad / SIGMA) ** 2)
OFFSETS = np.array([-T / 4, T / 4])
POINTS = np.array(
    [[5, 1, 1], [-4, 4, 2], [1, -3, 3], [2, 2, 4], [-2, 2, 4], [-2, -2, 4], [2, -2, 4], [4, 4, 1]]
) * np.array(0.01)
BANKS: list[type[FilterBank]] = [PoseFilterBank, CompiledFilterBank]
INTERACTING: list[type[FilterBank]] = [FilterpyInteractingBank, CompiledInteractingBank]


def every(craft: int = CRAFT) -> Bools:
    return np.ones(craft, dtype=np.bool_)


def still(craft: int = CRAFT) -> State:
    rng, nothing = np.random.default_rng(1), np.zeros((craft, 3))
    facing = rot.exp(np.array([0.0, np.pi - 0.3, 0.0]))
    return State(
        facing @ rot.exp(0.1 * rng.standard_normal((craft, 3))),
        np.array([0.1, -0.2, 3.0]) + 0.1 * rng.standard_normal((craft, 3)),
        nothing,
        nothing.copy(),
    )


def seen(state: State, rng: np.random.Generator, shown: int, noise: float = 1.0) -> tuple[Floats, Floats]:
    """Angles of craft at rest, NaN beyond the first `shown` photodiodes; every craft has a rotor of its own."""
    theta = ideal_theta(np.einsum("cij,kj->cki", state.rotation, POINTS) + state.position[:, None])
    rotor = NOISE.shared_rad * rng.standard_normal((len(theta), 1, 2))
    theta = theta + noise * (rotor + NOISE.own_rad * rng.standard_normal(theta.shape))
    theta[:, shown:] = np.nan
    return theta, np.where(np.isfinite(theta), OFFSETS, 0.0)


def rows_at(state: State, shown: int, seed: int = 0):
    theta, offset = seen(state, np.random.default_rng(seed), shown)
    rows = rows_of_sweeps(theta, offset)
    point = np.tile(POINTS, (len(theta), 1, 1))
    return (
        rows,
        point,
        innovations(rows, np.ones(len(rows.angle), np.bool_), every(), light_of(STATION, [NOISE]), point, state),
    )


def covariance_of(rows) -> Floats:
    same = rows.fan[:, None] == rows.fan
    return NOISE.own_rad**2 * np.eye(len(same)) + NOISE.shared_rad**2 * same


@pytest.mark.parametrize("shown", [1, 3, 8])
def test_whitened_rows_have_the_information_of_the_rows(shown):
    state = still()
    rows, point, found = rows_at(state, shown)
    for c in range(CRAFT):
        own, n = rows.of(c), found.number[c]
        one = state.of(c)
        y, h = linearise(own, STATION, point[c], one.rotation, one.position, one.velocity, one.angular_rate)
        inverse = np.linalg.inv(covariance_of(own))
        assert n == 2 * shown
        white, scale = found.h[c, :n], np.sqrt(np.diag(h.T @ inverse @ h))
        np.testing.assert_allclose(white.T @ white, h.T @ inverse @ h, rtol=0, atol=1e-9 * np.outer(scale, scale).max())
        np.testing.assert_allclose(found.y[c, :n] @ found.y[c, :n], y @ inverse @ y, rtol=1e-9)
        np.testing.assert_allclose(found.pivot[c, :3], POINTS[:shown].mean(axis=0), atol=1e-15)


def started(kind: type[FilterBank], state: State, wide: float = 1.0, speed: float = 0.05) -> FilterBank:
    count = len(state.position)
    if issubclass(kind, InteractingBank):
        bank: FilterBank = kind([(0.2, 0.2), (0.02, 0.02)], 2.0, 30.0, np.full(count, 2), 0.999999)
    else:
        bank = kind(count, acceleration_noise_m_s2=0.2, gate_probability=0.999999)
    p = np.tile(1e-6 * wide**2 * np.eye(6), (count, 1, 1))
    bank.start(every(count), state.rotation, state.position, p, (speed, speed))
    bank.predict(T, every(len(p)))
    return bank


@pytest.mark.parametrize("wide", [1.0, 30.0])
@pytest.mark.parametrize("shown", [1, 2, 8])
def test_both_banks_take_independent_rows_alike(shown, wide):
    state = still()
    banks = [started(kind, state, wide) for kind in BANKS]
    for seed in range(5):
        _, _, found = rows_at(banks[0].state, shown, seed)
        found, angles = condense(found, every(), banks[0].covariance)
        given = found.y, found.h, np.ones_like(found.y), found.number, found.pivot, angles
        results = [b.update(every(), *given) for b in banks]
        np.testing.assert_array_equal(results[0].accepted, results[1].accepted)
        np.testing.assert_allclose(results[0].nis, results[1].nis, rtol=1e-9)
        np.testing.assert_allclose(results[0].log_determinant, results[1].log_determinant, rtol=1e-9, atol=1e-9)
        scale = np.sqrt(np.einsum("cii->ci", banks[0].covariance))
        off = (banks[0].covariance - banks[1].covariance) / (scale[:, :, None] * scale[:, None])
        assert np.abs(off).max() < 1e-9
        for name in ("rotation", "position", "velocity", "angular_rate"):
            np.testing.assert_allclose(getattr(banks[0], name), getattr(banks[1], name), rtol=1e-9, atol=1e-12)


def test_a_large_turn_leaves_the_pivot_in_its_place_and_the_shear_is_its_derivative():
    rng = np.random.default_rng(0)
    r, p, w, v, b = rot.exp(rng.standard_normal(3)), *rng.standard_normal((3, 3)), 0.1 * rng.standard_normal(3)
    d, dw = 0.5 * rng.standard_normal(3), 0.3 * rng.standard_normal(3)
    arm = r @ b
    x = np.concatenate([d, dw, -np.cross(d, arm), -np.cross(dw, arm) - np.cross(w, np.cross(d, arm))])

    def moved(error: Floats, arms: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        state = r.copy(), w.copy(), p.copy(), v.copy()
        turn_about(*state, error, np.append(b, np.zeros(PIVOT - 3)), arms)
        return state

    turned, rate, position, velocity = moved(x, np.empty(ARMS))
    np.testing.assert_allclose(position + turned @ b, p + arm, atol=1e-14)
    np.testing.assert_allclose(velocity + np.cross(rate, turned @ b), v + np.cross(w, arm), atol=1e-14)
    # In the pivot's coordinates B (d, dw, dp, dv) of the errors before and after, the place and its velocity are equal.
    arms, matrix = np.empty(ARMS), np.empty((12, 12))
    base = moved(x, arms)
    shear_into(arms, matrix)
    before, after = of_pivot(arm, w), of_pivot(turned @ b, rate)
    np.testing.assert_allclose(after @ matrix, before, atol=1e-14)
    for i in range(12):
        step = 1e-6 * np.eye(12)[i]
        one, other = moved(x + step, np.empty(ARMS)), moved(x - step, np.empty(ARMS))
        turn = rot.log(one[0] @ base[0].T) - rot.log(other[0] @ base[0].T)
        column = np.concatenate([turn, *(a - c for a, c in zip(one[1:], other[1:], strict=True))]) / 2e-6
        np.testing.assert_allclose((after @ column)[6:], before[6:, i], atol=1e-8)


def test_of_two_photodiodes_what_the_light_leaves_open_is_straight():
    """Apparent direction and length of the line between them, its tilt and the turn about it, and their rates."""
    rng = np.random.default_rng(5)
    turned, station, line = rot.exp(rng.standard_normal(3)), np.array([0.2, -0.1, 0.0]), np.array([0.05, 0.02, -0.01])
    p, w, b = np.array([0.3, 0.2, 3.0]), 0.2 * rng.standard_normal(3), 0.03 * rng.standard_normal(3)
    arm = turned @ b
    n = (p + arm - station) / np.linalg.norm(p + arm - station)
    base = State(turned, p, 0.05 * n - np.cross(w, arm), w)
    aside = np.cross(line, [1.0, 0.0, 0.0])

    def angles(s: State) -> Floats:
        q, e, f = s.position + s.rotation @ b - station, s.rotation @ line, s.rotation @ aside
        n = q / np.linalg.norm(q)
        across = e - n * (n @ e)
        k = np.cross(e, n)
        spin = np.arctan2(f @ np.cross(e / np.linalg.norm(e), k), f @ k)
        lies = np.arctan2(across @ np.cross(n, [1.0, 0.0, 0.0]), across[0])
        return np.array(
            [lies, np.arctan2(n @ e, np.linalg.norm(across)), spin, np.log(np.linalg.norm(q) / np.linalg.norm(across))]
        )

    def seen(s: State) -> Floats:
        ahead, behind = (angles(s.ahead(h)) for h in (1e-4, -1e-4))
        return np.concatenate([angles(s), (ahead - behind) / 2e-4])

    def moved(s: State, x: Floats, arms: Floats) -> State:
        out, pivot = State._make(part.copy() for part in s), np.concatenate([b, line, station])
        turn_about(out.rotation, out.angular_rate, out.position, out.velocity, x, pivot, arms)
        return out

    def plain(s: State, x: Floats) -> State:
        return State(rot.exp(x[:3]) @ s.rotation, s.position + x[6:9], s.velocity + x[9:], s.angular_rate + x[3:6])

    def slope(s: State) -> Floats:
        pairs = [[seen(plain(s, h * one)) for h in (1e-5, -1e-5)] for one in np.eye(12)]
        return np.array([(one - other) / 2e-5 for one, other in pairs]).T

    # Errors of turn and rate about the pivot, and along the line of sight.
    along = [np.concatenate([np.zeros(6), n, np.zeros(3)]), np.concatenate([np.zeros(9), n])]
    free = np.linalg.inv(of_pivot(arm, w)) @ np.vstack([np.eye(12)[:6], along]).T
    arms, matrix = np.empty(ARMS), np.empty((12, 12))
    x = free @ np.array([0.2, -0.25, 0.15, 0.1, 0.05, -0.1, 0.1, 0.02])
    after = moved(base, x, arms)
    shear_into(arms, matrix)
    np.testing.assert_allclose(seen(after), seen(base) + slope(base) @ x, atol=1e-6)
    np.testing.assert_allclose(slope(after) @ matrix @ free, slope(base) @ free, atol=1e-5)
    assert np.abs(slope(after) @ free - slope(base) @ free).max() > 0.05, "the slopes themselves are others"


def of_pivot(arm: Floats, rate: Floats) -> Floats:
    """B, (12, 12)."""
    out = np.eye(12)
    out[6:9, :3] = out[9:, 3:6] = -rot.skew(arm)
    out[9:, :3] = -rot.skew(rate) @ rot.skew(arm)
    return out


def test_a_false_photodiode_is_found_by_the_prediction_alone():
    state = still(1)
    bank = started(CompiledFilterBank, state)
    theta, offset = seen(bank.state, np.random.default_rng(3), 3)
    theta[0, 1] += 0.05
    rows = rows_of_sweeps(theta, offset).of(0)
    gate = shown_to_gate(np.full(7, 30.0), 1e-4)
    kept = agreeing(rows, STATION, POINTS, bank.state.of(0), bank.covariance[0], [NOISE], gate)
    assert kept is not None
    assert set(rows.photodiode[~kept]) == {1}
    theta[0, :3] += 0.05 * np.arange(3)[:, None]
    rows = rows_of_sweeps(theta, offset).of(0)
    assert agreeing(rows, STATION, POINTS, bank.state.of(0), bank.covariance[0], [NOISE], gate) is None


@pytest.mark.parametrize("shown", [2, 3])
def test_what_an_undetected_fault_does_is_within_the_slope(shown):
    state, rng = still(1), np.random.default_rng(4)
    bank = started(CompiledFilterBank, state)
    for _ in range(60):
        bank.predict(T, every(1))
        theta, offset = seen(state, rng, 8, noise=0.0)
        rows = rows_of_sweeps(theta, offset)
        give(bank, rows)
    bank.predict(T, every(1))
    theta, offset = seen(state, rng, shown, noise=0.0)
    rows = rows_of_sweeps(theta, offset)
    first, p, one = rows.of(0), bank.covariance[0], bank.state.of(0)
    h = linearise(first, STATION, POINTS, one.rotation, one.position, one.velocity, one.angular_rate).matrix
    shown_by = np.linalg.inv(h @ p @ h.T + covariance_of(first))
    worst = 0.0
    for bias in np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, -1.0]]):
        false = np.where(first.photodiode == 1, bias[first.fan], 0.0)
        lying = theta.copy()
        lying[0, 1] += bias / np.sqrt(false @ shown_by @ false)  # noncentrality one
        followed = started(CompiledFilterBank, state)
        followed.adopt(every(1), bank.state, bank.covariance)
        rows = rows_of_sweeps(lying, offset)
        for period in range(60):
            kept, light = np.ones(len(rows.angle), np.bool_), light_of(STATION, [NOISE])
            found = innovations(rows, kept, every(1), light_of(STATION, [NOISE]), POINTS[None], followed.state)
            open_s = np.array([period * T if shown < 3 else 0.0])
            place, turn = row_faults(rows, kept, every(1), found, light, followed.covariance, open_s)[:, 0]
            give(followed, rows)
            away = float(np.linalg.norm(followed.position - state.position))
            turned = float(np.linalg.norm(rot.log(followed.rotation[0] @ state.rotation[0].T)))
            worst = max(worst, away / place, turned / turn)
            followed.predict(T, every(1))
    assert 0.1 < worst <= 1.0, "a bound, and not an empty one"


def give(bank: FilterBank, rows: RowBatch) -> None:
    """Let the bank of one craft take in its rows."""
    kept = np.ones(len(rows.angle), np.bool_)
    found = innovations(rows, kept, every(1), light_of(STATION, [NOISE]), POINTS[None], bank.state)
    bank.update(every(1), found.y, found.h, np.ones_like(found.y), found.number, found.pivot)


def test_a_row_that_the_prediction_has_behind_the_station_is_not_counted():
    facing = rot.exp(np.array([[0.0, np.pi, 0.0]]))
    state = State(facing, np.array([[0.0, 0.0, 0.025]]), np.zeros((1, 3)), np.zeros((1, 3)))
    bank = started(CompiledFilterBank, state, 0.1)
    q = np.einsum("cij,kj->cki", bank.rotation, POINTS) + bank.position[:, None]
    assert (q[0, :3, 2] > 0).tolist() == [True, True, False]
    theta = ideal_theta(q)
    theta[0, 2], theta[0, 3:] = np.pi / 2, np.nan
    offset = np.where(np.isfinite(theta), OFFSETS, 0.0)
    rows = rows_of_sweeps(theta, offset)
    kept = np.ones(len(rows.angle), np.bool_)
    found = innovations(rows, kept, every(1), light_of(STATION, [NOISE]), POINTS[None], bank.state)
    np.testing.assert_array_equal(kept, rows.photodiode != 2)
    np.testing.assert_allclose(found.pivot[0, :3], POINTS[:2].mean(axis=0), atol=1e-15)

    tracks = Tracks(bank, T, TrackLimits(2.0, 6), None)
    settings = replace(SETTINGS, motion_compensation=False)
    out = SingleSweeps(POINTS[None], settings).take_in(theta, offset, every(1), tracks)
    assert (out.fresh[0], out.rows[0], out.photodiodes[0], out.dropped[0]) == (True, 4, 2, 0)
    assert (np.isfinite(out.fault) & (out.fault > 0)).all()

    # A false photodiode beside it: only that one counts as left out.
    shown = State(facing, np.array([[0.0, 0.0, 0.035]]), np.zeros((1, 3)), np.zeros((1, 3)))
    bank = started(CompiledFilterBank, shown, 0.1)
    q = np.einsum("cij,kj->cki", bank.rotation, POINTS) + bank.position[:, None]
    theta = ideal_theta(q)
    theta[0, 1] += 0.3
    theta[0, 3], theta[0, 4:7] = np.pi / 2, np.nan
    offset = np.where(np.isfinite(theta), OFFSETS, 0.0)
    out = SingleSweeps(POINTS[None], settings).take_in(
        theta, offset, every(1), Tracks(bank, T, TrackLimits(2.0, 6), None)
    )
    assert (out.fresh[0], out.photodiodes[0], out.dropped[0]) == (True, 3, 1)


def angles(state: State, rng: np.random.Generator, shown: int) -> SweepAngles:
    theta, offset = seen(state, rng, shown)
    none = np.zeros(len(theta), dtype=np.int64)
    lit: Bools = np.all(np.isfinite(theta), axis=2)
    return SweepAngles(theta, offset, lit, none, none, none)


@pytest.mark.parametrize("coupling", ["auto", "tight", "loose"])
def test_three_photodiodes_keep_a_craft_navigating(coupling):
    state, rng = still(), np.random.default_rng(6)
    layout = pad([POINTS] * CRAFT, [np.tile([0.0, 0.0, 1.0], (len(POINTS), 1))] * CRAFT)
    navigator = Navigator(layout, replace(SETTINGS, coupling=coupling, filter="compiled"))
    for _ in range(30):
        converged = navigator.step(angles(state, rng, 8))
    assert (converged.status == Status.TRACKING).all()
    assert (converged.coupling == (Coupling.TIGHT if coupling == "tight" else Coupling.LOOSE)).all()
    for _ in range(130):
        last = navigator.step(angles(state, rng, 3))
    if coupling == "loose":
        assert (last.status == Status.SEARCHING).all()
        assert not last.rows.any()
        return
    assert (last.status == Status.SINGLE_SWEEPS).all()
    assert (last.rows == 6).all()
    error = np.linalg.norm(last.position - state.position, axis=1)
    assert (error < 5e-3).all()
    assert (error < last.integrity.position_m).all()
    assert np.isfinite(last.integrity.position_m).all()


def test_a_craft_in_tight_mode_knows_the_same_alone():
    state = still()
    layout = pad([POINTS] * CRAFT, [np.tile([0.0, 0.0, 1.0], (len(POINTS), 1))] * CRAFT)
    quiet = QuietModel(0.002, 0.002, 1.0, 2.0, only_free=False)
    settings = replace(SETTINGS, coupling="tight", filter="compiled", quiet=quiet)
    together, alone = Navigator(layout, settings), Navigator(layout.of(2), settings)
    rng = np.random.default_rng(7)
    for period in range(40):
        light = angles(state, rng, 8 if period < 20 else 2)
        one = SweepAngles._make(part[2:3] for part in light)
        every_craft, own = together.step(light), alone.step(one)
        for name in ("status", "rotation", "position", "velocity", "covariance", "nis", "rows"):
            np.testing.assert_array_equal(getattr(every_craft, name)[2], getattr(own, name)[0], err_msg=name)


def interacting(kind: type[InteractingBank], craft: int) -> InteractingBank:
    noises = [(DEFAULT_ACCELERATION_NOISE_M_S2, DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2), (0.002, 0.002)]
    return kind(noises, 1.0, 2.0, np.full(craft, 2))


def test_two_models_of_either_bank_agree_and_tell_a_push_from_quiet():
    rng, state = np.random.default_rng(8), still()
    banks = [interacting(kind, CRAFT) for kind in (FilterpyInteractingBank, CompiledInteractingBank)]
    p, b = np.tile(1e-6 * np.eye(6), (CRAFT, 1, 1)), np.zeros((CRAFT, 6, 6))
    push, quiet = np.array([0.0, 0.0, 0.3, 0.3]), np.zeros(CRAFT)
    for bank in banks:
        bank.start(every(), state.rotation, state.position, p, (1.0, 0.5))
    for period in range(120):
        time = max(0.0, (period - 90) * T)
        place = state.position + np.outer(push, [time**2 / 2, 0.0, 0.0]) + 1e-3 * rng.standard_normal((CRAFT, 3))
        turned = rot.exp(1e-3 * rng.standard_normal((CRAFT, 3))) @ state.rotation
        for bank in banks:
            bank.predict(T, every())
        fates = [bank.update_pose(every(), turned, place, p, b) for bank in banks]
        np.testing.assert_allclose(fates[0].nis, fates[1].nis, rtol=1e-9)
        if 50 <= period < 90:
            quiet += banks[0].probability[:, 1] / 40
    np.testing.assert_allclose(banks[0].covariance, banks[1].covariance, rtol=1e-8, atol=1e-16)
    np.testing.assert_allclose(banks[0].position, banks[1].position, rtol=0, atol=1e-12)
    assert (quiet > 0.8).all()
    assert (banks[0].probability[2:, 1] < 0.2).all()
    assert (banks[0].probability[:2, 1] > 0.6).all()
    banks[0].stop(every())
    assert not banks[0].active.any()


def test_free_turns_keep_angular_momentum_and_energy_for_ten_seconds():
    rng = np.random.default_rng(9)
    inertia: Floats = np.diag([1.0, 2.0, 2.5])[None] * 1e-3
    inverse: Floats = np.linalg.inv(inertia).astype(np.float64)
    rotation, rate = rot.exp(rng.standard_normal((1, 3))), np.array([[0.3, -0.2, 0.25]])

    def kept() -> tuple[Floats, float]:
        momentum = rotation[0] @ inertia[0] @ rotation[0].T @ rate[0]
        return momentum, float(momentum @ rate[0])

    before = kept()
    for _ in range(600):
        turns = free_turns(every(1), rotation, rate, inertia, inverse, T)
        rotation, rate = rot.exp(turns.turn) @ rot.exp(T * rate) @ rotation, rate + turns.rate
    after = kept()
    # RK4 of a step errs by (w T)^5 / 120, 1e-13 of the rate; 600 steps.
    np.testing.assert_allclose(after[0], before[0], rtol=0, atol=1e-10 * float(np.linalg.norm(before[0])))
    assert after[1] == pytest.approx(before[1], rel=1e-10)


def test_the_coupling_of_free_turns_is_their_derivative():
    rng = np.random.default_rng(10)
    inertia: Floats = np.diag([1.0, 2.0, 2.5])[None] * 1e-3
    inverse: Floats = np.linalg.inv(inertia).astype(np.float64)
    start = rot.exp(rng.standard_normal((1, 3)))
    rate, small = np.array([[0.3, -0.2, 0.25]]), 1e-5

    def after(x: Floats) -> tuple[Floats, Floats]:
        moved, faster = rot.exp(x[None, :3]) @ start, rate + x[3:]
        turns = free_turns(every(1), moved, faster, inertia, inverse, T)
        return (rot.exp(turns.turn) @ rot.exp(T * faster) @ moved)[0], (faster + turns.rate)[0]

    derivative = np.empty((6, 6))
    for i in range(6):
        plus, minus = after(small * np.eye(6)[i]), after(-small * np.eye(6)[i])
        turned = rot.log(plus[0] @ minus[0].T)
        derivative[:, i] = np.concatenate([turned, plus[1] - minus[1]]) / (2 * small)
    bank = BANKS[0](1)
    bank.start(every(1), start, np.zeros((1, 3)), np.eye(6)[None], (1.0, 1.0))
    bank._state.angular_rate[:] = rate
    constant = bank.transition(T)[0, :6, :6]
    coupling = free_turns(every(1), start, rate, inertia, inverse, T).coupling[0]
    # What is left is of third order in w T, some 1e-2.
    np.testing.assert_allclose(coupling @ constant, derivative, rtol=0, atol=2e-6)
    assert np.abs(constant - derivative).max() > 1e-3


def test_condensed_rows_say_the_same_as_all_rows():
    """The estimates by the rows as they are and by their sums; where the rates are hardly known, rows are left out."""
    rng, state = np.random.default_rng(14), still()
    light = angles(state, rng, 8)
    rows = rows_of_sweeps(light.theta, light.offset_s)
    for speed, most in ((0.0003, 8), (20.0, 13)):
        whole, condensed = CompiledFilterBank(CRAFT), CompiledFilterBank(CRAFT)
        for bank in (whole, condensed):
            p = np.tile(1e-6 * np.eye(6), (CRAFT, 1, 1))
            bank.start(every(), state.rotation, state.position, p, (speed, speed))
        y, h, r = np.zeros((CRAFT, 16)), np.zeros((CRAFT, 16, 12)), np.zeros((CRAFT, 16, 16))
        for c in range(CRAFT):
            own = rows.of(c)
            y[c], h[c] = linearise(own, STATION, POINTS, *whole.state.of(c))
            r[c] = NOISE.own_rad**2 * np.eye(16) + NOISE.shared_rad**2 * (own.fan[:, None] == own.fan)
        kept, point = np.ones(len(rows.angle), np.bool_), np.tile(POINTS, (CRAFT, 1, 1))
        found = innovations(rows, kept, every(), light_of(STATION, [NOISE]), point, condensed.state)
        found, counted = condense(found, every(), condensed.covariance)
        assert (counted == 16).all()
        assert (found.number <= most).all()
        assert (found.number >= most - 5).all()
        one = whole.update(every(), y, h, r)
        two = condensed.update(every(), found.y, found.h, np.ones_like(found.y), found.number, found.pivot, counted)
        # Information of 1e-5 of the prediction's may be missing, in each of six directions.
        np.testing.assert_allclose(two.nis, one.nis, rtol=1e-3)
        scale = np.sqrt(np.einsum("ci,cj->cij", *[np.diagonal(whole.covariance, axis1=1, axis2=2)] * 2))
        np.testing.assert_allclose(condensed.covariance / scale, whole.covariance / scale, rtol=0, atol=6e-4)
        sigma = np.sqrt(np.diagonal(whole.covariance, axis1=1, axis2=2))
        assert (np.abs(condensed.position - whole.position) < 0.01 * sigma[:, 6:9]).all()
        assert (np.abs(condensed.velocity - whole.velocity) < 0.01 * sigma[:, 9:]).all()


def lit_differently(state: State, seed: int) -> RowBatch:
    """Rows of craft that see 8, 5, 7, ... photodiodes, and of one fan one less."""
    theta, offset = seen(state, np.random.default_rng(seed), 8)
    for c, fewer in enumerate((0, 3, 1, 2, 0, 3)[: len(theta)]):
        theta[c, 8 - fewer :] = np.nan
        theta[c, 0, c % 2] = np.nan
    return rows_of_sweeps(theta, offset)


@pytest.mark.parametrize("kind", [*BANKS, *INTERACTING])
def test_sums_as_poses_say_the_same_as_all_rows(kind):
    """What a filter, of any number of models, makes of poses that are sums, and of the rows themselves."""
    state = still()
    whole, posed = (started(kind, state, speed=1e-3) for _ in range(2))
    for seed in range(2):
        rows, light, point = lit_differently(state, seed), light_of(STATION, [NOISE]), np.tile(POINTS, (CRAFT, 1, 1))
        kept = np.ones(len(rows.angle), np.bool_)
        sums = pose_sums(rows, kept, every(), light, point, posed.state, posed.covariance)
        assert sums.told.all()
        np.testing.assert_array_equal(sums.rows, np.diff(rows.first))
        two = posed.update(every(), sums.y, sums.h, sums.r, freedoms=sums.rows, square=sums.square)
        found = innovations(rows, kept, every(), light_of(STATION, [NOISE]), point, whole.state)
        one = whole.update(every(), found.y, found.h, np.ones_like(found.y), found.number, found.pivot)
        np.testing.assert_array_equal(two.accepted, one.accepted)
        np.testing.assert_allclose(two.nis, one.nis, rtol=2e-3)
        np.testing.assert_allclose(two.log_determinant + sums.log_determinant, one.log_determinant, rtol=2e-3)
        scale = np.sqrt(np.einsum("ci,cj->cij", *[np.diagonal(whole.covariance, axis1=1, axis2=2)] * 2))
        # Information of 1e-3 of the prediction's is missing in each of six directions of the rates.
        off = np.abs(posed.covariance - whole.covariance) / scale
        assert off[:, POSE_COLUMNS[:, None], POSE_COLUMNS].max() < 1e-3
        assert off.max() < 2e-2
        sigma = np.sqrt(np.diagonal(whole.covariance, axis1=1, axis2=2))
        assert (np.abs(posed.position - whole.position) < 0.02 * sigma[:, 6:9]).all()


def test_sums_of_four_craft_at_once_have_the_bits_of_one() -> None:
    """Sums side by side, those of a craft by itself, and the same steps with numbers."""
    count = 6
    state = still(count)
    rows, light, point = lit_differently(state, 3), light_of(STATION, [NOISE]), np.tile(POINTS, (count, 1, 1))
    state.angular_rate[:], kept = np.random.default_rng(5).normal(0.0, 0.5, (count, 3)), np.ones(len(rows.angle), bool)
    p = np.tile(1e-10 * np.eye(12), (count, 1, 1))
    together = pose_sums(rows, kept, every(count), light, point, state, p)
    found = innovations(rows, kept.copy(), every(count), light_of(STATION, [NOISE]), point, state)
    assert together.told.all()
    for c in range(count):
        alone = pose_sums(rows, kept, np.arange(count) == c, light, point, state, p)
        np.testing.assert_array_equal(alone.told, np.arange(count) == c)
        for one, side_by_side in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one[c], side_by_side[c])
        lower, total, inverse = np.zeros((12, 12)), np.zeros(12), np.zeros((12, 12))
        _root_of_sums(found.y[c], found.h[c], int(found.number[c]), lower, total)
        _solve_pose(lower, total, inverse)
        np.testing.assert_array_equal(total[:6], together.y[c])
        np.testing.assert_array_equal(lower[6:, :6].T, together.h[c][:, [3, 4, 5, 9, 10, 11]])
        root = inverse[:6, :6] * np.triu(np.ones((6, 6)))
        np.testing.assert_allclose(root @ root.T, together.r[c], rtol=1e-12)


def test_sums_are_no_poses_where_the_rows_do_not_make_one() -> None:
    """Few rows, rates that one sweep tells, a wide attitude, a photodiode behind: the rows are taken one by one."""
    state = still()
    rows, light, point = lit_differently(state, 3), light_of(STATION, [NOISE]), np.tile(POINTS, (CRAFT, 1, 1))
    kept, p = np.ones(len(rows.angle), bool), np.tile(1e-10 * np.eye(12), (CRAFT, 1, 1))
    kept[rows.first[0] + 8 : rows.first[1]] = False
    p[1, 9:, 9:] = 400 * np.eye(3)
    p[2, :3, :3] = np.eye(3)
    state.position[3, 2] *= -1
    assert not pose_sums(rows, kept, every(), light, point, state, p).told.any()


@pytest.mark.parametrize("kind", BANKS)
def test_known_motion_with_a_coupling_moves_the_covariance_too(kind):
    rng, state, still_there = np.random.default_rng(11), still(), np.zeros((CRAFT, 3))
    coupling = np.eye(6) + 0.1 * rng.standard_normal((CRAFT, 6, 6))
    plain, coupled = kind(CRAFT), kind(CRAFT)
    for bank in (plain, coupled):
        bank.start(every(), state.rotation, state.position, np.tile(np.eye(6), (CRAFT, 1, 1)), (1.0, 0.5))
        bank.predict(T, every())
    coupled.add_motion(every(), *[still_there] * 4, coupling)
    whole = np.tile(np.eye(12), (CRAFT, 1, 1))
    whole[:, :6, :6] = coupling
    expected = whole @ plain.covariance @ np.swapaxes(whole, 1, 2)
    np.testing.assert_allclose(coupled.covariance, expected, rtol=1e-12, atol=1e-14)
    # And the filter itself holds it.
    plain.adopt(every(), plain.state, expected)
    for bank in (plain, coupled):
        bank.predict(T, every())
    np.testing.assert_allclose(coupled.covariance, plain.covariance, rtol=1e-12, atol=1e-14)


def test_a_grid_of_models_finds_the_noise_that_a_motion_has():
    """Motions with the noise of one of the models each: its probability becomes the largest, or a neighbour's."""
    rng, levels, craft = np.random.default_rng(12), [0.2, 0.02, 0.002], 3
    bank = CompiledInteractingBank([(a, a) for a in levels], 30.0, 2.0, np.full(craft, len(levels)))
    p, b = np.tile(1e-8 * np.eye(6), (craft, 1, 1)), np.zeros((craft, 6, 6))
    rotation, place, speed = np.tile(np.eye(3), (craft, 1, 1)), np.zeros((craft, 3)), np.zeros((craft, 3))
    rate = np.zeros((craft, 3))
    bank.start(every(craft), rotation, place, p, (1.0, 0.5))
    mean, square, count = np.zeros((craft, len(levels))), np.zeros(craft), 0
    for period in range(1200):
        push = np.array(levels)[:, None] * rng.standard_normal((craft, 3))
        place, speed = place + speed * T + push * T**2 / 2, speed + push * T
        twist = np.array(levels)[:, None] * rng.standard_normal((craft, 3))
        rotation, rate = rot.exp(rate * T + twist * T**2 / 2) @ rotation, rate + twist * T
        bank.predict(T, every(craft))
        turned = rot.exp(1e-4 * rng.standard_normal((craft, 3))) @ rotation
        bank.update_pose(every(craft), turned, place + 1e-4 * rng.standard_normal((craft, 3)), p, b)
        if period > 300:
            mean += bank.probability
            off = place - bank.position
            square += np.einsum("ci,ci->c", off, np.linalg.solve(bank.covariance[:, 6:9, 6:9], off[..., None])[..., 0])
            count += 1
    assert (np.argmax(mean, axis=1) == [0, 1, 2]).all()
    # Three degrees of freedom; some 30 independent values each: 15 % one sigma.
    np.testing.assert_allclose(square / count, 3.0, rtol=0.4)


@pytest.mark.parametrize("tested", [True, False])
def test_a_push_harder_than_every_model_has_it_widens_the_prediction(tested):
    """As in fault-parade: 0.15 m/s and 55 deg/s within a period, after five seconds at rest. Each pose agrees with
    itself: the filter follows from the first one on, and its covariance says so.
    """
    rng, nothing = np.random.default_rng(13), np.zeros((CRAFT, 6, 6))
    levels = [(0.2 * share, 0.2 * share) for share in (2.5e-4 ** np.linspace(0, 1, 6)).tolist()]
    bank = CompiledInteractingBank(levels, 30.0, 2.0, np.full(CRAFT, 6))
    tracks = Tracks(bank, T, TrackLimits(2.0, 6), None)
    sigma = np.array([6e-4, 6e-4, 1e-4, 5e-5, 5e-5, 7e-4])
    covariance = np.tile(np.diag(sigma**2), (CRAFT, 1, 1))
    velocity, rate = np.array([-0.12, -0.08, -0.04]), np.radians([20.0, 50.0, 10.0])
    start, squares, followed = still(), [], []
    for period in range(330):
        since = max(0.0, (period - 299 - 0.4) * T)
        moving = since > 0
        rotation, position = rot.exp(rate * since) @ start.rotation, start.position + velocity * since
        tracks.predict(None)
        noise = sigma * rng.standard_normal((CRAFT, 6))
        sensor = np.ones(CRAFT, dtype=np.int64)
        pose = rot.exp(noise[:, :3]) @ rotation, position + noise[:, 3:], covariance, nothing, nothing
        taken = tracks.take_in(PoseFix(every(), *pose, sensor, tested=tested))
        tracks.count(taken.fresh, np.zeros_like(taken.fresh), taken.refused)
        if moving:
            followed.append(taken.fresh & bank.active)
            turned = rot.log(rotation @ np.swapaxes(bank.rotation, 1, 2))
            error = np.concatenate([turned, position - bank.position], axis=1)
            p = bank.covariance[:, POSE_COLUMNS[:, None], POSE_COLUMNS]
            squares.append(np.einsum("ci,ci->c", error, np.linalg.solve(p, error[..., None])[..., 0]))
    assert np.all(followed) == tested
    if tested:
        # Some 4 x 15 independent values: two sigma is 0.9.
        assert 4.0 < np.mean(squares) < 8.0
        speed = np.linalg.norm(bank.velocity - velocity, axis=1)
        assert (speed < 5 * np.sqrt(np.trace(bank.covariance[:, 9:, 9:], axis1=1, axis2=2))).all()


def test_rows_are_the_finite_angles_of_the_craft_concerned_fan_by_fan():
    theta, offset = seen(still(), np.random.default_rng(4), 5)
    theta[1, 2, 0], theta[2] = np.nan, np.nan
    mask = np.arange(CRAFT) % 3 != 0
    rows = rows_of_sweeps(theta, offset, mask)
    expected = [
        (c, fan, k) for c in np.flatnonzero(mask) for fan in range(2) for k in range(8) if np.isfinite(theta[c, k, fan])
    ]
    whose = np.repeat(np.arange(CRAFT), np.diff(rows.first))
    assert list(zip(whose, rows.fan, rows.photodiode, strict=True)) == expected
    at = tuple(np.array([(c, k, fan) for c, fan, k in expected]).T)
    np.testing.assert_array_equal(rows.angle, theta[at] - np.pi / 2)
    np.testing.assert_array_equal(rows.offset_s, offset[at])
    for part, alone in zip(rows_of_sweeps(theta, offset), rows_of_sweeps(theta, offset, every()), strict=True):
        np.testing.assert_array_equal(part, alone)


@pytest.mark.parametrize("kind", [*BANKS, *INTERACTING])
def test_who_is_too_coarse_is_told_of_the_craft_asked_for_alone(kind):
    """The sum of the three variances of the attitude against a limit, of craft of a mask that have a filter."""
    bank = started(kind, still())
    wide = np.array([0.01, 0.02, 0.5])
    p = np.tile(1e-8 * np.eye(STATES), (CRAFT, 1, 1))
    p[:, np.arange(3), np.arange(3)] = np.square(wide)[np.arange(CRAFT) % 3][:, None]
    bank.adopt(every(), bank.state, p)
    bank.stop(np.arange(CRAFT) == 2)
    tracks, asked = Tracks(bank, T, TrackLimits(2.0, 6), None), np.arange(CRAFT) % 2 == 0
    sigma = np.sqrt(3) * wide[np.arange(CRAFT) % 3]
    for limit in (0.02, 0.1, 1.0):
        expected = asked & (sigma > limit) & (np.arange(CRAFT) != 2)
        np.testing.assert_array_equal(tracks.bank.beyond(limit, asked), expected)
