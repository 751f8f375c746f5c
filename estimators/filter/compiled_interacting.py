"""The interacting filters as one compiled loop over the craft, with the numbers of filterpy's.

The models of a craft share state, transition and measurement, and differ in mean and covariance: `estimators.lanes`
takes them through the kernels of `estimators.filter.compiled` at once.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import Given, Independent, Poses, UpdateResult
from estimators.filter.compiled import (
    Work,
    absorb_independent,
    advance,
    move_on,
    step_into,
    take_rows,
    turn_into,
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


class Motion(NamedTuple):
    """Predictions that the models of C craft have yet to make: a craft's models are fetched once per period.

    waits: (C,), whether a craft's have. step: (C,) [s]. angular_rate: (C, 3) [rad/s], about which the step is linear.
    """

    waits: Bools
    step: Floats
    angular_rate: Floats


class CompiledInteractingBank(InteractingBank):
    """Interacting filters in arrays: the means and covariances of all models of all craft."""

    def __init__(
        self,
        noises: list[tuple[float, float]],
        quiet_s: float,
        manoeuvre_s: float,
        models: Ints,
        gate_probability: float = 0.99999,
    ) -> None:
        """Begin without a state; the arguments are those of any `InteractingBank`."""
        super().__init__(noises, quiet_s, manoeuvre_s, models, gate_probability)
        craft = len(models)
        self._motion = Motion(np.zeros(craft, dtype=np.bool_), np.zeros(craft), np.zeros((craft, 3)))

    def _predict(self, mask: Bools, step: Floats) -> None:
        self._catch_up(mask)
        _predict_states(mask, step, self._motion, self._state)

    def _catch_up(self, mask: Bools) -> None:
        late = mask & self._motion.waits
        if late.any():
            _predict_models(late, self._motion, self.grid, self._mixtures)

    def _update(self, mask: Bools, given: Given | Independent | Poses, result: UpdateResult) -> int:
        models = self._motion, self.grid, self._mixtures
        if isinstance(given, Independent):
            _update_one_by_one(mask, given, *models, self._state, self._p, result)
            return -1
        if isinstance(given, Poses):
            return _update_poses(mask, given, *models, self._state, self._p, result)
        work = work_for(given.y.shape[1], LANES)
        return _update_rows(mask, given, work, *models, self._state, self._p, result)


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
def _predict_states(mask: Bools, step: Floats, motion: Motion, state: State) -> None:
    """Move the states of the craft of the mask on by step (C,) [s], and leave their models' motion to be made."""
    turn = scratch(0.0, 3, 3)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        motion.waits[c], motion.step[c] = True, step[c]
        for i in range(3):
            motion.angular_rate[c, i] = state.angular_rate[c, i]
        turn_into(state.angular_rate[c], step[c], turn)
        move_on(state, c, turn, step[c])


@kernel
def _predict_models(mask: Bools, motion: Motion, grid: Grid, mixtures: Mixtures) -> None:
    """Make the motion of the models of the craft of the mask, which wait for it."""
    covariances = lanes_in(mixtures.covariance)
    p = scratch(covariances, STATES, STATES)
    for c in range(len(mask)):
        if mask[c] and _predicted_into(c, motion, grid, mixtures, p):
            to_triangle(p, covariances[c])


@kernel
def _predicted_into(c: int, motion: Motion, grid: Grid, mixtures: Mixtures, p: Floats) -> bool:
    """Write P (12, 12) of the models of craft c, predicted, as lanes; return whether it has changed.

    If the prediction is still to be made, the models are mixed where it is time, and their means are moved in place.

    Args:
        c: the craft.
        motion: what waits.
        grid: the models.
        mixtures: models of all craft.
        p: (12, 12), receives P.
    """
    waits, dt, x = motion.waits[c], motion.step[c], lanes_in(mixtures.mean)[c]
    if waits:
        mix_if_due(c, dt, grid, mixtures)
    from_triangle(lanes_in(mixtures.covariance)[c], p)
    if waits:
        motion.waits[c] = False
        turn, jacobian, moved = scratch(0.0, 3, 3), scratch(0.0, 3, 3), scratch(x, 3)
        step_into(motion.angular_rate[c], dt, turn, jacobian)
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
        advance(p, turn, jacobian, dt, linear, angular)
    return bool(waits)


@kernel
def _update_rows(
    mask: Bools,
    given: Given,
    places: Work,
    motion: Motion,
    grid: Grid,
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
        moved = _predicted_into(c, motion, grid, mixtures, p)
        regular, squared, volume = weigh_rows(p, given.y[c], h, r, n, work, means[c])
        sound = _all_regular(c, regular, mixtures)
        accepted = sound and _let_in(c, squared + given.square[c], volume, given.gate[free], mixtures, result)
        if accepted:
            take_rows(p, h, r, n, work, means[c])
        if accepted or moved:
            to_triangle(p, covariances[c])
        if not sound:
            return c
        if accepted:
            _correct(c, mixtures, state)
            settle(c, free, mixtures, covariance[c])
    return -1


@kernel
def _update_poses(
    mask: Bools,
    poses: Poses,
    motion: Motion,
    grid: Grid,
    mixtures: Mixtures,
    state: State,
    covariance: Floats,
    result: UpdateResult,
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
        moved = _predicted_into(c, motion, grid, mixtures, p)
        regular, squared, volume = weigh_pose(p, y, h, r, work, means[c])
        sound = _all_regular(c, regular, mixtures)
        accepted = sound and _let_in(c, squared, volume, poses.gate, mixtures, result)
        if accepted:
            take_rows(p, h, r, POSE, work, means[c])
        if accepted or moved:
            to_triangle(p, covariances[c])
        if not sound:
            return c
        if accepted:
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
    mask: Bools,
    given: Independent,
    motion: Motion,
    grid: Grid,
    mixtures: Mixtures,
    state: State,
    covariance: Floats,
    result: UpdateResult,
) -> None:
    """Take in the rows of the craft of the mask, one after the other."""
    means, covariances = lanes_in(mixtures.mean), lanes_in(mixtures.covariance)
    p, left, x = scratch(means, STATES, STATES), scratch(means, STATES, STATES), scratch(means, STATES)
    correction, arms = scratch(0.0, STATES), scratch(0.0, ARMS)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        if _predicted_into(c, motion, grid, mixtures, p):
            to_triangle(p, covariances[c])
        for i in range(STATES):
            x[i] = means[c, i]
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
