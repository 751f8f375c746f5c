"""Hardware of a craft: photodiodes, cameras, lights, thrusters, wheels and docking ports.

Physics and the on-board computer share these records. All positions and directions are in the craft's body frame.

Docking ports are frames. A port's origin is where the mating faces meet; its +z axis points outwards along the docking
axis. When two ports are mated, the frame of a craft's own port has its origin at the target's port, and its axes are
turned by half a turn about x from the target's:

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
    """Photodiodes of C craft, padded to the largest number K per craft.

    point_m: positions, (C, K, 3) [m], body frame.
    normal: unit normals, (C, K, 3), body frame.
    present: False where padded, (C, K).
    """

    point_m: Floats
    normal: Floats
    present: Bools

    @property
    def craft_count(self) -> int:
        """Number of craft C."""
        return len(self.present)

    def of(self, craft: int) -> "Photodiodes":
        """Return the layout of one craft, as a batch of one without padding."""
        real = self.present[craft]
        return Photodiodes(self.point_m[craft][real][None], self.normal[craft][real][None], real[real][None])


def pad(points: list[Floats], normals: list[Floats]) -> Photodiodes:
    """Return one layout from lists, per craft, of points (k, 3) [m] and of normals (k, 3)."""
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
    """A craft's cameras, main camera first; N is 2, or 0 for a craft without a pair.

    rotation: attitudes R_b_c of the cameras' frames, x right, y down in the image, z along the optical axis, (N, 3, 3).
    position_m: pinholes in the body frame, (N, 3) [m].
    """

    rotation: Floats
    position_m: Floats


class Lights(NamedTuple):
    """The lights that a craft shows to the cameras of others, in its body frame.

    point_m: positions, (L, 3) [m].
    normal: unit directions of the light, (L, 3).
    """

    point_m: Floats
    normal: Floats


class Thrusters(NamedTuple):
    """A craft's on-off thrusters, in its body frame; the force on the craft is opposite to the exhaust.

    point_m: positions, (N, 3) [m].
    exhaust: unit directions of the exhaust, (N, 3).
    force_n: forces while open, (N,) [N].
    minimum_impulse_ns: impulses of the shortest pulses, (N,) [N s].
    """

    point_m: Floats
    exhaust: Floats
    force_n: Floats
    minimum_impulse_ns: Floats

    def none(self) -> "Thrusters":
        """Return the thrusters of a craft that has none."""
        return Thrusters(*(part[:0] for part in self))


class Wheels(NamedTuple):
    """A craft's reaction wheels, in its body frame.

    axis: unit axes, (W, 3).
    torque_nm: largest torque in either direction, (W,) [N m].
    momentum_nms: largest momentum in either direction, (W,) [N m s].
    """

    axis: Floats
    torque_nm: Floats
    momentum_nms: Floats

    def none(self) -> "Wheels":
        """Return the wheels of a craft that has none."""
        return Wheels(*(part[:0] for part in self))


class Fitted(NamedTuple):
    """Actuators of one craft.

    thrusters: its thrusters.
    wheels: its reaction wheels.
    errors: 1 sigma of a thruster's relative error of force, and of its tilt [rad].
    key: key of the craft's random numbers.
    """

    thrusters: Thrusters
    wheels: Wheels
    errors: tuple[float, float]
    key: int


class ActuatorSet(NamedTuple):
    """Actuators of A craft, body frame, padded with zeros to the largest numbers N of thrusters and W of wheels.

    who: indices of the craft that have any, (A,).
    force: forces on the craft while open, (A, N, 3) [N].
    arm: lever arms from the centre of mass, (A, N, 3) [m].
    shortest_s: lengths of the shortest pulses, (A, N) [s].
    has_thruster: False where padded, (A, N).
    axis: unit axes of the wheels, (A, W, 3).
    torque_nm: largest torques of the wheels, (A, W) [N m].
    momentum_nms: largest momenta of the wheels, (A, W) [N m s].
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
        """Force [N] and torque [N m] about the centre of mass at full output, (A, 6, N + W)."""
        wheels = self.axis * self.torque_nm[..., None]
        force = np.concatenate([self.force, np.zeros_like(wheels)], axis=1)
        torque = np.concatenate([np.cross(self.arm, self.force), wheels], axis=1)
        out: Floats = np.swapaxes(np.concatenate([force, torque], axis=2), 1, 2).copy()
        return out


def actuator_set(fitted: Sequence[Fitted], com_m: Floats) -> ActuatorSet:
    """Return the actuators of all craft that have any. com_m: centres of mass, (C, 3) [m]."""
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
"""Half a turn about x: from a port's axes to those of the port that is mated to it."""


class Port(NamedTuple):
    """A docking port in some frame.

    position: origin, (..., 3) [m].
    rotation: attitude, (..., 3, 3), whose third column points outwards.
    """

    position: Floats
    rotation: Floats


class Closing(NamedTuple):
    """Relative pose and speed of two ports, each (...).

    range_m: range [m].
    lateral_m: lateral offset [m].
    angle_rad: angle between the docking axes [rad].
    speed_m_s: closing speed [m/s].
    """

    range_m: Floats
    lateral_m: Floats
    angle_rad: Floats
    speed_m_s: Floats


def placed(port: Port, rotation: Floats, position: Floats) -> Port:
    """Return a port in the frame in which its body has a given pose.

    Args:
        port: port in the body frame.
        rotation: attitude of the body, (..., 3, 3).
        position: position of the body, (..., 3) [m].
    """
    return Port(position + rotation @ port.position, rotation @ port.rotation)


def docked_pose(own: Port, target: Port) -> tuple[Floats, Floats]:
    """Return rotation (3, 3) and position (3,) [m] of the body whose port `own` is mated to `target` (C1)."""
    rotation = target.rotation @ FACE_TO_FACE @ own.rotation.T
    return rotation, target.position - rotation @ own.position


def closing(own: Port, target: Port, velocity: Floats) -> Closing:
    """Return the relative pose and speed of the port `own` against the port `target`, both in one frame.

    Args:
        own: port of the craft.
        target: port of the target.
        velocity: velocity of `own` relative to `target`, (..., 3) [m/s].
    """
    axis = target.rotation[..., :, 2]
    away = own.position - target.position
    distance = np.sum(away * axis, axis=-1)
    across = away - distance[..., None] * axis
    facing = own.rotation[..., :, 2]
    # From the chord between the axis and the opposite of the other; accurate also for an angle near zero.
    angle = 2 * np.arcsin(np.minimum(np.linalg.norm(facing + axis, axis=-1) / 2, 1.0))
    return Closing(distance, np.linalg.norm(across, axis=-1), angle, -np.sum(velocity * axis, axis=-1))
