"""Errors of craft that carry stations, in the filters of those that navigate by these.

A station that rides on craft b is taken to be where b tells that it is. Rows depend on where a craft is before a
station, so that an error e_b of b, truth minus what it tells, is in them as an error of the craft's own state,

    y = H (e - T e_b) + noise,    T e_b = (d_b, dw_b, dp_b + d_b x a, dv_b + dw_b x a + d_b x u)

with a = p - p_b, u = v - v_b and (attitude, angular rate, position, velocity) errors. A filter that takes e_b for noise
that all rows of b's stations share, of the covariance N = T D T^T with b's own D, weighs them by

    R' = R + H N H^T,    H^T R'^-1 x = (I + L N)^-1 H^T R^-1 x,    L = H^T R^-1 H

But e_b lasts: what the filter believes to have averaged out is in its error still. With A, B of
`estimators.relative.error_step`, G = P H^T R'^-1 H T the part of the errors e_B^- of all bearers that it takes over in
a period, and the predicted covariance S^- of these,

    e <- A e + G e_B^- - B u + own noise and process noise

    X = E[e e_B^T] <- Y M_B^T + Y G_B^T + B B_B^T,     Y = A X F_B^T + G S^-,     A_B = M_B F_B
    E[e e^T] = P + V,   V <- A V A^T + G (S^- - diag D) G^T + Z + Z^T,     Z = A X F_B^T G^T

P is what the filter believes: each e_b anew in every period, with its covariance D. Of a bearer itself Y is M_B S^- +
G S^- instead. A bearer may navigate by other bearers.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.relative.cross import shared_draws
from estimators.relative.error_step import ErrorStep
from estimators.rotation import skew
from estimators.state import STATES, State

_TURN, _RATE, _PLACE, _SPEED = (slice(i, i + 3) for i in range(0, STATES, 3))


def moved_alike(state: State, position: Floats, velocity: Floats) -> Floats:
    """Return T (C, 12, 12), what an error of a bearer is as one of each craft.

    Args:
        state: the craft.
        position: (3,) [m], of the bearer.
        velocity: (3,) [m/s], likewise.
    """
    out = np.tile(np.eye(STATES), (len(state.position), 1, 1))
    arm, away = skew(state.position - position), skew(state.velocity - velocity)
    out[:, _PLACE, _TURN], out[:, _SPEED, _RATE], out[:, _SPEED, _TURN] = -arm, -arm, -away
    return out


def with_common_error(y: Floats, h: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return rows with noise of variance one, y (n,) and H (n, 12), from such rows with a common error besides.

    Args:
        y: (n,).
        h: (n, 12).
        covariance: (12, 12), N of the error, of which each row has H times it.
    """
    root = np.linalg.cholesky(np.eye(len(y)) + h @ covariance @ h.T)
    both = np.linalg.solve(root, np.column_stack([y, h]))
    return both[:, 0], both[:, 1:]


class Told(NamedTuple):
    """Messages of m bearers for a period: transition (m, 12, 12), F of their prediction; covariance (m, 12, 12), D of
    their predicted errors, all that they know of themselves; joint (12 m, 12 m), S^-, without errors that stay.
    """

    transition: Floats
    covariance: Floats
    joint: Floats


class BearerErrors:
    """The errors that C filters have in common with those of m bearers, which are among these craft.

    cross: (C, 12, 12 m), X. beyond: (C, 12, 12), V.
    """

    def __init__(self, bearers: Ints, craft: int) -> None:
        """Begin with filters that have not been started.

        Args:
            bearers: (m,), index of each bearer.
            craft: number C.
        """
        self.bearers = bearers
        self.cross = np.zeros((craft, STATES, STATES * len(bearers)))
        self.beyond = np.zeros((craft, STATES, STATES))

    def told(self, active: Bools, transition: Floats, covariance: Floats, stays: Floats) -> Told:
        """Return what the bearers tell of their predictions; zero of those that know nothing.

        Args:
            active: (C,), filters that run.
            transition: (C, 12, 12), F.
            covariance: (C, 12, 12), P of the predictions.
            stays: (C, 12, 12), covariance of errors that stay, such as those of fans.
        """
        own, b = np.where(active[self.bearers, None, None], transition[self.bearers], 0.0), self.bearers
        joint = np.zeros((STATES * len(b), STATES * len(b)))
        of = np.zeros((len(b), STATES, STATES))
        for i, craft in enumerate(b.tolist()):
            if not active[craft]:
                continue
            for j, other in enumerate(b.tolist()):
                if j != i and active[other]:
                    joint[_block(i), _block(j)] = own[i] @ self.cross[craft, :, _block(j)] @ own[j].T
            alone = covariance[craft] + own[i] @ self.beyond[craft] @ own[i].T
            joint[_block(i), _block(i)], of[i] = alone, alone + stays[craft]
        # Both halves come from two recursions that agree but for rounding.
        return Told(own, of, (joint + joint.T) / 2)

    def end(self, step: ErrorStep, taken: Floats, told: Told) -> None:
        """Carry everything on by a period.

        Args:
            step: A and B of every craft.
            taken: (C, 12, 12 m), G.
            told: as the bearers told.
        """
        count = len(self.bearers)
        before = np.concatenate(
            [step.kept @ self.cross[:, :, _block(j)] @ told.transition[j].T for j in range(count)], axis=2
        )
        both = before @ np.swapaxes(taken, 1, 2)
        apart = told.joint.copy()
        for j in range(count):
            apart[_block(j), _block(j)] -= told.covariance[j]
        kept = step.kept @ self.beyond @ np.swapaxes(step.kept, 1, 2)
        self.beyond = kept + taken @ apart @ np.swapaxes(taken, 1, 2) + both + np.swapaxes(both, 1, 2)
        with_told = before + taken @ told.joint
        update = np.zeros((count, STATES, STATES))
        for j, craft in enumerate(self.bearers.tolist()):
            if told.transition[j].any():
                update[j] = step.kept[craft] @ np.linalg.inv(told.transition[j])
            with_told[craft] = update[j] @ told.joint[_block(j)] + taken[craft] @ told.joint
        self.cross = np.concatenate(
            [
                with_told[:, :, _block(j)] @ update[j].T
                + with_told @ taken[craft].T
                + step.drawn @ shared_draws(step.instant, step.instant[craft]) @ step.drawn[craft].T
                for j, craft in enumerate(self.bearers.tolist())
            ],
            axis=2,
        )


def _block(number: int) -> slice:
    return slice(STATES * number, STATES * (number + 1))
