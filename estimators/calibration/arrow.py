"""The arrow in a calibration's normal matrix: blocks of periods, joined only by the shared unknowns.

    [ D   B ]        D = diag(D_1, D_2, ...),  D_k = L_k L_k^T
    [ B^T G ],       S = G - sum B_k^T D_k^-1 B_k

S, Schur's complement, is the information on the shared unknowns once every period's own are eliminated: its inverse is
their covariance, its eigenvectors say what the survey does not tell. The matrix itself is U^T U with
U = [[L^T, L^-1 B], [0, C^T]], S = C C^T; in the coordinates y = U x the problem is nearly orthonormal, whatever the
units, however weakly poses and fans hold each other, and an iterative solver needs a handful of products.
"""

from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator

from estimators.arrays import Floats
from estimators.calibration.problem import Problem


class Arrow(NamedTuple):
    """The normal matrix, factored as far as S. lower: (blocks, width, width), L. border: (blocks, width, shared),
    L^-1 B. schur: (shared, shared), S.
    """

    lower: Floats
    border: Floats
    schur: Floats


def arrow(problem: Problem, jacobian: sparse.csr_array, weight: Floats) -> Arrow:
    """Return the arrow of J^T diag(weight^2) J, with the shared unknowns along `problem.basis`.

    Unknowns that no used angle depends on have zero rows: there D gets a one on its diagonal, and they stay as they
    are.

    Args:
        problem: the calibration.
        jacobian: J, (rows, unknowns).
        weight: (rows,), of the residuals.
    """
    weighted = sparse.diags_array(weight) @ jacobian
    own, shared = weighted[:, : problem.local].tocsr(), weighted[:, problem.local :].tocsr() @ problem.basis
    width, count = problem.width, problem.basis.shape[1]
    # Dense blocks: every block has entries, its observations of u at least.
    blocks = sparse.bsr_array(own.T @ own, blocksize=(width, width))
    diagonal = np.zeros((problem.blocks, width, width))
    diagonal[blocks.indices] = blocks.data
    empty = np.einsum("bii->bi", diagonal)
    empty[empty == 0] = 1.0
    lower = np.asarray(np.linalg.cholesky(diagonal), dtype=np.float64)
    coupling: Floats = (own.T @ shared).reshape(problem.blocks, width, count)
    border = np.asarray(np.linalg.solve(lower, coupling), dtype=np.float64)
    flat = border.reshape(-1, count)
    return Arrow(lower, border, shared.T @ shared - flat.T @ flat)


class Whitening:
    """Coordinates y with x - x_0 = T y, T = U^-1, so that J T is nearly orthonormal. Raises LinAlgError if S is
    singular.
    """

    def __init__(self, problem: Problem, normal: Arrow) -> None:
        self.shape = (problem.size, problem.local + problem.basis.shape[1])
        self._local = problem.local
        self._inverse = np.linalg.inv(normal.lower)
        self._border = normal.border.reshape(problem.local, -1)
        self._shared_inverse = np.linalg.inv(np.linalg.cholesky(normal.schur))
        self._basis = problem.basis

    def forward(self, y: Floats) -> Floats:
        """Return T y, (size,)."""
        shared = self._shared_inverse.T @ y[self._local :]
        rest = (y[: self._local] - self._border @ shared).reshape(*self._inverse.shape[:2], 1)
        own = np.swapaxes(self._inverse, 1, 2) @ rest
        return np.concatenate([own.ravel(), self._basis @ shared])

    def backward(self, x: Floats) -> Floats:
        """Return T^T x."""
        own = (self._inverse @ x[: self._local].reshape(*self._inverse.shape[:2], 1)).ravel()
        shared = self._shared_inverse @ (self._basis.T @ x[self._local :] - self._border.T @ own)
        return np.concatenate([own, shared])

    def of(self, jacobian: sparse.csr_array) -> LinearOperator:
        """Return J T."""
        transposed = jacobian.T.tocsr()
        return LinearOperator(
            shape=(jacobian.shape[0], self.shape[1]),
            matvec=lambda y: jacobian @ self.forward(np.ravel(y)),
            rmatvec=lambda r: self.backward(transposed @ np.ravel(r)),
            dtype=np.float64,
        )
