"""Every pose that fits one craft's rows, without a first guess, whatever stations and fans they come from.

1. Of each station, the direction (x/z, y/z) of every photodiode that both its fans met, by Newton's method on the two
   angles; where four or more have one, all minima of `estimators.lighthouse.pnp_start`, mirror images included.
2. Photodiodes that two stations or more see are crossed: the point nearest to their rays; three or more such points
   give a pose by the nearest rotation.
3. Where several stations see few photodiodes each: attitudes all over the sphere, at the point nearest to all rays.
4. Each of these is finished by `estimators.lighthouse.row_pose` on all rows together. What ends at one attitude is one.
5. Rows that lie `OUTLIER` times farther off than half of the others do, such as reflections, are left out, and the rest
   is fitted again, until none does (`trimmed`).

The craft is taken to be at rest within the period.
"""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.innovation import RowBatch, light_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.pnp import FEWEST_LIT
from estimators.lighthouse.pnp_start import DISTINCT_RAD, cold_starts_projections
from estimators.lighthouse.projection import angle_weights
from estimators.lighthouse.row_pose import RowPose, solve_rows
from estimators.lighthouse.rows import Rows, Station, linearise, packed
from estimators.lighthouse.sweep import angle_gradient, kernel_fans, measured_angle
from estimators.state import State

STARTS_MAX = 4
"""Poses that are returned at most."""
OUTLIER = 4.0
"""Standard deviations beyond which a row is left out, those of a normal distribution with the residuals' median."""
FEWEST_KEPT = 0.75
"""Share of the rows that remains at least; where more would be left out, none is."""
TRIMS_MAX = 10
NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a normal distribution of variance one."""
ROUNDS = 30
_CONVERGED = 1e-10
_STEEPEST = 4.0
"""Largest tangent of a direction's angle from boresight."""
_FEWEST_CROSSED = 3


class RowStarts(NamedTuple):
    """Distinct poses of one craft that fit its rows, best first, (M, ...) of each part as in `RowPose`."""

    pose: RowPose

    def __len__(self) -> int:
        return len(self.pose.cost)


class _Rays(NamedTuple):
    """Directions from one station: seen (K,); uv (K, 2), NaN where not seen."""

    seen: Bools
    uv: Floats


def row_starts(rows: Rows, stations: Sequence[Station], point_m: Floats, noise: Sequence[AngleNoise]) -> RowStarts:
    """Return every pose that fits the rows of one craft; none where they determine no pose.

    Args:
        rows: M sweep angles.
        stations: the stations that they name.
        point_m: (K, 3) [m], photodiodes in the body frame.
        noise: noise of the rows of each station.
    """
    rays = [_rays(rows, s, station, len(point_m)) for s, station in enumerate(stations)]
    found = [*_by_station(rays, stations, point_m), *_crossed(rays, stations, point_m)]
    if not found:
        found = _all_over(rays, stations, point_m)
    return refined_starts(rows, stations, point_m, noise, found)


def refined_starts(
    rows: Rows,
    stations: Sequence[Station],
    point_m: Floats,
    noise: Sequence[AngleNoise],
    starts: Sequence[tuple[Floats, Floats]],
) -> RowStarts:
    """Return the distinct minima that poses lead to, best first.

    Args:
        rows: M sweep angles of one craft.
        stations: the stations that they name.
        point_m: (K, 3) [m], photodiodes in the body frame.
        noise: noise of the rows of each station.
        starts: rotations (3, 3) and positions (3,) [m].
    """
    many, count = len(starts), len(rows.angle)
    batch = RowBatch._make((count * np.arange(many + 1, dtype=np.int64), *(np.tile(part, many) for part in rows)))
    still = np.zeros((many, 3))
    start = State(
        np.array([r for r, _ in starts]).reshape(-1, 3, 3),
        np.array([p for _, p in starts]).reshape(-1, 3),
        still,
        still,
    )
    every: Bools = np.ones(many, dtype=np.bool_)
    kept: Bools = np.ones(many * count, dtype=np.bool_)
    point = np.broadcast_to(point_m, (many, *point_m.shape))
    pose = solve_rows(batch, kept, every, light_of(packed(stations), noise), point, start)
    order: list[int] = []
    for i in np.argsort(np.where(pose.solved, pose.cost, np.inf), kind="stable").tolist():
        if pose.solved[i] and np.all(rot.angle_between(pose.rotation[order], pose.rotation[i]) > DISTINCT_RAD):
            order.append(i)
    return RowStarts(RowPose._make(part[order[:STARTS_MAX]] for part in pose))


def trimmed(
    rows: Rows, stations: Sequence[Station], point_m: Floats, noise: Sequence[AngleNoise], starts: RowStarts
) -> RowStarts:
    """Return the minima of the rows without those that are far off, as the pose tells which fits most of them.

    What craft that move do to their residuals is no such thing: it is much the same for all rows.

    Args:
        rows: M sweep angles of one craft.
        stations: the stations that they name.
        point_m: (K, 3) [m], photodiodes in the body frame.
        noise: noise of the rows of each station.
        starts: minima of all rows.
    """
    best: tuple[int, Bools] | None = None
    poses = list(zip(starts.pose.rotation, starts.pose.position, strict=True))
    for i, pose in enumerate(poses):
        found = _agreeing_with(rows, stations, point_m, noise, pose)
        if found is None:
            continue
        kept, poses[i] = found
        number = int(np.count_nonzero(kept))
        if best is None or number > best[0]:
            best = number, kept
    if best is None or best[1].all():
        return starts
    left = Rows._make(part[best[1]] for part in rows)
    return refined_starts(left, stations, point_m, noise, poses)


def _agreeing_with(
    rows: Rows,
    stations: Sequence[Station],
    point_m: Floats,
    noise: Sequence[AngleNoise],
    pose: tuple[Floats, Floats],
) -> tuple[Bools, tuple[Floats, Floats]] | None:
    """Return the rows (M,) that are not far off from a pose that is fitted to them, and that pose; None without one."""
    light, still = packed(stations), np.zeros(3)
    least = np.array([np.hypot(*one) for one in noise])[rows.station]
    kept: Bools = np.ones(len(rows.angle), dtype=np.bool_)
    for _ in range(TRIMS_MAX):
        off = np.abs(linearise(rows, light, point_m, *pose, still, still)[0])
        known = off[kept & np.isfinite(off)]
        if not len(known):
            return None
        spread = np.maximum(np.median(known) / NORMAL_MEDIAN, least)
        with np.errstate(invalid="ignore"):
            before, kept = kept, off <= OUTLIER * spread
        if np.array_equal(kept, before):
            return kept, pose
        if np.count_nonzero(kept) < FEWEST_KEPT * len(kept):
            return None
        found = refined_starts(Rows._make(part[kept] for part in rows), stations, point_m, noise, [pose])
        if not len(found):
            return None
        pose = found.pose.rotation[0], found.pose.position[0]
    return None


def _rays(rows: Rows, number: int, station: Station, photodiodes: int) -> _Rays:
    """Return the directions from one station of the photodiodes that both its fans met, the sweeps' mean each."""
    mean = np.full((photodiodes, 2), np.nan)
    for fan in (0, 1):
        own = (rows.station == number) & (rows.fan == fan)
        total = np.bincount(rows.photodiode[own], rows.angle[own], minlength=photodiodes)
        count = np.bincount(rows.photodiode[own], minlength=photodiodes)
        mean[:, fan] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    uv = np.full((photodiodes, 2), np.nan)
    if len(station.fans) == 2:
        _directions_into(mean, kernel_fans(station.fans), uv)
    return _Rays(np.isfinite(uv).all(axis=1), uv)


def directions(angles: Floats, station: Station) -> Floats:
    """Return the directions (x/z, y/z), (N, 2), that the two fans of a station measured as angles (N, 2) [rad].

    NaN where an angle is missing, or no direction in front has both.
    """
    out = np.full(np.shape(angles), np.nan)
    _directions_into(np.ascontiguousarray(angles, dtype=np.float64), kernel_fans(station.fans), out)
    return out


@kernel
def _directions_into(angles: Floats, fans: Floats, out: Floats) -> None:
    """Write directions (K, 2); rows without both angles stay as they are."""
    for k in range(len(angles)):
        if np.isnan(angles[k, 0]) or np.isnan(angles[k, 1]):
            continue
        u, v, settled = 0.0, 0.0, False
        for _ in range(ROUNDS):
            r0 = angles[k, 0] - measured_angle(u, v, 1.0, fans[0])
            r1 = angles[k, 1] - measured_angle(u, v, 1.0, fans[1])
            a = angle_gradient(u, v, 1.0, fans[0])
            b = angle_gradient(u, v, 1.0, fans[1])
            determinant = a[0] * b[1] - a[1] * b[0]
            du = (r0 * b[1] - r1 * a[1]) / determinant
            dv = (a[0] * r1 - b[0] * r0) / determinant
            size = np.sqrt(du * du + dv * dv)
            if not size < 1e6:
                break
            # The whole step far off boresight would leave the front.
            scale = min(1.0, 0.5 / size) if size > 0 else 1.0
            u, v = u + scale * du, v + scale * dv
            if u * u + v * v > 2 * _STEEPEST * _STEEPEST:
                break
            if size < _CONVERGED:
                settled = True
                break
        if settled:
            out[k, 0], out[k, 1] = u, v


def _by_station(rays: Sequence[_Rays], stations: Sequence[Station], point_m: Floats) -> list[tuple[Floats, Floats]]:
    """Return the poses that single stations find."""
    out = []
    for ray, station in zip(rays, stations, strict=True):
        if np.count_nonzero(ray.seen) < FEWEST_LIT:
            continue
        uv, none = ray.uv[None], np.zeros((1, len(point_m), 2))
        still = np.zeros((1, 3))
        weight = angle_weights(np.where(ray.seen[None, :, None], uv, 0.0))
        found = cold_starts_projections(uv, weight, ray.seen[None], point_m[None], none, still, still)[0]
        out += [
            (station.rotation @ r, station.rotation @ p + station.position)
            for r, p in zip(found.rotation, found.position, strict=True)
        ]
    return out


def _lines(rays: Sequence[_Rays], stations: Sequence[Station]) -> list[tuple[Ints, Floats, Floats]]:
    """Return photodiodes (n,), origins and unit directions (n, 3), world frame, of each station's rays."""
    out = []
    for ray, station in zip(rays, stations, strict=True):
        at = np.flatnonzero(ray.seen)
        ahead = np.concatenate([ray.uv[at], np.ones((len(at), 1))], axis=1) @ station.rotation.T
        unit = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
        out.append((at, np.broadcast_to(station.position, unit.shape), unit))
    return out


def _nearest(origin: Floats, unit: Floats) -> Floats | None:
    """Return the point (3,) nearest to lines through `origin` along `unit`, (n, 3) each; None if they are parallel."""
    across = np.eye(3) - unit[:, :, None] * unit[:, None, :]
    normal = across.sum(axis=0)
    if np.linalg.eigvalsh(normal)[0] < 1e-4 * len(unit):
        return None
    out: Floats = np.linalg.solve(normal, np.einsum("nij,nj->i", across, origin))
    return out


def _crossed(rays: Sequence[_Rays], stations: Sequence[Station], point_m: Floats) -> list[tuple[Floats, Floats]]:
    """Return the pose of the photodiodes that several stations see, as a list of one; empty where there is none."""
    lines = _lines(rays, stations)
    photodiodes, places = [], []
    for k in range(len(point_m)):
        seen = [(origin[at == k], unit[at == k]) for at, origin, unit in lines if np.any(at == k)]
        if len(seen) < 2:
            continue
        place = _nearest(*(np.concatenate(part) for part in zip(*seen, strict=True)))
        if place is not None:
            photodiodes.append(k)
            places.append(place)
    if len(places) < _FEWEST_CROSSED:
        return []
    body, world = point_m[photodiodes], np.array(places)
    if np.linalg.matrix_rank(body - body.mean(axis=0), tol=1e-6) < 2:
        return []
    turn = _kabsch(body - body.mean(axis=0), world - world.mean(axis=0))
    return [(turn, world.mean(axis=0) - turn @ body.mean(axis=0))]


def _kabsch(body: Floats, world: Floats) -> Floats:
    """Return the rotation that brings centred points nearest to centred points, (n, 3) each."""
    left, _, right = np.linalg.svd(world.T @ body)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    out: Floats = left @ flip @ right
    return out


def _all_over(rays: Sequence[_Rays], stations: Sequence[Station], point_m: Floats) -> list[tuple[Floats, Floats]]:
    """Return poses of all attitudes where the stations' rays meet; none with rays of fewer than two stations."""
    lines = [line for line in _lines(rays, stations) if len(line[0])]
    if len(lines) < 2:
        return []
    origin, unit = (np.concatenate(part) for part in zip(*((o, u) for _, o, u in lines), strict=True))
    place = _nearest(origin, unit)
    if place is None:
        return []
    seen = np.unique(np.concatenate([at for at, _, _ in lines]))
    centre = point_m[seen].mean(axis=0)
    return [(turn, place - turn @ centre) for turn in _sphere()]


@cache
def _sphere() -> Floats:
    """Return rotations (N, 3, 3) that leave none farther away than some 45 degrees: quaternions of -1, 0, 1."""
    grid = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 4, indexing="ij"), axis=-1).reshape(-1, 4)
    grid = grid[np.linalg.norm(grid, axis=1) > 0]
    first = np.array([row[np.flatnonzero(row)[0]] > 0 for row in grid])
    unit = grid[first] / np.linalg.norm(grid[first], axis=1, keepdims=True)
    return rot.matrix_from_quaternion(unit)
