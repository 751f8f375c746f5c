"""Places where no photodiode may sit: by the craft's model, and by the user.

A zone is a box in the body frame, or what a name in the model file stands for:

    a body, a geom    the surface of it, and of all bodies below it
    a site            the volume of it: box, sphere, ellipsoid, cylinder or capsule

Bodies, geoms and sites whose name starts with `keepout` are zones by themselves. A site is met by no ray and weighs
nothing, so a zone may reach over parts of the craft.
"""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from estimators.arrays import Bools, Floats, Ints
from swarm.errors import SwarmError, did_you_mean
from swarm.world.craft import quiet
from swarm.world.hull import Mount
from swarm.world.mesh_file import read_named_meshes
from swarm.world.model_file import open_model

PREFIX = "keepout"
BOX = "six numbers, x0,x1,y0,y1,z0,z1 in metres in the body frame"
AHEAD_M = 1e-4
"""A ray to the surface below a photodiode starts this far above the photodiode."""


class KeepOut:
    """The zones of one craft. zones: their names, as the user knows them."""

    def __init__(self, path: Path, wanted: Sequence[str]) -> None:
        """Read the model file, and the user's zones.

        Args:
            path: The craft's model file.
            wanted: Boxes and names of the user.

        Raises:
            SwarmError: A zone is neither a box nor a name in the file.
        """
        self._model = _unfused(path)
        self._data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, self._data)
        self._boxes: list[Floats] = []
        names: list[str] = []
        for text in wanted:
            box = _box(text)
            if box is None:
                names.append(text)
            else:
                self._boxes.append(box)
        known = self._names()
        for name in names:
            if name not in known:
                raise SwarmError(
                    f"--keep-out {name}: {path.name} has no body, geom or site of this name"
                    f"{did_you_mean(name, known)}; a box is {BOX}"
                )
        marked = [name for name in known if name.startswith(PREFIX)]
        self._zones = list(dict.fromkeys([*names, *marked]))
        self.zones = [*self._zones, *(text for text in wanted if text not in names)]

    def free(self, mount: Mount) -> Bools:
        """Return which places (N,) lie in no zone."""
        out = np.ones(len(mount.point_m), dtype=np.bool_)
        if not self.zones:
            return out
        for low, high in self._boxes:
            out &= ~((mount.point_m >= low) & (mount.point_m <= high)).all(axis=1)
        if not self._zones:
            return out
        root = self._data.xmat[1].reshape(3, 3), self._data.xpos[1]
        point, normal = mount.point_m @ root[0].T + root[1], mount.normal @ root[0].T
        carrier = self._carriers(point, normal)
        for name in self._zones:
            out &= ~np.isin(carrier, self._geoms(name))
            site = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_SITE, name)
            if site >= 0:
                out &= ~self._within(site, point)
        return out

    def _names(self) -> list[str]:
        m = self._model
        every = [*(m.body(i).name for i in range(1, m.nbody)), *(m.geom(i).name for i in range(m.ngeom))]
        return [name for name in (*every, *(m.site(i).name for i in range(m.nsite))) if name]

    def _carriers(self, point: Floats, normal: Floats) -> Ints:
        """Return the geom (N,) on which each place lies, -1 for none."""
        out, geom = np.empty(len(point), dtype=np.int64), np.empty(1, dtype=np.int32)
        for i, (start, up) in enumerate(zip(point + AHEAD_M * normal, normal, strict=True)):
            mujoco.mj_ray(self._model, self._data, start, -up, None, True, -1, geom)
            out[i] = geom[0]
        return out

    def _geoms(self, name: str) -> Ints:
        """Return the geoms of a body of this name and all below it, and the geom of this name."""
        m = self._model
        mine = np.array([m.geom(i).name == name for i in range(m.ngeom)], dtype=np.bool_)
        body = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, name)
        for above in range(m.nbody) if body >= 0 else ():
            at = above
            while at > 0 and at != body:
                at = int(m.body_parentid[at])
            if at == body:
                mine |= m.geom_bodyid == above
        return np.flatnonzero(mine)

    def _within(self, site: int, point: Floats) -> Bools:
        """Return which points (N, 3) lie inside a site."""
        turn, size = self._data.site_xmat[site].reshape(3, 3), self._model.site_size[site]
        local, kind, shape = (point - self._data.site_xpos[site]) @ turn, self._model.site_type[site], mujoco.mjtGeom
        if kind == shape.mjGEOM_BOX:
            inside = (np.abs(local) <= size).all(axis=1)
        elif kind == shape.mjGEOM_ELLIPSOID:
            inside = np.linalg.norm(local / size, axis=1) <= 1
        elif kind == shape.mjGEOM_SPHERE:
            inside = np.linalg.norm(local, axis=1) <= size[0]
        elif kind == shape.mjGEOM_CAPSULE:
            local[:, 2] -= np.clip(local[:, 2], -size[1], size[1])
            inside = np.linalg.norm(local, axis=1) <= size[0]
        else:
            inside = (np.hypot(local[:, 0], local[:, 1]) <= size[0]) & (np.abs(local[:, 2]) <= size[1])
        return np.asarray(inside, dtype=np.bool_)


def _box(text: str) -> Floats | None:
    """Return the low and the high corner of a box, (2, 3), None for a text without numbers. Raises SwarmError."""
    parts = text.split(",")
    try:
        numbers = np.array([float(part) for part in parts])
    except ValueError:
        return None
    if len(numbers) != 6 or not np.isfinite(numbers).all():
        raise SwarmError(f"--keep-out {text}: a box is {BOX}")
    low, high = numbers[::2], numbers[1::2]
    if not (low < high).all():
        raise SwarmError(f"--keep-out {text}: each first number must be below the second; a box is {BOX}")
    return np.stack([low, high])


def _unfused(path: Path) -> mujoco.MjModel:
    """Return the model of a file with its bodies as they are, for their names."""
    try:
        with quiet():
            spec = open_model(path)
            spec.compiler.discardvisual = False
            read_named_meshes(spec)
            return spec.compile()
    except ValueError as error:
        raise SwarmError(f"{path} does not compile: {' '.join(str(error).split())}") from None
