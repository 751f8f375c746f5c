"""Pushes on the craft other than their own control: random accelerations, drift, and blows.

Random accelerations add to the control's wrench; a drifting craft has no control, and a blow replaces every other push
on a craft in its period.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from swarm.world.motion.disturbance import Pushes
from swarm.world.motion.fleet import Fleet
from swarm.world.world import World


class Blow(NamedTuple):
    """Changes of rates that a fault causes in one period; zero for craft that are not struck.

    velocity: change of velocity, (C, 3) [m/s].
    angular_rate: change of angular rate, (C, 3) [rad/s].
    """

    velocity: Floats
    angular_rate: Floats


class Surroundings:
    """All pushes on C craft other than their actuators."""

    def __init__(self, world: World, random: Pushes, motions: Fleet, period_s: float) -> None:
        """Take the sources of the pushes.

        Args:
            world: the world, which gives the wrench for a wanted acceleration.
            random: random accelerations of the scenario's craft.
            motions: motions of the craft, some of which drift.
            period_s: length of a lighthouse period [s].
        """
        self._world, self._random, self._motions, self._period_s = world, random, motions, period_s
        self._any_random, self._any_drift = bool(random.pushed.any()), bool(motions.pushed.any())

    def add(self, frame: int, force: Floats, torque: Floats, blow: Blow | None) -> tuple[Floats, Floats]:
        """Return the wrench on every craft in a period, (C, 3) [N] and (C, 3) [N m], lighthouse frame.

        Args:
            frame: number of the period.
            force: force of the control, (C, 3) [N].
            torque: torque of the control, (C, 3) [N m].
            blow: blow of a fault in this period, if any.
        """
        if self._any_random:
            more = self._world.inertial_wrench(*self._random.at(frame))
            # The control's own wrench already contains the wrench that the spin requires.
            still = np.zeros_like(force)
            spin = self._world.inertial_wrench(still, still)
            force, torque = force + more[0] - spin[0], torque + more[1] - spin[1]
        if blow is not None:
            struck = np.any(np.concatenate([blow.velocity, blow.angular_rate], axis=1) != 0, axis=1)
            change = blow.velocity / self._period_s, blow.angular_rate / self._period_s
            more = self._world.inertial_wrench(*change)
            force[struck], torque[struck] = more[0][struck], more[1][struck]
        if self._any_drift:
            pushed, drift = self._motions.pushed, self._world.inertial_wrench(*self._motions.disturbance(frame))
            force[pushed], torque[pushed] = drift[0][pushed], drift[1][pushed]
        return force, torque
