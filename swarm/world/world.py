"""MuJoCo's truth: C free craft in front of one lighthouse, without gravity, with real contacts.

MuJoCo's world frame is the lighthouse frame `l`: the lighthouse sits at the origin, looks along +z. Every craft is one
rigid body with a free joint. A step h of MuJoCo's `implicitfast` integrator is

    v' = v + h a(v'),   p' = p + h v',   R' = Exp([h w']x) R

so the motion between two knots is a straight line and a constant-rate rotation, both at the rates of the LATER knot.
A craft's position and velocity are those of the origin of its body frame, by convention its centre of mass.
In an orbit the frame turns with the station, and gravity and this rotation accelerate every craft
(`swarm.world.orbit`). Attitudes are relative to this frame; its own angular rate (n = 1e-3 rad/s) does not act on the
craft's rotation.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial import cKDTree

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.relative_orbit import RelativeOrbit
from estimators.rotation import matrix_from_quaternion, quaternion_rows
from estimators.state import State
from swarm import hardware as layout
from swarm.errors import SwarmError
from swarm.world import docking
from swarm.world.assembly import LIGHTHOUSE, Placement, Standing, assemble, at_origin
from swarm.world.craft import Visual, load_craft, quiet
from swarm.world.nearby import Neighbourhood
from swarm.world.orbit import NO_ORBIT, orbit_step, velocity_before
from swarm.world.wrench import OnboardWrench, constant_into, most_force, wrench_into

LARGEST = 1e6
"""Limit of a coordinate [m], velocity [m/s] or rate [rad/s]; beyond it the simulation counts as unstable."""
CROWD = 64
"""Craft from which on the nearest two are tried alone first: MuJoCo takes memory for all contacts of a crowd."""
LARGE_CRAFT_M = 50.0
"""Size above which a craft was probably drawn in millimetres [m]."""

NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)


class CraftStart(NamedTuple):
    """One craft at time 0, in the lighthouse frame.

    name: name of the craft.
    model: path of its model file.
    position: position, (3,) [m].
    quaternion: attitude, (4,) wxyz.
    velocity: velocity, (3,) [m/s].
    angular_rate: angular rate, (3,) [rad/s].
    passive: True for a craft without working photodiodes; those in its model file are left out.
    """

    name: str
    model: Path
    position: Floats
    quaternion: Floats
    velocity: Floats
    angular_rate: Floats
    passive: bool = False


class PeriodTruth(NamedTuple):
    """The true motion over one lighthouse period, at n + 1 knots from t_k to t_k + T, in the lighthouse frame.

    The rates at a knot are those of the interval that ends there. The intervals are physics steps, or halves of them
    where their number is no multiple of four.

    time_s: times of the knots, (n + 1,) [s].
    position: positions, (n + 1, C, 3) [m].
    quaternion: attitudes, (n + 1, C, 4) wxyz.
    velocity: velocities, (n + 1, C, 3) [m/s].
    angular_rate: angular rates, (n + 1, C, 3) [rad/s].
    contact: craft that touched something during the period, (C,).
    """

    time_s: Floats
    position: Floats
    quaternion: Floats
    velocity: Floats
    angular_rate: Floats
    contact: Bools

    @property
    def epoch(self) -> int:
        """Index of the knot in the middle of the period."""
        return len(self.time_s) // 2

    @property
    def mid_sweep(self) -> tuple[int, int]:
        """Indices of the knots in the middle of the two sweeps, X then Y."""
        steps = len(self.time_s) - 1
        return steps // 4, 3 * steps // 4

    def state(self, knot: int) -> State:
        """Return the state of all craft at one knot."""
        return State(
            rotation=matrix_from_quaternion(self.quaternion[knot]),
            position=self.position[knot],
            velocity=self.velocity[knot],
            angular_rate=self.angular_rate[knot],
        )


class World:
    """The only holder of MuJoCo's state. Arrays over craft are in the order of the `CraftStart` records.

    steps: physics steps in a period.
    """

    def __init__(
        self,
        craft: Sequence[CraftStart],
        lighthouse: Path,
        rate_hz: float = 60.0,
        steps_per_period: int = 8,
        orbit: RelativeOrbit | None = None,
        latches: Sequence[tuple[int, int]] = (),
        stations: Sequence[Standing] | None = None,
    ) -> None:
        """Build the world.

        Args:
            craft: the craft and their states at time 0.
            lighthouse: path of the lighthouse's model file.
            rate_hz: rate of the lighthouse periods [Hz].
            steps_per_period: number of physics steps per period, even.
            orbit: the station's orbit; None: weightless space.
            latches: pairs of craft, by index, that `latch` can hold together.
            stations: lighthouse stations that stay where they are; None: the lighthouse at the origin.

        Raises:
            SwarmError: Two craft have the same name, `load_craft` refuses a model, or a craft starts inside another
                one or inside a lighthouse.
        """
        self.names = tuple(start.name for start in craft)
        _check_names(self.names)
        self._models = tuple(load_craft(start.model, start.passive) for start in craft)
        self.steps, self._rate_hz, self._frame = steps_per_period, rate_hz, 0
        position = _table([start.position for start in craft], 3)
        quaternion = _table([start.quaternion for start in craft], 4)
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        standing = [at_origin(lighthouse)] if stations is None else list(stations)
        _check_nearest(craft, position, lighthouse, standing)
        velocity, rate = _table([s.velocity for s in craft], 3), _table([s.angular_rate for s in craft], 3)
        timestep_s = 1 / (rate_hz * steps_per_period)
        self._orbit = NO_ORBIT if orbit is None else orbit_step(orbit, timestep_s)
        placements = [
            Placement(name, model.spec, model.file_pose, position[i], quaternion[i])
            for i, (name, model) in enumerate(zip(self.names, self._models, strict=True))
        ]
        self.model = assemble(placements, standing, timestep_s, latches)
        self._data = mujoco.MjData(self.model)

        self._number_bodies(standing)
        self._neighbourhood = Neighbourhood(self.model, self.craft_bodies, self.station_bodies)
        # All joints are free joints, attached in order: qpos is a table of seven columns, qvel one of six.
        self._pose = self._data.qpos.reshape(-1, 7)
        self._rate = self._data.qvel.reshape(-1, 6)
        self._joint_forces = self._data.qfrc_applied.reshape(-1, 6)
        self._pose[:] = np.concatenate([position, quaternion], axis=1)
        # MuJoCo keeps a free joint's angular rate in the body frame.
        body_rate = (np.swapaxes(matrix_from_quaternion(quaternion), -1, -2) @ rate[..., None])[..., 0]
        self._rate[:] = np.concatenate([velocity, body_rate], axis=1)
        if orbit is not None:
            self._begin_in_orbit(orbit, timestep_s)

        self._read_models(craft)
        self._check_overlap()

    def _number_bodies(self, stations: Sequence[Standing]) -> None:
        """Find the bodies of the stations, which come first, and those of the craft, each in their order."""
        self.stations = tuple(station.name for station in stations)
        roots = np.flatnonzero(self.model.body_parentid[1:] == 0) + 1
        self.station_bodies: Ints = roots[: len(stations)].astype(np.int64)
        self.lighthouse_body = int(self.station_bodies[0]) if len(stations) else -1
        self.craft_bodies: Ints = self.model.jnt_bodyid.astype(np.int64)
        self._craft_of_geom = np.searchsorted(self.craft_bodies, self.model.geom_bodyid)
        for i, body in enumerate(self.station_bodies):
            self._craft_of_geom[self.model.geom_bodyid == body] = -1 - i

    def _read_models(self, craft: Sequence[CraftStart]) -> None:
        """Set the properties of the craft and of what is mounted on them."""
        self.mass: Floats = np.array([model.mass for model in self._models])
        self.com_m: Floats = np.array([model.com_m for model in self._models]).reshape(-1, 3)
        self.inertia: Floats = np.array([model.inertia for model in self._models]).reshape(-1, 3, 3)
        alive = [0 if start.passive else None for start in craft]
        self.photodiodes = layout.pad(
            [m.point_m[:n] for m, n in zip(self._models, alive, strict=True)],
            [m.normal[:n] for m, n in zip(self._models, alive, strict=True)],
        )
        self.lidars = tuple(model.lidar for model in self._models)
        self.cameras = tuple(model.cameras for model in self._models)
        self.lights = tuple(model.lights for model in self._models)
        self.thrusters = tuple(model.thrusters for model in self._models)
        self.wheels = tuple(model.wheels for model in self._models)
        self.ports = tuple(model.port for model in self._models)

    def visuals(self, craft: int) -> tuple[Visual, ...]:
        """Return the drawn parts of a craft, in its body frame; the same object for every craft of one model."""
        return self._models[craft].visuals

    def advance(self, force: Floats, torque: Floats, onboard: OnboardWrench | None = None) -> PeriodTruth:
        """Advance the world by one lighthouse period under a constant wrench on every craft.

        Args:
            force: force through the centre of mass, (C, 3) [N], lighthouse frame.
            torque: torque about the centre of mass, (C, 3) [N m], lighthouse frame.
            onboard: wrench of the craft's actuators, which turns with the craft.

        Raises:
            SwarmError: The wrench is not finite or the simulation is unstable; the message gives craft and time.
        """
        count, steps = len(self.names), self.steps
        pose, rate = np.empty((steps + 1, count, 7)), np.empty((steps + 1, count, 6))
        contact = np.zeros(count, dtype=np.bool_)
        pose[0], rate[0] = self._pose, self._rate
        if not (np.isfinite(force).all() and np.isfinite(torque).all()):
            who = self.names[int(np.argmin(np.isfinite(force).all(axis=1) & np.isfinite(torque).all(axis=1)))]
            raise SwarmError(f"craft {who!r}: force or torque is not finite at {self._frame / self._rate_hz:.4f} s")
        n, period_s = self._orbit.n, 1 / self._rate_hz
        most = force
        if onboard is not None or n:
            most = most_force(self._pose, self._rate, self.mass, self.com_m, force, onboard, n, period_s)
        self._look_for_contacts(self._neighbourhood.can_touch(self._pose, self._rate, most, period_s))
        if onboard is None and n:
            onboard = OnboardWrench(*np.zeros((3, steps, count, 3)))
        with quiet():
            for step in range(1, steps + 1):
                if onboard is None:
                    constant_into(self._pose, self.com_m, force, torque, self._joint_forces)
                else:
                    self._apply(force, torque, onboard, step - 1)
                mujoco.mj_step(self.model, self._data)
                pose[step], rate[step] = self._pose, self._rate
                if self._data.ncon:
                    contact[self._touching()] = True
        knots = steps if steps % 4 == 0 else 2 * steps
        time_s = (self._frame + np.arange(knots + 1) / knots) / self._rate_hz
        self._frame += 1
        position, velocity, angular_rate = np.empty((3, knots + 1, count, 3))
        quaternion = np.empty((knots + 1, count, 4))
        stable = _unpack_into(pose, rate, LARGEST, position, quaternion, velocity, angular_rate)
        if not stable or self._data.warning.number.any():
            self._report_instability(pose, rate, time_s[:: knots // steps])
        return PeriodTruth(time_s, position, quaternion, velocity, angular_rate, contact)

    def latch(self, number: int) -> None:
        """Close a latch, by its index: from now on its two craft keep their present relative pose."""
        docking.close(self.model, self._data, number)

    def inertial_wrench(self, acceleration: Floats, angular_acceleration: Floats) -> tuple[Floats, Floats]:
        """Return the force (C, 3) [N] and torque (C, 3) [N m] that give every craft these accelerations now.

        acceleration: (C, 3) [m/s^2] of the body frame's origin; angular_acceleration: (C, 3) [rad/s^2]; lighthouse
        frame. F = m a, M = I alpha + w x I w: the rate in the lighthouse frame then changes by alpha T.
        """
        rotation = matrix_from_quaternion(self._pose[:, 3:])
        rate = (rotation @ self._rate[:, 3:, None])[..., 0]
        arm = (rotation @ self.com_m[..., None])[..., 0]
        inertia = rotation @ self.inertia @ np.swapaxes(rotation, -1, -2)
        force = self.mass[:, None] * (
            acceleration + np.cross(angular_acceleration, arm) + np.cross(rate, np.cross(rate, arm))
        )
        momentum = (inertia @ rate[..., None])[..., 0]
        torque = (inertia @ angular_acceleration[..., None])[..., 0] + np.cross(rate, momentum)
        return force, torque

    def _apply(self, force: Floats, torque: Floats, onboard: OnboardWrench, step: int) -> None:
        """Set the wrench of one step: constant, from the orbit, and from the actuators."""
        wrench_into(
            self._pose,
            self._rate,
            self.com_m,
            self.mass,
            force,
            torque,
            onboard.force[step],
            onboard.torque[step],
            onboard.wheel_momentum[step],
            *self._orbit,
            self._joint_forces,
        )

    def _begin_in_orbit(self, orbit: RelativeOrbit, timestep_s: float) -> None:
        """Replace the velocities by those with which MuJoCo's steps begin (`swarm.world.orbit`)."""
        rotation = matrix_from_quaternion(self._pose[:, 3:])
        com = np.array([model.com_m for model in self._models]).reshape(-1, 3)
        arm = (rotation @ com[..., None])[..., 0]
        spin = (rotation @ self._rate[:, 3:, None])[..., 0]
        velocity = self._rate[:, :3] + np.cross(spin, arm)
        before = velocity_before(orbit, self._pose[:, :3] + arm, velocity, timestep_s)
        self._rate[:, :3] += before - velocity

    def _look_for_contacts(self, wanted: bool) -> None:
        """Switch MuJoCo's search for contacts on, or off where no contact is possible."""
        flags = int(self.model.opt.disableflags)
        self.model.opt.disableflags = flags & ~NO_CONTACT if wanted else flags | NO_CONTACT

    def _touching(self) -> Ints:
        contact = self._data.contact
        craft = self._craft_of_geom[contact.geom[contact.dist < 0].ravel()]
        touching: Ints = craft[craft >= 0]
        return touching

    def _check_overlap(self) -> None:
        with quiet():
            mujoco.mj_forward(self.model, self._data)
        contact = self._data.contact
        if not self._data.ncon or contact.dist.min() >= 0:
            return
        worst = int(np.argmin(contact.dist))
        one, other = sorted(self._craft_of_geom[contact.geom[worst]], reverse=True)
        depth = -1e3 * float(contact.dist[worst])
        where = f"inside craft {self.names[other]!r}" if other >= 0 else self._inside(-1 - int(other))
        size = 2 * max(self._neighbourhood.radius(one), self._neighbourhood.radius(other) if other >= 0 else 0.0)
        unit = f" (a model is {size:.0f} m across: lengths in MJCF are metres)" if size > LARGE_CRAFT_M else ""
        raise SwarmError(
            f"craft {self.names[one]!r} starts {where}: they overlap by {depth:.1f} mm; move them apart{unit}"
        )

    def _inside(self, station: int) -> str:
        name = self.stations[station]
        return "inside the lighthouse" if name == LIGHTHOUSE else f"inside station {name!r}"

    def _report_instability(self, pose: Floats, rate: Floats, time_s: Floats) -> None:
        state = np.concatenate([pose, rate], axis=2)
        good = (np.abs(state) < LARGEST).all(axis=2)
        if not good.all():
            step = int(np.argmin(good.all(axis=1)))
            who = ", ".join(repr(self.names[i]) for i in np.flatnonzero(~good[step])[:3])
            raise SwarmError(
                f"craft {who}: the simulation became unstable at {time_s[step]:.4f} s; more physics.steps_per_period, "
                "or a gentler motion, may help"
            )
        which = int(np.flatnonzero(self._data.warning.number)[0])
        raise SwarmError(f"MuJoCo: {mujoco.mju_warningText(which, 0)} at {time_s[-1]:.4f} s")


@kernel
def _unpack_into(
    pose: Floats,
    rate: Floats,
    largest: float,
    position: Floats,
    quaternion: Floats,
    velocity: Floats,
    angular_rate: Floats,
) -> bool:
    """Write MuJoCo's pose (n + 1, C, 7) and rate (n + 1, C, 6) as arrays (m + 1, C, 3) and (m + 1, C, 4), m = n or 2 n.

    Knots between are in the middle of a step, where the rate is the step's: the sum of two quaternions halves the turn
    between them. The angular rate is turned from the body into the lighthouse frame. Returns False where a number
    reaches `largest`.
    """
    good, parts = True, (len(position) - 1) // (len(pose) - 1)
    for n in range(len(position)):
        before, after = n // parts, (n + parts - 1) // parts
        for c in range(pose.shape[1]):
            p, q, v = pose[before, c], pose[after, c], rate[after, c]
            if before == after:
                for i in range(7):
                    good &= abs(q[i]) < largest
                for i in range(6):
                    good &= abs(v[i]) < largest
            w, x, y, z = q[3], q[4], q[5], q[6]
            if before < after:
                w, x, y, z = p[3] + w, p[4] + x, p[5] + y, p[6] + z
                scale = 2 / np.sqrt(w * w + x * x + y * y + z * z)
                w, x, y, z = w * scale / 2, x * scale / 2, y * scale / 2, z * scale / 2
            quaternion[n, c, 0], quaternion[n, c, 1], quaternion[n, c, 2], quaternion[n, c, 3] = w, x, y, z
            turn = quaternion_rows(w, x, y, z)
            for i in range(3):
                row = turn[i]
                position[n, c, i], velocity[n, c, i] = q[i] if before == after else (p[i] + q[i]) / 2, v[i]
                angular_rate[n, c, i] = row[0] * v[3] + row[1] * v[4] + row[2] * v[5]
    return good


def _check_names(names: tuple[str, ...]) -> None:
    seen = {LIGHTHOUSE}
    for name in names:
        if name in seen:
            raise SwarmError(f"two things are named {name!r}: give every craft a name of its own")
        seen.add(name)


def _check_nearest(
    craft: Sequence[CraftStart], position: Floats, lighthouse: Path, stations: Sequence[Standing]
) -> None:
    """Raise SwarmError where the two craft of a crowd, at positions (C, 3) [m], that are nearest overlap."""
    if len(craft) <= CROWD:
        return
    distance, index = cKDTree(position).query(position, k=2)
    one = int(np.argmin(distance[:, 1]))
    # Of craft in one place, either may be the first of its own neighbours.
    other = int(index[one, 0]) if index[one, 0] != one else int(index[one, 1])
    World([craft[i] for i in sorted((one, other))], lighthouse, stations=stations)


def _table(rows: list[Floats], columns: int) -> Floats:
    return np.array(rows, dtype=np.float64).reshape(-1, columns)
