"""Where every craft should be: the motions of a scenario as smooth functions of time.

Everything is in the lighthouse frame, SI units. The attitude of a craft on its path p(t) is

    R_l_b(t) = F(p(t)) Rx(yaw) Ry(pitch) Rz(roll + spin t)

with F the facing frame of `swarm.world.motion.pointing` (body +z towards the lighthouse), or the identity where
`facing` is off. A wandering craft is turned by three random angles more (`swarm.world.motion.wander`). Tumble and drift
are free motions: the reference is their start, carried on at their first rates, and not held.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from estimators.rotation import multiply_into
from estimators.state import Motion, Reference, Steered, Vector
from swarm import random
from swarm.errors import SwarmError
from swarm.random import Blocks, Purpose
from swarm.world.motion import paths, wander
from swarm.world.motion.pointing import facing

FILL = 1.2207440846057596
"""The real root of g^4 = g + 1."""
LEAST_OFF_AXIS_M = 1e-6
"""Nearer to the lighthouse's y axis than this, "facing with down below" means nothing."""
BLOCK = 256
"""Lighthouse periods per block of random draws, so that no period loops over the craft."""


@dataclass(frozen=True)
class Attitude:
    """How a craft is turned: facing the lighthouse or not, then turned about the body's axes x (yaw), y (pitch), z."""

    facing: bool = True
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    spin_rad_s: float = 0.0


@dataclass(frozen=True)
class Hold:
    """Stay at one place; several craft spread over a square grid perpendicular to z, or over `box_m`, centred there."""

    position_m: Vector
    spacing_m: float = 0.0
    attitude: Attitude = Attitude()
    box_m: Vector | None = None


@dataclass(frozen=True)
class Ring:
    """A circle, the craft spread evenly over it, turning right-handed about its normal at `rate_rad_s`.

    The normal is the lighthouse's z axis turned about its x axis by `tilt_rad`.
    """

    centre_m: Vector
    radius_m: float
    rate_rad_s: float = 0.0
    tilt_rad: float = 0.0
    attitude: Attitude = Attitude()


@dataclass(frozen=True)
class Waypoints:
    """Through the points at the given times, smoothly, from rest to rest; at the first before, at the last after."""

    points_m: tuple[Vector, ...]
    times_s: tuple[float, ...]
    attitude: Attitude = Attitude()


@dataclass(frozen=True)
class Approach:
    """Along a straight corridor from `start_s` at a cruising speed, with a smooth start and stop."""

    from_m: Vector
    to_m: Vector
    start_s: float
    speed_m_s: float
    attitude: Attitude = Attitude()


@dataclass(frozen=True)
class Tumble:
    """Free flight and free spin: nothing is held. `angular_rate_rad_s` is in the lighthouse frame."""

    position_m: Vector
    velocity_m_s: Vector = (0.0, 0.0, 0.0)
    angular_rate_rad_s: Vector = (0.0, 0.0, 0.0)
    spacing_m: float = 0.0
    attitude: Attitude = Attitude()
    box_m: Vector | None = None


@dataclass(frozen=True)
class Drift:
    """White accelerations, constant over each lighthouse period; 1 sigma per axis, the same for every axis."""

    position_m: Vector
    acceleration_m_s2: float
    angular_acceleration_rad_s2: float
    velocity_m_s: Vector = (0.0, 0.0, 0.0)
    spacing_m: float = 0.0
    attitude: Attitude = Attitude()
    box_m: Vector | None = None


@dataclass(frozen=True)
class Wander:
    """Random motion within a box (`swarm.world.motion.wander`); speeds are RMS, turn_rad is the largest angle."""

    centre_m: Vector
    size_m: Vector
    speed_m_s: float
    turn_rad: float
    turn_rate_rad_s: float
    bandwidth_hz: float
    attitude: Attitude = Attitude()


@dataclass(frozen=True)
class Guided:
    """Starts at a place, at a velocity; then it goes where its guidance says, or on so where that says nothing."""

    position_m: Vector
    velocity_m_s: Vector = (0.0, 0.0, 0.0)
    attitude: Attitude = Attitude()


AnyMotion = Hold | Ring | Waypoints | Approach | Tumble | Drift | Wander | Guided


@dataclass(frozen=True)
class Task:
    """The motion of one craft, and its place among the `count` craft that share it."""

    motion: AnyMotion
    index: int = 0
    count: int = 1


class Start(NamedTuple):
    """How C craft start: position (C, 3) [m], quaternion (C, 4) wxyz, velocity (C, 3), angular_rate (C, 3) [rad/s]."""

    position: Floats
    quaternion: Floats
    velocity: Floats
    angular_rate: Floats


class Disturbance(NamedTuple):
    """What pushes C craft over one period: acceleration (C, 3) [m/s^2], angular_acceleration (C, 3) [rad/s^2]."""

    acceleration: Floats
    angular_acceleration: Floats


class Fleet:
    """The references of all craft, in the order of the tasks."""

    def __init__(self, tasks: Sequence[Task], seed: int = 0) -> None:
        """Prepare the paths. seed: of what is random. Raises SwarmError where a motion makes no sense."""
        motions = [task.motion for task in tasks]
        attitude = [motion.attitude for motion in motions]
        # A craft's draws go by its number: no other craft changes them.
        rngs = [random.stream(seed, Purpose.WANDER, i) for i in range(len(tasks))]
        every = [_path(task, rng) for task, rng in zip(tasks, rngs, strict=True)]
        self._turns = {
            i: _turn(m, rng) for i, (m, rng) in enumerate(zip(motions, rngs, strict=True)) if isinstance(m, Wander)
        }
        circles = {i: path for i, path in enumerate(every) if isinstance(path, paths.Circle)}
        pieces = {i: path for i, path in enumerate(every) if isinstance(path, paths.Pieces)}
        self._paths: list[tuple[list[int], paths.Path]] = []
        if circles:
            self._paths.append((list(circles), paths.Circles(list(circles.values()))))
        if pieces:
            self._paths.append((list(pieces), paths.Polynomials(list(pieces.values()))))
        self._paths += [([i], path) for i, path in enumerate(every) if isinstance(path, paths.Wandering)]
        self._facing: Bools = np.array([a.facing for a in attitude], dtype=np.bool_)
        angles = np.array([(a.yaw_rad, a.pitch_rad, a.roll_rad) for a in attitude]).reshape(-1, 3, 1)
        x, y, z = (rot.exp(angles[:, i] * np.eye(3)[i]) for i in range(3))
        self._offset = x @ y @ z
        self._offset_angle = angles[..., 0]
        self._spin: Floats = np.array([a.spin_rad_s for a in attitude], dtype=np.float64)
        self._free: Bools = np.array([isinstance(m, Tumble | Drift) for m in motions], dtype=np.bool_)
        self._sigma = np.array(
            [(m.acceleration_m_s2, m.angular_acceleration_rad_s2) if isinstance(m, Drift) else (0, 0) for m in motions]
        ).reshape(-1, 2, 1)
        self.pushed: Bools = np.asarray(self._sigma.any(axis=(1, 2)))
        """(C,): the craft that `disturbance` pushes."""
        self._seed, self._draws = seed, Blocks(BLOCK, self._draw)
        for place in self._paths_at(0.0).position[self._facing]:
            if np.hypot(place[0], place[2]) < LEAST_OFF_AXIS_M:
                raise SwarmError(
                    f"a craft at {place.tolist()} m cannot face the lighthouse: it is beside it, on its y axis; "
                    "move it, or set attitude.facing = false"
                )
        start = self._on_path(0.0, self._facing)
        tumbling = np.array([m.angular_rate_rad_s if isinstance(m, Tumble) else (0, 0, 0) for m in motions])
        self._start_rotation = start.rotation
        self._free_rate = self._spin[:, None] * start.rotation[:, :, 2] + tumbling.reshape(-1, 3)

    def at(self, time_s: float, steered: Steered | None = None) -> Reference:
        """The reference of every craft at `time_s` [s]; steered: of those that guidance wants elsewhere."""
        held = self._on_path(time_s, self._facing & ~self._free, steered)
        if not self._free.any():
            return held
        free = self._free[:, None]
        carried = rot.exp(self._free_rate * time_s) @ self._start_rotation
        return held._replace(
            rotation=np.where(free[..., None], carried, held.rotation),
            angular_rate=np.where(free, self._free_rate, held.angular_rate),
            angular_acceleration=np.where(free, 0.0, held.angular_acceleration),
        )

    def start(self) -> Start:
        """How every craft starts: its reference at time 0."""
        first = self.at(0.0)
        quaternion = rot.quaternion_from_matrix(first.rotation)
        return Start(first.position, quaternion, first.velocity, first.angular_rate)

    def disturbance(self, frame: int) -> Disturbance:
        """What pushes the drifting craft in lighthouse period `frame`; zero for the others.

        White and normal, drawn per craft from the seed alone: no other craft and no order of calls changes a draw.
        """
        drifting = np.flatnonzero(self.pushed)
        draws, place = self._draws.at(frame)
        push = np.zeros((len(self.pushed), 2, 3))
        push[drifting] = self._sigma[drifting] * draws[place]
        return Disturbance(push[:, 0], push[:, 1])

    def _draw(self, block: int) -> Floats:
        """Draw (BLOCK, D, 2, 3) standard normal numbers for the craft that drift."""
        streams = [random.stream(self._seed, Purpose.DRIFT, int(craft), block) for craft in np.flatnonzero(self.pushed)]
        draws = [stream.standard_normal((BLOCK, 2, 3)) for stream in streams]
        return np.stack(draws, axis=1) if draws else np.zeros((BLOCK, 0, 2, 3))

    def _paths_at(self, time_s: float) -> Motion:
        if len(self._paths) == 1:
            return self._paths[0][1].at(time_s)
        out = Motion(*(np.zeros((len(self._free), 3)) for _ in range(3)))
        for craft, path in self._paths:
            for part, of_kind in zip(out, path.at(time_s), strict=True):
                part[craft] = of_kind
        return out

    def _on_path(self, time_s: float, turned: Bools, steered: Steered | None = None) -> Reference:
        """The reference on the paths, with the front towards the lighthouse where `turned`."""
        count = len(self._free)
        position, velocity, acceleration = self._paths_at(time_s)
        holds = ~self._free
        if steered is not None:
            for part, wanted in zip((position, velocity, acceleration), steered.motion, strict=True):
                part[steered.craft] = wanted
            holds[steered.craft] = ~steered.free
        out = Reference(
            position,
            velocity,
            acceleration,
            np.empty((count, 3, 3)),
            np.zeros((count, 3)),
            np.zeros((count, 3)),
            holds,
            holds.copy(),
        )
        if turned.all():
            frame, rate, change = facing(position, velocity, acceleration)
        else:
            frame, rate, change = np.tile(np.eye(3), (count, 1, 1)), out.angular_rate, out.angular_acceleration
            frame[turned], rate[turned], change[turned] = facing(
                position[turned], velocity[turned], acceleration[turned]
            )
        offset = self._offset
        if self._turns:
            offset = offset.copy()
            for craft, tones in self._turns.items():
                own = wander.turn(self._offset_angle[craft], tones, time_s)
                turning = frame[craft] @ own.rate
                change[craft] += frame[craft] @ own.change + np.cross(rate[craft], turning)
                rate[craft] += turning
                offset[craft] = own.rotation
        _turn_into(time_s, frame, rate, change, offset, self._spin, *out[3:6])
        return out


@kernel
def _turn_into(
    time_s: float,
    frame: Floats,
    rate: Floats,
    change: Floats,
    offset: Floats,
    spin: Floats,
    rotation: Floats,
    angular_rate: Floats,
    angular_acceleration: Floats,
) -> None:
    """Turn frames (C, 3, 3), moving at rate and change (C, 3), by offset (C, 3, 3) and by a spin (C,) about body z."""
    for c in range(len(frame)):
        r = rotation[c]
        multiply_into(frame[c], offset[c], r)
        s = spin[c]
        if s != 0.0:
            cosine, sine = np.cos(s * time_s), np.sin(s * time_s)
            for i in range(3):
                x, y = r[i, 0], r[i, 1]
                r[i, 0], r[i, 1] = cosine * x + sine * y, cosine * y - sine * x
        w0, w1, w2 = rate[c, 0], rate[c, 1], rate[c, 2]
        z0, z1, z2 = s * r[0, 2], s * r[1, 2], s * r[2, 2]
        angular_rate[c, 0], angular_rate[c, 1], angular_rate[c, 2] = w0 + z0, w1 + z1, w2 + z2
        # The spin axis is carried round by the frame: d/dt (s z) = w x s z.
        angular_acceleration[c, 0] = change[c, 0] + w1 * z2 - w2 * z1
        angular_acceleration[c, 1] = change[c, 1] + w2 * z0 - w0 * z2
        angular_acceleration[c, 2] = change[c, 2] + w0 * z1 - w1 * z0


def _path(task: Task, rng: np.random.Generator) -> paths.Circle | paths.Pieces | paths.Wandering:
    """The path of one craft; rng: its own random numbers."""
    motion = task.motion
    match motion:
        case Hold():
            return paths.line(_place(motion, task), (0, 0, 0))
        case Guided():
            return paths.line(motion.position_m, motion.velocity_m_s)
        case Tumble() | Drift():
            return paths.line(_place(motion, task), motion.velocity_m_s)
        case Ring():
            phase = 2 * np.pi * task.index / task.count
            return paths.circle(motion.centre_m, motion.radius_m, motion.rate_rad_s, motion.tilt_rad, phase)
        case Waypoints():
            if len(motion.points_m) != len(motion.times_s) or not motion.points_m:
                raise SwarmError(f"waypoints: {len(motion.points_m)} points_m for {len(motion.times_s)} times_s")
            if any(b <= a for a, b in zip(motion.times_s, motion.times_s[1:], strict=False)):
                raise SwarmError(f"waypoints: times_s must increase strictly, got {list(motion.times_s)}")
            return paths.smooth_through(motion.points_m, motion.times_s)
        case Approach():
            if motion.speed_m_s <= 0 or motion.from_m == motion.to_m:
                raise SwarmError("approach: speed_m_s must be positive, and from_m differ from to_m")
            return paths.corridor(motion.from_m, motion.to_m, motion.start_s, motion.speed_m_s)
        case Wander():
            size = np.array(motion.size_m)
            speed = motion.speed_m_s * size / max(float(np.linalg.norm(size)), 1e-12)
            return paths.Wandering(np.array(motion.centre_m), wander.tones(size / 2, speed, motion.bandwidth_hz, rng))


def _turn(motion: Wander, rng: np.random.Generator) -> wander.Tones:
    """How a wandering craft turns: the same share of its rate about each axis."""
    rate = np.full(3, motion.turn_rate_rad_s / np.sqrt(3))
    return wander.tones(np.full(3, motion.turn_rad), rate, motion.bandwidth_hz, rng)


def _place(motion: Hold | Tumble | Drift, task: Task) -> Vector:
    if motion.box_m is None:
        return on_grid(motion.position_m, motion.spacing_m, task.index, task.count)
    return _in_box(motion.position_m, motion.box_m, task.index)


def _in_box(centre_m: Vector, size_m: Vector, index: int) -> Vector:
    """Evenly in a box, by the additive recurrence x_n = (1/2 + n a) mod 1, a = (1/g, 1/g^2, 1/g^3), g^4 = g + 1.

    The R sequence (M. Roberts, 2018): craft 0 in the middle, and no place depends on how many craft there are.
    """
    x, y, z = (
        c + s * ((0.5 + index * FILL**-k) % 1 - 0.5) for k, (c, s) in enumerate(zip(centre_m, size_m, strict=True), 1)
    )
    return x, y, z


def on_grid(centre_m: Vector, spacing_m: float, index: int, count: int) -> Vector:
    """Place `index` of `count` on a square grid perpendicular to z, row by row."""
    side = int(np.ceil(np.sqrt(count)))
    rows = -(-count // side)
    row, column = divmod(index, side)
    x, y, z = centre_m
    return x + (column - (side - 1) / 2) * spacing_m, y + (row - (rows - 1) / 2) * spacing_m, z
