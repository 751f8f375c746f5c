"""All sensors of a flight: the light of the lighthouse or of several stations, the cameras and the LiDARs.

sight: which photodiodes the light reaches -> pulses; images at the epoch; scans that are completed
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Ints
from swarm.messages import Signals
from swarm.sensors.ccd import Ccd
from swarm.sensors.lidar import Lidar
from swarm.sensors.lighthouse import Lighthouse, Rotor
from swarm.sensors.stations import Stations
from swarm.sensors.visibility import Visibility
from swarm.world.world import PeriodTruth


class Sensors:
    """The sensors of C craft. ccd: None where no craft has cameras."""

    def __init__(
        self,
        lighthouse: Lighthouse,
        visibility: Visibility,
        ccd: Ccd | None,
        lidars: Sequence[Lidar],
        stations: Stations | None = None,
    ) -> None:
        """Take the sensors.

        Args:
            lighthouse: the lighthouse's light, and the circuits that receive that of stations as well.
            visibility: rays of the lighthouse, or of the first station, through the scene.
            ccd: the cameras, if any.
            lidars: the LiDARs.
            stations: light of several stations; None: that of the lighthouse.
        """
        self.lighthouse, self.visibility, self.ccd, self.lidars = lighthouse, visibility, ccd, tuple(lidars)
        self.stations = stations

    def sight(self, truth: PeriodTruth) -> NDArray[np.int8]:
        """Return the `Sight` of every photodiode as each fan sweeps, (C, K, 2), taken at the knots in mid-sweep.

        With stations, from each of them at each look, (C, K, L).
        """
        if self.stations is not None:
            return self.stations.sight(truth)
        out = np.empty((*self.visibility.shape, 2), dtype=np.int8)
        for fan, knot in enumerate(truth.mid_sweep):
            self.visibility.state_into(truth.position[knot], truth.quaternion[knot], fan, out)
        return out

    def seen(self, sight: NDArray[np.int8]) -> NDArray[np.int8]:
        """Return the `Sight` of every photodiode over the period, (C, K), from that of `sight`."""
        if self.stations is not None:
            return self.stations.seen(sight)
        out: NDArray[np.int8] = np.minimum(sight[..., 0], sight[..., 1])
        return out

    def overlaps(self) -> Ints | None:
        """Return the number of hits that each craft has lost to two beams at once in the period sensed last, (C,); None
        where beams cannot meet.
        """
        return None if self.stations is None else self.stations.overlaps

    def signals(self, truth: PeriodTruth, frame: int, lit: Bools, rotor: Rotor | None = None) -> Signals:
        """Return all that the craft receive in one period.

        Args:
            truth: true motion over the period.
            frame: number of the period.
            lit: photodiodes that the light reaches, as `sight`.
            rotor: motion of the one lighthouse's rotor; None: nominal.
        """
        if self.stations is not None:
            pulses, beams = self.stations.shine(truth, frame, lit)
        else:
            pulses, beams = self.lighthouse.sweep(truth, frame, lit, rotor), None
        return Signals(
            pulses=pulses,
            beams=beams,
            bearers=None if self.stations is None else self.stations.bearers(truth),
            images=None if self.ccd is None else self.ccd.expose(truth, frame),
            scans=[scan for lidar in self.lidars for scan in lidar.sweep(truth)],
            epoch_s=float(truth.time_s[truth.epoch]),
        )
