"""Errors that a false photodiode among the rows of C craft may bring into their filters, as a kernel.

Photodiode k errs by b, one number per row. The gate sees the noncentrality b^T E^T S^-1 E b of it, with the selection E
of its rows and S = H P H^T + R. A filter that follows the error in the end, as if it knew nothing, moves by

    o G b,   G = Q H^T (H Q H^T + R)^-1 E,   Q = f P,   f = `FORGOTTEN`,   o = `OVERSHOOT`

and the slope is the largest ratio of |o G b| to the root of the noncentrality, over b and k: with the least
noncentrality L that the gate does not miss, the error is at most slope sqrt(L). One or two photodiodes leave turns and
the distance open; there nothing takes back what the error has put into the rates, and their part grows with the time
for which this has lasted.

It is computed in information form: with W H the whitened rows of a period and Z = R^-1 H = W^T W H,

    S^-1 = R^-1 - Z (P^-1 + H^T Z)^-1 Z^T,      Q H^T (H Q H^T + R)^-1 = (Q^-1 + H^T Z)^-1 Z^T

in which the matrices to invert have 12 rows, however many angles the period has. A photodiode is false before one
station; of that, all rows of the period.
"""

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.innovation import SWEEPS, Innovations, RowBatch, StationArrays
from estimators.linear import cholesky_into, sweep_out
from estimators.state import STATES

FORGOTTEN = 100.0
"""Factor of the covariance of a filter that follows a false photodiode for long: its own state counts a tenth."""
OVERSHOOT = 1.25
"""By how much a filter that has rates in its state exceeds a step that it follows: 21 % with the damping of a Kalman
filter of constant velocity, 1 / sqrt(2)."""


def row_faults(
    rows: RowBatch,
    kept: Bools,
    mask: Bools,
    found: Innovations,
    light: StationArrays,
    covariance: Floats,
    open_s: Floats,
) -> Floats:
    """Return the largest error per root of noncentrality, (2, C): of position [m] and of attitude [rad].

    Zero for craft outside the mask, infinite where a fault does not show at all.

    Args:
        rows: rows of C craft.
        kept: (N,), those that were taken in.
        mask: (C,), the craft concerned.
        found: innovations of the kept rows of the craft of the mask, with their derivatives.
        light: stations with the noise of their rows.
        covariance: (C, 12, 12), P.
        open_s: (C,) [s], time for which the light has left a part of the pose open.
    """
    out = np.zeros((2, len(mask)))
    _faults_into(mask, rows, kept, found, light, covariance, open_s, out)
    return out


@kernel
def _faults_into(
    mask: Bools,
    rows: RowBatch,
    kept: Bools,
    found: Innovations,
    light: StationArrays,
    covariance: Floats,
    open_s: Floats,
    out: Floats,
) -> None:
    """Write the slopes of every craft of the mask."""
    most = found.y.shape[1]
    work, source = np.empty((2, most), np.int64), np.empty((2, most), np.int64)
    z, inverse = np.empty((most, STATES)), np.empty((2, STATES, STATES))
    for c in range(len(mask)):
        if not mask[c]:
            continue
        n = 0
        for r in range(rows.first[c], rows.first[c + 1]):
            if kept[r]:
                s = rows.station[r]
                work[0, n], work[1, n] = (light.first[s] + rows.fan[r]) * SWEEPS + rows.sweep[r], s
                source[0, n], source[1, n] = s, rows.photodiode[r]
                n += 1
        _unwhitened(found.h[c], n, work, light, z)
        if not _inverses(covariance[c], found.h[c], n, inverse):
            out[:, c] = np.inf
            continue
        _worst(z, n, work, light, source, inverse, open_s[c], out[:, c])


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
        size = end - begin
        share, over = (1 - own / np.sqrt(own * own + size * shared * shared)) / size, 1 / own
        for k in range(begin, end):
            for i in range(STATES):
                z[k, i] = (h[k, i] - share * total[i]) * over
        begin = end


@kernel
def _inverses(covariance: Floats, h: Floats, n: int, out: Floats) -> bool:
    """Write (P^-1 + N)^-1 and ((f P)^-1 + N)^-1, with N of n whitened rows; False where P is singular."""
    information, told = np.empty((STATES, STATES)), np.zeros((STATES, STATES))
    row = np.empty(STATES)
    information[:] = covariance
    if not sweep_out(information, row):
        return False
    for k in range(n):
        for i in range(STATES):
            factor = h[k, i]
            for j in range(STATES):
                told[i, j] += factor * h[k, j]
    for which in range(2):
        scale = 1.0 if which == 0 else 1 / FORGOTTEN
        for i in range(STATES):
            for j in range(STATES):
                out[which, i, j] = scale * information[i, j] + told[i, j]
        if not sweep_out(out[which], row):
            return False
    return True


@kernel
def _worst(
    z: Floats, n: int, work: Ints, light: StationArrays, source: Ints, inverse: Floats, open_s: float, out: Floats
) -> None:
    """Write the largest slopes (2,) of any photodiode before a station."""
    of, done, common = np.empty(n, np.int64), np.zeros(n, np.bool_), np.empty(n)
    _commons_into(n, work, light, common)
    shown, lower, across = np.empty((n, n)), np.empty((n, n)), np.empty((STATES, n))
    moved, seen = np.empty((n, STATES)), np.empty((2, STATES))
    for first in range(n):
        if done[first]:
            continue
        b = 0
        for k in range(first, n):
            if source[0, k] == source[0, first] and source[1, k] == source[1, first]:
                of[b], done[k] = k, True
                for p in range(STATES):
                    across[p, b] = z[k, p]
                b += 1
        for i in range(b):
            own = light.own[work[1, of[i]]]
            seen[:] = 0.0
            for m in range(STATES):
                factor = z[of[i], m]
                for p in range(STATES):
                    seen[0, p] += factor * inverse[0, m, p]
                    seen[1, p] += factor * inverse[1, m, p]
            for m in range(STATES):
                moved[i, m] = seen[1, m]
            for j in range(i + 1):
                shown[i, j] = 0.0
                if work[0, of[i]] == work[0, of[j]]:
                    shown[i, j] = ((1.0 if i == j else 0.0) - common[of[i]]) / (own * own)
            # Sums over the states go on side by side: one after the other, each would wait for its own last term.
            for p in range(STATES):
                factor = seen[0, p]
                for j in range(i + 1):
                    shown[i, j] -= factor * across[p, j]
        if not cholesky_into(shown[:b, :b], lower[:b, :b]):
            out[:] = np.inf
            return
        # G L^-T, column by column: L x = g.
        for i in range(b):
            for j in range(i):
                factor = lower[i, j]
                for m in range(STATES):
                    moved[i, m] -= factor * moved[j, m]
            for m in range(STATES):
                moved[i, m] /= lower[i, i]
        out[0] = max(out[0], OVERSHOOT * (_norm(moved, b, 6) + open_s * _norm(moved, b, 9)))
        out[1] = max(out[1], OVERSHOOT * (_norm(moved, b, 0) + open_s * _norm(moved, b, 3)))


@kernel
def _commons_into(n: int, work: Ints, light: StationArrays, out: Floats) -> None:
    """Write k of Sherman and Morrison, b^2 / (a^2 + n b^2), of the sweep of every row."""
    begin = 0
    while begin < n:
        end = begin
        while end < n and work[0, end] == work[0, begin]:
            end += 1
        own, shared = light.own[work[1, begin]], light.shared[work[1, begin]]
        for k in range(begin, end):
            out[k] = shared * shared / (own * own + (end - begin) * shared * shared)
        begin = end


@kernel
def _norm(m: Floats, b: int, first: int) -> float:
    """Return the largest singular value of three columns of m (b, 12): of M^T M by the cosine of a third of an angle.

    Args:
        m: (b, 12), or more rows.
        b: number of rows.
        first: the first of the three columns.
    """
    if b <= 2:  # of M M^T
        near, cross, far = 0.0, 0.0, 0.0
        for i in range(first, first + 3):
            near += m[0, i] * m[0, i]
            if b == 2:
                cross, far = cross + m[0, i] * m[1, i], far + m[1, i] * m[1, i]
        apart = (near - far) / 2
        return float(np.sqrt((near + far) / 2 + np.sqrt(apart * apart + cross * cross)))
    square = np.zeros((3, 3))
    for i in range(3):
        for j in range(i + 1):
            for k in range(b):
                square[i, j] += m[k, first + i] * m[k, first + j]
    mean = (square[0, 0] + square[1, 1] + square[2, 2]) / 3
    x, y, z = square[0, 0] - mean, square[1, 1] - mean, square[2, 2] - mean
    u, v, w = square[1, 0], square[2, 0], square[2, 1]
    spread = (x * x + y * y + z * z + 2 * (u * u + v * v + w * w)) / 6
    if not spread > 0:
        return float(np.sqrt(mean))
    root = np.sqrt(spread)
    half = (x * (y * z - w * w) - u * (u * z - w * v) + v * (u * w - y * v)) / (2 * spread * root)
    third = np.arccos(min(max(half, -1.0), 1.0)) / 3
    return float(np.sqrt(mean + 2 * root * np.cos(third)))
