"""One craft's LiDAR on board: a scan as the estimators want it, everything moved to one instant."""

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.scan import Scan
from swarm.scans import LidarPattern, LidarScan


def rays(scan: LidarScan, pattern: LidarPattern) -> Scan:
    """The scan as it is, in the scanner's frame: right where nothing moves."""
    return Scan(scan.direction, scan.range_m, pattern.spacing_rad, pattern.noise_m, scan.line, scan.step)
