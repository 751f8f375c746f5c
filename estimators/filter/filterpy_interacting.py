"""The interacting filters of record: one of filterpy's for every model of every craft.

What makes several filters one, the mixing and the weights, is that of `estimators.filter.interacting`.
"""

from functools import cached_property

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import Given, Independent, UpdateResult
from estimators.filter.error_state import correct, process_noise_into, propagate, transition_into
from estimators.filter.filterpy_bank import ErrorFilter, error_filter, taken_by
from estimators.filter.interacting import (
    InteractingBank,
    centre,
    combine,
    mix_if_due,
    model_in,
    runs,
    settle,
    shear_models,
    weigh,
)
from estimators.lanes import LANES
from estimators.pivot import ARMS, turn_about
from estimators.state import STATES


class FilterpyInteractingBank(InteractingBank):
    """Interacting filters by filterpy: the reference, and slow, for it takes a Python loop over craft and models."""

    @cached_property
    def _filter(self) -> ErrorFilter:
        """The one filter that takes the mean and covariance of every model in turn."""
        return error_filter()

    def _predict(self, mask: Bools, step: Floats) -> None:
        mixtures, state, grid, f = self._mixtures, self._state, self.grid, self._filter
        for c in np.flatnonzero(mask).tolist():
            mix_if_due(c, step[c], grid, mixtures)
            transition_into(state.angular_rate[c], step[c], f.F)
            for at in self._lanes(c):
                model = model_in(at, mixtures.window[c])
                process_noise_into(step[c], grid.acceleration[model], grid.angular_acceleration[model], f.Q)
                f.x, f.P = mixtures.mean[c, :, at][:, None], mixtures.covariance[c, :, :, at]
                f.predict()
                mixtures.mean[c, :, at], mixtures.covariance[c, :, :, at] = f.x[:, 0], f.P
            propagate(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], step[c])
            combine(c, mixtures, self._covariance[c])

    def _update(self, mask: Bools, given: Given | Independent, result: UpdateResult) -> int:
        mixtures, f, x = self._mixtures, self._filter, np.empty(STATES)
        for c in np.flatnonzero(mask).tolist():
            n = given.rows[c]
            if isinstance(given, Independent):
                noise, free = np.diag(given.variance[c, :n]), given.freedoms[c]
            else:
                noise, free = given.r[c, :n, :n], n
            nis, spread = np.zeros((2, LANES))
            found = {}
            for at in self._lanes(c):
                f.x, f.P = mixtures.mean[c, :, at][:, None].copy(), mixtures.covariance[c, :, :, at].copy()
                if (fate := taken_by(f, given.y[c, :n], given.h[c, :n], noise)) is None:
                    return c
                nis[at], spread[at] = fate
                found[at] = f.x[:, 0], f.P
            accepted = min(nis[at] for at in found) <= given.gate[free]
            if accepted:
                for at, (mean, covariance) in found.items():
                    mixtures.mean[c, :, at], mixtures.covariance[c, :, :, at] = mean, covariance
            result.accepted[c] = accepted
            result.nis[c], result.log_determinant[c] = weigh(c, accepted, nis, spread, mixtures)
            if not accepted:
                continue
            centre(c, mixtures, x)
            s = self._state.of(c)
            if isinstance(given, Independent):
                arms = np.empty(ARMS)
                turn_about(s.rotation, s.angular_rate, s.position, s.velocity, x, given.pivot[c], arms)
                shear_models(c, arms, mixtures)
            else:
                correct(s.rotation, s.angular_rate, s.position, s.velocity, x)
            settle(c, free, mixtures, self._covariance[c])
        return -1

    def _lanes(self, c: int) -> list[int]:
        """Return the lanes of the models that craft c runs."""
        return [at for at in range(self._mixtures.probability.shape[1]) if runs(at, c, self._mixtures)]
