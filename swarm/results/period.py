"""One lighthouse period of a run: everything that telemetry, recording and summary are made from."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from swarm.hardware import Closing
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.inspection import LidarFix
from swarm.onboard.navigation import Estimate
from swarm.results.records import Peer, Truth
from swarm.world.actuators import ActuatorWork


class Guided(NamedTuple):
    """Guidance of C craft at the epoch.

    phase: (C,), of `swarm.onboard.guidance.phase.Phase`. reference_m: (C, 3) [m], where guidance wants each craft.
    gave_way: (C,), whether a craft flew otherwise than it wanted, to keep clear of another. docking: craft that
    dock, by index, with the true state of their ports to their targets'.
    """

    phase: Ints
    reference_m: Floats
    gave_way: Bools
    docking: Sequence[tuple[int, Closing]] = ()


class Period(NamedTuple):
    """One lighthouse period of C craft at its epoch, in the lighthouse frame; NaN where unknown.

    frame: number of the period. time_s: the epoch [s]. truth: None in a replay. sight: (C, K), what every photodiode
    saw, of `swarm.sensors.sight.Sight`. angles: what every craft's decoder made of the
    light. estimate: what every craft knows. peer: the pose that came with a recording, in a replay. scans: what became
    of the LiDAR scans that were completed. work: of the actuators; None in a replay. guided: None without guided craft.
    fault: (C,), index into the fault schedule's names; None without faults. overlaps: (C,), hits lost to two beams at
    once; None where beams cannot meet.
    """

    frame: int
    time_s: float
    truth: Truth | None
    sight: NDArray[np.integer]
    angles: SweepAngles
    estimate: Estimate
    peer: Peer | None = None
    scans: Sequence[LidarFix] = ()
    work: ActuatorWork | None = None
    guided: Guided | None = None
    fault: Ints | None = None
    overlaps: Ints | None = None
