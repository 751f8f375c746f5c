"""A placement's figures, as the JSON has them, and as the reader at a terminal sees them.

Errors at a percentile are null where more poses are undecided than the percentile forgives; the terminal shows ∞.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import degrees, isfinite
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from estimators.arrays import Floats
from estimators.layout.error import percentile
from swarm.flight.recordings.stations_file import PlacedStation
from swarm.studies.placement.candidates import Stand
from swarm.studies.placement.judgement import Bound, Judged
from swarm.studies.placement.request import Request
from swarm.studies.placement.task import Task
from swarm.tables import RankedColumn, counted, fitting, table

Figures = Mapping[str, Any]
PLACED, EVEN, STANDING, ALL = "placed", "even spread", "as they stand", "all candidates"
GAP = 0.02
"""A placement within so much of the bound is as good as any."""


def figures(
    request: Request, task: Task, judged: Sequence[Judged], least: Bound, stations: Sequence[PlacedStation]
) -> dict[str, Any]:
    """Return everything that was found, ready for JSON.

    Args:
        request: the request.
        task: the request in SI units.
        judged: the placement, then others.
        least: the bound.
        stations: all stations of the file.
    """
    ours = judged[0]
    error = percentile(ours.lost_error if task.losses and ours.lost_error is not None else ours.error, task.share)
    return {
        "program": "lighthouse-swarm",
        "subject": request.subject,
        "model": task.hull.path.name,
        "asked": {key: list(value) if isinstance(value, tuple) else value for key, value in request._asdict().items()},
        "angle_noise": {
            "own_arcsec": degrees(task.noise.own_rad) * 3600,
            "shared_arcsec": degrees(task.noise.shared_rad) * 3600,
        },
        "error_of_one": {"attitude_deg": degrees(task.unit[0]), "position_mm": 1e3 * task.unit[1]},
        "wanted_precision_met": error <= 1 if request.precision_wanted else None,
        "percentile": 100 * task.share,
        "poses": {"judged": len(ours.error)},
        "volume_m": {"low": task.site.volume.low.tolist(), "high": task.site.volume.high.tolist()},
        "placements": {each.name: _placement(each, task.share) for each in judged},
        "bound": {key: _number(value) for key, value in least._asdict().items()},
        "stations": [_station(placed, fixed=i < len(task.fixed)) for i, placed in enumerate(stations)],
    }


def where(task: Task, stands: Sequence[Stand]) -> list[str]:
    """Return in words what each station stands on, those that stood already first.

    Args:
        task: the task.
        stands: the new stations.
    """
    return ["stood already"] * len(task.fixed) + [task.site.surfaces[stand.surface].name for stand in stands]


def _placement(judged: Judged, share: float) -> dict[str, Any]:
    lost = None
    if judged.lost_position_m is not None and judged.lost_attitude_rad is not None and judged.lost_error is not None:
        lost = judged.lost_position_m, judged.lost_attitude_rad, judged.lost_error
    return {
        "stations": len(judged.stations),
        "decided_share": judged.decided,
        "decided_with_one_lost_share": judged.decided_with_one_lost,
        "found_by_one_station_alone_share": judged.from_nothing,
        "all": _errors(judged.position_m, judged.attitude_rad, judged.error, share),
        "one_lost": None if lost is None else _errors(*lost, share),
    }


def _errors(position: Floats, attitude: Floats, error: Floats, share: float) -> dict[str, dict[str, float | None]]:
    def at(part: float) -> dict[str, float | None]:
        return {
            "position_mm": _number(1e3 * percentile(position, part)),
            "attitude_deg": _number(degrees(percentile(attitude, part))),
            "error": _number(percentile(error, part)),
        }

    return {"median": at(0.5), "percentile": at(share), "worst": at(1.0)}


def _station(placed: PlacedStation, fixed: bool) -> dict[str, Any]:
    return {
        "name": placed.name,
        "number": placed.number,
        "stood_already": fixed,
        "position_m": placed.position.tolist(),
        "looks_along": placed.rotation[:, 2].round(6).tolist(),
    }


def _number(value: float) -> float | None:
    return value if isfinite(value) else None


def print_report(console: Console, made: Figures) -> None:
    """Print the tables, and what they mean."""
    one, q = made["error_of_one"], f"{made['percentile']:g} %"
    console.print(Text(_asked(made)))
    console.print(_places(made))
    console.print(
        Text(f"error e: e² = (attitude / {one['attitude_deg']:g}°)² + (position / {one['position_mm']:g} mm)²")
    )
    printed, left_out = fitting(console.width, _columns(made, q))
    console.print(printed)
    if left_out:
        console.print(Text(f"No room in {console.width} columns for: {left_out} (the JSON has them).", "dim"))
    for sentence in (*_sentences(made, q), *_warnings(made)):
        console.print(Text(*sentence))


def _asked(made: Figures) -> str:
    """Return in words what was placed, and for which poses."""
    asked = made["asked"]
    new = sum(not station["stood_already"] for station in made["stations"])
    text = f"{counted(new, 'station')} of {asked['kind']} for {made['model']}: "
    if asked["volume"] is None:
        return text + f"along the flight of {asked['subject']}, turned by up to 5°"
    tilt = asked["tilt_deg"]
    attitudes = "all attitudes" if tilt >= 180 else f"+z within {tilt:g}° of {asked['up']}" if tilt else "upright"
    return text + f"{attitudes}, positions within {asked['volume']} m"


def _places(made: Figures) -> Table:
    printed = table("station", "x, m", "y, m", "z, m", "looks along", tight=True)
    for station in made["stations"]:
        along = ", ".join(f"{value + 0.0:.2f}" for value in station["looks_along"])
        name = f"{station['name']} (stands)" if station["stood_already"] else station["name"]
        printed.add_row(name, *(f"{value + 0.0:.3f}" for value in station["position_m"]), along)
    return printed


def _columns(made: Figures, q: str) -> list[RankedColumn]:
    placements, least = made["placements"], made["bound"]

    def cells(text: Callable[[Figures], str], bound: str = "–") -> list[str]:
        return [*(text(each) for each in placements.values()), bound]

    def error(which: str, at: str, key: str) -> Callable[[Figures], str]:
        return lambda each: "–" if each[which] is None else _shown(each[which][at][key])

    return [
        RankedColumn(0, "placement", [*placements, "bound"]),
        RankedColumn(6, "stations", cells(lambda each: str(each["stations"]))),
        RankedColumn(1, "decided\n%", cells(lambda each: _percent(each["decided_share"]))),
        RankedColumn(2, "one\nlost, %", cells(lambda each: _percent(each["decided_with_one_lost_share"]))),
        RankedColumn(9, "by one\nalone, %", cells(lambda each: _percent(each["found_by_one_station_alone_share"]))),
        RankedColumn(2, "pos., mm\nmedian", cells(error("all", "median", "position_mm"))),
        RankedColumn(1, f"pos., mm\n{q}", cells(error("all", "percentile", "position_mm"))),
        RankedColumn(7, "pos., mm\nworst", cells(error("all", "worst", "position_mm"))),
        RankedColumn(4, f"one lost\n{q}", cells(error("one_lost", "percentile", "position_mm"))),
        RankedColumn(8, "att., °\nmedian", cells(error("all", "median", "attitude_deg"))),
        RankedColumn(3, f"att., °\n{q}", cells(error("all", "percentile", "attitude_deg"))),
        RankedColumn(8, "e\nmedian", cells(error("all", "median", "error"), _shown(least["median"]))),
        RankedColumn(3, f"e\n{q}", cells(error("all", "percentile", "error"), _shown(least["error"]))),
        RankedColumn(5, f"e, one\nlost {q}", cells(error("one_lost", "percentile", "error"), _shown(least["lost"]))),
    ]


def _sentences(made: Figures, q: str) -> Iterator[tuple[str, str]]:
    """Yield what the figures mean."""
    least, placements = made["bound"], made["placements"]
    new = sum(not station["stood_already"] for station in made["stations"])
    lost = bool(made["asked"]["losses"])
    reached, bound = (least["reached_lost"], least["lost"]) if lost else (least["reached"], least["error"])
    if reached is not None and bound is not None:
        above = reached / bound - 1
        gap = "as good as any" if above < GAP else f"{100 * above:.0f} % above it"
        yield (
            f"Bound: at the poses of the search, no {counted(new, 'station')} among these places and directions have e "
            f"below {_shown(bound)} at {q} of the poses{' with one lost' if lost else ''}; the placement has "
            f"{_shown(reached)} there, {gap}.",
            "",
        )
    yield f"“{ALL}” is all {least['candidates']} at once: a limit that no placement reaches.", "dim"
    even, ours = (placements[name]["all"]["percentile"]["error"] for name in (EVEN, PLACED))
    if even is not None and ours is not None:
        yield f"The even spread, aimed at the volume's middle, has {even / ours:.2f} times the error at {q}.", ""
    if STANDING in placements:
        yield from _standing(placements[STANDING], placements[PLACED], q)
    yield (
        "Errors are those of one period's noise; what is wrong in a station's pose and calibration adds to them.",
        "dim",
    )
    if made["wanted_precision_met"] is not None:
        verdict = "met" if made["wanted_precision_met"] else "NOT met"
        yield f"The wanted precision is {verdict} at {q} of the poses.", ""


def _standing(standing: Figures, placed: Figures, q: str) -> Iterator[tuple[str, str]]:
    """Yield how the stations of the scenario compare with those that were placed, also with one lost."""
    said = []
    for which, text in (("all", ""), ("one_lost", " with one lost")):
        theirs, ours = (each[which]["percentile"]["error"] if each[which] else None for each in (standing, placed))
        if theirs is None:
            said.append(f"do not decide {q} of the poses{text}")
        elif ours is not None:
            said.append(f"have {theirs / ours:.2f} times the error of those placed at {q}{text}")
    if said:
        yield (
            f"The {counted(standing['stations'], 'station')} of the scenario, as they stand, {', and '.join(said)}.",
            "",
        )


def _warnings(made: Figures) -> Iterator[tuple[str, str]]:
    """Yield what the user should not overlook."""
    ours = made["placements"][PLACED]
    if (share := 1 - ours["decided_with_one_lost_share"]) > 1 - made["percentile"] / 100 and not made["asked"][
        "losses"
    ]:
        yield (
            f"Warning: with one station lost, up to {100 * share:.3g} % of the poses are undecided (--losses 1 looks "
            "for a placement without such poses)",
            "yellow",
        )
    if (alone := ours["decided_share"] - ours["found_by_one_station_alone_share"]) > 0:
        yield (
            f"{100 * alone:.3g} % of the poses are decided by several stations together only: a craft cannot begin "
            "there, no station lights four photodiodes",
            "dim",
        )


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{np.floor(1000 * share) / 10:.1f}"


def _shown(value: float | None) -> str:
    return "∞" if value is None else f"{value:.3f}" if value < 10 else f"{value:.1f}"
