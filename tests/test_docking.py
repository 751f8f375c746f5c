"""Docking: ports against SciPy's rotations, the glideslope against its closed form, the phases with a craft that flies
exactly as told."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimators import rotation as rot
from estimators.relative.pose import relative, seen_from
from estimators.state import State
from swarm.hardware import Closing, Port, closing, docked_pose, placed
from swarm.onboard.guidance.corridor import in_corridor
from swarm.onboard.guidance.docking import Docking
from swarm.onboard.guidance.gains import Gains
from swarm.onboard.guidance.glideslope import Glideslope, Moving, at_rest, brake, through, towards
from swarm.onboard.guidance.guidance import Clearance, Guidance, Knowledge
from swarm.onboard.guidance.neighbours import Neighbour, at_rest_in, carried
from swarm.onboard.guidance.phase import Phase
from swarm.scenario import Dock
from swarm.units import si

T = 1 / 60
SLOPE = Glideslope(slope_per_s=0.25, speed_m_s=0.2, acceleration_m_s2=0.02)
PLAN: dict[str, Any] = {
    "kind": "dock",
    "target": "berth",
    "from_m": (0.3, 0.0, 3.0),
    "hold_ranges_m": (1.0, 0.4),
    "hold_s": (1.0, 1.0),
    "glideslope_s": 4.0,
    "speed_m_s": 0.2,
    "acceleration_m_s2": 0.02,
    "closing_speed_m_s": 0.03,
    "corridor_radius_m": 0.05,
    "corridor_deg": 10.0,
    "corridor_attitude_deg": 5.0,
    "retreats": 2,
}


def a_port(seed, place=(0.1, -0.2, 0.3)):
    return Port(np.array(place), Rotation.random(rng=np.random.default_rng(seed)).as_matrix())


def test_mated_ports_meet_face_to_face():
    own, target = a_port(1), a_port(2, (1.0, 2.0, 3.0))
    rotation, position = docked_pose(own, target)
    there = placed(own, rotation, position)
    assert np.allclose(there.position, target.position, atol=1e-12)
    assert np.allclose(there.rotation[:, 2], -target.rotation[:, 2], atol=1e-12)
    assert np.allclose(there.rotation[:, 0], target.rotation[:, 0], atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
    at = closing(there, target, np.zeros(3))
    assert np.allclose([at.range_m, at.lateral_m], 0, atol=1e-12)
    # The chord of two unit vectors that are opposite but for rounding.
    assert at.angle_rad < 1e-15**0.5


@pytest.mark.parametrize("angle_rad", [1e-6, 0.01, 1.0, 3.0])
def test_offset_angle_and_speed_are_those_that_were_put_in(angle_rad):
    target = a_port(3, (0.5, 0.0, 2.0))
    across, up, out = target.rotation.T
    own_rotation = target.rotation @ np.diag([1.0, -1.0, -1.0])
    tilt = Rotation.from_rotvec(angle_rad * (0.6 * across + 0.8 * up)).as_matrix()
    own = Port(target.position + 0.7 * out + 0.03 * across - 0.04 * up, tilt @ own_rotation)
    at = closing(own, target, -0.05 * out + 0.5 * up)
    assert at.range_m == pytest.approx(0.7)
    assert at.lateral_m == pytest.approx(0.05)
    assert at.angle_rad == pytest.approx(angle_rad, rel=1e-8)
    assert at.speed_m_s == pytest.approx(0.05)


def test_corridor_is_a_blunt_cone():
    table = si(Dock(**PLAN | {"corridor_attitude_deg": 0.1 * 180 / np.pi}))

    def inside(rho, lateral, angle=0.0):
        return in_corridor(table, Closing(np.array(rho), np.array(lateral), np.array(angle), np.array(0.0)))

    assert inside(0.0, 0.0499)
    assert not inside(0.0, 0.0501)
    assert inside(2.0, 0.05 + 2 * np.tan(np.radians(10)) - 1e-9)
    assert not inside(2.0, 0.05 + 2 * np.tan(np.radians(10)) + 1e-9)
    assert inside(-0.01, 0.0499)
    assert not inside(1.0, 0.0, 0.11)


def test_glideslope_takes_the_time_of_its_closed_form():
    """From 0.3 m at a rho + v_e, well below speed and braking limits, to the port: t = ln(1 + a rho / v_e) / a (G1)."""
    end = 0.03
    point = at_rest(np.array([0.0, 0.0, 0.3]))._replace(velocity=np.array([0.0, 0.0, -(0.25 * 0.3 + end)]))
    gentle = Glideslope(0.25, 1.0, 1.0)
    steps = 0
    while point.position[2] > 0:
        point = through(point, np.zeros(3), np.array([0.0, 0.0, -end]), gentle, T)
        steps += 1
    assert -point.velocity[2] == pytest.approx(end, rel=0.01)
    # The speed lags by a period at most.
    assert steps * T == pytest.approx(np.log(1 + 0.25 * 0.3 / end) / 0.25, abs=2 * T)


def test_reference_arrives_at_rest_within_speed_and_acceleration():
    point, goal = at_rest(np.array([1.0, -2.0, 3.0])), np.array([0.0, 0.5, 1.0])
    fastest = hardest = 0.0
    for _ in range(round(60 / T)):
        before, point = point, towards(point, goal, SLOPE, T)
        fastest, hardest = (
            max(fastest, float(np.linalg.norm(point.velocity))),
            max(hardest, float(np.linalg.norm(point.acceleration))),
        )
        # Position and velocity are exactly those of the acceleration, held for a period.
        assert np.allclose(point.velocity, before.velocity + point.acceleration * T, atol=1e-15)
        moved = before.position + before.velocity * T + point.acceleration * T**2 / 2
        assert np.allclose(point.position, moved, atol=1e-15)
    assert np.linalg.norm(point.position - goal) < 1e-3
    assert np.linalg.norm(point.velocity) < 1e-3
    assert fastest <= 0.2 + 1e-12
    assert hardest <= 0.02 + 1e-12


def test_braking_takes_the_shortest_way_that_the_acceleration_allows():
    point = at_rest(np.zeros(3))._replace(velocity=np.array([0.12, 0.0, 0.16]))
    for _ in range(round(0.2 / 0.02 / T) + 1):
        point = brake(point, 0.02, T)
    assert np.allclose(point.velocity, 0, atol=1e-12)
    assert np.linalg.norm(point.position) == pytest.approx(0.2**2 / (2 * 0.02), rel=0.01)


TARGET = Port(np.array([0.0, 0.4, 0.5]), np.eye(3))
OWN = Port(np.array([0.0, 0.0, 0.3]), np.eye(3))
DOCKED = docked_pose(OWN, TARGET)[1]


class Craft:
    """Flies exactly as told, and believes the truth unless a test says otherwise."""

    def __init__(self, **changes):
        self.docking = Docking(0, OWN, TARGET, Dock(**PLAN | changes), T)
        self.time_s, self.position, self.velocity = 0.0, np.array([0.3, 0.0, 3.0]), np.zeros(3)
        self.phases = []

    @property
    def range_m(self):
        return self.position[2] - DOCKED[2]

    def fly(self, seconds, until=None, tracking=True, aside_m=0.0, latch=False, sigma_m=0.001):
        for _ in range(round(seconds / T)):
            aside = np.array([aside_m, 0.0, 0.0])
            here = Port(self.position + aside, TARGET.rotation @ np.diag([1.0, -1.0, -1.0]))
            at = closing(here, Port(DOCKED, TARGET.rotation), self.velocity)
            latched = latch and self.range_m <= 0
            known = self.position + aside if tracking else self.position
            moving = self.docking.step(self.time_s, known, self.velocity, at, tracking, sigma_m, latched)
            self.time_s += T
            self.position = moving.position + moving.velocity * T + moving.acceleration * T**2 / 2
            self.velocity = moving.velocity + moving.acceleration * T
            if not self.phases or self.phases[-1] != self.docking.phase:
                self.phases.append(self.docking.phase)
            if self.docking.phase == until:
                return self
        assert until is None, f"never came to {until!r}: {self.phases}"
        return self


def test_an_undisturbed_approach_goes_through_its_phases_to_the_latch():
    craft = Craft().fly(200, until=Phase.DOCKED, latch=True)
    hold = Phase.HOLD
    assert craft.phases == [
        Phase.WAIT, Phase.TRANSFER, hold, Phase.APPROACH, hold, Phase.FINAL, Phase.DOCKED
    ]  # fmt: skip
    assert -craft.velocity[2] == pytest.approx(0.03, rel=0.05)
    assert np.hypot(*(craft.position - DOCKED)[:2]) < 1e-3


def test_it_does_not_leave_before_its_time_nor_without_good_navigation():
    craft = Craft(start_s=5.0).fly(4.9)
    assert craft.phases == [Phase.WAIT]
    craft = Craft().fly(10, sigma_m=0.06)
    assert craft.phases == [Phase.WAIT]
    # Good for settle_s, and off it goes.
    assert craft.fly(1.1, until=Phase.TRANSFER)


def test_out_of_the_corridor_it_retreats_to_the_hold_point_and_tries_again():
    craft = Craft().fly(200, until=Phase.APPROACH).fly(3.0)
    craft.fly(1.0, aside_m=0.3, until=Phase.RETREAT)
    craft.fly(200, until=Phase.HOLD)
    assert craft.range_m == pytest.approx(1.0, abs=0.02)
    craft.fly(200, until=Phase.DOCKED, latch=True)


def test_it_gives_up_after_its_retreats_and_stays_at_the_first_hold_point():
    craft = Craft()
    for _ in range(2):
        craft.fly(200, until=Phase.FINAL).fly(1.0, aside_m=0.3, until=Phase.RETREAT)
    craft.fly(200, until=Phase.FINAL).fly(1.0, aside_m=0.3, until=Phase.ABORTED)
    craft.fly(60)
    assert craft.phases[-1] == Phase.ABORTED
    assert craft.range_m == pytest.approx(1.0, abs=0.02)


def test_a_port_that_does_not_latch_is_a_retreat():
    craft = Craft().fly(200, until=Phase.RETREAT)
    assert craft.phases[-2] == Phase.FINAL
    # It has felt for the port 20 mm beyond where it should be, and no farther than it flies in two periods.
    assert craft.range_m == pytest.approx(-0.02, abs=2 * T * 0.03 + 1e-3)


@pytest.mark.parametrize("phase", [Phase.APPROACH, Phase.FINAL])
def test_in_the_dark_it_brakes_and_stays_and_comes_back_to_its_hold_point(phase):
    craft = Craft().fly(200, until=phase).fly(1.5)
    before = craft.range_m
    craft.fly(0.2, tracking=False)
    assert craft.docking.phase == phase, "a short gap is none"
    craft.fly(5.0, tracking=False)
    assert craft.docking.phase == Phase.LOST
    assert np.linalg.norm(craft.velocity) < 1e-9
    stopping = 0.2**2 / (2 * 0.05)
    assert before - stopping - 0.1 < craft.range_m < before
    stayed = craft.range_m
    craft.fly(3.0, tracking=False)
    assert craft.range_m == pytest.approx(stayed, abs=1e-9)
    craft.fly(1.2, until=Phase.RETREAT).fly(200, until=Phase.HOLD)
    hold = 1.0 if phase == Phase.APPROACH else 0.4
    assert craft.range_m == pytest.approx(hold, abs=0.02)
    craft.fly(200, until=Phase.DOCKED, latch=True)


def test_lost_at_a_hold_point_it_stays_and_goes_on_from_there():
    craft = Craft().fly(200, until=Phase.HOLD).fly(2.0, tracking=False)
    assert craft.docking.phase == Phase.LOST
    craft.fly(200, until=Phase.DOCKED, latch=True)


def client(time_s):
    """A craft that drifts and turns steadily."""
    rate = np.array([0.02, -0.05, 0.03])
    start = rot.exp(np.array([0.1, 0.6, 0.2]))
    velocity = np.array([0.02, -0.01, 0.015])
    return State(rot.exp(rate * time_s) @ start, np.array([-0.4, 0.1, 2.5]) + velocity * time_s, velocity, rate)


def test_a_point_in_the_axes_of_a_turning_craft_moves_in_the_world_as_differences_say():
    start, speed, push = np.array([0.2, -0.4, 0.9]), np.array([0.03, 0.01, -0.05]), np.array([0.01, -0.02, 0.005])

    def point(t):
        return Moving(start + speed * t + push * t**2 / 2, speed + push * t, push)

    h = 1e-3
    before, now, after = (carried(client(t), point(t)) for t in (2.0 - h, 2.0, 2.0 + h))
    assert now.velocity == pytest.approx((after.position - before.position) / (2 * h), abs=1e-7)
    assert now.acceleration == pytest.approx((after.velocity - before.velocity) / (2 * h), abs=1e-7)
    resting = carried(client(2.0), at_rest_in(client(2.0), (0.5, 0.6, 3.0)))
    assert resting.position == pytest.approx([0.5, 0.6, 3.0])
    assert resting.velocity == pytest.approx([0, 0, 0], abs=1e-12)


def test_a_craft_is_seen_where_its_relative_state_has_it():
    a, b = client(0.3), client(4.0)._replace(velocity=np.array([0.1, 0.2, -0.3]))
    back = seen_from(a, State._make(relative(a, b)[:4]))
    for got, want in zip(back, b, strict=True):
        assert got == pytest.approx(want, abs=1e-12)


SHORT: dict[str, Any] = {
    "from_m": (0.15, 0.15, 3.3),
    "hold_ranges_m": (0.2,),
    "hold_s": (2.0,),
    "glideslope_s": 1.0,
    "settle_s": 0.1,
}


def flown_to_client(seconds, *, heard=lambda time_s: True):
    """A craft that flies exactly as told to a port of `client`: its phases, and its last pose in the port's frame."""
    target = Port(np.array([0.0, 0.05, 0.3]), rot.exp(np.array([0.0, 0.3, 0.0])))
    docking = Docking(0, OWN, target, Dock(**PLAN | SHORT), T, rides=1)
    nobody = Clearance(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))
    guidance = Guidance(T, [Gains(1.0, 1.0), None], [docking], [], nobody, np.zeros(2, dtype=np.bool_))
    own = State(np.eye(3), np.array(SHORT["from_m"]), np.zeros(3), np.zeros(3))
    phases, known_as, speeds = [], client(0.0), []
    for n in range(round(seconds / T)):
        there = client(n * T)
        # Who is not heard is carried on at constant rates: `client` moves so.
        known_as = there if heard(n * T) else known_as.ahead(T)
        both = State._make(np.stack(part) for part in zip(own, there, strict=True))
        knows = Knowledge(
            np.array([True, False]),
            np.zeros(2),
            np.array([False, False]),
            {(0, 1): Neighbour(known_as, 0.001, heard(n * T))},
        )
        asked = guidance.steer(n * T, both, knows)
        moving = Moving(*(part[0] for part in asked.motion))
        assert asked.turning is not None
        turn, rate = asked.turning.rotation[0], asked.turning.angular_rate[0]
        own = State(
            rot.exp(rate * T) @ turn,
            moving.position + moving.velocity * T + moving.acceleration * T**2 / 2,
            moving.velocity + moving.acceleration * T,
            rate,
        )
        phases.append(docking.phase)
        port = placed(target, there.rotation, there.position)
        mine = placed(OWN, turn, moving.position)
        at = closing(mine, port, np.zeros(3))
        speeds.append((float(at.range_m), float(at.lateral_m), float(at.angle_rad)))
        if at.range_m < 0:
            break
    return phases, speeds


def test_a_port_that_moves_and_turns_is_met_in_its_own_axes():
    phases, way = flown_to_client(40.0)
    assert list(dict.fromkeys(phases)) == [Phase.WAIT, Phase.TRANSFER, Phase.HOLD, Phase.FINAL]
    ranges, lateral, angle = np.array(way).T
    assert ranges[-1] < 0
    assert lateral[-1] < 1e-3
    assert angle.max() < 1e-6
    assert (ranges[-2] - ranges[-1]) / T == pytest.approx(0.03, rel=0.05)


def test_a_craft_that_does_not_hear_its_target_is_lost_and_stays_beside_it():
    phases, way = flown_to_client(9.0, heard=lambda time_s: time_s < 2.0)
    assert phases[-1] == Phase.LOST
    ranges = np.array(way)[:, 0]
    # At rest in the axes of the target as it was last known, which moves on so.
    assert ranges[-120:] == pytest.approx(ranges[-1], abs=1e-4)
