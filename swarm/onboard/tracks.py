"""The pose filters of C craft, and how fresh each is: what every pose sensor on board feeds.

A sensor is a *fix*: once per lighthouse period it finds poses with their covariances (`PoseFix`). `Tracks` predicts
every filter to the epoch, by the craft's own orders and the orbit too, and takes in one fix after the other: two
sensors are two updates, and either is enough. Nothing in here mixes rows of the craft axis.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import FilterBank
from estimators.filter.error_state import RATE_COLUMNS
from estimators.relative_orbit import RelativeOrbit, acceleration
from estimators.state import State
from swarm.messages import Command

UNKNOWN_RATE = (1.0, 0.5)
"""1 sigma per axis of a craft's rates before it knows them: angular [rad/s], linear [m/s]."""


class PoseFix(NamedTuple):
    """Poses that a sensor has found for C craft in one period, lighthouse frame, at the epoch.

    known: (C,), where there is a pose. rotation: (C, 3, 3) R_l_b. position: (C, 3) [m]. covariance: (C, 6, 6) of
    (attitude, position) [rad, m]. coupling: (C, 6, 6) [s], B of a pose that was solved with the filter's predicted
    rates. start_coupling: (C, 6, 6) [s], B of a pose that was solved as if at rest. sensor: (C,), codes of `Sensor`.
    """

    known: Bools
    rotation: Floats
    position: Floats
    covariance: Floats
    coupling: Floats
    start_coupling: Floats
    sensor: Ints


class Taken(NamedTuple):
    """What became of a fix in the filters, (C,) each: accepted, or a filter started; refused by the gate; and the
    squared
    innovation normalised by its covariance, NaN where there was no update.
    """

    fresh: Bools
    refused: Bools
    nis: Floats


class Filtered(NamedTuple):
    """The filters after all fixes of a period: active (C,), states, covariance (C, 12, 12); NaN without one."""

    active: Bools
    state: State
    covariance: Floats


@dataclass(frozen=True)
class TrackLimits:
    """When a filter is given up: without a pose for coast_limit_s [s], or after rejections_limit refused poses in a
    row.
    """

    coast_limit_s: float
    rejections_limit: int


class Tracks:
    """The filters of C craft, from one period to the next.

    bank: the filters. since_update_s: (C,) [s], the time since each craft's last pose.
    """

    def __init__(self, bank: FilterBank, frame_s: float, limits: TrackLimits, orbit: RelativeOrbit | None) -> None:
        """Begin with filters that have not been started.

        Args:
            bank: the filters of C craft.
            frame_s: length of a lighthouse period [s].
            limits: when a filter is given up.
            orbit: the lighthouse's orbit; None in weightless space.
        """
        craft = len(bank.active)
        self.bank, self._frame_s, self._limits, self._orbit = bank, frame_s, limits, orbit
        self.since_update_s = np.zeros(craft)
        self._rejections = np.zeros(craft, dtype=np.int64)
        self._command: Command | None = None

    def forget(self, mask: Bools) -> None:
        """Forget everything about the craft of the mask (C,)."""
        self.bank.stop(mask)
        self.since_update_s[mask], self._rejections[mask] = 0.0, 0
        if self._command is not None:
            self._command = self._command.only(~mask)

    def predict(self, command: Command | None) -> None:
        """Move every filter on to the next epoch. command: what the craft have ordered for the period, if known."""
        bank = self.bank
        active = bank.active
        pull = None if self._orbit is None else acceleration(self._orbit, bank.position, bank.velocity)
        bank.predict(self._frame_s, active)
        if pull is not None:
            still = np.zeros_like(pull)
            bank.add_motion(active, still, still, pull * self._frame_s**2 / 2, pull * self._frame_s)
        if command is not None:
            self._add_command(command)

    def _add_command(self, command: Command) -> None:
        """Add what the craft did between the epochs, T apart: half a period by the last command, half by this one."""
        last, half = self._command or command, self._frame_s / 2
        self._command = command
        before = last.angular_acceleration, last.acceleration
        after = command.angular_acceleration, command.acceleration
        if not any(order.any() for order in (*before, *after)):
            # A swarm that is steered by the truth orders nothing that its filters could know.
            return
        rate, velocity = ((a + b) * half for a, b in zip(before, after, strict=True))
        turn, shift = ((3 * a + b) * half**2 / 2 for a, b in zip(before, after, strict=True))
        self.bank.add_motion(self.bank.active, turn, rate, shift, velocity)

    def take_in(self, fix: PoseFix) -> Taken:
        """Update the filters that run with the fix's poses, and start the others."""
        bank = self.bank
        active = bank.active
        update, start = fix.known & active, fix.known & ~active
        result = bank.update_pose(update, fix.rotation, fix.position, fix.covariance, fix.coupling)
        bank.start(start, fix.rotation, fix.position, fix.covariance, UNKNOWN_RATE, fix.start_coupling)
        return Taken(start | result.accepted, update & ~result.accepted, np.where(update, result.nis, np.nan))

    def count(self, fresh: Bools, refused: Bools) -> None:
        """Note who has had a pose; stop the filters of those who have had none for long, or refused too many.

        fresh: (C,), a pose was taken in. refused: (C,), the gate refused one.
        """
        self.since_update_s = np.where(fresh, 0.0, self.since_update_s + self._frame_s)
        self._rejections = np.where(fresh, 0, self._rejections + refused)
        given_up = self.since_update_s > self._limits.coast_limit_s
        self.bank.stop(self.bank.active & (given_up | (self._rejections >= self._limits.rejections_limit)))

    def filtered(self) -> Filtered:
        """Return the filters as they are now."""
        return Filtered(self.bank.active, self.bank.state, self.bank.covariance)

    def rate_covariance(self, craft: int) -> Floats:
        """Return the covariance (6, 6) of a craft's rates (angular, linear): predicted, or a wide prior."""
        if self.bank.active[craft]:
            covariance: Floats = self.bank.covariance[craft][np.ix_(RATE_COLUMNS, RATE_COLUMNS)]
            return covariance
        return np.diag(np.repeat(np.square(UNKNOWN_RATE), 3))
