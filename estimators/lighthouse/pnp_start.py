"""A pose from sweep angles alone: every minimum of the reprojection error (7), for a craft that knows nothing yet.

A target that is small against its distance is seen nearly in parallel projection, in which a plane and its mirror
image (turned over about the line of sight) look the same. The mirrored pose is therefore often a second minimum, and
for a plane sometimes the deeper one under noise: a start must find both and let the caller compare their costs. The
starts, each finished by the Levenberg-Marquardt of `estimators.lighthouse.pnp`, which alone knows the craft's motion:

1. `plane_starts`: homography of the best plane and its two decompositions; exact for coplanar photodiodes (n >= 4).
2. `weak_perspective_start`: the linear fit of a scaled orthographic view; for n >= 4 not in one plane. It stands where
   source 1 has DLT, which needs n >= 6 and whose perspective terms drown in noise for a small target, or RPnP.
3. `grid_starts`: twelve attitudes that leave none farther than 90 deg; for wide targets and near-flat ones, and so
   that no answer hangs on one linear fit.
4. `mirrored`: the mirror pose of every minimum found so far.

Rotations are R_l_b, positions metres in the lighthouse frame. A *view* frame has its z axis along the mean ray.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from estimators.lighthouse.pnp import FEWEST_LIT, refine_projections
from estimators.lighthouse.projection import COLLINEAR, angle_weights, checked, checked_lit, projections
from estimators.lighthouse.start_poses import (
    Starts,
    grid_starts,
    mirrored,
    plane_starts,
    transposed,
    weak_perspective_start,
)

CANDIDATES_MAX = 4
ITERATIONS_MAX = 50

DISTINCT_RAD = 1e-3
"""Minima closer than this in attitude are one: LM ends within its last step, 1e-7 rad, of a minimum or, in a flat
valley, some hundred of them. One attitude has one position, because (7) is nearly linear in it."""

FLAT = 1e-3
"""Photodiodes whose smallest spread is below this share of their largest count as coplanar."""

CHUNK = 256
"""Craft that are started side by side: their starts take some 50 kB each."""


class StartCandidates(NamedTuple):
    """Distinct minima for one craft, refined, best first, at most 4; none where the angles determine no pose.

    rotation: (M, 3, 3) R_l_b. position: (M, 3) [m], lighthouse frame. cost: (M,) sum of squared angle residuals
    [rad^2]. With independent angle noise s_ind the difference cost[1] - cost[0], in units of s_ind^2, is twice the log
    likelihood ratio of the two poses: below 25 the caller must not trust the first.
    """

    rotation: Floats
    position: Floats
    cost: Floats


@kernel
def _distinct_into(
    rotation: Floats, position: Floats, cost: Floats, out_rotation: Floats, out_position: Floats, out_cost: Floats
) -> None:
    """Keep the distinct poses of (G, M, ...), NaN where there is none, best first, at most 4: (G, 4, ...)."""
    # The chord |Ra - Rb| of two rotations an angle a apart is 2 sqrt(2) sin(a/2).
    nearest = 2 * DISTINCT_RAD**2
    taken = np.empty(cost.shape[1], np.bool_)
    for c in range(len(cost)):
        out_rotation[c], out_position[c], out_cost[c] = np.nan, np.nan, np.nan
        taken[:] = False
        kept = 0
        while kept < CANDIDATES_MAX:
            best = -1
            for i in range(cost.shape[1]):
                if not taken[i] and np.isfinite(cost[c, i]) and (best < 0 or cost[c, i] < cost[c, best]):
                    best = i
            if best < 0:
                break
            taken[best] = True
            apart = True
            for k in range(kept):
                chord = 0.0
                for i in range(3):
                    for j in range(3):
                        chord += (rotation[c, best, i, j] - out_rotation[c, k, i, j]) ** 2
                apart = apart and chord > nearest
            if apart:
                for i in range(3):
                    out_position[c, kept, i] = position[c, best, i]
                    for j in range(3):
                        out_rotation[c, kept, i, j] = rotation[c, best, i, j]
                out_cost[c, kept] = cost[c, best]
                kept += 1


class _Group(NamedTuple):
    """Craft with the same number n of lit photodiodes: uv, weight, offset (G, n, 2), point (G, n, 3), motion (G, 3)."""

    uv: Floats
    weight: Floats
    point: Floats
    offset: Floats
    angular_rate: Floats
    velocity: Floats


def _refined(group: _Group, starts: Starts, known: Starts, known_cost: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the distinct minima (G, 4, ...) that the starts (G, M, ...) lead to, and those known already."""
    rotation, position = starts
    craft, many = rotation.shape[:2]

    def each(array: Floats) -> Floats:
        return np.repeat(array, many, axis=0)

    solution = refine_projections(
        each(group.uv),
        each(group.weight),
        np.ones((craft * many, group.uv.shape[1]), dtype=np.bool_),
        each(group.point),
        rotation.reshape(-1, 3, 3),
        position.reshape(-1, 3),
        each(group.offset),
        each(group.angular_rate),
        each(group.velocity),
        ITERATIONS_MAX,
    )
    out = (
        np.empty((craft, CANDIDATES_MAX, 3, 3)),
        np.empty((craft, CANDIDATES_MAX, 3)),
        np.empty((craft, CANDIDATES_MAX)),
    )
    _distinct_into(
        np.concatenate([known[0], solution.rotation.reshape(craft, many, 3, 3)], axis=1),
        np.concatenate([known[1], solution.position.reshape(craft, many, 3)], axis=1),
        np.concatenate([known_cost, solution.cost.reshape(craft, many)], axis=1),
        *out,
    )
    return out


def _start_group(group: _Group) -> tuple[Floats, Floats, Floats]:
    """Return the distinct minima (G, 4, 3, 3), (G, 4, 3), (G, 4) of craft whose angles are finite; NaN for none."""
    uv, point = group.uv, group.point
    craft = len(uv)
    rotation, position = np.full((craft, CANDIDATES_MAX, 3, 3), np.nan), np.full((craft, CANDIDATES_MAX, 3), np.nan)
    cost = np.full((craft, CANDIDATES_MAX), np.nan)
    centre = point.mean(axis=1)
    _, spread, axes = np.linalg.svd(point - centre[:, None])
    fits = (spread[:, 1] > COLLINEAR * spread[:, 0]) & np.ptp(uv, axis=1).any(axis=1)
    if not fits.any():
        return rotation, position, cost
    group = _Group(*(part[fits] for part in group))
    uv, point, centre, spread = uv[fits], point[fits], centre[fits], spread[fits]
    axes = transposed(axes[fits])
    axes[..., 2] *= np.linalg.det(axes)[:, None]

    ray = np.concatenate([uv, np.ones((*uv.shape[:2], 1))], axis=2)
    starts = (
        plane_starts(ray, point, centre, axes),
        grid_starts(ray, point, centre),
        weak_perspective_start(ray, point, centre, spread[:, 2] > FLAT * spread[:, 0]),
    )
    joined = np.concatenate([r for r, _ in starts], axis=1), np.concatenate([p for _, p in starts], axis=1)
    none = rotation[fits][:, :0], position[fits][:, :0]
    turned, placed, found_cost = _refined(group, joined, none, cost[fits][:, :0])
    turned_over = mirrored(turned, placed, centre, axes[..., 2])
    rotation[fits], position[fits], cost[fits] = _refined(group, turned_over, (turned, placed), found_cost)
    return rotation, position, cost


def cold_starts(
    theta: Floats, lit: Bools, point_m: Floats, offset_s: Floats, angular_rate: Floats, velocity: Floats
) -> list[StartCandidates]:
    """Return every distinct minimum of (7) in front of the lighthouse, for C craft, without a first guess.

    The candidates of a craft are the same, bit for bit, in whatever company it starts. There is none where fewer than 4
    are lit, where a lit angle is missing or outside (0, pi), and where the lit photodiodes are on a line or their
    images in one point.

    Args:
        theta: (C, K, 2) [rad], fans X and Y; ignored, NaN allowed, where not lit.
        lit: (C, K), both fans seen.
        point_m: (C, K, 3) [m], photodiodes in the body frame.
        offset_s: (C, K, 2) [s], each angle's instant minus the epoch.
        angular_rate: (C, 3) [rad/s], assumed within the period, lighthouse frame.
        velocity: (C, 3) [m/s], likewise.

    Raises:
        ValueError: an array's shape does not fit `lit`; the message names the argument.
    """
    lit = checked_lit(lit)
    uv = projections(checked("theta", theta, (*lit.shape, 2)))
    return cold_starts_projections(uv, angle_weights(uv), lit, point_m, offset_s, angular_rate, velocity)


def cold_starts_projections(
    uv: Floats, weight: Floats, lit: Bools, point_m: Floats, offset_s: Floats, angular_rate: Floats, velocity: Floats
) -> list[StartCandidates]:
    """Return the minima of `cold_starts` from projections.

    Args:
        uv: (C, K, 2), (x/z, y/z).
        weight: (C, K, 2), each one's inverse noise; costs are in that unit of noise, as in `refine_projections`.
        lit: (C, K).
        point_m: (C, K, 3) [m].
        offset_s: (C, K, 2) [s].
        angular_rate: (C, 3) [rad/s].
        velocity: (C, 3) [m/s].

    Raises:
        ValueError: as `cold_starts`.
    """
    lit = checked_lit(lit)
    craft, photodiodes = lit.shape
    uv = checked("uv", uv, (craft, photodiodes, 2))
    weight = checked("weight", weight, (craft, photodiodes, 2))
    point = checked("point_m", point_m, (craft, photodiodes, 3))
    offset = checked("offset_s", offset_s, (craft, photodiodes, 2))
    angular_rate = checked("angular_rate", angular_rate, (craft, 3))
    velocity = checked("velocity", velocity, (craft, 3))
    out = [StartCandidates(np.empty((0, 3, 3)), np.empty((0, 3)), np.empty(0))] * craft
    count = np.count_nonzero(lit, axis=1)
    usable = (count >= FEWEST_LIT) & np.isfinite(np.where(lit[..., None], uv, 0.0)).all(axis=(1, 2))
    # Craft with as many photodiodes lit share the shapes of their arrays: no padding enters a sum.
    for n in np.unique(count[usable]):
        members = np.flatnonzero(usable & (count == n))
        for first in range(0, len(members), CHUNK):
            who = members[first : first + CHUNK]
            seen = (part[who][lit[who]].reshape(len(who), n, -1) for part in (uv, weight, point, offset))
            own_uv, own_weight, own_point, own_offset = seen
            group = _Group(own_uv, own_weight, own_point, own_offset, angular_rate[who], velocity[who])
            rotation, position, cost = _start_group(group)
            for i, found in zip(who, np.count_nonzero(np.isfinite(cost), axis=1), strict=True):
                row = int(np.searchsorted(who, i))
                out[i] = StartCandidates(rotation[row, :found], position[row, :found], cost[row, :found])
    return out


def cold_start(
    theta: Floats, lit: Bools, point_m: Floats, offset_s: Floats, angular_rate: Floats, velocity: Floats
) -> StartCandidates:
    """Return `cold_starts` of one craft, from the same arguments without the craft axis.

    Args:
        theta: (K, 2) [rad].
        lit: (K,).
        point_m: (K, 3) [m].
        offset_s: (K, 2) [s].
        angular_rate: (3,) [rad/s].
        velocity: (3,) [m/s].

    Raises:
        ValueError: as `cold_starts`.
    """
    rates = np.asarray(angular_rate)[None], np.asarray(velocity)[None]
    seen = np.asarray(theta)[None], np.asarray(lit)[None], np.asarray(point_m)[None], np.asarray(offset_s)[None]
    return cold_starts(*seen, *rates)[0]
