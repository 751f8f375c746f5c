"""Bounds on the errors of physics steps against 64 steps, and the number of steps that they choose."""

from typing import Any

import numpy as np
import pytest

from estimators import rotation as rot
from swarm import scenario
from swarm.assets import find_model
from swarm.flight.builders.steps import vigour
from swarm.flight.flight import Flight
from swarm.scenario import load
from swarm.world.step_error import CHOICES, DOCKING_S, Vigour, least_steps, step_errors
from swarm.world.world import CraftStart, World
from swarm.world.wrench import OnboardWrench

T, CRAFT, FINE = 1 / 60, 9, 64
MODELS = "mockup", "cubesat6u", "cubesat12u"


def craft_of(rng: np.random.Generator, rate_rad_s: float) -> list[CraftStart]:
    """Return craft in a row, each turning about an axis of its own at most so fast."""
    rate = rng.normal(size=(CRAFT, 3))
    rate *= rate_rad_s * rng.random((CRAFT, 1)) / np.linalg.norm(rate, axis=1, keepdims=True)
    return [
        CraftStart(
            f"c{i}",
            find_model(MODELS[i % len(MODELS)]),
            np.array([3.0 * i, 0.0, 5.0]),
            rng.normal(size=4),
            rng.normal(0, 0.3, 3),
            rate[i],
        )
        for i in range(CRAFT)
    ]


def shape_of(world: World) -> np.ndarray:
    out = np.zeros(CRAFT)
    for i, inertia in enumerate(world.inertia):
        a, b, c = np.linalg.eigvalsh(inertia)
        out[i] = max((c - b) / a, (c - a) / b, (b - a) / c)
    return out


def pushed(starts: list[CraftStart], steps: int, push: np.ndarray, twist: np.ndarray, wheels: np.ndarray) -> list[Any]:
    """Return the truth of 60 periods under a constant force, torque and momentum of the wheels."""
    world = World(starts, find_model("lighthouse"), steps_per_period=steps)
    least = np.linalg.eigvalsh(world.inertia)[:, :1]
    onboard = OnboardWrench(*np.zeros((3, steps, CRAFT, 3)))
    onboard.wheel_momentum[:] = wheels * least
    force, torque = world.mass[:, None] * push, twist * least
    return [world.advance(force, torque, onboard) for _ in range(60)]


@pytest.mark.parametrize(("rate_rad_s", "turning"), [(2.0, 0.0), (0.5, 1.0)])
def test_errors_stay_below_their_bounds_and_bounds_are_not_far_above(rate_rad_s: float, turning: float) -> None:
    rng = np.random.default_rng(round(10 * rate_rad_s + turning))
    starts = craft_of(rng, rate_rad_s)
    push, twist = rng.normal(0, 0.1, (CRAFT, 3)), rng.normal(size=(CRAFT, 3))
    twist *= turning * rng.random((CRAFT, 1)) / np.linalg.norm(twist, axis=1, keepdims=True)
    wheels = rng.normal(0, 0.2, (CRAFT, 3))
    exact = pushed(starts, FINE, push, twist, wheels)
    fastest = np.max([np.linalg.norm(truth.angular_rate, axis=2).max(axis=0) for truth in exact], axis=0)
    a, w, s = (np.linalg.norm(one, axis=1) for one in (push, twist, wheels))
    shape = shape_of(World(starts, find_model("lighthouse")))
    still = np.zeros(CRAFT)
    most = Vigour(still, a, fastest, w, shape, s, still, still)
    for steps in (2, 4, 8):
        # What is left of a first-order error against 64 steps.
        left = 1 - steps / FINE
        found, bound = pushed(starts, steps, push, twist, wheels), step_errors(most, T, steps)
        for k, place, turn in ((0, bound.period_m, bound.period_rad), (59, bound.second_m, bound.second_rad)):
            apart = np.linalg.norm(found[k].position[-1] - exact[k].position[-1], axis=1)
            one, other = (rot.matrix_from_quaternion(each[k].quaternion[-1]) for each in (found, exact))
            turned = rot.angle_between(one, other)
            assert np.allclose(apart, left * place, rtol=1e-3)
            # Terms of h^2 are not in the bound.
            assert (turned <= left * turn * (1 + 0.02 * (1 + rate_rad_s)) + 1e-9).all(), steps
            assert (turned / np.maximum(turn, 1e-12)).max() > 0.25


def test_the_least_number_is_chosen_whose_errors_are_small_enough() -> None:
    def of(acceleration: float = 0.0, rate: float = 0.0, speed: float = 0.0) -> Vigour:
        return Vigour(*(np.array([x]) for x in (speed, acceleration, rate, 0.0, 0.5, 0.0, 0.0, 0.0)))

    chosen = []
    for most in (of(), of(0.2), of(0.4), of(0.8), of(rate=1.0), of(rate=2.0), of(speed=1.0), of(acceleration=1e3)):
        steps = least_steps(most, T, docking=False)
        chosen.append(steps)
        assert step_errors(most, T, steps).over <= 1 or steps == CHOICES[-1]
        assert steps == 2 or step_errors(most, T, steps // 2).over > 1
    assert chosen[:4] == [2, 2, 4, 8]
    assert chosen[-1] == 64
    assert T / least_steps(of(), T, docking=True) <= DOCKING_S < T / 2


def test_half_steps_lie_on_the_motion_of_their_step() -> None:
    starts = craft_of(np.random.default_rng(3), 2.0)
    still = np.zeros((CRAFT, 3))
    two = World(starts, find_model("lighthouse"), steps_per_period=2).advance(still, still)
    assert two.time_s == pytest.approx(np.arange(5) * T / 4)
    rotation = rot.matrix_from_quaternion(two.quaternion)
    for k in range(4):
        # The rates at a knot are those of the interval that ends there, in the world.
        ahead = two.position[k] + two.velocity[k + 1] * T / 4
        assert np.allclose(ahead, two.position[k + 1], atol=1e-12)
        turn = rot.exp(two.angular_rate[k + 1] * T / 4) @ rotation[k]
        assert np.allclose(turn, rotation[k + 1], atol=1e-9)
    assert np.array_equal(two.velocity[1], two.velocity[2])
    six = World(starts, find_model("lighthouse"), steps_per_period=6).advance(still, still)
    assert len(six.time_s) == 13
    assert np.allclose(np.linalg.norm(six.quaternion, axis=2), 1, atol=1e-12)


def flown(*values: str) -> Flight:
    return Flight(load("free-flight", ["swarm.count=1", "duration_s=1", *values]))


def test_a_scenario_flies_in_the_steps_that_it_says_or_in_the_least() -> None:
    calm, told = flown(), flown("physics.steps_per_period=16")
    assert (calm.steps.number, calm.world.steps, calm.steps.chosen) == (2, 2, True)
    assert (told.steps.number, told.world.steps, told.steps.chosen) == (16, 16, False)
    # Orders act half a step before their period begins.
    leads = [flight.computer.navigator.settings.order_lead_s for flight in (calm, told)]
    assert leads == pytest.approx([T / 4, T / 32])
    spun = flown("swarm.motion={kind='tumble', angular_rate_deg_s=[100, 20, 0]}")
    assert spun.steps.number > 8
    blown = flown("swarm.disturbance={acceleration_m_s2=0.2}")
    assert blown.steps.number == 8
    kicked = flown("fault=[{kind='craft-lost', at_s=0.5, angular_rate_deg_s=[0, 100, 30]}]")
    assert kicked.steps.number > 8
    assert "craft-0" in kicked.steps.sentence()


def test_too_few_steps_are_told_with_the_limit_and_the_craft_that_it_binds() -> None:
    fast, fastest = (f"swarm.motion={{kind='tumble', angular_rate_deg_s=[{rate}, 20, 0]}}" for rate in (100, 2000))
    chosen, told = flown(fast).steps, flown(fast, "physics.steps_per_period=2").steps
    assert (chosen.too_few, told.too_few) == (False, True)
    assert "for craft-0, nearest to the limit of 0.1 deg in a second" in chosen.sentence()
    assert "as the scenario says, too few for craft-0 and the limit of 0.1 deg in a second" in told.sentence()
    assert "64 physics steps in a period, the most there are, too few" in flown(fastest).steps.sentence()


@pytest.mark.parametrize("name", ["docking", "crossing"])
def test_motions_of_scenarios_stay_within_what_the_choice_rests_on(name: str) -> None:
    """Accelerations, rates and speeds in flight against the vigour that the bounds are made of."""
    settings = load(name, ["duration_s=2", "navigation.filter=compiled"])
    flight = Flight(settings)
    most = vigour(settings, flight.motions, scenario.craft(settings))
    before = flight.world._rate.copy()
    for frame in range(flight.periods):
        truth, _ = flight.move(frame)
        assert (np.linalg.norm(truth.velocity, axis=2).max(axis=0) <= 1.05 * most.speed + 0.02).all()
        assert (np.linalg.norm(truth.angular_rate, axis=2).max(axis=0) <= 1.05 * most.rate + 0.05).all()
        change = np.linalg.norm(flight.world._rate[:, :3] - before[:, :3], axis=1) / flight.period_s
        assert (change <= 1.05 * most.acceleration + most.shaking + 0.02).all()
        before = flight.world._rate.copy()
