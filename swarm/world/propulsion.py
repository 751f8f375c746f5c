"""A model's thrusters and reaction wheels, as a craft's MJCF file defines them.

Thrusters are the sites whose name starts with `thruster`, wheels those named `wheel...`, ordered by number. As for
every site here, a thruster's z axis points away from the craft: it is the exhaust's direction, and the force on the
craft is opposite. A wheel's z axis is its spin axis; its position does not matter. Their capabilities are in the file's
`<custom>` numbers, each a single value for all or one value per thruster (wheel):

    thruster_force_n, thruster_minimum_impulse_mns, wheel_torque_mnm, wheel_momentum_mnms
"""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from estimators.arrays import Floats
from estimators.rotation import matrix_from_quaternion
from swarm.errors import SwarmError
from swarm.hardware import Thrusters, Wheels
from swarm.world.optics import numbered

NUMBERS = {
    "thruster": ("thruster_force_n", "thruster_minimum_impulse_mns"),
    "wheel": ("wheel_torque_mnm", "wheel_momentum_mnms"),
}


def thrusters_of(model: mujoco.MjModel, path: Path) -> Thrusters:
    """Return the thrusters of the one rigid body of `model`, read from `path`.

    Raises SwarmError where a number is missing or out of range.
    """
    sites = _sites(model, "thruster")
    force, minimum = _numbers(model, path, "thruster", len(sites))
    if np.any(minimum < 0):
        raise SwarmError(f"{path}: thruster_minimum_impulse_mns must not be negative")
    axis = _axes(model, sites)
    return Thrusters(model.site_pos[sites].reshape(-1, 3).copy(), axis, force, 1e-3 * minimum)


def wheels_of(model: mujoco.MjModel, path: Path) -> Wheels:
    """Return the reaction wheels of the one rigid body of `model`, read from `path`.

    Raises SwarmError where a number is missing or out of range.
    """
    sites = _sites(model, "wheel")
    torque, momentum = _numbers(model, path, "wheel", len(sites))
    if np.any(momentum <= 0):
        raise SwarmError(f"{path}: wheel_momentum_mnms must be positive")
    return Wheels(_axes(model, sites), 1e-3 * torque, 1e-3 * momentum)


def _sites(model: mujoco.MjModel, prefix: str) -> list[int]:
    return numbered([model.site(i).name for i in range(model.nsite)], prefix)


def _axes(model: mujoco.MjModel, sites: Sequence[int]) -> Floats:
    axis: Floats = matrix_from_quaternion(model.site_quat[list(sites)].reshape(-1, 4))[..., 2]
    return axis


def _numbers(model: mujoco.MjModel, path: Path, prefix: str, count: int) -> tuple[Floats, Floats]:
    """Return both numbers of `count` thrusters (wheels), one value each; the first (force or torque) is positive."""
    found: list[Floats] = []
    for name in NUMBERS[prefix]:
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
        if count == 0:
            found.append(np.zeros(0))
            continue
        if index < 0:
            raise SwarmError(f'{path}: it has sites {prefix}..., but no <custom> <numeric name="{name}" data="..."/>')
        first = model.numeric_adr[index]
        data = np.array(model.numeric_data[first : first + model.numeric_size[index]])
        if len(data) not in (1, count) or not np.isfinite(data).all():
            raise SwarmError(f"{path}: {name} needs one number, or one for each of the {count}; it has {len(data)}")
        found.append(np.broadcast_to(data, count).copy())
    if np.any(found[0] <= 0):
        raise SwarmError(f"{path}: {NUMBERS[prefix][0]} must be positive")
    return found[0], found[1]
