"""What passes from a LiDAR to the computer of the craft that carries it: rays, each at its own instant.

Sensors write `LidarScan`, on-board computers read it; neither knows the other.
"""

from typing import NamedTuple

from estimators.arrays import Floats, Ints


class LidarScan(NamedTuple):
    """One scan of one craft's LiDAR, whose frame s has its origin in the scanner and its z axis as the spin axis.

    direction: (N, 3), where the rays were meant to go. range_m: (N,) [m], NaN where nothing came back. time_s: (N,)
    [s], when. line, step: (N,), which of the lines, and the number along it.
    """

    direction: Floats
    range_m: Floats
    time_s: Floats
    line: Ints
    step: Ints


class LidarPattern(NamedTuple):
    """What a craft's computer knows of its LiDAR. rotation: (3, 3) R_b_s, position: (3,) [m], of the scanner in the
    craft's body. spacing_rad: between lines, or steps if that is more. noise_m: 1 sigma of a range. period_s: of
    a scan.
    """

    rotation: Floats
    position: Floats
    spacing_rad: float
    noise_m: float
    period_s: float
