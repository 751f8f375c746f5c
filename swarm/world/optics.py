"""A model's cameras and lights for the CCD sensor, as a craft's MJCF file defines them.

Cameras are those named `ccd...`, ordered by the number in the name with the main one first; a craft has none or two.
MuJoCo's cameras look along their -z with y up, the cameras here along +z with y down: half a turn about x. Lights are
the sites named `light...`, ordered by number; a site's z axis is the direction in which the light shines.
"""

import re
from pathlib import Path

import mujoco
import numpy as np

from estimators.rotation import matrix_from_quaternion
from swarm.errors import SwarmError
from swarm.hardware import Cameras, Lights

HALF_TURN_ABOUT_X = np.diag([1.0, -1.0, -1.0])


def cameras_of(model: mujoco.MjModel, path: Path) -> Cameras:
    """Return the cameras of the one rigid body of `model`, read from `path`.

    Raises SwarmError where there are neither none nor two.
    """
    found = numbered([model.cam(i).name for i in range(model.ncam)], "ccd")
    if len(found) not in (0, 2):
        raise SwarmError(f"{path}: {len(found)} cameras (whose name starts with 'ccd'): a pair is two, main and backup")
    rotation = matrix_from_quaternion(model.cam_quat[found].reshape(-1, 4)) @ HALF_TURN_ABOUT_X
    return Cameras(rotation, model.cam_pos[found].reshape(-1, 3).copy())


def lights_of(model: mujoco.MjModel) -> Lights:
    """Return the lights of the one rigid body of `model`; there may be none."""
    found = numbered([model.site(i).name for i in range(model.nsite)], "light")
    normal = matrix_from_quaternion(model.site_quat[found].reshape(-1, 4))[..., 2]
    return Lights(model.site_pos[found].reshape(-1, 3).copy(), normal)


def numbered(names: list[str], prefix: str) -> list[int]:
    """Return the indices of the names that start with `prefix`, by the number in the name: light2 before light10."""
    found = []
    for index, name in enumerate(names):
        if name.startswith(prefix):
            number = re.search(r"\d+", name)
            found.append((int(number.group()) if number else 0, name, index))
    return [index for _, _, index in sorted(found)]
