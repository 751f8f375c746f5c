"""Start of a survey, from nothing but the objects' layouts.

1. Every window gives every station that sees four photodiodes by both fans the object's poses before it, by PnP: one,
   or with its mirror two, of a plane most often two (`estimators.lighthouse.pnp_start`).
2. Two stations that see the same window differ by T_i_j = T_i_w T_j_w^-1. Of the true poses that is the same in every
   window; of mirrors it is not, since they turn with the object. The difference with the most agreement among all
   windows and candidates wins.
3. Stations are joined along the pairs with the most agreement to the first one, whose frame is the world.
4. Each window's candidates, from whatever station, are refined with the stations held; the one whose rows fit best
   stays.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.lighthouse.pnp_start import cold_starts_projections
from estimators.survey.problem import Free, Problem, Room, Rows, fans_of, room_of
from estimators.survey.rays import directions
from estimators.survey.solve import solve
from estimators.survey.terms import Errors

CANDIDATES = 4
TURN_RAD = np.radians(5.0)
"""Difference of two answers for a pair's turn that counts half: a tilt of a small plane is not better known."""
AWAY = 0.08
"""The same for its translation, in units of the object's distance."""
HYPOTHESES = 500
FACING = -0.3
"""Cosine between a photodiode's normal and the direction to the station below which it could not have been hit."""
ROUNDS = 8
TRIALS = 4
"""Candidates of a window that are refined."""
ROUGH_RAD = 2e-3
"""Residual that counts half before anything is refined [rad]."""
SAME_RAD = np.radians(6.0)
"""Candidates turned by less against each other are one."""


class Start(NamedTuple):
    """A start. room: poses, in the first station's frame. placed (S,): stations that could be joined to the first.
    solved (W,): windows with a pose. agreement (S,): share of the windows that agree with a station's place, NaN of the
    first. root: the station whose frame is the world.
    """

    room: Room
    placed: Bools
    solved: Bools
    agreement: Floats
    root: int


class Candidates(NamedTuple):
    """Poses of the object of each window before each station, (W, S, CANDIDATES, ...): rotation R_s_b, position [m],
    cost; NaN where there is none.
    """

    rotation: Floats
    position: Floats
    cost: Floats


def start(
    rows: Rows,
    moving: Bools,
    errors: tuple[tuple[Errors, Errors], ...],
    normals: Floats | None = None,
    hold: Room | None = None,
) -> Start:
    """Return a start for the poses of stations and windows.

    Args:
        rows: of W windows.
        moving: (W,).
        errors: of both fans of each station.
        normals: of each row's photodiode in its object's frame, (M, 3), if known.
        hold: stations whose poses are known.
    """
    windows = len(moving)
    found = candidates(rows, windows, errors, normals)
    root = _root(found)
    if hold is None:
        turned, placed_at, agreement = _joined(found)
        placed = np.isfinite(agreement)
        placed[root] = True
    else:
        turned, placed_at = hold.rotation, hold.position
        agreement, placed = np.full(len(errors), np.nan), np.ones(len(errors), dtype=np.bool_)
    stations = [(turned[s], placed_at[s], errors[s]) for s in range(len(errors))]
    room = room_of(stations, np.tile(np.eye(3), (windows, 1, 1)), np.tile([0.0, 0.0, 1.0], (windows, 1)))
    rotation, position, usable = world_candidates(found, room, placed)
    mine = placed[rows.station]
    room, solved = best_of(rows.of(mine), moving, room, rotation, position, usable)
    return Start(room, placed, solved, agreement, root)


def world_candidates(found: Candidates, room: Room, placed: Bools) -> tuple[Floats, Floats, Bools]:
    """Return all stations' candidates for each window in the world frame (W, N, 3, 3), (W, N, 3) [m], and which are
    there (W, N).

    Args:
        found: the candidates.
        room: stations.
        placed: (S,), stations that have a place.
    """
    windows = len(found.cost)
    rotation = np.einsum("sij,wscjk->wscik", room.rotation, found.rotation).reshape(windows, -1, 3, 3)
    position = np.einsum("sij,wscj->wsci", room.rotation, found.position) + room.position[:, None]
    position = position.reshape(windows, -1, 3)
    usable: Bools = np.isfinite(position).all(axis=2) & np.repeat(placed, CANDIDATES)
    return rotation, position, usable


def best_of(
    rows: Rows, moving: Bools, room: Room, rotation: Floats, position: Floats, usable: Bools
) -> tuple[Room, Bools]:
    """Return the room with the best of several poses for each window, each refined, the stations held.

    Args:
        rows: of the windows.
        moving: (W,).
        room: stations; its windows are not used.
        rotation: candidates in the world frame, (W, N, 3, 3).
        position: (W, N, 3) [m].
        usable: (W, N).

    Returns:
        The room, and the windows that have a pose (W,).
    """
    windows = len(moving)
    least = np.full(windows, np.inf)
    best = room
    every = np.arange(windows)
    # Several stations' candidates are mostly the same few poses: the most promising ones are refined.
    order = np.argsort(_promise(rows, moving, room, rotation, position, usable), axis=1, kind="stable")
    for n in range(min(int(usable.sum(axis=1).max(initial=0)), TRIALS)):
        pick = order[:, n]
        has = usable[every, pick]
        none = np.zeros((windows, 3))
        trial = replace(
            room,
            window_rotation=np.where(has[:, None, None], rotation[every, pick], best.window_rotation),
            window_position=np.where(has[:, None], position[every, pick], best.window_position),
            rate=none,
            velocity=none.copy(),
        )
        mine = has[rows.window]
        problem = Problem(rows.of(mine), moving, Free(np.zeros(len(room.position), dtype=np.bool_)), trial)
        refined = solve(problem, trial, scale=10.0, rounds=ROUNDS)
        loss = np.log1p((refined.residual / 30.0) ** 2)
        cost = np.bincount(rows.window[mine], loss, minlength=windows)
        better = has & (cost < least)
        least[better] = cost[better]
        best = _taken(best, refined.room, better)
    return best, np.isfinite(least)


def _promise(rows: Rows, moving: Bools, room: Room, rotation: Floats, position: Floats, usable: Bools) -> Floats:
    """Return the cost of each candidate (W, N) as it is, and that of its attitude where it resembles a better one.

    Args:
        rows: of the windows.
        moving: (W,).
        room: stations.
        rotation: (W, N, 3, 3).
        position: (W, N, 3) [m].
        usable: (W, N).
    """
    windows, count = usable.shape
    cost = np.full((windows, count), np.inf)
    none = np.zeros((windows, 3))
    for n in np.flatnonzero(usable.any(axis=0)):
        trial = replace(
            room,
            window_rotation=np.where(usable[:, n, None, None], rotation[:, n], np.eye(3)),
            window_position=np.where(usable[:, n, None], position[:, n], [0.0, 0.0, 1.0]),
            rate=none,
            velocity=none,
        )
        problem = Problem(rows, moving, Free(np.zeros(len(room.position), dtype=np.bool_), windows=False), trial)
        away = problem.residuals(trial) / ROUGH_RAD
        cost[:, n] = np.where(usable[:, n], np.bincount(rows.window, np.log1p(away**2), minlength=windows), np.inf)
    order = np.argsort(cost, axis=1, kind="stable")
    for w in range(windows):
        kept: list[int] = []
        for n in order[w].tolist():
            if not usable[w, n]:
                break
            turns = [float(np.trace(rotation[w, n] @ rotation[w, k].T)) for k in kept]
            if turns and (max(turns) - 1) / 2 > np.cos(SAME_RAD):
                cost[w, n] += 1e6
            else:
                kept.append(n)
    return cost


def _taken(best: Room, other: Room, windows: Bools) -> Room:
    """Return `best` with some windows of `other`."""
    flat = windows[:, None]
    return replace(
        best,
        window_rotation=np.where(flat[..., None], other.window_rotation, best.window_rotation),
        window_position=np.where(flat, other.window_position, best.window_position),
        rate=np.where(flat, other.rate, best.rate),
        velocity=np.where(flat, other.velocity, best.velocity),
    )


def candidates(
    rows: Rows, windows: int, errors: tuple[tuple[Errors, Errors], ...], normals: Floats | None
) -> Candidates:
    """Return the poses of the object of each window before each station, by PnP without a first guess.

    Args:
        rows: of the windows.
        windows: their number W.
        errors: of both fans of each station.
        normals: of each row's photodiode in its object's frame, (M, 3), if known.
    """
    stations = len(errors)
    shape = (windows, stations, CANDIDATES)
    out = Candidates(np.full((*shape, 3, 3), np.nan), np.full((*shape, 3), np.nan), np.full(shape, np.nan))
    where: list[tuple[int, int]] = []
    uv: list[Floats] = []
    points: list[Floats] = []
    facing: list[Floats | None] = []
    for s in range(stations):
        for w in range(windows):
            pair = _pairs(rows, np.flatnonzero((rows.station == s) & (rows.window == w)))
            ray = directions(pair.angle, fans_of(errors[s]))
            good = np.isfinite(ray).all(axis=1)
            if np.count_nonzero(good) < CANDIDATES:
                continue
            where.append((w, s))
            uv.append(ray[good])
            points.append(rows.point[pair.row[good]])
            facing.append(None if normals is None else normals[pair.row[good]])
    if not where:
        return out
    width = max(map(len, uv))
    lit = np.zeros((len(where), width), dtype=np.bool_)
    all_uv, all_point = np.full((len(where), width, 2), np.nan), np.zeros((len(where), width, 3))
    for i, (ray, point) in enumerate(zip(uv, points, strict=True)):
        lit[i, : len(ray)], all_uv[i, : len(ray)], all_point[i, : len(ray)] = True, ray, point
    weight = np.where(lit[..., None], 1 / (1 + np.nan_to_num(all_uv) ** 2), 0.0)
    none = np.zeros((len(where), 3))
    found = cold_starts_projections(all_uv, weight, lit, all_point, np.zeros_like(all_uv), none, none.copy())
    for (w, s), poses, point, normal in zip(where, found, points, facing, strict=True):
        keep = _facing(poses.rotation, poses.position, point, normal)
        n = len(keep)
        out.rotation[w, s, :n], out.position[w, s, :n] = poses.rotation[keep], poses.position[keep]
        out.cost[w, s, :n] = poses.cost[keep]
    return out


def _facing(rotation: Floats, position: Floats, point: Floats, normal: Floats | None) -> Ints:
    """Return the candidates whose photodiodes could have been hit, or all if none could."""
    if normal is None or not len(rotation):
        return np.arange(len(rotation))
    place = np.einsum("cij,kj->cki", rotation, point) + position[:, None]
    turned = np.einsum("cij,kj->cki", rotation, normal)
    cosine = -np.sum(turned * place, axis=2) / np.linalg.norm(place, axis=2)
    seen = np.median(cosine, axis=1) > FACING
    return np.flatnonzero(seen) if np.any(seen) else np.arange(len(rotation))


class _Pair(NamedTuple):
    """Photodiodes that both fans hit: a row of each, and their mean angles (n, 2)."""

    row: Ints
    angle: Floats


def _pairs(rows: Rows, mine: Ints) -> _Pair:
    photodiode, fan, angle = rows.photodiode[mine], rows.fan[mine], rows.angle[mine]
    names, index = np.unique(photodiode, return_inverse=True)
    means = np.full((len(names), 2), np.nan)
    for k in range(len(names)):
        for f in (0, 1):
            values = angle[(index == k) & (fan == f)]
            if len(values):
                means[k, f] = np.median(values)
    both = np.isfinite(means).all(axis=1)
    first = np.array([mine[np.flatnonzero(index == k)[0]] for k in range(len(names))], dtype=np.int64)
    return _Pair(first[both] if len(names) else first, means[both])


def _root(found: Candidates) -> int:
    """Return the station whose frame is the world: the first that sees any object."""
    seen = np.isfinite(found.cost).any(axis=(0, 2))
    return int(np.argmax(seen))


def _joined(found: Candidates) -> tuple[Floats, Floats, Floats]:
    """Return poses of the stations (S, 3, 3), (S, 3) in the root's frame, and their agreement (S,), NaN where a station
    is not joined, and of the root.
    """
    stations = found.cost.shape[1]
    rotation, position = np.tile(np.eye(3), (stations, 1, 1)), np.zeros((stations, 3))
    agreement = np.full(stations, np.nan)
    pairs = {(i, j): _difference(found, i, j) for i in range(stations) for j in range(i + 1, stations)}
    root = _root(found)
    joined = {root}
    while True:
        best: tuple[float, int, int] | None = None
        for (i, j), pair in pairs.items():
            if pair is not None and (i in joined) != (j in joined) and (best is None or pair.votes > best[0]):
                best = (pair.votes, i, j)
        if best is None:
            return rotation, position, agreement
        _, i, j = best
        pair = pairs[i, j]
        assert pair is not None
        if i in joined:
            rotation[j], position[j] = rotation[i] @ pair.rotation, rotation[i] @ pair.position + position[i]
        else:
            rotation[i] = rotation[j] @ pair.rotation.T
            position[i] = position[j] - rotation[i] @ pair.position
        new = j if i in joined else i
        agreement[new] = pair.share
        joined.add(new)


class _Difference(NamedTuple):
    """Pose of station j in the frame of station i. votes: sum of agreement. share: of the windows."""

    rotation: Floats
    position: Floats
    votes: float
    share: float


def _difference(found: Candidates, i: int, j: int) -> _Difference | None:
    """Return the difference of two stations that most windows agree on, None if no window has both."""
    both = np.flatnonzero(np.isfinite(found.cost[:, i, 0]) & np.isfinite(found.cost[:, j, 0]))
    if not len(both):
        return None
    a_r, a_p, b_r, b_p = (part[both][:, s] for s in (i, j) for part in (found.rotation, found.position))
    turn = np.einsum("wcij,wdkj->wcdik", a_r, b_r).reshape(len(both), -1, 3, 3)
    away = (a_p[:, :, None] - np.einsum("wcdij,wdj->wcdi", turn.reshape(len(both), CANDIDATES, -1, 3, 3), b_p)).reshape(
        len(both), -1, 3
    )
    far = np.nanmean(np.linalg.norm(a_p, axis=2), axis=1) + np.nanmean(np.linalg.norm(b_p, axis=2), axis=1)
    real = np.isfinite(away).all(axis=2)
    window, combination = np.nonzero(real)
    if len(window) > HYPOTHESES:
        some = np.linspace(0, len(window) - 1, HYPOTHESES).astype(np.int64)
        window, combination = window[some], combination[some]
    score = np.zeros(len(window))
    distance = np.empty((len(window), len(both)))
    for h, (w, c) in enumerate(zip(window.tolist(), combination.tolist(), strict=True)):
        distance[h] = _apart(turn, away, turn[w, c], away[w, c], far).min(axis=1)
        score[h] = float(np.sum(1 / (1 + distance[h])))
    h = int(np.argmax(score))
    rotation, position = turn[window[h], combination[h]], away[window[h], combination[h]]
    for _ in range(3):
        apart = _apart(turn, away, rotation, position, far)
        nearest = np.argmin(apart, axis=1)
        every = np.arange(len(both))
        weight = 1 / (1 + apart[every, nearest]) ** 2
        step = rot.log(np.einsum("wij,kj->wik", turn[every, nearest], rotation))
        rotation = rot.exp(np.average(step, axis=0, weights=weight)) @ rotation
        position = np.average(away[every, nearest], axis=0, weights=weight)
    apart = _apart(turn, away, rotation, position, far).min(axis=1)
    return _Difference(rotation, position, float(np.max(score)), float(np.mean(apart < 1)))


def _apart(turn: Floats, away: Floats, rotation: Floats, position: Floats, far: Floats) -> Floats:
    """Return the squared distance (W, N) of differences from one of them, inf where there is none."""
    cosine = (np.einsum("wcij,ij->wc", turn, rotation) - 1) / 2
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    shift = np.linalg.norm(away - position, axis=2)
    out = (angle / TURN_RAD) ** 2 + (shift / (AWAY * far[:, None])) ** 2
    return np.where(np.isfinite(out), out, np.inf)
