"""Thrusters and wheels: what is ordered, what MuJoCo makes of it, and the errors and faults in between."""

from typing import Any, NamedTuple

import numpy as np
import pytest

import swarm
from estimators import rotation as rot
from estimators.state import State
from swarm.assets import find_model
from swarm.errors import SwarmError
from swarm.hardware import Fitted, Wheels, actuator_set
from swarm.messages import Command
from swarm.onboard.actuation.actuation import Actuation
from swarm.onboard.actuation.modulation import on_time
from swarm.onboard.actuation.orders import UNLOAD_ABOVE
from swarm.scenario import validate
from swarm.world.actuators import Actuators
from swarm.world.craft import load_craft
from swarm.world.execution import StuckThruster, executed, open_share
from swarm.world.world import CraftStart, World
from swarm.world.wrench import OnboardWrench

T, STEPS = 1 / 60, 8
CUBESAT = load_craft(find_model("cubesat12u"))
EXACT = (0.0, 0.0)
ATTITUDE = rot.exp(np.array([0.3, -0.5, 0.8]))


class Driven(NamedTuple):
    """What came of a wanted wrench, and the command that the craft's computers ordered."""

    force: np.ndarray
    torque: np.ndarray
    onboard: OnboardWrench
    command: Command


class Chain:
    """The craft's actuator computers and their actuators, one after the other."""

    def __init__(self, fitted, world, seed):
        actuators = actuator_set(fitted, world.com_m)
        self.computers = Actuation(actuators, world.mass, world.inertia, T)
        self.actuators = Actuators(fitted, actuators, world.mass, T, STEPS, seed)

    def drive(self, force, torque, believed, command, stuck=()):
        order = self.computers.order(force, torque, believed, command)
        drive = self.actuators.drive(order, stuck)
        assert drive.onboard is not None
        return Driven(drive.force, drive.torque, drive.onboard, order.command)

    def work(self):
        return self.actuators.work()

    @property
    def stored(self):
        return self.computers._orders.stored


def flight(fitted, rate=(0.0, 0.0, 0.0), seed=0):
    """A world of cubesats, turned and turning, and their actuators."""
    quaternion = rot.quaternion_from_matrix(ATTITUDE)
    starts = [
        CraftStart(
            f"c{i}", CUBESAT.path, np.array([3.0 * i, 0, 5]), quaternion, np.zeros(3), np.array(rate, dtype=float)
        )
        for i in range(len(fitted))
    ]
    world = World(starts, find_model("lighthouse"))
    return world, Chain(fitted, world, seed)


def cubesat(errors=EXACT, key=1, thrusters=True, wheels=True):
    t, w = CUBESAT.thrusters, CUBESAT.wheels
    return Fitted(t if thrusters else t.none(), w if wheels else w.none(), errors, key)


def state_of(truth):
    last = -1
    return truth.state(last)


def resting(count, rate=(0.0, 0.0, 0.0)):
    zero = np.zeros((count, 3))
    return State(
        rotation=np.tile(ATTITUDE, (count, 1, 1)), angular_rate=zero + np.array(rate), position=zero, velocity=zero
    )


def push(actuators, state, force, torque=(0.0, 0.0, 0.0), faults=(), mass=CUBESAT.mass):
    """Drive with force and torque given in the body frame; the command that goes with them is of no matter here."""
    count = len(state.position)
    into_l = [
        (state.rotation @ np.broadcast_to(np.array(v, dtype=float), (count, 3))[..., None])[..., 0]
        for v in (force, torque)
    ]
    return actuators.drive(*into_l, state, Command(into_l[0] / mass, np.zeros((count, 3))), faults)


# Pulses


def test_pulses_have_their_impulse_and_their_place():
    rng = np.random.default_rng(0)
    share = np.concatenate([rng.uniform(0, 1, (20, 3)), [[0, 1, 1e-9], [2.0, -1.0, 0.5]]])
    open_s = on_time(share, np.full_like(share, 1e-3), T)
    clipped = np.clip(share, 0, 1) * T
    assert open_s == pytest.approx(np.where(clipped < 1e-3, 0, clipped), abs=1e-17)
    for steps in (4, 8, 64):
        steps_open = open_share(open_s, T, steps)
        assert steps_open.min() >= 0
        assert steps_open.max() <= 1 + 1e-12
        assert steps_open.sum(axis=0) * T / steps == pytest.approx(open_s, abs=1e-16)
        # In mid-period: the pulse is the same backwards.
        assert steps_open == pytest.approx(steps_open[::-1], abs=1e-12)
        # One pulse: full steps in the middle, at most two that are cut.
        assert np.all(np.count_nonzero((steps_open > 1e-12) & (steps_open < 1 - 1e-12), axis=0) <= 2)


# Orders, and MuJoCo


def test_the_craft_moves_as_it_has_ordered():
    """Whatever comes of quantisation, MuJoCo's craft gets the mean accelerations that the filter is told."""
    world, actuators = flight([cubesat()], rate=(0.02, 0.05, -0.03))
    rng = np.random.default_rng(1)
    state = resting(1, (0.02, 0.05, -0.03))
    for _ in range(40):
        drive = push(actuators, state, rng.normal(size=3), 0.01 * rng.normal(size=3))
        truth = world.advance(drive.force, drive.torque, drive.onboard)
        change = (truth.velocity[-1] - truth.velocity[0], truth.angular_rate[-1] - truth.angular_rate[0])
        # The body turns by w T = 1e-3 rad meanwhile, and with it what it thrusts: 0.1 m/s^2 of it.
        assert change[0] / T == pytest.approx(drive.command.acceleration, abs=2e-4)
        assert change[1] / T == pytest.approx(drive.command.angular_acceleration, abs=2e-3 * 0.5)
        state = state_of(truth)
    assert np.linalg.norm(truth.velocity[-1]) > 0.01


def test_thrusters_and_wheels_give_the_wrench_within_their_limits():
    _, actuators = flight([cubesat(), cubesat(key=2)])
    wanted = np.array([1.2, -0.7, 1.9]), np.array([0.01, -0.015, 0.018])
    drive = push(actuators, resting(2), *wanted)
    assert not drive.force.any()
    assert not drive.torque.any()
    # All of these pulses are longer than the shortest, so that nothing is left to carry over.
    assert drive.onboard.force.mean(axis=0) == pytest.approx(np.tile(wanted[0], (2, 1)), rel=1e-5)
    assert drive.onboard.torque.mean(axis=0) == pytest.approx(np.tile(wanted[1], (2, 1)), rel=1e-5)
    # Ten times what there is: as much as there is, 2 N along each axis.
    most = push(actuators, resting(2), (20.0, -20, 20))
    assert most.onboard.force.mean(axis=0) == pytest.approx(np.tile([2.0, -2, 2], (2, 1)), rel=1e-6)


def test_thrusters_alone_give_force_and_torque():
    """A pulse of 14 mN m about x is 50 mN with 14 cm twice: 0.8 mN s, too short to fire; carried over, it adds up."""
    _, actuators = flight([cubesat(wheels=False)])
    given = np.zeros(6)
    for _ in range(120):
        drive = push(actuators, resting(1), (1.0, 0.5, -0.8), (0.014, -0.01, 0.02))
        mean = np.concatenate([drive.onboard.force[:, 0].mean(axis=0), drive.onboard.torque[:, 0].mean(axis=0)])
        given += mean / 120
    assert given[:3] == pytest.approx([1.0, 0.5, -0.8], abs=4e-3 / 2)
    assert given[3:] == pytest.approx([0.014, -0.01, 0.02], abs=4e-3 * 0.14 / 2)
    assert np.isnan(actuators.work().wheel_momentum_nms[0])


def test_impulses_too_small_to_fire_add_up():
    """10 mN is 0.17 mN s in a period; with two thrusters of 2 mN s at least, it fires some twice a second."""
    world, actuators = flight([cubesat()])
    state, impulse, fired = resting(1), np.zeros(3), []
    periods = 600
    for _ in range(periods):
        drive = push(actuators, state, (0.01, 0, -0.004))
        given = drive.onboard.force[:, 0].mean(axis=0) * T
        impulse += given
        if actuators.work().thrusters_open[0]:
            fired.append(np.abs(given[np.abs(given) > 1e-12]).min())
        state = state_of(world.advance(drive.force, drive.torque, drive.onboard))
    assert len(fired) < 0.2 * periods
    assert min(fired) >= 2e-3 * (1 - 1e-9)
    # What is still carried is below the shortest pulses of both thrusters of a direction.
    assert impulse == pytest.approx(np.array([0.01, 0, -0.004]) * periods * T, abs=2 * 2e-3)


def test_what_could_not_be_given_is_not_made_up_for_later():
    _, actuators = flight([cubesat()])
    for _ in range(100):
        push(actuators, resting(1), (50.0, 0, 0))
    after = push(actuators, resting(1), (0.0, 0, 0))
    assert np.abs(after.onboard.force.mean(axis=0)).max() * T < 4e-3


def test_delta_v_is_the_impulse_of_every_thruster_over_the_mass():
    """A force along one axis needs two thrusters that point alike: delta-v is F t / m; others cost more."""
    world, actuators = flight([cubesat(), cubesat(thrusters=False, wheels=False)])
    state = resting(2)
    for _ in range(60):
        drive = push(actuators, state, (0.6, 0, 0))
        state = state_of(world.advance(drive.force, drive.torque, drive.onboard))
    assert actuators.work().delta_v_m_s == pytest.approx(0.6 / CUBESAT.mass, rel=1e-5)
    assert np.linalg.norm(state.velocity, axis=1) == pytest.approx(0.6 / CUBESAT.mass, rel=1e-5)
    assert actuators.work().thrusters_open[0] == 2
    assert np.isnan([actuators.work().thrusters_open[1], actuators.work().wheel_momentum_nms[1]]).all()


# Wheels


def test_wheels_and_craft_keep_their_momentum():
    """Without thrusters nothing leaves the craft: R (I w + h) stays, also while all of it turns, but for what MuJoCo's
    first-order steps lose of it."""

    def momentum(state, actuators, inertia):
        body = np.swapaxes(state.rotation, 1, 2) @ state.angular_rate[..., None]
        return (state.rotation @ (inertia @ body + actuators.stored[..., None]))[0, :, 0]

    rate = (0.1, 0.2, -0.15)
    world, actuators = flight([cubesat(thrusters=False)], rate)
    state, rng = resting(1, rate), np.random.default_rng(2)
    before = momentum(state, actuators, world.inertia)
    torque = 0.02 * rng.choice([-1, 1], 3)
    for _ in range(120):
        drive = push(actuators, state, (0.0, 0, 0), torque)
        state = state_of(world.advance(drive.force, drive.torque, drive.onboard))
    stored = np.linalg.norm(actuators.stored)
    assert stored == pytest.approx(actuators.work().wheel_momentum_nms[0])
    assert stored > 0.02
    assert momentum(state, actuators, world.inertia) == pytest.approx(before, abs=1e-4)


def test_a_full_wheel_is_unloaded_by_the_thrusters_and_the_craft_feels_nothing():
    """10 mN m for 30 s would fill a wheel of 200 mN m s: it never is full, and the torque is given all the time."""
    world, actuators = flight([cubesat()])
    state, stored, given = resting(1), [], np.zeros(3)
    for _ in range(30 * 60):
        drive = push(actuators, state, (0.0, 0, 0), (0.01, 0, 0))
        given += drive.onboard.torque[:, 0].mean(axis=0) * T
        stored.append(actuators.work().wheel_momentum_nms[0])
    assert max(stored) < 0.2
    assert max(stored) > UNLOAD_ABOVE * 0.2
    assert min(stored[600:]) < 0.05
    # 0.3 N m s in all, but for what the thrusters carry: the shortest pulse at 14 cm.
    assert given == pytest.approx([0.3, 0, 0], abs=2 * 2e-3 * 0.14)
    assert actuators.work().delta_v_m_s[0] == pytest.approx(0.3 / 0.14 / world.mass[0], rel=0.3)


def test_a_wheel_never_passes_its_limits():
    """Without thrusters to unload it, it stops at its momentum; the torque is at most its own all the time."""
    _, actuators = flight([cubesat(thrusters=False)])
    for _ in range(900):
        drive = push(actuators, resting(1), (0.0, 0, 0), (0.05, 0, 0))
        assert np.abs(drive.onboard.torque).max() <= 0.02 * (1 + 1e-9)
        assert actuators.work().wheel_momentum_nms[0] <= 0.2 * (1 + 1e-9)
    assert actuators.work().wheel_momentum_nms[0] == pytest.approx(0.2)


# Errors and faults


def test_execution_errors_are_drawn_per_thruster_and_craft():
    """Mean and spread over 500 craft, four sigmas of them; the same craft always has the same thrusters."""
    nominal = -CUBESAT.thrusters.force_n[:, None] * CUBESAT.thrusters.exhaust
    assert executed(CUBESAT.thrusters, EXACT, 5, 0) == pytest.approx(nominal, abs=1e-15)
    true = np.array([executed(CUBESAT.thrusters, (0.03, np.radians(1.0)), key, 0) for key in range(500)])
    size = np.linalg.norm(true, axis=2)
    count = size.size
    assert size.mean() == pytest.approx(1.0, abs=4 * 0.03 / np.sqrt(count))
    assert size.std() == pytest.approx(0.03, rel=4 / np.sqrt(2 * count))
    tilt = np.degrees(np.arccos(np.clip(np.sum(true * nominal, axis=2) / size, -1, 1)))
    # Two normal angles: Rayleigh, mean square 2 sigma^2 with a relative spread of one.
    assert np.mean(tilt**2) == pytest.approx(2.0, rel=4 / np.sqrt(count))
    assert np.array_equal(true[7], executed(CUBESAT.thrusters, (0.03, np.radians(1.0)), 7, 0))
    assert not np.array_equal(true[7], executed(CUBESAT.thrusters, (0.03, np.radians(1.0)), 7, 1))


def test_errors_reach_the_world_but_not_the_computer():
    exact, wrong = cubesat(), cubesat((0.1, 0.05))
    _, actuators = flight([exact, wrong])
    drive = push(actuators, resting(2), (1.0, 1.0, 1.0))
    assert drive.command.acceleration[1] == pytest.approx(drive.command.acceleration[0], abs=1e-15)
    assert np.abs(drive.onboard.force[:, 1] - drive.onboard.force[:, 0]).max() > 0.01


def test_a_stuck_thruster_pushes_or_does_not_and_the_computer_does_not_know():
    stuck = [StuckThruster(1, 2, True), StuckThruster(1, 0, False), StuckThruster(1, 2, False)]
    _, actuators = flight([cubesat(), cubesat()])
    drive = push(actuators, resting(2), (-1.0, 0, 0), faults=stuck)
    obedient, faulty = drive.onboard.force.mean(axis=0)
    # Thrusters 0 and 1 push along -x, half a newton each; 2 along x, all the time, also where it is said to be shut.
    assert obedient == pytest.approx([-1.0, 0, 0], abs=1e-5)
    assert faulty == pytest.approx([-0.5 + 1.0, 0, 0], abs=1e-5)
    assert np.array_equal(drive.command.acceleration[0], drive.command.acceleration[1])
    assert actuators.work().thrusters_open.tolist() == [2, 2]


def test_a_craft_without_a_pose_orders_nothing():
    _, actuators = flight([cubesat(), cubesat()])
    state = resting(2)
    state.rotation[0] = np.nan
    force = np.tile([[1.0, 0, 0]], (2, 1))
    drive = actuators.drive(force, force, state, Command(force, force))
    assert not drive.onboard.force[:, 0].any()
    assert not drive.onboard.torque[:, 0].any()
    assert not drive.command.acceleration[0].any()
    assert drive.onboard.force[:, 1].any()


def test_a_craft_is_driven_the_same_alone_and_in_company():
    """Bit for bit, beside craft with other actuators and with none."""
    one = cubesat((0.05, 0.02), key=9)
    company = [cubesat(thrusters=False, wheels=False), cubesat(wheels=False, key=3), one]
    _, alone = flight([one])
    _, together = flight(company)
    rng = np.random.default_rng(4)
    for _ in range(20):
        force, torque = rng.normal(size=3), 0.02 * rng.normal(size=3)
        a, b = push(alone, resting(1), force, torque), push(together, resting(3), force, torque)
        assert np.array_equal(a.onboard.force[:, 0], b.onboard.force[:, 2])
        assert np.array_equal(a.onboard.torque[:, 0], b.onboard.torque[:, 2])
    assert b.onboard.wheel_momentum[:, 1].any() is np.False_
    assert b.force[0] == pytest.approx(ATTITUDE @ force)


def test_a_craft_with_wheels_only_gets_its_force_as_it_is():
    _, actuators = flight([cubesat(thrusters=False)])
    drive = push(actuators, resting(1), (5.0, 0, 0), (0.01, 0, 0))
    assert drive.force[0] == pytest.approx(ATTITUDE @ [5.0, 0, 0])
    assert not drive.torque.any()
    assert drive.onboard.torque.mean(axis=0)[0] == pytest.approx([0.01, 0, 0], rel=1e-5)
    assert drive.command.acceleration[0] == pytest.approx(ATTITUDE @ [5.0, 0, 0] / CUBESAT.mass)


# Models and scenarios

HEAD = '<mujoco><custom>{numbers}</custom><worldbody><body><geom type="box" size="0.1 0.1 0.1" mass="1"/>'
SITES = "".join(f'<site name="photodiode{i}" pos="0.0{i} 0.0{3 * i % 4} 0.1005"/>' for i in range(4))
FORCE = '<numeric name="thruster_force_n" data="{}"/>'
LEAST = '<numeric name="thruster_minimum_impulse_mns" data="{}"/>'


def model(tmp_path, numbers, sites):
    path = tmp_path / "craft.xml"
    path.write_text(HEAD.format(numbers=numbers) + SITES + sites + "</body></worldbody></mujoco>")
    return path


def test_a_model_says_what_its_thrusters_and_wheels_can_do(tmp_path):
    sites = (
        '<site name="thruster10" pos="0.1 0 0" zaxis="1 0 0"/><site name="thruster2" pos="0 0 -0.1" zaxis="0 0 -1"/>'
    )
    sites += '<site name="wheel0" zaxis="0 1 0"/>'
    wheel = '<numeric name="wheel_torque_mnm" data="5"/><numeric name="wheel_momentum_mnms" data="30"/>'
    craft = load_craft(model(tmp_path, FORCE.format("0.5 2") + LEAST.format("1") + wheel, sites))
    assert craft.thrusters.point_m == pytest.approx(np.array([[0, 0, -0.1], [0.1, 0, 0]]))
    assert craft.thrusters.exhaust == pytest.approx(np.array([[0, 0, -1.0], [1, 0, 0]]))
    assert craft.thrusters.force_n.tolist() == [0.5, 2]
    assert craft.thrusters.minimum_impulse_ns.tolist() == [1e-3, 1e-3]
    expected: list[Any] = [pytest.approx(np.array([[0, 1.0, 0]])), pytest.approx([5e-3]), pytest.approx([0.03])]
    assert craft.wheels == Wheels(*expected)
    assert not load_craft(find_model("mockup")).thrusters.force_n.size
    assert not craft.spec.sites
    assert not craft.spec.numerics


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ("", 'no <custom> <numeric name="thruster_force_n"'),
        (FORCE.format("1"), "thruster_minimum_impulse_mns"),
        (
            FORCE.format("1 1 1") + LEAST.format("1"),
            "thruster_force_n needs one number, or one for each of the 2; it has 3",
        ),
        (FORCE.format("1 0") + LEAST.format("1"), "thruster_force_n must be positive"),
        (FORCE.format("1") + LEAST.format("-1"), "thruster_minimum_impulse_mns must not be negative"),
    ],
)
def test_a_model_that_does_not_say_so_is_refused(tmp_path, numbers, message):
    sites = '<site name="thruster0"/><site name="thruster1"/>'
    with pytest.raises(SwarmError) as error:
        load_craft(model(tmp_path, numbers, sites))
    assert message in str(error.value)
    assert "craft.xml" in str(error.value)


def test_a_flight_on_thrusters_by_the_crafts_own_estimate(tmp_path):
    """Beside an ideal one on the same path: it arrives, with errors of its thrusters, for at most twice the delta-v."""
    motion: dict[str, Any] = {
        "kind": "waypoints",
        "points_m": [[0.2, 0.0, 3.0], [0.0, 0.0, 2.8]],
        "times_s": [1.0, 9.0],
    }
    motion["attitude"] = {"yaw_deg": 10.0, "pitch_deg": 15.0}
    other = {**motion, "points_m": [[-1.2, 0.0, 3.0], [-1.4, 0.0, 2.8]]}
    errors = {"thrust_error_percent": 3.0, "thrust_direction_error_deg": 1.0}
    craft = [
        {"model": "cubesat12u", "feedback": "estimate", "motion": motion, "actuation": errors},
        {"model": "cubesat12u", "feedback": "truth", "motion": other, "actuation": {"ideal": True}},
    ]
    data = {"duration_s": 11.0, "seed": 4, "orbit": {"altitude_km": 400.0}, "craft": craft}
    run = swarm.simulate(validate(data, file="test", folder=tmp_path), out=tmp_path / "run", record=False)
    end = run.telemetry.slice(len(run.telemetry) - 2).to_pylist()
    place = np.array([[row[f"true_p{a}_m"] for a in "xyz"] for row in end])
    assert place[0] == pytest.approx([0.0, 0, 2.8], abs=5e-3)
    assert end[0]["delta_v_m_s"] < 2 * end[1]["delta_v_m_s"] + 0.05
    assert end[1]["thrusters_open"] is None
    spent = [run.summary["craft"][name]["delta_v_m_s"] for name in ("craft-0", "craft-1")]
    assert spent == [row["delta_v_m_s"] for row in end]
    assert run.summary["swarm"]["delta_v_m_s"] == pytest.approx(np.mean(spent))
    assert 0 < end[0]["wheel_momentum_nms"] < 0.2
    status = run.telemetry["status"].to_pylist()
    assert status[4:].count("tracking") == len(status) - 4
    errors_m = run.telemetry["position_error_m"].to_numpy()[120:]
    assert np.sqrt(np.mean(errors_m**2)) < 1e-3
