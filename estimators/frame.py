"""A frame in the world, such as a station's: poses, states and covariances taken into it and out of it.

With T_w_f = (R, t), p_w = R p_f + t. The world's own frame changes nothing, bit for bit.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimators.arrays import Floats
from estimators.rotation import quaternion_from_matrix, quaternion_multiply
from estimators.state import State

_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Frame:
    """A frame f in the world w: rotation (3, 3) R_w_f and position (3,) [m] of its origin."""

    rotation: Floats
    position: Floats

    @cached_property
    def is_world(self) -> bool:
        """True if the frame is the world's own."""
        return bool(np.array_equal(self.rotation, np.eye(3)) and not self.position.any())

    @cached_property
    def _both(self) -> Floats:
        """The rotation of (attitude, position), (6, 6)."""
        return np.asarray(np.kron(np.eye(2), self.rotation), dtype=np.float64)

    def poses_into(self, position: Floats, quaternion: Floats) -> tuple[Floats, Floats]:
        """Return world poses, positions (..., 3) [m] and quaternions (..., 4) wxyz, in this frame."""
        if self.is_world:
            return position, quaternion
        turn = quaternion_from_matrix(self.rotation) * _CONJUGATE
        return (position - self.position) @ self.rotation, quaternion_multiply(
            np.broadcast_to(turn, quaternion.shape), quaternion
        )

    def state_into(self, state: State) -> State:
        """Return a world state of C craft in this frame."""
        if self.is_world:
            return state
        return State(
            rotation=self.rotation.T @ state.rotation,
            position=(state.position - self.position) @ self.rotation,
            velocity=state.velocity @ self.rotation,
            angular_rate=state.angular_rate @ self.rotation,
        )

    def pose_out(self, rotation: Floats, position: Floats) -> tuple[Floats, Floats]:
        """Return poses in this frame, rotations (..., 3, 3) and positions (..., 3) [m], in the world."""
        if self.is_world:
            return rotation, position
        return self.rotation @ rotation, position @ self.rotation.T + self.position

    def matrix_out(self, matrix: Floats) -> Floats:
        """Return covariances or couplings (..., 6, 6) of (attitude, position) or their rates in the world's axes."""
        if self.is_world:
            return matrix
        out: Floats = self._both @ matrix @ self._both.T
        return out

    def matrix_into(self, matrix: Floats) -> Floats:
        """Return covariances (..., 6, 6) of (attitude, position) in the world's axes in this frame's."""
        if self.is_world:
            return matrix
        out: Floats = self._both.T @ matrix @ self._both
        return out

    def rows_out(self, rows: Floats) -> Floats:
        """Return derivatives (..., n, 6) by (attitude, position), or their rates, by the same in the world's axes."""
        if self.is_world:
            return rows
        out: Floats = rows @ self._both.T
        return out


WORLD = Frame(np.eye(3), np.zeros(3))
"""The world's own frame."""
