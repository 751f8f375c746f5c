"""A survey from collected windows: adjustment, truth, and the frame in which the result is told."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from estimators.survey.problem import Room, Rows, Truth, room_of
from estimators.survey.survey import Surveyed, Unsolvable, disagreement, moved, survey, turned_covariance, with_truth
from swarm.errors import SwarmError
from swarm.flight.recordings.alignment import (
    LEAST_SPREAD_M,
    Alignment,
    Clock,
    agreed,
    align,
    clock_of_marks,
    interpolated,
)
from swarm.flight.recordings.trajectory import Trajectory, read_trajectory
from swarm.studies.survey.collect import Collected, Known, ObjectWindows

TRUTH_M = 1.5e-3
"""Standard deviation of a coordinate of a motion capture system [m], with its clock's error."""
FEWEST_PLACES = 3
STILL_M = 2e-3
"""Spread of a truth that keeps to one place [m]."""
SAMPLE_S = 0.1
"""Distance of the samples in time that a stretch at rest gives for the alignment of the clocks [s]."""
SHIFT_RAD = 1e-4
"""Median shift of a resting object's angles up to which their station has not moved [rad]."""


class Told(NamedTuple):
    """A move of a station in words, and the index of the station after it."""

    words: str
    station: int
    after: int


class Result(NamedTuple):
    """A survey's result.

    collected: its input. found: stations and windows, in the final frame. covariance: of the stations' poses there.
    frame: whose axes these are. before, after: median absolute residual per station [rad] (S,), NaN where not known:
    with the stations as the files have them, and as found. apart_before, apart_after: median disagreement of two
    stations' poses of the object, (distance [m], turn [rad]). moves, notes: in words.
    """

    collected: Collected
    found: Surveyed
    covariance: Floats
    frame: str
    before: Floats
    after: Floats
    apart_before: tuple[float, float]
    apart_after: tuple[float, float]
    moves: list[Told]
    notes: list[str]


def solve_survey(collected: Collected, truths: Sequence[Path] = (), parts: Sequence[str] = ()) -> Result:
    """Return the survey of collected windows.

    Args:
        collected: the windows.
        truths: trajectories from another system, one per file and in their order.
        parts: error terms of the fans that are adjusted, too.

    Raises:
        SwarmError: the light tells nothing, or a truth does not fit.
    """
    # Read first: a mistake in them is said at once.
    trajectories = [read_trajectory(path) for path in truths]
    try:
        found = survey(
            collected.rows,
            collected.moving,
            collected.errors,
            collected.normals,
            time_s=collected.time_s,
            parts=parts,
        )
    except Unsolvable as error:
        raise SwarmError(f"{collected.objects[0].light.path}: {error}") from None
    notes = list(collected.notes)
    lost = np.flatnonzero(~found.placed[: len(collected.stations)])
    for s in lost.tolist():
        name = collected.stations[s].name
        notes.append(f"{name} never sees an object together with another station; it has no place")
    dropped = len(found.used) - int(np.count_nonzero(found.used))
    if dropped:
        notes.append(f"windows whose light fits no pose, left out: {dropped} of {len(found.used)}")
    before, apart_before = _before(collected, parts)
    frame, covariance = "", found.covariance
    if truths:
        joined = _with_truths(collected, found, trajectories, notes)
        if joined is not None:
            found, frame, covariance = joined, truths[0].name, joined.covariance
    if not frame:
        found, covariance, frame = _in_known_frame(collected, found)
    apart, turned = disagreement(found)
    return Result(
        collected,
        found,
        covariance,
        frame,
        before,
        _medians(found.rows.station, found.residual, len(found.placed)),
        apart_before,
        (_median(apart), _median(turned)),
        _moves(collected, found),
        notes,
    )


def _median(values: Floats) -> float:
    kept = values[np.isfinite(values)]
    return float(np.median(kept)) if len(kept) else float("nan")


def _medians(station: Ints, residual: Floats, stations: int) -> Floats:
    return np.array([_median(np.abs(residual[station == s])) for s in range(stations)])


def known_room(stations: list[Known]) -> Room | None:
    """Return the stations where the files have them, None unless all have a place."""
    places = [station.place for station in stations]
    poses = [(p.rotation, p.position, s.errors) for p, s in zip(places, stations, strict=True) if p is not None]
    if len(poses) != len(stations):
        return None
    return room_of(poses, np.zeros((0, 3, 3)), np.zeros((0, 3)))


def _before(collected: Collected, parts: Sequence[str]) -> tuple[Floats, tuple[float, float]]:
    """Return the residuals and the disagreement with the stations as the files have them."""
    stations = len(collected.stations)
    nothing = np.full(stations, np.nan), (float("nan"), float("nan"))
    room = known_room(collected.stations)
    if room is None:
        return nothing
    try:
        held = survey(collected.rows, collected.moving, collected.errors, collected.normals, hold=room)
    except Unsolvable:
        return nothing
    apart, turned = disagreement(held)
    return _medians(held.rows.station, held.residual, stations), (_median(apart), _median(turned))


def _in_known_frame(collected: Collected, found: Surveyed) -> tuple[Surveyed, Floats, str]:
    """Return the survey in the frame of the stations' known poses, or else in that of the first station."""
    known = [
        (s, station.place)
        for s, station in enumerate(collected.stations)
        if station.place is not None and found.placed[s]
    ]
    first = int(np.argmax(found.placed))
    if not known:
        return found, found.covariance, f"{collected.stations[first].name}"
    turns = np.array([place.rotation @ found.room.rotation[s].T for s, place in known])
    turn = rot.mean_rotation(turns)
    shift = np.mean([place.position - turn @ found.room.position[s] for s, place in known], axis=0)
    out = found._replace(room=moved(found.room, turn, shift))
    return (
        out,
        turned_covariance(found.covariance, turn),
        f"the stations' known poses of {Path(collected.stations[known[0][0]].source).name}",
    )


def _with_truths(
    collected: Collected, found: Surveyed, truths: Sequence[Trajectory], notes: list[str]
) -> Surveyed | None:
    """Return the survey in the truth's frame, None where it has too few places to tell its frame."""
    files = sorted({part.file for part in collected.objects})
    if len(truths) <= max(files):
        raise SwarmError(
            f"--truth: {len(truths)} given for {max(files) + 1} recordings; give one for each, in their order"
        )
    place = np.full((len(found.used), 3), np.nan)
    marker = np.zeros(len(found.used), dtype=np.int64)
    names = list(dict.fromkeys(part.light.name for part in collected.objects))
    for part in collected.objects:
        marker[part.first : part.last] = names.index(part.light.name)
        place[part.first : part.last] = _places(part, found, truths[part.file], notes)
    known = np.isfinite(place).all(axis=1) & found.used
    spread = np.linalg.svd(place[known] - place[known].mean(axis=0), compute_uv=False) if np.any(known) else np.zeros(3)
    if np.count_nonzero(known) < FEWEST_PLACES or spread[1] < LEAST_SPREAD_M:
        notes.append(
            f"the truth has {np.count_nonzero(known)} places, too few or all in a line: at least {FEWEST_PLACES} that "
            f"span {1e3 * LEAST_SPREAD_M:.0f} mm fix a frame; it is left aside"
        )
        return None
    turn, shift = agreed(found.room.window_position[known], place[known])
    truth = Truth(place, marker, TRUTH_M)
    out = with_truth(found, truth, turn, shift)
    away = place - out.room.window_position
    away -= np.einsum("wij,wj->wi", out.room.window_rotation, out.room.lever[marker])
    distance = np.linalg.norm(away[known], axis=1)
    notes.append(
        f"the truth has {np.count_nonzero(known)} of the windows' places: distance {1e3 * np.median(distance):.1f} mm "
        f"median, {1e3 * distance.max():.1f} mm at most, a marker at "
        + "; ".join(f"({', '.join(f'{1e3 * x:+.1f}' for x in lever)}) mm" for lever in out.room.lever)
    )
    return out


def _places(part: ObjectWindows, found: Surveyed, truth: Trajectory, notes: list[str]) -> Floats:
    """Return the truth's places of the windows of one object (n, 3) [m], NaN where it has none."""
    count = part.last - part.first
    own = slice(part.first, part.last)
    if float(np.linalg.norm(np.ptp(truth.position, axis=0))) < STILL_M:
        return np.tile(truth.position.mean(axis=0), (count, 1))
    marks = part.light.marks_s
    position = np.where(found.used[own][:, None], found.room.window_position[own], np.nan)
    still = float(np.linalg.norm(np.ptp(position[found.used[own]], axis=0))) < LEAST_SPREAD_M if count else True
    clock = clock_of_marks(marks, truth)
    if not still:
        repeated = np.maximum(((part.cut.end_s - part.cut.begin_s) / SAMPLE_S).astype(np.int64), 1)
        which = np.repeat(np.arange(count), repeated)
        # A stretch at rest is many samples: it says when the object came and went.
        within = np.concatenate([(np.arange(n) + 0.5) / n for n in repeated.tolist()])
        times = part.cut.begin_s[which] + within * (part.cut.end_s - part.cut.begin_s)[which]
        aligned = align(times, position[which], found.room.window_rotation[own][which], truth, marks)
        notes.extend(f"{part.light.path.name}: {text}" for text in _of_clock(aligned))
        clock = aligned.clock
    if clock is None:
        notes.append(f"{truth.path}: it moves and the object does not, and no marks tell its time; it is left aside")
        return np.full((count, 3), np.nan)
    return np.array([_place(truth, clock, b, e) for b, e in zip(part.cut.begin_s, part.cut.end_s, strict=True)])


def _of_clock(aligned: Alignment) -> list[str]:
    return aligned.sentences()[:1]


def _place(truth: Trajectory, clock: Clock, begin_s: float, end_s: float) -> Floats:
    """Return the place (3,) [m] in a window, the median of a stretch at rest, NaN where the truth has a gap in it."""
    times = np.linspace(begin_s, end_s, 9) if end_s - begin_s > 0.2 else np.array([(begin_s + end_s) / 2])
    places = interpolated(truth, clock.of(times))
    seen = np.isfinite(places).all(axis=1)
    return np.median(places[seen], axis=0) if 2 * np.count_nonzero(seen) > len(times) else np.full(3, np.nan)


def _moves(collected: Collected, found: Surveyed) -> list[Told]:
    """Return the moves of stations in words."""
    out = []
    given = len(collected.stations)
    now = list(range(given))
    for i, step in enumerate(found.steps):
        original = step.station
        while original >= given:
            original = found.steps[original - given].station
        old, new = step.station, given + i
        now[original] = new
        way = float(np.linalg.norm(found.room.position[new] - found.room.position[old]))
        turn = float(np.linalg.norm(rot.log((found.room.rotation[new] @ found.room.rotation[old].T)[None])))
        who, when = _who(collected, original, step.window), _when(collected, step.window)
        words = f"{who} before {when}: by {1e3 * way:.0f} mm and {np.degrees(turn):.2f} deg; its place is that after it"
        out.append(Told(words, original, new))
    return out


def _when(collected: Collected, window: int) -> str:
    part = next(p for p in collected.objects if p.first <= window < p.last)
    at = float(part.cut.begin_s[window - part.first] - part.light.time_s(np.array(part.light.light.hits.tick[0])))
    return f"{max(at, 0.0):.1f} s of {part.light.path.name}"


def _who(collected: Collected, moved_: int, window: int) -> str:
    """Return which station moved, as far as an object at rest tells."""
    stations, name = collected.stations, collected.stations[moved_].name
    if len(stations) > 2:
        return f"{name} was moved"
    other = 1 - moved_
    rows, order = collected.rows, np.argsort(collected.time_s, kind="stable")
    at = int(np.flatnonzero(order == window)[0])
    if at > 0 and not collected.moving[order[at]] and not collected.moving[order[at - 1]]:
        shift = [_jump(rows, s, int(order[at - 1]), int(order[at])) for s in (moved_, other)]
        if min(shift) < SHIFT_RAD < max(shift):
            return f"{stations[(moved_, other)[int(np.argmax(shift))]].name} was moved"
    return f"{name} and {stations[other].name} were moved against each other"


def _jump(rows: Rows, station: int, before: int, after: int) -> float:
    """Return the median shift of a station's streams from one window at rest to the next [rad]."""
    values: list[dict[tuple[int, int], float]] = []
    for window in (before, after):
        mine = np.flatnonzero((rows.station == station) & (rows.window == window))
        keys = zip(rows.fan[mine].tolist(), rows.photodiode[mine].tolist(), strict=True)
        values.append(dict(zip(keys, rows.angle[mine].tolist(), strict=True)))
    both = set(values[0]) & set(values[1])
    return float(np.median([abs(values[1][k] - values[0][k]) for k in both])) if both else float("inf")
