"""C independent pose filters behind one batch interface, which checks and holds the arrays of either filter.

Two banks stand behind it, of the same equations (`estimators.filter.error_state`): `estimators.filter.filterpy_bank`
runs filterpy, one object per craft; `estimators.filter.compiled` one compiled loop over all craft.
"""

from abc import ABC, abstractmethod
from functools import cache
from math import prod
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.error_state import (
    DEFAULT_ACCELERATION_NOISE_M_S2,
    DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2,
    POSE,
    POSE_COLUMNS,
    RATE_COLUMNS,
    STATES,
    innovations_into,
    transitions_into,
)
from estimators.kernel import inlined, kernel
from estimators.lanes import LANES, any_of, lanes_in
from estimators.pivot import PIVOT
from estimators.rotation import exp
from estimators.state import State


class UpdateResult(NamedTuple):
    """Fates of the measurements of C craft: `accepted` (C,), `nis` (C,), the normalised innovation squared of both
    fates, and `log_determinant` (C,) of the innovation's covariance, NaN where masked out.
    """

    accepted: Bools
    nis: Floats
    log_determinant: Floats


class Given(NamedTuple):
    """Measurements of C craft, checked: y (C, m), h (C, m, 12), r (C, m, m), of which each craft uses its first `rows`
    (C,); gate (M + 1,): the largest normalised innovation squared that is let in, per number of measurements; freedoms
    (C,): numbers of measurements that the rows stand for; square (C,): the part of the normalised innovation squared
    of which the rows tell nothing.
    """

    y: Floats
    h: Floats
    r: Floats
    rows: Ints
    gate: Floats
    freedoms: Ints
    square: Floats


class Poses(NamedTuple):
    """Solved poses of C craft, checked: rotation (C, 3, 3), position (C, 3), covariance (C, 6, 6) and coupling (C, 6,
    6) as in `FilterBank.update_pose`; gate, freedoms, square: as of rows, six per craft.
    """

    rotation: Floats
    position: Floats
    covariance: Floats
    coupling: Floats
    gate: Floats
    freedoms: Ints
    square: Floats

    def rows(self, mask: Bools, state: State) -> Given:
        """Return the same as rows, H = [I B], against the predicted state of the craft of the mask."""
        y, h = np.empty((len(mask), POSE)), np.empty((len(mask), POSE, STATES))
        innovations_into(mask, self.rotation, self.position, state, self.coupling, y, h)
        return Given(y, h, self.covariance, self.freedoms, self.gate, self.freedoms, self.square)


class Independent(NamedTuple):
    """Measurements of C craft whose noise is independent from row to row, checked: as `Given`, with the variances of
    the rows (C, m) in the place of r; pivot (C, PIVOT): points about which corrections turn the bodies.
    """

    y: Floats
    h: Floats
    variance: Floats
    rows: Ints
    gate: Floats
    pivot: Floats
    freedoms: Ints


@cache
def gates(probability: float, rows: int) -> Floats:
    """Return the chi-square quantiles (rows + 1,) for 0, 1, ... `rows` degrees of freedom."""
    out: Floats = 2 * gammaincinv(np.arange(rows + 1) / 2, probability)
    return out


class FilterBank(ABC):
    """C independent pose filters; one craft's numbers never depend on another craft.

    Every array carries the craft axis first and every method a mask (C,) of the craft that it concerns; what stands
    elsewhere in the arguments is not read. Attributes are copies, NaN where a craft is not active. Methods raise
    ValueError, naming the argument, on a wrong shape, on values that are not finite and on craft that are not active.

    The public methods check and hold the arrays; `_begin`, `_predict` and `_update` are the filter itself. Measurements
    come in by `update`, or as poses by `update_pose`, and both end in `_update`.
    """

    def __init__(
        self,
        craft_count: int,
        *,
        acceleration_noise_m_s2: float = DEFAULT_ACCELERATION_NOISE_M_S2,
        angular_acceleration_noise_rad_s2: float = DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2,
        gate_probability: float = 0.99999,
    ) -> None:
        """`gate_probability`: share of consistent measurements let in (chi-square, one freedom per row); 1: all."""
        for name, sigma in (
            ("acceleration_noise_m_s2", acceleration_noise_m_s2),
            ("angular_acceleration_noise_rad_s2", angular_acceleration_noise_rad_s2),
        ):
            if not 0 <= sigma < np.inf:
                raise ValueError(f"{name}: {sigma} is not a finite number, zero or more")
        if not 0 < gate_probability <= 1:
            raise ValueError(f"gate_probability: {gate_probability} is not in (0, 1]")
        self.acceleration_noise_m_s2 = float(acceleration_noise_m_s2)
        self.angular_acceleration_noise_rad_s2 = float(angular_acceleration_noise_rad_s2)
        self.gate_probability = float(gate_probability)
        self._active = np.zeros(craft_count, dtype=np.bool_)
        self._state = State(
            rotation=np.full((craft_count, 3, 3), np.nan),
            position=np.full((craft_count, 3), np.nan),
            velocity=np.full((craft_count, 3), np.nan),
            angular_rate=np.full((craft_count, 3), np.nan),
        )
        self._p = np.full((craft_count, STATES, STATES), np.nan)

    def _covariance(self, mask: Bools) -> Floats:
        """Return P (C, 12, 12), the bank's own, of which those of the craft of the mask are to be read."""
        return self._p

    def _covariance_to_write(self, mask: Bools) -> Floats:
        """Return P (C, 12, 12), the bank's own, of which those of the craft of the mask are to be read or written."""
        return self._covariance(mask)

    @property
    def active(self) -> Bools:
        """The craft (C,) that have a state."""
        return self._active.copy()

    @property
    def gate(self) -> float:
        """The largest normalised innovation squared of a pose that is let in."""
        return float(gates(self.gate_probability, POSE)[POSE])

    @property
    def state(self) -> State:
        """The estimated state of the C craft."""
        return State(
            rotation=self.rotation, position=self.position, velocity=self.velocity, angular_rate=self.angular_rate
        )

    @property
    def rotation(self) -> Floats:
        """R_l_b (C, 3, 3)."""
        return self._state.rotation.copy()

    @property
    def angular_rate(self) -> Floats:
        """Angular rates (C, 3) [rad/s] in the lighthouse frame."""
        return self._state.angular_rate.copy()

    @property
    def position(self) -> Floats:
        """Positions (C, 3) [m]."""
        return self._state.position.copy()

    @property
    def velocity(self) -> Floats:
        """Velocities (C, 3) [m/s]."""
        return self._state.velocity.copy()

    @property
    def covariance(self) -> Floats:
        """P (C, 12, 12): attitude error, angular rate, position, velocity [rad, rad/s, m, m/s]."""
        return self._covariance(np.ones_like(self._active)).copy()

    def covariance_to_read(self) -> Floats:
        """Return P as `covariance` does, for reading only: it may be an array that the bank reads as well."""
        return self.covariance

    def state_where(self, mask: Bools) -> State:
        """Return the states of the craft of the mask (C,) alone; those of the others are not set."""
        return self._state.copied(mask)

    def state_of(self, craft: int) -> State:
        """Return the state of one craft, without the craft axis."""
        return State._make(part.copy() for part in self._state.of(craft))

    def covariance_where(self, mask: Bools) -> Floats:
        """Return P (C, 12, 12) of the craft of the mask (C,) alone; those of the others are not set."""
        out = np.empty_like(self._p)
        _copy_where(mask, self._covariance(mask), out)
        return out

    def covariance_of(self, craft: int) -> Floats:
        """Return P (12, 12) of one craft."""
        mask = np.zeros_like(self._active)
        mask[craft] = True
        out: Floats = self._covariance(mask)[craft].copy()
        return out

    def beyond(self, attitude_rad: float, mask: Bools) -> Bools:
        """Return which craft (C,) of the mask are active with a larger standard deviation of attitude than this."""
        out = mask & self._active
        if out.any():
            _keep_beyond(out, self._covariance(out), attitude_rad**2)
        return out

    def start(
        self,
        mask: Bools,
        rotation: Floats,
        position: Floats,
        covariance: Floats,
        rate_sigma: tuple[float, float],
        rate_coupling: Floats | None = None,
    ) -> None:
        """Start, or start again, from a solved pose, at rest within `rate_sigma`.

        Args:
            mask: (C,), the craft concerned.
            rotation: (C, 3, 3) R_l_b.
            position: (C, 3) [m].
            covariance: (C, 6, 6) of the pose [rad, m].
            rate_sigma: one sigma per axis of the unknown angular rate [rad/s] and velocity [m/s].
            rate_coupling: (C, 6, 6) [s], B of a pose that was solved as if at rest, which is therefore off by B times
                the rates; None: zero.
        """
        mask = self._checked(mask, active=False)
        if not mask.any():
            return
        rotation = self._argument("rotation", rotation, (3, 3), mask)
        position = self._argument("position", position, (3,), mask)
        covariance = self._covariances("covariance", covariance, POSE, mask)
        b = np.zeros((len(mask), POSE, POSE)) if rate_coupling is None else rate_coupling
        b = self._argument("rate_coupling", b, (POSE, POSE), mask)
        if np.shape(rate_sigma) != (2,) or not np.all(np.greater_equal(rate_sigma, 0) & np.isfinite(rate_sigma)):
            raise ValueError(f"rate_sigma: expected two finite sigmas (angular rate, velocity), got {rate_sigma!r}")
        craft = np.flatnonzero(mask)
        rate_variance = np.repeat(np.square(rate_sigma), 3)
        # Solved as if at rest: true pose + B rates + noise, so truth minus estimate is -B rates - noise.
        cross = -b[craft] * rate_variance
        p = np.zeros((len(craft), STATES, STATES))
        moved = np.einsum("cab,cdb->cad", cross, b[craft])
        p[:, POSE_COLUMNS[:, None], POSE_COLUMNS] = covariance[craft] - moved
        p[:, POSE_COLUMNS[:, None], RATE_COLUMNS] = cross
        p[:, RATE_COLUMNS[:, None], POSE_COLUMNS] = np.swapaxes(cross, 1, 2)
        p[:, RATE_COLUMNS, RATE_COLUMNS] = rate_variance
        self._covariance_to_write(mask)[craft] = p
        state = self._state
        state.rotation[craft], state.position[craft] = rotation[craft], position[craft]
        state.angular_rate[craft] = state.velocity[craft] = 0.0
        self._active[craft] = True
        self._begin(mask)

    def predict(self, dt: float | Floats, mask: Bools) -> None:
        """Move on by `dt`, a number or (C,) [s], over which the accelerations are taken as constant.

        A longer gap is several calls of one period each: the process noise of one long step is another model.
        """
        mask = self._checked(mask)
        if isinstance(dt, float) and 0 <= dt < np.inf:
            self._predict(mask, np.full(len(mask), dt))
            return
        every = np.asarray(dt, dtype=np.float64)
        step = self._argument("dt", np.full(len(mask), every) if every.ndim == 0 else every, (), mask)
        if np.any(step[mask] < 0):
            raise ValueError(f"dt: {step[mask].min()} s is negative")
        self._predict(mask, step)

    def transition(self, dt: float) -> Floats:
        """Return F (C, 12, 12) of the next `predict` by `dt` [s], from the states as they are; NaN where inactive."""
        out = np.full_like(self._p, np.nan)
        transitions_into(self._active, self._state.angular_rate, np.full(len(self._active), float(dt)), out)
        return out

    def add_motion(
        self,
        mask: Bools,
        turn: Floats,
        rate: Floats,
        shift: Floats,
        velocity: Floats,
        coupling: Floats | None = None,
    ) -> None:
        """Add known motion to the prediction, as of the craft's own actuators.

        Args:
            mask: (C,), the craft concerned.
            turn: (C, 3) [rad], R <- Exp([turn]x) R.
            rate: (C, 3) [rad/s], added to the angular rate.
            shift: (C, 3) [m], added to the position.
            velocity: (C, 3) [m/s], added to the velocity.
            coupling: (C, 6, 6), what the motion makes of an error of attitude and angular rate; None: leaves it as it
                is, and the covariance.
        """
        mask = self._checked(mask)
        turn, rate = self._argument("turn", turn, (3,), mask), self._argument("rate", rate, (3,), mask)
        shift = self._argument("shift", shift, (3,), mask)
        velocity = self._argument("velocity", velocity, (3,), mask)
        state = self._state
        state.rotation[mask] = exp(turn[mask]) @ state.rotation[mask]
        state.angular_rate[mask] += rate[mask]
        state.position[mask] += shift[mask]
        state.velocity[mask] += velocity[mask]
        if coupling is not None:
            coupling = self._argument("coupling", coupling, (POSE, POSE), mask)
            _couple_all(mask, coupling, self._covariance_to_write(mask))
            self._changed(mask)

    def update(
        self,
        mask: Bools,
        y: Floats,
        h: Floats,
        r: Floats,
        count: Ints | None = None,
        pivot: Floats | None = None,
        freedoms: Ints | None = None,
        square: Floats | None = None,
    ) -> UpdateResult:
        """Take in measurements y = H x + noise, gated per craft; a craft whose rows are gated out keeps its state.

        Args:
            mask: (C,), the craft concerned.
            y: (C, m), innovations: measured minus predicted.
            h: (C, m, 12), derivatives H by the error state x.
            r: (C, m, m), covariances of the noise; or (C, m), variances of rows with independent noise.
            count: (C,), the number of rows of each craft, the first of the m; None: all m.
            pivot: (C, PIVOT) [m]: where large corrections turn the bodies about, with independent rows
                (`estimators.pivot`); None: their origins.
            freedoms: (C,), the numbers of measurements that the rows stand for, as the sums of many in fewer rows; the
                gate is that of as many. None: every row is one.
            square: (C,), with covariances: the part of the normalised innovation squared of these measurements of
                which the rows tell nothing; None: zero.

        Raises:
            ValueError: a wrong shape, a value that is not finite, a covariance that is not positive definite, a craft
                that is not active; the message names the argument.
        """
        mask = self._checked(mask)
        if np.ndim(y) != 2:
            raise ValueError(f"y: expected shape (craft, rows), got {np.shape(y)}")
        craft, rows = len(mask), np.shape(y)[1]
        used = np.full(craft, rows) if count is None else np.ascontiguousarray(count, dtype=np.int64)
        if used.shape != (craft,) or np.any((used < 0) | (used > rows)):
            raise ValueError(f"count: expected {(craft,)} numbers from 0 to {rows}")
        free, most = used, rows
        if freedoms is not None and freedoms is not count:
            free = np.ascontiguousarray(freedoms, dtype=np.int64)
            if free.shape != (craft,) or np.any(free[mask] < 0):
                raise ValueError(f"freedoms: expected {(craft,)} numbers, zero or more")
            most = int(free[mask].max(initial=rows))
        gate = gates(self.gate_probability, most)
        if np.ndim(r) == 2:
            independent = self._independent(mask, y, h, r, used, gate, pivot, free)
            return self._taken("r", mask & (used > 0), independent)
        more = self._argument("square", np.zeros(craft) if square is None else square, (), mask)
        if count is None:
            y, h = self._argument("y", y, (rows,), mask), self._argument("h", h, (rows, STATES), mask)
            return self._taken("r", mask, Given(y, h, self._covariances("r", r, rows, mask), used, gate, free, more))
        there = np.arange(rows) < used[:, None]
        # Rows that a craft does not have are not read: whatever stands there becomes zero.
        y = self._argument("y", np.where(there, y, 0.0), (rows,), mask)
        h = np.where(there[:, :, None], self._shaped("h", h, (rows, STATES)), 0.0)
        h = self._argument("h", h, (rows, STATES), mask)
        both = there[:, :, None] & there[:, None, :]
        r = np.where(both, self._shaped("r", r, (rows, rows)), np.eye(rows))
        r = self._covariances("r", r, rows, mask)
        return self._taken("r", mask & (used > 0), Given(y, h, r, used, gate, free, more))

    def _independent(
        self,
        mask: Bools,
        y: Floats,
        h: Floats,
        r: Floats,
        used: Ints,
        gate: Floats,
        pivot: Floats | None,
        freedoms: Ints,
    ) -> Independent:
        """Return rows of independent noise, checked; the arguments are those of `update`, and of `Given`."""
        craft, rows = np.shape(y)
        out = Independent(
            self._shaped("y", y, (rows,)),
            self._shaped("h", h, (rows, STATES)),
            self._shaped("r", r, (rows,)),
            used,
            gate,
            self._argument("pivot", np.zeros((craft, PIVOT)) if pivot is None else pivot, (PIVOT,), mask),
            freedoms,
        )
        if (wrong := _wrong_row(mask, out)) >= 0:
            reason = ("not finite", "not finite", "a variance is not positive and finite")[wrong]
            raise ValueError(f"{'yhr'[wrong]}: {reason} for a craft of the mask")
        return out

    def update_pose(
        self, mask: Bools, rotation: Floats, position: Floats, covariance: Floats, rate_coupling: Floats
    ) -> UpdateResult:
        """Take in solved poses: `update` with H = [I B].

        Args:
            mask: (C,), the craft concerned.
            rotation: (C, 3, 3) R_l_b.
            position: (C, 3) [m].
            covariance: (C, 6, 6) of the pose [rad, m].
            rate_coupling: (C, 6, 6) [s], B of a pose that was solved with this filter's predicted rates; zero where it
                was solved without.

        Raises:
            ValueError: as `update`.
        """
        mask = self._checked(mask)
        if not mask.any():
            return self._nothing()
        rotation, position = self._shaped("rotation", rotation, (3, 3)), self._shaped("position", position, (3,))
        covariance = self._shaped("covariance", covariance, (POSE, POSE))
        rate_coupling = self._shaped("rate_coupling", rate_coupling, (POSE, POSE))
        fours = (array.reshape(len(mask), -1, LANES) for array in (covariance, rate_coupling))
        if (wrong := _wrong_pose(mask, rotation.reshape(-1, 9), position, *fours)) >= 0:
            name = ("rotation", "position", "covariance", "rate_coupling", "covariance")[wrong]
            reason = "a variance is not positive" if wrong == 4 else "not finite"
            raise ValueError(f"{name}: {reason} for a craft of the mask")
        terms = gates(self.gate_probability, POSE), np.full(len(mask), POSE), np.zeros(len(mask))
        return self._taken("covariance", mask, Poses(rotation, position, covariance, rate_coupling, *terms))

    def adopt(self, mask: Bools, state: State, covariance: Floats) -> None:
        """Take over states and covariances, and start the craft that are not active.

        Args:
            mask: (C,), the craft concerned.
            state: of the C craft.
            covariance: (C, 12, 12).
        """
        for own, given in zip((*self._state, self._covariance_to_write(mask)), (*state, covariance), strict=True):
            own[mask] = given[mask]
        self._active[mask] = True
        self._begin(mask)

    def stop(self, mask: Bools) -> None:
        """Forget the state of these craft."""
        mask = self._checked(mask, active=False)
        if mask.any():
            self._active[mask] = False
            for array in (*self._state, self._covariance_to_write(mask)):
                array[mask] = np.nan

    @abstractmethod
    def _begin(self, mask: Bools) -> None:
        """Set up the filters of these craft, whose arrays have just been filled."""

    def _changed(self, mask: Bools) -> None:
        """Take over the covariances of these craft from the arrays, where they have just been changed."""
        self._begin(mask)

    @abstractmethod
    def _predict(self, mask: Bools, step: Floats) -> None:
        """Move these craft on by `step` (C,) [s]."""

    @abstractmethod
    def _update(self, mask: Bools, given: Given | Independent | Poses, result: UpdateResult) -> int:
        """Take in the rows or poses of these craft, and write their fates.

        Returns -1, or the first craft whose covariance of the innovation is not positive definite.
        """

    def _taken(self, name: str, mask: Bools, given: Given | Independent | Poses) -> UpdateResult:
        """Update with what has been checked; `name` is the argument to blame for an indefinite covariance."""
        result = self._nothing()
        indefinite = self._update(mask, given, result)
        if indefinite >= 0:
            raise ValueError(f"{name}: not positive definite for craft {indefinite}")
        return result

    def _nothing(self) -> UpdateResult:
        craft = len(self._active)
        return UpdateResult(np.zeros(craft, dtype=np.bool_), np.full(craft, np.nan), np.full(craft, np.nan))

    def _checked(self, mask: Bools, active: bool = True) -> Bools:
        """The mask; all the craft that it names must be active if `active`."""
        mask = np.ascontiguousarray(mask)
        if mask.shape != self._active.shape or mask.dtype != np.bool_:
            raise ValueError(f"mask: expected {self._active.shape} bool, got {mask.shape} {mask.dtype}")
        if active and (mask & ~self._active).any():
            raise ValueError(f"mask: craft {np.flatnonzero(mask & ~self._active).tolist()} have not been started")
        return mask

    def _shaped(self, name: str, value: Floats, shape: tuple[int, ...]) -> Floats:
        """Return `value` as contiguous floats (C, *shape)."""
        array = np.ascontiguousarray(value, dtype=np.float64)
        expected = (len(self._active), *shape)
        if array.shape != expected:
            raise ValueError(f"{name}: expected shape {expected}, got {array.shape}")
        return array

    def _argument(self, name: str, value: Floats, shape: tuple[int, ...], mask: Bools) -> Floats:
        """Return `value` as contiguous floats (C, *shape), finite for these craft."""
        array = self._shaped(name, value, shape)
        if not _finite(array.reshape(len(mask), prod(shape)), mask):
            raise ValueError(f"{name}: not finite for a craft of the mask")
        return array

    def _covariances(self, name: str, value: Floats, rows: int, mask: Bools) -> Floats:
        """Return `value` as covariances (C, rows, rows), with positive variances for these craft."""
        array = self._argument(name, value, (rows, rows), mask)
        if not _positive_diagonal(array, mask):
            raise ValueError(f"{name}: a variance is not positive for a craft of the mask")
        return array


@kernel
def _copy_where(mask: Bools, given: Floats, out: Floats) -> None:
    """Copy matrices (C, n, n) of the craft of the mask."""
    for c in range(len(mask)):
        if mask[c]:
            for i in range(given.shape[1]):
                for j in range(given.shape[2]):
                    out[c, i, j] = given[c, i, j]


@kernel
def _keep_beyond(mask: Bools, covariance: Floats, variance: float) -> None:
    """Keep the craft of the mask (C,) whose sum of the three variances of the attitude exceeds `variance` [rad^2]."""
    for c in range(len(mask)):
        p = covariance[c]
        mask[c] = mask[c] and p[0, 0] + p[1, 1] + p[2, 2] > variance


@kernel
def _finite(array: Floats, mask: Bools) -> bool:
    """Return whether all of `array` (C, n) is finite for the craft of the mask."""
    finite = True
    for c in range(len(mask)):
        if mask[c]:
            for i in range(array.shape[1]):
                finite &= abs(array[c, i]) < np.inf
    return finite


@inlined
def _are_finite(row: Floats) -> bool:
    """Return whether a row (n,) of numbers or of lanes is finite, without a branch for each: zero times a number is
    zero, or NaN where the number is not finite.
    """
    total = 0.0 * row[0]
    for i in range(1, len(row)):
        total += 0.0 * row[i]
    return not any_of(total != 0.0)


@kernel
def _wrong_row(mask: Bools, given: Independent) -> int:
    """Return 0, 1 or 2 if y, H or a variance of a craft of the mask is not as it must be; -1 if all are."""
    for c in range(len(mask)):
        if not mask[c]:
            continue
        for a in range(given.rows[c]):
            if not np.isfinite(given.y[c, a]):
                return 0
            for i in range(STATES):
                if not np.isfinite(given.h[c, a, i]):
                    return 1
            if not 0 < given.variance[c, a] < np.inf:
                return 2
    return -1


@kernel
def _wrong_pose(mask: Bools, rotation: Floats, position: Floats, covariance: Floats, coupling: Floats) -> int:
    """Return the argument, counted from 0, that is not finite for a craft of the mask; 4 if a variance is not positive,
    -1 if all are as they must be. rotation (C, 9), covariance and coupling (C, 9, 4), numbers of their matrices.
    """
    covariances, couplings = lanes_in(covariance), lanes_in(coupling)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        if not _are_finite(rotation[c]):
            return 0
        if not _are_finite(position[c]):
            return 1
        if not _are_finite(covariances[c]):
            return 2
        if not _are_finite(couplings[c]):
            return 3
        for i in range(0, POSE * POSE, POSE + 1):
            if not covariance[c, i // LANES, i % LANES] > 0:
                return 4
    return -1


@kernel
def _positive_diagonal(matrix: Floats, mask: Bools) -> bool:
    """Return whether the diagonals of `matrix` (C, n, n) are positive for the craft of the mask."""
    for c in range(len(mask)):
        if mask[c]:
            for i in range(matrix.shape[1]):
                if not matrix[c, i, i] > 0:
                    return False
    return True


@kernel
def couple(m: Floats, p: Floats, half: Floats) -> None:
    """Multiply the errors of attitude and angular rate by a matrix, in their covariance, of numbers or of lanes.

    Args:
        m: (6, 6), numbers.
        p: (12, 12), P, in place.
        half: (6, 12), workspace.
    """
    for i in range(6):
        for j in range(STATES):
            value = m[i, 0] * p[0, j]
            for k in range(1, 6):
                value += m[i, k] * p[k, j]
            half[i, j] = value
    for i in range(6):
        for j in range(i + 1):
            value = half[i, 0] * m[j, 0]
            for k in range(1, 6):
                value += half[i, k] * m[j, k]
            p[i, j] = p[j, i] = value
        for j in range(6, STATES):
            p[i, j] = p[j, i] = half[i, j]


@kernel
def _couple_all(mask: Bools, coupling: Floats, covariance: Floats) -> None:
    """`couple` for the craft of the mask: coupling (C, 6, 6), covariance (C, 12, 12)."""
    half = np.empty((6, STATES))
    for c in range(len(mask)):
        if mask[c]:
            couple(coupling[c], covariance[c], half)
