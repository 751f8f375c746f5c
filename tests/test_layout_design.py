"""Choice of photodiodes: errors against the dilution, the objective and its optimum by brute force, Monte Carlo."""

from itertools import combinations

import numpy as np
import pytest
from convex_target import ANGLE_NOISE, RHO, dome, random_position, random_rotation, visible
from scipy.stats import chi2

from estimators.arrays import Floats, Ints
from estimators.layout.design import EXCESS, MARGIN, SHORT, TAIL, cover, design, objective, refine_design
from estimators.layout.error import LACKING, WANTED_LIT, WORST, Mix, Sightings, mixed_errors, percentile, sightings
from estimators.lighthouse.dop import dilution
from estimators.lighthouse.pose_trials import scatter

MIX = Mix(np.deg2rad(0.1), 2e-3, ANGLE_NOISE, RHO)
POINT, NORMAL = dome()


def poses(count: int, seed: int = 0) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    return random_rotation(rng, count), random_position(rng, count, 1.0, 3.0)


def scene(count: int, seed: int = 0, rho: float = RHO, every: int = 1) -> Sightings:
    rotation, position = poses(count, seed)
    lit = visible(rotation, position, POINT, NORMAL)
    return sightings(rotation, position, lit, POINT, MIX._replace(rotor_correlation=rho), every)


@pytest.mark.parametrize("rho", [0.0, RHO, 1.0])
def test_errors_are_those_of_the_dilution(rho: float) -> None:
    """`estimators.lighthouse.dop` works per craft, in other units, and is itself tested against source 1's matrices."""
    rotation, position = poses(200)
    lit = visible(rotation, position, POINT, NORMAL)
    chosen = np.array([0, 1, 3, 4, 6, 7, 8, 10])
    seen = lit[:, chosen]
    count = seen.shape
    made = dilution(
        rotation,
        position,
        seen,
        np.broadcast_to(POINT[chosen], (*count, 3)),
        np.zeros((*count, 2)),
        np.zeros((count[0], 3)),
        np.zeros((count[0], 3)),
        rho,
        seen.sum(axis=1) >= 4,
    )
    expected = np.hypot(
        np.deg2rad(made.adop_deg_per_rad) * ANGLE_NOISE / MIX.attitude_rad,
        made.pdop_m_per_rad * ANGLE_NOISE / MIX.position_m,
    )
    found = mixed_errors(scene(200, rho=rho), chosen)
    solvable = np.isfinite(expected)
    assert solvable.sum() > 20
    np.testing.assert_array_equal(np.isfinite(found), solvable)
    # Two Choleskys of matrices in other units: their condition, up to 1e6, times rounding.
    np.testing.assert_allclose(found[solvable], expected[solvable], rtol=1e-8)


def brute_objective(candidates: Sightings, chosen: Ints, share: float) -> float:
    """The objective in plain NumPy, from the full covariance of every pose."""
    row, lit = candidates.row[:, chosen], candidates.lit[:, chosen]
    errors = []
    for p in range(len(lit)):
        count = int(lit[p].sum())
        e = WORST
        if count >= 4:
            j = row[p, lit[p]].transpose(1, 0, 2).reshape(-1, 6)
            r = np.kron(np.eye(2), RHO * np.ones((count, count)) + (1 - RHO) * np.eye(count))
            inverse = np.linalg.pinv(j)
            e = min(WORST, float(np.sqrt(np.trace(inverse @ r @ inverse.T))))
        errors.append(e * (1 + LACKING * max(0, WANTED_LIT - count)))
    seen = candidates.reached[:, chosen].sum(axis=1)
    blind = np.where(seen < 4, 1 + SHORT * (4 - seen), 0).mean()
    ordered = np.sort(errors)
    last = int(share * len(ordered))
    tail = ordered[int((share - TAIL) * len(ordered)) : last]
    return EXCESS * max(0.0, float(blind) - MARGIN * (1 - share)) + float(np.mean(np.log(tail)))


@pytest.mark.parametrize("share", [0.3, 0.55])
def test_objective_is_what_it_says(share: float) -> None:
    candidates = scene(120, every=2)
    rng = np.random.default_rng(1)
    for count in (4, 6, 9):
        chosen = rng.choice(12, count, replace=False)
        expected = brute_objective(candidates, chosen, share)
        assert objective(candidates, chosen, share) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(("seed", "count", "share"), [(0, 6, 0.4), (1, 7, 0.5), (2, 8, 0.5)])
def test_search_finds_the_best_of_all_sets(seed: int, count: int, share: float) -> None:
    """All sets of the 12 photodiodes, up to 924."""
    candidates = scene(100, seed)
    best = min(objective(candidates, np.array(chosen), share) for chosen in combinations(range(12), count))
    found = design(candidates, count, share, starts=20, finalists=6, rounds=2)[0]
    assert found.objective == pytest.approx(best, abs=1e-9)
    assert objective(candidates, found.chosen, share) == pytest.approx(found.objective, abs=1e-9)
    assert len(np.unique(found.chosen)) == count


def test_cover_finds_the_fewest_unsolvable_poses() -> None:
    reached = scene(400, 3).reached
    fewest = min((reached[:, chosen].sum(axis=1) < 4).sum() for chosen in combinations(range(12), 9))
    found = cover(reached, 9, 0.99, starts=20)
    assert (reached[:, found[0].chosen].sum(axis=1) < 4).sum() == fewest
    values = [each.objective for each in found]
    assert values == sorted(values)


def test_an_exchange_never_worsens_its_start() -> None:
    candidates = scene(150, 4)
    rng = np.random.default_rng(4)
    for _ in range(5):
        start = rng.choice(12, 7, replace=False)
        assert refine_design(candidates, [start], 0.5)[0].objective <= objective(candidates, start, 0.5)


def test_same_seed_same_design_on_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    candidates = scene(100, 5)
    first = design(candidates, 6, 0.4, starts=10, finalists=4, rounds=1, seed=7)
    monkeypatch.setattr("estimators.layout.design.WORKERS_MAX", 1)
    second = design(candidates, 6, 0.4, starts=10, finalists=4, rounds=1, seed=7)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.chosen, b.chosen)


def test_more_photodiodes_are_never_worse() -> None:
    """Independent noise: J^T J grows, so the trace of its inverse cannot. rho: see the next test."""
    candidates = scene(200, 6, rho=0.0)
    chosen = np.array([0, 2, 4, 5, 7, 9, 11])
    few = mixed_errors(candidates, chosen)
    for more in np.setdiff1d(np.arange(12), chosen):
        many = mixed_errors(candidates, np.append(chosen, more))
        assert np.all(many[np.isfinite(few)] <= few[np.isfinite(few)] * (1 + 1e-9))
        assert np.isinf(many).sum() <= np.isinf(few).sum()


def test_more_photodiodes_are_not_worse_to_speak_of_with_shared_noise() -> None:
    """Least squares without the noise's correlations is within 0.1 % of the bound, which cannot grow (section 3)."""
    candidates = scene(200, 6)
    chosen = np.array([0, 2, 4, 5, 7, 9, 11])
    few = mixed_errors(candidates, chosen)
    for more in np.setdiff1d(np.arange(12), chosen):
        many = mixed_errors(candidates, np.append(chosen, more))
        assert np.all(many[np.isfinite(few)] <= few[np.isfinite(few)] * 1.002)


def test_unsolvable_poses_are_infinite() -> None:
    candidates = scene(50, 7)
    chosen = np.arange(4)
    seen = candidates.lit[:, chosen].sum(axis=1)
    np.testing.assert_array_equal(np.isinf(mixed_errors(candidates, chosen)), seen < 4)
    # Four on one line determine no pose, however many see them.
    line = np.array([[0.01 * i, 0.0, 0.03] for i in range(4)])
    rotation, position = poses(20)
    on_line = sightings(rotation, position, np.ones((20, 4), dtype=np.bool_), line, MIX)
    assert np.isinf(mixed_errors(on_line, chosen)).all()


def test_percentile_counts_what_is_unsolvable() -> None:
    error = np.array([3.0, 1.0, np.inf, 2.0])
    assert percentile(error, 0.25) == 1.0
    assert percentile(error, 0.75) == 3.0
    assert percentile(error, 0.76) == np.inf
    # 0.95 * 20 is 19 but for rounding.
    assert percentile(np.arange(20.0), 0.95) == 18.0


def test_wrong_numbers_are_refused() -> None:
    candidates = scene(20)
    with pytest.raises(ValueError, match="3 photodiodes: at least 4"):
        design(candidates, 3, 0.9)
    with pytest.raises(ValueError, match="there are 12 candidates"):
        design(candidates, 13, 0.9)
    with pytest.raises(ValueError, match="point_m"):
        sightings(*poses(5), np.ones((5, 4), dtype=np.bool_), POINT, MIX)


def test_scatter_is_what_the_dilution_predicts() -> None:
    """The mean square of n trials of a 3-vector: chi-square between those of n and 3 n degrees of freedom."""
    rotation, position = poses(60, 8)
    lit = visible(rotation, position, POINT, NORMAL)
    # Poses seen by a plane alone scatter beyond the linear law; the dome's top is one, so ask for more.
    keep = lit.sum(axis=1) >= 6
    rotation, position, lit = rotation[keep], position[keep], lit[keep]
    count, trials = len(lit), 400
    still = np.zeros((count, 12, 2)), np.zeros((count, 3)), np.zeros((count, 3))
    every = np.ones(count, dtype=np.bool_)
    made = dilution(rotation, position, lit, np.broadcast_to(POINT, (count, 12, 3)), *still, RHO, every)
    found = scatter(rotation, position, lit, POINT, ANGLE_NOISE, RHO, trials, seed=1)
    assert np.all(found.failed == 0)
    ratio = np.stack(
        [
            found.attitude_rad / (np.deg2rad(made.adop_deg_per_rad) * ANGLE_NOISE),
            found.position_m / (made.pdop_m_per_rad * ANGLE_NOISE),
        ]
    )
    # 1e-3 over all poses and both errors; a square dominated by one direction has `trials` degrees of freedom.
    chance = 1e-3 / ratio.size
    low, high = (np.sqrt(chi2.ppf(q, trials) / trials) for q in (chance / 2, 1 - chance / 2))
    assert np.all(ratio > low)
    assert np.all(ratio < high)


def test_scatter_says_what_it_cannot_solve() -> None:
    rotation, position = poses(3, 9)
    lit = np.ones((3, 12), dtype=np.bool_)
    lit[1, 3:] = False
    found = scatter(rotation, position, lit, POINT, ANGLE_NOISE, RHO, 5, seed=1)
    np.testing.assert_array_equal(found.failed, [0, 1, 0])
    np.testing.assert_array_equal(np.isnan(found.position_m), [False, True, False])


def test_scatter_does_not_depend_on_its_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    rotation, position = poses(7, 10)
    lit = np.ones((7, 12), dtype=np.bool_)
    whole = scatter(rotation, position, lit, POINT, ANGLE_NOISE, 0.0, 10, seed=1)
    monkeypatch.setattr("estimators.lighthouse.pose_trials.BATCH", 20)
    assert np.isfinite(whole.attitude_rad).all()
    assert np.isfinite(scatter(rotation, position, lit, POINT, ANGLE_NOISE, 0.0, 10, seed=1).attitude_rad).all()
