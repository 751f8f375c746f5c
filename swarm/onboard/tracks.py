"""The pose filters of C craft and the age of each one's last pose; every pose sensor on board feeds them.

A sensor is a *fix*: once per lighthouse period it finds poses with their covariances (`PoseFix`). `Tracks` predicts
every filter to the epoch, also by the craft's own orders and by the orbit, and takes in one fix after the other: two
sensors are two updates, and either is enough. No operation mixes rows of the craft axis.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import FilterBank
from estimators.filter.error_state import POSE, POSE_COLUMNS, RATE_COLUMNS, STATES
from estimators.lighthouse.planar import Rows
from estimators.relative_orbit import RelativeOrbit, acceleration
from estimators.state import State
from swarm.messages import Command

UNKNOWN_RATE = (1.0, 0.5)
"""Standard deviation per axis of a craft's rates before it knows them: angular [rad/s], linear [m/s]."""


class PoseFix(NamedTuple):
    """Poses of C craft from one sensor in one period, lighthouse frame, at the epoch.

    known: craft with a pose, (C,). rotation: R_l_b, (C, 3, 3). position: (C, 3) [m]. covariance: of (attitude,
    position), (C, 6, 6) [rad, m]. coupling: B of a pose that was solved with the filter's predicted rates, (C, 6, 6)
    [s]. start_coupling: B of a pose that was solved as if at rest, (C, 6, 6) [s]. sensor: codes of `Sensor`, (C,).
    rows: what updates running filters in the pose's place where a pose and a covariance do not tell it; None: nowhere.
    """

    known: Bools
    rotation: Floats
    position: Floats
    covariance: Floats
    coupling: Floats
    start_coupling: Floats
    sensor: Ints
    rows: Rows | None = None


class Taken(NamedTuple):
    """Result of the filters' update with a fix, (C,) each.

    fresh: whether the pose was accepted, or started a filter. refused: whether the gate refused it. nis: squared
    innovation normalised by its covariance, NaN without an update.
    """

    fresh: Bools
    refused: Bools
    nis: Floats


class Filtered(NamedTuple):
    """The filters after all fixes of a period, NaN where inactive.

    active: (C,). state: estimated states. covariance: (C, 12, 12).
    """

    active: Bools
    state: State
    covariance: Floats


@dataclass(frozen=True)
class TrackLimits:
    """Limits beyond which a filter is stopped.

    coast_limit_s: time without a pose [s]. rejections_limit: number of successive refused poses.
    """

    coast_limit_s: float
    rejections_limit: int


class Tracks:
    """The filters of C craft, from one period to the next.

    bank: the filters. since_update_s: time since each craft's last pose, (C,) [s].
    """

    def __init__(self, bank: FilterBank, frame_s: float, limits: TrackLimits, orbit: RelativeOrbit | None) -> None:
        """Begin with filters that have not been started.

        Args:
            bank: filters of C craft.
            frame_s: length of a lighthouse period [s].
            limits: limits beyond which a filter is stopped.
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
        """Predict every filter to the next epoch; `command` has the orders for the period, if known."""
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
        """Add the ordered motion between the epochs, T apart: half a period by the last command, half by this one."""
        last, half = self._command or command, self._frame_s / 2
        self._command = command
        before = last.angular_acceleration, last.acceleration
        after = command.angular_acceleration, command.acceleration
        if not any(order.any() for order in (*before, *after)):
            # Craft that steer by the truth give no orders to their filters.
            return
        rate, velocity = ((a + b) * half for a, b in zip(before, after, strict=True))
        turn, shift = ((3 * a + b) * half**2 / 2 for a, b in zip(before, after, strict=True))
        self.bank.add_motion(self.bank.active, turn, rate, shift, velocity)

    def take_in(self, fix: PoseFix) -> Taken:
        """Update the active filters with the fix's poses, and start the others."""
        bank = self.bank
        active = bank.active
        update, start = fix.known & active, fix.known & ~active
        by_rows = np.zeros_like(update) if fix.rows is None else update & fix.rows.mask
        pose = fix.rotation, fix.position, fix.covariance
        result = bank.update_pose(update & ~by_rows, *pose, fix.coupling)
        accepted, nis = result.accepted, result.nis
        if fix.rows is not None:
            h = np.zeros((len(update), POSE, STATES))
            h[:, :, POSE_COLUMNS], h[:, :, RATE_COLUMNS] = fix.rows.pose, fix.rows.rates
            result = bank.update(by_rows, fix.rows.y, h, np.broadcast_to(np.eye(POSE), (len(update), POSE, POSE)))
            accepted, nis = accepted | result.accepted, np.where(by_rows, result.nis, nis)
        bank.start(start, *pose, UNKNOWN_RATE, fix.start_coupling)
        return Taken(start | accepted, update & ~accepted, np.where(update, nis, np.nan))

    def count(self, fresh: Bools, refused: Bools) -> None:
        """Count the time without a pose and the refused poses; stop the filters that exceed a limit.

        fresh: craft whose filter took in a pose, (C,). refused: craft whose gate refused one, (C,).
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
