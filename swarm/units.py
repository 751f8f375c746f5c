"""Units in names: the meaning of a suffix, and the conversion of a table's values to SI units by suffix.

A user reads and writes `field_deg = 120.0`; the program computes with `field_rad`. The suffix alone decides:

    si(table).field_rad == radians(table.field_deg)
    si(table).sync_jitter_s == 1e-9 * table.sync_jitter_ns
    si(table).thrust_error == table.thrust_error_percent / 100

Values in SI units, words, switches and counts keep their names and values.
"""

from collections.abc import Callable
from functools import cache
from math import radians
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from pydantic import BaseModel

ARCSEC = radians(1 / 3600)
"""One second of arc [rad]."""


class Unit(NamedTuple):
    """A unit as a suffix of a name.

    written: the unit as printed for a reader.
    si: the suffix of the same quantity in SI units, empty for a plain number.
    convert: the function that converts a value in this unit to SI units, None where the unit is one of them.
    """

    written: str
    si: str
    convert: Callable[[float], float] | None = None


def _times(factor: float) -> Callable[[float], float]:
    return lambda value: value * factor


UNITS: dict[str, Unit] = {
    "deg_per_rad": Unit("deg/rad", "rad_per_rad", radians),
    "m_per_rad": Unit("m/rad", "m_per_rad"),
    "per_s": Unit("1/s", "per_s"),
    "ppm": Unit("ppm", "", _times(1e-6)),
    "deg_s2": Unit("deg/s²", "rad_s2", radians),
    "rad_s2": Unit("rad/s²", "rad_s2"),
    "m_s2": Unit("m/s²", "m_s2"),
    "deg_s": Unit("deg/s", "rad_s", radians),
    "rad_s": Unit("rad/s", "rad_s"),
    "m_s": Unit("m/s", "m_s"),
    "hz": Unit("Hz", "hz"),
    "percent": Unit("%", "", lambda value: value / 100),
    "arcsec": Unit("arcsec", "rad", _times(ARCSEC)),
    "arcmin": Unit("arcmin", "rad", _times(radians(1 / 60))),
    "deg": Unit("deg", "rad", radians),
    "rad": Unit("rad", "rad"),
    "mm": Unit("mm", "m", _times(1e-3)),
    "um": Unit("um", "m", _times(1e-6)),
    "cm": Unit("cm", "m", _times(1e-2)),
    "km": Unit("km", "m", _times(1e3)),
    "ms": Unit("ms", "s", _times(1e-3)),
    "us": Unit("us", "s", _times(1e-6)),
    "ns": Unit("ns", "s", _times(1e-9)),
    "m": Unit("m", "m"),
    "s": Unit("s", "s"),
}
"""All suffixes that are units; the longer one comes first where one ends with another."""


def split_unit(key: str) -> tuple[str, Unit | None]:
    """Return `key` without its unit, and the unit; None where the name carries none."""
    for suffix, unit in UNITS.items():
        if key.endswith(f"_{suffix}"):
            return key.removesuffix(f"_{suffix}"), unit
    return key, None


def written_unit(key: str) -> str:
    """Return the unit of `key` as printed for a reader, empty where the name carries none."""
    unit = split_unit(key)[1]
    return "" if unit is None else unit.written


def si_name(key: str) -> str:
    """Return the name of `key` in SI units: `field_rad` for `field_deg`, `thrust_error` for a percentage."""
    stem, unit = split_unit(key)
    return key if unit is None else f"{stem}_{unit.si}" if unit.si else stem


class SI:
    """The values of one table in SI units, as read-only attributes; tables within it are converted likewise."""

    _table: "BaseModel"

    def __init__(self, table: "BaseModel") -> None:
        """Take a table, whose values are converted when they are first read."""
        vars(self)["_table"] = table

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        table, known = self._table, _fields(type(self._table))
        if name not in known:
            raise AttributeError(f"{type(table).__name__} has no {name!r} in SI units; it has {', '.join(known)}")
        key, convert = known[name]
        value = vars(self)[name] = _converted(getattr(table, key), convert)
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{type(self._table).__name__} is frozen: {name!r} cannot be set")

    def __dir__(self) -> list[str]:
        return sorted(_fields(type(self._table)))


def si(table: "BaseModel") -> SI:
    """Return the values of a scenario's table in SI units, under names with SI suffixes.

    A name that the table does not have raises AttributeError, which lists its names.
    """
    return SI(table)


@cache
def _fields(model: "type[BaseModel]") -> dict[str, tuple[str, Callable[[float], float] | None]]:
    """Return, for every name in SI units, the key in the table and the conversion."""
    units = {key: split_unit(key)[1] for key in model.model_fields}
    return {si_name(key): (key, None if unit is None else unit.convert) for key, unit in units.items()}


def _converted(value: Any, convert: Callable[[float], float] | None) -> Any:
    if isinstance(value, tuple):
        return tuple(_converted(entry, convert) for entry in value)
    if hasattr(type(value), "model_fields"):
        return SI(value)
    if convert is None or value is None or isinstance(value, str | bool):
        return value
    return convert(value)
