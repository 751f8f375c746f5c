"""All sensors of a flight: the lighthouse's light, the cameras and the LiDARs.

sight: which photodiodes the light reaches -> pulses; images at the epoch; scans that are completed
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools
from swarm.messages import Signals
from swarm.sensors.ccd import Ccd
from swarm.sensors.lidar import Lidar
from swarm.sensors.lighthouse import Lighthouse, Rotor
from swarm.sensors.visibility import Visibility
from swarm.world.world import PeriodTruth


class Sensors:
    """The sensors of C craft. ccd: None where no craft has cameras."""

    def __init__(
        self, lighthouse: Lighthouse, visibility: Visibility, ccd: Ccd | None, lidars: Sequence[Lidar]
    ) -> None:
        """Take the sensors.

        Args:
            lighthouse: the lighthouse's light.
            visibility: the lighthouse's rays through the scene.
            ccd: the cameras, if any.
            lidars: the LiDARs.
        """
        self.lighthouse, self.visibility, self.ccd, self.lidars = lighthouse, visibility, ccd, tuple(lidars)

    def sight(self, truth: PeriodTruth) -> NDArray[np.int8]:
        """Return the `Sight` of every photodiode as each fan sweeps, (C, K, 2), taken at the knots in mid-sweep."""
        out = np.empty((*self.visibility.shape, 2), dtype=np.int8)
        for fan, knot in enumerate(truth.mid_sweep):
            out[..., fan] = self.visibility.state(truth.position[knot], truth.quaternion[knot])
        return out

    def signals(self, truth: PeriodTruth, frame: int, lit: Bools, rotor: Rotor | None = None) -> Signals:
        """Return all that the craft receive in one period.

        Args:
            truth: true motion over the period.
            frame: number of the period.
            lit: photodiodes that the light reaches as each fan sweeps, (C, K, 2).
            rotor: motion of the rotor; None: nominal.
        """
        return Signals(
            pulses=self.lighthouse.sweep(truth, frame, lit, rotor),
            images=None if self.ccd is None else self.ccd.expose(truth, frame),
            scans=[scan for lidar in self.lidars for scan in lidar.sweep(truth)],
            epoch_s=float(truth.time_s[truth.epoch]),
        )
