"""Writing of this project's calibration file: TOML for `read_calibration`, with each value's standard deviation."""

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
    """Return the file's text; reading it gives the same numbers, to the bit.

    Args:
        station: the calibration.
        fan_sigma: standard deviations per fan, 0 for values that were not estimated.
        point_sigma_m: standard deviations of the photodiodes' positions per name, (K, 3) [m], 0 likewise.
        head: comment lines that state the source.
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
    """Return `file` after checking that it can be written.

    Raises:
        SwarmError: the folder is missing, or the file exists and `force` is False.
    """
    if not file.parent.is_dir():
        raise SwarmError(f"cannot write {file}: there is no folder {file.parent}")
    refuse_existing(file, force=force)
    return file


def held_parts(text: str) -> tuple[str, ...]:
    """Return the parts that a list such as "curve,gibbous" names.

    Raises:
        SwarmError: a part does not exist, or none is left to be estimated.
    """
    parts = tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))
    for part in parts:
        if part not in PARTS:
            raise SwarmError(f"--hold: {part!r} cannot be held{did_you_mean(part, PARTS)}")
    if len(parts) == len(PARTS):
        raise SwarmError("--hold: nothing is left to be estimated")
    return parts


def _key(name: str) -> str:
    """Return a name as a TOML key."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_value(name)


def write_calibration(path: Path, text: str) -> None:
    """Write a file's text in one step.

    Raises:
        SwarmError: the file cannot be written.
    """
    write_text(path, text)
