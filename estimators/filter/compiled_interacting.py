"""The interacting filters as one compiled loop over the craft, with the numbers of filterpy's.

The models of a craft share state, transition and measurement, and differ in mean and covariance: `estimators.lanes`
takes them, and those of a second craft beside them where a processor has wide lanes, through the kernels of
`estimators.filter.compiled` at once.
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
from estimators.filter.error_state import POSE, correct, pose_difference_into
from estimators.filter.interacting import (
    COLUMNS,
    Grid,
    InteractingBank,
    Mixtures,
    centre,
    centred,
    combine,
    combined_into,
    let_in,
    mix_if_due,
    model_in,
    running,
    settle,
    shares,
    shear_models,
    weighed,
)
from estimators.kernel import inlined, kernel
from estimators.lanes import (
    FOURS,
    LANES,
    WIDE,
    any_in_four,
    any_of,
    beside,
    fours_in,
    lane,
    lanes_in,
    opposite,
    pack,
    wide_in,
)
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


class Sides(NamedTuple):
    """Places, in wide lanes, for the models of craft side by side, and for a measurement by up to m rows.

    x: (12,). p: (12, 12). columns: (12, 3). h: (m, 12). r: (m, m). work: with the innovations y.
    """

    x: Floats
    p: Floats
    columns: Floats
    h: Floats
    r: Floats
    work: Work


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
        if len(who := np.flatnonzero(mask & self._motion.waits)):
            _predict_models(who, self._motion, self.grid, self._mixtures)

    def _update(self, mask: Bools, given: Given | Independent | Poses, result: UpdateResult) -> int:
        after = self._mixtures, self._state, self._columns, result
        if isinstance(given, Independent):
            self._catch_up(mask)
            _update_one_by_one(mask, given, *after)
            return -1
        who = np.flatnonzero(mask)
        if isinstance(given, Poses):
            return _update_poses(who, given, self._motion, self.grid, *after)
        most = given.y.shape[1]
        h, r, work = np.empty((most, STATES, WIDE)), np.empty((most, most, WIDE)), work_for(most, WIDE)
        return _update_rows(who, given, h, r, work, self._motion, self.grid, *after)


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
def _due(c: int, motion: Motion, grid: Grid, mixtures: Mixtures) -> float:
    """Return the step [s] for which the models of craft c wait, mixed where it is time; zero if they do not wait."""
    if not motion.waits[c]:
        return 0.0
    motion.waits[c] = False
    mix_if_due(c, motion.step[c], grid, mixtures)
    return float(motion.step[c])


@inlined
def _predicted_into(
    one: int, other: int, motion: Motion, grid: Grid, mixtures: Mixtures, x: Floats, p: Floats, columns: Floats
) -> bool:
    """Write means and covariances of the models of two craft, predicted; return whether they have changed.

    Models that do not wait for a prediction are moved on by a step of zero, which leaves them as they are.

    Args:
        one: a craft.
        other: a craft beside it, or the same.
        motion: what waits.
        grid: the models.
        mixtures: models of all craft.
        x: (12,), wide lanes, receives the means.
        p: (12, 12), wide lanes, whose lower triangle receives P.
        columns: (12, 3), wide lanes, workspace.
    """
    means, covariances, window = lanes_in(mixtures.mean), lanes_in(mixtures.covariance), mixtures.window
    dt = beside(_due(one, motion, grid, mixtures), _due(other, motion, grid, mixtures))
    for i in range(STATES):
        x[i] = beside(means[one, i], means[other, i])
    k = np.uint64(0)  # unsigned: an index that may be negative takes longer
    for i in range(STATES):
        for j in range(i + 1):
            p[i, j] = beside(covariances[one, k], covariances[other, k])
            k += np.uint64(1)
    rate, moved, turn, jacobian = scratch(x, 3), scratch(x, 3), scratch(x, 3, 3), scratch(x, 3, 3)
    for i in range(3):
        rate[i] = beside(motion.angular_rate[one, i], motion.angular_rate[other, i])
    step_into(rate, dt, turn, jacobian)
    for i in range(3):
        value = turn[i, 0] * x[0] + turn[i, 1] * x[1] + turn[i, 2] * x[2]
        moved[i] = value + (jacobian[i, 0] * x[3] + jacobian[i, 1] * x[4] + jacobian[i, 2] * x[5])
    for i in range(3):
        x[i] = moved[i]
        x[6 + i] += dt * x[9 + i]
    linear = beside(_noise(grid.acceleration, window[one]), _noise(grid.acceleration, window[other]))
    angular = beside(_noise(grid.angular_acceleration, window[one]), _noise(grid.angular_acceleration, window[other]))
    advance(p, turn, jacobian, dt, linear, angular, columns)
    return any_of(dt > 0)


@inlined
def _keep(c: int, side: int, x: Floats, p: Floats, mixtures: Mixtures) -> None:
    """Give craft c the means and covariances of its models.

    Args:
        c: the craft.
        side: its place beside others.
        x: (12,), wide lanes.
        p: (12, 12), wide lanes.
        mixtures: models of all craft, changed in place.
    """
    mean, covariance = lanes_in(mixtures.mean)[c], lanes_in(mixtures.covariance)[c]
    xs, ps = fours_in(x), fours_in(p)
    for i in range(STATES):
        mean[i] = xs[i, side]
    k = np.uint64(0)
    for i in range(STATES):
        for j in range(i + 1):
            covariance[k] = ps[i, j, side]
            k += np.uint64(1)


@kernel
def _predict_models(who: Ints, motion: Motion, grid: Grid, mixtures: Mixtures) -> None:
    """Make the motion of the models of craft `who` (n,)."""
    wide = beside(0.0, 0.0)
    x, p, columns = scratch(wide, STATES), scratch(wide, STATES, STATES), scratch(wide, STATES, COLUMNS)
    for first in range(0, len(who), FOURS):
        craft = who[first : first + FOURS]
        if _predicted_into(craft[0], craft[len(craft) - 1], motion, grid, mixtures, x, p, columns):
            for side in range(len(craft)):
                _keep(craft[side], side, x, p, mixtures)


@kernel
def _update_rows(
    who: Ints,
    given: Given,
    h: Floats,
    r: Floats,
    places: Work,
    motion: Motion,
    grid: Grid,
    mixtures: Mixtures,
    state: State,
    covariance: Floats,
    result: UpdateResult,
) -> int:
    """Take in the rows of craft `who` (n,); return -1, or a craft whose S is not positive definite.

    Places, in numbers: h (m, 12, WIDE), r (m, m, WIDE), and those of `work_for`.
    """
    wide = beside(0.0, 0.0)
    work = Work(wide_in(places.y), wide_in(places.g), wide_in(places.s), wide_in(places.pivot))
    own = scratch(wide, STATES), scratch(wide, STATES, STATES), scratch(wide, STATES, COLUMNS)
    sides = Sides(own[0], own[1], own[2], wide_in(h), wide_in(r), work)
    for first in range(0, len(who), FOURS):
        craft = who[first : first + FOURS]
        one, other = craft[0], craft[len(craft) - 1]
        # Rows that a craft does not have are zero, of variance one, and change nothing.
        n = max(given.rows[one], given.rows[other])
        for a in range(n):
            work.y[a] = beside(given.y[one, a], given.y[other, a])
            for i in range(STATES):
                sides.h[a, i] = beside(given.h[one, a, i], given.h[other, a, i])
            for d in range(a + 1):
                sides.r[a, d] = beside(given.r[one, a, d], given.r[other, a, d])
        moved = _predicted_into(one, other, motion, grid, mixtures, sides.x, sides.p, sides.columns)
        weights = weigh_rows(sides.p, work.y, sides.h, sides.r, n, work, sides.x)
        terms = given.gate, given.freedoms, given.square
        indefinite = _absorb(craft, n, moved, weights, terms, sides, mixtures, state, covariance, result)
        if indefinite >= 0:
            return indefinite
    return -1


@kernel
def _update_poses(
    who: Ints,
    poses: Poses,
    motion: Motion,
    grid: Grid,
    mixtures: Mixtures,
    state: State,
    covariance: Floats,
    result: UpdateResult,
) -> int:
    """Take in the poses of craft `who` (n,); return -1, or a craft whose S is not positive definite."""
    wide = beside(0.0, 0.0)
    work = Work(scratch(wide, POSE), scratch(wide, POSE, STATES), scratch(wide, POSE, POSE), scratch(wide, POSE))
    h, r, y = scratch(wide, POSE, STATES), scratch(wide, POSE, POSE), scratch(0.0, FOURS, POSE)
    own = scratch(wide, STATES), scratch(wide, STATES, STATES), scratch(wide, STATES, COLUMNS)
    sides = Sides(own[0], own[1], own[2], h, r, work)
    for a in range(POSE):
        for i in range(STATES):
            h[a, i] = 1.0 if i == a + a // 3 * 3 else 0.0
    for first in range(0, len(who), FOURS):
        craft = who[first : first + FOURS]
        one, other = craft[0], craft[len(craft) - 1]
        for side in range(len(craft)):
            c = craft[side]
            measured, predicted = (poses.rotation[c], poses.position[c]), (state.rotation[c], state.position[c])
            pose_difference_into(*measured, *predicted, y[side])
        for a in range(POSE):
            work.y[a] = beside(y[0, a], y[len(craft) - 1, a])
            for j in range(3):
                h[a, 3 + j] = beside(poses.coupling[one, a, j], poses.coupling[other, a, j])
                h[a, 9 + j] = beside(poses.coupling[one, a, 3 + j], poses.coupling[other, a, 3 + j])
            for d in range(a + 1):
                r[a, d] = beside(poses.covariance[one, a, d], poses.covariance[other, a, d])
        moved = _predicted_into(one, other, motion, grid, mixtures, sides.x, sides.p, sides.columns)
        weights = weigh_pose(sides.p, work.y, h, r, work, sides.x)
        terms = poses.gate, poses.freedoms, poses.square
        indefinite = _absorb(craft, POSE, moved, weights, terms, sides, mixtures, state, covariance, result)
        if indefinite >= 0:
            return indefinite
    return -1


@inlined
def _absorb(
    craft: Ints,
    n: int,
    moved: bool,
    weights: tuple[bool, float, float],
    terms: tuple[Floats, Ints, Floats],
    sides: Sides,
    mixtures: Mixtures,
    state: State,
    covariance: Floats,
    result: UpdateResult,
) -> int:
    """Take in n rows of craft side by side, as far as they are let in; return -1, or a craft whose S is not positive
    definite.

    Args:
        craft: (m,), as many as there are side by side.
        n: number of rows that are used.
        moved: whether the models have been predicted.
        weights: of `weigh_rows`.
        terms: gate, freedoms and square of `Given`.
        sides: means and covariances of the models, and the rows.
        mixtures: models of all craft, changed in place.
        state: of all craft, changed in place.
        covariance: (C, 12, 3, L), receives those of the mixtures.
        result: receives the fates.
    """
    regular, squared, volume = weights
    gate, freedoms, square = terms
    one, other = craft[0], craft[len(craft) - 1]
    among = beside(running(one, mixtures), running(other, mixtures))
    nis, limit = squared + beside(square[one], square[other]), beside(gate[freedoms[one]], gate[freedoms[other]])
    own = beside(shares(one, mixtures), shares(other, mixtures))
    accepted, share, nis, spread = weighed(own, among, nis, volume, limit)
    singular = any_in_four(among & opposite(regular))
    indefinite = -1
    for side in range(len(craft)):
        c, at = craft[side], LANES * side
        if lane(singular, at):
            indefinite = c
        else:
            result.accepted[c] = lane(accepted, at)
            result.nis[c], result.log_determinant[c] = lane(nis, at), lane(spread, at)
            for k in range(LANES):
                mixtures.probability[c, k] = lane(share, at + k)
        if moved and not result.accepted[c]:
            _keep(c, side, sides.x, sides.p, mixtures)
    if not any_of(accepted):
        return indefinite
    take_rows(sides.p, sides.h, sides.r, n, sides.work, sides.x)
    mean, columns, error = scratch(0.0, COLUMNS, WIDE), sides.columns, scratch(0.0, STATES)
    centred(share, sides.x, wide_in(mean))
    combined_into(share, sides.x, sides.p, columns)
    for side in range(len(craft)):
        c = craft[side]
        if not result.accepted[c]:
            continue
        _keep(c, side, sides.x, sides.p, mixtures)
        for i in range(STATES):
            for j in range(COLUMNS):
                lanes_in(covariance)[c, i, j] = fours_in(columns)[i, j, side]
        for i in range(STATES):
            error[i] = mean[i // LANES, LANES * side + i % LANES]
        correct(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], error)
        settle(c, freedoms[c], mixtures)
    return indefinite


@kernel
def _update_one_by_one(
    mask: Bools,
    given: Independent,
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
        from_triangle(covariances[c], p)
        for i in range(STATES):
            x[i] = means[c, i]
        squared, volume = absorb_independent(p, given.y[c], given.h[c], given.variance[c], given.rows[c], x, left)
        free = given.freedoms[c]
        if let_in(c, squared, volume, given.gate[free], mixtures, result):
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
            combine(c, mixtures, covariance)
            settle(c, free, mixtures)
