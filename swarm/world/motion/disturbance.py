"""Disturbance of a craft apart from its own control: white accelerations, constant over each lighthouse period.

They match the filter's own model of motion: with the same sigmas in both, a craft under control is as uncertain as its
filter predicts.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from swarm import random
from swarm.random import Blocks, Purpose

BLOCK = 256
"""Number of lighthouse periods per block of random draws."""


class Disturbance(NamedTuple):
    """Accelerations of C craft over one period.

    acceleration: linear accelerations, (C, 3) [m/s^2].
    angular_acceleration: angular accelerations, (C, 3) [rad/s^2].
    """

    acceleration: Floats
    angular_acceleration: Floats


class Pushes:
    """The accelerations of C craft, drawn per craft from the seed and the craft's key alone."""

    def __init__(self, sigma: Floats, keys: Sequence[int], seed: int, purpose: Purpose = Purpose.PUSH) -> None:
        """Prepare the draws.

        Args:
            sigma: 1 sigma per axis of acceleration [m/s^2] and angular acceleration [rad/s^2], (C, 2).
            keys: One number per craft that names its draws.
            seed: The run's seed.
            purpose: The purpose of the draws.
        """
        self._sigma, self._keys, self._seed, self._purpose = sigma.reshape(-1, 2, 1), list(keys), seed, purpose
        self._draws = Blocks(BLOCK, self._draw)

    @property
    def pushed(self) -> Bools:
        """Craft with any acceleration at all, (C,)."""
        pushed: Bools = np.any(self._sigma, axis=(1, 2))
        return pushed

    def at(self, frame: int) -> Disturbance:
        """Return the accelerations in lighthouse period `frame`."""
        draws, place = self._draws.at(frame)
        push = self._sigma * draws[place]
        return Disturbance(push[:, 0], push[:, 1])

    def _draw(self, block: int) -> Floats:
        """Draw (BLOCK, C, 2, 3) standard normal numbers."""
        out = np.zeros((BLOCK, len(self._keys), 2, 3))
        for craft in np.flatnonzero(self.pushed):
            stream = random.stream(self._seed, self._purpose, self._keys[craft], block)
            out[:, craft] = stream.standard_normal((BLOCK, 2, 3))
        return out
