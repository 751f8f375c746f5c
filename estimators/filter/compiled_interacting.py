"""The interacting filters as one compiled loop over the craft, with the numbers of filterpy's.

The models of a craft share state, transition and measurement, and differ in mean and covariance: `estimators.lanes`
takes them through the kernels of `estimators.filter.compiled` at once.
"""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import Given, Independent, UpdateResult
from estimators.filter.compiled import (
    absorb_independent,
    advance,
    lanes_work_for,
    move_on,
    pick,
    step_into,
    take_rows,
    weigh_rows,
)
from estimators.filter.error_state import correct
from estimators.filter.interacting import (
    Grid,
    InteractingBank,
    Mixtures,
    centre,
    combine,
    mix_if_due,
    model_in,
    runs,
    settle,
    shear_models,
    weigh,
)
from estimators.kernel import inlined, kernel
from estimators.lanes import LANES, lane, lanes_in, pack
from estimators.linear import from_triangle, to_triangle
from estimators.pivot import ARMS, turn_about
from estimators.state import STATES, State


class CompiledInteractingBank(InteractingBank):
    """Interacting filters in arrays: the means and covariances of all models of all craft."""

    def _predict(self, mask: Bools, step: Floats) -> None:
        _predict_all(mask, step, self.grid, self._mixtures, self._state, self._covariance)

    def _update(self, mask: Bools, given: Given | Independent, result: UpdateResult) -> int:
        if isinstance(given, Independent):
            _update_one_by_one(mask, given, self._mixtures, self._state, self._covariance, result)
            return -1
        return _update_all(mask, given, self._mixtures, self._state, self._covariance, result)


@inlined
def _noise(noises: Floats, window: int) -> float:
    """Return the noises of the models that a craft runs, as lanes; noises: (N,), of all models."""
    last = len(noises) - 1
    lanes: float = pack(
        noises[min(model_in(0, window), last)],
        noises[min(model_in(1, window), last)],
        noises[min(model_in(2, window), last)],
        noises[min(model_in(3, window), last)],
    )
    return lanes


@kernel
def _predict_all(mask: Bools, step: Floats, grid: Grid, mixtures: Mixtures, state: State, covariance: Floats) -> None:
    """Mix the models of the craft of the mask, and move them on by step (C,) [s]."""
    turn, jacobian = np.empty((3, 3)), np.empty((3, 3))
    moved, fp = lanes_in(np.empty((3, LANES))), lanes_in(np.empty((3, STATES, LANES)))
    p = lanes_in(np.empty((STATES, STATES, LANES)))
    means, covariances = lanes_in(mixtures.mean), lanes_in(mixtures.covariance)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        dt, x = step[c], means[c]
        mix_if_due(c, dt, grid, mixtures)
        step_into(state.angular_rate[c], dt, turn, jacobian)
        for i in range(3):
            value = turn[i, 0] * x[0] + turn[i, 1] * x[1] + turn[i, 2] * x[2]
            moved[i] = value + (jacobian[i, 0] * x[3] + jacobian[i, 1] * x[4] + jacobian[i, 2] * x[5])
        for i in range(3):
            x[i] = moved[i]
            x[6 + i] += dt * x[9 + i]
        linear, angular = (
            _noise(grid.acceleration, mixtures.window[c]),
            _noise(grid.angular_acceleration, mixtures.window[c]),
        )
        from_triangle(covariances[c], p)
        advance(p, turn, jacobian, dt, linear, angular, fp)
        to_triangle(p, covariances[c])
        move_on(state, c, turn, dt)
        combine(c, mixtures, covariance[c])


@inlined
def _lowest(c: int, squared: float, volume: float, mixtures: Mixtures, nis: Floats, spread: Floats) -> float:
    """Write NIS and log det S (L,) by the models of craft c, and return the least NIS.

    Args:
        c: the craft.
        squared: lanes, NIS.
        volume: lanes, the roots of det S.
        mixtures: models of the craft.
        nis: (L,).
        spread: (L,).
    """
    least = np.inf
    for at in range(LANES):
        nis[at], spread[at] = lane(squared, at), 2 * np.log(lane(volume, at))
        if runs(at, c, mixtures):
            least = min(least, nis[at])
    return least


@kernel
def _update_all(
    mask: Bools, given: Given, mixtures: Mixtures, state: State, covariance: Floats, result: UpdateResult
) -> int:
    """Take in the rows of the craft of the mask; -1, or the first craft whose S is not positive definite."""
    work, correction = lanes_work_for(given.y.shape[1]), np.empty(STATES)
    means, covariances = lanes_in(mixtures.mean), lanes_in(mixtures.covariance)
    p, nis, spread = lanes_in(np.empty((STATES, STATES, LANES))), np.empty(LANES), np.empty(LANES)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        n, x, h, r = given.rows[c], means[c], given.h[c], given.r[c]
        pick(h, n, work.picked)
        from_triangle(covariances[c], p)
        regular, squared, volume = weigh_rows(p, given.y[c], h, r, n, work, x)
        for at in range(LANES):
            if runs(at, c, mixtures) and not lane(regular, at):
                return c
        squared += given.square[c]
        accepted = _lowest(c, squared, volume, mixtures, nis, spread) <= given.gate[given.freedoms[c]]
        result.accepted[c] = accepted
        result.nis[c], result.log_determinant[c] = weigh(c, accepted, nis, spread, mixtures)
        if accepted:
            take_rows(p, h, r, n, work, x)
            to_triangle(p, covariances[c])
            centre(c, mixtures, correction)
            correct(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], correction)
            settle(c, given.freedoms[c], mixtures, covariance[c])
    return -1


@kernel
def _update_one_by_one(
    mask: Bools, given: Independent, mixtures: Mixtures, state: State, covariance: Floats, result: UpdateResult
) -> None:
    """Take in the rows of the craft of the mask, one after the other."""
    work, correction, arms = lanes_work_for(given.y.shape[1]), np.empty(STATES), np.empty(ARMS)
    p, left = lanes_in(np.empty((STATES, STATES, LANES))), lanes_in(np.empty((STATES, STATES, LANES)))
    x = lanes_in(np.empty((STATES, LANES)))
    means, covariances = lanes_in(mixtures.mean), lanes_in(mixtures.covariance)
    nis, spread = np.empty(LANES), np.empty(LANES)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        for i in range(STATES):
            x[i] = means[c, i]
        from_triangle(covariances[c], p)
        squared, volume = absorb_independent(p, given.y[c], given.h[c], given.variance[c], given.rows[c], work, x, left)
        free = given.freedoms[c]
        accepted = _lowest(c, squared, volume, mixtures, nis, spread) <= given.gate[free]
        result.accepted[c] = accepted
        result.nis[c], result.log_determinant[c] = weigh(c, accepted, nis, spread, mixtures)
        if accepted:
            for i in range(STATES):
                means[c, i] = x[i]
            to_triangle(left, covariances[c])
            centre(c, mixtures, correction)
            turn_about(
                state.rotation[c],
                state.angular_rate[c],
                state.position[c],
                state.velocity[c],
                correction,
                given.pivot[c],
                arms,
            )
            shear_models(c, arms, mixtures)
            settle(c, free, mixtures, covariance[c])
