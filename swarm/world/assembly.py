"""One MuJoCo model of many craft, each a copy of its file's one rigid body, attached at its starting pose.

Attaching takes time in proportion to the number of elements that the parent holds already, so craft are gathered in
groups of BATCH, groups in groups of groups, and so on: the time grows as C log C. Compiling stays quadratic in C
(MuJoCo finds every body's inverse inertia through the mass matrix of all): 0.2 s for 1000 craft and half a minute for
10 000.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from estimators.arrays import Floats
from estimators.rotation import matrix_from_quaternion, quaternion_multiply
from swarm.world.craft import FilePose, load_static, quiet
from swarm.world.docking import add_latches

LIGHTHOUSE = "lighthouse"
"""Prefix of the lighthouse in the MuJoCo model; no craft may have this name."""
BATCH = 32
"""Largest number of craft, or groups of craft, attached to one parent."""


class Placement(NamedTuple):
    """One object to attach.

    name: name of the object.
    spec: its file's one body.
    file_pose: pose of that body in the file.
    position: position in the world, (3,) [m].
    quaternion: attitude in the world, (4,) wxyz.
    """

    name: str
    spec: mujoco.MjSpec
    file_pose: FilePose
    position: Floats
    quaternion: Floats


class Standing(NamedTuple):
    """One lighthouse station that stays where it is.

    name: its name. model: path of its model file. position: (3,) [m]. quaternion: (4,) wxyz.
    """

    name: str
    model: Path
    position: Floats
    quaternion: Floats


def at_origin(model: Path) -> Standing:
    """Return the one lighthouse, whose frame is the world's."""
    return Standing(LIGHTHOUSE, model, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


def assemble(
    craft: Sequence[Placement],
    stations: Sequence[Standing],
    timestep_s: float,
    latches: Sequence[tuple[int, int]] = (),
) -> mujoco.MjModel:
    """Return the compiled model: world, stations, and the craft, each in their order.

    Args:
        craft: the craft, at their starting poses.
        stations: the stations that stay where they are.
        timestep_s: length of a physics step [s].
        latches: pairs of craft, by index, that can be latched together.

    Raises:
        SwarmError: `load_static` refuses a station's model.
    """
    world = _empty(timestep_s)
    with quiet():
        for station in stations:
            spec, pose = load_static(station.model)
            _attach(world, Placement(station.name, spec, pose, station.position, station.quaternion))
        _attach_group(world, craft, timestep_s)
        bodies = [f"{single.name}/{single.spec.worldbody.bodies[0].name}" for single in craft]
        add_latches(world, [(bodies[one], bodies[other]) for one, other in latches])
        world.memory = _memory_bytes(len(craft))
        return world.compile()


def _attach_group(parent: mujoco.MjSpec, craft: Sequence[Placement], timestep_s: float) -> None:
    """Attach the craft to `parent`, in groups of equal size where there are more than BATCH."""
    if len(craft) <= BATCH:
        for single in craft:
            _attach(parent, single)
    else:
        size = BATCH
        while size * BATCH < len(craft):
            size *= BATCH
        for first in range(0, len(craft), size):
            group = _empty(timestep_s)
            _attach_group(group, craft[first : first + size], timestep_s)
            parent.attach(group, prefix="", frame=parent.worldbody.add_frame())
    parent.dedup_assets()


def _memory_bytes(craft: int) -> int:
    """Return the size of MuJoCo's working memory: all pairs of bodies, which its broad phase reserves, and contacts.

    The operating system provides the memory as it is used, so that a swarm without contacts takes a few megabytes.
    MuJoCo's own estimate grows with the square of 6 C doubles: more than the machine has from 10 000 craft on.
    """
    return (64 << 20) + 4 * craft * craft + (16 << 10) * craft


def _empty(timestep_s: float) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.modelname = "swarm"
    spec.copy_during_attach = True
    spec.option.timestep = timestep_s
    spec.option.gravity = np.zeros(3)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # An automatic reset would silently continue the run from its start. Free bodies have no springs or dampers.
    off = mujoco.mjtDisableBit
    spec.option.disableflags |= int(off.mjDSBL_AUTORESET) | int(off.mjDSBL_SPRING) | int(off.mjDSBL_DAMPER)
    return spec


def _attach(parent: mujoco.MjSpec, craft: Placement) -> None:
    """Attach a copy of the root body so that it has the given pose, whatever its pose in its own file."""
    spec, file_pose = craft.spec, craft.file_pose
    turn = quaternion_multiply(craft.quaternion, file_pose[1] * [1, -1, -1, -1])
    place = craft.position - matrix_from_quaternion(turn) @ file_pose[0]
    spec.option = parent.option
    frame = parent.worldbody.add_frame(pos=place, quat=turn)
    frame.attach_body(spec.worldbody.bodies[0], f"{craft.name}/", "")
