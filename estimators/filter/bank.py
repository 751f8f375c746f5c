"""C independent pose filters behind one batch interface: what it checks and holds, whichever filter runs inside.

Two banks stand behind it, of the same equations (`estimators.filter.error_state`): `estimators.filter.filterpy_bank`
runs filterpy, one object per craft; `estimators.filter.compiled` one compiled loop over all craft.
"""

from abc import ABC, abstractmethod
from math import prod
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

from estimators.arrays import Bools, Floats
from estimators.filter.error_state import (
    DEFAULT_ACCELERATION_NOISE_M_S2,
    DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2,
    POSE,
    POSE_COLUMNS,
    RATE_COLUMNS,
    STATES,
)
from estimators.kernel import kernel
from estimators.rotation import exp


class UpdateResult(NamedTuple):
    """`accepted` (C,), and `nis` (C,), the normalised innovation squared of both fates, NaN where masked out."""

    accepted: Bools
    nis: Floats


class FilterBank(ABC):
    """C independent pose filters; one craft's numbers never depend on another craft.

    Every array carries the craft axis first and every method a mask (C,) of the craft that it concerns; what stands
    elsewhere in the arguments is not read. Attributes are copies, NaN where a craft is not active. Methods raise
    ValueError, naming the argument, on a wrong shape, on values that are not finite and on craft that are not active.

    The public methods check and hold the arrays; `_begin`, `_predict` and `_update` are the filter itself.
    """

    def __init__(
        self,
        craft_count: int,
        *,
        acceleration_noise_m_s2: float = DEFAULT_ACCELERATION_NOISE_M_S2,
        angular_acceleration_noise_rad_s2: float = DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2,
        gate_probability: float = 0.99999,
    ) -> None:
        """`gate_probability`: share of consistent measurements (chi-square, 6 degrees of freedom) let in; 1: all."""
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
        self.gate = float(2 * gammaincinv(POSE / 2, gate_probability))
        self._active = np.zeros(craft_count, dtype=np.bool_)
        self._rotation = np.full((craft_count, 3, 3), np.nan)
        self._angular_rate, self._position, self._velocity = np.full((3, craft_count, 3), np.nan)
        self._covariance = np.full((craft_count, STATES, STATES), np.nan)

    @property
    def active(self) -> Bools:
        """Which craft (C,) have a state."""
        return self._active.copy()

    @property
    def rotation(self) -> Floats:
        """R_l_b (C, 3, 3)."""
        return self._rotation.copy()

    @property
    def angular_rate(self) -> Floats:
        """Angular rates (C, 3) [rad/s] in the lighthouse frame."""
        return self._angular_rate.copy()

    @property
    def position(self) -> Floats:
        """Positions (C, 3) [m]."""
        return self._position.copy()

    @property
    def velocity(self) -> Floats:
        """Velocities (C, 3) [m/s]."""
        return self._velocity.copy()

    @property
    def covariance(self) -> Floats:
        """P (C, 12, 12): attitude error, angular rate, position, velocity [rad, rad/s, m, m/s]."""
        return self._covariance.copy()

    def start(
        self,
        mask: Bools,
        rotation: Floats,
        position: Floats,
        covariance: Floats,
        rate_sigma: tuple[float, float],
        rate_coupling: Floats | None = None,
    ) -> None:
        """Start, or start again, from a solved pose, at rest give or take `rate_sigma`.

        rotation (C, 3, 3), position (C, 3) [m], covariance (C, 6, 6) of the pose [rad, m]; `rate_sigma`: one sigma per
        axis of the unknown (angular rate [rad/s], velocity [m/s]); `rate_coupling` (C, 6, 6) [s]: B of this pose where
        it was solved as if at rest, so that the filter knows that the pose is off by B times the rates.
        """
        mask = self._checked(mask, active=False)
        if not mask.any():
            return
        rotation = self._argument("rotation", rotation, (3, 3), mask)
        position = self._argument("position", position, (3,), mask)
        covariance = self._variances(self._argument("covariance", covariance, (POSE, POSE), mask), mask)
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
        self._covariance[craft] = p
        self._rotation[craft], self._position[craft] = rotation[craft], position[craft]
        self._angular_rate[craft] = self._velocity[craft] = 0.0
        self._active[craft] = True
        self._begin(mask)

    def predict(self, dt: float | Floats, mask: Bools) -> None:
        """Move on by `dt`, a number or (C,) [s], over which the accelerations are taken as constant.

        A longer gap is several calls of one period each: the process noise of one long step is another model.
        """
        mask = self._checked(mask)
        every = np.asarray(dt, dtype=np.float64)
        step = self._argument("dt", np.full(len(mask), every) if every.ndim == 0 else every, (), mask)
        if np.any(step[mask] < 0):
            raise ValueError(f"dt: {step[mask].min()} s is negative")
        self._predict(mask, step)

    def add_motion(self, mask: Bools, turn: Floats, rate: Floats, shift: Floats, velocity: Floats) -> None:
        """Add known motion to the prediction: what the craft's own actuators did meanwhile.

        turn (C, 3) [rad], R <- Exp([turn]x) R; rate (C, 3) [rad/s]; shift (C, 3) [m]; velocity (C, 3) [m/s]. Known
        exactly, it leaves the covariance as it is.
        """
        mask = self._checked(mask)
        turn, rate = self._argument("turn", turn, (3,), mask), self._argument("rate", rate, (3,), mask)
        shift = self._argument("shift", shift, (3,), mask)
        velocity = self._argument("velocity", velocity, (3,), mask)
        self._rotation[mask] = exp(turn[mask]) @ self._rotation[mask]
        self._angular_rate[mask] += rate[mask]
        self._position[mask] += shift[mask]
        self._velocity[mask] += velocity[mask]

    def update(
        self, mask: Bools, rotation: Floats, position: Floats, covariance: Floats, rate_coupling: Floats
    ) -> UpdateResult:
        """Take in solved poses, each gated by itself: one that is gated out leaves its craft's state as it was.

        rotation (C, 3, 3), position (C, 3) [m], covariance (C, 6, 6) of the pose [rad, m], rate_coupling (C, 6, 6) [s]:
        B of a pose that was solved with this filter's predicted rates; zero where it was solved without.
        """
        mask = self._checked(mask)
        rotation = self._argument("rotation", rotation, (3, 3), mask)
        position = self._argument("position", position, (3,), mask)
        covariance = self._variances(self._argument("covariance", covariance, (POSE, POSE), mask), mask)
        rate_coupling = self._argument("rate_coupling", rate_coupling, (POSE, POSE), mask)
        accepted, nis = np.zeros(len(mask), dtype=np.bool_), np.full(len(mask), np.nan)
        self._update(mask, rotation, position, covariance, rate_coupling, accepted, nis)
        return UpdateResult(accepted, nis)

    def stop(self, mask: Bools) -> None:
        """Forget the state of these craft."""
        mask = self._checked(mask, active=False)
        if mask.any():
            self._active[mask] = False
            for array in (self._rotation, self._angular_rate, self._position, self._velocity, self._covariance):
                array[mask] = np.nan

    @abstractmethod
    def _begin(self, mask: Bools) -> None:
        """Set up the filters of these craft, whose arrays have just been filled."""

    @abstractmethod
    def _predict(self, mask: Bools, step: Floats) -> None:
        """Move these craft on by `step` (C,) [s]."""

    @abstractmethod
    def _update(
        self,
        mask: Bools,
        rotation: Floats,
        position: Floats,
        covariance: Floats,
        rate_coupling: Floats,
        accepted: Bools,
        nis: Floats,
    ) -> None:
        """Take in the poses of these craft; write what became of them into `accepted` and `nis`."""

    def _checked(self, mask: Bools, active: bool = True) -> Bools:
        """The mask; all the craft that it names must be active if `active`."""
        mask = np.ascontiguousarray(mask)
        if mask.shape != self._active.shape or mask.dtype != np.bool_:
            raise ValueError(f"mask: expected {self._active.shape} bool, got {mask.shape} {mask.dtype}")
        if active and (mask & ~self._active).any():
            raise ValueError(f"mask: craft {np.flatnonzero(mask & ~self._active).tolist()} have not been started")
        return mask

    def _argument(self, name: str, value: Floats, shape: tuple[int, ...], mask: Bools) -> Floats:
        """`value` as contiguous floats (C, *shape), finite for these craft."""
        array = np.ascontiguousarray(value, dtype=np.float64)
        expected = (len(self._active), *shape)
        if array.shape != expected:
            raise ValueError(f"{name}: expected shape {expected}, got {array.shape}")
        if not _finite(array.reshape(len(mask), prod(shape)), mask):
            raise ValueError(f"{name}: not finite for a craft of the mask")
        return array

    def _variances(self, covariance: Floats, mask: Bools) -> Floats:
        """`covariance`, with positive variances for these craft."""
        if not _positive_diagonal(covariance, mask):
            raise ValueError("covariance: a variance is not positive for a craft of the mask")
        return covariance


@kernel
def _finite(array: Floats, mask: Bools) -> bool:
    """Whether all of `array` (C, n) is finite for the craft of the mask."""
    for c in range(len(mask)):
        if mask[c]:
            for i in range(array.shape[1]):
                if not np.isfinite(array[c, i]):
                    return False
    return True


@kernel
def _positive_diagonal(matrix: Floats, mask: Bools) -> bool:
    """Whether the diagonals of `matrix` (C, n, n) are positive for the craft of the mask."""
    for c in range(len(mask)):
        if mask[c]:
            for i in range(matrix.shape[1]):
                if not matrix[c, i, i] > 0:
                    return False
    return True
