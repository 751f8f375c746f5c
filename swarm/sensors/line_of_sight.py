"""Kernels of the line of sight: the `Sight` of every photodiode, given the owners of solids in each direction.

All tests of a photodiode against its own craft use the body frame, where photodiode, normal and surfaces never move and
the lighthouse stands at o: range, incidence, and whether the plane under the photodiode keeps the ray outside; for four
photodiodes at once.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lanes import LANES, all_of, lane, lanes_in, opposite
from estimators.scratch import scratch
from swarm.sensors.broad_phase import Grid, Placed, met_into
from swarm.sensors.hits import HULL, OTHER, hull_hit, solid_hit
from swarm.sensors.solids import Solids

OUTSIDE, BLOCKED, LIT = 0, 1, 2
"""Values of `swarm.sensors.sight.Sight`."""


class Faces(NamedTuple):
    """Photodiodes of C craft in fours, (C, G, LANES) each, in the body frame.

    point: positions, (C, G, 3, LANES) [m]. normal: (C, G, 3, LANES); NaN behind the last photodiode. plane: plane
    (n, d) of the craft's only hull that each is farthest outside of, (C, G, 4, LANES); NaN for none.
    """

    point: Floats
    normal: Floats
    plane: Floats


def faces(point: Floats, normal: Floats, present: Bools, plane: Floats) -> Faces:
    """Return photodiodes in fours.

    Args:
        point: positions, (C, K, 3) [m].
        normal: normals, (C, K, 3).
        present: photodiodes that are not padding, (C, K).
        plane: planes that most probably keep the whole ray outside of their craft, (C, K, 4); NaN for none.
    """
    more = -present.shape[1] % LANES

    def fours(values: Floats) -> Floats:
        whole = np.pad(values, ((0, 0), (0, more), (0, 0)), constant_values=np.nan)
        rows = whole.reshape(len(values), -1, LANES, values.shape[2]).swapaxes(2, 3)
        return np.ascontiguousarray(rows)

    return Faces(fours(point), fours(np.where(present[..., None], normal, np.nan)), fours(plane))


@kernel
def sight_into(
    faces: Faces,
    near: Bools,
    placed: Placed,
    solids: Solids,
    grid: Grid,
    range_min: float,
    range_max: float,
    least_cosine: float,
    thickness: float,
    likely: Ints,
    radius: Floats,
    others: Ints,
    out: NDArray[np.int8],
    unsure: Ints,
) -> int:
    """Write the sight of every photodiode, and list the rays that MuJoCo must decide about.

    Args:
        faces: the photodiodes, in fours.
        near: craft that the light may reach, (C,); the others are outside.
        placed: owners of the solids, at their poses.
        solids: solids that can block the light.
        grid: owners by direction.
        range_min: shortest range [m].
        range_max: longest range [m].
        least_cosine: cosine of the largest angle of incidence.
        thickness: a surface nearer than the photodiode by less than this does not shade it [m].
        likely: plane of the photodiode's craft that most probably keeps the ray outside, (C, K), see `hull_hit`.
        radius: radii of spheres around the owners' centres in which their shapes and photodiodes are, (C + 1,) [m].
        others: room for the owners that a craft's rays could meet, (C + 1,).
        out: output, the sight of every photodiode, (C, K).
        unsure: output, undecided rays, (n, 3): craft, photodiode, and index of the geom among those of all owners.

    Returns:
        The number of undecided rays; larger than n where they do not fit into `unsure`.
    """
    points, normals, planes = lanes_in(faces.point), lanes_in(faces.normal), lanes_in(faces.plane)
    count, wide = 0, grid.half_width
    d, e = scratch(0.0, 3), scratch(0.0, 3)
    for c in range(out.shape[0]):
        if not near[c]:
            out[c] = OUTSIDE
            continue
        r, o = placed.rotation[c], placed.origin[c]
        own = solids.shape[c]
        met = met_into(c, placed, grid, radius, others)
        for g in range(points.shape[1]):
            p, n, f = points[c, g], normals[c, g], planes[c, g]
            x, y, z = p[0] - o[0], p[1] - o[1], p[2] - o[2]
            distance = np.sqrt(x * x + y * y + z * z)
            facing = -(n[0] * x + n[1] * y + n[2] * z)
            # The same rays in the lighthouse frame.
            qx = r[0, 0] * x + r[0, 1] * y + r[0, 2] * z
            qy = r[1, 0] * x + r[1, 1] * y + r[1, 2] * z
            qz = r[2, 0] * x + r[2, 1] * y + r[2, 2] * z
            inside = (facing >= least_cosine * distance) & (range_min <= distance) & (distance <= range_max)
            inside = inside & (qz > 0) & (abs(qx) <= wide * qz) & (abs(qy) <= wide * qz)
            reach, scale = distance - thickness, 1 / distance
            x, y, z = x * scale, y * scale, z * scale
            height = f[0] * o[0] + f[1] * o[1] + f[2] * o[2] + f[3]
            free = (height > 0) & (height + reach * (f[0] * x + f[1] * y + f[2] * z) >= 0)
            past = min(LANES, out.shape[1] - LANES * g)
            if met == 0 and (own < 0 or all_of(free | opposite(inside))):
                for i in range(past):
                    out[c, LANES * g + i] = LIT if lane(inside, i) else OUTSIDE
                continue
            for i in range(past):
                k = LANES * g + i
                out[c, k] = LIT if lane(inside, i) else OUTSIDE
                if not lane(inside, i):
                    continue
                d[0], d[1], d[2] = lane(x, i), lane(y, i), lane(z, i)
                if own >= 0 and not lane(free, i):
                    count = _meet(c, k, c, o, d, lane(reach, i), solids, likely[c, k], out, unsure, count)
                for m in range(met):
                    if out[c, k] == BLOCKED:
                        break
                    j = others[m]
                    centre, size = placed.centre[j], solids.shape_radius[solids.shape[j]]
                    u, v, w, length = lane(qx, i), lane(qy, i), lane(qz, i), lane(reach, i)
                    along = (u * centre[0] + v * centre[1] + w * centre[2]) * lane(scale, i)
                    square = centre[0] * centre[0] + centre[1] * centre[1] + centre[2] * centre[2]
                    # For a centre beyond an end of the ray, that end is the nearest point.
                    t = min(max(along, 0.0), length)
                    if square - 2 * t * along + t * t <= size * size:
                        s = placed.rotation[j]
                        for a in range(3):
                            e[a] = (s[0, a] * u + s[1, a] * v + s[2, a] * w) * lane(scale, i)
                        count = _meet(c, k, j, placed.origin[j], e, length, solids, -1, out, unsure, count)
    return count


@kernel
def _meet(
    c: int,
    k: int,
    owner: int,
    o: Floats,
    d: Floats,
    reach: float,
    solids: Solids,
    likely: int,
    out: NDArray[np.int8],
    unsure: Ints,
    count: int,
) -> int:
    """Test a ray o, d (3,) against all solids of an owner, in its body frame: darken `out[c, k]` or add to `unsure`."""
    shape = solids.shape[owner]
    first, past = solids.first[shape], solids.first[shape + 1]
    for m in range(first, past):
        if past - first > 1 and _clear(o, d, reach, solids.centre[m], solids.radius[m]):
            continue
        kind = solids.kind[m]
        if kind == HULL:
            start, end = solids.planes[m, 0], solids.planes[m, 1]
            hit = hull_hit(solids.plane, start, end, likely if start <= likely < end else -1, o, d, reach)
        else:
            hit = solid_hit(kind, solids.size[m], solids.position[m], solids.rotation[m], o, d, reach)
        if hit and kind == OTHER:
            if count < len(unsure):
                unsure[count, 0], unsure[count, 1], unsure[count, 2] = c, k, solids.geom[owner] + m - first
            count += 1
        elif hit:
            out[c, k] = BLOCKED
            break
    return count


@kernel
def _clear(o: Floats, d: Floats, reach: float, centre: Floats, radius: float) -> bool:
    """Return whether the ray o + t d, (3,) each, t from 0 to `reach`, stays outside a sphere."""
    x, y, z = centre[0] - o[0], centre[1] - o[1], centre[2] - o[2]
    along = x * d[0] + y * d[1] + z * d[2]
    t = min(max(along, 0.0), reach)
    return bool(x * x + y * y + z * z - 2 * t * along + t * t > radius * radius)
