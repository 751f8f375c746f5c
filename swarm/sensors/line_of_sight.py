"""Kernels of the line of sight: the `Sight` of every photodiode, given the owners of solids in each direction.

All tests of a photodiode against its own craft use the body frame, where photodiode, normal and surfaces never move and
the lighthouse stands at o: range, incidence, and whether the plane under the photodiode keeps the ray outside. WIDE
photodiodes are looked at side by side.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import inlined, kernel
from estimators.lanes import WIDE, alike, all_of, any_of, lane, opposite, select, wide_in, with_lane
from estimators.rotation import Row
from estimators.scratch import scratch
from swarm.sensors.broad_phase import Met, Placed
from swarm.sensors.hits import HULL, OTHER, hull_hit, solid_hit
from swarm.sensors.solids import Solids

OUTSIDE, BLOCKED, LIT = 0, 1, 2
"""Values of `swarm.sensors.sight.Sight`."""


class Faces(NamedTuple):
    """Photodiodes of C craft, WIDE side by side, in the body frame.

    point: positions, (C, G, 3, WIDE) [m]. normal: (C, G, 3, WIDE); NaN behind the last photodiode. plane: plane (n, d)
    of the craft's only hull that each is farthest outside of, (C, G, 4, WIDE); NaN for none.
    """

    point: Floats
    normal: Floats
    plane: Floats


class Light(NamedTuple):
    """Limits of the light.

    half_width: half width of the field on the plane z = 1. range_min, range_max: shortest and longest range [m].
    least_cosine: cosine of the largest angle of incidence. thickness: a surface nearer than the photodiode by less than
    this does not shade it [m].
    """

    half_width: float
    range_min: float
    range_max: float
    least_cosine: float
    thickness: float


class _Rays(NamedTuple):
    """Rays from the lighthouse to WIDE photodiodes of a craft, in lanes, in the frame of one body.

    o: the lighthouse, (3,) [m]. d: unit directions. reach: lengths [m]. open: rays that nothing blocks so far.
    """

    o: Floats
    d: Row
    reach: float
    open: bool


def faces(point: Floats, normal: Floats, present: Bools, plane: Floats) -> Faces:
    """Return photodiodes side by side.

    Args:
        point: positions, (C, K, 3) [m].
        normal: normals, (C, K, 3).
        present: photodiodes that are not padding, (C, K).
        plane: planes that most probably keep the whole ray outside of their craft, (C, K, 4); NaN for none.
    """
    more = -present.shape[1] % WIDE

    def wide(values: Floats) -> Floats:
        whole = np.pad(values, ((0, 0), (0, more), (0, 0)), constant_values=np.nan)
        rows = whole.reshape(len(values), -1, WIDE, values.shape[2]).swapaxes(2, 3)
        return np.ascontiguousarray(rows)

    return Faces(wide(point), wide(np.where(present[..., None], normal, np.nan)), wide(plane))


@kernel
def sight_into(
    faces: Faces,
    near: Bools,
    placed: Placed,
    solids: Solids,
    met: Met,
    light: Light,
    room: Floats,
    look: int,
    out: NDArray[np.int8],
    unsure: Ints,
) -> int:
    """Write the sight of every photodiode, and list the rays that MuJoCo must decide about.

    Args:
        faces: the photodiodes.
        near: craft that the light may reach, (C,); the others are outside.
        placed: owners of the solids, at their poses.
        solids: solids that can block the light.
        met: owners that the rays to each craft could meet.
        light: limits of the light.
        room: room for numbers side by side, (1, WIDE).
        look: the column of `out` that is written.
        out: output, the sight of every photodiode, (C, K, L).
        unsure: output, undecided rays, (n, 3): craft, photodiode, and index of the geom among those of all owners.

    Returns:
        The number of undecided rays; larger than n where they do not fit into `unsure`.
    """
    points, normals, planes, values = wide_in(faces.point), wide_in(faces.normal), wide_in(faces.plane), wide_in(room)
    count, half = 0, light.half_width
    for c in range(out.shape[0]):
        if not near[c]:
            for k in range(out.shape[1]):
                out[c, k, look] = OUTSIDE
            continue
        r, o = placed.rotation[c], placed.origin[c]
        for g in range(points.shape[1]):
            p, n, f = points[c, g], normals[c, g], planes[c, g]
            x, y, z = p[0] - o[0], p[1] - o[1], p[2] - o[2]
            distance = np.sqrt(x * x + y * y + z * z)
            facing = -(n[0] * x + n[1] * y + n[2] * z)
            # The same rays in the lighthouse frame.
            u = r[0, 0] * x + r[0, 1] * y + r[0, 2] * z
            v = r[1, 0] * x + r[1, 1] * y + r[1, 2] * z
            w = r[2, 0] * x + r[2, 1] * y + r[2, 2] * z
            inside = (facing >= light.least_cosine * distance) & (light.range_min <= distance)
            inside = inside & (distance <= light.range_max)
            inside = inside & (w > 0) & (abs(u) <= half * w) & (abs(v) <= half * w)
            reach, scale, rays = distance - light.thickness, 1 / distance, inside
            if solids.shape[c] >= 0:
                x, y, z = x * scale, y * scale, z * scale
                height = f[0] * o[0] + f[1] * o[1] + f[2] * o[2] + f[3]
                free = (height > 0) & (height + reach * (f[0] * x + f[1] * y + f[2] * z) >= 0)
                if not all_of(free | opposite(inside)):
                    own = _Rays(o, (x, y, z), reach, inside & opposite(free))
                    left, count = _pass(c, WIDE * g, c, own, solids, unsure, count)
                    rays = inside & (free | left)
            for m in range(met.first[c], met.first[c + 1]):
                j = met.owner[m]
                centre, size = placed.centre[j], solids.shape_radius[solids.shape[j]]
                along = (u * centre[0] + v * centre[1] + w * centre[2]) * scale
                near_by = rays & opposite(_clear(centre, along, reach, size))
                if any_of(near_by):
                    s = placed.rotation[j]
                    d = (
                        (s[0, 0] * u + s[1, 0] * v + s[2, 0] * w) * scale,
                        (s[0, 1] * u + s[1, 1] * v + s[2, 1] * w) * scale,
                        (s[0, 2] * u + s[1, 2] * v + s[2, 2] * w) * scale,
                    )
                    left, count = _pass(
                        c, WIDE * g, j, _Rays(placed.origin[j], d, reach, near_by), solids, unsure, count
                    )
                    rays = rays & (left | opposite(near_by))
                    if not any_of(rays):
                        break
            values[0] = select(rays, float(LIT), select(inside, float(BLOCKED), float(OUTSIDE)))
            for i in range(min(WIDE, out.shape[1] - WIDE * g)):
                out[c, WIDE * g + i, look] = int(room[0, i])
    return count


@inlined
def _pass(c: int, k: int, owner: int, rays: _Rays, solids: Solids, unsure: Ints, count: int) -> tuple[bool, int]:
    """Return which open rays pass all solids of an owner, in its body frame, and how many rays are `unsure` then.

    c, k: the craft, and the photodiode of the first lane.
    """
    o, d, reach, left = rays.o, rays.d, rays.reach, rays.open
    shape = solids.shape[owner]
    first, past = solids.first[shape], solids.first[shape + 1]
    for m in range(first, past):
        asked = left
        if past - first > 1:
            centre = solids.centre[m]
            x, y, z = centre[0] - o[0], centre[1] - o[1], centre[2] - o[2]
            asked = left & opposite(_clear((x, y, z), x * d[0] + y * d[1] + z * d[2], reach, solids.radius[m]))
            if not any_of(asked):
                continue
        if solids.kind[m] == HULL:
            left = left & opposite(hull_hit(solids.plane, solids.planes[m, 0], solids.planes[m, 1], o, d, reach, asked))
        else:
            blocked, count = _ask_one_by_one(c, k, owner, m, asked, rays, solids, unsure, count)
            left = left & opposite(blocked)
        if not any_of(left):
            break
    return left, count


@kernel
def _ask_one_by_one(
    c: int, k: int, owner: int, m: int, asked: bool, rays: _Rays, solids: Solids, unsure: Ints, count: int
) -> tuple[bool, int]:
    """Return which rays a solid that is no hull blocks, and how many are `unsure` then."""
    d, blocked = scratch(0.0, 3), alike(rays.reach, 0.0)
    for i in range(WIDE):
        if not lane(asked, i):
            continue
        d[0], d[1], d[2] = lane(rays.d[0], i), lane(rays.d[1], i), lane(rays.d[2], i)
        kind = solids.kind[m]
        if not solid_hit(kind, solids.size[m], solids.position[m], solids.rotation[m], rays.o, d, lane(rays.reach, i)):
            continue
        if kind == OTHER:
            if count < len(unsure):
                geom = solids.geom[owner] + m - solids.first[solids.shape[owner]]
                unsure[count, 0], unsure[count, 1], unsure[count, 2] = c, k + i, geom
            count += 1
        else:
            blocked = with_lane(blocked, i, 1.0)
    return blocked > 0, count


@inlined
def _clear(centre: Floats | Row, along: float, reach: float, radius: float) -> bool:
    """Return which rays stay outside a sphere, whose centre is so far along each of them."""
    square = centre[0] * centre[0] + centre[1] * centre[1] + centre[2] * centre[2]
    # For a centre beyond an end of the ray, that end is the nearest point.
    t = min(max(along, 0.0), reach)
    return square - 2 * t * along + t * t > radius * radius
