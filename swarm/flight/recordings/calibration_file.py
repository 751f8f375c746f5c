"""Our calibration file, written: TOML that `read_calibration` reads, each value's standard deviation beside it."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from estimators.arrays import Floats
from estimators.calibration.problem import PARTS
from estimators.lighthouse.sweep import FanErrors
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.recordings.station_calibration import StationCalibration
from swarm.results.disk import refuse_existing, write_text
from swarm.scenario.text import toml_value


def calibration_text(
    station: StationCalibration,
    fan_sigma: Sequence[FanErrors],
    point_sigma_m: dict[str, Floats],
    head: Iterable[str] = (),
) -> str:
    """The file's text. fan_sigma: per fan, point_sigma_m: per name (K, 3), standard deviations, 0 for what was not
    estimated. head: comment lines that say where it comes from. Reading the text gives the same numbers, to the bit.
    """
    lines = [*(f"# {line}".rstrip() for line in head), "", "# After each value: its standard deviation."]
    for name, fan, sigmas in zip(("fan_x", "fan_y"), (station.fan_x, station.fan_y), fan_sigma, strict=True):
        lines += ["", f"[{name}]"]
        for key, value, sigma in zip(fan._fields, fan, sigmas, strict=True):
            lines.append(f"{f'{key} = {float(value)!r}':<48} # {f'{sigma:.2g}' if sigma > 0 else 'not estimated'}")
    for name, point_m in station.by_name.items():
        lines += ["", f"[photodiodes.{_key(name)}]", "point_m = ["]
        for row, sigma in zip(point_m.tolist(), point_sigma_m[name], strict=True):
            beside = ", ".join(f"{s * 1e6:.2g}" for s in sigma) + " um" if np.any(sigma > 0) else "not estimated"
            lines.append(f"{f'    {row!r},':<80} # {beside}")
        lines.append("]")
    return "\n".join(lines) + "\n"


def place_for(file: Path, *, force: bool) -> Path:
    """`file`, if it can be written there. Raises SwarmError where something is in the way, before any work is done."""
    if not file.parent.is_dir():
        raise SwarmError(f"cannot write {file}: there is no folder {file.parent}")
    refuse_existing(file, force=force)
    return file


def held_parts(text: str) -> tuple[str, ...]:
    """The parts that a list such as "curve,gibbous" names. Raises SwarmError for one that there is not."""
    parts = tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))
    for part in parts:
        if part not in PARTS:
            raise SwarmError(f"--hold: {part!r} cannot be held{did_you_mean(part, PARTS)}")
    if len(parts) == len(PARTS):
        raise SwarmError("--hold: nothing is left to be estimated")
    return parts


def _key(name: str) -> str:
    """A name as a TOML key."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_value(name)


def write_calibration(path: Path, text: str) -> None:
    """Write a file's text in one step. Raises SwarmError where it cannot be written."""
    write_text(path, text)
