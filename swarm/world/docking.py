"""A craft's docking port as its model file has it, and the latches that close when two ports have met.

The port is the site whose name starts with `port`: +z outwards along the docking axis, the origin where the mating
faces meet (`swarm.hardware`). A latch is a weld of MuJoCo's between the two bodies, idle until it is closed; it then
keeps the pose that they have to each other. It closes when both touch something while the ports stand within its reach.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from estimators.arrays import Floats
from estimators.rotation import matrix_from_quaternion, quaternion_multiply, skew
from swarm.errors import SwarmError
from swarm.hardware import Closing, Port, closing, placed

ANCHOR, POSE, TORQUE = slice(0, 3), slice(3, 10), 10
"""Where MuJoCo's data of a weld has its anchor in the second body, that body's pose in the first, its torque scale."""
INVERSE = np.array([1.0, -1.0, -1.0, -1.0])


class Mating(NamedTuple):
    """Who docks to whom: craft and target by index, their ports in their body frames, and the latch's reach: lateral
    offset [m] and angle [rad].
    """

    craft: int
    target: int
    own: Port
    at: Port
    latch_radius_m: float
    latch_rad: float

    def closing(self, rotation: Floats, position: Floats, velocity: Floats, angular_rate: Floats) -> Closing:
        """How the two ports stand; of all craft, in one frame: rotation (C, 3, 3), position, velocity, rate (C, 3)."""
        who = (self.craft, self.target)
        own, at = (placed(p, rotation[i], position[i]) for p, i in zip((self.own, self.at), who, strict=True))
        # Both velocities at the craft's own port.
        here, there = (velocity[i] + skew(angular_rate[i]) @ (own.position - position[i]) for i in who)
        return closing(own, at, here - there)

    def within_reach(self, at: Closing) -> bool:
        """Whether the latch can close."""
        return bool(at.lateral_m <= self.latch_radius_m and at.angle_rad <= self.latch_rad)


def port_of(model: mujoco.MjModel, path: Path) -> Port | None:
    """The port of the one rigid body of `model`, read from `path`. Raises SwarmError for more than one."""
    found = [i for i in range(model.nsite) if model.site(i).name.startswith("port")]
    if len(found) > 1:
        raise SwarmError(f"{path}: {len(found)} docking ports (sites whose name starts with 'port'); one at most")
    if not found:
        return None
    return Port(model.site_pos[found[0]].copy(), matrix_from_quaternion(model.site_quat[found[0]]))


def add_latches(world: mujoco.MjSpec, bodies: Sequence[tuple[str, str]]) -> None:
    """An idle latch between each pair of bodies, by their names."""
    for one, other in bodies:
        weld = world.add_equality(name=f"{one}|{other}", name1=one, name2=other, active=False)
        weld.type, weld.objtype = mujoco.mjtEq.mjEQ_WELD, mujoco.mjtObj.mjOBJ_BODY


def close(model: mujoco.MjModel, data: mujoco.MjData, latch: int) -> None:
    """Close a latch, by its number, upon the two bodies as they stand."""
    one, other = int(model.eq_obj1id[latch]), int(model.eq_obj2id[latch])
    back = data.xquat[one] * INVERSE
    place = matrix_from_quaternion(back) @ (data.xpos[other] - data.xpos[one])
    weld = model.eq_data[latch]
    weld[ANCHOR], weld[TORQUE] = 0.0, 1.0
    weld[POSE] = [*place, *quaternion_multiply(back, data.xquat[other])]
    data.eq_active[latch] = 1
