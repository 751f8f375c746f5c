"""Docking ports: frames on craft, how two of them stand to each other, and the pose in which they are mated.

A port's origin is where the mating faces meet, its +z points outwards along the docking axis. Mated, a craft's own port
has its origin at the target's, and its axes half a turn about x from it:

    R_l_own = R_l_port diag(1, -1, -1),    so    R_l_b = R_l_own R_b_own^T,   p_b = p_port - R_l_b s_own            (C1)

With q the craft's port relative to the target's, in the target port's frame, the range is q_z, the lateral offset is
|(q_x, q_y)|, the angle is that between the own axis and the opposite of the target's, the closing speed is -q'_z.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats

FACE_TO_FACE = np.diag([1.0, -1.0, -1.0])
"""Half a turn about x: from a port's axes to those of the one that is mated to it."""


class Port(NamedTuple):
    """A docking port in some frame: position (..., 3) [m] and rotation (..., 3, 3), whose third column points out."""

    position: Floats
    rotation: Floats


class Closing(NamedTuple):
    """How two ports stand: range and lateral offset [m], angle [rad], closing speed [m/s], each (...)."""

    range_m: Floats
    lateral_m: Floats
    angle_rad: Floats
    speed_m_s: Floats


def placed(port: Port, rotation: Floats, position: Floats) -> Port:
    """A body's port in the frame in which the body has this rotation (..., 3, 3) and position (..., 3) [m]."""
    return Port(position + rotation @ port.position, rotation @ port.rotation)


def docked_pose(own: Port, target: Port) -> tuple[Floats, Floats]:
    """Rotation (3, 3) and position (3,) [m] of the body whose port `own` is mated to `target` (C1)."""
    rotation = target.rotation @ FACE_TO_FACE @ own.rotation.T
    return rotation, target.position - rotation @ own.position


def closing(own: Port, target: Port, velocity: Floats) -> Closing:
    """How the port `own` stands to `target`, both in one frame; velocity: (..., 3) [m/s], of own against target."""
    axis = target.rotation[..., :, 2]
    away = own.position - target.position
    distance = np.sum(away * axis, axis=-1)
    across = away - distance[..., None] * axis
    facing = own.rotation[..., :, 2]
    # Of the chord between the axis and the opposite of the other: exact also where the angle is nearly nothing.
    angle = 2 * np.arcsin(np.minimum(np.linalg.norm(facing + axis, axis=-1) / 2, 1.0))
    return Closing(distance, np.linalg.norm(across, axis=-1), angle, -np.sum(velocity * axis, axis=-1))
