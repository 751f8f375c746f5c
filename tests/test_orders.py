"""Orders: the filter moves by them as physics moves the craft."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimators import rotation as rot
from estimators.filter.error_state import STATES
from swarm.flight import builders
from swarm.messages import Command
from swarm.onboard.filters import tracks_of
from swarm.scenario import validate


@pytest.mark.parametrize("steps", [4, 12])
def test_a_filter_that_knows_its_orders_follows_them_to_rounding(steps: int) -> None:
    """A physics step moves the craft at the velocity of its end; a filter that does not know drifts by millimetres."""
    craft = [{"motion": {"kind": "hold", "position_m": [0.0, 0.0, 3.0]}}]
    data = {"name": "orders", "craft": craft, "physics": {"steps_per_period": steps}}
    scenario = validate(data, file="orders", folder=Path())
    world = builders.world(scenario, builders.fleet(scenario))
    settings = replace(builders.navigation(scenario), quiet=None, filter="compiled", coast_limit_s=1e3)
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
