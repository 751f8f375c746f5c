"""The interacting filters of record: filterpy's, which takes all models of a craft at once.

The models of a craft are independent of each other while they are predicted and updated. They are the blocks of one
filter of filterpy's: x holds their means one below the other, F, P, Q, H and R their matrices along the diagonal, and
beside it zeros, which remain zeros. Most of what filterpy takes is for the calls: four models take twice what one does.

What makes several filters one, the mixing and the weights, is that of `estimators.filter.interacting`.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import Given, Independent, UpdateResult
from estimators.filter.error_state import correct, process_noise_into, propagate, transition_into
from estimators.filter.filterpy_bank import ErrorFilter, error_filter, updated
from estimators.filter.interacting import (
    Grid,
    InteractingBank,
    Mixtures,
    centre,
    combine,
    mix_if_due,
    model_in,
    settle,
    shear_models,
    weigh,
)
from estimators.kernel import kernel
from estimators.lanes import LANES
from estimators.linear import cholesky_into, from_triangle, to_triangle
from estimators.pivot import ARMS, turn_about
from estimators.state import STATES, State


class Blocks(NamedTuple):
    """Rows of a craft for all its M models: y (M n, 1), h (M n, 12 M) and r (M n, M n), the same in every block."""

    y: Floats
    h: Floats
    r: Floats


class FilterpyInteractingBank(InteractingBank):
    """Interacting filters by filterpy: the reference, and slow, for it takes a Python loop over the craft."""

    @cached_property
    def _filters(self) -> dict[int, ErrorFilter]:
        """The filter that takes craft of so many models, one after the other."""
        return {models: error_filter(models) for models in set(np.minimum(self._mixtures.models, LANES).tolist())}

    @cached_property
    def _blocks(self) -> dict[tuple[int, int], Blocks]:
        """The arrays in which craft of so many models have so many rows, as far as there were any."""
        return {}

    def _blocks_of(self, models: int, rows: int) -> Blocks:
        """Return the arrays in which craft of so many models have so many rows: zeros beside the blocks."""
        if (models, rows) not in self._blocks:
            n = models * rows
            self._blocks[models, rows] = Blocks(np.zeros((n, 1)), np.zeros((n, models * STATES)), np.zeros((n, n)))
        return self._blocks[models, rows]

    def _predict(self, mask: Bools, step: Floats) -> None:
        mixtures, state, grid = self._mixtures, self._state, self.grid
        for c in np.flatnonzero(mask).tolist():
            f = self._filters[min(LANES, int(mixtures.models[c]))]
            _fill_motion(c, step[c], grid, mixtures, state, f.F, f.Q)
            f.x, f.P = _stacked(c, f.dim_x // STATES, mixtures)
            f.predict()
            _take_motion(c, step[c], f.x, f.P, mixtures, state, self._covariance)

    def _update(self, mask: Bools, given: Given | Independent, result: UpdateResult) -> int:
        mixtures, state = self._mixtures, self._state
        nis, spread = np.zeros((2, LANES))
        for c in np.flatnonzero(mask).tolist():
            n, models = int(given.rows[c]), min(LANES, int(mixtures.models[c]))
            if isinstance(given, Independent):
                noise, more = np.diag(given.variance[c, :n]), 0.0
            else:
                noise, more = given.r[c, :n, :n], given.square[c]
            free = given.freedoms[c]
            f, blocks = self._filters[models], self._blocks_of(models, n)
            _fill_rows(given.y[c], given.h[c], noise, blocks)
            f.x, f.P = _stacked(c, models, mixtures)
            if not updated(f, *blocks) or not _fates(f.y, f.S, f.SI, n, nis, spread):
                return c
            nis += more
            accepted = nis[:models].min() <= given.gate[free]
            result.accepted[c] = accepted
            result.nis[c], result.log_determinant[c] = weigh(c, accepted, nis, spread, mixtures)
            if not accepted:
                continue
            if isinstance(given, Independent):
                _take_about(c, f.x, f.P, given.pivot[c], mixtures, state)
            else:
                _take(c, f.x, f.P, mixtures, state)
            settle(c, free, mixtures, self._covariance[c])
        return -1


@kernel
def _fill_motion(c: int, dt: float, grid: Grid, mixtures: Mixtures, state: State, f: Floats, q: Floats) -> None:
    """Mix the models of craft c if it is time, and write F and Q (12 M, 12 M) of all for a step of `dt` [s].

    Args:
        c: the craft.
        dt: the step [s].
        grid: the models.
        mixtures: models of all craft, changed in place.
        state: states of all craft.
        f: receives F.
        q: receives Q.
    """
    mix_if_due(c, dt, grid, mixtures)
    for at in range(f.shape[0] // STATES):
        own, model = slice(at * STATES, (at + 1) * STATES), model_in(at, mixtures.window[c])
        transition_into(state.angular_rate[c], dt, f[own, own])
        process_noise_into(dt, grid.acceleration[model], grid.angular_acceleration[model], q[own, own])


@kernel
def _stacked(c: int, models: int, mixtures: Mixtures) -> tuple[Floats, Floats]:
    """Return x (12 M, 1) and P (12 M, 12 M) of the M models of craft c."""
    x, p = np.empty((models * STATES, 1)), np.zeros((models * STATES, models * STATES))
    for at in range(models):
        own = at * STATES
        for i in range(STATES):
            x[own + i, 0] = mixtures.mean[c, i, at]
        from_triangle(mixtures.covariance[c, :, at], p[own : own + STATES, own : own + STATES])
    return x, p


@kernel
def _unstack(c: int, x: Floats, p: Floats, mixtures: Mixtures) -> None:
    """Write means and covariances of all models into those of craft c, as `_stacked` found them there."""
    for at in range(x.shape[0] // STATES):
        own = at * STATES
        for i in range(STATES):
            mixtures.mean[c, i, at] = x[own + i, 0]
        to_triangle(p[own : own + STATES, own : own + STATES], mixtures.covariance[c, :, at])


@kernel
def _take_motion(c: int, dt: float, x: Floats, p: Floats, mixtures: Mixtures, state: State, covariance: Floats) -> None:
    """Give craft c its predicted models x, P, and the state and covariance that go with them."""
    _unstack(c, x, p, mixtures)
    propagate(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], dt)
    combine(c, mixtures, covariance[c])


@kernel
def _fill_rows(y: Floats, h: Floats, r: Floats, blocks: Blocks) -> None:
    """Write rows y (n,), H (n, 12) and the covariance of their noise (n, n) into every block."""
    n = r.shape[0]
    for at in range(blocks.y.shape[0] // n):
        first = at * n
        for i in range(n):
            blocks.y[first + i, 0] = y[i]
            for j in range(STATES):
                blocks.h[first + i, at * STATES + j] = h[i, j]
            for j in range(n):
                blocks.r[first + i, first + j] = r[i, j]


@kernel
def _fates(y: Floats, s: Floats, inverse: Floats, n: int, nis: Floats, spread: Floats) -> bool:
    """Write NIS and log det S (L,) of the models; return False where an S is not positive definite.

    Args:
        y: (M n, 1), innovations.
        s: (M n, M n), their covariances S.
        inverse: (M n, M n), of S.
        n: number of rows of a model.
        nis: (L,), receives the normalised innovations squared.
        spread: (L,), receives log det S.
    """
    lower = np.empty((n, n))
    for at in range(y.shape[0] // n):
        first, squared, volume = at * n, 0.0, 0.0
        if not cholesky_into(s[first : first + n, first : first + n], lower):
            return False
        for i in range(n):
            volume += np.log(lower[i, i])
            for j in range(n):
                squared += y[first + i, 0] * inverse[first + i, first + j] * y[first + j, 0]
        nis[at], spread[at] = squared, 2 * volume
    return True


@kernel
def _take(c: int, x: Floats, p: Floats, mixtures: Mixtures, state: State) -> None:
    """Give craft c its updated models, and its state their mean error."""
    correction = np.empty(STATES)
    _unstack(c, x, p, mixtures)
    centre(c, mixtures, correction)
    correct(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], correction)


@kernel
def _take_about(c: int, x: Floats, p: Floats, pivot: Floats, mixtures: Mixtures, state: State) -> None:
    """`_take` where the body turns about points `pivot` (PIVOT,) of its own."""
    correction, arms = np.empty(STATES), np.empty(ARMS)
    _unstack(c, x, p, mixtures)
    centre(c, mixtures, correction)
    rotation, rate = state.rotation[c], state.angular_rate[c]
    turn_about(rotation, rate, state.position[c], state.velocity[c], correction, pivot, arms)
    shear_models(c, arms, mixtures)
