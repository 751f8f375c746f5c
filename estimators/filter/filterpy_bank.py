"""The filter of record: `filterpy.kalman.ExtendedKalmanFilter`, one per craft, of `estimators.filter.error_state`'s
equations.

No other file imports filterpy. Its `update` with a 1-D measurement and a 2-D Hx silently broadcasts the state into a
matrix, and its `predict_update` stores the wrong prior: here everything is a column, and `predict` comes before
`update`.
"""

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank
from estimators.filter.error_state import (
    POSE,
    STATES,
    correct,
    innovation_into,
    process_noise_into,
    propagate,
    transition_into,
)


class PoseFilterBank(FilterBank):
    """A bank of filterpy's filters: the reference, and slow, for it takes a Python loop over the craft."""

    def __init__(self, craft_count: int, **options: float) -> None:
        """As of any `FilterBank`."""
        super().__init__(craft_count, **options)
        self._filter: dict[int, ExtendedKalmanFilter] = {}

    def _begin(self, mask: Bools) -> None:
        for i in np.flatnonzero(mask).tolist():
            f = self._filter[i] = ExtendedKalmanFilter(STATES, POSE)
            f.P = self._covariance[i].copy()

    def _predict(self, mask: Bools, step: Floats) -> None:
        for i in np.flatnonzero(mask).tolist():
            f = self._filter[i]
            transition_into(self._angular_rate[i], step[i], f.F)
            process_noise_into(step[i], self.acceleration_noise_m_s2, self.angular_acceleration_noise_rad_s2, f.Q)
            f.predict()
            propagate(self._rotation[i], self._angular_rate[i], self._position[i], self._velocity[i], step[i])
            self._covariance[i] = f.P

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
        y, h = np.empty((POSE, 1)), np.empty((POSE, STATES))
        for i in np.flatnonzero(mask).tolist():
            f = self._filter[i]
            innovation_into(rotation[i], position[i], self._rotation[i], self._position[i], rate_coupling[i], y, h)
            x_prior, p_prior = f.x, f.P
            try:
                # y is a column, as Hx is: filterpy would broadcast a 1-D measurement into a matrix.
                f.update(y, _matrix, _predicted, R=covariance[i], args=(h,), hx_args=(h,))
                nis[i] = f.mahalanobis**2
            except ValueError as error:  # a singular S, or the root of a negative number
                f.x, f.P = x_prior, p_prior
                raise ValueError(f"covariance: not positive definite for craft {i}") from error
            accepted[i] = nis[i] <= self.gate
            if accepted[i]:
                correct(self._rotation[i], self._angular_rate[i], self._position[i], self._velocity[i], f.x)
                self._covariance[i] = f.P
            else:
                f.x, f.P = x_prior, p_prior


def _matrix(x: Floats, h: Floats) -> Floats:
    """H, as filterpy asks for it."""
    return h


def _predicted(x: Floats, h: Floats) -> Floats:
    """H x, as filterpy asks for it: zero, for the state is reset after every update."""
    return h @ x
