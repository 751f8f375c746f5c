"""libsurvive's configuration file: what it knows of the stations, of either generation.

libsurvive writes `"key":"value"` pairs and `"lighthouse0":{...}` tables in which commas and outer braces may be
missing; real JSON is read, too. A station's `fcal*` values, two each, are its factory calibration per sweep as the
station sent it (OOTX); `mode` is the channel of a station of Lighthouse 2.0, `id` tells it from all others, and `pose`
is its pose in libsurvive's world. The number of a table is libsurvive's own, which `A` lines have; lines of Lighthouse
2.0 have the channel.
"""

import math
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimators.lighthouse.rotor import CHANNEL_TICKS
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.recordings.libsurvive import WorldPose, station_id
from swarm.flight.recordings.station_terms import SweepTerms
from swarm.user_text import parse_json, read_text, short, user_path

_TOKEN = re.compile(r'(?P<space>\s*)(?P<token>"(?:[^"\\]|\\.)*"|[{}\[\]:,]|[^\s{}\[\]:,"]+)')
_TERMS = ("fcalphase", "fcaltilt", "fcalcurve", "fcalgibpha", "fcalgibmag")
_OGEE = ("fcalogeephase", "fcalogeemag")
"""Keys of the values, in the order of `SweepTerms`; those of the ogee only of Lighthouse 2.0."""


class FactoryStation(NamedTuple):
    """One station of libsurvive's file.

    number: libsurvive's. channel: its mode, which is the channel if it is of Lighthouse 2.0, None if not given.
    identity: its id, as `station_id` returns it.
    terms: of both sweeps, None if they had not been received. pose: in libsurvive's world, None if not known.
    """

    number: int
    channel: int | None
    identity: str | None
    terms: tuple[SweepTerms, SweepTerms] | None
    pose: WorldPose | None


def read_factory_stations(path: str | Path) -> list[FactoryStation]:
    """Read all stations of libsurvive's file.

    Raises:
        SwarmError: the file cannot be read or is invalid, or names no station; the message names file, key and value.
    """
    file = Path(path)
    data = tolerant_json(read_text(user_path(path), str(path), "a calibration file"), file)
    names = [key for key in data if re.fullmatch(r"lighthouse\d{1,4}", key) and isinstance(data[key], dict)]
    if not names:
        raise SwarmError(f"{file}: no station, such as 'lighthouse0', is in the file")
    return [_station(data[name], int(name.removeprefix("lighthouse")), f"{file}, {name}") for name in names]


def _station(table: dict[str, Any], number: int, where: str) -> FactoryStation:
    terms, pose = sweep_terms(table, where), pose_of(table, where)
    return FactoryStation(number, _channel(table, where), identity_of(table), terms, pose)


def sweep_terms(table: dict[str, Any], where: str) -> tuple[SweepTerms, SweepTerms] | None:
    """Return a station's factory calibration of both sweeps, None if it had not been received.

    Raises SwarmError, opened by `where`, for a missing key or a damaged value.
    """
    if table.get("OOTXSet", "1") == "0":
        return None
    # Values of Lighthouse 1.0 have no ogee.
    columns = [
        numbers(table, key, 2, where) if key in table or key not in _OGEE else [0.0, 0.0] for key in (*_TERMS, *_OGEE)
    ]
    return SweepTerms(*(first for first, _ in columns)), SweepTerms(*(second for _, second in columns))


def _channel(table: dict[str, Any], where: str) -> int | None:
    """Return a station's channel, None if it has none, or a negative one."""
    mode = table.get("mode")
    if mode is None:
        return None
    try:
        channel = int(str(mode))
    except ValueError:
        channel = len(CHANNEL_TICKS)
    if channel >= len(CHANNEL_TICKS):
        raise SwarmError(f"{where}: mode must be a channel, 0 to {len(CHANNEL_TICKS) - 1}, not {short(repr(mode))}")
    return channel if channel >= 0 else None


def station_table(data: dict[str, Any], name: str, file: Path) -> dict[str, Any]:
    """Return the table of a station.

    Args:
        data: all of the file.
        name: of the station, such as "lighthouse0".
        file: the file, for the message.

    Raises:
        SwarmError: the file has no such station.
    """
    stations = [key for key in data if key.startswith("lighthouse") and isinstance(data[key], dict)]
    if name not in stations:
        raise SwarmError(f"{file}: no station {name!r}{did_you_mean(name, stations) or '; the file has none'}")
    table: dict[str, Any] = data[name]
    return table


def pose_of(table: dict[str, Any], where: str) -> WorldPose | None:
    """Return a station's pose, None if it is not known; raise SwarmError if it is none."""
    if "pose" not in table or table.get("PositionSet", "1") == "0":
        return None
    values = np.array(numbers(table, "pose", 7, where))
    length = float(np.linalg.norm(values[3:]))
    if abs(length - 1) > 1e-2:
        raise SwarmError(f"{where}: pose must end with a unit quaternion, its length is {length:.4g}")
    return WorldPose(values[:3], values[3:] / length)


def identity_of(table: dict[str, Any]) -> str | None:
    """Return a station's id, None if it has none."""
    return station_id(str(table["id"])) if table.get("id") is not None else None


def numbers(table: dict[str, Any], key: str, count: int, where: str) -> list[float]:
    """Return the finite numbers under a key of libsurvive's file, in which numbers are written as strings.

    Args:
        table: a station's.
        key: the key.
        count: how many numbers there must be.
        where: opens the message.

    Raises:
        SwarmError: the key is missing, or has something else.
    """
    if key not in table:
        raise SwarmError(f"{where}: {key} is missing{did_you_mean(key, table)}")
    try:
        values = [float(value) for value in table[key]]
    except (TypeError, ValueError, OverflowError):
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise SwarmError(f"{where}: {key} must be {count} numbers, not {short(repr(table[key]))}")
    return values


def tolerant_json(text: str, file: Path) -> dict[str, Any]:
    """Parse JSON in which commas and the outer braces may be missing; line numbers in messages are the file's."""
    out, previous, end = [], "", 0
    for match in _TOKEN.finditer(text):
        if match.start() != end:
            break
        end, token = match.end(), match["token"]
        if previous and previous not in "{[:," and token not in "}]:,":
            out.append(",")
        elif previous == "," and token in "}]":
            out.pop()
        out += [match["space"], token]
        previous = token
    if text[end:].strip():
        raise SwarmError(f"{file}, line {text.count(chr(10), 0, end) + 1}: a string is not closed: the file is damaged")
    joined = "".join(out)
    whole = joined if joined.lstrip().startswith("{") else "{" + joined + "}"
    return dict(parse_json(whole, str(file), "a calibration file"))
