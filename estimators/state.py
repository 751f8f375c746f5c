"""Where bodies are, where they should be, and how they move: records that physics, guidance and estimation share."""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints

Vector = tuple[float, float, float]
"""Three numbers along x, y, z."""


class State(NamedTuple):
    """Where C craft are, or believe to be: rotation (C, 3, 3), angular_rate (C, 3) [rad/s], position (C, 3) [m],
    velocity (C, 3) [m/s]; NaN where unknown.
    """

    rotation: Floats
    angular_rate: Floats
    position: Floats
    velocity: Floats

    def ahead(self, time_s: float) -> "State":
        """The state `time_s` later if the rates stay as they are."""
        return self._replace(
            rotation=rot.exp(self.angular_rate * time_s) @ self.rotation,
            position=self.position + self.velocity * time_s,
        )

    def where(self, mask: Bools, other: "State") -> "State":
        """This state for the craft in `mask` (C,), `other` for the rest."""
        flat = np.reshape(mask, (-1, 1))
        return State(
            np.where(mask.reshape(-1, 1, 1), self.rotation, other.rotation),
            np.where(flat, self.angular_rate, other.angular_rate),
            np.where(flat, self.position, other.position),
            np.where(flat, self.velocity, other.velocity),
        )


def unknown(craft: int) -> State:
    """The state of craft that know nothing."""
    nothing = np.full((craft, 3), np.nan)
    return State(np.full((craft, 3, 3), np.nan), nothing, nothing, nothing)


class Motion(NamedTuple):
    """Position, velocity and acceleration, (C, 3) each [m, m/s, m/s^2]."""

    position: Floats
    velocity: Floats
    acceleration: Floats


class Reference(NamedTuple):
    """Where C craft should be at one instant, lighthouse frame.

    position, velocity, acceleration: (C, 3) [m, m/s, m/s^2]. rotation: (C, 3, 3) R_l_b. angular_rate,
    angular_acceleration: (C, 3) [rad/s, rad/s^2]. holds_position, holds_attitude: (C,), False where the craft is free.
    """

    position: Floats
    velocity: Floats
    acceleration: Floats
    rotation: Floats
    angular_rate: Floats
    angular_acceleration: Floats
    holds_position: Bools
    holds_attitude: Bools


class Steered(NamedTuple):
    """Where guidance wants some craft to be now: craft (G,), motion (G, 3) each, free (G,): do not hold it."""

    craft: Ints
    motion: Motion
    free: Bools
