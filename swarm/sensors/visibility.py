"""Visibility of the lighthouse from the photodiodes: field, range, incidence, then a ray against every craft's shape.

Lighthouse frame = MuJoCo's world frame: the light starts at the origin and goes along +z. A photodiode at p with normal
n is lit when

    z > 0,  |atan2(x, z)| and |atan2(y, z)| <= field / 2        both fans sweep over it
    range_min <= |p| <= range_max                               enough light, no glare
    -n . p / |p| >= cos(incidence_max)                          it faces the light
    first hit of the ray from the origin to p is not nearer than |p| - 1 mm

The ray meets the same surfaces as MuJoCo's `mj_ray`: meshes by their triangles (not their convex hull), and every geom
that is not fully transparent, of every body except the lighthouse. The millimetre is the photodiode's thickness: a
photodiode lies on a surface, which would otherwise shade it by a rounding error, and a geom of that thickness may
represent the photodiode itself.

All rays start at one point, so a grid of directions (`broad_phase`) finds the craft that could block a ray to another,
and a closed-form test (`hits`) decides for each of their convex geoms. MuJoCo's own ray decides for geoms that are not
convex.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.frame import WORLD, Frame
from estimators.lanes import WIDE
from estimators.rotation import matrix_from_quaternion
from swarm.hardware import Photodiodes
from swarm.scenario import Lighthouse
from swarm.sensors.broad_phase import MOST_CELLS, SLACK, Met, Placed, all_met, place_into, stayed
from swarm.sensors.hits import HULL
from swarm.sensors.line_of_sight import Light, faces, sight_into
from swarm.sensors.sight import Sight
from swarm.sensors.solids import Solids, read_solids
from swarm.units import si
from swarm.world.rays import Rays, free_joint_address

THICKNESS_M = 1e-3
"""A surface that is nearer than the photodiode by less than this does not shade it [m]."""

WIDEST_HALF_FIELD_RAD = 1.57
"""Largest half field, just below pi/2: the field is a rectangle on the plane z = 1."""


class Visibility:
    """The lighthouse's rays through a scene of craft; neither the world's state nor the model is modified.

    A photodiode that lies more than a millimetre inside its craft is dark, so the layout must be the drawn one, on the
    surface. The mounting error shifts a photodiode from its drawn place, but not into the craft.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        photodiodes: Photodiodes,
        craft_bodies: Sequence[int] | Ints,
        lighthouse_body: int,
        station: Lighthouse,
        frame: Frame = WORLD,
    ) -> None:
        """Prepare the shapes that can block the light.

        Args:
            model: The model of the world.
            photodiodes: The layout of the photodiodes as drawn.
            craft_bodies: The craft's root bodies (C,), each with a free joint, in the order of `photodiodes`.
            lighthouse_body: The station's body, which does not shade its own light; -1: none.
            station: The scenario's table of the station.
            frame: The station's frame in the world.

        Raises:
            ValueError: A root body has no free joint, the numbers of craft differ, or the lighthouse carries geoms on
                bodies below its own (a ray can leave out only one body).
        """
        self._model = model
        self._photodiodes = photodiodes
        self._lighthouse_body = lighthouse_body
        self._limits = si(station)
        for body in craft_bodies:
            free_joint_address(model, int(body))
        self._craft_bodies = np.asarray(craft_bodies, dtype=np.int64)
        craft = len(craft_bodies)
        if craft != photodiodes.craft_count:
            raise ValueError(f"{craft} craft bodies, but layouts of {photodiodes.craft_count} craft")
        for body in range(lighthouse_body + 1, model.nbody) if lighthouse_body > 0 else ():
            if model.body_geomnum[body] > 0 and _is_part_of(model, body, lighthouse_body):
                raise ValueError(f"body {model.body(body).name!r} would shade the lighthouse that it belongs to")
        self._solids, self._geoms = read_solids(model, craft_bodies, lighthouse_body)
        self._faces = faces(
            photodiodes.point_m, photodiodes.normal, photodiodes.present, _own_planes(self._solids, photodiodes)
        )
        self._extent_m, self._near = _extents(self._solids, photodiodes), np.empty(craft, dtype=np.bool_)
        self._radius = _radii(self._solids, photodiodes)
        # The scene, owner number C, never moves: its body frame is the world frame.
        self._placed = Placed(np.tile(np.eye(3), (craft + 1, 1, 1)), *(np.zeros((craft + 1, 3)) for _ in range(3)))
        self.move(frame)
        self._side = min(2 * int(np.ceil(np.sqrt(craft))) + 2, MOST_CELLS)
        self._met = Met(np.zeros(craft + 1, dtype=np.int64), np.zeros(0, dtype=np.int64))
        self._met_at = np.full((craft + 1, 3), np.nan)  # the owners' centres
        limits = self._limits
        self._light = Light(
            half_width=float(np.tan(min(limits.field_rad / 2, WIDEST_HALF_FIELD_RAD))),
            range_min=limits.range_min_m,
            range_max=limits.range_max_m,
            least_cosine=float(np.cos(limits.incidence_max_rad)),
            thickness=THICKNESS_M,
        )
        self._room, self._unsure = np.empty((1, WIDE)), np.empty((64, 3), dtype=np.int64)
        self._rays: Rays | None = None

    def move(self, frame: Frame) -> None:
        """Move the station, which may ride on a craft, to a frame in the world."""
        self._frame = frame
        if not frame.is_world:
            self._placed.rotation[-1] = frame.rotation.T
            self._placed.position[-1] = -frame.position @ frame.rotation

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of craft and of photodiodes per craft, (C, K)."""
        craft, photodiodes = self._photodiodes.present.shape
        return craft, photodiodes

    def lit(self, position: Floats, quaternion: Floats) -> Bools:
        """Return which photodiodes (C, K) are lit.

        The craft are at `position` (C, 3) [m] with attitude `quaternion` (C, 4) wxyz.
        """
        lit: Bools = self.state(position, quaternion) == Sight.LIT
        return lit

    def state(self, position: Floats, quaternion: Floats) -> NDArray[np.int8]:
        """Return the `Sight` of every photodiode, (C, K); raise ValueError for poses of wrong shape.

        The craft are at `position` (C, 3) [m] with attitude `quaternion` (C, 4) wxyz.
        """
        out = np.empty((*self.shape, 1), dtype=np.int8)
        self.state_into(position, quaternion, 0, out)
        return out[..., 0]

    def state_into(self, position: Floats, quaternion: Floats, look: int, out: NDArray[np.int8]) -> None:
        """Write the `Sight` of every photodiode into one look of several.

        Args:
            position: of the craft, (C, 3) [m].
            quaternion: their attitudes, (C, 4) wxyz.
            look: index of the look.
            out: receives it, (C, K, looks), contiguous.

        Raises:
            ValueError: The poses have a wrong shape.
        """
        craft = len(self._craft_bodies)
        if position.shape != (craft, 3) or quaternion.shape != (craft, 4):
            raise ValueError(f"poses of {craft} craft needed, not {position.shape}, {quaternion.shape}")
        light, solids, placed = self._light, self._solids, self._placed
        place_into(
            np.ascontiguousarray(position),
            np.ascontiguousarray(quaternion),
            self._frame.rotation,
            self._frame.position,
            self._extent_m,
            light.range_max,
            solids.shape,
            solids.shape_centre,
            placed,
            self._near,
        )
        if not stayed(placed.centre, self._met_at, self._radius):
            wider = (1 + SLACK) * self._radius
            self._met = all_met(placed, solids.shape, wider, self._side, light.half_width)
            self._met_at[:] = placed.centre
        while True:
            count = sight_into(
                self._faces, self._near, placed, solids, self._met, light, self._room, look, out, self._unsure
            )
            if count <= len(self._unsure):
                break
            self._unsure = np.empty((2 * count, 3), dtype=np.int64)
        if count:
            self._ask_mujoco(position, quaternion, self._unsure[:count], out[..., look])

    def _ask_mujoco(self, position: Floats, quaternion: Floats, unsure: Ints, out: NDArray[np.int8]) -> None:
        """Let MuJoCo's rays decide about geoms that are not convex.

        unsure: (n, 3), craft, photodiode and geom of every ray that may meet such a geom. out: (C, K), updated.
        """
        rays, start = self._placed_rays(position, quaternion), self._frame.position
        rotation = matrix_from_quaternion(quaternion)
        for c, k, number in unsure:
            if out[c, k] == Sight.BLOCKED:
                continue
            point = rotation[c] @ self._photodiodes.point_m[c, k] + position[c] - start
            distance = float(np.linalg.norm(point))
            if 0 <= rays.distance_to(int(self._geoms[number]), start, point / distance) < distance - THICKNESS_M:
                out[c, k] = Sight.BLOCKED

    @property
    def solids(self) -> Solids:
        """The solids that can block the light, by owner."""
        return self._solids

    def blocked(
        self,
        origin: Floats,
        point: Floats,
        position: Floats,
        quaternion: Floats,
        through_lighthouse: bool = False,
    ) -> Bools:
        """Return whether anything blocks the line from a camera to each point, (N,).

        The camera's own craft blocks too: a pinhole stands clear of its surface.

        Args:
            origin: Position of the camera, (3,) [m].
            point: Points, (N, 3) [m].
            position: Positions of the craft, (C, 3) [m].
            quaternion: Attitudes of the craft, (C, 4) wxyz.
            through_lighthouse: Ignore the lighthouse's own body, as for its own light.
        """
        ray = point - origin
        distance = np.linalg.norm(ray, axis=-1)
        # A surface beyond the farthest point cannot block any line.
        hit = self._placed_rays(position, quaternion).cast(
            origin,
            ray / distance[:, None],
            reach_m=float(distance.max(initial=0.0)),
            without_body=self._lighthouse_body if through_lighthouse else -1,
        )
        hidden: Bools = (hit.distance >= 0) & (hit.distance < distance - THICKNESS_M)
        return hidden

    def _placed_rays(self, position: Floats, quaternion: Floats) -> Rays:
        """Return the rays through the scene with every craft moved; made when they are first needed."""
        if self._rays is None:
            self._rays = Rays(self._model, self._craft_bodies)
        self._rays.place(position, quaternion)
        return self._rays


def _own_planes(solids: Solids, photodiodes: Photodiodes) -> Floats:
    """Return the plane of its craft's only hull that every photodiode is farthest outside of, (C, K, 4); NaN for other
    craft: who is outside of the hull is outside of the craft.
    """
    out: Floats = np.full((*photodiodes.present.shape, 4), np.nan)
    for shape in range(len(solids.first) - 1):
        first = int(solids.first[shape])
        if solids.first[shape + 1] - first == 1 and solids.kind[first] == HULL:
            plane = solids.plane[slice(*solids.planes[first])]
            for c in np.flatnonzero(solids.shape[:-1] == shape):
                height = photodiodes.point_m[c] @ plane[:, :3].T + plane[:, 3]
                out[c] = plane[np.argmax(height, axis=1)]
    return out


def _extents(solids: Solids, photodiodes: Photodiodes) -> Floats:
    """Return the largest distance of a photodiode or a surface from each craft's origin, (C,) [m]."""
    out: Floats = np.linalg.norm(photodiodes.point_m, axis=2).max(axis=1, initial=0.0)
    shape = solids.shape[:-1]
    solid = np.linalg.norm(solids.shape_centre, axis=1) + solids.shape_radius
    out[shape >= 0] = np.maximum(out[shape >= 0], solid[shape[shape >= 0]])
    return out


def _radii(solids: Solids, photodiodes: Photodiodes) -> Floats:
    """Return radii of spheres around the owners' centres in which shapes and photodiodes are, (C + 1,) [m]."""
    known = solids.shape >= 0
    out, centre = np.zeros(len(solids.shape)), np.zeros((len(solids.shape), 3))
    out[known], centre[known] = solids.shape_radius[solids.shape[known]], solids.shape_centre[solids.shape[known]]
    away = np.linalg.norm(photodiodes.point_m - centre[:-1, None], axis=2)
    # The margin keeps photodiodes on the sphere within it despite rounding.
    reach = np.where(photodiodes.present, away, 0.0).max(axis=1, initial=0.0) * (1 + 1e-9)
    out[:-1] = np.maximum(out[:-1], reach)
    return out


def _is_part_of(model: mujoco.MjModel, body: int, whole: int) -> bool:
    """Return whether `body` hangs below `whole`, which must not be the world; parents come before their children."""
    while body > whole:
        body = int(model.body_parentid[body])
    return body == whole > 0
