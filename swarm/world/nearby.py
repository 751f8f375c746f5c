"""Test of whether any two craft could touch within one period; only then does MuJoCo search for contacts.

A sphere around every craft's centre of mass holds all its geoms, whatever its attitude. Without a contact, a constant
force F moves the centre of mass by at most (|v| + |F| T / m) T in a period T, so craft whose spheres, enlarged by that,
do not overlap cannot touch in it; the same holds for a craft and a station. The spheres are sorted into cubes half as
wide again as the largest of them, and each is compared with those in the 27 cubes around it: the time grows with the
number of craft, not its square.

The least gap g between any two of them is found along with it. No two overlap as long as each stays within the sphere
that is larger by g / 2 than it was then.
"""

import mujoco
import numpy as np

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel
from estimators.rotation import quaternion_rows


class Neighbourhood:
    """The spheres of C craft and of S lighthouse stations."""

    def __init__(self, model: mujoco.MjModel, craft_bodies: Ints, station_bodies: Ints) -> None:
        """Compute the spheres' radii.

        Args:
            model: compiled model, with every geom on the body of a craft or of a station.
            craft_bodies: bodies of the craft, (C,).
            station_bodies: bodies of the stations, (S,).
        """
        craft, stations = len(craft_bodies), len(station_bodies)
        owner = np.full(model.nbody, -1, dtype=np.int64)
        owner[craft_bodies], owner[station_bodies] = np.arange(craft), craft + np.arange(stations)
        colliding = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        of = owner[model.geom_bodyid]
        reach = np.zeros(craft + stations)
        # The centre of a geom's bounding sphere is its position; a geom without one (a plane) is unbounded.
        distance = np.linalg.norm(model.geom_pos - model.body_ipos[model.geom_bodyid], axis=1)
        bound = np.where(model.geom_rbound > 0, distance + model.geom_rbound + model.geom_margin, np.inf)
        np.maximum.at(reach, of[colliding], bound[colliding])
        self._radius = reach
        self._mass = model.body_mass[craft_bodies].copy()
        self._com_m = model.body_ipos[craft_bodies].copy()
        self._spheres, self._before = np.empty((craft + stations, 4)), np.full((craft + stations, 4), np.nan)
        self._gap_m = 0.0
        self._station_m = np.empty((stations, 3))
        for place, body in zip(self._station_m, station_bodies, strict=True):
            mujoco.mju_rotVecQuat(place, model.body_ipos[body], model.body_quat[body])
            place += model.body_pos[body]

    def radius(self, craft: int) -> float:
        """Return the radius of the sphere around a craft's centre of mass that holds all its geoms [m]."""
        return float(self._radius[craft])

    def can_touch(self, pose: Floats, rate: Floats, force: Floats, period_s: float) -> bool:
        """Return whether a contact is possible within a period.

        Args:
            pose: MuJoCo's position and quaternion of the craft at the beginning, (C, 7).
            rate: MuJoCo's velocity and body angular rate of the craft at the beginning, (C, 6).
            force: bound on the force on each craft, (C, 3) [N].
            period_s: length of the period [s].
        """
        spheres, craft = self._spheres, len(self._mass)
        spheres[craft:, :3], spheres[craft:, 3] = self._station_m, self._radius[craft:]
        _grow_into(pose, rate, force, self._mass, self._com_m, self._radius, period_s, spheres)
        if not _within(spheres, self._before, self._gap_m / 2):
            self._gap_m = _least_gap(spheres)
            self._before[:] = spheres
        return not self._gap_m > 0


@kernel
def _grow_into(
    pose: Floats, rate: Floats, force: Floats, mass: Floats, com: Floats, radius: Floats, period: float, out: Floats
) -> None:
    """Write centre and radius (C, 4) of the spheres that hold the craft during the period."""
    for c in range(len(pose)):
        # The centre of mass in the body frame, the body rate, and a bound on the speed of the centre of mass.
        a, b, e = com[c, 0], com[c, 1], com[c, 2]
        p, q, r = rate[c, 3], rate[c, 4], rate[c, 5]
        speed = np.sqrt(rate[c, 0] ** 2 + rate[c, 1] ** 2 + rate[c, 2] ** 2)
        speed += np.sqrt((q * e - r * b) ** 2 + (r * a - p * e) ** 2 + (p * b - q * a) ** 2)
        push = np.sqrt(force[c, 0] ** 2 + force[c, 1] ** 2 + force[c, 2] ** 2) / mass[c]
        turn = quaternion_rows(pose[c, 3], pose[c, 4], pose[c, 5], pose[c, 6])
        for i in range(3):
            row = turn[i]
            out[c, i] = pose[c, i] + row[0] * a + row[1] * b + row[2] * e
        out[c, 3] = radius[c] * (1 + 1e-9) + (speed + push * period) * period


@kernel
def _within(sphere: Floats, before: Floats, more: float) -> bool:
    """Return whether each sphere (N, 4), centre and radius, is within the one before, enlarged by `more` [m]."""
    for i in range(len(sphere)):
        x, y, z = sphere[i, 0] - before[i, 0], sphere[i, 1] - before[i, 1], sphere[i, 2] - before[i, 2]
        left = more - (sphere[i, 3] - before[i, 3])
        if not (left > 0 and x * x + y * y + z * z < left * left):
            return False
    return True


@kernel
def _least_gap(sphere: Floats) -> float:
    """Return the least gap between any two of the spheres (N, 4), centre and radius [m].

    Where two overlap, it is that of any such two, not above zero; where a number is not finite, NaN. Gaps beyond the
    largest radius are not looked for.
    """
    count = len(sphere)
    widest, farthest = 0.0, 0.0
    for i in range(count):
        for k in range(4):
            if not np.isfinite(sphere[i, k]):
                return np.nan
        widest = max(widest, sphere[i, 3])
        farthest = max(farthest, max(abs(sphere[i, 0]), max(abs(sphere[i, 1]), abs(sphere[i, 2]))))
    # The lower limit keeps the cubes' integer indices in range where the spheres are nearly points.
    side = max(3 * widest, farthest * 1e-6 + 1e-9)
    gap: float = side - 2 * widest
    size = 1
    while size < 2 * count:
        size *= 2
    head, following = np.empty(size, np.int64), np.empty(count, np.int64)
    for i in range(size):
        head[i] = -1
    for i in range(count):
        x, y = int(np.floor(sphere[i, 0] / side)), int(np.floor(sphere[i, 1] / side))
        z = int(np.floor(sphere[i, 2] / side))
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dz in range(-1, 2):
                    j = head[_slot(x + dx, y + dy, z + dz, size)]
                    while j >= 0:
                        square = 0.0
                        for k in range(3):
                            square += (sphere[i, k] - sphere[j, k]) ** 2
                        gap = min(gap, np.sqrt(square) - (sphere[i, 3] + sphere[j, 3]))
                        if gap <= 0:
                            return gap
                        j = following[j]
        slot = _slot(x, y, z, size)
        following[i] = head[slot]
        head[slot] = i
    return gap


@kernel
def _slot(x: int, y: int, z: int, size: int) -> int:
    """Return the slot of a cube in a hash table of `size`, a power of two; cubes may share a slot."""
    return (x * 73856093 ^ y * 19349663 ^ z * 83492791) & (size - 1)
