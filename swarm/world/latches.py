"""The latches of a flight's docking pairs: a latch closes when two ports have met."""

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Bools
from swarm.hardware import Closing
from swarm.world.docking import Mating
from swarm.world.world import PeriodTruth, World


class Latches:
    """One latch per docking pair. closed: switches in the craft's ports, (C,)."""

    def __init__(self, world: World, matings: Sequence[Mating]) -> None:
        self._world, self.matings = world, tuple(matings)
        self.closed: Bools = np.zeros(len(world.names), dtype=np.bool_)

    def meet(self, truth: PeriodTruth) -> list[tuple[int, Closing]]:
        """Close the latches whose ports met in a period.

        Returns:
            For every docking pair the index of the docking craft, and its ports' relative pose and speed at the epoch.
        """
        epoch, last = len(truth.time_s) // 2, -1
        for number, mating in enumerate(self.matings):
            i = mating.craft
            met = truth.contact[i] and truth.contact[mating.target] and not self.closed[i]
            if met and mating.within_reach(_closing(mating, truth, last)):
                self._world.latch(number)
                self.closed[i] = True
        return [(mating.craft, _closing(mating, truth, epoch)) for mating in self.matings]


def _closing(mating: Mating, truth: PeriodTruth, knot: int) -> Closing:
    """Return the relative pose and speed of the two ports at one knot of the period."""
    at = truth.state(knot)
    return mating.closing(at.rotation, at.position, at.velocity, at.angular_rate)
