"""Bundle adjustment of a room: stations, objects' poses and, if wanted, the fans' terms, from a start out of nothing.

1. `estimators.survey.start` finds where stations and windows stand, roughly.
2. `estimators.survey.solve` adjusts all together, first with a loss so wide that a start of centimetres off is no
   outlier.
3. Windows that fit badly try their object's other poses again, with the stations as they are now; those that still fit
   badly are left out.
4. What the residuals have beyond the light's noise is systematic (calibration, layout): its standard deviation is found
   such that the residuals are as large as they should be, and added to every row. So an average over 1000 turns is not
   believed to a thousandth of that.
5. A station that was moved (`estimators.survey.moves`) is two stations, before and after.
6. Standard deviations of the stations from the inverse of the normal matrix there.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.survey.moves import Step, find_step
from estimators.survey.problem import Free, Problem, Room, Rows, Truth
from estimators.survey.solve import Solution, degrees_of_freedom, shared_covariance, solve
from estimators.survey.start import Start, best_of, candidates, start, world_candidates
from estimators.survey.terms import Errors

SYSTEMATIC_RAD = 3e-5
"""Systematic error of an angle before anything is known [rad]: well calibrated stations' residuals."""
BAD_WINDOW = 4.0
"""RMS of a window's whitened residuals, outliers cut at `CUT`, beyond which its pose is doubted."""
CUT = 10.0
FEWEST_ROWS_ALONE = 8
"""Rows of one station's that tell a pose: four photodiodes by both fans."""
MOST_STEPS = 4
"""Moves that are looked for."""
_SAME = 0.05
"""Relative change of the systematic error that ends its rounds."""
_ROUNDS = 3
"""Rounds of solving and finding the systematic error."""


class Unsolvable(ValueError):
    """A survey that tells nothing; the message says why."""


class Surveyed(NamedTuple):
    """A room as found.

    room: stations and windows. placed (S,): stations that were found. used (W,): windows that were used. covariance:
    (6 S, 6 S) of the stations' (d_s, dt_s), zero where held; rows of stations that are not placed are infinite.
    term_sigma: (S, 2, TERMS), 0 where not adjusted. systematic_rad: what residuals have beyond noise. residual: raw
    residuals of all rows (M,), NaN of windows and stations left out. solution, problem: of the last solve. agreement
    (S,): share of the windows by themselves that agree with a station's place. rows: as given, but for stations that
    moved: from move i on, station steps[i].station has the index S_0 + i, S_0 the number that was given. moving: (W,).
    """

    room: Room
    placed: Bools
    used: Bools
    covariance: Floats
    term_sigma: Floats
    systematic_rad: float
    residual: Floats
    solution: Solution
    problem: Problem
    agreement: Floats
    rows: Rows
    steps: tuple[Step, ...]
    moving: Bools

    def position_sigma(self, station: int) -> Floats:
        """Return standard deviations of a station's position along the world's axes (3,) [m]."""
        out: Floats = np.sqrt(np.diagonal(self.covariance)[6 * station + 3 : 6 * station + 6])
        return out

    def rotation_sigma(self, station: int) -> Floats:
        """Return standard deviations of a station's turn about the world's axes (3,) [rad]."""
        out: Floats = np.sqrt(np.diagonal(self.covariance)[6 * station : 6 * station + 3])
        return out


def survey(
    rows: Rows,
    moving: Bools,
    errors: tuple[tuple[Errors, Errors], ...],
    normals: Floats | None = None,
    *,
    time_s: Floats | None = None,
    parts: Sequence[str] = (),
    hold: Room | None = None,
) -> Surveyed:
    """Return where stations stand, in the frame of the first that sees an object.

    Args:
        rows: of W windows.
        moving: (W,).
        errors: of both fans of each station, S of them.
        normals: of each row's photodiode in its object's frame, (M, 3), if known.
        time_s: of the windows (W,), in which stations that were moved are looked for; None: nowhere.
        parts: terms that are adjusted, too, names of `estimators.survey.terms.PARTS`.
        hold: stations whose poses stay as they are here; only objects, and terms if wanted, are adjusted.

    Raises:
        Unsolvable: no station sees an object whose pose is decided.
    """
    found = start(rows, moving, errors, normals, hold)
    if not np.any(found.solved):
        raise Unsolvable("no station sees four photodiodes of an object by both fans")
    steps: list[Step] = []
    while True:
        free = found.placed & (np.arange(len(found.placed)) != found.root)
        if hold is not None:
            free[:] = False
        chosen = Free(free, parts=tuple(parts))
        problem, mine = _problem(rows, moving, found.placed, found.solved, chosen, found.room, SYSTEMATIC_RAD)
        wide = solve(problem, found.room, scale=10.0)
        step = None if time_s is None or len(steps) >= MOST_STEPS else find_step(problem, wide.room, time_s)
        if step is None or time_s is None:
            break
        rows, found = _divided(rows, found, wide.room, time_s, step)
        errors = (*errors, errors[step.station])
        steps.append(step)
    room, used = _retried(rows, moving, found, errors, mine, solve(problem, wide.room))
    systematic = SYSTEMATIC_RAD
    for _ in range(_ROUNDS):
        problem, mine = _problem(rows, moving, found.placed, used, chosen, room, systematic)
        solution = solve(problem, room)
        room, before = solution.room, systematic
        systematic = _systematic(rows.of(mine), problem, solution, systematic)
        if abs(systematic - before) < _SAME * before:
            break
    problem, mine = _problem(rows, moving, found.placed, used, chosen, room, systematic)
    return concluded(problem, solve(problem, room), rows, mine, found, used, systematic, tuple(steps))


def _divided(rows: Rows, found: Start, room: Room, time_s: Floats, step: Step) -> tuple[Rows, Start]:
    """Return rows and start with a station that is another one, the last, from a move on."""
    s, new = step.station, len(found.placed)
    later = time_s[rows.window] >= time_s[step.window]
    divided = rows._replace(station=np.where((rows.station == s) & later, new, rows.station))
    grown = replace(
        room,
        rotation=np.concatenate([room.rotation, (rot.exp(step.shift[:3]) @ room.rotation[s])[None]]),
        position=np.concatenate([room.position, (room.position[s] + step.shift[3:])[None]]),
        terms=np.concatenate([room.terms, room.terms[s : s + 1]]),
        like=(*room.like, room.like[s]),
    )
    placed = np.append(found.placed, True)
    return divided, found._replace(room=grown, placed=placed, agreement=np.append(found.agreement, np.nan))


def with_truth(before: Surveyed, truth: Truth, turn: Floats, shift: Floats) -> Surveyed:
    """Return a survey in the frame of another system, whose places join as measurements.

    Args:
        before: the survey without it.
        truth: places of the markers.
        turn: (3, 3), brings `before` near to the truth's frame: x' = turn x + shift.
        shift: (3,) [m].
    """
    room = replace(moved(before.room, turn, shift), lever=np.zeros((truth.markers, 3)))
    free = Free(before.placed, parts=before.problem.free.parts)
    problem, mine = _problem(
        before.rows, before.moving, before.placed, before.used, free, room, before.systematic_rad, truth
    )
    solution = solve(problem, solve(problem, room, scale=10.0).room)
    found = Start(solution.room, before.placed, before.used, before.agreement, 0)
    out = concluded(problem, solution, before.rows, mine, found, before.used, before.systematic_rad, before.steps)
    return out._replace(covariance=_against_first(out))


def _against_first(found: Surveyed) -> Floats:
    """Return the covariance of the stations' poses against the first one's, (6 S, 6 S)."""
    first = int(np.argmax(found.placed))
    size = len(found.covariance)
    change = np.eye(size)
    own = slice(6 * first, 6 * first + 6)
    for s in range(size // 6):
        arm = found.room.position[s] - found.room.position[first]
        block = np.eye(6)
        block[3:, :3] = -rot.skew(arm)
        change[6 * s : 6 * s + 6, own] -= block
    finite = np.where(np.isfinite(found.covariance), found.covariance, 0.0)
    out: Floats = change @ finite @ change.T
    lost = np.flatnonzero(~np.isfinite(np.diagonal(found.covariance)))
    out[lost, lost] = np.inf
    return out


def moved(room: Room, turn: Floats, shift: Floats) -> Room:
    """Return a room in another frame, x' = turn x + shift.

    Args:
        room: in its own frame.
        turn: (3, 3).
        shift: (3,) [m].
    """
    return replace(
        room,
        rotation=turn @ room.rotation,
        position=room.position @ turn.T + shift,
        window_rotation=turn @ room.window_rotation,
        window_position=room.window_position @ turn.T + shift,
        rate=room.rate @ turn.T,
        velocity=room.velocity @ turn.T,
    )


def turned_covariance(covariance: Floats, turn: Floats) -> Floats:
    """Return the covariance (6 S, 6 S) in a frame that is turned by (3, 3)."""
    whole = np.kron(np.eye(len(covariance) // 3), turn)
    # 0 times infinity is no number: stations that are not placed stay infinite.
    finite = np.where(np.isfinite(covariance), covariance, 0.0)
    out: Floats = whole @ finite @ whole.T
    lost = ~np.isfinite(np.diagonal(covariance))
    out[lost, lost] = np.inf
    return out


def _problem(
    rows: Rows,
    moving: Bools,
    placed: Bools,
    used: Bools,
    free: Free,
    room: Room,
    systematic: float,
    truth: Truth | None = None,
) -> tuple[Problem, Bools]:
    """Return the problem of what is placed and used, and its rows (M,)."""
    mine = placed[rows.station] & used[rows.window]
    known = rows.of(mine)
    known = known._replace(own=np.hypot(known.own, systematic))
    if truth is not None:
        truth = truth._replace(place=np.where(used[:, None], truth.place, np.nan))
    return Problem(known, moving, free, room, truth), mine


def _retried(
    rows: Rows,
    moving: Bools,
    found: Start,
    errors: tuple[tuple[Errors, Errors], ...],
    mine: Bools,
    solution: Solution,
) -> tuple[Room, Bools]:
    """Return the room with other poses where they fit better, and the windows that are used."""
    windows, room, used = len(moving), solution.room, found.solved
    size = _rms(rows.window[mine], solution.residual, windows)
    # Where all fit badly, the calibration is to blame, and no window.
    limit = BAD_WINDOW * max(1.0, float(np.median(size[used])))
    bad = used & (size > limit)
    if not np.any(bad):
        return room, used
    rotation, position, usable = world_candidates(
        candidates(rows.of(bad[rows.window]), windows, errors, None), room, found.placed
    )
    again = found.placed[rows.station] & bad[rows.window]
    better, solved = best_of(rows.of(again), moving, room, rotation, position, usable & bad[:, None])
    trial = replace(
        room,
        window_rotation=np.where(solved[:, None, None], better.window_rotation, room.window_rotation),
        window_position=np.where(solved[:, None], better.window_position, room.window_position),
    )
    nothing = np.zeros(len(room.position), dtype=np.bool_)
    known = rows.of(again)
    check = Problem(known._replace(own=np.hypot(known.own, SYSTEMATIC_RAD)), moving, Free(nothing), trial)
    settled = solve(check, trial, rounds=15)
    still = _rms(rows.window[again], settled.residual, windows) > limit
    kept = int(np.count_nonzero(used & ~still))
    if 2 * kept < int(np.count_nonzero(used)):
        # Most windows fit badly: it is the stations, not the windows, and nothing is gained by leaving them out.
        return settled.room, used
    return settled.room, used & ~still


def _rms(window: Ints, residual: Floats, windows: int) -> Floats:
    square = np.minimum(np.abs(residual), CUT) ** 2
    count = np.bincount(window, minlength=windows)
    out: Floats = np.sqrt(np.bincount(window, square, minlength=windows) / np.maximum(count, 1))
    return out


def _systematic(rows: Rows, problem: Problem, solution: Solution, before: float) -> float:
    """Return the standard deviation that makes the residuals as large as they should be [rad]."""
    freedom = degrees_of_freedom(problem, solution)
    if freedom < 3:
        return before
    # What a whitened residual has lost to the rotor's shared part, it has lost at any size of this one.
    share = solution.weight * (solution.residual * problem.rows.own) ** 2

    def excess(value: float) -> float:
        return float(np.sum(share / (rows.own**2 + value**2))) - freedom

    if excess(0.0) <= 0:
        return 0.0
    high = 1e-3
    return high if excess(high) > 0 else float(brentq(excess, 0.0, high, xtol=1e-8))


def concluded(
    problem: Problem,
    solution: Solution,
    rows: Rows,
    mine: Bools,
    found: Start,
    used: Bools,
    systematic: float,
    steps: tuple[Step, ...],
) -> Surveyed:
    """Return the result of a solution.

    Args:
        problem: what was solved.
        solution: its solution.
        rows: all.
        mine: (M,), the rows that it has.
        found: the start.
        used: (W,).
        systematic: [rad].
        steps: moves of stations.
    """
    stations = len(found.placed)
    freedom = degrees_of_freedom(problem, solution)
    excess = float(np.sum(solution.weight * solution.residual**2)) / freedom if freedom >= 3 else 1.0
    shared = shared_covariance(problem, solution) * max(excess, 1.0)
    covariance = np.zeros((6 * stations, 6 * stations))
    at = problem.station_at
    own = [s for s in range(stations) if at[s] >= 0]
    places = np.array([at[s] - problem.shared_at + i for s in own for i in range(6)], dtype=np.int64)
    target = np.array([6 * s + i for s in own for i in range(6)], dtype=np.int64)
    covariance[np.ix_(target, target)] = shared[np.ix_(places, places)]
    for s in np.flatnonzero(~found.placed):
        covariance[6 * s : 6 * s + 6, 6 * s : 6 * s + 6] = np.diag(np.full(6, np.inf))
    residual = np.full(len(mine), np.nan)
    residual[mine] = solution.raw
    return Surveyed(
        solution.room,
        found.placed,
        used,
        covariance,
        problem.term_sigma(shared),
        systematic,
        residual,
        solution,
        problem,
        found.agreement,
        rows,
        steps,
        problem.moving,
    )


def by_each(found: Surveyed) -> tuple[Floats, Floats]:
    """Return the objects' poses by each station's light alone, (S, W, 3, 3) and (S, W, 3) [m], NaN where it tells none.

    Each starts from the pose that all stations told, so that no mirror comes in.
    """
    stations, windows = len(found.placed), len(found.used)
    rotation, position = np.full((stations, windows, 3, 3), np.nan), np.full((stations, windows, 3), np.nan)
    nothing = Free(np.zeros(stations, dtype=np.bool_))
    for s in range(stations):
        enough = np.bincount(found.rows.window[found.rows.station == s], minlength=windows) >= FEWEST_ROWS_ALONE
        mine = (found.rows.station == s) & (found.used & enough)[found.rows.window]
        if not found.placed[s] or not np.any(mine):
            continue
        rows = found.rows.of(mine)
        problem = Problem(
            rows._replace(own=np.hypot(rows.own, found.systematic_rad)), found.moving, nothing, found.room
        )
        alone = solve(problem, found.room, rounds=20).room
        some = np.unique(rows.window)
        rotation[s, some], position[s, some] = alone.window_rotation[some], alone.window_position[some]
    return rotation, position


def disagreement(found: Surveyed) -> tuple[Floats, Floats]:
    """Return the largest distance [m] and turn [rad] between two stations' poses of the object per window, (W,) each;
    NaN where fewer than two tell one.
    """
    rotation, position = by_each(found)
    apart, turned = np.full(len(found.used), np.nan), np.full(len(found.used), np.nan)
    for i in range(len(position)):
        for j in range(i):
            distance = np.linalg.norm(position[i] - position[j], axis=1)
            both = np.isfinite(distance)
            relative = np.einsum("wij,wkj->wik", rotation[i][both], rotation[j][both])
            apart[both] = np.fmax(apart[both], distance[both])
            turned[both] = np.fmax(turned[both], np.linalg.norm(rot.log(relative), axis=1))
    return apart, turned
