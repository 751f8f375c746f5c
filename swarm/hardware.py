"""What is mounted on a craft: photodiodes, cameras, lights, thrusters, wheels and docking ports.

Physics and the on-board computer share these records. All places and directions are in the craft's body frame.

Docking ports are frames. A port's origin is where the mating faces meet, its +z axis points outwards along the docking
axis. When two ports are mated, a craft's own port has its origin at the target's, and its axes half a turn about x from
it:

    R_l_own = R_l_port diag(1, -1, -1),    so    R_l_b = R_l_own R_b_own^T,   p_b = p_port - R_l_b s_own            (C1)

With q the position of the craft's port relative to the target's, in the target port's frame, the range is q_z, the
lateral offset is |(q_x, q_y)|, the angle is the one between the own axis and the opposite of the target's, and the
closing speed is -q'_z.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints


class Photodiodes(NamedTuple):
    """Photodiodes of C craft, padded to the largest number K.

    point_m: (C, K, 3) [m] and normal: (C, K, 3), unit, in the craft's body frame. present: (C, K), False where padded.
    """

    point_m: Floats
    normal: Floats
    present: Bools

    @property
    def craft_count(self) -> int:
        """The number of craft C."""
        return len(self.present)

    def of(self, craft: int) -> "Photodiodes":
        """The layout of one craft, as a batch of one without padding."""
        real = self.present[craft]
        return Photodiodes(self.point_m[craft][real][None], self.normal[craft][real][None], real[real][None])


def pad(points: list[Floats], normals: list[Floats]) -> Photodiodes:
    """One layout from a list of (k, 3) [m] points and (k, 3) normals per craft."""
    most = max((len(p) for p in points), default=0)
    craft = len(points)
    layout = Photodiodes(
        np.zeros((craft, most, 3)), np.zeros((craft, most, 3)), np.zeros((craft, most), dtype=np.bool_)
    )
    for i, (point, normal) in enumerate(zip(points, normals, strict=True)):
        layout.point_m[i, : len(point)] = point
        layout.normal[i, : len(normal)] = normal
        layout.present[i, : len(point)] = True
    return layout


class Cameras(NamedTuple):
    """A craft's cameras, main camera first.

    rotation: (N, 3, 3) R_b_c of the camera's frame, x right, y down in the image, z along the optical axis. position_m:
    (N, 3) [m], the pinholes in the body frame. N is 2, or 0 for a craft without a pair.
    """

    rotation: Floats
    position_m: Floats


class Lights(NamedTuple):
    """The lights that a craft shows to others' cameras: point_m (L, 3) [m], normal (L, 3), unit, in its body frame."""

    point_m: Floats
    normal: Floats


class Thrusters(NamedTuple):
    """A craft's on-off thrusters: point_m (N, 3) [m] and exhaust (N, 3), unit, in its body frame; the force on the
    craft is against the exhaust. force_n: (N,) [N] while open. minimum_impulse_ns: (N,) [N s] of the shortest pulse.
    """

    point_m: Floats
    exhaust: Floats
    force_n: Floats
    minimum_impulse_ns: Floats

    def none(self) -> "Thrusters":
        """The same craft without any."""
        return Thrusters(*(part[:0] for part in self))


class Wheels(NamedTuple):
    """A craft's reaction wheels: axis (W, 3), unit, in its body frame; torque_nm (W,) [N m] and momentum_nms (W,)
    [N m s], the most of each in either direction.
    """

    axis: Floats
    torque_nm: Floats
    momentum_nms: Floats

    def none(self) -> "Wheels":
        """The same craft without any."""
        return Wheels(*(part[:0] for part in self))


class Fitted(NamedTuple):
    """One craft's actuators. errors: 1 sigma of a thruster's relative error of force, and of its tilt [rad]. key: of
    the craft's random numbers.
    """

    thrusters: Thrusters
    wheels: Wheels
    errors: tuple[float, float]
    key: int


class ActuatorSet(NamedTuple):
    """The actuators of A craft, body frame, padded to the most thrusters N and wheels W of any; zeros are padding.

    who: (A,), the craft that have some. force: (A, N, 3) [N] while open. arm: (A, N, 3) [m] from the centre
    of mass. shortest_s: (A, N), the shortest pulse. has_thruster: (A, N). axis: (A, W, 3). torque_nm: (A, W) [N m] and
    momentum_nms: (A, W) [N m s], the most of a wheel.
    """

    who: Ints
    force: Floats
    arm: Floats
    shortest_s: Floats
    has_thruster: Bools
    axis: Floats
    torque_nm: Floats
    momentum_nms: Floats

    def thrusting(self, craft: int) -> Bools:
        """Return which of `craft` craft have thrusters, (C,)."""
        out = np.zeros(craft, dtype=np.bool_)
        out[self.who] = self.has_thruster.any(axis=1)
        return out

    @property
    def effect(self) -> Floats:
        """Force [N] and torque [N m] about the centre of mass, (A, 6, N + W), of all at their most."""
        wheels = self.axis * self.torque_nm[..., None]
        force = np.concatenate([self.force, np.zeros_like(wheels)], axis=1)
        torque = np.concatenate([np.cross(self.arm, self.force), wheels], axis=1)
        out: Floats = np.swapaxes(np.concatenate([force, torque], axis=2), 1, 2).copy()
        return out


def actuator_set(fitted: Sequence[Fitted], com_m: Floats) -> ActuatorSet:
    """The actuators of every craft that has some. com_m: (C, 3) [m], centres of mass."""
    thrusters = [len(f.thrusters.force_n) for f in fitted]
    wheels = [len(f.wheels.torque_nm) for f in fitted]
    who = [i for i in range(len(fitted)) if thrusters[i] or wheels[i]]
    shape, wheel_shape = (len(who), max(thrusters, default=0)), (len(who), max(wheels, default=0))
    out = ActuatorSet(
        who=np.array(who, dtype=np.int64),
        force=np.zeros((*shape, 3)),
        arm=np.zeros((*shape, 3)),
        shortest_s=np.zeros(shape),
        has_thruster=np.zeros(shape, dtype=np.bool_),
        axis=np.zeros((*wheel_shape, 3)),
        torque_nm=np.zeros(wheel_shape),
        momentum_nms=np.zeros(wheel_shape),
    )
    for a, craft in enumerate(who):
        f, n, w = fitted[craft], thrusters[craft], wheels[craft]
        out.force[a, :n] = -f.thrusters.force_n[:, None] * f.thrusters.exhaust
        out.arm[a, :n] = f.thrusters.point_m - com_m[craft]
        out.shortest_s[a, :n] = f.thrusters.minimum_impulse_ns / f.thrusters.force_n
        out.has_thruster[a, :n] = True
        out.axis[a, :w], out.torque_nm[a, :w], out.momentum_nms[a, :w] = f.wheels
    return out


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
