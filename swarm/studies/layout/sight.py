"""Which places on a hull the lighthouse's light reaches at many poses: the simulator's own line of sight."""

import numpy as np

from estimators.arrays import Bools
from estimators.rotation import quaternion_from_matrix
from swarm.hardware import pad
from swarm.scenario import Lighthouse
from swarm.sensors.visibility import Visibility
from swarm.studies.layout.poses import Poses
from swarm.world.hull import Hull, Mount


def lit(hull: Hull, mount: Mount, station: Lighthouse, poses: Poses) -> Bools:
    """Tell which places are lit: in field and range, facing the light, and nothing in between.

    Args:
        hull: The craft's hull.
        mount: N places on it.
        station: The lighthouse, with its field and range.
        poses: P poses.

    Returns:
        Mask (P, N).
    """
    sight = Visibility(hull.model, pad([mount.point_m], [mount.normal]), [hull.body], hull.world_body, station)
    quaternion = quaternion_from_matrix(poses.rotation)
    out = np.empty((len(quaternion), len(mount.point_m)), dtype=np.bool_)
    for p in range(len(out)):
        out[p] = sight.lit(poses.position[p : p + 1], quaternion[p : p + 1])[0]
    return out
