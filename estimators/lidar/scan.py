"""One scan of a laser scanner as rays: those that came back, and those that did not, which says something too.

The scanner sits at the origin of its frame s, and everything about a scan is in that frame. A ray with direction d that
returned from range r is the point r d; r is NaN where nothing came back.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel

LINKS = 2.2
"""Neighbouring returns of one object lie within this many ray spacings."""
LEAST_BLUR = 0.1
"""Part of a range's noise better than which an edge of the known shape is not known."""


class Edges(NamedTuple):
    """The ends of the scan's lines on the target: point (k, 3) [m], along (k, 3), the line's direction, from the ray
    that met the target to the one that did not. width_m: (k,), between the two. blur_m: (k,), 1 sigma of their own
    directions. lost: (k,), the second did not return at all.
    """

    point: Floats
    along: Floats
    width_m: Floats
    blur_m: Floats
    lost: Bools


class Returns(NamedTuple):
    """Points of a scan, (n, 3) [m]. noise_m: 1 sigma of a range. jitter_rad: of a ray's direction, per axis."""

    point: Floats
    noise_m: float
    jitter_rad: float


class Scan(NamedTuple):
    """Rays of one scan. direction: (N, 3) unit. range_m: (N,) [m], NaN: no return. spacing_rad: between neighbouring
    rays, at the widest (between the lines). noise_m: 1 sigma of a range. line: (N,), which line a ray belongs to, and
    step: (N,), its number along it; -1: not known. jitter_rad: 1 sigma of a ray's direction, per axis.
    """

    direction: Floats
    range_m: Floats
    spacing_rad: float
    noise_m: float
    line: Ints
    step: Ints
    jitter_rad: float = 0.0

    @property
    def returned(self) -> Bools:
        """The rays that came back, (N,)."""
        return np.isfinite(self.range_m)

    @property
    def point(self) -> Floats:
        """The points (n, 3) [m] of the rays that came back."""
        hit = self.returned
        out: Floats = self.direction[hit] * self.range_m[hit, None]
        return out

    @property
    def returns(self) -> Returns:
        """The points, and what is known of their errors."""
        return Returns(self.point, self.noise_m, self.jitter_rad)

    def rays(self, which: Bools | Ints) -> "Scan":
        """Return the scan with some of the rays."""
        return self._replace(
            direction=self.direction[which],
            range_m=self.range_m[which],
            line=self.line[which],
            step=self.step[which],
        )

    def around(self, position: Floats, radius_m: float) -> "Scan":
        """Return the rays that pass within `radius_m` of `position` (3,).

        Returns from elsewhere count as none, unless they come from in front: what stands there hides the target, and
        the ray says nothing of it.
        """
        along = self.direction @ position
        near = (along > 0) & (np.sum(position**2) - along**2 < radius_m**2)
        distance = float(np.linalg.norm(position))
        if distance <= radius_m:
            near |= True
        part = self.rays(near & ~(self.range_m < distance - radius_m))
        outside = part.range_m > distance + radius_m
        return part._replace(range_m=np.where(outside, np.nan, part.range_m))

    def edges(self, jump_m: float) -> Edges:
        """Return the edges: where, along a line, a return is followed by none, or by one further away by `jump_m`.

        The edge is taken to be midway between the two rays, at the nearer range: off by at most half a step.
        """
        order = np.lexsort((self.step, self.line))
        pairs = np.empty((2, len(order)), dtype=np.int64)
        a, b = pairs[:, : _ends_into(order, self.line, self.step, self.range_m, jump_m, *pairs)]
        depth = self.range_m[a]
        middle = self.direction[a] + self.direction[b]
        across = self.direction[b] - self.direction[a]
        width = np.linalg.norm(across, axis=1)
        point = depth[:, None] * middle / np.linalg.norm(middle, axis=1, keepdims=True)
        blur = np.hypot(depth * self.jitter_rad, LEAST_BLUR * self.noise_m)
        return Edges(point, across / width[:, None], depth * width, blur, ~np.isfinite(self.range_m[b]))


@kernel
def _ends_into(order: Ints, line: Ints, step: Ints, range_m: Floats, jump: float, ends: Ints, beyond: Ints) -> int:
    """Write the rays with which a line ends on something, and those beside them; return how many there are.

    Args:
        order: (N,), of the rays along their lines, one line after the other.
        line: (N,).
        step: (N,).
        range_m: (N,) [m].
        jump: by which the ray beside goes further, at least [m].
        ends: receives rays.
        beyond: receives rays.
    """
    count = 0
    for n in range(len(order) - 1):
        a, b, after = order[n], order[n + 1], n + 2
        if line[a] != line[b] or line[a] < 0 or step[b] != step[a] + 1:
            continue
        if np.isnan(range_m[a]) or range_m[b] <= range_m[a]:
            a, b, after = b, a, n - 1
        lost = np.isnan(range_m[b])
        if np.isnan(range_m[a]) or not (lost or range_m[b] > range_m[a] + jump):
            continue
        # Where the line goes on at the same range after one ray, that ray was lost.
        if lost and 0 <= after < len(order):
            c = order[after]
            if line[c] == line[a] and abs(step[c] - step[a]) == 2 and abs(range_m[c] - range_m[a]) <= jump:
                continue
        ends[count], beyond[count] = a, b
        count += 1
    return count


def checked(scan: Scan) -> Scan:
    """Return the scan itself. Raises ValueError, naming what is wrong, where it cannot be one."""
    direction, depth = scan.direction, scan.range_m
    if direction.ndim != 2 or direction.shape[1:] != (3,) or depth.shape != (len(direction),):
        raise ValueError(f"scan: expected (N, 3) directions and (N,) ranges, got {direction.shape}, {depth.shape}")
    if scan.line.shape != depth.shape or scan.step.shape != depth.shape:
        raise ValueError(f"scan: expected (N,) lines and steps, got {scan.line.shape}, {scan.step.shape}")
    if not np.isfinite(direction).all():
        raise ValueError("scan: a direction is not finite")
    if np.any(np.abs(np.sqrt(np.einsum("ij,ij->i", direction, direction)) - 1) > 1e-6):
        raise ValueError("scan: a direction is not of unit length")
    if np.isinf(depth).any() or np.any(depth[np.isfinite(depth)] <= 0):
        raise ValueError("scan: a range is infinite or not positive; NaN says that a ray did not return")
    if not (scan.noise_m > 0 and scan.spacing_rad > 0):
        raise ValueError("scan: noise_m and spacing_rad must be positive")
    return scan


def from_points(point: Floats, spacing_rad: float, noise_m: float) -> Scan:
    """Return a scan of which only the returns are known.

    Args:
        point: (n, 3) [m].
        spacing_rad: between neighbouring rays.
        noise_m: 1 sigma of a range.

    Raises:
        ValueError: a point is not finite, or lies in the scanner itself.
    """
    point = np.asarray(point, dtype=np.float64)
    if point.ndim != 2 or point.shape[1] != 3:
        raise ValueError(f"point: expected (n, 3), got {point.shape}")
    if not np.isfinite(point).all():
        raise ValueError("point: a coordinate is not finite")
    depth = np.linalg.norm(point, axis=1)
    if np.any(depth == 0):
        raise ValueError("point: one lies in the scanner itself")
    unknown = np.full(len(point), -1, dtype=np.int64)
    return checked(Scan(point / depth[:, None], depth, spacing_rad, noise_m, unknown, unknown))


def clusters(scan: Scan, link_m: float) -> list[Ints]:
    """Return the objects in a scan: indices of the rays of each, largest first.

    Two returns belong together if they are nearer than `LINKS` ray spacings at their range, or than `link_m`.
    """
    hit = np.flatnonzero(scan.returned)
    if not len(hit):
        return []
    point = scan.point
    reach = np.maximum(LINKS * scan.spacing_rad * scan.range_m[hit], link_m)
    label = np.full(len(hit), -1, dtype=np.int64)
    _join_into(point, reach, label)
    order = np.argsort(-np.bincount(label), kind="stable")
    return [hit[label == which] for which in order]


@kernel
def _join_into(point: Floats, reach: Floats, label: Ints) -> None:
    """Write the objects' numbers (n,), from zero; every point looks at all that belong to none yet."""
    left, queue = np.arange(len(point)), np.empty(len(point), dtype=np.int64)
    number = 0
    for first in range(len(point)):
        if label[first] >= 0:
            continue
        label[first], queue[0], head, tail = number, first, 0, 1
        while head < tail:
            i = queue[head]
            head += 1
            kept = 0
            for k in range(len(left)):
                j = left[k]
                if label[j] >= 0:
                    continue
                square = 0.0
                for c in range(3):
                    square += (point[i, c] - point[j, c]) ** 2
                if square <= min(reach[i], reach[j]) ** 2:
                    label[j], queue[tail] = number, j
                    tail += 1
                else:
                    left[kept] = j
                    kept += 1
            left = left[:kept]
        number += 1
