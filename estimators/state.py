"""Records of states, motions and references that physics, guidance and estimation share."""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints

STATES = 12
"""Components of the error of a state: attitude, angular rate, position and velocity, three each."""
Vector = tuple[float, float, float]
"""Three numbers along x, y, z."""


class State(NamedTuple):
    """Pose and rates of C craft, true or estimated: rotation (C, 3, 3), position (C, 3) [m], velocity (C, 3) [m/s],
    angular_rate (C, 3) [rad/s]; NaN where unknown.
    """

    rotation: Floats
    position: Floats
    velocity: Floats
    angular_rate: Floats

    def of(self, craft: int) -> "State":
        """Return the state of one craft, without the craft axis."""
        return State._make(part[craft] for part in self)

    def copied(self, mask: Bools) -> "State":
        """Return a copy of the states of the craft in `mask` (C,); those of the others are not set."""
        out, who = State._make(np.empty_like(part) for part in self), np.flatnonzero(mask)
        for own, part in zip(out, self, strict=True):
            own[who] = part[who]
        return out

    def ahead(self, time_s: float) -> "State":
        """Return the state `time_s` later if the rates stay constant."""
        return self._replace(
            rotation=rot.exp(self.angular_rate * time_s) @ self.rotation,
            position=self.position + self.velocity * time_s,
        )

    def where(self, mask: Bools, other: "State") -> "State":
        """Return this state for the craft in `mask` (C,), `other` for the rest."""
        flat = np.reshape(mask, (-1, 1))
        return State(
            rotation=np.where(mask.reshape(-1, 1, 1), self.rotation, other.rotation),
            position=np.where(flat, self.position, other.position),
            velocity=np.where(flat, self.velocity, other.velocity),
            angular_rate=np.where(flat, self.angular_rate, other.angular_rate),
        )


def unknown(craft: int) -> State:
    """Return the state of craft that know nothing, all NaN."""
    nothing = np.full((craft, 3), np.nan)
    return State(rotation=np.full((craft, 3, 3), np.nan), position=nothing, velocity=nothing, angular_rate=nothing)


class Motion(NamedTuple):
    """Position, velocity and acceleration, (C, 3) each [m, m/s, m/s^2]."""

    position: Floats
    velocity: Floats
    acceleration: Floats


class Reference(NamedTuple):
    """Reference state of C craft at one instant, lighthouse frame.

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


class Turning(NamedTuple):
    """Attitude that guidance asks of some craft now: craft (G,), rotation (G, 3, 3) R_l_b, angular_rate (G, 3)
    [rad/s], constant.
    """

    craft: Ints
    rotation: Floats
    angular_rate: Floats


class Steered(NamedTuple):
    """Motion that guidance asks of some craft now: craft (G,), motion (G, 3) each, free (G,): not held. turning: of
    those of them whose attitude it decides as well; None: of none.
    """

    craft: Ints
    motion: Motion
    free: Bools
    turning: Turning | None = None
