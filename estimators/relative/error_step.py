"""The error of a filter over one period: what is kept of it, and what errors add that other craft share.

With F of the prediction, and an update x <- x + K (y - H x) of rows whose noise is G u + D q + own noise, u draws that
are new in every period and q constant, the error e = truth minus estimate of a filter becomes

    e <- A e - B u - C q + own noise and process noise,   A = (I - K H) F,   B = K G,   C = K D

K = P H^T R^-1 with the covariance P after the update, so that an update needs no more than three sums over its rows,

    A <- (I - P L) A,  B <- (I - P L) B + P H^T R^-1 G,  C likewise,     L = H^T R^-1 H

whatever filter has found P, also one whose models of motion share the rows: its gain is the mean of theirs, and P that
of theirs but for the spread of their means. A filter that starts with a pose has A = 0.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.lighthouse.shared import Shared
from estimators.state import STATES


class ErrorStep(NamedTuple):
    """One period of C filters: kept A (C, 12, 12), drawn B (C, 12, M) of draws of variance one, considered C (C, 12,
    Q); instant (C, M) [s], tells the draws apart: those of two craft are the same where their instants are.
    """

    kept: Floats
    drawn: Floats
    considered: Floats
    instant: Floats

    def of(self, craft: int) -> "ErrorStep":
        """Return the period of one filter, without the craft axis."""
        return ErrorStep._make(part[craft] for part in self)


def predicted(transition: Floats, active: Bools, draws: int, errors: int) -> ErrorStep:
    """Return the period so far of filters that were predicted.

    Args:
        transition: (C, 12, 12), F.
        active: (C,); the others keep nothing.
        draws: number M.
        errors: number Q.
    """
    craft = len(active)
    kept = np.where(active[:, None, None], transition, 0.0)
    return ErrorStep(
        kept, np.zeros((craft, STATES, draws)), np.zeros((craft, STATES, errors)), np.full((craft, draws), np.nan)
    )


def updated(step: ErrorStep, mask: Bools, covariance: Floats, rows: Shared) -> ErrorStep:
    """Return the period after an update of the filters of the mask.

    Args:
        step: the period so far.
        mask: (C,), filters that took the rows in.
        covariance: (C, 12, 12), P after it.
        rows: their sums, weighted.
    """
    who = np.flatnonzero(mask)
    if not len(who):
        return step
    p = covariance[who]
    left = np.eye(STATES) - p @ rows.information[who]
    kept, drawn, considered, instant = (part.copy() for part in step)
    kept[who] = left @ kept[who]
    drawn[who] = left @ drawn[who] + p @ rows.sweeps[who]
    considered[who] = left @ considered[who] + p @ rows.considered[who]
    instant[who] = np.where(np.isfinite(rows.instant[who]), rows.instant[who], instant[who])
    return ErrorStep(kept, drawn, considered, instant)


def started(step: ErrorStep, mask: Bools, drawn: Floats, considered: Floats, instant: Floats) -> ErrorStep:
    """Return the period of filters of which those of the mask have started with a pose.

    Args:
        step: the period so far.
        mask: (C,).
        drawn: (C, 6, M), by how much the poses (attitude, position) are off by the draws.
        considered: (C, 6, Q), likewise by the constant errors.
        instant: (C, M) [s].
    """
    if not mask.any():
        return step
    out = ErrorStep._make(part.copy() for part in step)
    for own, given in ((out.drawn, drawn), (out.considered, considered)):
        own[mask] = 0.0
        own[np.ix_(mask, _POSE)] = given[mask]
    out.kept[mask] = 0.0
    out.instant[mask] = instant[mask]
    return out


def sums_of_pose(
    pose: Floats, rates: Floats, off: tuple[Floats, Floats, Floats], mask: Bools, covariance: Floats | None = None
) -> Shared:
    """Return the weighted sums of six rows y = pose d + rates dw + noise that stand for a solved pose.

    Args:
        pose: (C, 6, 6), derivatives by the error d of (attitude, position).
        rates: (C, 6, 6) [s], by that of their rates.
        off: by how much a pose is off by the draws (C, 6, M), by the constant errors (C, 6, Q), and the draws' instants
            (C, M) [s].
        mask: (C,), craft to compute; zero for the others.
        covariance: (C, 6, 6) of the noise; None: one.
    """
    craft, (drawn, considered, instant) = len(mask), off
    h = np.zeros((craft, 6, STATES))
    h[:, :, _POSE], h[:, :, _RATES] = pose, rates
    h[~mask] = 0.0
    weight = h if covariance is None else np.linalg.solve(np.where(mask[:, None, None], covariance, np.eye(6)), h)
    weight = np.swapaxes(weight, 1, 2)
    moved = np.where(mask[:, None, None], pose, 0.0)
    return Shared(weight @ h, weight @ (moved @ drawn), weight @ (moved @ considered), instant)


_POSE = np.array([0, 1, 2, 6, 7, 8])
_RATES = np.array([3, 4, 5, 9, 10, 11])
