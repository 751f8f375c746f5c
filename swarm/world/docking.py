"""A craft's docking port as its model file defines it, and the latches that close when two ports have met.

The port is the site whose name starts with `port`: +z outwards along the docking axis, the origin where the mating
faces meet (`swarm.hardware`). A latch is a MuJoCo weld between the two bodies, inactive until it is closed; it then
keeps their relative pose. It closes when both craft touch something while the ports are within its reach.
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
"""Layout of MuJoCo's data of a weld: anchor in the second body, pose of that body in the first, torque scale."""
INVERSE = np.array([1.0, -1.0, -1.0, -1.0])


class Mating(NamedTuple):
    """A docking pair.

    craft: index of the craft that docks.
    target: index of the craft that it docks to.
    own: port of the craft, in its body frame.
    at: port of the target, in the target's body frame.
    latch_radius_m: largest lateral offset at which the latch closes [m].
    latch_rad: largest angle at which it closes [rad].
    """

    craft: int
    target: int
    own: Port
    at: Port
    latch_radius_m: float
    latch_rad: float

    def closing(self, rotation: Floats, position: Floats, velocity: Floats, angular_rate: Floats) -> Closing:
        """Return the relative pose and speed of the two ports, from the states of all craft in one frame.

        Args:
            rotation: attitudes, (C, 3, 3).
            position: positions, (C, 3) [m].
            velocity: velocities, (C, 3) [m/s].
            angular_rate: angular rates, (C, 3) [rad/s].
        """
        who = (self.craft, self.target)
        own, at = (placed(p, rotation[i], position[i]) for p, i in zip((self.own, self.at), who, strict=True))
        # Velocities of both bodies at the craft's own port.
        here, there = (velocity[i] + skew(angular_rate[i]) @ (own.position - position[i]) for i in who)
        return closing(own, at, here - there)

    def within_reach(self, at: Closing) -> bool:
        """Return whether the latch can close."""
        return bool(at.lateral_m <= self.latch_radius_m and at.angle_rad <= self.latch_rad)


def port_of(model: mujoco.MjModel, path: Path) -> Port | None:
    """Return the port of the one rigid body of `model`, read from `path`; None without one.

    Raises SwarmError where there is more than one port.
    """
    found = [i for i in range(model.nsite) if model.site(i).name.startswith("port")]
    if len(found) > 1:
        raise SwarmError(f"{path}: {len(found)} docking ports (sites whose name starts with 'port'); one at most")
    if not found:
        return None
    return Port(model.site_pos[found[0]].copy(), matrix_from_quaternion(model.site_quat[found[0]]))


def add_latches(world: mujoco.MjSpec, bodies: Sequence[tuple[str, str]]) -> None:
    """Add an inactive latch between each pair of bodies, given by their names."""
    for one, other in bodies:
        weld = world.add_equality(name=f"{one}|{other}", name1=one, name2=other, active=False)
        weld.type, weld.objtype = mujoco.mjtEq.mjEQ_WELD, mujoco.mjtObj.mjOBJ_BODY


def close(model: mujoco.MjModel, data: mujoco.MjData, latch: int) -> None:
    """Close a latch at the present relative pose of its two bodies.

    Args:
        model: compiled model; the pose is written into the weld's data.
        data: present state.
        latch: number of the latch.
    """
    one, other = int(model.eq_obj1id[latch]), int(model.eq_obj2id[latch])
    back = data.xquat[one] * INVERSE
    place = matrix_from_quaternion(back) @ (data.xpos[other] - data.xpos[one])
    weld = model.eq_data[latch]
    weld[ANCHOR], weld[TORQUE] = 0.0, 1.0
    weld[POSE] = [*place, *quaternion_multiply(back, data.xquat[other])]
    data.eq_active[latch] = 1
