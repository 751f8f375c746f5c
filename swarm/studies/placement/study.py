"""`swarm place` from request to files: search, bound, judge against even spreads and all candidates, write.

A placement leaves, beside each other: the stations (TOML, `swarm.flight.recordings.stations_file`), and with `-place`
in their names the figures (JSON) and the picture (PNG and SVG).
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimators.layout.error import percentile
from estimators.lighthouse.sweep import FanErrors
from estimators.lighthouse.tilted import TiltedErrors
from estimators.placement.search import errors
from swarm.errors import SwarmError, did_you_mean
from swarm.figures import save
from swarm.flight.recordings.stations_file import PlacedStation, PlacedStations, stations_text
from swarm.results.disk import outputs, refuse_existing
from swarm.studies.design.even import even_spreads
from swarm.studies.placement.candidates import Stand
from swarm.studies.placement.figure import draw
from swarm.studies.placement.judgement import bound, judge, sample, together
from swarm.studies.placement.refusal import most_new, needed, refuse_uncovered
from swarm.studies.placement.report import ALL, EVEN, PLACED, STANDING, figures, where
from swarm.studies.placement.request import Request, checked, in_scene
from swarm.studies.placement.search import Found, Places, find, places
from swarm.studies.placement.task import Task
from swarm.tables import counted

EVENS = 8
"""Even spreads that are tried, from as many first places; the most even one is compared."""
GRID_M = 1e-4
"""Positions are rounded to so much: what is judged is what the file says [m]."""


class Placement(NamedTuple):
    """A placement that was found and written. figures: as in the JSON. stations: in the file's order, those that stood
    already first. files: paths of what was written.
    """

    figures: dict[str, Any]
    stations: tuple[PlacedStation, ...]
    files: tuple[Path, ...]


def place(
    subject: str,
    *,
    out: Path | None = None,
    force: bool = False,
    seed: int = 0,
    say: Callable[[str], None] = lambda text: None,
    **wanted: Any,
) -> Placement:
    """Find where stations should stand, and write the places.

        swarm.place("mockup", stations=2, volume="-1,1,-1,1,0,2", room="-3,3,-3,3,0,3")

    Args:
        subject: model or scenario.
        out: file of the stations; None: below runs/.
        force: replace files that are there.
        seed: seed of the search.
        say: is told what is going on.
        **wanted: the other fields of `swarm.studies.placement.request.Request`.

    Raises:
        SwarmError: something is wrong, or there is no such placement; nothing is written then.
    """
    for key in wanted:
        if key not in Request._fields:
            raise SwarmError(f"place: unknown argument {key!r}{did_you_mean(key, Request._fields)}")
    return study(Request(subject, **wanted), out, force, say, seed)


def study(request: Request, out: Path | None, force: bool, say: Callable[[str], None], seed: int = 0) -> Placement:
    """Find a placement and write it.

    Args:
        request: what the user asks for.
        out: file of the stations; None: below runs/.
        force: replace files that are there.
        say: is told what is going on.
        seed: seed of the search.

    Raises:
        SwarmError: something is wrong, or there is no such placement; nothing is written then.
    """
    made = checked(request)
    request, task = made.request, made.task
    out = _default_out(request) if out is None else out
    files = files_of(out)
    if out.suffix != ".toml":
        raise SwarmError(f"--out {out}: the file of the stations must end in .toml")
    refuse_existing(*files, force=force)
    if made.settings is not None:
        say(f"flying {request.subject} by the truth")
        task = in_scene(request, made)

    say("places for stations")
    at = places(task)
    found = _found(request, task, at, say, seed)
    count = len(found.stands)
    say("bounding and judging")
    poses = sample(task)
    least = bound(task, at, found)
    named = [(PLACED, task.stations(found.stands)), (EVEN, task.stations(_even(at, count)))]
    if made.standing:
        named.append((STANDING, list(made.standing)))
    judged = [*judge(task, named, poses), together(task, ALL, at)]
    refuse_uncovered(task, at, judged[0], count, say)
    stations = placed_stations(task, found.stands)
    figured = figures(request, task, judged, least, stations)
    head = (f"{counted(count, 'station')} placed by `swarm place` for {request.subject}",)
    text = stations_text(PlacedStations(_frame(request), stations), head, where(task, found.stands))
    picture = draw(task, judged, poses, found.stands)
    with outputs(*files) as (places_file, figures_file, *pictures):
        places_file.write_text(text, encoding="utf-8")
        figures_file.write_text(json.dumps(figured, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        for path in pictures:
            save(picture, path)
            # The second format has the same layout: to find it takes longer than to draw it.
            picture.set_layout_engine("none")
    return Placement(figured, stations, files)


def files_of(out: Path) -> tuple[Path, ...]:
    """Return the files of the stations, the figures and the pictures of a placement that is written as `out`."""
    return (out, *(out.with_name(f"{out.stem}-place{suffix}") for suffix in (".json", ".png", ".svg")))


def placed_stations(task: Task, stands: list[Stand]) -> tuple[PlacedStation, ...]:
    """Return the stations that stand already, and the new ones with the lowest numbers that are free.

    Args:
        task: the task.
        stands: the new stations.
    """
    taken = {station.number for station in task.fixed}
    free = (number for number in range(task.kind.most) if number not in taken)
    perfect = FanErrors() if task.kind.generation == "1.0" else TiltedErrors()
    new = []
    for stand in stands:
        number = next(free)
        name, generation = f"station {number}", task.kind.generation
        new.append(PlacedStation(name, number, generation, None, stand.rotation, stand.position, (perfect, perfect)))
    return (*task.fixed, *new)


def _found(request: Request, task: Task, at: Places, say: Callable[[str], None], seed: int) -> Found:
    """Return the placement of so many stations, or of the fewest that reach the precision. Raises SwarmError."""
    least = needed(task, at)
    counts = [request.stations] if request.stations else range(least, most_new(task, at) + 1)
    if not counts:
        raise SwarmError(
            f"no placement does with fewer than {least} stations, and at most {most_new(task, at)} are possible: let "
            "stations stand elsewhere (--room, --shell-m, --at), or narrow the poses (--volume, --tilt-deg)"
        )
    for count in counts:
        say(f"{counted(count, 'station')} among {len(at.stands)} candidates, at {len(at.poses.position)} poses")
        found = find(task, at, count, seed=seed)
        if request.stations is not None:
            return _rounded(task, found)
        error = percentile(errors(at.fixed.joined(found.seen), task.losses), task.share)
        say(f"error e at {100 * task.share:g} % of the poses: {error:.3g}, 1 is wanted")
        if error <= 1:
            return _rounded(task, found)
    raise SwarmError(
        f"{request.kind}: {counted(count, 'station')}, the most that are possible, reach e = {error:.3g} at "
        f"{100 * task.share:g} % of the poses, and 1 is wanted: the precision of --attitude-deg and --position-mm"
    )


def _rounded(task: Task, found: Found) -> Found:
    """Return the stations in order of their azimuth about the volume, at rounded positions."""
    middle = task.site.volume.middle
    away = [stand.position - middle for stand in found.stands]
    axis = int(np.argmax(np.abs(task.site.up)))
    first, second = (i for i in range(3) if i != axis)
    order = sorted(range(len(away)), key=lambda i: float(np.arctan2(away[i][second], away[i][first])))
    return found._replace(stands=[_on_grid(task, found.stands[i]) for i in order], seen=found.seen.at(np.array(order)))


def _on_grid(task: Task, stand: Stand) -> Stand:
    """Return a station at a rounded position; the points of the user stay as they are."""
    if task.site.surfaces[stand.surface].area == 0:
        return stand
    return stand._replace(position=(stand.position / GRID_M).round() * GRID_M)


def _even(at: Places, count: int) -> list[Stand]:
    """Return stations evenly spread over the places, each in the first of its directions: at the volume's middle."""
    first: dict[tuple[float, ...], Stand] = {}
    for stand in at.stands:
        first.setdefault(tuple(stand.position.tolist()), stand)
    each = list(first.values())
    if count == 1 or len(each) <= count:
        return (each * count)[:count]
    chosen = even_spreads(np.array([stand.position for stand in each]), count, EVENS)[0]
    return [each[i] for i in chosen]


def _default_out(request: Request) -> Path:
    name = Path(request.subject).stem
    return Path("runs") / f"place-{name}-{request.stations or 'fewest'}" / "stations.toml"


def _frame(request: Request) -> str:
    return f"world of {Path(request.subject).stem}" if request.volume is None else "that of the volume"
