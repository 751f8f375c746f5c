"""The lighthouse: crossing instants against a root finder, noise against its distributions, draws bit for bit."""

from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation, Slerp
from scipy.stats import chi2

from estimators.arrays import Bools, Floats
from estimators.lanes import WIDE
from estimators.lighthouse.sweep import LIGHTHOUSE_1, FanErrors, ideal_theta, kernel_fans, lighthouse_1, measured_theta
from estimators.rotation import exp, quaternion_from_matrix
from swarm.draws import key_of, keys_of, normals
from swarm.hardware import Photodiodes, pad
from swarm.messages import SYNC_WIDTH_S, SYNC_WIDTH_STEP_S, Pulses
from swarm.random import Purpose
from swarm.scenario import Lighthouse as Station
from swarm.sensors.crossing import cross_into, knots_of, row_by_row, side_by_side
from swarm.sensors.light_draws import ANGLE, draw_room, errors_into
from swarm.sensors.light_draws import strays as strays_of
from swarm.sensors.lighthouse import Lighthouse

PERIOD = 1 / 60
W = 2 * np.pi / PERIOD
FLASH_TICKS = [3125, 3646]  # 3000 / 48 MHz and 3500 / 48 MHz in ticks of 20 ns
TICK_S = 20e-9


def station(**values: Any) -> Station:
    """A station without noise, but for these values."""
    return Station(**{"angle_noise_arcsec": 0.0} | values)


QUIET = station()
NOISE = float(np.deg2rad(8.8 / 3600))
REAL_FANS = (FanErrors(0.05, 0.01, 0.002, 1.3, 0.01), FanErrors(-0.03, -0.008, -0.003, -2.1, -0.02))


class Truth(NamedTuple):
    time_s: Floats
    position: Floats
    quaternion: Floats


def layout_of(counts: list[int], seed: int = 0) -> Photodiodes:
    rng = np.random.default_rng(seed)
    points = [rng.uniform(-0.1, 0.1, (k, 3)) for k in counts]
    return pad(points, [np.tile([0.0, 0.0, -1.0], (k, 1)) for k in counts])


class FreeMotion:
    """Straight flight and a turn at constant rate from random starts: its knots are exact, like MuJoCo's own.

    The start, where all are in the field, is at the beginning of period `frame`.
    """

    def __init__(self, seed: int, craft: int, frame: int = 0) -> None:
        self.begin = frame * PERIOD
        rng = np.random.default_rng(seed)
        depth = rng.uniform(0.8, 6.0, craft)
        self.start = np.column_stack([rng.uniform(-1.2, 1.2, (craft, 2)) * depth[:, None], depth])
        self.velocity = rng.normal(0, 2.0, (craft, 3))
        self.turn = rng.normal(0, 4.0, (craft, 3))
        self.attitude = exp(rng.normal(0, 2.0, (craft, 3)))

    def at(self, t: float) -> tuple[Floats, Floats]:
        since = t - self.begin
        return self.start + self.velocity * since, exp(self.turn * since) @ self.attitude

    def period(self, frame: int, steps: int = 8) -> Truth:
        time = (frame + np.arange(steps + 1) / steps) * PERIOD
        poses = [self.at(t) for t in time]
        # Signs as they come: q and -q, which an interpolation must survive.
        quaternion = quaternion_from_matrix(np.array([r for _, r in poses]))
        return Truth(time, np.array([p for p, _ in poses]), quaternion)

    def points(self, layout: Photodiodes, t: float) -> Floats:
        position, rotation = self.at(t)
        out: Floats = np.einsum("cij,ckj->cki", rotation, layout.point_m) + position[:, None]
        return out


def all_lit(layout: Photodiodes) -> Bools:
    return np.repeat(layout.present[..., None], 2, axis=-1)


def row(pulses: Pulses, craft: int) -> list[tuple[int, int, int]]:
    n = pulses.total[craft]
    columns = (pulses.photodiode[craft, :n], pulses.rise_tick[craft, :n], pulses.width_tick[craft, :n])
    return list(zip(*(column.tolist() for column in columns), strict=True))


def is_flash(width: int) -> bool:
    """With ticks of 20 ns."""
    return width in FLASH_TICKS


def angles(lighthouse: Lighthouse, pulses: Pulses) -> Floats:
    """Decode by hand, (C, K, 2): the middle of the n-th sweep of a photodiode from the n-th flash."""
    out = np.full((*lighthouse.photodiodes.present.shape, 2), np.nan)
    tick_s = lighthouse.settings.tick_s
    flash_ticks = [round((SYNC_WIDTH_S + code * SYNC_WIDTH_STEP_S) / tick_s) for code in (0, 1)]
    for c in range(len(out)):
        flash = {flash_ticks.index(width): rise for _, rise, width in row(pulses, c) if width in flash_ticks}
        for k, rise, width in row(pulses, c):
            if width not in flash_ticks:
                fan = int(rise > flash[1])
                out[c, k, fan] = W * tick_s * (rise + width / 2 - flash[fan])
    return out


def crossings(truth: Truth, point: Floats, normal: Floats, error: Floats, fans: Floats) -> tuple[Floats, Floats]:
    """Instants and widths, (C, K, 2), of errors that are NaN where a fan does not light a photodiode."""
    errors = side_by_side(error)
    instant, width = np.zeros_like(errors), np.zeros_like(errors)
    cross_into(knots_of(*truth), side_by_side(point), side_by_side(normal), errors, fans, PERIOD, 3e-3, instant, width)
    return row_by_row(instant, len(error)), row_by_row(width, len(error))


def test_craft_side_by_side_are_those_one_by_one() -> None:
    values = np.random.default_rng(0).random((11, 5, 3))
    abreast = side_by_side(values)
    np.testing.assert_array_equal(row_by_row(abreast, 11), values)
    for c, k, n in np.ndindex(values.shape):
        assert abreast[c // WIDE, n, k, c % WIDE] == values[c, k, n]
    np.testing.assert_array_equal(
        row_by_row(abreast, len(abreast) * WIDE)[11:], np.repeat(values[-1:], -11 % WIDE, axis=0)
    )


@pytest.mark.parametrize("fans", [(FanErrors(), FanErrors()), REAL_FANS])
@pytest.mark.parametrize("frame", [0, 100_000])
def test_crossing_instants_equal_a_root_finder_on_the_analytic_motion(
    fans: tuple[FanErrors, FanErrors], frame: int
) -> None:
    motion, layout = FreeMotion(1, 20, frame), layout_of([12] * 20)
    truth = motion.period(frame)
    error = np.random.default_rng(2).normal(0, NOISE, (20, 12, 2))
    truth = truth._replace(time_s=truth.time_s - truth.time_s[0])
    instant, _ = crossings(truth, layout.point_m, layout.normal, error, kernel_fans(lighthouse_1(*fans)))
    for c, k, fan in np.ndindex(20, 12, 2):
        start = fan * PERIOD / 2

        def gap(t: float, c: int = c, k: int = k, fan: int = fan, start: float = start) -> float:
            theta = measured_theta(motion.points(layout, frame * PERIOD + t)[c, k], fans)[fan]
            return float(theta + error[c, k, fan] - W * (t - start))

        expected = brentq(gap, start, start + PERIOD / 2, xtol=1e-14)
        # A picosecond; the absolute time of frame 100 000 has 2e-13 s of rounding, times a few m/s: nothing.
        assert abs(instant[c, k, fan] - expected) < 1e-12


@pytest.mark.parametrize("scale", [0.0, 0.01, 0.1, 1.0, 3.0, 10.0, 30.0])
def test_crossings_keep_the_limit_however_fast_the_craft_move(scale: float) -> None:
    """Slow craft cross by the series, fast ones by Newton steps; the widths are those of the pose at the crossing."""
    motion, layout = FreeMotion(11, 8), layout_of([6] * 8)
    rng = np.random.default_rng(12)
    normal = rng.normal(0, 0.3, (8, 6, 3)) - motion.attitude.transpose(0, 2, 1)[:, None, :, 2]
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    motion.velocity *= scale
    motion.turn *= scale
    truth, error, lit = motion.period(0, 2), rng.normal(0, NOISE, (8, 6, 2)), rng.random((8, 6, 2)) < 0.8
    perfect = kernel_fans(LIGHTHOUSE_1)
    instant, width = crossings(truth, layout.point_m, normal, np.where(lit, error, np.nan), perfect)
    found = np.isfinite(instant)
    np.testing.assert_array_equal(found, np.isfinite(width))
    assert not np.any(found & ~lit)
    assert found.sum() > 0.7 * lit.sum()  # the fastest leave the field
    for c, k, fan in np.argwhere(found):

        def gap(t: float, c: int = c, k: int = k, fan: int = fan) -> float:
            return float(
                ideal_theta(motion.points(layout, t)[c, k])[fan] + error[c, k, fan] - W * (t - fan * PERIOD / 2)
            )

        t = instant[c, k, fan]
        # The fan and the photodiode together move by 0.8 to 1.2 w at least; what SciPy leaves is 1e-17 s.
        assert abs(t - brentq(gap, t - 1e-6, t + 1e-6, xtol=1e-17, rtol=1e-14)) < 1.25e-13
        rotation = motion.at(t)[1]
        p, n = motion.points(layout, t)[c, k], rotation[c] @ normal[c, k]
        distance = np.hypot(p[fan], p[2])
        along = (n[fan] * p[2] - n[2] * p[fan]) / distance
        # The sweep's edges are sharp to a thousandth of a tick of 20 ns.
        assert abs(width[c, k, fan] - 3e-3 * np.sqrt(1 - along**2) / distance / W) < 2e-11


def test_crossing_instants_follow_bent_knots() -> None:
    """Where the craft is pushed between knots: SciPy's slerp and a straight line within each step."""
    rng = np.random.default_rng(3)
    layout = layout_of([12])
    truth = FreeMotion(4, 1).period(0)
    quaternion = truth.quaternion + rng.normal(0, 0.02, truth.quaternion.shape)
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    quaternion[::2] *= -1
    position = truth.position + rng.normal(0, 0.002, truth.position.shape)
    bent = truth._replace(position=position, quaternion=quaternion)
    nothing, perfect = np.zeros((1, 12, 2)), kernel_fans(LIGHTHOUSE_1)
    instant, _ = crossings(bent, layout.point_m, layout.normal, nothing, perfect)
    turn = Slerp(truth.time_s, Rotation.from_quat(quaternion[:, 0], scalar_first=True))
    for k, fan in np.ndindex(12, 2):
        start = fan * PERIOD / 2

        def gap(t: float, k: int = k, fan: int = fan, start: float = start) -> float:
            origin = [np.interp(t, truth.time_s, position[:, 0, i]) for i in range(3)]
            return float(ideal_theta(turn(t).apply(layout.point_m[0, k]) + origin)[fan] - W * (t - start))

        assert abs(instant[0, k, fan] - brentq(gap, start, start + PERIOD / 2, xtol=1e-14)) < 1e-12


def test_photodiodes_cross_before_and_after_a_knot_each_in_its_own_motion() -> None:
    layout = layout_of([12])
    knot = np.array([0.0, PERIOD / 4, PERIOD])
    position = np.array([[[-2.0 * PERIOD / 4, 0.0, 2.0]], [[0.0, 0.0, 2.0]], [[-3.0 * PERIOD * 3 / 4, 0.0, 2.0]]])
    truth = Truth(knot, position, np.tile([1.0, 0.0, 0.0, 0.0], (3, 1, 1)))
    nothing, perfect = np.zeros((1, 12, 2)), kernel_fans(LIGHTHOUSE_1)
    instant, _ = crossings(truth, layout.point_m, layout.normal, nothing, perfect)
    sides = set()
    for k in range(12):

        def gap(t: float, k: int = k) -> float:
            x, _, z = layout.point_m[0, k] + [np.interp(t, knot, position[:, 0, i]) for i in range(3)]
            return float(np.arctan2(z, x) - W * t)

        t = instant[0, k, 0]
        assert abs(t - brentq(gap, 0, PERIOD / 2, xtol=1e-17, rtol=1e-14)) < 1.25e-13
        sides.add(t > PERIOD / 4)
    assert sides == {False, True}


def test_without_noise_every_pulse_is_within_half_a_tick() -> None:
    frame = 777
    motion, layout = FreeMotion(5, 4, frame), layout_of([12, 5, 8, 0])
    lighthouse, lit = Lighthouse(layout, QUIET, seed=1), all_lit(layout)
    pulses = lighthouse.sweep(motion.period(frame), frame, lit)
    zero = lighthouse.clock_offset_tick + frame * PERIOD / TICK_S
    seen = 0
    for c in range(4):
        for k, rise, width in row(pulses, c):
            middle = (rise + (0 if is_flash(width) else width / 2) - zero[c]) * TICK_S
            if is_flash(width):
                expected = FLASH_TICKS.index(width) * PERIOD / 2
            else:
                fan = int(middle > PERIOD / 2)
                theta = ideal_theta(motion.points(layout, frame * PERIOD + middle)[c, k])[fan]
                expected = theta / W + fan * PERIOD / 2
            # Half a tick, and what the float of some 1e11 ticks rounds.
            assert abs(middle - expected) <= 0.5001 * TICK_S
            seen += 1
    assert seen == 4 * (12 + 5 + 8)
    assert pulses.total.tolist() == [48, 20, 32, 0]
    # So an angle, the difference of two rounded instants, is within one tick.
    still = FreeMotion(5, 4)
    still.velocity[:], still.turn[:] = 0, 0
    decoded = angles(lighthouse, lighthouse.sweep(still.period(0), 0, lit))
    ideal = ideal_theta(still.points(layout, 0.0))
    assert np.max(np.abs(decoded - ideal)[layout.present]) <= 1.0001 * W * TICK_S


def test_pulses_are_sorted_typed_and_padded() -> None:
    motion, layout = FreeMotion(6, 3), layout_of([12, 4, 7])
    noisy = station(angle_noise_arcsec=8.8, stray_pulse_rate_hz=500.0, sync_jitter_ns=100.0)
    lighthouse = Lighthouse(layout, noisy, seed=2)
    pulses = lighthouse.sweep(motion.period(0), 0, all_lit(layout))
    assert [column.dtype for column in pulses] == [np.int16, np.int64, np.int32, np.int32]
    assert pulses.photodiode.shape == (3, pulses.total.max())
    for c in range(3):
        assert np.all(np.diff(pulses.rise_tick[c, : pulses.total[c]]) >= 0)
        assert np.all(pulses.photodiode[c, pulses.total[c] :] == -1)
        assert np.all(pulses.photodiode[c, : pulses.total[c]] < layout.present[c].sum())
    assert np.all(pulses.rise_tick >= 0)


def test_flashes_carry_their_fan_and_follow_the_line_of_sight() -> None:
    motion, layout = FreeMotion(7, 1), layout_of([6])
    lit = all_lit(layout)
    lit[0, 0], lit[0, 1, 0], lit[0, 2, 1] = False, False, False
    pulses = row(Lighthouse(layout, QUIET, seed=3).sweep(motion.period(0), 0, lit), 0)
    for fan, code in ((0, 0), (1, 1)):
        seen = [k for k in range(6) if lit[0, k, fan]]
        width = (SYNC_WIDTH_S + code * SYNC_WIDTH_STEP_S) / TICK_S
        assert [k for k, _, w in pulses if abs(w - width) <= 0.5] == seen
        assert len({rise for _, rise, w in pulses if abs(w - width) <= 0.5}) == 1
    sweeps = [k for k, _, w in pulses if not is_flash(w)]
    assert sorted(sweeps) == [1, 2, 3, 3, 4, 4, 5, 5]


@pytest.mark.parametrize(
    ("fan_angles", "incidence_axis", "factor"),
    [
        # On boresight, a face turned about an axis across the fan's motion keeps its extent, along it shrinks.
        ((0.0, 0.0), None, (1.0, 1.0)),
        ((0.0, 0.0), 0, (1.0, np.cos(0.7))),
        ((0.0, 0.0), 1, (np.cos(0.7), 1.0)),
        # 0.6 rad to the right and facing back along -z: fan X passes r cos(0.6) slower away, and foreshortened.
        ((0.6, 0.0), None, (np.cos(0.6) ** 2, 1.0)),
    ],
)
def test_sweep_width_is_the_face_over_the_fans_speed(
    fan_angles: tuple[float, float], incidence_axis: int | None, factor: tuple[float, float]
) -> None:
    depth = 2.0
    place = depth * np.array([np.tan(fan_angles[0]), np.tan(fan_angles[1]), 1.0])
    turn = np.zeros(3)
    if incidence_axis is not None:
        turn[incidence_axis] = 0.7
    layout = pad([np.zeros((1, 3))], [np.array([[0.0, 0.0, -1.0]])])
    quaternion = quaternion_from_matrix(exp(turn))
    truth = Truth(np.array([0.0, PERIOD]), np.tile(place, (2, 1, 1)), np.tile(quaternion, (2, 1, 1)))
    pulses = row(Lighthouse(layout, QUIET, seed=4).sweep(truth, 0, all_lit(layout)), 0)
    widths = [w for _, _, w in pulses if not is_flash(w)]
    expected = 3e-3 / depth / W / TICK_S * np.array(factor)
    np.testing.assert_allclose(widths, expected, atol=0.5001)


def sampled_errors(table: Station, craft: int, frames: int, photodiodes: int = 5) -> Floats:
    """Angle errors (frames, craft, photodiodes, fans) [rad] of craft at rest, all pulses decoded at once."""
    motion, layout = FreeMotion(8, craft), layout_of([photodiodes] * craft)
    motion.velocity[:], motion.turn[:] = 0, 0
    lighthouse = Lighthouse(layout, table, seed=5)
    truth, lit = motion.period(0), all_lit(layout)
    logged = [lighthouse.sweep(truth, f, lit) for f in range(frames)]
    which, rise, width = (np.stack([getattr(p, name) for p in logged]) for name in Pulses._fields[:3])
    tick_s = lighthouse.settings.tick_s
    flash = [width == round((SYNC_WIDTH_S + code * SYNC_WIDTH_STEP_S) / tick_s) for code in (0, 1)]
    # All photodiodes see a flash at the same tick. Counted from it, ticks are exact in a double.
    zero = [np.where(seen, rise, 0).sum(axis=2) // photodiodes for seen in flash]
    theta = np.full((frames, craft, photodiodes, 2), np.nan)
    f, c, n = np.nonzero(~flash[0] & ~flash[1])
    assert len(f) == theta.size, "every photodiode is swept by both fans, and no pulse is anything else"
    at = rise[f, c, n]
    fan = (at > zero[1][f, c]).astype(np.int64)
    since = at - np.where(fan == 1, zero[1][f, c], zero[0][f, c])
    theta[f, c, which[f, c, n], fan] = W * tick_s * (since + width[f, c, n] / 2)
    return theta - ideal_theta(motion.points(layout, 0.0))


def test_every_angles_error_is_its_own_draw_and_its_sweeps() -> None:
    keys, rotor = keys_of(1, Purpose.LIGHT, range(3)), key_of(1, Purpose.LIGHT)
    lit = np.random.default_rng(0).random((3, 41, 2)) < 0.5
    errors = np.empty((-(-3 // WIDE), 2, 41, WIDE))
    errors_into(keys, rotor, 7, lit, 2.0, 3.0, draw_room(41), errors)
    out = row_by_row(errors, 3)
    common = normals(rotor, 7, 0, ANGLE)
    for (c, key), k in product(enumerate(keys), range(41)):
        drawn = normals(key, 7, k, ANGLE)
        expected = [2.0 * drawn[fan] + 3.0 * common[fan] if lit[c, k, fan] else np.nan for fan in range(2)]
        np.testing.assert_array_equal(out[c, k], expected)


def inside(sum_of_squares: float, count: int) -> bool:
    """Whether a sum of squares of `count` standard normal numbers is in its 99.9 % band."""
    low, high = chi2.ppf([0.0005, 0.9995], count)
    return bool(low < sum_of_squares < high)


def test_noise_has_a_shared_and_an_own_part_of_the_right_size() -> None:
    """5000 sweeps: a variance is known to 2 % (1 sigma), so that rho for sqrt(rho), 13 % less, is 6 sigma away."""
    rho, frames, craft, k = 0.8717, 5000, 2, 3
    # Ticks of 0.1 ns: their rounding (4e-8 rad) is a thousandth of the noise.
    errors = sampled_errors(station(angle_noise_arcsec=8.8, tick_ns=0.1), craft, frames, k) / NOISE
    shared = errors.mean(axis=(1, 2))
    own = errors - shared[:, None, None, :]
    n = craft * k
    # The mean over n of a shared draw and n own ones; the spread about it has n - 1 degrees of freedom.
    for fan in (0, 1):
        assert inside(float(np.sum(shared[:, fan] ** 2)) / (rho + (1 - rho) / n), frames)
        assert inside(float(np.sum(own[..., fan] ** 2)) / (1 - rho), frames * (n - 1))
    # Fans and successive sweeps are independent: correlations within 4 / sqrt(frames).
    limit = 4 / np.sqrt(frames)
    assert abs(np.corrcoef(shared[:, 0], shared[:, 1])[0, 1]) < limit
    assert abs(np.corrcoef(shared[:-1, 0], shared[1:, 0])[0, 1]) < limit
    assert abs(np.corrcoef(own[:, 0, 0, 0], own[:, 1, 0, 0])[0, 1] + 1 / (n - 1)) < limit


def test_sync_jitter_shifts_all_angles_of_a_sweep_alike() -> None:
    frames, jitter = 5000, 1e-6
    errors = sampled_errors(station(sync_jitter_ns=1e9 * jitter, tick_ns=0.1), 2, frames, 2)
    # Rounding to ticks of 0.1 ns is all that differs between photodiodes.
    assert np.ptp(errors, axis=(1, 2)).max() <= 2.001 * W * 1e-10
    # A late flash makes every angle smaller.
    for fan in (0, 1):
        assert inside(float(np.sum((errors[:, 0, 0, fan] / (W * jitter)) ** 2)), frames)


FAULTY = station(
    angle_noise_arcsec=8.8,
    sync_jitter_ns=100.0,
    mounting_error_mm=1.0,
    missed_sync_probability=0.2,
    lost_pulse_probability=0.2,
    stray_pulse_rate_hz=200.0,
)


def test_neither_other_craft_nor_padding_nor_order_changes_a_draw() -> None:
    truth, counts = FreeMotion(9, 5).period(0), [6, 4, 12, 5, 20]
    full = layout_of(counts)
    swarm = Lighthouse(full, FAULTY, seed=6)
    frames = [0, 1, 63, 64, 199, 2, 1 << 40]
    together = {f: swarm.sweep(truth, f, all_lit(full)) for f in frames}
    assert all(pulses.total.min() > 8 for pulses in together.values())
    for chosen in ([0], [2], [0, 1, 2], [3, 1]):
        part = pad([full.point_m[c, : counts[c]] for c in chosen], [full.normal[c, : counts[c]] for c in chosen])
        few = Lighthouse(part, FAULTY, seed=6, craft_keys=chosen)
        np.testing.assert_array_equal(few.clock_offset_tick, swarm.clock_offset_tick[chosen])
        alone = Truth(truth.time_s, truth.position[:, chosen], truth.quaternion[:, chosen])
        for f in reversed(frames):
            pulses = few.sweep(alone, f, all_lit(part))
            for i, c in enumerate(chosen):
                assert row(pulses, i) == row(together[f], c)


def test_visibility_changes_no_draw() -> None:
    motion, layout = FreeMotion(10, 3), layout_of([8] * 3)
    lit = all_lit(layout)
    some = lit & (np.random.default_rng(1).random(lit.shape) < 0.5)
    lighthouse = Lighthouse(layout, FAULTY, seed=7)
    for f in range(5):
        everything = lighthouse.sweep(motion.period(f), f, lit)
        less = lighthouse.sweep(motion.period(f), f, some)
        for c in range(3):
            assert set(row(less, c)) <= set(row(everything, c))


def test_faults_happen_as_often_as_asked() -> None:
    motion, layout = FreeMotion(11, 2), layout_of([6, 6])
    lighthouse = Lighthouse(layout, FAULTY, seed=8)
    frames, lit = 2000, all_lit(layout)
    truth = motion.period(0)
    flashes, sweeps, strays = [], 0, 0
    for f in range(frames):
        pulses = lighthouse.sweep(truth, f, lit)
        exact = [row(pulses, c) for c in range(2)]
        # A missed flash is missed by the whole craft.
        for code in FLASH_TICKS:
            seen = [sum(w == code for _, _, w in pulses_of) for pulses_of in exact]
            assert set(seen) <= {0, 6}
            flashes.append(seen)
        total = sum(not is_flash(w) for pulses_of in exact for _, _, w in pulses_of)
        strays += int(strays_of(lighthouse.keys, np.array([6, 6]), f, 200.0, PERIOD).number.sum())
        sweeps += total
    sweeps -= strays
    missed = np.array(flashes) == 0
    # Within 4 standard deviations of the binomial and Poisson laws.
    n = missed.size
    assert abs(missed.sum() - 0.2 * n) < 4 * np.sqrt(n * 0.16)
    assert abs(np.corrcoef(missed.T)[0, 1]) < 4 / np.sqrt(len(missed))
    n = frames * 24
    assert abs(sweeps - 0.8 * n) < 4 * np.sqrt(n * 0.16)
    mean = 200.0 / 60 * frames * 2
    assert abs(strays - mean) < 4 * np.sqrt(mean)


def test_strays_fall_on_own_photodiodes_at_any_time() -> None:
    layout = layout_of([4, 9])
    lighthouse = Lighthouse(layout, station(stray_pulse_rate_hz=600.0), seed=9)
    truth, dark = FreeMotion(12, 2).period(0), np.zeros((2, 9, 2), dtype=np.bool_)
    hits: list[list[int]] = [[], []]
    times: list[float] = []
    for f in range(300):
        pulses = lighthouse.sweep(truth, f, dark)
        zero = lighthouse.clock_offset_tick + f * PERIOD / TICK_S
        for c in range(2):
            for k, rise, width in row(pulses, c):
                hits[c].append(k)
                times.append((rise - zero[c]) * TICK_S / PERIOD)
                assert 1 <= width <= FLASH_TICKS[0] / 10 + 1
    for c, k in ((0, 4), (1, 9)):
        count = np.bincount(hits[c], minlength=k)
        assert len(count) == k
        expected = len(hits[c]) / k
        assert float(np.sum((count - expected) ** 2 / expected)) < chi2.ppf(0.999, k - 1)
    histogram, _ = np.histogram(times, bins=10, range=(0, 1))
    assert histogram.sum() == len(times)
    expected = len(times) / 10
    assert float(np.sum((histogram - expected) ** 2 / expected)) < chi2.ppf(0.999, 9)


def test_mounting_error_is_drawn_once_with_its_size() -> None:
    layout = layout_of([12] * 40)
    first, again = (Lighthouse(layout, station(mounting_error_mm=1.0), seed=10) for _ in range(2))
    np.testing.assert_array_equal(first.photodiodes.point_m, again.photodiodes.point_m)
    shift = (first.photodiodes.point_m - layout.point_m) / 1e-3
    assert inside(float(np.sum(shift**2)), shift.size)
    uneven = layout_of([3, 7])
    moved = Lighthouse(uneven, station(mounting_error_mm=1.0), seed=10).photodiodes
    assert np.all(moved.point_m[0, 3:] == 0)
    np.testing.assert_array_equal(Lighthouse(layout, QUIET, seed=10).photodiodes.point_m, layout.point_m)


def test_seed_decides() -> None:
    motion, layout = FreeMotion(13, 2), layout_of([6, 6])
    truth, lit = motion.period(0), all_lit(layout)
    one, same, other = (Lighthouse(layout, FAULTY, seed=s).sweep(truth, 0, lit) for s in (1, 1, 2))
    assert [row(one, c) for c in (0, 1)] == [row(same, c) for c in (0, 1)]
    assert row(one, 0) != row(other, 0)


def test_wrong_shapes_are_refused() -> None:
    layout = layout_of([6, 6])
    lighthouse = Lighthouse(layout, QUIET, seed=1)
    with pytest.raises(ValueError, match="lit must have shape"):
        lighthouse.sweep(FreeMotion(1, 2).period(0), 0, layout.present)
    with pytest.raises(ValueError, match="motion of 2 craft"):
        lighthouse.sweep(FreeMotion(1, 3).period(0), 0, all_lit(layout))
    with pytest.raises(ValueError, match="2 different craft keys"):
        Lighthouse(layout, QUIET, seed=1, craft_keys=[4, 4])
