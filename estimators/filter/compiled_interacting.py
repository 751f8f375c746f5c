"""The interacting filters as one compiled loop over the craft, with the numbers of filterpy's.

The models of a craft share state, transition and measurement, and differ in mean and covariance: `estimators.lanes`
takes them through the kernels of `estimators.filter.compiled` at once.
"""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import Given, Independent, Poses, UpdateResult
from estimators.filter.compiled import (
    Work,
    absorb_independent,
    advance,
    move_on,
    step_into,
    take_rows,
    weigh_pose,
    weigh_rows,
    work_for,
)
from estimators.filter.error_state import POSE, correct, pose_difference_into, pose_rows_into
from estimators.filter.interacting import (
    Grid,
    InteractingBank,
    Mixtures,
    centre,
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
from estimators.scratch import scratch
from estimators.state import STATES, State


class CompiledInteractingBank(InteractingBank):
    """Interacting filters in arrays: the means and covariances of all models of all craft."""

    def _predict(self, mask: Bools, step: Floats) -> None:
        _predict_all(mask, step, self.grid, self._mixtures, self._state)

    def _update(self, mask: Bools, given: Given | Independent | Poses, result: UpdateResult) -> int:
        if isinstance(given, Independent):
            _update_one_by_one(mask, given, self._mixtures, self._state, self._p, result)
            return -1
        if isinstance(given, Poses):
            return _update_poses(mask, given, self._mixtures, self._state, self._p, result)
        work = work_for(given.y.shape[1], LANES)
        return _update_rows(mask, given, work, self._mixtures, self._state, self._p, result)


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
def _predict_all(mask: Bools, step: Floats, grid: Grid, mixtures: Mixtures, state: State) -> None:
    """Mix the models of the craft of the mask, and move them on by step (C,) [s]."""
    means, covariances = lanes_in(mixtures.mean), lanes_in(mixtures.covariance)
    turn, jacobian = scratch(0.0, 3, 3), scratch(0.0, 3, 3)
    moved, p = scratch(means, 3), scratch(means, STATES, STATES)
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
        advance(p, turn, jacobian, dt, linear, angular)
        to_triangle(p, covariances[c])
        move_on(state, c, turn, dt)


@kernel
def _update_rows(
    mask: Bools,
    given: Given,
    places: Work,
    mixtures: Mixtures,
    state: State,
    covariance: Floats,
    result: UpdateResult,
) -> int:
    """Take in the rows of the craft of the mask; -1, or the first craft whose S is not positive definite."""
    work = Work(lanes_in(places.y), lanes_in(places.g), lanes_in(places.s), lanes_in(places.pivot))
    means, covariances = lanes_in(mixtures.mean), lanes_in(mixtures.covariance)
    p = scratch(means, STATES, STATES)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        h, r, n, free = given.h[c], given.r[c], given.rows[c], given.freedoms[c]
        from_triangle(covariances[c], p)
        regular, squared, volume = weigh_rows(p, given.y[c], h, r, n, work, means[c])
        if not _all_regular(c, regular, mixtures):
            return c
        if _let_in(c, squared + given.square[c], volume, given.gate[free], mixtures, result):
            take_rows(p, h, r, n, work, means[c])
            to_triangle(p, covariances[c])
            _correct(c, mixtures, state)
            settle(c, free, mixtures, covariance[c])
    return -1


@kernel
def _update_poses(
    mask: Bools, poses: Poses, mixtures: Mixtures, state: State, covariance: Floats, result: UpdateResult
) -> int:
    """Take in the poses of the craft of the mask; -1, or the first craft whose S is not positive definite."""
    means, covariances = lanes_in(mixtures.mean), lanes_in(mixtures.covariance)
    work = Work(scratch(means, POSE), scratch(means, POSE, STATES), scratch(means, POSE, POSE), scratch(means, POSE))
    p, y, h = scratch(means, STATES, STATES), scratch(0.0, POSE), scratch(0.0, POSE, STATES)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        r = poses.covariance[c]
        pose_difference_into(poses.rotation[c], poses.position[c], state.rotation[c], state.position[c], y)
        pose_rows_into(poses.coupling[c], h)
        from_triangle(covariances[c], p)
        regular, squared, volume = weigh_pose(p, y, h, r, work, means[c])
        if not _all_regular(c, regular, mixtures):
            return c
        if _let_in(c, squared, volume, poses.gate, mixtures, result):
            take_rows(p, h, r, POSE, work, means[c])
            to_triangle(p, covariances[c])
            _correct(c, mixtures, state)
            settle(c, POSE, mixtures, covariance[c])
    return -1


@kernel
def _all_regular(c: int, regular: bool, mixtures: Mixtures) -> bool:
    """Return whether the mask is true of all models that craft c runs."""
    every = True
    for at in range(LANES):
        every = every and (lane(regular, at) or not runs(at, c, mixtures))
    return every


@kernel
def _let_in(c: int, squared: float, volume: float, gate: float, mixtures: Mixtures, result: UpdateResult) -> bool:
    """Give the models of craft c their probabilities and the measurement its fate; return whether a model lets it in.

    Args:
        c: the craft.
        squared: lanes, NIS.
        volume: lanes, the roots of det S.
        gate: largest NIS that is let in.
        mixtures: models of all craft, changed in place.
        result: receives the fate.
    """
    nis, spread, least = scratch(0.0, LANES), scratch(0.0, LANES), np.inf
    for at in range(LANES):
        nis[at], spread[at] = lane(squared, at), 2 * np.log(lane(volume, at))
        if runs(at, c, mixtures):
            least = min(least, nis[at])
    accepted = least <= gate
    result.accepted[c] = accepted
    result.nis[c], result.log_determinant[c] = weigh(c, accepted, nis, spread, mixtures)
    return accepted


@kernel
def _correct(c: int, mixtures: Mixtures, state: State) -> None:
    """Take the mean error of the models of craft c off them, and into its state."""
    correction = scratch(0.0, STATES)
    centre(c, mixtures, correction)
    correct(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], correction)


@kernel
def _update_one_by_one(
    mask: Bools, given: Independent, mixtures: Mixtures, state: State, covariance: Floats, result: UpdateResult
) -> None:
    """Take in the rows of the craft of the mask, one after the other."""
    means, covariances = lanes_in(mixtures.mean), lanes_in(mixtures.covariance)
    p, left, x = scratch(means, STATES, STATES), scratch(means, STATES, STATES), scratch(means, STATES)
    correction, arms = scratch(0.0, STATES), scratch(0.0, ARMS)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        for i in range(STATES):
            x[i] = means[c, i]
        from_triangle(covariances[c], p)
        squared, volume = absorb_independent(p, given.y[c], given.h[c], given.variance[c], given.rows[c], x, left)
        free = given.freedoms[c]
        if _let_in(c, squared, volume, given.gate[free], mixtures, result):
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
