"""The filter of record: `filterpy.kalman.ExtendedKalmanFilter`, one per craft, of `estimators.filter.error_state`'s
equations.

No other file imports filterpy, which brings scipy.stats and takes most of a second: only who makes such a filter pays
for it. Its `update` with a 1-D measurement and a 2-D Hx silently broadcasts the state into a matrix, and its
`predict_update` stores the wrong prior: here everything is a column, and `predict` comes before `update`.
"""

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank, Given, Independent, Poses, UpdateResult
from estimators.filter.error_state import (
    POSE,
    STATES,
    correct,
    process_noise_into,
    propagate,
    transition_into,
)
from estimators.pivot import ARMS, is_wide, shear, turn_about

if TYPE_CHECKING:
    from filterpy.kalman import ExtendedKalmanFilter

ErrorFilter: TypeAlias = "ExtendedKalmanFilter"
"""The type of `error_filter`'s filter."""


class PoseFilterBank(FilterBank):
    """A bank of filterpy's filters: the reference, and slow, for it takes a Python loop over the craft."""

    def __init__(self, craft_count: int, **options: float) -> None:
        """Take the options of any `FilterBank`."""
        super().__init__(craft_count, **options)
        self._filter: dict[int, ErrorFilter] = {}

    def _begin(self, mask: Bools) -> None:
        for i in np.flatnonzero(mask).tolist():
            if i not in self._filter:
                self._filter[i] = error_filter()
            f = self._filter[i]
            f.P = self._p[i].copy()

    def _predict(self, mask: Bools, step: Floats) -> None:
        state = self._state
        for i in np.flatnonzero(mask).tolist():
            f = self._filter[i]
            transition_into(state.angular_rate[i], step[i], f.F)
            process_noise_into(step[i], self.acceleration_noise_m_s2, self.angular_acceleration_noise_rad_s2, f.Q)
            f.predict()
            propagate(state.rotation[i], state.angular_rate[i], state.position[i], state.velocity[i], step[i])
            self._p[i] = f.P

    def _update(self, mask: Bools, given: Given | Independent | Poses, result: UpdateResult) -> int:
        if isinstance(given, Poses):
            given = given.rows(mask, self._state)
        for i in np.flatnonzero(mask).tolist():
            n = given.rows[i]
            noise = np.diag(given.variance[i, :n]) if isinstance(given, Independent) else given.r[i, :n, :n]
            more = 0.0 if isinstance(given, Independent) else given.square[i]
            gate = given.gate[given.freedoms[i]]
            x = self._take(i, (given.y[i, :n], given.h[i, :n], noise), more, gate, result)
            if x is None:
                return i
            if not result.accepted[i]:
                continue
            s, f = self._state.of(i), self._filter[i]
            if isinstance(given, Independent):
                arms = np.empty(ARMS)
                turn_about(s.rotation, s.angular_rate, s.position, s.velocity, x[:, 0], given.pivot[i], arms)
                if is_wide(f.P):
                    shear(f.P, arms)
                x[:] = 0.0
            else:
                correct(s.rotation, s.angular_rate, s.position, s.velocity, x[:, 0])
            self._p[i] = f.P
        return -1

    def _take(
        self, i: int, given: tuple[Floats, Floats, Floats], more: float, gate: float, result: UpdateResult
    ) -> Floats | None:
        """Return the estimated error (12, 1) by the rows of one craft; None if its innovation's covariance is not
        positive definite.

        Args:
            i: the craft.
            given: y (n,), innovations, H (n, 12), and the covariance R (n, n) of the noise.
            more: part of the normalised innovation squared of which the rows tell nothing.
            gate: largest normalised innovation squared that is let in.
            result: receives the fate.
        """
        f = self._filter[i]
        x_prior, p_prior = f.x, f.P
        if (fate := taken_by(f, *given)) is None:
            return None
        result.nis[i], result.log_determinant[i] = fate[0] + more, fate[1]
        result.accepted[i] = result.nis[i] <= gate
        if not result.accepted[i]:
            f.x, f.P = x_prior, p_prior
        return f.x  # type: ignore[no-any-return]


def error_filter(models: int = 1) -> ErrorFilter:
    """Return one filter of the error states of so many models."""
    from filterpy.kalman import ExtendedKalmanFilter

    return ExtendedKalmanFilter(models * STATES, models * POSE)


def taken_by(f: ErrorFilter, y: Floats, h: Floats, r: Floats) -> tuple[float, float] | None:
    """Update a filter with rows, and return NIS and log det S; None, and nothing is changed, where S is not positive.

    Args:
        f: the filter, with its error estimate x and covariance P.
        y: (n,), measurements of H x.
        h: (n, 12), H.
        r: (n, n), covariance of the noise.
    """
    x_prior, p_prior = f.x, f.P
    # y is a column, as Hx is: filterpy would broadcast a 1-D measurement into a matrix.
    if updated(f, y[:, None], h, r):
        try:
            return f.mahalanobis**2, np.linalg.slogdet(f.S)[1]
        except ValueError:  # the root of a negative number
            pass
    f.x, f.P = x_prior, p_prior
    return None


def updated(f: ErrorFilter, y: Floats, h: Floats, r: Floats) -> bool:
    """Update a filter with rows; return False where S is singular or not finite.

    Args:
        f: the filter, with its error estimate x and covariance P.
        y: (n, 1), measurements of H x.
        h: (n, m), H.
        r: (n, n), covariance of the noise.
    """
    try:
        f.update(y, _matrix, _predicted, R=r, args=(h,), hx_args=(h,))
    except ValueError:  # numpy.linalg.LinAlgError is one
        return False
    return True


def _matrix(x: Floats, h: Floats) -> Floats:
    """H, as filterpy asks for it."""
    return h


def _predicted(x: Floats, h: Floats) -> Floats:
    """H x, as filterpy asks for it: zero, for the state is reset after every update."""
    return h @ x
