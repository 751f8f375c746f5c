"""Lanes: every operation against NumPy bit for bit, and PnP and dilution of several craft at once against one alone."""

from typing import Any, cast

import numpy as np
import pytest
from convex_target import draw, sweep_offsets

from estimators import lanes
from estimators import rotation as rot
from estimators.arrays import LINE, Bools, Floats, lined
from estimators.exponential import exponential, logarithm
from estimators.kernel import kernel
from estimators.kernel_digest import KernelDigest
from estimators.lanes import (
    FOURS,
    WIDE,
    alike,
    all_of,
    any_in_four,
    any_of,
    beside,
    exponent,
    fours_in,
    lane,
    lanes_in,
    mantissa,
    opposite,
    pack,
    power_of_two,
    select,
    transposed,
    wide_in,
    width,
    with_lane,
)
from estimators.lighthouse.dop import dilution, dilution_one, overwrite, rows_at, unknown
from estimators.lighthouse.pnp import (
    FEWEST_LIT,
    ITERATIONS_MAX,
    refine,
    refine_one,
    refine_projections,
    refine_with_dilution,
)
from estimators.lighthouse.projection import (
    COLUMNS,
    VALUE,
    WEIGHT,
    gather,
    projections,
    table_spans_plane,
)

ODD = [0.0, -0.0, 1.0, -2.5, np.inf, -np.inf, np.nan, 5e-324, 1e308, -1e-310]


def bits(array: Floats) -> Any:
    """The bytes of doubles, all NaN alike: which NaN an operation makes is the processor's affair."""
    return np.where(np.isnan(array), np.nan, array).tobytes()


@kernel
def everything(given: Floats, out: Floats) -> None:
    values, into = lanes_in(given), lanes_in(out)
    for k in range(values.shape[1]):
        a, b = values[0, k], values[1, k]
        total = 0.0
        total += a
        into[0, k], into[1, k], into[2, k], into[3, k] = a + b, a - b, a * b, a / b
        into[4, k], into[5, k], into[6, k], into[7, k] = -a, abs(a), np.sqrt(a), total
        into[8, k], into[9, k], into[10, k] = max(a, b), min(a, b), select(a < b, a, 2)
        into[11, k], into[12, k] = select(a <= b, 1, 0.0), select((a > b) | (a >= 1) & opposite(b == 1), a, b)
        into[13, k], into[14, k] = select(a != b, 1 - a, 3 / b), select(select(a < 0, b < 0, True), a, b)
        into[15, k] = pack(lane(a, 3), lane(b, 0), 1, lane(a, 1))
        into[16, k] = with_lane(with_lane(a, 0, lane(b, 2)), 2, width(a))
        into[17, k] = select(pack(True, False, lane(a < b, 2), all_of(a == a)), 1.0, 0.0)
        into[18, k] = select(any_of(a < 0) & (a == a), 1.0, 0.0)
        into[19, k], into[20, k], into[21, k], into[22, k] = transposed(a, b, abs(a), abs(b))


def test_every_operation_is_numpys_bit_for_bit() -> None:
    pairs = np.array(np.meshgrid(ODD, ODD)).reshape(2, -1)
    rng = np.random.default_rng(1)
    given = np.concatenate([pairs, rng.standard_normal((2, 100))], axis=1).reshape(2, -1, 4)
    out = np.full((23, given.shape[1], 4), 7.0)
    everything(given, out)
    a, b = given
    swapped = a.copy()
    swapped[:, 0], swapped[:, 2] = b[:, 2], 4
    with np.errstate(all="ignore"):
        wanted = [
            *(a + b, a - b, a * b, a / b, -a, abs(a), np.sqrt(a), 0.0 + a),
            *(np.where(b > a, b, a), np.where(b < a, b, a), np.where(a < b, a, 2)),
            *(np.where(a <= b, 1, 0), np.where((a > b) | (a >= 1) & ~(b == 1), a, b)),
            *(np.where(a != b, 1 - a, 3 / b), np.where(np.where(a < 0, b < 0, True), a, b)),
            *(np.stack([a[:, 3], b[:, 0], np.ones(len(a)), a[:, 1]], axis=-1), swapped),
            np.stack([np.ones(len(a)), np.zeros(len(a)), a[:, 2] < b[:, 2], (a == a).all(axis=1)], axis=-1),
            np.any(a < 0, axis=1, keepdims=True) & (a == a),
            *np.stack([a, b, abs(a), abs(b)]).transpose(2, 1, 0),
        ]
    for number, (mine, theirs) in enumerate(zip(out, wanted, strict=True)):
        assert bits(mine) == bits(np.asarray(theirs, dtype=np.float64)), number


@kernel
def in_place(array: Floats) -> None:
    rows = lanes_in(array)
    rows[1:][0] = 3
    middle = rows[2:6].reshape(2, 2)
    for k in range(2):
        middle[1, k] += rows[0]


@kernel
def everything_wide(given: Floats, out: Floats) -> None:
    values, into = wide_in(given), wide_in(out)
    for k in range(values.shape[1]):
        a, b = values[0, k], values[1, k]
        into[0, k], into[1, k], into[2, k], into[3, k] = a + b, a - 2, 3 * b, a / b
        into[4, k], into[5, k], into[6, k], into[7, k] = -a, abs(a), np.sqrt(a), max(a, b)
        into[8, k], into[9, k] = min(a, b), select((a < b) | opposite(b == 1), a, 2)
        into[10, k] = with_lane(alike(a, lane(b, WIDE - 1)), 1, width(a))
        into[11, k] = alike(a, select(any_of(a < 0) & (not all_of(a < 0)), 1.0, 0.0))


def test_wide_lanes_do_the_same() -> None:
    rng = np.random.default_rng(2)
    pairs = np.concatenate([np.array(np.meshgrid(ODD, ODD)).reshape(2, -1), rng.standard_normal((2, 100))], axis=1)
    given = pairs.reshape(2, -1, WIDE)
    out = np.full((12, given.shape[1], WIDE), 7.0)
    everything_wide(given, out)
    a, b = given
    last = np.repeat(b[:, -1:], WIDE, axis=1)
    last[:, 1] = WIDE
    some = (a < 0).any(axis=1, keepdims=True) & ~(a < 0).all(axis=1, keepdims=True)
    with np.errstate(all="ignore"):
        wanted = [
            *(a + b, a - 2, 3 * b, a / b, -a, abs(a), np.sqrt(a), np.where(b > a, b, a)),
            *(np.where(b < a, b, a), np.where((a < b) | ~(b == 1), a, 2), last, some & (a == a)),
        ]
    wanted[-1] = np.broadcast_to(some, a.shape)
    for number, (mine, theirs) in enumerate(zip(out, wanted, strict=True)):
        assert bits(mine) == bits(np.asarray(theirs, dtype=np.float64)), number


@kernel
def fours(given: Floats, out: Floats) -> None:
    values, into = lanes_in(given), wide_in(out)
    for k in range(values.shape[1]):
        a, b = values[0, k], values[1, k]
        into[0, k] = beside(a, b)
        into[1, k], into[2, k], into[3, k], into[4, k] = transposed(
            beside(a, b), beside(b, a), beside(a, a), into[0, k]
        )
        into[5, k] = select(any_in_four(beside(a > 0, b > 0)), beside(1.0, 2), beside(lane(a, 1), 0.0))
        fours_in(into)[6, k, 0] = a
        fours_in(into)[6, k, FOURS - 1] = fours_in(into)[0, k, FOURS - 1]


def test_fours_side_by_side() -> None:
    rng = np.random.default_rng(5)
    given = rng.standard_normal((2, 9, 4)) - 0.7
    out = np.full((7, 9, WIDE), 7.0)
    fours(given, out)
    a, b = given
    rows = np.stack([np.hstack(pair)[:, :WIDE] for pair in ((a, b), (b, a), (a, a), (a, b))])
    np.testing.assert_array_equal(out[0], rows[0])
    turned = rows.reshape(4, 9, FOURS, 4).transpose(3, 1, 2, 0).reshape(4, 9, WIDE)
    np.testing.assert_array_equal(out[1:5], turned)
    positive = [np.repeat((part > 0).any(axis=1, keepdims=True), 4, axis=1) for part in (a, b)]
    assert 0 < positive[0].sum() < positive[0].size
    chosen = [np.where(positive[0], 1.0, a[:, 1:2]), np.where(positive[1], 2.0, 0.0)]
    np.testing.assert_array_equal(out[5], np.hstack(chosen)[:, :WIDE])
    np.testing.assert_array_equal(out[6], rows[0])


def test_an_array_may_begin_with_a_line_of_the_cache() -> None:
    for shape in ((3,), (5, 7, 4), (1000, 78, 4)):
        array = lined(*shape)
        assert array.shape == shape
        assert array.flags.c_contiguous
        assert array.ctypes.data % LINE == 0
        assert not array.any()


@kernel
def by_powers(given: Floats, out: Floats, numbers: Floats) -> None:
    values, into = wide_in(given), wide_in(out)
    for k in range(len(values)):
        into[0, k], into[1, k] = mantissa(values[k]), exponent(values[k])
        into[2, k] = power_of_two(exponent(values[k])) * mantissa(values[k])
        into[3, k], into[4, k] = logarithm(values[k]), exponential(logarithm(values[k]))
        for i in range(WIDE):
            numbers[0, k, i], numbers[1, k, i] = mantissa(given[k, i]), exponent(given[k, i])
            numbers[2, k, i] = power_of_two(numbers[1, k, i]) * numbers[0, k, i]
            numbers[3, k, i] = logarithm(given[k, i])
            numbers[4, k, i] = exponential(numbers[3, k, i])


def test_powers_logarithm_and_exponential() -> None:
    rng = np.random.default_rng(6)
    ordinary = np.exp(rng.uniform(-700, 700, 400))
    near = 1 + np.array([0.0, 1e-16, 1e-9, 0.3, 0.414, 0.415, -1e-16, -1e-9, -0.2, -0.292, -0.293, 1.0])
    given = np.concatenate([ordinary, near, np.full(-len(near) % WIDE, 2.0)]).reshape(-1, WIDE)
    out, numbers = np.empty((2, 5, *given.shape))
    by_powers(given, out, numbers)
    np.testing.assert_array_equal(out, numbers)
    fraction, power = np.frexp(given)
    np.testing.assert_array_equal(out[0], 2 * fraction)
    np.testing.assert_array_equal(out[1], power - 1)
    np.testing.assert_array_equal(out[2], given)
    # A unit in the last place is up to 2.2e-16 of a number.
    np.testing.assert_allclose(out[3], np.log(given), rtol=4e-16)
    np.testing.assert_allclose(out[4], np.exp(out[3]), rtol=4e-16)


def test_logarithm_and_exponential_beyond_their_range() -> None:
    with np.errstate(all="ignore"):
        assert [logarithm(x) for x in (-1.0, 0.0, np.inf, np.nan)] == pytest.approx([np.nan] * 4, nan_ok=True)
    assert [exponential(x) for x in (-709.0, -np.inf, 710.0, np.inf)] == [0.0, 0.0, np.inf, np.inf]
    assert np.isnan(exponential(np.nan))


def test_an_array_of_lanes_shares_the_memory_of_its_numbers() -> None:
    array = np.arange(24.0).reshape(6, 4)
    wanted = array.copy()
    wanted[1] = 3
    wanted[4:] += array[0]
    in_place(array)
    np.testing.assert_array_equal(array, wanted)


@kernel
def names_lanes(x: float) -> float:
    return select(x > 0, x, 0.0)


def test_machine_code_follows_from_the_file_of_lanes(monkeypatch: pytest.MonkeyPatch) -> None:
    before = KernelDigest().of(cast(Any, names_lanes))
    assert KernelDigest().of(cast(Any, names_lanes)) == before
    monkeypatch.setattr(lanes, "KERNEL_SOURCE", "another")
    assert KernelDigest().of(cast(Any, names_lanes)) != before


class Company:
    """Craft with all sorts of light and starts, side by side: near, far, behind, odd, and none at all."""

    def __init__(self, count: int = 61) -> None:
        rng = np.random.default_rng(3)
        self.truth = draw(rng, count, 1.0, 5.0)
        d = self.truth
        self.lit = d.lit & (rng.random((count, 12)) < rng.choice([0.4, 1.0], (count, 1)))
        self.point = d.point.copy()
        self.offset = sweep_offsets(rng, count, 12)
        self.rate, self.velocity = 0.5 * rng.standard_normal((count, 3)), 0.3 * rng.standard_normal((count, 3))
        self.rate[5] = 40, -20, 10  # beyond the series of sine and cosine
        self.rotation = rot.exp(rng.choice([0.01, 0.3, 2.0], (count, 1)) * rng.standard_normal((count, 3))) @ d.rotation
        self.position = d.position + rng.choice([0.003, 0.3], (count, 1)) * rng.standard_normal((count, 3))
        place = np.einsum("cij,ckj->cki", d.rotation, d.point) + d.position[:, None]
        self.uv = place[..., :2] / place[..., 2:] + 1e-4 * rng.standard_normal((count, 12, 2))
        self.weight = 1 / (1 + self.uv**2)
        self.position[7], self.rotation[8], self.position[9] = (0, 0, -2), np.nan, (0, 0, 0.01)
        self.uv[10], self.weight[11], self.lit[12] = np.nan, np.inf, False
        self.point[13] = np.linspace(-1, 1, 12)[:, None] * [0.05, 0.02, 0.01]
        self.uv[~self.lit], self.point[~self.lit] = np.nan, np.nan
        self.lit[14:16] = True
        self.uv[14:16], self.point[14:16] = self.uv[20], self.point[20]

    def motion(self) -> tuple[Floats, Floats, Floats]:
        return self.offset, self.rate, self.velocity

    def table(self, c: int) -> tuple[Floats, int]:
        """The angles of one craft, numbers."""
        out, lit = np.empty((24, COLUMNS)), self.lit[c]
        n = gather(lit, self.point[c], self.offset[c], self.rate[c], self.velocity[c], out)
        out[: 2 * n, VALUE] = self.uv[c, lit].T.reshape(-1)
        out[: 2 * n, WEIGHT] = self.weight[c, lit].T.reshape(-1)
        return out, n


def test_poses_side_by_side_are_those_of_one_alone_bit_for_bit() -> None:
    company = Company()
    solution = refine_projections(
        company.uv, company.weight, company.lit, company.point, company.rotation, company.position, *company.motion()
    )
    hard = 0
    for c in range(len(company.lit)):
        table, n = company.table(c)
        rotation, position = company.rotation[c].copy(), company.position[c].copy()
        angles = table[: 2 * n]
        sound = n >= FEWEST_LIT and bool(np.isfinite(angles[:, VALUE] * angles[:, WEIGHT]).all())
        sound = sound and table_spans_plane(table, n)
        found = refine_one(table, n, rotation, position, sound, ITERATIONS_MAX) if n else (False, 0, 0)
        assert (solution.solved[c], solution.iterations[c]) == found[:2], c
        if solution.solved[c]:
            hard += solution.iterations[c] > 5
            assert bits(solution.rotation[c]) == bits(rotation), c
            assert bits(solution.position[c]) == bits(position), c
            assert solution.cost[c] == found[2], c
        else:
            assert np.isnan(solution.position[c]).all()
    assert 20 <= np.count_nonzero(solution.solved) < len(company.lit) - 5
    assert hard >= 3, "damped steps, with curvature"


def test_dilutions_side_by_side_are_those_of_one_alone_bit_for_bit() -> None:
    company = Company()
    d, rho = company.truth, 0.1
    mask: Bools = np.arange(len(company.lit)) % 9 > 0
    rotation, position = d.rotation.copy(), d.position.copy()
    position[20], rotation[21] = (0, 0, -2), np.nan
    ours = dilution(rotation, position, company.lit, company.point, *company.motion(), rho, mask)
    for c in range(len(company.lit)):
        table, n = company.table(c)
        table[:, WEIGHT] = 1
        out = np.empty((2, 6, 6))
        alone = mask[c] and n > 0 and rows_at(table, n, rotation[c], position[c], True)
        if alone:
            found = dilution_one(table, n, float(n), rho, out[0], out[1])
            alone = found[0] and table_spans_plane(table, n)
        assert alone == np.isfinite(ours.pdop_m_per_rad[c]), c
        if alone:
            assert bits(ours.covariance[c]) == bits(out[0]), c
            assert bits(ours.rate_coupling[c]) == bits(out[1]), c
            assert ours.attitude_slope_deg_per_rad[c] == np.rad2deg(found[1]), c
            assert ours.position_slope_m_per_rad[c] == found[2], c
    assert 20 <= np.count_nonzero(np.isfinite(ours.pdop_m_per_rad)) < len(company.lit) - 5


def test_a_pose_and_its_precision_are_the_same_whoever_is_beside_it_bit_for_bit() -> None:
    # Beside others that take more steps, or damped ones: a craft that has ended keeps the rows of its last step.
    company, rho = Company(), 0.1
    given = np.arctan2(1, company.uv), company.lit, company.point, company.rotation, company.position, *company.motion()
    solution, precision = refine_with_dilution(*given, rho)
    for mine, other in zip(solution, refine(*given), strict=True):
        np.testing.assert_array_equal(mine, other)
    assert 20 <= np.count_nonzero(solution.solved) < len(company.lit) - 5
    assert len(set(solution.iterations[solution.solved].tolist())) > 3
    np.testing.assert_array_equal(np.isfinite(precision.pdop_m_per_rad), solution.solved)
    for c in range(len(company.lit)):
        only: Any = [*(part[c : c + 1] for part in given), rho]
        alone = refine_with_dilution(*only)
        for mine, other in zip((*solution, *precision), (*alone[0], *alone[1]), strict=True):
            assert bits(np.asarray(mine[c : c + 1], dtype=np.float64)) == bits(np.asarray(other, dtype=np.float64)), c


def test_a_poses_precision_made_with_it_is_nearly_that_at_the_pose() -> None:
    company, rho = Company(), 0.1
    given = np.arctan2(1, company.uv), company.lit, company.point, company.rotation, company.position
    solution, precision = refine_with_dilution(*given, *company.motion(), rho)
    after = dilution(*solution[:2], company.lit, company.point, *company.motion(), rho, solution.solved)
    scale = np.sqrt(np.einsum("cii->ci", after.covariance))
    apart = abs(precision.covariance - after.covariance) / (scale[:, :, None] * scale[:, None])
    known = np.isfinite(after.pdop_m_per_rad)
    print("H with the pose less H at it, of its scale: most", apart[known].max(), "median", np.median(apart[known]))
    # Angles are 1e-4 off the pose's, by which (13) is changed, and the last step is below 1e-5.
    assert known.sum() >= 20
    assert apart[known].max() < 2e-3
    for k in (1, 2, 4, 5):
        np.testing.assert_allclose(precision[k][known], after[k][known], rtol=2e-3)


def test_precision_of_some_craft_is_overwritten() -> None:
    company = Company()
    d, rho = company.truth, 0.1
    of = d.rotation, d.position, company.lit, company.point, *company.motion()
    all_of_them, mask = np.ones(len(company.lit), dtype=np.bool_), np.arange(len(company.lit)) % 3 == 0
    whole, some, none = dilution(*of, rho, all_of_them), dilution(*of, rho, mask), unknown(len(mask))
    overwrite(none, mask, whole)
    overwrite(whole, ~mask, None)
    for part, ours, other in zip(some, none, whole, strict=True):
        assert bits(part) == bits(ours) == bits(other)


def test_a_cotangent_is_exact_to_four_units_in_the_last_place_and_the_same_of_lanes_and_of_a_number() -> None:
    rng = np.random.default_rng(8)
    small = 10.0 ** rng.uniform(-300, 0, 500)
    near = np.pi / 2 + 10.0 ** rng.uniform(-17, 0, 500) * rng.choice([-1, 1], 500)
    theta = np.concatenate([rng.uniform(0, np.pi, 4000), small, np.pi - 10.0 ** rng.uniform(-15, 0, 500), near])
    exact = np.cos(theta.astype(np.longdouble)) / np.sin(theta.astype(np.longdouble))
    found = projections(theta)
    assert (np.abs(found - exact) <= 4 * np.spacing(np.abs(exact.astype(np.float64)))).all()
    outside = np.array([0.0, -1.0, np.pi, 4.0, np.nan, np.inf, -np.inf])
    assert np.isnan(projections(outside)).all()
    shifted = projections(np.concatenate([outside[:1], theta]))[1:]  # other angles side by side, and left over
    assert bits(shifted) == bits(found)
