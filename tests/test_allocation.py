"""Bounded least squares against SciPy's, and against what it means for a craft."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from swarm.onboard.actuation.allocation import ROUNDS_PER_ACTUATOR, allocate


def problems(count, thrusters=12, wheels=3, seed=0, reach=2.0):
    """Random actuators, costs as different as the orders use, and wrenches that are within their reach or far out."""
    rng = np.random.default_rng(seed)
    n = thrusters + wheels
    effect, scale = rng.normal(size=(count, 6, n)), rng.uniform(0.5, 2, (count, 6))
    cost = np.tile(np.repeat([1e-7, 1e-10], [thrusters, wheels]), (count, 1))
    low = np.tile(np.repeat([0.0, -1.0], [thrusters, wheels]), (count, 1))
    wanted = rng.uniform(-0.1, 0.1, (count, n)) * (np.arange(n) >= thrusters)
    return effect, scale, cost, wanted, low, np.ones((count, n)), reach * rng.normal(size=(count, 6))


def stacked(effect, scale, cost, wanted, wrench):
    """The same as one ordinary least squares problem A x = b."""
    root = np.sqrt(cost)
    return np.vstack([scale[:, None] * effect, np.diag(root)]), np.concatenate([scale * wrench, root * wanted])


@pytest.mark.parametrize("reach", [0.01, 2.0, 30.0])
def test_as_scipy_solves_it(reach):
    effect, scale, cost, wanted, low, high, wrench = problems(60, reach=reach)
    found, rounds = allocate(effect, scale, cost, wanted, low, high, wrench)
    assert rounds.max() < ROUNDS_PER_ACTUATOR * found.shape[1]
    for c in range(len(found)):
        a, b = stacked(effect[c], scale[c], cost[c], wanted[c], wrench[c])
        peer = lsq_linear(a, b, (low[c], high[c]), method="bvls", tol=1e-15, max_iter=1000).x
        # Normal equations square the condition, 1e7 between the wrench's rows and the smallest cost's.
        assert found[c] == pytest.approx(peer, abs=1e-6)
        assert np.sum((a @ found[c] - b) ** 2) <= np.sum((a @ peer - b) ** 2) * (1 + 1e-9) + 1e-18


def test_nothing_between_bounds_pulls_and_nothing_at_a_bound_would_gain():
    """The conditions of Karush, Kuhn and Tucker, sufficient because the problem is convex."""
    effect, scale, cost, wanted, low, high, wrench = problems(300, seed=1)
    found, _ = allocate(effect, scale, cost, wanted, low, high, wrench)
    assert np.all((found >= low) & (found <= high))
    for c in range(len(found)):
        a, b = stacked(effect[c], scale[c], cost[c], wanted[c], wrench[c])
        slope, size = a.T @ (a @ found[c] - b), np.abs(a.T) @ np.abs(b)
        at_low, at_high = found[c] == low[c], found[c] == high[c]
        rounding = 1e-11 * size.max()
        assert np.all(np.abs(slope[~at_low & ~at_high]) < rounding)
        assert np.all(slope[at_low] > -rounding)
        assert np.all(slope[at_high] < rounding)


def test_what_stands_between_equal_bounds_stays_there():
    effect, scale, cost, wanted, low, high, wrench = problems(40, seed=2)
    pinned = np.random.default_rng(3).uniform(0, 1, (40, 12))
    low[:, :12] = high[:, :12] = pinned
    found, _ = allocate(effect, scale, cost, wanted, low, high, wrench)
    assert np.array_equal(found[:, :12], pinned)
    for c in range(40):
        rest = scale[c] * (wrench[c] - effect[c, :, :12] @ pinned[c])
        free = effect[c, :, 12:] * scale[c][:, None]
        peer = lsq_linear(free, rest, (-1, 1), method="bvls").x
        assert found[c, 12:] == pytest.approx(peer, abs=1e-8)


def test_no_wrench_asks_for_nothing_and_no_actuator_gives_none():
    effect, scale, cost, wanted, low, high, wrench = problems(5)
    found, _ = allocate(effect, scale, cost, 0 * wanted, low, high, 0 * wrench)
    assert np.array_equal(found, np.zeros_like(found))
    none = [part[:, :0] for part in (cost, wanted, low, high)]
    assert allocate(effect[..., :0], scale, none[0], none[1], none[2], none[3], wrench)[0].shape == (5, 0)


def test_a_craft_gets_the_same_alone():
    arguments = problems(7, seed=4)
    together, _ = allocate(*arguments)
    for c in range(7):
        alone, _ = allocate(*(part[c : c + 1] for part in arguments))
        assert np.array_equal(alone[0], together[c])


def test_bad_arguments_are_named():
    effect, scale, cost, wanted, low, high, wrench = problems(2)
    with pytest.raises(ValueError, match="expected shapes"):
        allocate(effect, scale[:1], cost, wanted, low, high, wrench)
    with pytest.raises(ValueError, match="cost must be positive"):
        allocate(effect, scale, 0 * cost, wanted, low, high, wrench)
    with pytest.raises(ValueError, match="low bound"):
        allocate(effect, scale, cost, wanted, high, low, wrench)
