"""One MuJoCo model of many craft: each a copy of its file's one rigid body, attached where it starts.

Attaching costs time in proportion to what the parent holds already, so craft are gathered in groups of BATCH, groups
in groups of groups, and so on: the time grows as C log C. Compiling stays quadratic in C (MuJoCo finds every body's
inverse inertia through the mass matrix of all): 0.2 s for 1000 craft and half a minute for 10 000.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from estimators.arrays import Floats
from estimators.rotation import matrix_from_quaternion, quaternion_multiply
from swarm.world.craft import FilePose, load_static, quiet

LIGHTHOUSE = "lighthouse"
"""The lighthouse's prefix in the MuJoCo model; no craft may have this name."""
BATCH = 32
"""Craft, or groups of craft, attached to one parent."""


class Placement(NamedTuple):
    """One thing to attach: its name, its file's one body and that body's pose there, its position (3,) [m] and
    quaternion (4,) wxyz.
    """

    name: str
    spec: mujoco.MjSpec
    file_pose: FilePose
    position: Floats
    quaternion: Floats


def assemble(craft: Sequence[Placement], lighthouse: Path, timestep_s: float) -> mujoco.MjModel:
    """The compiled model: world, lighthouse, and the craft in their order. Raises SwarmError as `load_static` does."""
    world = _empty(timestep_s)
    with quiet():
        station, pose = load_static(lighthouse)
        _attach(world, Placement(LIGHTHOUSE, station, pose, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])))
        _attach_group(world, craft, timestep_s)
        world.memory = _memory_bytes(len(craft))
        return world.compile()


def _attach_group(parent: mujoco.MjSpec, craft: Sequence[Placement], timestep_s: float) -> None:
    """Attach the craft to `parent`, in groups of equal size where they are more than BATCH."""
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
    """MuJoCo's working memory: room for all pairs of bodies, which its broad phase reserves, and for the contacts.

    The system hands it out as it is used, so that a swarm without contacts takes a few megabytes of it. MuJoCo's own
    guess grows with the square of 6 C doubles: more than there is from 10 000 craft on.
    """
    return (64 << 20) + 4 * craft * craft + (16 << 10) * craft


def _empty(timestep_s: float) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.modelname = "swarm"
    spec.copy_during_attach = True
    spec.option.timestep = timestep_s
    spec.option.gravity = np.zeros(3)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # After a reset the run would go on from its start as if nothing had happened. Free bodies have no springs.
    off = mujoco.mjtDisableBit
    spec.option.disableflags |= int(off.mjDSBL_AUTORESET) | int(off.mjDSBL_SPRING) | int(off.mjDSBL_DAMPER)
    return spec


def _attach(parent: mujoco.MjSpec, craft: Placement) -> None:
    """Attach a copy of the root body so that it stands at the given pose, whatever its pose in its own file."""
    spec, file_pose = craft.spec, craft.file_pose
    turn = quaternion_multiply(craft.quaternion, file_pose[1] * [1, -1, -1, -1])
    place = craft.position - matrix_from_quaternion(turn) @ file_pose[0]
    spec.option = parent.option
    frame = parent.worldbody.add_frame(pos=place, quat=turn)
    frame.attach_body(spec.worldbody.bodies[0], f"{craft.name}/", "")
