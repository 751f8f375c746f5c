"""Orders of a craft's computer to its thrusters and wheels, per period, for a wanted force F and torque M.

Everything is in the body frame, for all craft that have actuators:

    W = (F, M + w x h) + c            h: the wheels' momentum, which turns at the rate w; c: carried over
    u = allocate(W)                   thrusters 0 ... F_i, wheels within torque and momentum (`allocation`)
    pulses of the thrusters           `modulation`: nothing below the shortest pulse
    wheels again, pulses given        they compensate the torque that the pulses miss
    c = B (u - ordered u)             impulses too small to fire add up until they are not

Force beyond the thrusters' limits is not carried over. A wheel near its largest momentum is unloaded: the thrusters owe
it the momentum that it should give up, and give it as a torque of their own once a pulse is long enough; the wheel
compensates that torque and so slows down. The computer uses the design values: it knows neither the errors nor the
faults of its thrusters (`execution`).
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from swarm.hardware import ActuatorSet
from swarm.onboard.actuation.allocation import allocate
from swarm.onboard.actuation.modulation import on_time

THRUSTER_COST, WHEEL_COST = 1e-7, 1e-10
"""Cost of the squared share of an actuator's most, relative to the squared share of the missed wrench: wheels are
preferred to thrusters, which cost propellant.
"""
UNLOAD_ABOVE, UNLOAD_TO = 0.8, 0.1
"""Shares of a wheel's largest momentum at which its unloading begins and ends."""
UNLOAD_S = 2.0
"""Time in which a wheel would be empty at its unloading torque, if that is within its limit [s]."""


class BodyOrder(NamedTuple):
    """Orders of A craft for one period, body frame.

    open_s: opening time of each thruster, (A, N) [s]. wheel_torque: torque of each wheel on the craft, (A, W) [N m].
    wrench: mean force and torque of both, (A, 6) [N, N m].
    """

    open_s: Floats
    wheel_torque: Floats
    wrench: Floats


class Orders:
    """The actuator computers of A craft, from one period to the next.

    momentum: measured momentum stored in each wheel, (A, W) [N m s]. A wheel that exerts a torque t on the craft for a
    time T is left with momentum - t T.
    """

    def __init__(self, hardware: ActuatorSet, period_s: float) -> None:
        self._hardware, self._period_s = hardware, period_s
        self._effect = hardware.effect
        self._scale = _scale(self._effect)
        self._carried = np.zeros((len(hardware.who), 6))
        self.momentum = np.zeros_like(hardware.torque_nm)
        self._unloading = np.zeros(self.momentum.shape, dtype=np.bool_)
        self._owed = np.zeros((len(hardware.who), 3))
        thrusters, wheels = hardware.has_thruster.shape[1], hardware.torque_nm.shape[1]
        self._cost = np.tile(np.repeat([THRUSTER_COST, WHEEL_COST], [thrusters, wheels]), (len(hardware.who), 1))

    def give(self, force: Floats, torque: Floats, rate: Floats, able: Bools) -> BodyOrder:
        """Return the orders that come nearest to the wanted force and torque.

        Args:
            force: wanted force, body frame, (A, 3) [N].
            torque: wanted torque, body frame, (A, 3) [N m].
            rate: angular rate of the craft, body frame, (A, 3) [rad/s].
            able: craft that order anything at all, (A,).
        """
        wanted = np.concatenate([force, torque + np.cross(rate, self.stored)], axis=1) + self._carried
        wanted[~able] = 0.0
        thrusters = self._hardware.has_thruster.shape[1]
        low, high = self._bounds()
        best = self._allocate(wanted, low, high)
        asked = self._with_what_is_owed(wanted, best, low, high)[:, :thrusters]
        open_s = on_time(asked, self._hardware.shortest_s, self._period_s)
        low[:, :thrusters] = high[:, :thrusters] = open_s / self._period_s
        final = self._allocate(wanted, low, high)
        self._carried = _wrench(self._effect, best - final)
        self._book_what_is_owed(asked - low[:, :thrusters])
        wheel_torque = final[:, thrusters:] * self._hardware.torque_nm
        self.momentum = self.momentum - wheel_torque * self._period_s
        return BodyOrder(open_s, wheel_torque, _wrench(self._effect, final))

    @property
    def stored(self) -> Floats:
        """The total momentum of each craft's wheels, (A, 3) [N m s], body frame."""
        out: Floats = np.einsum("aw,awi->ai", self.momentum, self._hardware.axis)
        return out

    def _allocate(self, wanted: Floats, low: Floats, high: Floats) -> Floats:
        return allocate(self._effect, self._scale, self._cost, np.zeros_like(low), low, high, wanted)[0]

    def _bounds(self) -> tuple[Floats, Floats]:
        """Return the lowest and highest share of every actuator, (A, N + W) each, relative to its most."""
        limit, real = self._hardware.momentum_nms, self._hardware.torque_nm > 0
        full = np.where(real, self._hardware.torque_nm, 1.0) * self._period_s
        # The momentum must stay within its limit to the end of the period.
        low = np.clip((self.momentum - limit) / full, -1.0, 1.0) * real
        high = np.clip((self.momentum + limit) / full, -1.0, 1.0) * real
        thrusters = self._hardware.has_thruster
        shut = np.zeros(thrusters.shape)
        return np.concatenate([shut, low], axis=1), np.concatenate([thrusters, high], axis=1)

    def _with_what_is_owed(self, wanted: Floats, best: Floats, low: Floats, high: Floats) -> Floats:
        """Return shares (A, N + W) as `best`, with the thrusters also giving the momentum owed to the wheels."""
        limit, thrusters = self._hardware.momentum_nms, self._hardware.has_thruster.shape[1]
        full = np.abs(self.momentum) / np.where(limit > 0, limit, 1.0)
        self._unloading = (full > UNLOAD_ABOVE) | (self._unloading & (full > UNLOAD_TO))
        torque = np.clip(self.momentum / UNLOAD_S, -self._hardware.torque_nm, self._hardware.torque_nm)
        given_up = np.einsum("aw,awi->ai", torque * self._unloading * self._period_s, self._hardware.axis)
        can: Bools = np.asarray(self._hardware.has_thruster.any(axis=1) & self._unloading.any(axis=1))
        self._owed = np.where(can[:, None], self._owed - given_up, 0.0)
        if not can.any():
            return best
        low, high = low.copy(), high.copy()
        low[:, thrusters:] = high[:, thrusters:] = best[:, thrusters:]
        more = np.concatenate([np.zeros_like(self._owed), self._owed / self._period_s], axis=1)
        return np.where(can[:, None], self._allocate(wanted + more, low, high), best)

    def _book_what_is_owed(self, missed: Floats) -> None:
        """Keep as owed the torque of the shares (A, N) that thrusters were asked for and do not give."""
        torque = _wrench(self._effect[:, 3:, : missed.shape[1]], missed)
        self._owed = np.clip(torque * self._period_s, np.minimum(self._owed, 0.0), np.maximum(self._owed, 0.0))


def _wrench(effect: Floats, share: Floats) -> Floats:
    """Return the wrench (A, k) of actuators of `effect` (A, k, n) at shares (A, n) of their most."""
    out: Floats = (effect @ share[..., None])[..., 0]
    return out


def _scale(effect: Floats) -> Floats:
    """Return one over the largest force, and the largest torque, of any actuator of `effect` (A, 6, n), as (A, 6)."""
    force = np.linalg.norm(effect[:, :3], axis=1).max(axis=1, initial=0.0)
    torque = np.linalg.norm(effect[:, 3:], axis=1).max(axis=1, initial=0.0)
    size = np.stack([force, torque], axis=1)
    return np.repeat(1 / np.where(size > 0, size, 1.0), 3, axis=1)
