"""What pushes a craft beside its own control: white accelerations, constant over each lighthouse period.

They are the filter's own model of motion: with the same sigmas in both, a craft under control is as uncertain as its
filter believes it to be.
"""

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Bools, Floats
from swarm.world.motion.fleet import Disturbance

PURPOSE = 0x70757368
"""Spawn key of the random numbers: "push"."""
BLOCK = 256
"""Lighthouse periods per block of random draws."""


class Pushes:
    """The accelerations of C craft, drawn per craft from the seed and the craft's key alone."""

    def __init__(self, sigma: Floats, keys: Sequence[int], seed: int) -> None:
        """sigma: (C, 2), 1 sigma per axis of acceleration [m/s^2] and angular acceleration [rad/s^2]."""
        self._sigma, self._keys, self._seed = sigma.reshape(-1, 2, 1), list(keys), seed
        self._block, self._draws = -1, np.zeros((BLOCK, len(self._keys), 2, 3))

    @property
    def pushed(self) -> Bools:
        """(C,), who is pushed at all."""
        pushed: Bools = np.any(self._sigma, axis=(1, 2))
        return pushed

    def at(self, frame: int) -> Disturbance:
        """The accelerations in lighthouse period `frame`."""
        if frame // BLOCK != self._block:
            self._block = frame // BLOCK
            for craft in np.flatnonzero(self.pushed):
                key = (PURPOSE, self._keys[craft], self._block)
                stream = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=key))
                self._draws[:, craft] = stream.standard_normal((BLOCK, 2, 3))
        push = self._sigma * self._draws[frame % BLOCK]
        return Disturbance(push[:, 0], push[:, 1])
