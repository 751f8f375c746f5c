"""A station's calibration, to be subtracted from its sweep angles: from libsurvive's file, or from this project's.

libsurvive's file is read by `libsurvive_config`. Its `fcal*` values, two each (X sweep, Y sweep), become `FanErrors`
through `estimators.lighthouse.sweep.from_libsurvive`, which defines the signs and frames; `pose` is the station's pose
in libsurvive's world. This project's file is TOML, in SI units; values that are not given are zero:

    [fan_x]
    phase_rad = 0.0586
    tilt_rad = 0.0013
    curve = -0.0019
    gibbous_phase_rad = 2.89
    gibbous_magnitude = 0.0047
    [fan_y]
    ...
    [photodiodes.craft-0]                     # optional, any number: true positions of the photodiodes of a craft, of
    point_m = [[0.07, 0.02, 0.03], ...]       # all craft of a model, or of a recording's object, in its body frame

A plain [photodiodes] is for the one object of a replay. `swarm.flight.recordings.calibration_file` writes the file.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.lighthouse.sweep import FanErrors, from_libsurvive
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.recordings.libsurvive import WorldPose
from swarm.flight.recordings.libsurvive_config import identity_of, pose_of, station_table, sweep_terms, tolerant_json
from swarm.user_text import NotToml, parse_toml, read_text, short, user_path


class StationCalibration(NamedTuple):
    """Systematic errors of a station's fans and, if known, the station's pose and positions of photodiodes.

    fan_x, fan_y: errors of the fans. pose: the station's pose in libsurvive's world. point_m: positions of the
    photodiodes of any object, (K, 3) [m]. by_name: the same for the craft, models or objects of these names.
    identity: the station's id, as `station_id` returns it.
    """

    fan_x: FanErrors
    fan_y: FanErrors
    pose: WorldPose | None = None
    point_m: Floats | None = None
    by_name: Mapping[str, Floats] = MappingProxyType({})
    identity: str | None = None

    def places(self, name: str) -> Floats | None:
        """Return the positions of the photodiodes of `name`, (K, 3) [m], or None if the calibration has none."""
        return self.by_name.get(name, self.point_m)


def read_calibration(path: str | Path, lighthouse: int = 0) -> StationCalibration:
    """Read the calibration of one station.

    `lighthouse` selects the station in libsurvive's file; this project's file has only one.

    Raises:
        SwarmError: the file cannot be read or is invalid; the message names file, key, value and the nearest valid
            name.
    """
    file = Path(path)
    text = read_text(user_path(path), str(path), "a calibration file")
    if text.lstrip()[:1] in ('"', "{"):
        return _from_libsurvive(tolerant_json(text, file), file, lighthouse)
    try:
        return _from_toml(parse_toml(text, str(file)), file)
    except NotToml as error:
        said = str(error).replace("not TOML", "neither libsurvive's calibration nor TOML", 1)
        raise SwarmError(said) from None


def _from_libsurvive(data: dict[str, Any], file: Path, lighthouse: int) -> StationCalibration:
    name = f"lighthouse{lighthouse}"
    table = station_table(data, name, file)
    terms = sweep_terms(table, f"{file}, {name}")
    if terms is None:
        raise SwarmError(f"{file}, {name}: OOTXSet is 0: the station's factory calibration had not been received")
    x, y = terms
    fan_x, fan_y = from_libsurvive(
        (x.phase_rad, y.phase_rad),
        (x.tilt, y.tilt),
        (x.curve, y.curve),
        (x.gibbous_phase_rad, y.gibbous_phase_rad),
        (x.gibbous_magnitude, y.gibbous_magnitude),
    )
    pose = pose_of(table, f"{file}, {name}")
    return StationCalibration(fan_x, fan_y, pose, identity=identity_of(table))


def _from_toml(data: dict[str, Any], file: Path) -> StationCalibration:
    _known(data, ("fan_x", "fan_y", "photodiodes"), f"{file}")
    fans = []
    for name in ("fan_x", "fan_y"):
        table = data.get(name)
        if not isinstance(table, dict):
            raise SwarmError(f"{file}: the table [{name}] is missing{did_you_mean(name, data)}")
        _known(table, FanErrors._fields, f"{file}, [{name}]")
        for key, value in table.items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise SwarmError(f"{file}, [{name}]: {key} must be a finite number, not {short(repr(value))}")
        fans.append(FanErrors(**{key: float(value) for key, value in table.items()}))
    table = data.get("photodiodes", {})
    if not isinstance(table, dict):
        raise SwarmError(f"{file}, [photodiodes]: must be a table, not {short(repr(table))}")
    named = {name: inner for name, inner in table.items() if isinstance(inner, dict)}
    _known({key: None for key in table if key not in named}, ("point_m",), f"{file}, [photodiodes]")
    by_name = {name: _points(inner, f"{file}, [photodiodes.{name}]") for name, inner in named.items()}
    plain = "photodiodes" in data and (not named or "point_m" in table)
    point_m = _points({"point_m": table.get("point_m")}, f"{file}, [photodiodes]") if plain else None
    return StationCalibration(fans[0], fans[1], None, point_m, by_name)


def _points(table: dict[str, Any], where: str) -> Floats:
    _known(table, ("point_m",), where)
    try:
        point_m = np.array(table.get("point_m"), dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        point_m = np.empty(0)
    if point_m.ndim != 2 or point_m.shape[1] != 3 or not np.isfinite(point_m).all():
        raise SwarmError(f"{where}: point_m must be rows of three finite numbers [m]")
    return point_m


def _known(table: dict[str, Any], keys: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in keys:
            raise SwarmError(f"{where}: unknown key {key!r}{did_you_mean(key, keys)}")
