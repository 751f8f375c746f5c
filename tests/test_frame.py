"""A station that stands anywhere in the world: light, pulses and poses are those of one at the origin, moved along."""

import numpy as np
import pytest

import swarm
from estimators import rotation as rot
from estimators.frame import WORLD, Frame
from estimators.state import State
from swarm import random
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.onboard.navigation import Navigator
from swarm.sensors.lighthouse import Lighthouse
from swarm.sensors.sight import Sight
from swarm.sensors.visibility import Visibility
from swarm.world.world import PeriodTruth

FRAME = Frame(rot.exp(np.array([0.4, -0.7, 0.3])), np.array([2.0, -1.0, 0.5]))


def test_the_world_changes_nothing_and_a_frame_is_left_as_it_was_entered():
    rng = np.random.default_rng(0)
    rotation, position = rot.exp(rng.normal(size=(5, 3))), rng.normal(size=(5, 3))
    quaternion = rot.quaternion_from_matrix(rotation)
    assert WORLD.poses_into(position, quaternion) == (position, quaternion)
    place, turn = FRAME.poses_into(position, quaternion)
    back = FRAME.pose_out(rot.matrix_from_quaternion(turn), place)
    np.testing.assert_allclose(back[0], rotation, atol=1e-14)
    np.testing.assert_allclose(back[1], position, atol=1e-14)
    state = FRAME.state_into(State(rotation=rotation, position=position, velocity=position, angular_rate=position))
    np.testing.assert_allclose(state.position, place, atol=1e-14)
    np.testing.assert_allclose(state.rotation, rot.matrix_from_quaternion(turn), atol=1e-14)
    np.testing.assert_allclose(FRAME.rotation @ state.velocity[0], position[0], atol=1e-14)


def moved(truth: PeriodTruth) -> PeriodTruth:
    """The same motion, with the station's frame where FRAME is."""
    turn = rot.quaternion_from_matrix(FRAME.rotation)
    return truth._replace(
        position=truth.position @ FRAME.rotation.T + FRAME.position,
        quaternion=rot.quaternion_multiply(np.broadcast_to(turn, truth.quaternion.shape), truth.quaternion),
    )


@pytest.fixture(scope="module")
def flight():
    return Flight(swarm.load("formation", ["duration_s=1"]))


def test_a_station_elsewhere_sees_and_is_seen_as_one_at_the_origin(flight):
    scenario, world = swarm.load("formation", ["duration_s=1"]), flight.world
    layout = builders.photodiodes(scenario, world)
    body = world.craft_bodies, world.lighthouse_body, scenario.lighthouse
    sight = Visibility(world.model, layout, *body), Visibility(world.model, layout, *body, FRAME)
    keys = random.keys(scenario.craft_names)
    here = Lighthouse(layout, scenario.lighthouse, 1, keys)
    there = Lighthouse(layout, scenario.lighthouse, 1, keys, FRAME)
    settings = builders.navigation(scenario)
    own = builders.own_layout(scenario, world)
    decoders = builders.decoder(scenario, layout.present), builders.decoder(scenario, layout.present)
    elsewhere = Navigator(own, settings.__class__(**{**vars(settings), "station": FRAME}))
    navigators = Navigator(own, settings), elsewhere
    for frame in range(20):
        truth, seen = flight.move(frame)
        turned = moved(truth)
        knot = truth.epoch
        one = sight[0].state(truth.position[knot], truth.quaternion[knot])
        np.testing.assert_array_equal(sight[1].state(turned.position[knot], turned.quaternion[knot]), one)
        lit = seen == Sight.LIT
        pulses = here.sweep(truth, frame, lit), there.sweep(turned, frame, lit)
        # Rounding of the poses moves a pulse by a tick now and then, not more.
        assert np.abs(pulses[0].rise_tick - pulses[1].rise_tick).max() <= 1
        # The same light into both computers: their poses differ by the station's frame alone.
        a, b = (n.step(d.decode(pulses[0])) for n, d in zip(navigators, decoders, strict=True))
    rotation, position = FRAME.pose_out(a.rotation, a.position)
    assert np.isfinite(a.position).all()
    np.testing.assert_allclose(b.position, position, atol=1e-9)
    np.testing.assert_allclose(b.rotation, rotation, atol=1e-9)
    np.testing.assert_allclose(b.pnp.position, FRAME.pose_out(a.pnp.rotation, a.pnp.position)[1], atol=1e-9)
    np.testing.assert_allclose(b.integrity.position_m, a.integrity.position_m, rtol=1e-5)
    np.testing.assert_allclose(b.velocity, a.velocity @ FRAME.rotation.T, atol=1e-7)
    spread = np.einsum("ij,cjk,lk->cil", FRAME.rotation, a.covariance[:, 6:9, 6:9], FRAME.rotation)
    np.testing.assert_allclose(b.covariance[:, 6:9, 6:9], spread, rtol=1e-5, atol=1e-15)
