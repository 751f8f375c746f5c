"""The covariance between the errors of two filters, carried from period to period.

    E[e_i e_j^T] <- A_i E[e_i e_j^T] A_j^T + B_i M B_j^T

with A and B of `estimators.relative.error_step`, and M (M_i, M_j) one where draw m of craft i is draw n of craft j: the
sweep has met both. Constant errors q that both consider are kept apart: e = e' - S q with S <- A S + C and q of
covariance V, so that their part S_i V S_j^T is exact, however long the filters forget, and

    E[e_i e_i^T] = P_i + S_i V S_i^T

is what a craft knows of itself, P the covariance of its filter, which does not know of q (S. F. Schmidt's considered
errors, for a gain that is the filter's own).
"""

import numpy as np

from estimators.arrays import Floats
from estimators.lighthouse.shared import SWEEPS_PER_FAN
from estimators.relative.error_step import ErrorStep

SAME_S = 2e-4
"""Instants of a sweep found by two craft differ by less [s]."""


def cross_covariance(before: Floats, a: ErrorStep, b: ErrorStep) -> Floats:
    """Return the covariance (12, 12) between the errors of two filters after a period, without considered errors.

    Args:
        before: (12, 12), before it.
        a: the period of the first filter, without the craft axis.
        b: that of the second.
    """
    out: Floats = a.kept @ before @ b.kept.T + a.drawn @ shared_draws(a.instant, b.instant) @ b.drawn.T
    return out


def shared_draws(a: Floats, b: Floats) -> Floats:
    """Return 1 where two instants are of one sweep, (..., M_a, M_b), with the sweeps of each in the order of the fans.

    Both have as many sweeps of each fan.

    Args:
        a: (..., M_a) [s].
        b: (M_b,) [s].
    """
    fan = np.arange(a.shape[-1]) // SWEEPS_PER_FAN
    with np.errstate(invalid="ignore"):
        out: Floats = np.where((np.abs(a[..., None] - b) < SAME_S) & (fan[:, None] == fan), 1.0, 0.0)
    return out


def considered(before: Floats, step: ErrorStep) -> Floats:
    """Return S (12, Q), or (C, 12, Q), after a period: e = e' - S q.

    Args:
        before: likewise, before it.
        step: the period.
    """
    out: Floats = step.kept @ before + step.considered
    return out
