"""A value and the limits of a criterion, in a unit that suits their size: one form for the terminal and the page."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from swarm.report.numbers import number
from swarm.units import written_unit

SMALLER, SMALLER_BELOW = {"m": "mm", "m/s": "mm/s"}, 0.1
"""Units in which small figures are shown, and what is small."""


class Measured(NamedTuple):
    """The value that was measured, "53.6 mm" or "no value", and its limits, "≤ 2 mm"."""

    value: str
    limits: str


def measured(verdict: Mapping[str, Any]) -> Measured:
    """Return the value and the limits of a verdict, with the unit that its name tells."""
    unit, scale = written_unit(verdict["name"]), 1.0
    # By its limits, so that a value far off has their unit.
    if unit in SMALLER and max(abs(v) for v in (verdict["min"], verdict["max"]) if v is not None) < SMALLER_BELOW:
        unit, scale = SMALLER[unit], 1000.0
    unit = unit.replace("deg", "°")
    value, least, most = (None if verdict[key] is None else scale * verdict[key] for key in ("value", "min", "max"))
    both = f"{least:g} to {most:g}" if least is not None and most is not None else ""
    limits = both or (f"≤ {most:g}" if least is None else f"≥ {least:g}")
    shown = "no value" if value is None else f"{number(value)} {unit}".strip()
    return Measured(shown, f"{limits} {unit}".strip())
