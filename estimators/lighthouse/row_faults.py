"""Errors that a false photodiode among the rows of C craft may bring into their filters, as a kernel.

The slopes of `innovation.fault_slopes`, in information form: with W H the whitened rows of a period, the covariance P,
Z = R^-1 H = W^T W H and Q = f P,

    S^-1 = R^-1 - Z (P^-1 + H^T Z)^-1 Z^T,      Q H^T (H Q H^T + R)^-1 = (Q^-1 + H^T Z)^-1 Z^T

in which the matrices to invert have 12 rows, however many angles the period has. A photodiode is false before one
station; of that, all rows of the period.
"""

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.innovation import (
    FORGOTTEN,
    OVERSHOOT,
    Innovations,
    RowBatch,
    StationArrays,
    whitened_into,
)
from estimators.linear import cholesky_into, invert_spd_into
from estimators.state import STATES, State

ROUNDS = 30
"""Rounds of the power method, which finds the largest of three eigenvalues; a half of the second's leaves 1e-9."""


def row_faults(
    rows: RowBatch, kept: Bools, mask: Bools, light: StationArrays, point_m: Floats, state: State, covariance: Floats
) -> Floats:
    """Return the largest error per root of noncentrality, (2, C): of position [m] and of attitude [rad].

    Zero for craft outside the mask, infinite where a fault does not show at all.

    Args:
        rows: rows of C craft.
        kept: (N,), those that were taken in; all of photodiodes in front of their stations.
        mask: (C,), the craft concerned.
        light: stations with the noise of their rows.
        point_m: (C, K, 3) [m], photodiodes in the body frames.
        state: of C craft.
        covariance: (C, 12, 12), P.
    """
    craft, most = len(mask), int(np.diff(rows.first).max(initial=0))
    inner = Innovations(
        np.empty((craft, most)), np.empty((craft, most, STATES)), np.zeros(craft, dtype=np.int64), np.zeros((craft, 3))
    )
    out = np.zeros((2, craft))
    _faults_into(mask, rows, kept.copy(), light, np.ascontiguousarray(point_m), state, covariance, inner, out)
    return out


@kernel
def _faults_into(
    mask: Bools,
    rows: RowBatch,
    kept: Bools,
    light: StationArrays,
    point: Floats,
    state: State,
    covariance: Floats,
    inner: Innovations,
    out: Floats,
) -> None:
    """Write the slopes of every craft of the mask."""
    most = inner.y.shape[1]
    work, source = np.empty((2, most), np.int64), np.empty(most, np.int64)
    z, inverse = np.empty((most, STATES)), np.empty((2, STATES, STATES))
    for c in range(len(mask)):
        if not mask[c]:
            continue
        whitened_into(c, rows, kept, light, point, state, inner, work, True)
        n = inner.number[c]
        k = 0
        for r in range(rows.first[c], rows.first[c + 1]):
            if kept[r]:
                source[k] = rows.station[r] * point.shape[1] + rows.photodiode[r]
                k += 1
        _unwhitened(inner.h[c], n, work, light, z)
        if not _inverses(covariance[c], inner.h[c], n, inverse):
            out[:, c] = np.inf
            continue
        _worst(z, n, work, light, source, inverse, out[:, c])


@kernel
def _share(n: int, own: float, shared: float) -> float:
    """Return c of W = (I - c 1 1^T) / a."""
    share: float = (1 - own / np.sqrt(own * own + n * shared * shared)) / n
    return share


@kernel
def _unwhitened(h: Floats, n: int, work: Ints, light: StationArrays, z: Floats) -> None:
    """Write Z = W^T W H from W H (n, 12)."""
    total = np.empty(STATES)
    begin = 0
    while begin < n:
        end = begin
        total[:] = 0.0
        while end < n and work[0, end] == work[0, begin]:
            for i in range(STATES):
                total[i] += h[end, i]
            end += 1
        own, shared = light.own[work[1, begin]], light.shared[work[1, begin]]
        share = _share(end - begin, own, shared)
        for k in range(begin, end):
            for i in range(STATES):
                z[k, i] = (h[k, i] - share * total[i]) / own
        begin = end


@kernel
def _inverses(covariance: Floats, h: Floats, n: int, out: Floats) -> bool:
    """Write (P^-1 + N)^-1 and ((f P)^-1 + N)^-1, with N of n whitened rows; False where P is singular."""
    information, total = np.empty((STATES, STATES)), np.empty((STATES, STATES))
    if not invert_spd_into(covariance, information):
        return False
    for which in range(2):
        scale = 1.0 if which == 0 else 1 / FORGOTTEN
        for i in range(STATES):
            for j in range(STATES):
                total[i, j] = scale * information[i, j]
        for k in range(n):
            for i in range(STATES):
                for j in range(STATES):
                    total[i, j] += h[k, i] * h[k, j]
        if not invert_spd_into(total, out[which]):
            return False
    return True


@kernel
def _worst(z: Floats, n: int, work: Ints, light: StationArrays, source: Ints, inverse: Floats, out: Floats) -> None:
    """Write the largest slopes (2,) of any photodiode before a station."""
    of, done = np.empty(n, np.int64), np.zeros(n, np.bool_)
    for first in range(n):
        if done[first]:
            continue
        b = 0
        for k in range(first, n):
            if source[k] == source[first]:
                of[b], done[k] = k, True
                b += 1
        shown, lower = np.empty((b, b)), np.empty((b, b))
        moved = np.empty((STATES, b))
        for i in range(b):
            for j in range(b):
                shown[i, j] = _seen(z, of[i], of[j], work, light, n, inverse[0])
            for m in range(STATES):
                moved[m, i] = 0.0
                for p in range(STATES):
                    moved[m, i] += inverse[1, m, p] * z[of[i], p]
        if not cholesky_into(shown, lower):
            out[:] = np.inf
            return
        # G L^-T, row by row: L x = g.
        for m in range(STATES):
            for i in range(b):
                for j in range(i):
                    moved[m, i] -= lower[i, j] * moved[m, j]
                moved[m, i] /= lower[i, i]
        out[0] = max(out[0], OVERSHOOT * _norm(moved[6:9]))
        out[1] = max(out[1], OVERSHOOT * _norm(moved[0:3]))


@kernel
def _seen(z: Floats, i: int, j: int, work: Ints, light: StationArrays, n: int, inverse: Floats) -> float:
    """Return an element of S^-1."""
    total = 0.0
    if work[0, i] == work[0, j]:
        size = 0
        for k in range(n):
            if work[0, k] == work[0, i]:
                size += 1
        own, shared = light.own[work[1, i]], light.shared[work[1, i]]
        common = shared * shared / (own * own + size * shared * shared)
        total = ((1.0 if i == j else 0.0) - common) / (own * own)
    for a in range(STATES):
        for b in range(STATES):
            total -= z[i, a] * inverse[a, b] * z[j, b]
    return total


@kernel
def _norm(m: Floats) -> float:
    """Return the largest singular value of m (3, b)."""
    square, v, w = np.zeros((3, 3)), np.ones(3), np.empty(3)
    for i in range(3):
        for j in range(3):
            for k in range(m.shape[1]):
                square[i, j] += m[i, k] * m[j, k]
    value = 0.0
    # Begun on the longest row, which the largest eigenvector is not perpendicular to.
    best = 0
    for i in range(1, 3):
        if square[i, i] > square[best, best]:
            best = i
    for i in range(3):
        v[i] = square[i, best]
    for _ in range(ROUNDS):
        length = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        if not length > 0:
            return 0.0
        for i in range(3):
            v[i] /= length
        for i in range(3):
            w[i] = square[i, 0] * v[0] + square[i, 1] * v[1] + square[i, 2] * v[2]
        value = w[0] * v[0] + w[1] * v[1] + w[2] * v[2]
        v[:] = w
    return float(np.sqrt(value))
