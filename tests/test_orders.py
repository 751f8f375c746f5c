"""Orders: the filter moves by them as physics moves the craft."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimators import rotation as rot
from estimators.filter.error_state import STATES
from estimators.state import State
from swarm.flight import builders
from swarm.flight.builders.dynamics import fitted
from swarm.hardware import actuator_set
from swarm.messages import Command
from swarm.onboard.actuation.actuation import Actuation
from swarm.onboard.filters import tracks_of
from swarm.onboard.settings import NavigationSettings
from swarm.scenario import validate


@pytest.mark.parametrize("steps", [2, 4, 12])
def test_a_filter_that_knows_its_orders_follows_them_to_rounding(steps: int) -> None:
    """A physics step moves the craft at the velocity of its end; a filter that does not know drifts by millimetres."""
    craft = [{"motion": {"kind": "hold", "position_m": [0.0, 0.0, 3.0]}}]
    data = {"name": "orders", "craft": craft, "physics": {"steps_per_period": steps}}
    scenario = validate(data, file="orders", folder=Path())
    world = builders.world(scenario, builders.fleet(scenario))
    settings = replace(builders.navigation(scenario, world.steps), quiet=None, filter="compiled", coast_limit_s=1e3)
    informed, naive = (tracks_of(1, s, None) for s in (settings, replace(settings, order_lead_s=0.0)))
    rng, both = np.random.default_rng(steps), (informed, naive)
    for number in range(30):
        order = Command(rng.normal(0.0, 0.5, (1, 3)), np.zeros((1, 3)))
        force, torque = world.inertial_wrench(order.acceleration, order.angular_acceleration)
        truth = world.advance(force, torque)
        state, step = truth.state(truth.epoch), settings.frame_s / steps
        for tracks in both:
            if number == 0:
                tracks._command = order
                ahead = state._replace(velocity=state.velocity + order.acceleration * step / 2)
                tracks.bank.adopt(np.ones(1, dtype=np.bool_), ahead, np.eye(STATES)[None])
            else:
                tracks.predict(order)
    off = [float(np.linalg.norm(tracks.bank.position - state.position)) for tracks in both]
    assert off[0] < 1e-12
    assert off[1] > 1e4 * off[0]
    np.testing.assert_allclose(rot.log(informed.bank.rotation[0] @ state.rotation[0].T), 0.0, atol=1e-12)


def test_a_craft_that_orders_no_torque_is_known_to_turn_freely() -> None:
    """A box that has lost its control tumbles by Euler's equation; any torque ordered ends that."""
    craft = [{"feedback": "estimate", "motion": {"kind": "hold", "position_m": [0.0, 0.0, 3.0]}}]
    scenario = validate({"name": "lost", "craft": craft}, file="lost", folder=Path())
    world = builders.world(scenario, builders.fleet(scenario))
    settings = replace(builders.navigation(scenario, world.steps), quiet=None, filter="compiled", coast_limit_s=1e3)
    actuators = actuator_set(fitted(scenario, world), world.com_m)
    actuation = Actuation(actuators, world.mass, world.inertia, settings.frame_s)
    informed, naive = (tracks_of(1, settings, None) for _ in range(2))
    still, rate = np.zeros((1, 3)), np.array([[0.6, 0.5, 0.3]])
    kick = world.inertial_wrench(still, rate / settings.frame_s)
    for number in range(30):
        truth = world.advance(*(kick if number == 0 else (still, still)))
        state = truth.state(truth.epoch)
        order = actuation.order(still, still, state, Command(still, still)).command
        assert order.inertia is not None
        np.testing.assert_array_equal(order.inertia, world.inertia)
        for tracks, told in ((informed, order), (naive, order.only(np.zeros(1, dtype=np.bool_)))):
            if number == 1:
                tracks._command = told
                tracks.bank.adopt(np.ones(1, dtype=np.bool_), state, np.eye(STATES)[None])
            elif number:
                tracks.predict(told)
    away = [np.linalg.norm(rot.log(tracks.bank.rotation[0] @ state.rotation[0].T)) for tracks in (informed, naive)]
    assert away[0] < 1e-4, "what is left are the steps of the physics"
    assert away[1] > 1e-2
    torque = np.array([[0.0, 1e-9, 0.0]])
    assert actuation.order(still, torque, state, Command(still, still)).command.inertia is None


@pytest.mark.parametrize("lead_s", [0.0, 1e-3])
def test_the_motion_ordered_between_two_epochs_is_that_of_two_halves(lead_s: float) -> None:
    """By the last command until half the period, and by this one after that, which begins earlier by the lead."""
    craft, rng = 3, np.random.default_rng(1)
    settings = NavigationSettings(
        frame_s=1 / 60, angle_noise_rad=4e-5, rotor_correlation=0.9, filter="compiled", order_lead_s=lead_s
    )
    tracks, half = tracks_of(craft, settings, None), 1 / 120
    last, order = (Command(*rng.standard_normal((2, craft, 3))) for _ in range(2))
    begun = State(np.tile(np.eye(3), (craft, 1, 1)), *np.zeros((3, craft, 3)))
    tracks.bank.adopt(np.ones(craft, dtype=np.bool_), begun, np.tile(np.eye(STATES), (craft, 1, 1)))
    tracks._command = last
    tracks.predict(order)
    for a, b, way, rate in (
        (last.acceleration, order.acceleration, tracks.bank.position, tracks.bank.velocity),
        (
            last.angular_acceleration,
            order.angular_acceleration,
            rot.log(tracks.bank.rotation),
            tracks.bank.angular_rate,
        ),
    ):
        np.testing.assert_allclose(rate, (a + b) * half + (b - a) * lead_s, rtol=1e-12)
        np.testing.assert_allclose(way, a * half**2 * 1.5 + b * half**2 / 2 + (b - a) * lead_s * half, rtol=1e-9)


def test_a_command_of_nobody_orders_nothing_and_tells_nobody_turns_freely() -> None:
    rng = np.random.default_rng(2)
    linear, angular = rng.standard_normal((2, 4, 3))
    whole = Command(linear, angular, np.tile(np.eye(3), (4, 1, 1)))
    nobody, some = np.zeros(4, dtype=np.bool_), np.array([True, False, True, False])
    none, part = whole.only(nobody), whole.only(some)
    assert not none.acceleration.any()
    assert not none.angular_acceleration.any()
    assert none.inertia is None
    np.testing.assert_array_equal(part.acceleration, np.where(some[:, None], whole.acceleration, 0.0))
    assert part.inertia is not None
    np.testing.assert_array_equal(np.isfinite(part.inertia[:, 0, 0]), some)
    assert whole.only(~nobody) is whole
