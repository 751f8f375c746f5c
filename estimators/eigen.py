"""Eigenvalues and eigenvectors of a small symmetric matrix by cyclic Jacobi rotations, as a kernel: V^T A V = diag.

Each rotation makes one element off the diagonal vanish (Golub and Van Loan, *Matrix Computations*, section 8.5); their
squares' sum falls with every sweep, at last quadratically.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import kernel

SWEEPS_MAX = 30


@kernel
def eigen_into(a: Floats, vector: Floats) -> None:
    """Leave the eigenvalues on the diagonal of `a`, in no order, and write the eigenvectors.

    Args:
        a: (n, n), symmetric; spoilt.
        vector: (n, n), receives the eigenvectors as columns.
    """
    n = len(a)
    for i in range(n):
        for j in range(n):
            vector[i, j] = 1.0 if i == j else 0.0
    for _ in range(SWEEPS_MAX):
        off, size = 0.0, 0.0
        for i in range(n):
            size += a[i, i] * a[i, i]
            for j in range(i):
                off += a[i, j] * a[i, j]
        if not off > 1e-34 * size:
            break
        for i in range(n - 1):
            for j in range(i + 1, n):
                if a[i, j] == 0.0:
                    continue
                ratio = (a[j, j] - a[i, i]) / (2 * a[i, j])
                t = (1.0 if ratio >= 0 else -1.0) / (abs(ratio) + np.sqrt(ratio * ratio + 1))
                c = 1 / np.sqrt(t * t + 1)
                s = t * c
                for m in range(n):
                    one, two = a[m, i], a[m, j]
                    a[m, i], a[m, j] = c * one - s * two, s * one + c * two
                for m in range(n):
                    one, two = a[i, m], a[j, m]
                    a[i, m], a[j, m] = c * one - s * two, s * one + c * two
                    one, two = vector[m, i], vector[m, j]
                    vector[m, i], vector[m, j] = c * one - s * two, s * one + c * two
