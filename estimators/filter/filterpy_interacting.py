"""The interacting filters of record: filterpy's, which takes all models of a craft at once.

The models of a craft are independent of each other while they are predicted and updated. They are the blocks of one
filter of filterpy's: x holds their means one below the other, F, P, Q, H and R their matrices along the diagonal, and
beside it zeros, which remain zeros. Most of what filterpy takes is for the calls: four models take twice what one does.
A kernel stacks a few craft at once, filterpy takes one after the other, and a kernel takes them off the stack.

What makes several filters one, the mixing and the weights, is that of `estimators.filter.interacting`.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import Given, Independent, Poses, UpdateResult
from estimators.filter.error_state import correct, process_noise_into, propagate, transition_into
from estimators.filter.filterpy_bank import ErrorFilter, error_filter, updated
from estimators.filter.interacting import (
    Grid,
    InteractingBank,
    Mixtures,
    centre,
    combine,
    let_in,
    mix_if_due,
    model_in,
    settle,
    shear_models,
)
from estimators.kernel import inlined, kernel
from estimators.lanes import LANES, lanes_in
from estimators.linear import cholesky_into, from_triangle, to_triangle
from estimators.pivot import ARMS, turn_about
from estimators.scratch import scratch
from estimators.state import STATES, State

BATCH = 8
"""Largest number of craft on a stack."""


class Stack(NamedTuple):
    """B craft of M models each for filterpy: x (B, 12 M, 1), P, F and Q (B, 12 M, 12 M), zero beside the blocks; nis
    and volume (B, L): normalised innovations squared and roots of det S of their models.
    """

    x: Floats
    p: Floats
    f: Floats
    q: Floats
    nis: Floats
    volume: Floats

    @classmethod
    def of(cls, models: int) -> "Stack":
        """Return a stack for craft of so many models."""
        n = models * STATES
        return cls(np.zeros((BATCH, n, 1)), *np.zeros((3, BATCH, n, n)), *np.zeros((2, BATCH, LANES)))


class Blocks(NamedTuple):
    """Rows of B craft for all their M models: y (B, M n, 1), h (B, M n, 12 M) and r (B, M n, M n), the same in every
    block of a craft, zero beside them.
    """

    y: Floats
    h: Floats
    r: Floats

    @classmethod
    def of(cls, models: int, rows: int) -> "Blocks":
        """Return blocks for so many rows of craft of so many models."""
        n = models * rows
        return cls(np.zeros((BATCH, n, 1)), np.zeros((BATCH, n, models * STATES)), np.zeros((BATCH, n, n)))


class FilterpyInteractingBank(InteractingBank):
    """Interacting filters by filterpy: the reference, and slow, for it takes a Python loop over the craft."""

    @cached_property
    def _stacks(self) -> dict[int, tuple[ErrorFilter, Stack]]:
        """The filter that takes craft of so many models, one after the other, and their stack."""
        sizes = set(np.minimum(self._mixtures.models, LANES).tolist())
        return {models: (error_filter(models), Stack.of(models)) for models in sizes}

    @cached_property
    def _blocks(self) -> dict[tuple[int, int], Blocks]:
        """The arrays in which craft of so many models have so many rows, as far as there were any."""
        return {}

    def _batches(self, mask: Bools, rows: Ints | None = None) -> Iterator[tuple[Ints, int, int]]:
        """Yield the craft of the mask in batches of the same numbers of models and of rows, with these numbers."""
        models = np.minimum(self._mixtures.models, LANES).tolist()
        alike: dict[tuple[int, int], list[int]] = {}
        for c in np.flatnonzero(mask).tolist():
            alike.setdefault((models[c], 0 if rows is None else int(rows[c])), []).append(c)
        for numbers, craft in alike.items():
            for first in range(0, len(craft), BATCH):
                yield np.array(craft[first : first + BATCH]), *numbers

    def _predict(self, mask: Bools, step: Floats) -> None:
        mixtures, state = self._mixtures, self._state
        for who, models, _ in self._batches(mask):
            f, stack = self._stacks[models]
            x, p = stack.x, stack.p
            _stack_motion(who, step, self.grid, mixtures, state, stack)
            for b in range(len(who)):
                f.x, f.P, f.F, f.Q = x[b], p[b], stack.f[b], stack.q[b]
                f.predict()
                x[b], p[b] = f.x, f.P
            _take_motion(who, step, stack, mixtures, state)

    def _update(self, mask: Bools, given: Given | Independent | Poses, result: UpdateResult) -> int:
        if isinstance(given, Poses):
            given = given.rows(mask, self._state)
        mixtures, state, covariance = self._mixtures, self._state, self._columns
        if isinstance(given, Independent):
            noise, square = given.variance, np.zeros(len(mask))
        else:
            noise, square = given.r, given.square
        terms = given.gate, given.freedoms, square
        for who, models, n in self._batches(mask, given.rows):
            f, stack = self._stacks[models]
            if (models, n) not in self._blocks:
                self._blocks[models, n] = Blocks.of(models, n)
            x, p, (y, h, r) = stack.x, stack.p, self._blocks[models, n]
            _stack_rows(who, given.y, given.h, noise, mixtures, stack, self._blocks[models, n])
            for b in range(len(who)):
                f.x, f.P = x[b], p[b]
                if not updated(f, y[b], h[b], r[b]) or not _fates(f.y, f.S, f.SI, n, stack.nis[b], stack.volume[b]):
                    return int(who[b])
                x[b], p[b] = f.x, f.P
            if isinstance(given, Independent):
                _take_about(who, terms, given.pivot, stack, mixtures, state, covariance, result)
            else:
                _take(who, terms, stack, mixtures, state, covariance, result)
        return -1


@kernel
def _stack_motion(who: Ints, step: Floats, grid: Grid, mixtures: Mixtures, state: State, stack: Stack) -> None:
    """Mix the models of craft if it is time, and stack them with F and Q of their steps.

    Args:
        who: (B,), the craft.
        step: (C,) [s], the steps of all craft.
        grid: the models.
        mixtures: models of all craft, changed in place.
        state: states of all craft.
        stack: receives x, P, F and Q.
    """
    for b in range(len(who)):
        c = who[b]
        mix_if_due(c, step[c], grid, mixtures)
        _stack_models(b, c, mixtures, stack)
        for at in range(stack.f.shape[1] // STATES):
            own, model = slice(at * STATES, (at + 1) * STATES), model_in(at, mixtures.window[c])
            transition_into(state.angular_rate[c], step[c], stack.f[b, own, own])
            process_noise_into(
                step[c], grid.acceleration[model], grid.angular_acceleration[model], stack.q[b, own, own]
            )


@kernel
def _stack_models(b: int, c: int, mixtures: Mixtures, stack: Stack) -> None:
    """Write means and covariances of all models of craft c in place b of the stack."""
    for at in range(stack.p.shape[1] // STATES):
        own = at * STATES
        for i in range(STATES):
            stack.x[b, own + i, 0] = mixtures.mean[c, i, at]
        from_triangle(mixtures.covariance[c, :, at], stack.p[b, own : own + STATES, own : own + STATES])


@kernel
def _unstack_models(b: int, c: int, stack: Stack, mixtures: Mixtures) -> None:
    """Write means and covariances in place b of the stack into the models of craft c."""
    for at in range(stack.p.shape[1] // STATES):
        own = at * STATES
        for i in range(STATES):
            mixtures.mean[c, i, at] = stack.x[b, own + i, 0]
        to_triangle(stack.p[b, own : own + STATES, own : own + STATES], mixtures.covariance[c, :, at])


@kernel
def _take_motion(who: Ints, step: Floats, stack: Stack, mixtures: Mixtures, state: State) -> None:
    """Give craft `who` (B,) their predicted models on the stack, and the states that go with them."""
    for b in range(len(who)):
        c = who[b]
        _unstack_models(b, c, stack, mixtures)
        propagate(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], step[c])


@kernel
def _stack_rows(
    who: Ints, y: Floats, h: Floats, noise: Floats, mixtures: Mixtures, stack: Stack, blocks: Blocks
) -> None:
    """Stack craft with n rows each, which go into every block.

    Args:
        who: (B,), the craft.
        y: (C, m), of which the first n count.
        h: (C, m, 12), likewise.
        noise: (C, m, m), covariances of the noise, or (C, m), variances.
        mixtures: models of all craft.
        stack: receives x and P.
        blocks: receives the rows.
    """
    n = blocks.y.shape[1] // (stack.p.shape[1] // STATES)
    for b in range(len(who)):
        c = who[b]
        _stack_models(b, c, mixtures, stack)
        for at in range(stack.p.shape[1] // STATES):
            first = at * n
            for i in range(n):
                blocks.y[b, first + i, 0] = y[c, i]
                for j in range(STATES):
                    blocks.h[b, first + i, at * STATES + j] = h[c, i, j]
                for j in range(n):
                    if noise.ndim == 3:
                        blocks.r[b, first + i, first + j] = noise[c, i, j]
                    else:
                        blocks.r[b, first + i, first + j] = noise[c, i] if i == j else 0.0


@kernel
def _fates(y: Floats, s: Floats, inverse: Floats, n: int, nis: Floats, volume: Floats) -> bool:
    """Write NIS and the root of det S (L,) of the models; return False where an S is not positive definite.

    Args:
        y: (M n, 1), innovations.
        s: (M n, M n), their covariances S.
        inverse: (M n, M n), of S.
        n: number of rows of a model.
        nis: (L,), receives the normalised innovations squared.
        volume: (L,), receives the roots of det S.
    """
    lower = np.empty((n, n))
    for at in range(y.shape[0] // n):
        first, squared, root = at * n, 0.0, 1.0
        if not cholesky_into(s[first : first + n, first : first + n], lower):
            return False
        for i in range(n):
            root *= lower[i, i]
            for j in range(n):
                squared += y[first + i, 0] * inverse[first + i, first + j] * y[first + j, 0]
        nis[at], volume[at] = squared, root
    return True


Terms = tuple[Floats, Ints, Floats]
"""Gate, freedoms and square of `Given`."""


@inlined
def _let_in(
    b: int, c: int, terms: Terms, stack: Stack, mixtures: Mixtures, error: Floats, result: UpdateResult
) -> bool:
    """Give craft c, in place b of the stack, its updated models and write their mean error (12,), if its rows are let
    in; return whether they are.
    """
    gate, freedoms, square = terms
    nis, volume = lanes_in(stack.nis)[b] + square[c], lanes_in(stack.volume)[b]
    accepted = let_in(c, nis, volume, gate[freedoms[c]], mixtures, result)
    if accepted:
        _unstack_models(b, c, stack, mixtures)
        centre(c, mixtures, error)
    return accepted


@kernel
def _take(
    who: Ints, terms: Terms, stack: Stack, mixtures: Mixtures, state: State, covariance: Floats, result: UpdateResult
) -> None:
    """Give craft `who` (B,) whose rows are let in their updated models, and their states the mean error."""
    error, freedoms = scratch(0.0, STATES), terms[1]
    for b in range(len(who)):
        c = who[b]
        if _let_in(b, c, terms, stack, mixtures, error, result):
            correct(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], error)
            combine(c, mixtures, covariance)
            settle(c, freedoms[c], mixtures)


@kernel
def _take_about(
    who: Ints,
    terms: Terms,
    pivot: Floats,
    stack: Stack,
    mixtures: Mixtures,
    state: State,
    covariance: Floats,
    result: UpdateResult,
) -> None:
    """`_take` where the bodies turn about points of their own, pivot (C, PIVOT). Apart: it takes long to compile."""
    error, arms, freedoms = scratch(0.0, STATES), scratch(0.0, ARMS), terms[1]
    for b in range(len(who)):
        c = who[b]
        if _let_in(b, c, terms, stack, mixtures, error, result):
            rotation, rate = state.rotation[c], state.angular_rate[c]
            turn_about(rotation, rate, state.position[c], state.velocity[c], error, pivot[c], arms)
            shear_models(c, arms, mixtures)
            combine(c, mixtures, covariance)
            settle(c, freedoms[c], mixtures)
