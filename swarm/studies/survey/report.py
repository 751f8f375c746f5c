"""The result of a survey, for the terminal and for its file."""

from collections.abc import Sequence
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from estimators.arrays import Floats
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.recordings.stations_file import PlacedStation, PlacedStations, stations_text
from swarm.studies.survey.solve import Result
from swarm.tables import counted, table
from swarm.version import VERSION


def placed_stations(result: Result) -> PlacedStations:
    """Return the stations that were found, as their file has them; one that moved stands where it stood last."""
    out = []
    last = last_places(result)
    first = _first(result)
    for s, known in enumerate(result.collected.stations):
        if not result.found.placed[s]:
            continue
        at = last[s]
        sigma = _sigma(result, at)
        out.append(
            PlacedStation(
                known.name,
                known.number,
                known.generation,
                known.identity,
                result.found.room.rotation[at],
                result.found.room.position[at],
                result.found.room.errors(at),
                None if s == first else sigma[:3],
                None if s == first else sigma[3:],
                None if s == first else result.covariance[6 * at : 6 * at + 6, 6 * at : 6 * at + 6],
                result.found.systematic_rad,
            )
        )
    return PlacedStations(result.frame, tuple(out))


def last_places(result: Result) -> list[int]:
    """Return the index of each station after its last move."""
    last = list(range(len(result.collected.stations)))
    for move in result.moves:
        last[move.station] = move.after
    return last


def _first(result: Result) -> int:
    return int(np.argmax(result.found.placed))


def _sigma(result: Result, at: int) -> Floats:
    out: Floats = np.sqrt(np.maximum(np.diagonal(result.covariance)[6 * at : 6 * at + 6], 0.0))
    return out


def findings(result: Result) -> list[str]:
    """Return in sentences what the survey was made of, and how well it fits."""
    collected, found = result.collected, result.found
    moving = int(np.count_nonzero(collected.moving & found.used))
    used = int(np.count_nonzero(found.used))
    files = list(dict.fromkeys(part.light.path.name for part in collected.objects))
    lines = [
        f"{', '.join(files[:6])}{' ...' if len(files) > 6 else ''}: {counted(used, 'window')} of light, "
        f"{used - moving} at rest and {moving} of motion, {counted(len(found.rows.angle), 'angle')}",
        f"Frame: {result.frame}; standard deviations against {collected.stations[_first(result)].name}",
        f"Systematic error of an angle, beside its noise: {1e6 * found.systematic_rad:.0f} urad",
    ]
    if isfinite(result.apart_after[0]):
        before = ""
        if isfinite(result.apart_before[0]):
            before = f", {_apart(result.apart_before)} with the stations where the files have them"
        lines.append(
            f"Poses of an object by each station alone differ by {_apart(result.apart_after)} (median){before}"
        )
    uncalibrated = [s.name for s in collected.stations if not s.calibrated]
    if uncalibrated:
        lines.append(
            f"No calibration of {', '.join(uncalibrated)} is known: taken as perfect, which costs centimetres; give "
            "--calibration, or adjust terms with --adjust"
        )
    return lines + [f"Moved: {move.words}" for move in result.moves]


def _apart(values: tuple[float, float]) -> str:
    return f"{1e3 * values[0]:.1f} mm, {np.degrees(values[1]):.2f} deg"


def file_text(result: Result) -> str:
    """Return the text of the stations' file."""
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    head = [f"Stations by lighthouse-swarm {VERSION}, {now}", *findings(result)]
    remarks = []
    first = _first(result)
    for s in range(len(result.collected.stations)):
        if result.found.placed[s]:
            words = [move.words for move in result.moves if move.station == s]
            words += ["the other stations' standard deviations are against this one"] if s == first else []
            remarks.append("; ".join(words))
    return stations_text(placed_stations(result), head, remarks)


def print_survey(console: Console, result: Result, file: Path) -> None:
    """Print what was found, and where it is.

    Args:
        console: Where to print.
        result: The survey.
        file: Its file.
    """
    for i, line in enumerate(findings(result)):
        style = "yellow" if line.startswith(("Moved", "No calibration")) else "bold" if i == 0 else ""
        console.print(Text(line, style), soft_wrap=True)
    console.print(_stations(result))
    if result.found.problem.free.parts:
        console.print(_terms(result))
    console.print(Text(f"\n{file}", "bold"))
    console.print(Text(f"  swarm replay RECORDING --stations {file}"))


def _stations(result: Result) -> Table:
    heads = ("station", "light", "position (m)", "sigma\n(mm)", "turn's sigma\n(deg)")
    made = table(*heads, "residual\n(urad)", "before\n(urad)", "windows\nthat agree", left=2)
    last, first = last_places(result), _first(result)
    for s, known in enumerate(result.collected.stations):
        if not result.found.placed[s]:
            made.add_row(Text(known.name), known.generation, Text("not found", "yellow"), *("",) * 5)
            continue
        at = last[s]
        sigma = _sigma(result, at)
        place = " ".join(f"{x:8.4f}" for x in result.found.room.position[at])
        size = "frame" if s == first else f"{1e3 * np.linalg.norm(sigma[3:]):.1f}"
        turn = "frame" if s == first else f"{np.degrees(np.linalg.norm(sigma[:3])):.3f}"
        share = result.found.agreement[at]
        made.add_row(
            Text(known.name),
            known.generation,
            place,
            size,
            turn,
            _urad(result.after[at]),
            _urad(result.before[s]),
            f"{100 * share:.0f} %" if isfinite(share) else "",
        )
    return made


def _terms(result: Result) -> Table:
    """Return the terms that were adjusted, per fan: value and standard deviation."""
    found, stations = result.found, result.collected.stations
    rows: dict[str, list[str]] = {}
    heads: list[str] = []
    names = ("phase (rad)", "tilt (rad)", "curve", "gibbous cos", "gibbous sin", "ogee cos", "ogee sin")
    for s, known in enumerate(stations):
        for fan in (0, 1):
            if not found.placed[s]:
                continue
            heads.append(f"{known.name}\nfan {fan}")
            values = zip(names, found.room.terms[s, fan], found.term_sigma[s, fan], strict=True)
            for name, value, sigma in values:
                rows.setdefault(name, []).append(f"{value:.5f} ± {sigma:.5f}" if sigma > 0 else f"{value:.5f}  (held)")
    made = table("", *heads)
    for name, cells in rows.items():
        made.add_row(name, *cells)
    return made


def _urad(value: float) -> str:
    return f"{1e6 * value:.0f}" if isfinite(value) else ""


def adjusted_parts(text: str, known: Sequence[str]) -> tuple[str, ...]:
    """Return the parts that a list such as "phase,tilt" names.

    Args:
        text: the list.
        known: the parts that there are.

    Raises:
        SwarmError: a part does not exist.
    """
    parts = tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))
    for part in parts:
        if part not in known:
            raise SwarmError(f"--adjust: {part!r} is no term of a fan{did_you_mean(part, known)}")
    return parts
