"""Mirror images: innovations to second order, a filter parted at a fold, two poses of a search, windows of models."""

from dataclasses import replace

import numpy as np
import pytest

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.filter.compiled import CompiledFilterBank
from estimators.filter.interacting import COLUMNS, Grid, Mixtures, _mix, _move_window, combine
from estimators.lanes import LANES
from estimators.lighthouse.curvature import to_second_order
from estimators.lighthouse.innovation import Innovations, innovations, light_of, rows_of_sweeps
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import AT_ORIGIN, packed
from estimators.lighthouse.sweep import ideal_theta
from estimators.pivot import ARMS, PIVOT, turn_about
from estimators.state import STATES, State
from swarm.hardware import pad
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.mirror_images import MirrorImages, _away, _moved
from swarm.onboard.navigation import Navigator
from swarm.onboard.settings import NavigationSettings, Status
from swarm.onboard.single_sweeps import SingleSweeps
from swarm.onboard.tracks import TrackLimits, Tracks

T = 1 / 60
NOISE = AngleNoise(1.5e-5, 4.0e-5)
SIGMA = float(np.hypot(*NOISE))
SETTINGS = NavigationSettings(T, SIGMA, (NOISE.shared_rad / SIGMA) ** 2, filter="compiled")
OFFSETS = np.array([-T / 4, T / 4])
STATION = packed([AT_ORIGIN])
TRIPLE = np.array([[0.0559, 0.008, 0.0082], [0.006, -0.0332, 0.0309], [0.0412, 0.0412, 0.0077]])
"""Three photodiodes of the mockup whose two poses meet a few degrees from the attitude HOLD, 3 m away."""
HOLD = rot.exp(np.array([0.0, np.pi - 0.3, 0.0])) @ rot.exp(np.array([0.2, 0.0, 0.0]))
PLATE = 0.05 * np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])


def held(craft: int, rotation: Floats = HOLD) -> State:
    nothing = np.zeros((craft, 3))
    place = np.broadcast_to(np.array([0.0, 0.0, 3.0]), (craft, 3)).copy()
    return State(np.broadcast_to(rotation, (craft, 3, 3)).copy(), place, nothing, nothing.copy())


def light(state: State, points: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Noisy angles (C, K, 2) of craft at rest, and their instants."""
    theta = ideal_theta(np.einsum("cij,kj->cki", state.rotation, points) + state.position[:, None])
    rotor = NOISE.shared_rad * rng.standard_normal((len(theta), 1, 2))
    theta = theta + rotor + NOISE.own_rad * rng.standard_normal(theta.shape)
    return theta, np.broadcast_to(OFFSETS, theta.shape).copy()


def coarse(degrees: float) -> Floats:
    """Covariance of a filter that knows its roll well, and its tilts to so many degrees."""
    sigma = np.repeat([np.radians(degrees), 0.02, 5e-4, 0.01], 3)
    sigma[2] /= 10
    return np.diag(np.square(sigma))


def off(state: State, x: Floats, points: Floats) -> State:
    """States that are off by errors x (C, 12), about the photodiodes' centre."""
    out = State._make(part.copy() for part in state)
    for c in range(len(x)):
        place = out.rotation[c], out.angular_rate[c], out.position[c], out.velocity[c]
        turn_about(*place, x[c], np.append(points.mean(axis=0), np.zeros(PIVOT - 3)), np.empty(ARMS))
    return out


def test_innovations_to_second_order_have_the_mean_and_the_variance_that_they_claim() -> None:
    rng, craft = np.random.default_rng(1), 300
    predicted, covariance = held(craft), np.broadcast_to(coarse(2.0), (craft, STATES, STATES)).copy()
    error = rng.multivariate_normal(np.zeros(STATES), coarse(2.0), size=craft)
    theta, offset = light(off(predicted, error, TRIPLE), TRIPLE, rng)
    # The truth is off by its rates as well: they do not move what is seen at rest.
    rows = rows_of_sweeps(theta, np.zeros_like(offset))
    every, point = np.ones(craft, dtype=np.bool_), np.tile(TRIPLE, (craft, 1, 1))

    def asked(state: State, mask: np.ndarray) -> Innovations:
        return innovations(
            rows, np.ones(len(rows.angle), dtype=np.bool_), mask, light_of(STATION, [NOISE]), point, state
        )

    found = asked(predicted, every)
    plain = found.y - (found.h @ error[..., None])[..., 0]
    to_second_order(found, every, predicted, covariance, asked)
    left = found.y - (found.h @ error[..., None])[..., 0]
    # Six of unit variance, the heavy tail of a square of squares; to first order it is far off.
    assert np.sum(left**2, axis=1).mean() == pytest.approx(6.0, rel=0.2)
    assert np.abs(left.mean(axis=0)).max() < 5 / np.sqrt(craft)
    assert np.sum(plain**2, axis=1).mean() > 8.5


def test_a_filter_that_reaches_over_a_fold_is_parted_into_what_it_was() -> None:
    rng = np.random.default_rng(2)
    bank, layout = CompiledFilterBank(1), TRIPLE[None]
    tracks = Tracks(bank, T, TrackLimits(2.0, 6), None)
    sweeps = SingleSweeps(layout, SETTINGS)
    images = MirrorImages(CompiledFilterBank(1), tracks, sweeps)
    bank.adopt(np.ones(1, dtype=np.bool_), held(1), coarse(5.0)[None])
    taken = sweeps.take_in(*light(held(1), TRIPLE, rng), np.ones(1, dtype=np.bool_), tracks)
    before = tracks.filtered()
    assert not images.open.any()
    images.step(taken)
    assert images.open.all()
    after = images.reported(tracks.filtered())
    # Both together are what the filter was, and neither of them is.
    turned = np.degrees(rot.angle_between(after.state.rotation, before.state.rotation[0]))
    assert turned[0] < 0.3
    np.testing.assert_allclose(after.covariance[0, :3, :3], before.covariance[0, :3, :3], rtol=0.1, atol=1e-5)
    own = tracks.filtered()
    assert np.linalg.det(own.covariance[0, :3, :3]) < 0.95 * np.linalg.det(before.covariance[0, :3, :3])
    # An attitude that is known to a hundredth of a degree reaches over nothing.
    bank.adopt(np.ones(1, dtype=np.bool_), held(1), coarse(0.01)[None])
    images.forget(np.ones(1, dtype=np.bool_))
    images.step(sweeps.take_in(*light(held(1), TRIPLE, rng), np.ones(1, dtype=np.bool_), tracks))
    assert not images.open.any()


def test_two_poses_of_a_search_get_a_filter_each_and_none_is_told_before_one_leads() -> None:
    """A plate at 3 m, 12 degrees from face-on: two poses fit; the share of rows decides after some periods."""
    craft, rng = 6, np.random.default_rng(3)
    facing = rot.exp(np.radians(12.0) * np.array([0.6, 0.8, 0.0])) @ rot.exp(np.array([0.0, np.pi, 0.0]))
    state = held(craft, facing)
    small = 0.4 * PLATE
    layout = pad([small] * craft, [np.tile([0.0, 0.0, 1.0], (len(small), 1))] * craft)
    ways = {way: Navigator(layout, replace(SETTINGS, coupling=way)) for way in ("loose", "auto")}
    first = {way: np.full(craft, 240) for way in ways}
    none, lit = np.zeros(craft, dtype=np.int64), np.ones((craft, len(small)), dtype=np.bool_)
    for period in range(120):
        theta, offset = light(state, small, rng)
        for way, navigator in ways.items():
            known = navigator.step(SweepAngles(theta, offset, lit, none, none, none))
            told = np.isfinite(known.position[:, 0])
            assert (known.status[~told] == Status.AMBIGUOUS).all()
            assert (rot.angle_between(known.rotation[told], facing) < np.radians(8.0)).all()
            first[way][told] = np.minimum(first[way][told], period)
        if not (known.status == Status.AMBIGUOUS).any():
            break
    assert first["auto"].max() < 120
    assert first["auto"].mean() < first["loose"].mean()


def mixture(rng: np.random.Generator, window: int, probability: list[float]) -> Mixtures:
    root = rng.standard_normal((LANES, STATES, STATES))
    mean = 0.1 * rng.standard_normal((STATES, LANES))
    mean -= (mean @ np.array(probability))[:, None]
    return Mixtures(
        window=np.array([window]),
        models=np.array([6]),
        probability=np.array([probability]),
        mean=mean[None],
        covariance=np.moveaxis(root @ np.swapaxes(root, 1, 2), 0, -1)[None][:, *np.tril_indices(STATES)].copy(),
        told=np.ones(1, dtype=np.bool_),
        since_s=np.zeros(1),
        mixed=np.zeros((1, LANES, LANES)),
        moved=np.zeros((1, LANES, LANES)),
        mingled=np.zeros(1, dtype=np.bool_),
    )


NOISES = np.geomspace(0.2, 5e-5, 6)
GRID = Grid(NOISES, NOISES, 0.5, 1 / 30)


def test_mixing_moves_probabilities_to_the_next_models_only_and_keeps_what_is_known() -> None:
    one = mixture(np.random.default_rng(4), 1, [0.0, 0.6, 0.4, 0.0])  # lanes 1 to 3 and 0 are models 1 to 4
    before, after = np.empty((2, 1, STATES, COLUMNS, LANES))
    combine(0, one, before)
    _mix(0, 0.1, GRID, one)
    combine(0, one, after)
    np.testing.assert_allclose(after, before, atol=1e-12)
    livelier, quieter = 0.1 / 30, 0.05
    expected = [
        0.0,
        0.6 * (1 - quieter) + 0.4 * livelier,
        0.4 * (1 - livelier - quieter) + 0.6 * quieter,
        0.4 * quieter,
    ]
    np.testing.assert_allclose(one.probability[0], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("window", "best", "then"),
    [(1, 1, 0), (1, 4, 2), (1, 2, 1), (0, 0, 0), (2, 5, 2)],
    ids=["livelier", "quieter", "inside", "liveliest", "quietest"],
)
def test_a_window_moves_by_one_model_where_the_likeliest_is_at_its_end(window: int, best: int, then: int) -> None:
    probability = np.full(LANES, 0.1)
    probability[best % LANES] = 0.7
    one = mixture(np.random.default_rng(5), window, probability.tolist())
    old = one.covariance.copy()
    _move_window.py_func(0, one)  # type: ignore[attr-defined]
    assert one.window[0] == then
    assert one.probability.sum() == pytest.approx(1.0)
    assert one.probability[0, best % LANES] == one.probability.max()
    changed = [at for at in range(LANES) if not np.array_equal(one.covariance[0, :, at], old[0, :, at])]
    if then == window:
        assert not changed
        return
    # The newcomer is a copy of the likeliest, hardly probable, in the lane of the one given up.
    newcomer = then if then < window else then + LANES - 1
    assert changed == [newcomer % LANES]
    np.testing.assert_array_equal(one.covariance[0, :, newcomer % LANES], old[0, :, best % LANES])
    assert one.probability[0, newcomer % LANES] < 1e-5


def test_the_error_between_two_states_moves_one_to_the_other() -> None:
    """In the coordinates of a turn about a line, and of one about a point."""
    rng = np.random.default_rng(3)
    for line in (0.0, 0.1):
        pivot = np.concatenate([0.05 * rng.standard_normal(3), line * rng.standard_normal(3), np.zeros(3)])
        here, x = held(1).of(0), rng.standard_normal(STATES) * np.repeat([0.15, 0.1, 0.1, 0.05], 3)
        there, _ = _moved(here, x, pivot)
        np.testing.assert_allclose(_away(there, here, pivot), x, atol=1e-8)


def test_a_filter_of_two_photodiodes_is_parted_in_the_middle_of_its_tilt() -> None:
    """Only where the tilt is coarse; both halves together are what it was, and neither alone."""
    points = TRIPLE[:2]
    rng, craft = np.random.default_rng(4), 2
    covariance = np.stack([coarse(1.0), coarse(8.0)])
    covariance[:, [6, 7, 8], [6, 7, 8]] = 0.3**2  # else the distance tells the tilt
    bank, other = CompiledFilterBank(craft), CompiledFilterBank(craft)
    state, every_craft = held(craft), np.ones(craft, dtype=np.bool_)
    bank.adopt(every_craft, state, covariance)
    tracks = Tracks(bank, T, TrackLimits(2.0, 6), None)
    sweeps = SingleSweeps(np.tile(points, (craft, 1, 1)), SETTINGS)
    images = MirrorImages(other, tracks, sweeps)
    taken = sweeps.take_in(*light(state, points, rng), every_craft, tracks)
    before = bank.state, bank.covariance
    images.step(taken)
    np.testing.assert_array_equal(images.open, [False, True])
    np.testing.assert_array_equal(bank.covariance[0], before[1][0])
    pivot = sweeps.centre(1, taken.batch.of(1, taken.kept)) if taken.batch is not None else np.zeros(PIVOT)
    axis = np.cross(before[0].rotation[1] @ pivot[3:6], before[0].position[1] + before[0].rotation[1] @ pivot[:3])
    axis /= np.linalg.norm(axis)
    sigma = np.sqrt(axis @ before[1][1, :3, :3] @ axis)
    own, image = (axis @ rot.log(one.rotation[1] @ before[0].rotation[1].T) for one in (bank, other))
    # Halves of a normal distribution: mean sqrt(2 / pi), variance 1 - 2 / pi.
    np.testing.assert_allclose(sorted([own / sigma, image / sigma]), np.sqrt(2 / np.pi) * np.array([-1, 1]), rtol=0.02)
    np.testing.assert_allclose(axis @ bank.covariance[1, :3, :3] @ axis / sigma**2, 1 - 2 / np.pi, rtol=0.05)
    told = images.reported(tracks.filtered())
    away = _away(told.state.of(1), before[0].of(1), pivot)
    assert np.abs(away[:3]).max() < 0.02 * sigma
    np.testing.assert_allclose(told.covariance[1], before[1][1], atol=0.03 * np.abs(before[1][1]).max())
