"""The actuators of all craft: from the wrench that the control wants to what thrusters and wheels give.

On board, per craft and period, with the wanted force F and torque M turned into the body frame:

    w = (F, M + w x h) + c            h: the wheels' momentum, which turns with the craft; c: carried over
    u = allocate(w)                   thrusters 0 ... F_i, wheels within torque and momentum (`allocation`)
    pulses of the thrusters           `modulation`: nothing below the shortest pulse
    wheels again, pulses given        they make up for what the pulses miss of the torque
    c = B (u - what is ordered)       what is too small to fire adds up until it is not

What the thrusters cannot give for lack of force is not carried over. A wheel that has stored most of what it can is
unloaded: it is asked to give its momentum back, against the thrusters. In the world, every pulse has its thruster's own
error and faults (`execution`), and turns with the craft's true attitude. Propellant is not taken off the mass.

A craft whose model has no thrusters gets the ideal force, one with neither thrusters nor wheels the ideal wrench.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from swarm.actuation.allocation import allocate
from swarm.actuation.execution import ActuatorFaults, executed, obeyed
from swarm.actuation.modulation import on_time, open_share
from swarm.layout import Thrusters, Wheels
from swarm.onboard.control import Command, State
from swarm.results.extra_columns import Extra
from swarm.world.world import OnboardWrench

THRUSTER_COST, WHEEL_COST, UNLOADING_COST = 1e-7, 1e-10, 1e-5
"""Of a unit squared, beside the squared share of the wrench that is missed: wheels before thrusters, which cost propellant;
and where a wheel is unloaded, thrusters before wheels."""
UNLOAD_ABOVE, UNLOAD_TO = 0.8, 0.1
"""Shares of its largest momentum at which a wheel begins and ends to be unloaded."""
UNLOAD_S = 2.0
"""The time in which a wheel would be empty at its unloading torque, if that is within its limit."""

COLUMNS = (
    Extra(
        "delta_v_m_s", "m/s", "impulse of the craft's thrusters, or of its ideal force, over its mass", plot="delta-v"
    ),
    Extra("thrusters_open", "1", "thrusters that were open in the period", "count"),
    Extra("wheel_momentum_nms", "N m s", "momentum of the craft's reaction wheels together", plot="wheel momentum"),
)
"""What telemetry shows of the actuators."""


class Fitted(NamedTuple):
    """One craft's actuators. errors: 1 sigma of a thruster's relative error of force, and of its direction [rad]. key: of
    the craft's random numbers.
    """

    thrusters: Thrusters
    wheels: Wheels
    errors: tuple[float, float]
    key: int


class Drive(NamedTuple):
    """What moves the craft in one period: force (C, 3) [N] and torque (C, 3) [N m], ideal and in the lighthouse frame, of
    those without actuators; onboard: of the others (None: there are none); command: what all of them have ordered.
    """

    force: Floats
    torque: Floats
    onboard: OnboardWrench | None
    command: Command


class Actuators:
    """Thrusters and wheels of C craft. The wheels turn on from one `drive` to the next."""

    def __init__(
        self,
        fitted: Sequence[Fitted],
        mass: Floats,
        com_m: Floats,
        inertia: Floats,
        period_s: float,
        steps: int,
        seed: int = 0,
    ) -> None:
        """fitted: of every craft, without thrusters and wheels for an ideal one. mass (C,) [kg], com_m (C, 3) [m],
        inertia (C, 3, 3) [kg m^2], body frame. steps: of the physics in a period of `period_s`. seed: draws the errors.
        """
        self._period_s, self._steps = period_s, steps
        self._mass, self._count = mass, len(fitted)
        count: Ints = np.array([len(f.thrusters.force_n) for f in fitted], dtype=np.int64)
        wheels: Ints = np.array([len(f.wheels.torque_nm) for f in fitted], dtype=np.int64)
        self._has_thrusters = count > 0
        self._who = np.flatnonzero((count > 0) | (wheels > 0))
        mine = [fitted[i] for i in self._who]
        craft, most, most_wheels = len(mine), int(max(count, default=0)), int(max(wheels, default=0))
        self._n = self.most_thrusters = most
        self._inertia = inertia[self._who]
        self._force, self._true_force, self._arm = np.zeros((3, craft, most, 3))
        self._axis = np.zeros((craft, most_wheels, 3))
        # What is missing can do nothing: its bounds are zero.
        self._shortest_s, self._most = np.zeros((craft, most)), np.zeros((craft, most))
        self._torque, self._momentum_limit = np.zeros((2, craft, most_wheels))
        for a, f in enumerate(mine):
            n, w = len(f.thrusters.force_n), len(f.wheels.torque_nm)
            self._force[a, :n] = -f.thrusters.force_n[:, None] * f.thrusters.exhaust
            self._true_force[a, :n] = executed(f.thrusters, *f.errors, f.key, seed)
            self._arm[a, :n] = f.thrusters.point_m - com_m[self._who[a]]
            self._shortest_s[a, :n] = f.thrusters.minimum_impulse_ns / f.thrusters.force_n
            self._most[a, :n] = 1.0
            self._axis[a, :w], self._torque[a, :w] = f.wheels.axis, f.wheels.torque_nm
            self._momentum_limit[a, :w] = f.wheels.momentum_nms
        wheel_effect = np.swapaxes(self._axis * self._torque[..., None], 1, 2)
        self._effect = np.zeros((craft, 6, most + most_wheels))
        self._effect[:, :3, :most] = np.swapaxes(self._force, 1, 2)
        self._effect[:, 3:, :most] = np.swapaxes(np.cross(self._arm, self._force), 1, 2)
        self._effect[:, 3:, most:] = wheel_effect
        self._scale = _scale(self._effect)
        self._momentum = np.zeros((craft, most_wheels))
        self._unloading = np.zeros((craft, most_wheels), dtype=np.bool_)
        self._carried = np.zeros((craft, 6))
        self._delta_v = np.zeros(len(fitted))
        self._open = np.zeros((len(fitted), most), dtype=np.bool_)

    @property
    def columns(self) -> tuple[Extra, ...]:
        """The telemetry columns of `work`; those of thrusters and wheels only where a craft has some."""
        return COLUMNS if len(self._who) else COLUMNS[:1]

    def work(self) -> Floats:
        """What the actuators have truly done by the end of the last period, (C, len(columns)); NaN for what is missing."""
        firing = np.where(self._has_thrusters, np.count_nonzero(self._open, axis=1), np.nan)
        momentum = np.full(len(firing), np.nan)
        stored = np.linalg.norm(self._stored(), axis=1)
        momentum[self._who] = np.where(self._momentum_limit.any(axis=1), stored, np.nan)
        return np.stack([self._delta_v, firing, momentum], axis=1)[:, : len(self.columns)]

    def drive(
        self, force: Floats, torque: Floats, believed: State, command: Command, faults: ActuatorFaults | None = None
    ) -> Drive:
        """Make force (C, 3) [N] and torque (C, 3) [N m], lighthouse frame, that the control wants for one period.

        believed: the state that they were wanted in. command: the accelerations that they stand for. faults: thrusters
        that do not obey, which nobody on board knows.
        """
        ideal = ~self._has_thrusters
        self._delta_v[ideal] += np.linalg.norm(force[ideal], axis=1) / self._mass[ideal] * self._period_s
        who = self._who
        if not len(who):
            return Drive(force, torque, None, command)
        # A craft that does not know how it is turned can order nothing.
        known = np.isfinite(believed.rotation[who]).all(axis=(1, 2)) & np.isfinite(believed.angular_rate[who]).all(
            axis=1
        )
        rotation = np.where(known[:, None, None], believed.rotation[who], np.eye(3))
        rate = np.where(known[:, None], believed.angular_rate[who], 0.0)
        stored = self._stored()
        wanted = np.concatenate([_into_body(rotation, force[who]), _into_body(rotation, torque[who])], axis=1)
        body_rate = _into_body(rotation, rate)
        wanted[:, 3:] += np.cross(body_rate, stored)
        wanted[~known] = self._carried[~known] = 0.0
        wanted[ideal[who], :3] = 0.0
        share, turning = self._order(wanted)
        ordered = (self._effect @ np.concatenate([share, turning], axis=1)[..., None])[..., 0]

        opened = obeyed(open_share(share * self._period_s, self._period_s, self._steps), who.tolist(), faults)
        onboard = self._execute(opened, turning)
        self._momentum -= turning * self._torque * self._period_s
        return self._driven(force, torque, command, ordered, rotation, body_rate, stored, onboard)

    def _order(self, wanted: Floats) -> tuple[Floats, Floats]:
        """Shares of the period that thrusters are open (A, N), and shares of the wheels' torque (A, W), for `wanted`."""
        n = self._n
        cost, preferred, low, high = self._bounds()
        demand = wanted + self._carried
        best, _ = allocate(self._effect, self._scale, cost, preferred, low, high, demand)
        share = on_time(best[:, :n], self._shortest_s, self._period_s) / self._period_s
        low[:, :n] = high[:, :n] = share
        final, _ = allocate(self._effect, self._scale, cost, preferred, low, high, demand)
        self._carried = (self._effect @ (best - final)[..., None])[..., 0]
        return share, final[:, n:]

    def _bounds(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Cost, preferred value, lowest and highest (A, N + W) of every actuator, in its units, for this period."""
        craft, n = len(self._who), self._n
        full = np.abs(self._momentum) / np.where(self._momentum_limit > 0, self._momentum_limit, 1.0)
        self._unloading = (full > UNLOAD_ABOVE) | (self._unloading & (full > UNLOAD_TO))
        # A wheel gives the craft what it loses itself: its momentum h becomes h - torque T.
        torque = np.where(self._torque > 0, self._torque, 1.0)
        room = self._momentum_limit / (torque * self._period_s)
        held = self._momentum / (torque * self._period_s)
        present = np.where(self._torque > 0, 1.0, 0.0)
        unload = np.where(self._unloading, self._momentum / (UNLOAD_S * torque), 0.0)
        wheel_low, wheel_high = np.clip(held - room, -present, present), np.clip(held + room, -present, present)
        wheel_cost = np.where(self._unloading, UNLOADING_COST, WHEEL_COST)
        zero = np.zeros((craft, n))
        return (
            np.concatenate([np.full((craft, n), THRUSTER_COST), wheel_cost], axis=1),
            np.concatenate([zero, np.clip(unload, wheel_low, wheel_high)], axis=1),
            np.concatenate([zero, wheel_low], axis=1),
            np.concatenate([self._most, wheel_high], axis=1),
        )

    def _execute(self, opened: Floats, turning: Floats) -> OnboardWrench:
        """What thrusters open for the shares `opened` (S, A, N) of the steps, and wheels, do to all craft."""
        who = self._who
        out = OnboardWrench(*np.zeros((3, self._steps, self._count, 3)))
        out.force[:, who] = np.einsum("san,ani->sai", opened, self._true_force)
        pulse_torque = np.einsum("san,ani->sai", opened, np.cross(self._arm, self._true_force))
        wheel_torque = turning * self._torque
        out.torque[:, who] = pulse_torque + np.einsum("aw,awi->ai", wheel_torque, self._axis)
        middle = (np.arange(self._steps) + 0.5) * self._period_s / self._steps
        momentum = self._momentum - wheel_torque * middle[:, None, None]
        out.wheel_momentum[:, who] = np.einsum("saw,awi->sai", momentum, self._axis)
        impulse = np.einsum("san,an->a", opened, np.linalg.norm(self._true_force, axis=2)) / self._steps
        self._delta_v[who] += impulse * self._period_s / self._mass[who]
        self._open[who] = (opened > 0).any(axis=0) & (self._most > 0)
        return out

    def _driven(
        self,
        force: Floats,
        torque: Floats,
        command: Command,
        ordered: Floats,
        rotation: Floats,
        body_rate: Floats,
        stored: Floats,
        onboard: OnboardWrench,
    ) -> Drive:
        """What is left to the ideal wrench, and the accelerations that follow from what is ordered (A, 6), body frame."""
        who, thrusting = self._who, self._who[self._has_thrusters[self._who]]
        force, torque = force.copy(), torque.copy()
        force[thrusting], torque[who] = 0.0, 0.0
        momentum = (self._inertia @ body_rate[..., None])[..., 0] + stored
        change = np.linalg.solve(self._inertia, (ordered[:, 3:] - np.cross(body_rate, momentum))[..., None])
        acceleration, angular = command.acceleration.copy(), command.angular_acceleration.copy()
        linear = (rotation @ (ordered[:, :3] / self._mass[who, None])[..., None])[..., 0]
        acceleration[thrusting] = linear[self._has_thrusters[who]]
        angular[who] = (rotation @ change)[..., 0]
        return Drive(force, torque, onboard, Command(acceleration, angular))

    def _stored(self) -> Floats:
        """The wheels' momentum (A, 3) [N m s] in the body frame."""
        out: Floats = np.einsum("aw,awi->ai", self._momentum, self._axis)
        return out


def _into_body(rotation: Floats, vector: Floats) -> Floats:
    """Vectors (A, 3) of the lighthouse frame in the frames of `rotation` (A, 3, 3)."""
    out: Floats = np.einsum("aji,aj->ai", rotation, vector)
    return out


def _scale(effect: Floats) -> Floats:
    """S (A, 6): one over the largest force, and the largest torque, of any actuator of `effect` (A, 6, n)."""
    force = np.linalg.norm(effect[:, :3], axis=1).max(axis=1, initial=0.0)
    torque = np.linalg.norm(effect[:, 3:], axis=1).max(axis=1, initial=0.0)
    size = np.stack([force, torque], axis=1)
    return np.repeat(1 / np.where(size > 0, size, 1.0), 3, axis=1)
