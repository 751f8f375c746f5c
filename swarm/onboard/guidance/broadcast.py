"""Broadcasts between craft: once per lighthouse period, each sends its own estimated position and velocity.

A message is heard one period after its estimate was made. A craft that is not heard (its filter has no estimate, or it
is lost) is assumed to fly on straight from its last message for some seconds; then it is forgotten.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats

FORGOTTEN_S = 5.0
"""Age of the last message beyond which the position of a silent craft counts as unknown [s]."""


class Heard(NamedTuple):
    """States of C craft by their broadcasts.

    position: (C, 3) [m]. velocity: (C, 3) [m/s]. known: craft whose last message is recent enough, (C,).
    """

    position: Floats
    velocity: Floats
    known: Bools


class Broadcasts:
    """The last message of every craft, and its age."""

    def __init__(self, craft: int, period_s: float) -> None:
        self._period_s = period_s
        self._position, self._velocity = np.zeros((2, craft, 3))
        self._age_s = np.full(craft, np.inf)
        self._sent: tuple[Floats, Floats, float] | None = None

    def tell(self, position: Floats, velocity: Floats, age_s: float) -> None:
        """Send the state of every craft; it is heard from the next call on.

        Args:
            position: (C, 3) [m], NaN for a craft that does not know its own.
            velocity: (C, 3) [m/s], NaN likewise.
            age_s: age of the estimates [s].
        """
        self._age_s += self._period_s
        if self._sent is not None:
            last, moving, old_s = self._sent
            spoken = np.isfinite(last).all(axis=1) & np.isfinite(moving).all(axis=1)
            self._position[spoken], self._velocity[spoken] = last[spoken], moving[spoken]
            self._age_s[spoken] = old_s + self._period_s
        self._sent = position.copy(), velocity.copy(), age_s

    def heard(self) -> Heard:
        """Return the present state of every craft, extrapolated from its last message."""
        known = self._age_s <= FORGOTTEN_S
        age = np.where(known, self._age_s, 0.0)[:, None]
        return Heard(self._position + self._velocity * age, self._velocity.copy(), known)
