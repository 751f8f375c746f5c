"""Disturbance of a craft apart from its own control: white accelerations, constant over each lighthouse period.

They match the filter's own model of motion: with the same sigmas in both, a craft under control is as uncertain as its
filter predicts.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from swarm.draws import keys_of, normal_rows
from swarm.random import Purpose


class Disturbance(NamedTuple):
    """Accelerations of C craft over one period.

    acceleration: linear accelerations, (C, 3) [m/s^2].
    angular_acceleration: angular accelerations, (C, 3) [rad/s^2].
    """

    acceleration: Floats
    angular_acceleration: Floats


class Pushes:
    """The accelerations of C craft, drawn per craft from the seed and the craft's key alone.

    pushed: craft with any acceleration at all, (C,).
    """

    def __init__(self, sigma: Floats, keys: Sequence[int], seed: int, purpose: Purpose = Purpose.PUSH) -> None:
        """Prepare the draws.

        Args:
            sigma: 1 sigma per axis of acceleration [m/s^2] and angular acceleration [rad/s^2], (C, 2).
            keys: One number per craft that names its draws.
            seed: The run's seed.
            purpose: The purpose of the draws.
        """
        self._sigma = sigma.reshape(-1, 2, 1)
        self.pushed: Bools = np.any(self._sigma, axis=(1, 2))
        self._who = np.flatnonzero(self.pushed)
        self._keys = keys_of(seed, purpose, [keys[craft] for craft in self._who.tolist()])

    def at(self, frame: int) -> Disturbance:
        """Return the accelerations in lighthouse period `frame`."""
        push = np.zeros((len(self._sigma), 2, 3))
        if len(self._who):
            push[self._who] = self._sigma[self._who] * normal_rows(self._keys, frame, 6).reshape(-1, 2, 3)
        return Disturbance(push[:, 0], push[:, 1])
