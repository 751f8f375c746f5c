"""Broadcasts between craft: once per lighthouse period, each its own position and velocity as it believes them.

A message is heard one period after its estimate was made. Who is not heard (its filter knows nothing, or it is lost) is
believed to fly on straight from its last message, for some seconds; then it is forgotten.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats

FORGOTTEN_S = 5.0
"""Nobody can say where a craft is that has been silent for so long."""


class Heard(NamedTuple):
    """The craft by their broadcasts: position (C, 3) [m], velocity (C, 3) [m/s]; known: (C,)."""

    position: Floats
    velocity: Floats
    known: Bools


class Broadcasts:
    """The last message of every craft, and how old it is."""

    def __init__(self, craft: int, period_s: float) -> None:
        self._period_s = period_s
        self._position, self._velocity = np.zeros((2, craft, 3))
        self._age_s = np.full(craft, np.inf)
        self._sent: tuple[Floats, Floats, float] | None = None

    def tell(self, position: Floats, velocity: Floats, age_s: float) -> None:
        """Every craft sends position (C, 3) [m] and velocity (C, 3) [m/s] of `age_s` ago, NaN where it knows none.

        They are heard from the next call on.
        """
        self._age_s += self._period_s
        if self._sent is not None:
            last, moving, old_s = self._sent
            spoken = np.isfinite(last).all(axis=1) & np.isfinite(moving).all(axis=1)
            self._position[spoken], self._velocity[spoken] = last[spoken], moving[spoken]
            self._age_s[spoken] = old_s + self._period_s
        self._sent = position.copy(), velocity.copy(), age_s

    def heard(self) -> Heard:
        """Return the craft as they are now by their broadcasts."""
        known = self._age_s <= FORGOTTEN_S
        age = np.where(known, self._age_s, 0.0)[:, None]
        return Heard(self._position + self._velocity * age, self._velocity.copy(), known)
