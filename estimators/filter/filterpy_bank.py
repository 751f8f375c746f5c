"""The filter of record: `filterpy.kalman.ExtendedKalmanFilter`, one per craft, of `estimators.filter.error_state`'s
equations.

No other file imports filterpy. Its `update` with a 1-D measurement and a 2-D Hx silently broadcasts the state into a
matrix, and its `predict_update` stores the wrong prior: here everything is a column, and `predict` comes before
`update`.
"""

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank, Given
from estimators.filter.error_state import (
    POSE,
    STATES,
    correct,
    process_noise_into,
    propagate,
    transition_into,
)


class PoseFilterBank(FilterBank):
    """A bank of filterpy's filters: the reference, and slow, for it takes a Python loop over the craft."""

    def __init__(self, craft_count: int, **options: float) -> None:
        """Take the options of any `FilterBank`."""
        super().__init__(craft_count, **options)
        self._filter: dict[int, ExtendedKalmanFilter] = {}

    def _begin(self, mask: Bools) -> None:
        for i in np.flatnonzero(mask).tolist():
            f = self._filter[i] = ExtendedKalmanFilter(STATES, POSE)
            f.P = self._covariance[i].copy()

    def _predict(self, mask: Bools, step: Floats) -> None:
        state = self._state
        for i in np.flatnonzero(mask).tolist():
            f = self._filter[i]
            transition_into(state.angular_rate[i], step[i], f.F)
            process_noise_into(step[i], self.acceleration_noise_m_s2, self.angular_acceleration_noise_rad_s2, f.Q)
            f.predict()
            propagate(state.rotation[i], state.angular_rate[i], state.position[i], state.velocity[i], step[i])
            self._covariance[i] = f.P

    def _update(self, mask: Bools, given: Given, accepted: Bools, nis: Floats) -> int:
        state = self._state
        for i in np.flatnonzero(mask).tolist():
            f, n = self._filter[i], given.rows[i]
            h = given.h[i, :n]
            x_prior, p_prior = f.x, f.P
            try:
                # y is a column, as Hx is: filterpy would broadcast a 1-D measurement into a matrix.
                f.update(given.y[i, :n, None], _matrix, _predicted, R=given.r[i, :n, :n], args=(h,), hx_args=(h,))
                nis[i] = f.mahalanobis**2
            except ValueError:  # a singular S, or the root of a negative number
                f.x, f.P = x_prior, p_prior
                return i
            accepted[i] = nis[i] <= given.gate[n]
            if accepted[i]:
                correct(state.rotation[i], state.angular_rate[i], state.position[i], state.velocity[i], f.x)
                self._covariance[i] = f.P
            else:
                f.x, f.P = x_prior, p_prior
        return -1


def _matrix(x: Floats, h: Floats) -> Floats:
    """H, as filterpy asks for it."""
    return h


def _predicted(x: Floats, h: Floats) -> Floats:
    """H x, as filterpy asks for it: zero, for the state is reset after every update."""
    return h @ x
