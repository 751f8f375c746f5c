"""Kernels of the line of sight: the `Sight` of every photodiode, given the owners of solids in each direction.

All tests of a photodiode against its own craft use the body frame, where photodiode, normal and surfaces never move and
the lighthouse stands at o: range, incidence, and whether the plane under the photodiode keeps the ray outside.
"""

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from swarm.sensors.broad_phase import Grid, Placed, cell_of
from swarm.sensors.hits import HULL, OTHER, hull_hit, solid_hit
from swarm.sensors.solids import Solids

OUTSIDE, BLOCKED, LIT = 0, 1, 2
"""Values of `swarm.sensors.sight.Sight`."""


@kernel
def sight_into(
    point: Floats,
    normal: Floats,
    present: Bools,
    near: Bools,
    placed: Placed,
    solids: Solids,
    grid: Grid,
    range_min: float,
    range_max: float,
    least_cosine: float,
    thickness: float,
    likely: Ints,
    out: NDArray[np.int8],
    unsure: Ints,
) -> int:
    """Write the sight of every photodiode, and list the rays that MuJoCo must decide about.

    Args:
        point: positions of the photodiodes, (C, K, 3) [m], body frame.
        normal: normals of the photodiodes, (C, K, 3), body frame.
        present: photodiodes that are not padding, (C, K).
        near: craft that the light may reach, (C,); the others are outside.
        placed: owners of the solids, at their poses.
        solids: solids that can block the light.
        grid: owners by direction.
        range_min: shortest range [m].
        range_max: longest range [m].
        least_cosine: cosine of the largest angle of incidence.
        thickness: a surface nearer than the photodiode by less than this does not shade it [m].
        likely: plane of the photodiode's craft that most probably keeps the ray outside, (C, K), see `hull_hit`.
        out: output, the sight of every photodiode, (C, K).
        unsure: output, undecided rays, (n, 3): craft, photodiode, and index of the geom among those of all owners.

    Returns:
        The number of undecided rays; larger than n where they do not fit into `unsure`.
    """
    count = 0
    d, e = np.empty(3), np.empty(3)
    for c in range(present.shape[0]):
        if not near[c]:
            out[c] = OUTSIDE
            continue
        r, o = placed.rotation[c], placed.origin[c]
        o0, o1, o2 = o[0], o[1], o[2]
        own = solids.shape[c]
        simple = own >= 0 and solids.first[own + 1] - solids.first[own] == 1
        for k in range(present.shape[1]):
            out[c, k] = OUTSIDE
            if not present[c, k]:
                continue
            x, y, z = point[c, k, 0] - o0, point[c, k, 1] - o1, point[c, k, 2] - o2
            distance = np.sqrt(x * x + y * y + z * z)
            facing = -(normal[c, k, 0] * x + normal[c, k, 1] * y + normal[c, k, 2] * z)
            if not (facing >= least_cosine * distance and range_min <= distance <= range_max):
                continue
            # The same ray in the lighthouse frame.
            qx = r[0, 0] * x + r[0, 1] * y + r[0, 2] * z
            qy = r[1, 0] * x + r[1, 1] * y + r[1, 2] * z
            qz = r[2, 0] * x + r[2, 1] * y + r[2, 2] * z
            if not (qz > 0 and abs(qx) <= grid.half_width * qz and abs(qy) <= grid.half_width * qz):
                continue
            out[c, k] = LIT
            reach, scale = distance - thickness, 1 / distance
            d[0], d[1], d[2] = x * scale, y * scale, z * scale
            free = False
            if simple and likely[c, k] >= 0:
                n = solids.plane[likely[c, k]]
                height = n[0] * o0 + n[1] * o1 + n[2] * o2 + n[3]
                free = height > 0 and height + reach * (n[0] * d[0] + n[1] * d[1] + n[2] * d[2]) >= 0
            column = cell_of(qx / qz, grid.side, grid.half_width) * grid.side
            cell = column + cell_of(qy / qz, grid.side, grid.half_width)
            for i in range(grid.start[cell], grid.start[cell + 1]):
                j = grid.owner[i]
                if j == c:
                    if not free:
                        count = _meet(c, k, c, o, d, reach, solids, likely[c, k], out, unsure, count)
                else:
                    centre, radius = placed.centre[j], solids.shape_radius[solids.shape[j]]
                    along = (qx * centre[0] + qy * centre[1] + qz * centre[2]) * scale
                    square = centre[0] * centre[0] + centre[1] * centre[1] + centre[2] * centre[2]
                    # For a centre beyond an end of the ray, that end is the nearest point.
                    t = min(max(along, 0.0), reach)
                    if square - 2 * t * along + t * t <= radius * radius:
                        s = placed.rotation[j]
                        for a in range(3):
                            e[a] = (s[0, a] * qx + s[1, a] * qy + s[2, a] * qz) * scale
                        count = _meet(c, k, j, placed.origin[j], e, reach, solids, -1, out, unsure, count)
                if out[c, k] == BLOCKED:
                    break
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
