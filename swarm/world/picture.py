"""Pictures of craft and lighthouse, drawn by MuJoCo off the screen, with or without a graphics card.

The world is that of a flight (`swarm.world.assembly`), without its physics: craft are put where they are told to be.
Which graphics library draws is chosen before (`swarm.world.offscreen`).
MuJoCo's own cameras have z up, and the lighthouse frame has y down, so the camera is set directly. Marks are drawn as
MuJoCo draws its decorations.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from swarm.errors import SwarmError
from swarm.world.assembly import Placement, Standing, assemble
from swarm.world.craft import load_craft

FIELD_DEG = 40.0
"""Full height of the camera's field."""
NEAR_M = 0.02
SAMPLES = 4
"""Samples per pixel."""
AMBIENT, DIFFUSE, SPECULAR = (np.full(3, share) for share in (0.35, 0.75, 0.3))
"""The light of the camera's lamp, which is the only one."""
MOST_MATERIALS = 900
"""Most materials of all craft together; MuJoCo draws 1000. More craft are drawn in plain colours."""
LIBRARIES = "Debian: libegl1 libgl1-mesa-dri, or libosmesa6"


class Subject(NamedTuple):
    """A craft that is drawn. passive: without photodiodes."""

    name: str
    model: Path
    passive: bool


class View(NamedTuple):
    """A camera: its place and the point that it looks at, (3,) [m], with the lighthouse's -y upwards."""

    eye_m: Floats
    target_m: Floats


class Mark(NamedTuple):
    """A decoration: a line from `a_m` to `b_m` (3,) of some width, or a ball about `a_m` where there is no `b_m`."""

    a_m: Floats
    b_m: Floats | None
    width_m: float
    rgba: tuple[float, float, float, float]


class Plate(NamedTuple):
    """A thin see-through box: its centre (3,), its half edges (3,) [m] and its rotation (3, 3)."""

    centre_m: Floats
    half_m: Floats
    rotation: Floats
    rgba: tuple[float, float, float, float]


class Wedge(NamedTuple):
    """A thin see-through triangle: its tip (3,) and the two other corners (3,), as far from it as each other [m]."""

    tip_m: Floats
    corners_m: tuple[Floats, Floats]
    rgba: tuple[float, float, float, float]


class Picture:
    """Draws craft and lighthouse. As a context manager it gives its memory back."""

    def __init__(
        self, craft: Sequence[Subject], stations: Sequence[Standing], width: int, height: int, marks: int
    ) -> None:
        """Build the scene.

        Args:
            craft: The craft.
            stations: The lighthouse stations that stay where they are.
            width: Width of a picture [px].
            height: Its height.
            marks: Most marks, plates and halves of wedges of a picture.

        Raises:
            SwarmError: A model is refused, or this machine cannot draw.
        """
        models = [load_craft(each.model, each.passive) for each in craft]
        rest = np.array([1.0, 0.0, 0.0, 0.0])
        specs = [model.spec for model in models]
        if sum(len(spec.materials) for spec in specs) > MOST_MATERIALS:
            plain = {model.path: _plain(model.spec) for model in models}
            specs = [plain[model.path] for model in models]
        placements = [
            Placement(each.name, spec, model.file_pose, np.zeros(3), rest)
            for each, model, spec in zip(craft, models, specs, strict=True)
        ]
        self._model = assemble(placements, stations, 0.001)
        seen = self._model.vis
        seen.global_.offwidth, seen.global_.offheight, seen.quality.offsamples = width, height, SAMPLES
        seen.map.znear = NEAR_M
        self._model.stat.extent = 1.0
        seen.headlight.ambient, seen.headlight.diffuse, seen.headlight.specular = AMBIENT, DIFFUSE, SPECULAR
        self._data = mujoco.MjData(self._model)
        self._pose = self._data.qpos.reshape(-1, 7)
        try:
            self._renderer = mujoco.Renderer(self._model, height, width, max_geom=self._model.ngeom + marks + 16)
        except Exception as error:  # each graphics library has its own kind
            raise SwarmError(
                f"this machine cannot draw off the screen ({_first_line(error)}): install a graphics library "
                f"({LIBRARIES}), and set MUJOCO_GL to egl or osmesa if the wrong one is chosen"
            ) from None
        self._ratio = width / height

    def draw(
        self,
        position: Floats,
        quaternion: Floats,
        view: View,
        marks: Sequence[Mark] = (),
        plates: Sequence[Plate] = (),
        wedges: Sequence[Wedge] = (),
    ) -> NDArray[np.uint8]:
        """Return a picture, (height, width, 3).

        Args:
            position: Places of the craft, (C, 3) [m].
            quaternion: Their attitudes, (C, 4) wxyz.
            view: The camera.
            marks: Lines and balls.
            plates: Thin boxes, drawn in front of what is behind them.
            wedges: Thin triangles, likewise.
        """
        self._pose[:, :3], self._pose[:, 3:] = position, quaternion
        mujoco.mj_kinematics(self._model, self._data)
        renderer: Any = self._renderer
        renderer.update_scene(self._data)
        scene = renderer.scene
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self._point(scene, view)
        for mark in marks:
            geom = _next(scene)
            if mark.b_m is None:
                _fill(geom, mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, mark.width_m), mark.a_m, np.eye(3), mark.rgba)
            else:
                _fill(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3), np.eye(3), mark.rgba)
                mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, mark.width_m, mark.a_m, mark.b_m)
        for plate in plates:
            _fill(_next(scene), mujoco.mjtGeom.mjGEOM_BOX, plate.half_m, plate.centre_m, plate.rotation, plate.rgba)
        for wedge in wedges:
            _fan_out(scene, wedge)
        drawn: NDArray[np.uint8] = renderer.render()
        return drawn

    def _point(self, scene: Any, view: View) -> None:
        forward = view.target_m - view.eye_m
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, [0.0, -1.0, 0.0])
        up = np.cross(right / np.linalg.norm(right), forward)
        for lamp in scene.lights[: scene.nlight]:
            lamp.pos, lamp.dir = view.eye_m, forward
        high = NEAR_M * np.tan(np.radians(FIELD_DEG / 2))
        for camera in scene.camera:
            camera.pos, camera.forward, camera.up = view.eye_m, forward, up
            camera.frustum_near, camera.frustum_far = NEAR_M, 1e4 * NEAR_M
            camera.frustum_bottom, camera.frustum_top = -high, high
            camera.frustum_center, camera.frustum_width = 0.0, high * self._ratio

    def close(self) -> None:
        """Give the memory back."""
        self._renderer.close()

    def __enter__(self) -> "Picture":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _plain(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy of a craft whose parts have the colours of their materials, and no materials."""
    out = spec.copy()
    ink = {each.name: np.array(each.rgba) for each in out.materials}
    for geom in out.geoms:
        if geom.material in ink:
            geom.rgba = ink[geom.material]
            geom.material = ""
    for asset in [*out.materials, *out.textures]:
        out.delete(asset)
    return out


def _next(scene: Any) -> Any:
    if scene.ngeom >= scene.maxgeom:
        raise ValueError("more marks than the picture was made for")
    scene.ngeom += 1
    return scene.geoms[scene.ngeom - 1]


def _fan_out(scene: Any, wedge: Wedge) -> None:
    """Add a wedge as two right triangles, the only ones that MuJoCo draws."""
    foot = (wedge.corners_m[0] + wedge.corners_m[1]) / 2
    down = wedge.tip_m - foot
    high = float(np.linalg.norm(down))
    for corner, turned in zip(wedge.corners_m, (False, True), strict=True):
        wide = float(np.linalg.norm(corner - foot))
        legs = [((corner - foot) / wide, wide), (down / high, high)]
        # Both halves face the same side, which the light tells.
        (x, first), (y, second) = legs[::-1] if turned else legs
        rotation = np.stack([x, y, np.cross(x, y)], axis=1)
        size = np.array([first, second, 0.0])
        _fill(_next(scene), mujoco.mjtGeom.mjGEOM_TRIANGLE, size, foot, rotation, wedge.rgba)


def _fill(
    geom: Any, kind: Any, size: Floats, place: Floats, rotation: Floats, rgba: tuple[float, float, float, float]
) -> None:
    mujoco.mjv_initGeom(geom, kind, size, place, rotation.ravel(), np.array(rgba, dtype=np.float32))
    geom.emission = 0.3
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
