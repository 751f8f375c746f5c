"""Surveys of real rooms: how well objects are placed by stations whose poses came from other recordings.

    python benchmarks/survey.py DATA [--windows 300] [--only crazyflie|lh1|lh2]

DATA is a folder with `crazyflie/lh{1,2}_{jitter,move}` (the Crazyflie positioning dataset), and `lighthouse-v1`,
`lighthouse-v2` (libsurvive-extras-data, tests).

- crazyflie: the stations are surveyed by the jitter logs alone, in which the craft rests at four or five places, and
  again with the cameras' places as truth, with calibrations adjusted, and with the flight's own light. Then each
  window of 60 ms of the flight is solved by itself, the stations held, and compared with motion capture after the
  alignment of `swarm.flight.recordings.alignment`. Of every log, how far the attitudes by each station alone are apart
  in the same windows.
- lh1_test_cal, lh2_test_cal: poses of the objects by each station alone, period by period, before and after the survey;
  of lh1 with geometry, calibration, both and neither adjusted. The survey takes the first half of the recording, the
  figures are of the second.
"""

import argparse
import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from estimators.arrays import Floats
from estimators.survey.problem import Room
from estimators.survey.survey import Surveyed, disagreement, survey
from estimators.survey.terms import PARTS
from swarm.flight.recordings.alignment import Alignment, align
from swarm.flight.recordings.trajectory import read_trajectory
from swarm.studies.survey.collect import collect
from swarm.studies.survey.solve import Result, known_room, solve_survey


def flight(folder: Path, name: str, result: Result, windows: int) -> dict[str, Any]:
    """Position errors in a flight with the stations of a survey."""
    log, truth = folder / f"log{name}", read_trajectory(folder / f"mocap{name}.npy")
    seen = collect([log], most=windows)
    errors = tuple(result.found.room.errors(s) for s in range(len(seen.stations)))
    found = survey(seen.rows, seen.moving, errors, seen.normals, hold=result.found.room)
    part = seen.objects[0]
    used = found.used
    middle = (part.cut.begin_s + part.cut.end_s)[used] / 2
    position, rotation = found.room.window_position[used], found.room.window_rotation[used]
    aligned = align(middle, position, rotation, truth, part.light.marks_s)
    apart, turned = disagreement(found)
    return {
        "windows": len(used),
        "solved": int(used.sum()),
        **_errors(aligned),
        "residual_urad": _urad(found.residual),
        "stations_alone_differ_mm_deg": [_mid(1e3 * apart), _mid(np.degrees(turned))],
        "alignment": aligned.sentences(),
    }


def attitudes(log: Path, result: Result, windows: int) -> dict[str, float | int]:
    """How far the poses by each station alone are apart at the same instants of a log, stations held."""
    seen = collect([log], most=windows, rest=False)
    errors = tuple(result.found.room.errors(s) for s in range(len(seen.stations)))
    found = survey(seen.rows, seen.moving, errors, seen.normals, hold=result.found.room)
    apart, turned = disagreement(found)
    both = np.isfinite(turned)
    return {
        "windows": int(both.sum()),
        "median_deg": float(np.degrees(np.median(turned[both]))),
        "90_percent_deg": float(np.degrees(np.quantile(turned[both], 0.9))),
        "median_mm": 1e3 * float(np.median(apart[both])),
    }


def _errors(aligned: Alignment) -> dict[str, float]:
    mm = 1e3 * aligned.residual_m
    return {
        "samples": len(mm),
        "median_mm": float(np.median(mm)),
        "90_percent_mm": float(np.quantile(mm, 0.9)),
        "99_percent_mm": float(np.quantile(mm, 0.99)),
        "largest_mm": float(mm.max()),
    }


def crazyflie(data: Path, generation: int, flown: str, windows: int) -> dict[str, Any]:
    """Survey by the jitter logs, and the flight."""
    rest = data / "crazyflie" / f"lh{generation}_jitter"
    logs, truths = sorted(rest.glob("log*")), sorted(rest.glob("mocap*"))
    moved = data / "crazyflie" / f"lh{generation}_move" / f"log{flown}"
    out: dict[str, Any] = {}
    terms = tuple(PARTS)
    for name, files, given, parts in (
        ("light alone", logs, [], ()),
        ("with the cameras' places of the jitter logs", logs, truths, ()),
        ("light alone, all terms adjusted", logs, [], terms),
        ("light of jitter logs and flight", [*logs, moved], [], ()),
        ("light of jitter logs and flight, all terms adjusted", [*logs, moved], [], terms),
    ):
        result = solve_survey(collect(files), given, parts)
        sigma = np.sqrt(np.diagonal(result.covariance)[6:12])
        out[name] = {
            "distance_of_stations_mm_sigma": _distance(result),
            "station_1_from_0_m": _relative(result.found.room),
            "sigma_mm_deg": [1e3 * float(np.linalg.norm(sigma[3:])), float(np.degrees(np.linalg.norm(sigma[:3])))],
            "systematic_urad": 1e6 * result.found.systematic_rad,
            "residual_before_after_urad": [(1e6 * result.before).tolist(), (1e6 * result.after).tolist()],
            "flight": flight(data / "crazyflie" / f"lh{generation}_move", flown, result, windows),
            "attitudes_by_each_station": {
                f"{log.parent.name}/{log.name}": attitudes(log, result, windows) for log in (*logs, moved)
            },
        }
    return out


def _distance(result: Result) -> list[float]:
    away = result.found.room.position[1] - result.found.room.position[0]
    length = float(np.linalg.norm(away))
    return [1e3 * length, 1e3 * float(np.sqrt(away @ result.covariance[9:12, 9:12] @ away)) / length]


def _relative(room: Room) -> list[float]:
    out: list[float] = (room.rotation[0].T @ (room.position[1] - room.position[0])).tolist()
    return out


def test_cal(file: Path, adjustments: dict[str, tuple[bool, tuple[str, ...]]]) -> dict[str, Any]:
    """Residuals and disagreement of the second half's periods, by what is adjusted in the first half."""
    first = collect([file], span=(0.0, 0.5))
    second = collect([file], span=(0.5, 1.0), rest=False, most=60)
    known = known_room(first.stations)
    assert known is not None
    out: dict[str, Any] = {}
    for name, (geometry, parts) in adjustments.items():
        hold = None if geometry else known
        if geometry or parts:
            found = survey(first.rows, first.moving, first.errors, first.normals, hold=hold, parts=parts)
            room, fitted = found.room, _by_station(found)
        else:
            room, fitted = known, None
        errors = tuple(room.errors(s) for s in range(len(first.stations)))
        tested = survey(second.rows, second.moving, errors, second.normals, hold=room)
        apart, turned = disagreement(tested)
        figures: dict[str, Any] = {"residual_urad": _by_station(tested), "fit_residual_urad": fitted}
        for part in second.objects:
            own = slice(part.first, part.last)
            figures[part.light.name] = {
                "windows": part.last - part.first,
                "differ_mm": _mid(1e3 * apart[own]),
                "differ_deg": _mid(np.degrees(turned[own])),
            }
        out[name] = figures
    return out


def _by_station(found: Surveyed) -> list[float]:
    return [_urad(found.residual[found.rows.station == s]) for s in range(len(found.placed))]


def _urad(residual: Floats) -> float:
    return 1e6 * float(np.nanmedian(np.abs(residual)))


def _mid(values: Floats) -> float | None:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else None


def main() -> None:
    """Print the figures as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="folder of the recordings")
    parser.add_argument("--windows", type=int, default=300, help="windows of a flight")
    parser.add_argument("--only", choices=("crazyflie", "lh1", "lh2"), help="only these")
    given = parser.parse_args()
    out: dict[str, Any] = {"machine": platform.platform(), "numpy": version("numpy"), "scipy": version("scipy")}
    if given.only in (None, "crazyflie"):
        out["lh2_move"] = crazyflie(given.data, 2, "00", given.windows)
        out["lh1_move"] = crazyflie(given.data, 1, "02", given.windows)
    everything = tuple(PARTS)
    if given.only in (None, "lh2"):
        file = given.data / "lighthouse-v2" / "lh2_test_cal.rec.gz"
        out["lh2_test_cal"] = test_cal(file, {"nothing": (False, ()), "geometry": (True, ())})
    if given.only in (None, "lh1"):
        file = given.data / "lighthouse-v1" / "lh1_test_cal.rec.gz"
        adjustments = {
            "nothing": (False, ()),
            "geometry": (True, ()),
            "phase and tilt": (False, ("phase", "tilt")),
            "all terms": (False, everything),
            "geometry, phase and tilt": (True, ("phase", "tilt")),
            "geometry and all terms": (True, everything),
        }
        out["lh1_test_cal"] = test_cal(file, adjustments)
    print(json.dumps(out, indent=1))


if __name__ == "__main__":
    main()
