"""The number of physics steps in a period: as the scenario says, or from how its craft move at most."""

from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Floats
from swarm import scenario
from swarm.flight.builders.craft import blame, start
from swarm.onboard.control import ATTITUDE_FREQUENCY_RAD_S, DAMPING, POSITION_FREQUENCY_RAD_S
from swarm.scenario import Craft, Scenario
from swarm.scenario.faults import CraftLost
from swarm.scenario.motions.dock import Dock
from swarm.scenario.motions.guided import Guided
from swarm.units import si
from swarm.world.craft import load_craft
from swarm.world.motion.fleet import Fleet
from swarm.world.step_error import LIMITS, StepErrors, Vigour, least_steps, step_errors

SAMPLES, SAMPLES_OF_MANY = 200, 25
"""Times at which motions are looked at, and those of more than `MANY` craft."""
MANY = 2000
LARGEST_SIGMA = 5.0
"""Standard deviations of one axis within which a random push of three axes stays: beyond in 15 of a million periods."""
NOISE_M_S2, CAMERA_NOISE_M_S2, NOISE_RAD_S2 = 0.35, 0.9, 1.3
"""Accelerations that the noise of its own estimate makes a craft order beside its plan, by a lighthouse's light and by
cameras at 30 m."""
UNFORESEEN_STEPS = 8
"""Least number of steps where nobody knows what a controller of the user's, or an agent, will order."""


class Steps(NamedTuple):
    """Physics steps in a period.

    number: of them. chosen: by their errors, not told by the scenario. errors: bounds, of C craft. worst: name of the
    craft whose bounds are nearest to their limits. limit: the limit that these are nearest to.
    """

    number: int
    chosen: bool
    errors: StepErrors
    worst: str
    limit: str

    @property
    def too_few(self) -> bool:
        """True where a bound is above its limit: so few are told, or no number of steps would do."""
        return bool(self.errors.over.max(initial=0.0) > 1)

    def summary(self) -> dict[str, Any]:
        """Return the entry of a run's summary: the largest bounds of all craft."""
        errors = self.errors
        return {
            "steps_per_period": self.number,
            "chosen": self.chosen,
            "period_error_m": float(errors.period_m.max()),
            "period_error_deg": float(np.degrees(errors.period_rad.max())),
            "second_error_m": float(errors.second_m.max()),
            "second_error_deg": float(np.degrees(errors.second_rad.max())),
        }

    def sentence(self) -> str:
        """Return how many there are, why, and how exact."""
        found = self.summary()
        why = f"for {self.worst}, nearest to the limit of {self.limit}" if self.chosen else "as the scenario says"
        if self.too_few:
            many = "the most there are" if self.chosen else "as the scenario says"
            why = f"{many}, too few for {self.worst} and the limit of {self.limit}"
        bounds = {
            "um": 1e6 * found["period_error_m"],
            "arcsec in a period": 3600 * found["period_error_deg"],
            "mm": 1e3 * found["second_error_m"],
            "deg in a second": found["second_error_deg"],
        }
        um, arcsec, mm, deg = (f"{_shown(value)} {unit}" for unit, value in bounds.items())
        errors = f"errors below {um} and {arcsec}, {mm} and {deg}"
        return f"{self.number} physics steps in a period, {why}: {errors} (docs/physics.md)"


def _shown(value: float) -> str:
    """Return a bound with two digits that count, and no more than four places behind the point."""
    return f"{value:.0f}" if value >= 10 else f"{max(value, 1e-4):.2g}"


def steps(settings: Scenario, motions: Fleet, agents: bool = False) -> Steps:
    """Return the number of physics steps in a period, and the bounds on their errors.

    Args:
        settings: the scenario.
        motions: the motion of every craft.
        agents: agents steer the craft, not their pilots.

    Raises:
        SwarmError: a model cannot fly.
    """
    craft = scenario.craft(settings)
    with blame(settings, craft):
        most = vigour(settings, motions, craft)
    told = settings.physics.steps_per_period
    number = told
    if number is None:
        docking = any(isinstance(c.table.motion, Dock) for c in craft)
        unforeseen = agents or any(c.table.controller is not None for c in craft)
        number = max(least_steps(most, settings.period_s, docking), UNFORESEEN_STEPS if unforeseen else 0)
    errors = step_errors(most, settings.period_s, number)
    limit, worst = np.unravel_index(np.argmax(errors.shares), errors.shares.shape)
    return Steps(number, told is None, errors, craft[int(worst)].name, list(LIMITS)[int(limit)])


def vigour(settings: Scenario, motions: Fleet, craft: list[Craft]) -> Vigour:
    """Return how the craft of a scenario move at most, by their motions, guidance, random pushes, start and faults.

    Args:
        settings: the scenario.
        motions: the motion of every craft.
        craft: the craft.
    """
    count = len(craft)
    speed, acceleration, rate, turning = np.zeros((4, count))
    for time_s in np.linspace(0.0, settings.duration_s, SAMPLES if count <= MANY else SAMPLES_OF_MANY):
        at = motions.at(float(time_s))
        wanted = at.velocity, at.acceleration, at.angular_rate, at.angular_acceleration
        for most, now in zip((speed, acceleration, rate, turning), wanted, strict=True):
            np.maximum(most, np.linalg.norm(now, axis=1), out=most)
    np.maximum(speed, [_planned(c, "speed_m_s") for c in craft], out=speed)
    np.maximum(acceleration, [_planned(c, "acceleration_m_s2", "brake_m_s2") for c in craft], out=acceleration)
    _add_start(settings, motions, (speed, acceleration, rate, turning))
    noisy = np.array([c.table.feedback == "estimate" for c in craft]) & ~motions.free
    cameras = [getattr(c.table, "ccd", None) is not None for c in craft]
    shaking, shaking_turn = np.where(cameras, CAMERA_NOISE_M_S2, NOISE_M_S2) * noisy, NOISE_RAD_S2 * noisy
    shape, wheels, push, twist = _bodies(craft)
    for asked, able in ((acceleration, push), (turning, twist), (shaking, push), (shaking_turn, twist)):
        np.minimum(asked, able, out=asked)
    shaking, shaking_turn = (shaking, shaking_turn) + LARGEST_SIGMA * _pushes(settings, motions, craft)
    for fault in settings.fault:
        if isinstance(fault, CraftLost):
            struck = np.array([not fault.craft or c.name in fault.craft for c in craft])
            speed[struck] += np.linalg.norm(fault.velocity_m_s)
            rate[struck] += np.linalg.norm(si(fault).angular_rate_rad_s)
    return Vigour(speed, acceleration, rate, turning, shape, wheels, shaking, shaking_turn)


def _planned(craft: Craft, *keys: str) -> float:
    """Return the largest of what these keys of its motion say, where guidance flies it."""
    motion = craft.table.motion
    return max(getattr(motion, key, 0.0) for key in keys) if isinstance(motion, Guided) else 0.0


def _pushes(settings: Scenario, motions: Fleet, craft: list[Craft]) -> Floats:
    """Return the standard deviations of random pushes, per axis, (2, C) [m/s^2] and [rad/s^2]."""
    tables = {id(c.table): si(c.table.disturbance) for c in craft}
    each = {table: (t.acceleration_m_s2, t.angular_acceleration_rad_s2) for table, t in tables.items()}
    own = np.array([each[id(c.table)] for c in craft])
    out: Floats = np.hypot(own, motions.push_sigma).T
    return out


def _add_start(settings: Scenario, motions: Fleet, most: tuple[Floats, Floats, Floats, Floats]) -> None:
    """Add what the scatter of the start makes, and what control makes of it, to speeds, accelerations and rates."""
    first, planned = start(settings, motions), motions.start()
    speed, acceleration, rate, turning = most
    off = np.linalg.norm(first.position - planned.position, axis=1)
    fast = np.linalg.norm(first.velocity - planned.velocity, axis=1)
    turned = 2 * np.arccos(np.minimum(np.abs(np.sum(first.quaternion * planned.quaternion, axis=1)), 1.0))
    spun = np.linalg.norm(first.angular_rate - planned.angular_rate, axis=1)
    speed += fast
    rate += spun
    held, w, v = ~motions.free, POSITION_FREQUENCY_RAD_S, ATTITUDE_FREQUENCY_RAD_S
    acceleration += held * (w * w * off + 2 * DAMPING * w * fast)
    turning += held * (v * v * turned + 2 * DAMPING * v * spun)


def _bodies(craft: list[Craft]) -> Floats:
    """Return what `_body` says of every craft, (4, C)."""
    alike: dict[tuple[Path, bool, bool], tuple[float, float, float, float]] = {}
    for c in craft:
        key = c.model, c.table.passive, c.table.actuation.ideal
        if key not in alike:
            alike[key] = _body(c)
    found = [alike[c.model, c.table.passive, c.table.actuation.ideal] for c in craft]
    out: Floats = np.array(found).reshape(-1, 4).T
    return out


def _body(craft: Craft) -> tuple[float, float, float, float]:
    """Return k, H / I, and the largest acceleration and angular acceleration by its actuators: infinite where ideal."""
    model = load_craft(craft.model, craft.table.passive)
    least, middle, most = np.linalg.eigvalsh(model.inertia)
    shape = max((most - middle) / least, (most - least) / middle, (middle - least) / most)
    thrusters, wheels = model.thrusters, model.wheels
    if craft.table.actuation.ideal or not len(thrusters.force_n):
        momentum = 0.0 if craft.table.actuation.ideal else float(np.linalg.norm(wheels.momentum_nms))
        return shape, momentum / least, inf, inf
    arm = np.linalg.norm(thrusters.point_m - model.com_m, axis=1)
    torque = thrusters.force_n @ arm + wheels.torque_nm.sum()
    force, momentum = thrusters.force_n.sum(), float(np.linalg.norm(wheels.momentum_nms))
    return shape, momentum / least, force / model.mass, torque / least
