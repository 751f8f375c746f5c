"""References of all craft: the courses of a scenario as smooth functions of time.

Everything is in the lighthouse frame, SI units. The attitude of a craft on its path p(t) is

    R_l_b(t) = F(p(t)) Rx(yaw) Ry(pitch) Rz(roll + spin t)

with F the facing frame of `swarm.world.motion.pointing` (body +z towards the lighthouse), or the identity where
`facing` is off. A wandering craft is turned by three additional random angles (`swarm.world.motion.wander`). The
reference of a free craft is its start, carried on at its initial rates; the craft is not held to it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from estimators.rotation import multiply_into
from estimators.state import Motion, Reference, Steered
from swarm.errors import SwarmError
from swarm.random import Purpose
from swarm.scenario.motions import Course
from swarm.scenario.motions.paths import Wandering
from swarm.scenario.motions.tones import Tones
from swarm.world.motion import wander
from swarm.world.motion.disturbance import Disturbance, Pushes
from swarm.world.motion.paths import grouped
from swarm.world.motion.pointing import facing

LEAST_OFF_AXIS_M = 1e-6
"""Smallest distance from the lighthouse's y axis [m]; nearer to it, facing with down below is undefined."""


class Start(NamedTuple):
    """Initial states of C craft, in the lighthouse frame.

    position: positions, (C, 3) [m].
    quaternion: attitudes, (C, 4) wxyz.
    velocity: velocities, (C, 3) [m/s].
    angular_rate: angular rates, (C, 3) [rad/s].
    """

    position: Floats
    quaternion: Floats
    velocity: Floats
    angular_rate: Floats


class Fleet:
    """The references of all craft, in the order of the courses.

    free: craft that are left to themselves, (C,). push_sigma: 1 sigma per axis of their random pushes, (C, 2) [m/s^2]
    and [rad/s^2].
    """

    def __init__(self, courses: Sequence[Course], seed: int = 0) -> None:
        """Prepare the paths.

        seed: seed of the random pushes. Raises SwarmError where a craft cannot face the lighthouse.
        """
        every = [course.path for course in courses]
        self._paths = grouped(every)
        wanders = ((i, path.turn) for i, path in enumerate(every) if isinstance(path, Wandering))
        turns = {i: turn for i, turn in wanders if turn.amplitude.any()}
        self._turning = np.array(list(turns), dtype=np.int64)
        self._turns = Tones._make(np.array(part) for part in zip(*turns.values(), strict=True)) if turns else None
        self._facing: Bools = np.array([course.facing for course in courses], dtype=np.bool_)
        angles = np.array([course.turn_rad for course in courses]).reshape(-1, 3, 1)
        x, y, z = (rot.exp(angles[:, i] * np.eye(3)[i]) for i in range(3))
        self._offset = x @ y @ z
        self._offset_angle = angles[..., 0]
        self._spin: Floats = np.array([course.spin_rad_s for course in courses], dtype=np.float64)
        self.free: Bools = np.array([course.free for course in courses], dtype=np.bool_)
        self.push_sigma: Floats = np.array([course.push for course in courses], dtype=np.float64)
        self._pushes = Pushes(self.push_sigma, [course.key for course in courses], seed, Purpose.DRIFT)
        for place in self._paths_at(0.0).position[self._facing]:
            if np.hypot(place[0], place[2]) < LEAST_OFF_AXIS_M:
                raise SwarmError(
                    f"a craft at {place.tolist()} m cannot face the lighthouse: it is beside it, on its y axis; "
                    "move it, or set attitude.facing = false"
                )
        start = self._on_path(0.0, self._facing)
        tumbling = np.array([course.rate_rad_s for course in courses], dtype=np.float64)
        self._start_rotation = start.rotation
        self._free_rate = self._spin[:, None] * start.rotation[:, :, 2] + tumbling.reshape(-1, 3)

    def at(self, time_s: float, steered: Steered | None = None) -> Reference:
        """Return the reference of every craft at `time_s` [s].

        steered: motions of the craft whose paths guidance replaces.
        """
        held = self._on_path(time_s, self._facing & ~self.free, steered)
        if not self.free.any():
            return held
        free = self.free[:, None]
        carried = rot.exp(self._free_rate * time_s) @ self._start_rotation
        return held._replace(
            rotation=np.where(free[..., None], carried, held.rotation),
            angular_rate=np.where(free, self._free_rate, held.angular_rate),
            angular_acceleration=np.where(free, 0.0, held.angular_acceleration),
        )

    def start(self) -> Start:
        """Return the initial state of every craft: its reference at time 0."""
        first = self.at(0.0)
        quaternion = rot.quaternion_from_matrix(first.rotation)
        return Start(first.position, quaternion, first.velocity, first.angular_rate)

    @property
    def pushed(self) -> Bools:
        """Craft that `disturbance` pushes, (C,)."""
        return self._pushes.pushed

    def disturbance(self, frame: int) -> Disturbance:
        """Return the accelerations of the drifting craft in lighthouse period `frame`; zero for the others."""
        return self._pushes.at(frame)

    def _paths_at(self, time_s: float) -> Motion:
        if len(self._paths) == 1:
            return self._paths[0][1].at(time_s)
        out = Motion(*np.zeros((3, len(self.free), 3)))
        for craft, paths in self._paths:
            of_kind = paths.at(time_s)
            out.position[craft], out.velocity[craft] = of_kind.position, of_kind.velocity
            out.acceleration[craft] = of_kind.acceleration
        return out

    def _on_path(self, time_s: float, turned: Bools, steered: Steered | None = None) -> Reference:
        """Return the reference on the paths, with the front towards the lighthouse where `turned`."""
        count = len(self.free)
        position, velocity, acceleration = self._paths_at(time_s)
        holds = ~self.free
        if steered is not None:
            wanted = steered.motion
            position[steered.craft], velocity[steered.craft] = wanted.position, wanted.velocity
            acceleration[steered.craft] = wanted.acceleration
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
        if self._turns is not None:
            offset, who = offset.copy(), self._turning
            own = wander.turn(self._offset_angle[who], self._turns, time_s)
            turning = (frame[who] @ own.rate[..., None])[..., 0]
            change[who] += (frame[who] @ own.change[..., None])[..., 0] + np.cross(rate[who], turning)
            rate[who] += turning
            offset[who] = own.rotation
        turned_into = out.rotation, out.angular_rate, out.angular_acceleration
        _turn_into(time_s, frame, rate, change, offset, self._spin, *turned_into)
        if steered is not None and (asked := steered.turning) is not None:
            out.rotation[asked.craft], out.angular_rate[asked.craft] = asked.rotation, asked.angular_rate
            out.angular_acceleration[asked.craft] = 0.0
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
    s, cosine, sine = 0.0, 1.0, 0.0
    for c in range(len(frame)):
        r = rotation[c]
        multiply_into(frame[c], offset[c], r)
        if spin[c] != s:
            s = spin[c]
            cosine, sine = np.cos(s * time_s), np.sin(s * time_s)
        if s != 0.0:
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
