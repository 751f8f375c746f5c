"""Keeping clear: the least change against SciPy's SLSQP, and craft that fly straight at each other."""

import numpy as np
import pytest
from scipy.optimize import minimize

from swarm.onboard.guidance.avoidance import Barrier, barriers, nearest, safe
from swarm.onboard.guidance.broadcast import Broadcasts

T = 1 / 60


def test_least_change_is_that_of_a_general_solver():
    rng = np.random.default_rng(1)
    for count in (1, 2, 3, 5):
        for _ in range(10):
            g, inside = rng.normal(size=(count, 3)), rng.normal(size=3)
            h = g @ inside - rng.uniform(0, 1, count)
            found = nearest(g, h)
            other = minimize(
                lambda x: x @ x,
                inside,
                jac=lambda x: 2 * x,
                constraints={"type": "ineq", "fun": lambda x, g=g, h=h: g @ x - h, "jac": lambda x, g=g: g},
                method="SLSQP",
                options={"ftol": 1e-14},
            )
            assert found is not None
            assert np.all(g @ found >= h - 1e-9)
            assert found @ found == pytest.approx(other.fun, abs=1e-6)


def test_conditions_that_exclude_each_other_have_no_least_change():
    assert nearest(np.array([[1.0, 0, 0], [-1.0, 0, 0]]), np.array([0.1, 0.1])) is None


def test_who_is_far_off_changes_nothing_and_who_cannot_meet_all_pushes_away():
    wanted = np.array([[0.01, 0.0, 0.0], [0.0, 0.02, 0.0]])
    loose = Barrier(np.array([0, 1]), np.array([[1.0, 0, 0], [0, 1.0, 0]]), np.array([0.011, 0.03]))
    same, gave_way = safe(wanted, loose, np.full(2, 0.05))
    assert np.array_equal(same, wanted)
    assert not gave_way.any()
    squeezed = Barrier(np.array([0, 0]), np.array([[1.0, 0, 0], [-1.0, 0, 0]]), np.array([-0.02, -0.01]))
    pushed, gave_way = safe(wanted, squeezed, np.full(2, 0.05))
    assert gave_way.tolist() == [True, False]
    # It presses harder from the right: 0.03 beyond its limit against none at all from the left, which it meets.
    assert pushed[0, 0] < 0
    assert np.linalg.norm(pushed[0]) <= 0.05 + 1e-12


def test_nobody_is_kept_from_itself_or_from_the_unheard():
    air = Broadcasts(3, T)
    place = np.array([[0.0, 0, 3], [0.3, 0, 3], [np.nan] * 3])
    for _ in range(2):
        air.tell(place, np.zeros((3, 3)), 0.0)
    conditions = barriers(np.array([0]), place[:1], np.zeros((1, 3)), air.heard(), np.array([0.2]), np.array([0.05]))
    assert conditions.craft.tolist() == [0]
    assert np.allclose(conditions.normal, [[1, 0, 0]])


def swap(count, noise_m=0.0, noise_m_s=0.0, seconds=60.0, seed=0):
    """Craft on a circle of 1.5 m fly to the opposite side, each by PD control, all at once; the least distance met."""
    distance, brake = 0.3, 0.05
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * np.arange(count) / count
    # Out of plane by centimetres: exactly head-on, a rule that looks at the present only has no reason to turn.
    position = np.stack([1.5 * np.cos(angle), 1.5 * np.sin(angle), 0.03 * rng.normal(size=count)], axis=1)
    goal, velocity, air, who = -position, np.zeros((count, 3)), Broadcasts(count, T), np.arange(count)
    least = np.inf
    for _ in range(round(seconds / T)):
        p = position + noise_m * rng.normal(size=(count, 3))
        v = velocity + noise_m_s * rng.normal(size=(count, 3))
        air.tell(p, v, 0.0)
        way = goal - p
        wanted_v = 0.15 * way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 0.5)
        wanted = np.clip(0.5 * (wanted_v - v), -brake, brake)
        conditions = barriers(who, p, v, air.heard(), np.full(count, distance), np.full(count, brake))
        order, _ = safe(wanted, conditions, np.full(count, brake))
        position, velocity = position + velocity * T + order * T**2 / 2, velocity + order * T
        gaps = np.linalg.norm(position[:, None] - position[None], axis=2) + 9 * np.eye(count)
        least = min(least, gaps.min())
    return least, np.linalg.norm(position - goal, axis=1)


def test_two_that_fly_at_each_other_pass_clear_and_arrive():
    least, off = swap(2)
    # D = 0.3 m; broadcasts are a period old, and each period's order is held: millimetres at these speeds.
    assert least > 0.3 - 0.005
    assert off.max() < 0.1


def test_six_that_meet_in_one_point_keep_clear_whatever_the_noise_of_their_estimates():
    least, _ = swap(6, noise_m=0.001, noise_m_s=0.001, seconds=25.0)
    assert least > 0.3 - 0.01
