"""Which places on a hull a station's light reaches at many poses: the simulator's own line of sight."""

import numpy as np

from estimators.arrays import Bools
from estimators.frame import WORLD, Frame
from estimators.rotation import quaternion_from_matrix
from swarm.hardware import pad
from swarm.scenario import Lighthouse
from swarm.sensors.visibility import Visibility
from swarm.studies.design.flown import Flown
from swarm.studies.design.poses import Poses
from swarm.world.hull import Hull, Mount


class LineOfSight:
    """The line of sight from stations to places on a hull: in field and range, facing the light, nothing in between."""

    def __init__(self, hull: Hull, mount: Mount, station: Lighthouse, scene: Flown | None = None) -> None:
        """Prepare the shapes that can block the light.

        Args:
            hull: The craft's hull.
            mount: N places on it.
            station: The table of the stations, with their field and range.
            scene: What else stands in the light; None: the craft is alone.
        """
        self._hull, self._mount, self._station, self._scene = hull, mount, station, scene
        self._alone: Visibility | None = None
        if scene is None:
            layout = pad([mount.point_m], [mount.normal])
            self._alone = Visibility(hull.model, layout, [hull.body], hull.world_body, station)

    def lit(self, poses: Poses, frame: Frame = WORLD) -> Bools:
        """Tell which places are lit.

        Args:
            poses: P poses; with a scene, poses in it.
            frame: The station's frame.

        Returns:
            Mask (P, N).
        """
        quaternion = quaternion_from_matrix(poses.rotation)
        out = np.empty((len(quaternion), len(self._mount.point_m)), dtype=np.bool_)
        if self._alone is not None:
            # A craft alone looks the same from a station in any frame.
            position, quaternion = frame.poses_into(poses.position, quaternion)
            for p in range(len(out)):
                out[p] = self._alone.lit(position[p : p + 1], quaternion[p : p + 1])[0]
            return out
        scene = self._scene
        assert scene is not None
        assert poses.moment is not None
        world = scene.world
        nothing = [np.empty((0, 3))] * len(world.craft_bodies)
        points, normals = list(nothing), list(nothing)
        points[scene.craft], normals[scene.craft] = self._mount.point_m, self._mount.normal
        layout = pad(points, normals)
        sight = Visibility(world.model, layout, world.craft_bodies, world.lighthouse_body, self._station, frame)
        for p, moment in enumerate(poses.moment):
            position, turned = scene.position[moment].copy(), scene.quaternion[moment].copy()
            position[scene.craft], turned[scene.craft] = poses.position[p], quaternion[p]
            out[p] = sight.lit(position, turned)[scene.craft]
        return out


def lit(hull: Hull, mount: Mount, station: Lighthouse, poses: Poses, scene: Flown | None = None) -> Bools:
    """Tell which places the lighthouse at the origin lights.

    Args:
        hull: The craft's hull.
        mount: N places on it.
        station: The lighthouse, with its field and range.
        poses: P poses; with a scene, poses in it.
        scene: What else stands in the light; None: the craft is alone.

    Returns:
        Mask (P, N).
    """
    return LineOfSight(hull, mount, station, scene).lit(poses)
