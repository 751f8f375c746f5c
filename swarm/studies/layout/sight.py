"""Which places on a hull the lighthouse's light reaches at many poses: the simulator's own line of sight."""

import numpy as np

from estimators.arrays import Bools
from estimators.rotation import quaternion_from_matrix
from swarm.hardware import pad
from swarm.scenario import Lighthouse
from swarm.sensors.visibility import Visibility
from swarm.studies.layout.flown import Flown
from swarm.studies.layout.poses import Poses
from swarm.world.hull import Hull, Mount


def lit(hull: Hull, mount: Mount, station: Lighthouse, poses: Poses, scene: Flown | None = None) -> Bools:
    """Tell which places are lit: in field and range, facing the light, and nothing in between.

    Args:
        hull: The craft's hull.
        mount: N places on it.
        station: The lighthouse, with its field and range.
        poses: P poses; with a scene, poses in it.
        scene: What else stands in the light; None: the craft is alone.

    Returns:
        Mask (P, N).
    """
    quaternion = quaternion_from_matrix(poses.rotation)
    out = np.empty((len(quaternion), len(mount.point_m)), dtype=np.bool_)
    if scene is None:
        alone = Visibility(hull.model, pad([mount.point_m], [mount.normal]), [hull.body], hull.world_body, station)
        for p in range(len(out)):
            out[p] = alone.lit(poses.position[p : p + 1], quaternion[p : p + 1])[0]
        return out
    assert poses.moment is not None
    world = scene.world
    nothing = [np.empty((0, 3))] * len(world.craft_bodies)
    points, normals = list(nothing), list(nothing)
    points[scene.craft], normals[scene.craft] = mount.point_m, mount.normal
    sight = Visibility(world.model, pad(points, normals), world.craft_bodies, world.lighthouse_body, station)
    for p, moment in enumerate(poses.moment):
        position, turned = scene.position[moment].copy(), scene.quaternion[moment].copy()
        position[scene.craft], turned[scene.craft] = poses.position[p], quaternion[p]
        out[p] = sight.lit(position, turned)[scene.craft]
    return out
