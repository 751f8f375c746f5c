"""Small symmetric positive definite systems, as kernels: by Cholesky, A = L L^T, and without roots.

A normal matrix that is not positive definite means that the geometry does not determine the answer: the kernels say
so with False. `solve_spd` and `invert_symmetric` take matrices of numbers, or of lanes, and then return a mask.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import inlined, kernel

SINGULAR = 1e-14
"""Share of a diagonal element that a pivot keeps at least where a matrix is positive definite: less is rounding."""


@kernel
def cholesky_into(a: Floats, out: Floats) -> bool:
    """Write the lower factor L of `a` (n, n) into `out` (n, n); False, with `out` spoilt, where a pivot is not safely
    positive.
    """
    n, regular = a.shape[0], True
    for j in range(n):
        pivot = a[j, j]
        for k in range(j):
            pivot -= out[j, k] * out[j, k]
        # A pivot that lost 14 digits to cancellation is rounding noise: the matrix is singular.
        regular = regular & (pivot > SINGULAR * a[j, j])
        out[j, j] = np.sqrt(pivot)
        for i in range(j + 1, n):
            s = a[i, j]
            for k in range(j):
                s -= out[i, k] * out[j, k]
            out[i, j] = s / out[j, j]
        for i in range(j):
            out[i, j] = 0.0
    return regular


@inlined
def solve_spd(a: Floats, factor: Floats, b: Floats) -> bool:
    """Solve A x = b in place, of numbers or of lanes; return False, with `b` spoilt, where A is singular.

    A = L D L^T with ones on L's diagonal: no root, and one division a pivot, which takes as long as a dozen products.

    Args:
        a: (n, n), of which only the lower triangle is read.
        factor: (n, n), workspace: L D below the diagonal, D^-1 on it, L^T above it.
        b: (n,), becomes x.
    """
    n, regular = a.shape[0], True
    for j in range(n):
        pivot, value = a[j, j], b[j]
        for k in range(j):
            pivot -= factor[j, k] * factor[k, j]
            value -= factor[k, j] * b[k]
        regular = regular & (pivot > SINGULAR * a[j, j])
        b[j] = value
        over = 1 / pivot
        factor[j, j] = over
        for i in range(j + 1, n):
            s = a[i, j]
            for k in range(j):
                s -= factor[i, k] * factor[k, j]
            factor[i, j], factor[j, i] = s, s * over
    for i in range(n - 1, -1, -1):
        s = b[i] * factor[i, i]
        for k in range(i + 1, n):
            s -= factor[i, k] * b[k]
        b[i] = s
    return regular


@kernel
def solve_cholesky(lower: Floats, b: Floats) -> None:
    """Solve L L^T x = b (n,) in place: `b` becomes x."""
    n = lower.shape[0]
    for i in range(n):
        s = b[i]
        for k in range(i):
            s -= lower[i, k] * b[k]
        b[i] = s / lower[i, i]
    for i in range(n - 1, -1, -1):
        s = b[i]
        for k in range(i + 1, n):
            s -= lower[k, i] * b[k]
        b[i] = s / lower[i, i]


@kernel
def invert_spd_into(a: Floats, out: Floats) -> bool:
    """Write the inverse of `a` (n, n) into `out` (n, n); False, with `out` untouched, where `a` is singular."""
    n = a.shape[0]
    lower = np.empty((n, n))
    if not cholesky_into(a, lower):
        return False
    invert_factor_into(lower, out)
    return True


@kernel
def invert_factor_into(lower: Floats, out: Floats) -> None:
    """Write (L L^T)^-1 of a lower factor (n, n), which is spoilt, into `out` (n, n)."""
    n = lower.shape[0]
    # L^-1 in the place of L, column by column; then A^-1 = L^-T L^-1.
    for j in range(n):
        lower[j, j] = 1 / lower[j, j]
        for i in range(j + 1, n):
            s = 0.0
            for k in range(j, i):
                s -= lower[i, k] * lower[k, j]
            lower[i, j] = s / lower[i, i]
    for i in range(n):
        for j in range(i + 1):
            s = 0.0
            for k in range(i, n):
                s += lower[k, i] * lower[k, j]
            out[i, j] = out[j, i] = s


@inlined
def invert_symmetric(a: Floats, row: Floats, out: Floats) -> bool:
    """Write the inverse of `a` (n, n), of numbers or of lanes, into `out` (n, n); return False, with `out` spoilt,
    where it is singular.

    A pivot after the other is swept, as by `sweep_out`, in the lower triangle, which ends as that of -A^-1: no root,
    and one division a pivot.

    Args:
        a: (n, n), of which only the lower triangle is read.
        row: (n,), workspace.
        out: receives it, symmetric to the bit.
    """
    n, regular = len(row), True
    for i in range(n):
        for j in range(i + 1):
            out[i, j] = a[i, j]
    for k in range(n):
        regular = regular & (out[k, k] > SINGULAR * a[k, k])
        over = 1 / out[k, k]
        for j in range(k):
            row[j] = out[k, j]
        for j in range(k, n):
            row[j] = out[j, k]
        for i in range(n):
            factor = row[i] * over
            for j in range(i + 1):
                out[i, j] -= factor * row[j]
        for j in range(k):
            out[k, j] = row[j] * over
        for i in range(k + 1, n):
            out[i, k] = row[i] * over
        out[k, k] = -over
    for i in range(n):
        for j in range(i + 1):
            out[i, j] = out[j, i] = -out[i, j]
    return regular


@kernel
def sweep_out(a: Floats, row: Floats) -> bool:
    """Put the inverse of `a` (n, n) in its place; return False, with `a` spoilt, where it is singular.

    Gauss and Jordan's way, a pivot after the other on the diagonal: for a positive definite matrix as exact as by its
    root, and every step goes along whole rows. row: (n,), workspace.
    """
    n = len(row)
    for k in range(n):
        row[k] = a[k, k]
    for k in range(n):
        pivot = a[k, k]
        if not (pivot > SINGULAR * row[k]):
            return False
        over = 1 / pivot
        for j in range(n):
            a[k, j] *= over
        a[k, k] = over
        for i in range(n):
            if i != k:
                factor = a[i, k]
                a[i, k] = 0.0
                for j in range(n):
                    a[i, j] -= factor * a[k, j]
    return True


@kernel
def absorb_row(p: Floats, x: Floats, h: Floats, y: float, variance: float, gain: Floats, scale: Floats) -> float:
    """Take one measurement y = h x + noise into an estimate x of covariance P, of numbers or of lanes, in place; return
    its share of the NIS.

        s = h P h^T + r,   x <- x + P h^T (y - h x) / s,   P <- P - P h^T h P / s,   NIS = (y - h x)^2 / s

    Rows whose noise is independent are taken in one after the other.

    Args:
        p: (n, n), P, symmetric.
        x: (n,).
        h: (n,).
        y: the measurement.
        variance: r, of its noise.
        gain: (n,), workspace.
        scale: (1,), receives s.
    """
    n = len(x)
    for i in range(n):
        value = h[0] * p[0, i]
        for j in range(1, n):
            value += h[j] * p[j, i]
        gain[i] = value
    s, left = variance + h[0] * gain[0], y - h[0] * x[0]
    for i in range(1, n):
        s += h[i] * gain[i]
        left -= h[i] * x[i]
    scale[0] = s
    pivot = 1 / np.sqrt(s)
    left *= pivot
    for i in range(n):
        gain[i] *= pivot
    for i in range(n):
        factor = gain[i]
        x[i] += factor * left
        for j in range(i + 1):
            p[i, j] = p[j, i] = p[i, j] - factor * gain[j]
    share: float = left * left
    return share


@inlined
def from_triangle(triangle: Floats, out: Floats) -> None:
    """Write a symmetric matrix (n, n) whose lower triangle is given row by row, of numbers or of lanes."""
    k = np.uint64(0)  # unsigned: an index that may be negative takes longer
    for i in range(out.shape[0]):
        for j in range(i + 1):
            out[i, j] = out[j, i] = triangle[k]
            k += np.uint64(1)


@inlined
def to_triangle(a: Floats, out: Floats) -> None:
    """Write the lower triangle of `a` (n, n) row by row, of numbers or of lanes."""
    k = np.uint64(0)
    for i in range(a.shape[0]):
        for j in range(i + 1):
            out[k] = a[i, j]
            k += np.uint64(1)
