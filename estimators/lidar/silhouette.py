"""Silhouette edges of a scan: each lies between two rays, and is as exact as the rays are.

A line of the scan meets the target with one ray and misses it with the next: the silhouette passes between the two.
With the edge's tangent T and a point m of it, both in the scanner's frame, and the midpoint x of the two rays at the
range of the one that met it,

    N = x x T / |...|,   e = N . (x - m),   h = |N . (x_b - x_a)| / 2,   J = [m x N, N]

the pose's error d must bring J d within [e - h, e + h], blurred by the jitter of the rays: a line that crosses an edge
at a small angle tells it to a fraction of a step. Such an interval is no normal error. Many of them leave a polytope
that is much smaller than the same number of normal errors of that size would: expectation propagation (Minka 2001)
replaces each by the normal factor that gives the same mean and variance together with all others. With m, v the mean
and variance of J d without the factor, a, b the interval's ends less m over t = sqrt(v + blur^2), and an edge that is
no edge at all (a ray that was lost) with probability q,

    Z = (1 - q) (Phi(b) - Phi(a)) + q,   g = (1 - q) (phi(a) - phi(b)) / (t Z)
    H = (1 - q) (a phi(a) - b phi(b)) / (t^2 Z) - g^2
    factor: precision -H / (1 + v H), precision times mean (g - m H) / (1 + v H)
"""

import math
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel
from estimators.lidar.nearest import PointTree, nearest
from estimators.lidar.scan import Edges
from estimators.lidar.shape import Shape, SharpEdges
from estimators.linear import invert_spd_into

CLEAR = 0.4
"""Sine of the least angle between an edge and the line of sight."""
STEEP = 0.4
"""Cosine of the incidence (66 degrees) on the face beside an edge beyond which a ray that did not return may have been
lost.
"""
OUTSIDE = 0.3
"""How clearly an edge must look outward across itself for its side to be compared with the scan's."""
LOST, LOST_STEEP = 0.005, 0.05
"""Probability that an edge is none, and where the face beside it is steep."""
ROUNDS, DAMPING = 12, 0.7
ROOT_2 = math.sqrt(2)


class Intervals(NamedTuple):
    """Edges matched with the shape's. jacobian: (k, 6). centre: (k,) e [m], half: (k,) h [m], blur: (k,) [m]. doubt:
    (k,) q.
    """

    jacobian: Floats
    centre: Floats
    half: Floats
    blur: Floats
    doubt: Floats


def matched(
    edges: Edges, shape: Shape, seen: PointTree, reach_m: float, rotation: Floats, position: Floats
) -> Intervals:
    """Return the intervals of a scan's edges at a pose.

    Args:
        edges: where the scan's lines leave the target.
        shape: of the target.
        seen: the shape's edge points that are seen.
        reach_m: from the nearest of these to an edge of the scan, at most.
        rotation: (3, 3), target to scanner.
        position: (3,) [m], likewise.
    """
    chosen = nearest(seen, edges.point, rotation, position, reach_m)
    out = Intervals(np.empty((len(chosen), 6)), *np.empty((4, len(chosen))))
    used = _match_into(edges, shape.edge, chosen, rotation, position, *out)
    return Intervals(*(part[:used] for part in out))


@kernel
def _match_into(
    edges: Edges,
    known: SharpEdges,
    chosen: Ints,
    rotation: Floats,
    position: Floats,
    jacobian: Floats,
    centre: Floats,
    half: Floats,
    blur: Floats,
    doubt: Floats,
) -> int:
    """Write the intervals of the edges that have one, and return how many there are."""
    used = 0
    m, t, n, own, across = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(chosen)):
        s = chosen[i]
        if s < 0:
            continue
        distance = np.sqrt(edges.point[i, 0] ** 2 + edges.point[i, 1] ** 2 + edges.point[i, 2] ** 2)
        error, outward, one, two = 0.0, 0.0, 0.0, 0.0
        for k in range(3):
            m[k], t[k], own[k] = 0.0, 0.0, 0.0
            for c in range(3):
                m[k] += rotation[k, c] * known.point[s, c]
                t[k] += rotation[k, c] * known.tangent[s, c]
                own[k] += edges.point[i, c] * rotation[c, k]
            # The face that looks to the scanner.
            one -= known.one[s, k] * own[k]
            two -= known.two[s, k] * own[k]
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            n[k] = edges.point[i, a] * t[b] - edges.point[i, b] * t[a]
        size = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
        crossing = 0.0
        for k in range(3):
            n[k] /= max(size, 1e-12)
            crossing += n[k] * edges.along[i, k]
            error += n[k] * (edges.point[i, k] - m[k] - position[k])
        for k in range(3):
            across[k] = n[0] * rotation[0, k] + n[1] * rotation[1, k] + n[2] * rotation[2, k]
            outward += across[k] * known.outward[s, k]
        # The surface must end on the side on which the rays did not return.
        right_side = abs(outward) < OUTSIDE or outward * crossing > 0
        if not (size / distance > CLEAR and right_side):
            continue
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            jacobian[used, k], jacobian[used, 3 + k] = m[a] * n[b] - m[b] * n[a], n[k]
        centre[used], half[used], blur[used] = error, abs(crossing) * edges.width_m[i] / 2, edges.blur_m[i]
        doubt[used] = LOST_STEEP if edges.lost[i] and max(one, two) / distance < STEEP else LOST
        used += 1
    return used


def propagated(normal: Floats, right: Floats, intervals: Intervals) -> tuple[Floats, Floats]:
    """Return the normal matrix (6, 6) and right side (6,) of all that is known: what is given, and the intervals.

    Args:
        normal: (6, 6), of what else is known.
        right: (6,).
        intervals: that the pose must fulfil.
    """
    j, centre, half, blur, doubt = intervals
    precision = 1 / (half**2 / 3 + blur**2)
    weighted = precision * centre
    _propagate_into(j, centre, half, blur, doubt, normal, right, precision, weighted)
    return normal + j.T @ (precision[:, None] * j), right + j.T @ weighted


@kernel
def _propagate_into(
    j: Floats,
    centre: Floats,
    half: Floats,
    blur: Floats,
    doubt: Floats,
    normal: Floats,
    right: Floats,
    precision: Floats,
    weighted: Floats,
) -> None:
    """Write precision (k,) and precision times mean (k,) of the factors, from those of normal errors."""
    whole, inverse, side = np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    for _ in range(ROUNDS):
        for r in range(6):
            side[r] = right[r]
            for c in range(6):
                whole[r, c] = normal[r, c]
        for i in range(len(centre)):
            for r in range(6):
                side[r] += weighted[i] * j[i, r]
                for c in range(r + 1):
                    whole[r, c] += precision[i] * j[i, r] * j[i, c]
        if not invert_spd_into(whole, inverse):
            return
        for i in range(len(centre)):
            variance, mean = 0.0, 0.0
            for r in range(6):
                spread = 0.0
                for c in range(6):
                    spread += inverse[r, c] * j[i, c]
                variance += j[i, r] * spread
                mean += side[r] * spread
            left = 1 / variance - precision[i]
            if left <= 1e-6 / variance:
                continue
            v = 1 / left
            m = v * (mean / variance - weighted[i])
            t = np.sqrt(v + blur[i] ** 2)
            a, b = (centre[i] - half[i] - m) / t, (centre[i] + half[i] - m) / t
            pa, pb = np.exp(-a * a / 2) / np.sqrt(2 * np.pi), np.exp(-b * b / 2) / np.sqrt(2 * np.pi)
            # Of the two tails, the one that keeps its digits.
            inside = (
                math.erfc(a / ROOT_2) - math.erfc(b / ROOT_2)
                if a > 0
                else math.erfc(-b / ROOT_2) - math.erfc(-a / ROOT_2)
            )
            z = (1 - doubt[i]) * inside / 2 + doubt[i]
            g = (1 - doubt[i]) * (pa - pb) / (t * z)
            h = (1 - doubt[i]) * (a * pa - b * pb) / (t * t * z) - g * g
            # A factor that would widen what is known, as of an edge that is none, says nothing.
            tells = h < 0 and 1 + v * h > 1e-6
            own = -h / (1 + v * h) if tells else 0.0
            shifted = (g - m * h) / (1 + v * h) if tells else 0.0
            precision[i] = DAMPING * own + (1 - DAMPING) * precision[i]
            weighted[i] = DAMPING * shifted + (1 - DAMPING) * weighted[i]
