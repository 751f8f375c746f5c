"""Aligning the frame of the truth with the lighthouse's, as a laboratory does before it measures (section 4.3).

One rigid transform for all poses, least squares over positions (Kabsch):

    t_m = R_0 t_l + t_0,   R_m = R_0 R_l

with l the lighthouse as it measures, and m the truth ("motion capture"). It absorbs most of a fan's constant errors,
and a swarm that shares one lighthouse never notices that part.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats


class Alignment(NamedTuple):
    """The rigid transform: R_0 (3, 3) and t_0 (3,) [m]."""

    rotation: Floats
    shift: Floats

    def positions(self, measured: Floats) -> Floats:
        """Return measured positions (..., 3) [m] in the frame of the truth."""
        return measured @ self.rotation.T + self.shift

    def rotations(self, measured: Floats) -> Floats:
        """Return measured rotations (..., 3, 3) in the frame of the truth."""
        return self.rotation @ measured


NONE = Alignment(np.eye(3), np.zeros(3))
"""The frames as they are."""


def align(measured: Floats, true: Floats) -> Alignment:
    """Return the alignment that brings positions (N, 3) [m] nearest to the true ones (N, 3) [m], N at least 3."""
    middle, true_middle = measured.mean(axis=0), true.mean(axis=0)
    u, _, vt = np.linalg.svd((true - true_middle).T @ (measured - middle))
    rotation: Floats = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return Alignment(rotation, true_middle - rotation @ middle)
