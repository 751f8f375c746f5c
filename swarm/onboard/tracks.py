"""The pose filters of C craft and the age of each one's last pose; every pose sensor on board feeds them.

A sensor is a *fix*: once per lighthouse period it finds poses with their covariances (`PoseFix`). `Tracks` predicts
every filter to the epoch, also by the craft's own orders and by the orbit, and takes in one fix after the other: two
sensors are two updates, and either is enough. No operation mixes rows of the craft axis.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import FilterBank, gates
from estimators.filter.error_state import (
    POSE,
    POSE_COLUMNS,
    RATE_COLUMNS,
    STATES,
    innovations_into,
)
from estimators.free_rotation import FreeTurns, free_turns
from estimators.kernel import kernel
from estimators.lighthouse.planar import Rows
from estimators.relative_orbit import RelativeOrbit, acceleration
from estimators.state import State
from swarm.messages import Command

UNDECIDED_RAD = 0.05
"""Standard deviation of the attitude [rad], root of the trace, beyond which single sweeps may not tell mirror images
apart: a search begins beside the filter, as for a craft that coasts."""
MEANINGLESS_RAD = 0.6
"""Likewise, beyond which the filter is stopped although single sweeps still come in: its equations are linear."""
UNKNOWN_RATE = (1.0, 0.5)
"""Standard deviation per axis of a craft's rates before it knows them: angular [rad/s], linear [m/s]."""
HARDER = (4.0, 16.0, 64.0, 256.0)
"""Factors of the accelerations that a push is taken to have which no model of motion has."""


class Motion(NamedTuple):
    """States of C craft with their covariances (C, 12, 12)."""

    state: State
    covariance: Floats


class PoseFix(NamedTuple):
    """Poses of C craft from one sensor in one period, lighthouse frame, at the epoch.

    known: craft with a pose, (C,). rotation: R_l_b, (C, 3, 3). position: (C, 3) [m]. covariance: of (attitude,
    position), (C, 6, 6) [rad, m]. coupling: B of a pose that was solved with the filter's predicted rates, (C, 6, 6)
    [s]. start_coupling: B of a pose that was solved as if at rest, (C, 6, 6) [s]. sensor: codes of `Sensor`, (C,).
    rows: what updates running filters in the pose's place where a pose and a covariance do not tell it; None: nowhere.
    motion: states and their covariances that start filters in the pose's place, running ones again; None: nowhere.
    tested: whether what each pose was solved from has been shown to agree with itself; a pose that a filter refuses
    then tells of a push.
    """

    known: Bools
    rotation: Floats
    position: Floats
    covariance: Floats
    coupling: Floats
    start_coupling: Floats
    sensor: Ints
    rows: Rows | None = None
    motion: Motion | None = None
    tested: bool = False


class Pair(NamedTuple):
    """Two poses, axis 2, that a search leaves to one craft: rotation (2, 3, 3), position (2, 3) [m], covariance and
    coupling, as in `PoseFix`, (2, 6, 6); lead: evidence for the first.
    """

    rotation: Floats
    position: Floats
    covariance: Floats
    coupling: Floats
    lead: float


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

    coast_limit_s: time without a pose or single sweeps [s]. rejections_limit: number of successive refusals.
    """

    coast_limit_s: float
    rejections_limit: int


class Tracks:
    """The filters of C craft, from one period to the next.

    bank: the filters. since_update_s: time since each craft's last pose or single sweeps, (C,) [s]. since_pose_s:
    likewise since the last pose.
    """

    def __init__(
        self,
        bank: FilterBank,
        frame_s: float,
        limits: TrackLimits,
        orbit: RelativeOrbit | None,
        inertia: Floats | None = None,
        lead_s: float = 0.0,
    ) -> None:
        """Begin with filters that have not been started.

        Args:
            bank: filters of C craft.
            frame_s: length of a lighthouse period [s].
            limits: limits beyond which a filter is stopped.
            orbit: the lighthouse's orbit; None in weightless space.
            inertia: (C, 3, 3) [kg m^2], body frame, of craft that turn freely; NaN for the others; None: of none.
            lead_s: time before the beginning of a period at which its orders begin to act [s].
        """
        craft = len(bank.active)
        self._lead_s = lead_s
        self.bank, self._frame_s, self._limits, self._orbit = bank, frame_s, limits, orbit
        self.since_update_s, self.since_pose_s = np.zeros((2, craft))
        self._rejections = np.zeros(craft, dtype=np.int64)
        self._still = np.zeros((craft, 3))
        self._command: Command | None = None
        self.inertia = np.full((craft, 3, 3), np.nan) if inertia is None else np.ascontiguousarray(inertia)
        self._turns_freely: Bools = np.isfinite(self.inertia).all(axis=(1, 2))
        self._inverse = np.full((craft, 3, 3), np.nan)
        self._inverse[self._turns_freely] = np.linalg.inv(self.inertia[self._turns_freely])

    def beside(self, bank: FilterBank) -> "Tracks":
        """Return other filters of the same craft, not started, with the same limits, orders and surroundings."""
        out = Tracks(bank, self._frame_s, self._limits, self._orbit, self.inertia, self._lead_s)
        out._command = self._command
        return out

    def forget(self, mask: Bools) -> None:
        """Forget everything about the craft of the mask (C,)."""
        self.bank.stop(mask)
        self.since_update_s[mask], self.since_pose_s[mask], self._rejections[mask] = 0.0, 0.0, 0
        if self._command is not None:
            self._command = self._command.only(~mask)

    def predict(self, command: Command | None) -> Floats | None:
        """Predict every filter to the next epoch; `command` has the orders for the period, if known.

        Returns what free turns make of an error of attitude and angular rate, (C, 6, 6); None without them.
        """
        bank = self.bank
        active = bank.active
        if not active.any():
            self._command = command or self._command
            return None
        pull = None if self._orbit is None else acceleration(self._orbit, bank.position, bank.velocity)
        unsteered = self._unsteered(command)
        free = active & (self._turns_freely | unsteered)
        turns = self._free_turns(free, unsteered, command) if free.any() else None
        bank.predict(self._frame_s, active)
        if turns is not None:
            bank.add_motion(free, turns.turn, turns.rate, self._still, self._still, turns.coupling)
        if pull is not None:
            bank.add_motion(active, self._still, self._still, pull * self._frame_s**2 / 2, pull * self._frame_s)
        if command is not None:
            self._add_command(command, unsteered)
        return None if turns is None else turns.coupling

    def _unsteered(self, command: Command | None) -> Bools:
        """Return the craft (C,) that turn freely between the epochs only because they order no torque."""
        last = self._command
        if command is None or command.inertia is None or last is None or last.inertia is None:
            return np.zeros(len(self._turns_freely), dtype=np.bool_)
        out: Bools = np.isfinite(command.inertia[:, 0, 0] + last.inertia[:, 0, 0]) & ~self._turns_freely
        return out

    def _free_turns(self, free: Bools, unsteered: Bools, command: Command | None) -> FreeTurns:
        """Return the motion of craft that turn without torque, beyond that at constant rates.

        Args:
            free: (C,), the craft.
            unsteered: (C,), those of them whose orders tell it.
            command: their orders.
        """
        bank, inertia, inverse = self.bank, self.inertia, self._inverse
        if unsteered.any() and command is not None and command.inertia is not None:
            inertia, inverse = inertia.copy(), inverse.copy()
            inertia[unsteered] = command.inertia[unsteered]
            inverse[unsteered] = np.linalg.inv(inertia[unsteered])
        return free_turns(free, bank.rotation, bank.angular_rate, inertia, inverse, self._frame_s)

    def _add_command(self, command: Command, unsteered: Bools) -> None:
        """Add the ordered motion between the epochs, T apart: half a period by the last command, half by this one,
        which has begun earlier by the lead of the orders.

        Args:
            command: orders of the craft.
            unsteered: (C,), craft whose turning is known already.
        """
        last, half = self._command or command, self._frame_s / 2
        self._command = command
        motion = np.empty((4, *unsteered.shape, 3))
        orders = last.angular_acceleration, last.acceleration, command.angular_acceleration, command.acceleration
        # Craft that steer by the truth give no orders to their filters.
        if _ordered_motion_into(orders, unsteered, half, half**2, self._lead_s, motion):
            turn, rate, shift, velocity = motion
            self.bank.add_motion(self.bank.active, turn, rate, shift, velocity)

    def take_in(self, fix: PoseFix) -> Taken:
        """Update the active filters with the fix's poses, and start the others."""
        bank = self.bank
        active = bank.active
        if fix.motion is not None:
            bank.adopt(fix.known, *fix.motion)
            return Taken(fix.known, np.zeros_like(fix.known), np.full(len(active), np.nan))
        update, start = fix.known & active, fix.known & ~active
        accepted, nis = self._update(update, fix)
        refused = update & ~accepted
        if fix.tested and refused.any():
            pushed = self._pushed(refused, fix)
            again, found = self._update(pushed, fix)
            accepted, refused, nis = accepted | again, refused & ~again, np.where(pushed, found, nis)
        bank.start(start, fix.rotation, fix.position, fix.covariance, UNKNOWN_RATE, fix.start_coupling)
        return Taken(start | accepted, refused, nis)

    def _update(self, update: Bools, fix: PoseFix) -> tuple[Bools, Floats]:
        """Update the filters of the craft of the mask; return whose were accepted, (C,), and the NIS, (C,)."""
        bank = self.bank
        by_rows = None if fix.rows is None else update & fix.rows.mask
        by_pose = update if by_rows is None else update & ~by_rows
        result = bank.update_pose(by_pose, fix.rotation, fix.position, fix.covariance, fix.coupling)
        if fix.rows is None or by_rows is None:
            return result.accepted, result.nis
        other = bank.update(by_rows, fix.rows.y, *_all_columns(fix.rows))
        return result.accepted | other.accepted, np.where(by_rows, other.nis, result.nis)

    def _pushed(self, refused: Bools, fix: PoseFix) -> Bools:
        """Return the craft (C,) of those whose pose was refused whose prediction `push` could widen for it."""
        y, h = np.empty((len(refused), POSE)), np.empty((len(refused), POSE, STATES))
        innovations_into(refused, fix.rotation, fix.position, self.bank.state, fix.coupling, y, h)
        r = fix.covariance.copy()
        if fix.rows is not None and (by_rows := refused & fix.rows.mask).any():
            for own, given in zip((y, h, r), (fix.rows.y, *_all_columns(fix.rows)), strict=True):
                own[by_rows] = given[by_rows]
        out = np.zeros_like(refused)
        for c in np.flatnonzero(refused).tolist():
            out[c] = self.push(c, y[c], h[c], r[c])
        return out

    def push(self, craft: int, y: Floats, h: Floats, r: Floats) -> bool:
        """Widen the prediction of a craft that has been pushed harder than any of its models has it.

        The push is a jump of the rates at any instant since the last epoch, by the model's acceleration over a period
        times a factor; of the factors `HARDER` the likeliest counts. The models of the craft begin anew.

        Args:
            craft: its index.
            y: (n,), innovations of rows that the gate has refused, although they agree with each other.
            h: (n, 12), their derivatives.
            r: (n, n), covariance of their noise.

        Returns:
            Whether a factor is enough; if not, nothing is changed.
        """
        bank, dt = self.bank, self._frame_s
        before, gate = bank.covariance_of(craft), gates(bank.gate_probability, len(y))[-1]
        sigma = dt * np.repeat([bank.angular_acceleration_noise_rad_s2, bank.acceleration_noise_m_s2], 3)
        best, least = None, np.inf
        for factor in HARDER:
            variance, wide = np.square(factor * sigma), before.copy()
            wide[POSE_COLUMNS, POSE_COLUMNS] += variance * dt**2 / 3
            wide[POSE_COLUMNS, RATE_COLUMNS] += variance * dt / 2
            wide[RATE_COLUMNS, POSE_COLUMNS] += variance * dt / 2
            wide[RATE_COLUMNS, RATE_COLUMNS] += variance
            s = h @ wide @ h.T + r
            nis = y @ np.linalg.solve(s, y)
            if nis <= gate and (loss := nis + np.linalg.slogdet(s)[1]) < least:
                best, least = wide, loss
        if best is None:
            return False
        covariance = bank.covariance
        covariance[craft] = best
        bank.adopt(np.arange(len(bank.active)) == craft, bank.state, covariance)
        return True

    def count(self, pose: Bools, sweeps: Bools, refused: Bools) -> None:
        """Count the time without light and the refusals; stop the filters that exceed a limit.

        Args:
            pose: craft whose filter took in a pose, or rows of as many photodiodes, (C,).
            sweeps: craft whose filter took in single sweeps of fewer photodiodes, (C,).
            refused: craft whose gate refused a pose, or rows of as many photodiodes, (C,).
        """
        ages, limits = (self.since_update_s, self.since_pose_s, self._rejections), self._limits
        given_up = np.empty_like(pose)
        if _count(pose, sweeps, refused, self._frame_s, limits.coast_limit_s, limits.rejections_limit, ages, given_up):
            given_up |= self.bank.beyond(MEANINGLESS_RAD, sweeps)
        self.bank.stop(self.bank.active & given_up)

    def lost(self, time_s: float) -> Bools:
        """Return the craft (C,) with a filter that have had no light for `time_s`, or only single sweeps that leave
        the attitude undecided.
        """
        active = self.bank.active
        out, without = active & (self.since_update_s > time_s), active & (self.since_pose_s > time_s)
        if without.any():
            out |= self.bank.beyond(UNDECIDED_RAD, without)
        return out

    def filtered(self) -> Filtered:
        """Return the filters as they are now; the covariances are for reading only."""
        return Filtered(self.bank.active, self.bank.state, self.bank.covariance_to_read())

    def filtered_where(self, mask: Bools) -> Filtered:
        """Return the filters of the craft of the mask (C,) alone as they are now; the covariances of the others are
        not set.
        """
        return Filtered(self.bank.active, self.bank.state, self.bank.covariance_where(mask))

    def rate_covariance(self, craft: int) -> Floats:
        """Return the covariance (6, 6) of a craft's rates (angular, linear): predicted, or a wide prior."""
        if self.bank.active[craft]:
            covariance: Floats = self.bank.covariance_of(craft)[np.ix_(RATE_COLUMNS, RATE_COLUMNS)]
            return covariance
        return np.diag(np.repeat(np.square(UNKNOWN_RATE), 3))


@kernel
def _ordered_motion_into(
    orders: tuple[Floats, Floats, Floats, Floats],
    unsteered: Bools,
    half_s: float,
    square: float,
    lead_s: float,
    out: Floats,
) -> bool:
    """Write what C craft order between two epochs; return whether any of them orders anything.

    Args:
        orders: angular [rad/s^2] and linear [m/s^2] accelerations of the command before, then of this one, (C, 3) each.
        unsteered: (C,), craft whose turning is known already.
        half_s: half a period [s].
        square: its square [s^2].
        lead_s: time before the period at which this command begins [s].
        out: (4, C, 3), receives turns [rad], angular rates [rad/s], shifts [m] and velocities [m/s].
    """
    some = False
    for order in orders:
        for c in range(len(unsteered)):
            some |= order[c, 0] != 0.0 or order[c, 1] != 0.0 or order[c, 2] != 0.0
    if not some:
        return False
    for kind in range(2):
        before, after = orders[kind], orders[2 + kind]
        for c in range(len(unsteered)):
            counts = 0.0 if kind == 0 and unsteered[c] else 1.0
            for i in range(3):
                a, b = before[c, i] * counts, after[c, i] * counts
                # What the rates have more of this command, and less of the last, when it begins.
                change = (b - a) * lead_s
                out[2 * kind, c, i] = (3 * a + b) * square / 2 + change * half_s
                out[2 * kind + 1, c, i] = (a + b) * half_s + change
    return True


@kernel
def _count(
    pose: Bools,
    sweeps: Bools,
    refused: Bools,
    frame_s: float,
    coast_limit_s: float,
    rejections_limit: int,
    ages: tuple[Floats, Floats, Ints],
    given_up: Bools,
) -> bool:
    """Count time and refusals of C craft, and write whose exceed a limit; return whether any took in single sweeps.

    Args:
        pose: (C,), as in `Tracks.count`.
        sweeps: (C,), likewise.
        refused: (C,), likewise.
        frame_s: length of the period [s].
        coast_limit_s: longest time without light [s].
        rejections_limit: number of refusals that is too many.
        ages: times without light and without a pose [s], and numbers of refusals, (C,) each, changed in place.
        given_up: (C,), receives whose exceed a limit.
    """
    since_update_s, since_pose_s, rejections = ages
    some = False
    for c in range(len(pose)):
        fresh = pose[c] or sweeps[c]
        since_update_s[c] = 0.0 if fresh else since_update_s[c] + frame_s
        since_pose_s[c] = 0.0 if pose[c] else since_pose_s[c] + frame_s
        rejections[c] = 0 if fresh else rejections[c] + refused[c]
        given_up[c] = since_update_s[c] > coast_limit_s or rejections[c] >= rejections_limit
        some = some or sweeps[c]
    return some


def _all_columns(rows: Rows) -> tuple[Floats, Floats]:
    """Return H (C, 6, 12) of rows whose columns are apart, and R (C, 6, 6); those of craft without are not set."""
    craft, who = len(rows.mask), np.flatnonzero(rows.mask)
    h, r, own = np.empty((craft, POSE, STATES)), np.empty((craft, POSE, POSE)), np.zeros((len(who), POSE, STATES))
    own[:, :, POSE_COLUMNS], own[:, :, RATE_COLUMNS] = rows.pose[who], rows.rates[who]
    h[who], r[who] = own, np.eye(POSE)
    return h, r
