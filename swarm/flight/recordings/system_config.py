"""A Crazyflie client's system configuration (YAML): poses and factory calibrations of the stations.

    type: lighthouse_system_configuration
    systemType: 2                       the generation of the stations
    calibs: {0: {uid: ..., sweeps: [{phase, tilt, curve, gibphase, gibmag, ogeephase, ogeemag}, (second)]}}
    geos: {0: {origin: [x, y, z], rotation: 3 x 3}}

Values are in radians and metres, as the station sends them. A pose is the station's in the client's world, with the
station's x ahead, y to the left and z up.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.lighthouse.rotor import CHANNEL_TICKS
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.recordings.station_terms import SweepTerms
from swarm.user_text import parse_yaml, read_text, short

NAME = "system-config.yaml"
"""Name of the file beside a log that is taken without being asked for."""
TYPE = "lighthouse_system_configuration"
_GENERATIONS = {1: "1.0", 2: "2.0"}
_ORTHOGONAL = 1e-2
"""Largest deviation of R^T R from the identity: files have rounded estimates."""
_TERMS = ("phase", "tilt", "curve", "gibphase", "gibmag", "ogeephase", "ogeemag")
"""Keys of a sweep's values, in the order of `SweepTerms`."""


class ConfiguredStation(NamedTuple):
    """One station. terms: of both sweeps, None if not known. identity: its id, None likewise. rotation (3, 3),
    position (3,) [m]: its pose, None likewise.
    """

    terms: tuple[SweepTerms, SweepTerms] | None
    identity: str | None
    rotation: Floats | None
    position: Floats | None


class SystemConfig(NamedTuple):
    """A system configuration. generation: "1.0" or "2.0". stations: by number."""

    path: Path
    generation: str
    stations: dict[int, ConfiguredStation]


def config_beside(log: Path) -> SystemConfig | None:
    """Return the configuration in a log's folder, None if there is none.

    Raises:
        SwarmError: it is there, but cannot be read.
    """
    file = log.with_name(NAME)
    return read_system_config(file) if file.is_file() else None


def read_system_config(path: str | Path) -> SystemConfig:
    """Read a system configuration.

    Raises:
        SwarmError: the file cannot be read or is none; the message names file, key and value.
    """
    file = Path(path)
    data = parse_yaml(read_text(file, str(file), "a system configuration"), str(file), "a system configuration")
    if not isinstance(data, dict) or data.get("type") != TYPE:
        raise SwarmError(f"{file}: not a Crazyflie's system configuration: its type is not {TYPE!r}")
    generation = data.get("systemType")
    if isinstance(generation, bool) or not isinstance(generation, int) or generation not in _GENERATIONS:
        raise SwarmError(f"{file}: systemType must be 1 or 2, not {short(repr(generation))}")
    calibrations, poses = (_tables(data, key, file) for key in ("calibs", "geos"))
    stations = {}
    for number in sorted({*calibrations, *poses}):
        terms, identity = _calibration(calibrations.get(number), f"{file}: calibs, {number}")
        rotation, position = _pose(poses.get(number), f"{file}: geos, {number}")
        stations[number] = ConfiguredStation(terms, identity, rotation, position)
    return SystemConfig(file, _GENERATIONS[generation], stations)


def _tables(data: dict[Any, Any], key: str, file: Path) -> dict[int, dict[Any, Any]]:
    """Return the tables per station under a key."""
    tables = data.get(key) or {}
    if not isinstance(tables, dict):
        raise SwarmError(f"{file}: {key} must be a table, not {short(repr(tables))}")
    for number, table in tables.items():
        if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < len(CHANNEL_TICKS):
            raise SwarmError(
                f"{file}: {key}: a station's number is 0 to {len(CHANNEL_TICKS) - 1}, not {short(repr(number))}"
            )
        if not isinstance(table, dict):
            raise SwarmError(f"{file}: {key}, {number}: must be a table, not {short(repr(table))}")
    return tables


def _calibration(table: dict[Any, Any] | None, where: str) -> tuple[tuple[SweepTerms, SweepTerms] | None, str | None]:
    if table is None:
        return None, None
    sweeps = table.get("sweeps")
    if not isinstance(sweeps, list) or len(sweeps) != 2 or not all(isinstance(sweep, dict) for sweep in sweeps):
        raise SwarmError(f"{where}: sweeps must be two tables, not {short(repr(sweeps))}")
    first, second = (
        SweepTerms(*(_number(sweep, key, f"{where}, sweep {i}") for key in _TERMS)) for i, sweep in enumerate(sweeps)
    )
    uid = table.get("uid")
    return (first, second), None if uid is None else str(uid)


def _number(table: dict[Any, Any], key: str, where: str) -> float:
    if key not in table:
        raise SwarmError(f"{where}: {key} is missing{did_you_mean(key, map(str, table))}")
    value = table[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise SwarmError(f"{where}: {key} must be a finite number, not {short(repr(value))}")
    return float(value)


def _pose(table: dict[Any, Any] | None, where: str) -> tuple[Floats | None, Floats | None]:
    if table is None:
        return None, None
    rotation, origin = _array(table, "rotation", (3, 3), where), _array(table, "origin", (3,), where)
    if np.max(np.abs(rotation.T @ rotation - np.eye(3))) > _ORTHOGONAL or np.linalg.det(rotation) < 0:
        raise SwarmError(f"{where}: rotation is no rotation matrix")
    return rotation, origin


def _array(table: dict[Any, Any], key: str, shape: tuple[int, ...], where: str) -> Floats:
    if key not in table:
        raise SwarmError(f"{where}: {key} is missing{did_you_mean(key, map(str, table))}")
    try:
        values = np.array(table[key], dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.empty(0)
    if values.shape != shape or not np.isfinite(values).all():
        wanted = " x ".join(map(str, shape))
        raise SwarmError(f"{where}: {key} must be {wanted} finite numbers, not {short(repr(table[key]))}")
    return values
