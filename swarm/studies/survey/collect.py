"""Recordings as the input of a survey: the windows of all objects in all files, and what is known of the stations."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.lighthouse.sweep import FanErrors
from estimators.lighthouse.tilted import TiltedErrors
from estimators.survey.problem import Rows
from estimators.survey.terms import Errors
from estimators.survey.windows import MOST, OWN_RAD, Cut, Seen, cut, join
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.recordings.contents import contents
from swarm.flight.recordings.formats import Format, format_of
from swarm.flight.recordings.object_light import ObjectLight, read_object
from swarm.flight.recordings.stations_file import MOST_STATIONS, PlacedStation, PlacedStations

LEAST_WINDOWS = 20
"""Moving windows that every object of every file may have, however many files there are."""
FIRST_TURN_S = 1 / 60
"""Duration of a turn of a Lighthouse 1.0 rotor [s]."""
_GAP_S = 1000.0
"""Time between two files on the survey's own clock [s]: their order is the order of their names."""


class Known(NamedTuple):
    """A station as it is known beforehand. place: its pose, None if not known. source: where that stands."""

    number: int
    generation: str
    name: str
    identity: str | None
    errors: tuple[Errors, Errors]
    calibrated: bool
    place: PlacedStation | None
    source: str


class ObjectWindows(NamedTuple):
    """The windows of one object of one file. number: of the file. first, last: its windows among all, last excluded."""

    light: ObjectLight
    cut: Cut
    file: int
    first: int
    last: int


class Collected(NamedTuple):
    """All windows of a survey.

    rows: of W windows. moving (W,). normals (M, 3): of each row's photodiode. stations: in order of their numbers; rows
    have their indices. objects: of all files. time_s (W,): middles of the windows on one clock for all files. notes:
    sentences about the recordings.
    """

    rows: Rows
    moving: Bools
    normals: Floats
    stations: list[Known]
    objects: list[ObjectWindows]
    time_s: Floats
    notes: list[str]

    @property
    def errors(self) -> tuple[tuple[Errors, Errors], ...]:
        """Return the errors of both fans of each station."""
        return tuple(station.errors for station in self.stations)


def collect(
    files: Sequence[Path],
    object_name: str | None = None,
    calibration: Path | None = None,
    start: PlacedStations | None = None,
    *,
    alone: bool = False,
    most: int | None = None,
    span: tuple[float, float] = (0.0, 1.0),
    rest: bool = True,
) -> Collected:
    """Return the windows of recordings.

    Args:
        files: libsurvive's recordings and Crazyflies' logs.
        object_name: the only object to take, None for all.
        calibration: libsurvive's configuration, for recordings without one beside them.
        start: stations as a file of ours has them; they take the place of what the recordings say.
        alone: whether one station by itself is enough, as it is where a truth goes with it.
        most: moving windows of an object, None: as many as all files together may have.
        span: the part of each recording that is taken, begin and end as shares of its duration.
        rest: whether stretches at rest become one window each; else all is cut as if it moved.

    Raises:
        SwarmError: a file cannot be read, or no object saw enough light.
    """
    lights, notes = _lights(files, object_name, calibration)
    stations = _stations(lights, start)
    index = {station.number: i for i, station in enumerate(stations)}
    most = max(LEAST_WINDOWS, MOST // max(len(lights), 1)) if most is None else most
    if len(stations) < 2 and not alone:
        raise SwarmError(
            f"{', '.join(map(str, files))}: only {stations[0].name} was seen, and how stations stand against each "
            "other takes two; with --truth one station's place is found, too"
        )
    seen_by = min(2, len(stations))
    objects: list[ObjectWindows] = []
    parts: list[Rows] = []
    normals: list[Floats] = []
    times: list[Floats] = []
    windows = sweeps = 0
    for number, light in lights:
        found = _cut(light, index, stations, seen_by, most, span, rest=rest)
        count = len(found.moving)
        if not count:
            notes.append(f"{light.path}: {light.name!r}: no window that {seen_by} stations saw; it is left out")
            continue
        objects.append(ObjectWindows(light, found, number, windows, windows + count))
        rows = found.rows
        parts.append(rows._replace(window=rows.window + windows, sweep=rows.sweep + sweeps))
        normals.append(light.photodiodes.normal[0][rows.photodiode])
        begin = float(light.time_s(np.array(light.light.hits.tick[0])))
        times.append((found.begin_s + found.end_s) / 2 - begin + number * _GAP_S)
        windows, sweeps = windows + count, int(parts[-1].sweep.max()) + 1
    if not objects:
        raise SwarmError(_nothing(files, seen_by, stations))
    moving = np.concatenate([part.cut.moving for part in objects])
    return Collected(join(parts), moving, np.concatenate(normals), stations, objects, np.concatenate(times), notes)


def _nothing(files: Sequence[Path], seen_by: int, stations: list[Known]) -> str:
    names = ", ".join(map(str, files))
    if seen_by < 2:
        return f"{names}: no window in which an object saw three photodiodes' light by both fans"
    numbers = ", ".join(station.name for station in stations)
    return (
        f"{names}: no moment in which an object saw two stations at once (there are {numbers}), and only such moments "
        "tell how stations stand against each other"
    )


def _lights(
    files: Sequence[Path], object_name: str | None, calibration: Path | None
) -> tuple[list[tuple[int, ObjectLight]], list[str]]:
    """Return the light of every object with the number of its file, and what is to be said of the files."""
    out: list[tuple[int, ObjectLight]] = []
    notes: list[str] = []
    names: list[str] = []
    for number, file in enumerate(files):
        own = _objects(file)
        names += own
        for name in own:
            if object_name is not None and name != object_name:
                continue
            light = read_object(file, name, "pulses", calibration)
            out.append((number, light))
            notes += [f"{file.name}, {name}: {note}" for note in light.notes]
    if not out:
        there = f"{did_you_mean(object_name, names)}" if object_name is not None else ""
        raise SwarmError(f"{', '.join(map(str, files))}: no object {object_name!r} saw light{there}")
    return out, notes


def _objects(file: Path) -> list[str]:
    """Return the names of the objects that saw light."""
    kind = format_of(file)
    if kind not in (Format.LIBSURVIVE, Format.CRAZYFLIE):
        raise SwarmError(f"{file}: a {kind}, which goes with a recording but is none")
    found = contents(file)
    names = list(dict.fromkeys(row.name for row in found.rows if row.station is not None))
    if not names:
        remark = next((f": object {row.name!r}: {row.remark}" for row in found.rows if row.remark), "")
        raise SwarmError(f"{file}: no object in it saw a station{remark}")
    return names


def _stations(lights: list[tuple[int, ObjectLight]], start: PlacedStations | None) -> list[Known]:
    """Return the stations of all files, in order of their numbers."""
    found: dict[int, Known] = {}
    for _, light in lights:
        for number in light.light.stations():
            one = _known(light, number, start)
            before = found.get(number)
            if before is not None and before.generation != one.generation:
                raise SwarmError(
                    f"station {number} is of Lighthouse {before.generation} in {before.source} and of "
                    f"{one.generation} in {light.path}: survey them one after the other"
                )
            if before is not None and None not in (before.identity, one.identity) and before.identity != one.identity:
                raise SwarmError(
                    f"station {number} has the id {before.identity} in {before.source} and {one.identity} in "
                    f"{light.path}: these are two stations"
                )
            if before is None or (one.place is not None and before.place is None):
                found[number] = one
    if len(found) > MOST_STATIONS:
        raise SwarmError(f"{len(found)} stations, and at most {MOST_STATIONS} are possible")
    return [found[number] for number in sorted(found)]


def _known(light: ObjectLight, number: int, start: PlacedStations | None) -> Known:
    generation = light.light.generation
    place, source = light.placed.get(number), str(light.path)
    given = start.numbered(number) if start is not None else None
    if given is not None:
        if given.generation != generation:
            raise SwarmError(
                f"--stations: {given.name!r} is of Lighthouse {given.generation}, but station {number} in {light.path} "
                f"is of {generation}"
            )
        place, source = given, f"{start.frame if start else ''}"
    perfect: Errors = TiltedErrors() if generation == "2.0" else FanErrors()
    errors = given.errors if given is not None else light.errors.get(number, (perfect, perfect))
    name = place.name if place is not None else f"channel {number}" if generation == "2.0" else f"station {number}"
    identity = given.identity if given is not None else light.identities.get(number)
    calibrated = given is not None or number in light.errors
    return Known(number, generation, name, identity, errors, calibrated, place, source)


def _cut(
    light: ObjectLight,
    index: dict[int, int],
    stations: list[Known],
    seen_by: int,
    most: int,
    span: tuple[float, float],
    *,
    rest: bool,
) -> Cut:
    """Return the windows of one object.

    Args:
        light: of the object.
        index: of each station's number.
        stations: in order of their indices.
        seen_by: stations that must see a window.
        most: moving windows at most.
        span: the part of the recording.
        rest: whether stretches at rest are averaged.
    """
    hits = light.light.hits
    station: Ints = np.array([index[number] for number in hits.station.tolist()], dtype=np.int64)
    seen = Seen(light.time_s(hits.tick), station, hits.fan, hits.photodiode, hits.angle)
    seen = seen.of(np.argsort(seen.time_s, kind="stable"))
    if span != (0.0, 1.0):
        begin, end = (seen.time_s[0] + share * (seen.time_s[-1] - seen.time_s[0]) for share in span)
        seen = seen.of((seen.time_s >= begin) & (seen.time_s <= end))
    turn = np.array([light.light.turn_s.get(known.number, FIRST_TURN_S) for known in stations])
    own = np.array([OWN_RAD[known.generation] for known in stations])
    point = light.photodiodes.point_m[0]
    return cut(seen, point, turn, own, stations=seen_by, most=most, rest=rest)
