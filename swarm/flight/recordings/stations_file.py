"""The stations of a room, where they stand and how their fans deviate: a TOML file that `swarm survey` writes.

    frame = "station 0"                      # whose axes the poses are in, for a reader only

    [[station]]
    name = "station 0"
    number = 0                               # in recordings; of Lighthouse 2.0 its channel
    generation = "1.0"
    id = "3428821765"                        # optional, as `station_id` returns it
    position_m = [0.0, 0.0, 0.0]             # in the world frame of the file
    quaternion_wxyz = [1.0, 0.0, 0.0, 0.0]   # world from station; the station's axes are x right, y down, z ahead
    position_sigma_m = [0.0, 0.0, 0.0]       # optional: standard deviation along the world's axes
    rotation_sigma_rad = [0.0, 0.0, 0.0]     # optional: about the world's axes
    covariance = [[...], ...]                # optional: 6 x 6, of the turn and the place, about and along them
    systematic_rad = 0.0                     # optional: standard deviation of what calibration leaves of an angle

    [station.fan_0]                          # optional: errors as in `FanErrors` (1.0) or `TiltedErrors` (2.0)
    phase_rad = 0.0586
    [station.fan_1]
    ...

A number and an id occur once. Fans without a table, and terms that are not given, are perfect.
"""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lighthouse.rotor import CHANNEL_TICKS
from estimators.lighthouse.rows import Station
from estimators.lighthouse.sweep import Fan, FanErrors, lighthouse_1, lighthouse_2
from estimators.lighthouse.tilted import TiltedErrors
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.recordings.libsurvive import station_id
from swarm.scenario.text import toml_value
from swarm.user_text import parse_toml, read_text, short, user_path

ERRORS: dict[str, type[FanErrors] | type[TiltedErrors]] = {"1.0": FanErrors, "2.0": TiltedErrors}
"""The error terms of a fan, by generation."""
MOST_STATIONS = len(CHANNEL_TICKS)
_LARGEST_M = 1e5
"""Largest coordinate of a station [m], as of a trajectory."""
_KEYS = (
    *("name", "number", "generation", "id", "position_m", "quaternion_wxyz"),
    *("position_sigma_m", "rotation_sigma_rad", "covariance", "systematic_rad", "fan_0", "fan_1"),
)
_UNIT = 1e-2
"""Deviation of a quaternion's length from 1 that rounding by hand may leave."""

Errors = FanErrors | TiltedErrors


class PlacedStation(NamedTuple):
    """One station.

    name: as it is shown. number: in recordings, for Lighthouse 2.0 its channel. generation: "1.0" or "2.0". identity:
    its id, None if not known. rotation: R_w_s, (3, 3). position: (3,) [m]. errors: of both fans. rotation_sigma: about
    the world's axes (3,) [rad], position_sigma: (3,) [m], covariance: (6, 6) of both, None if not known.
    systematic_rad: standard deviation of what its calibration leaves of an angle.
    """

    name: str
    number: int
    generation: str
    identity: str | None
    rotation: Floats
    position: Floats
    errors: tuple[Errors, Errors]
    rotation_sigma: Floats | None = None
    position_sigma: Floats | None = None
    covariance: Floats | None = None
    systematic_rad: float = 0.0

    @property
    def pose_covariance(self) -> Floats:
        """Return the covariance (6, 6) of turn and place [rad, m], from the standard deviations alone if need be."""
        if self.covariance is not None:
            return self.covariance
        sigma = [np.zeros(3) if part is None else part for part in (self.rotation_sigma, self.position_sigma)]
        return np.diag(np.square(np.concatenate(sigma)))

    @property
    def fans(self) -> tuple[Fan, Fan]:
        """Return its two fans with their errors."""
        first, second = self.errors
        if isinstance(first, TiltedErrors) and isinstance(second, TiltedErrors):
            return lighthouse_2(first, second)
        assert isinstance(first, FanErrors)
        assert isinstance(second, FanErrors)
        return lighthouse_1(first, second)

    @property
    def station(self) -> Station:
        """Return it as the estimators take it."""
        return Station(self.rotation, self.position, self.fans)


class PlacedStations(NamedTuple):
    """The stations of a file in its order. frame: whose axes the poses are in, in words."""

    frame: str
    stations: tuple[PlacedStation, ...]

    def numbered(self, number: int) -> PlacedStation | None:
        """Return the station of a number, None if there is none."""
        return next((station for station in self.stations if station.number == number), None)


def stations_text(placed: PlacedStations, head: Iterable[str] = (), remarks: Sequence[str] = ()) -> str:
    """Return the file's text; reading it gives the same numbers, to the bit.

    Args:
        placed: the stations.
        head: comment lines that state the source.
        remarks: a comment per station, empty for none.
    """
    lines = [*(f"# {line}".rstrip() for line in head), "", f"frame = {toml_value(placed.frame)}"]
    for i, station in enumerate(placed.stations):
        lines += ["", "[[station]]"]
        lines += [f"# {remarks[i]}"] if i < len(remarks) and remarks[i] else []
        lines += [f"name = {toml_value(station.name)}", f"number = {station.number}"]
        lines.append(f"generation = {toml_value(station.generation)}")
        lines += [f"id = {toml_value(station.identity)}"] if station.identity is not None else []
        lines.append(f"position_m = {_row(station.position)}")
        lines.append(f"quaternion_wxyz = {_row(rot.quaternion_from_matrix(station.rotation[None])[0])}")
        if station.position_sigma is not None:
            lines.append(f"position_sigma_m = {_row(station.position_sigma)}")
        if station.rotation_sigma is not None:
            lines.append(f"rotation_sigma_rad = {_row(station.rotation_sigma)}")
        if station.covariance is not None:
            lines += ["covariance = [", *(f"    {_row(row)}," for row in station.covariance), "]"]
        if station.systematic_rad:
            lines.append(f"systematic_rad = {station.systematic_rad!r}")
        for fan, errors in enumerate(station.errors):
            lines += ["", f"[station.fan_{fan}]"]
            lines += [f"{key} = {float(value)!r}" for key, value in zip(errors._fields, errors, strict=True)]
    return "\n".join(lines) + "\n"


def read_stations(path: str | Path) -> PlacedStations:
    """Read the stations of a file.

    Raises:
        SwarmError: the file cannot be read or is invalid; the message names file, key, value and the nearest valid
            name.
    """
    file = Path(path)
    data = parse_toml(read_text(user_path(path), str(path), "a file of stations"), str(file))
    _known(data, ("frame", "station"), f"{file}")
    frame, tables = data.get("frame", ""), data.get("station")
    if not isinstance(frame, str):
        raise SwarmError(f"{file}: frame must be a text, not {short(repr(frame))}")
    if not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        raise SwarmError(f"{file}: no table [[station]]{did_you_mean('station', data) if not tables else ''}")
    if len(tables) > MOST_STATIONS:
        raise SwarmError(f"{file}: {len(tables)} stations, and at most {MOST_STATIONS} are possible")
    stations = tuple(_station(table, f"{file}, [[station]] {i + 1}") for i, table in enumerate(tables))
    for i, station in enumerate(stations):
        for earlier in stations[:i]:
            for what, value in (("number", station.number), ("id", station.identity)):
                if value is not None and value == (earlier.number if what == "number" else earlier.identity):
                    raise SwarmError(f"{file}, [[station]] {i + 1}: {what} {value} is that of {earlier.name!r}, too")
    return PlacedStations(frame, stations)


def _station(table: dict[str, Any], where: str) -> PlacedStation:
    _known(table, _KEYS, where)
    generation = table.get("generation")
    if generation not in ERRORS:
        raise SwarmError(f"{where}: generation must be {' or '.join(map(repr, ERRORS))}, not {_value(generation)}")
    number = table.get("number")
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < MOST_STATIONS:
        raise SwarmError(
            f"{where}: number must be a station's number or channel, 0 to {MOST_STATIONS - 1}, not {_value(number)}"
        )
    name, identity = table.get("name", f"station {number}"), table.get("id")
    for key, text in (("name", name), ("id", "" if identity is None else identity)):
        if not isinstance(text, str):
            raise SwarmError(f"{where}: {key} must be a text, not {_value(text)}")
    quaternion = _numbers(table, "quaternion_wxyz", 4, where)
    assert quaternion is not None
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1) > _UNIT:
        raise SwarmError(f"{where}: quaternion_wxyz must have length 1, not {length:.4g}")
    position = _numbers(table, "position_m", 3, where)
    assert position is not None
    first, second = (_errors(table, fan, generation, where) for fan in ("fan_0", "fan_1"))
    return PlacedStation(
        name,
        number,
        generation,
        None if identity is None else station_id(identity),
        rot.matrix_from_quaternion(quaternion[None] / length)[0],
        position,
        (first, second),
        _sigma(table, "rotation_sigma_rad", where),
        _sigma(table, "position_sigma_m", where),
        _covariance(table, where),
        _systematic(table, where),
    )


def _errors(table: dict[str, Any], fan: str, generation: str, where: str) -> Errors:
    """Return the errors of a fan, none without its table."""
    kind, given = ERRORS[generation], table.get(fan, {})
    if not isinstance(given, dict):
        raise SwarmError(f"{where}: {fan} must be a table, not {_value(given)}")
    _known(given, kind._fields, f"{where}, {fan}")
    for key, value in given.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise SwarmError(f"{where}, {fan}: {key} must be a finite number, not {_value(value)}")
    return kind(**{key: float(value) for key, value in given.items()})


def _sigma(table: dict[str, Any], key: str, where: str) -> Floats | None:
    values = _numbers(table, key, 3, where, needed=False)
    if values is not None and np.any(values < 0):
        raise SwarmError(f"{where}: {key} must not be negative, not {_value(table[key])}")
    return values


def _covariance(table: dict[str, Any], where: str) -> Floats | None:
    if "covariance" not in table:
        return None
    try:
        values = np.array(table["covariance"], dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.empty(0)
    good = values.shape == (6, 6) and bool(np.isfinite(values).all())
    if not good or not np.allclose(values, values.T) or np.linalg.eigvalsh(values)[0] < -_UNIT * np.trace(values):
        raise SwarmError(
            f"{where}: covariance must be 6 x 6 numbers, symmetric and not negative, not {_value(table['covariance'])}"
        )
    return values


def _systematic(table: dict[str, Any], where: str) -> float:
    value = table.get("systematic_rad", 0.0)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < 1:
        raise SwarmError(f"{where}: systematic_rad must be an angle from 0 to 1, not {_value(value)}")
    return float(value)


def _numbers(table: dict[str, Any], key: str, count: int, where: str, *, needed: bool = True) -> Floats | None:
    """Return the finite numbers (count,) under a key, None where an optional one is missing."""
    if key not in table:
        if needed:
            raise SwarmError(f"{where}: {key} is missing{did_you_mean(key, [k for k in table if k not in _KEYS])}")
        return None
    try:
        values = np.array(table[key], dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.empty(0)
    if values.shape != (count,) or not np.isfinite(values).all() or np.max(np.abs(values)) > _LARGEST_M:
        raise SwarmError(f"{where}: {key} must be {count} numbers within {_LARGEST_M:g}, not {_value(table[key])}")
    return values


def _known(table: dict[str, Any], keys: Sequence[str], where: str) -> None:
    for key in table:
        if key not in keys:
            raise SwarmError(f"{where}: unknown key {key!r}{did_you_mean(key, keys)}")


def _row(values: Floats) -> str:
    return toml_value([float(value) for value in values])


def _value(value: object) -> str:
    return "nothing" if value is None else short(repr(value))
