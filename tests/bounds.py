"""Flights with one number of the scenario at a limit, of every table and key of the schema.

    python tests/bounds.py            flies all of them for a few periods each, and prints what does not fly

A case is a scenario in which the number's table is in use. A vector is at a limit in its first component. Cases that
would take hours or gigabytes are named in `COSTLY` with the reason, and are only loaded.
"""

import math
import sys
import tempfile
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.compute as pc

import swarm
from swarm.errors import SwarmError
from swarm.scenario import Scenario, load
from swarm.scenario.limits import Limits, limits_of
from swarm.scenario.mistakes import kind_of
from swarm.scenario.reference import every_number
from swarm.scenario.table import Table
from swarm.scenario.text import toml_value

DURATION_S = 0.1
ALONE = (
    "[swarm]\ncount = 0\n[[craft]]\nname = 'a'\nmotion = {{ {motion} }}\n{table}\n"
    "[[craft]]\nname = 'b'\nmotion = {{ kind = 'hold', position_m = [0.8, 0.0, 3.0] }}\n"
)
HOLD = "kind = 'hold', position_m = [0.0, 0.0, 2.0]"
NEEDS: dict[str, dict[str, Any]] = {
    "ring": {"radius_m": 1.0},
    "waypoints": {"points_m": [[0.0, 0.0, 2.0], [0.1, 0.0, 2.0]], "times_s": [0.0, 5.0]},
    "approach": {"from_m": [0.0, 0.0, 3.0], "to_m": [0.0, 0.0, 2.0], "speed_m_s": 0.1},
    "formation": {"figures": [{"shape": "ring", "radius_m": 1.0}]},
    "dock": {"from_m": [0.4, -0.3, 4.0], "target": "b"},
    "photodiode-dead": {"photodiodes": [0]},
    "photodiode-stuck": {"photodiodes": [0]},
    "ghosts": {"share": 0.5},
    "rotor-drift": {"for_s": 1.0, "speed_ppm": 0.5},
    "thruster-stuck": {"thruster": 0, "state": "on", "craft": ["a"]},
}
"""Keys that a kind cannot be without; a fault also needs its time, 0 s."""
COSTLY = {
    ("Scenario", "duration_s", "high"): "a day",
    ("Swarm", "count", "high"): "ten thousand craft",
    ("Lidar", "resolution_deg", "low"): "a scan of 290 000 rays, compared from every attitude",
    ("Lidar", "lines", "high"): "a scan of 460 000 rays, compared from every attitude",
}


PARTNERS: dict[str, dict[str, Any]] = {
    "range_min_m": {"range_max_m": 10000.0},
    "range_max_m": {"range_min_m": 0.0},
    "image_noise_um": {"believed_noise_um": 1.0},
    "from_s": {"to_s": 86400.0},
    "to_s": {"from_s": 0.0},
    "sun_phase_deg": {"altitude_km": 400.0},
    "sun_beta_deg": {"altitude_km": 400.0},
    "from_m": {"to_m": 0.0},
    "to_m": {"from_m": 10000.0},
    "unseen_acceleration_m_s2": {"false_photodiodes": 1},
    "unseen_angular_acceleration_deg_s2": {"false_photodiodes": 1},
}
WANDER: dict[str, dict[str, Any]] = {
    "speed_m_s": {"size_m": [100.0, 100.0, 100.0], "bandwidth_hz": 30.0},
    "turn_deg": {"turn_rate_deg_s": 0.0},
    "turn_rate_deg_s": {"turn_deg": 180.0, "bandwidth_hz": 30.0},
    "bandwidth_hz": {"speed_m_s": 0.0, "turn_rate_deg_s": 0.0},
}
"""Values of a second key, which the first one must lie beside."""
EXCLUDED = {("Ccd", "range_min_m", "high"), ("Lighthouse", "range_min_m", "high"), ("Outage", "from_s", "high")}
EXCLUDED |= {("Outage", "to_s", "low"), ("Outage", "from_m", "low"), ("Outage", "to_m", "high")}
EXCLUDED |= {("PhotodiodeDead", "photodiodes", "high"), ("PhotodiodeStuck", "photodiodes", "high")}
EXCLUDED |= {("ThrusterStuck", "thruster", "high"), ("Integrity", "false_stations", "high")}
"""Limits at which something else is refused: an empty range or time, a part that no model has, and stations
where there are none."""


class Case(NamedTuple):
    """One number at one limit. text: the scenario; beyond: the same with the number just outside the limit."""

    table: str
    key: str
    side: str
    text: str
    beyond: str


def cases() -> Iterator[Case]:
    """Yield the flights of every number at its lower and at its upper limit."""
    for table, key, field in every_number():
        limits = next(limits_of(field))
        for side in ("low", "high"):
            if (table.__name__, key, side) in EXCLUDED:
                continue
            value = _value(table, key, limits, side)
            beyond = _value(table, key, limits, side, outside=True)
            yield Case(table.__name__, key, side, *(_text(table, {key: v}) for v in (value, beyond)))


def load_case(case: Case, folder: Path, *, beyond: bool = False) -> Scenario:
    """Return the scenario of a case, or of the value beyond the limit. Raises SwarmError where it is refused."""
    file = folder / "bounds.toml"
    file.write_text(case.beyond if beyond else case.text)
    short = () if case.key == "duration_s" else (f"duration_s={DURATION_S}",)
    return load(file, short)


def infinite_columns(settings: Scenario, folder: Path) -> list[str]:
    """Fly a scenario, and return the columns of its telemetry that have an infinite number. Null is good: unknown."""
    run = swarm.simulate(settings, out=folder / "run", force=True, record=False)
    table = run.telemetry
    numbers = [name for name in table.column_names if str(table[name].type) in ("double", "float")]
    return [name for name in numbers if pc.any(pc.is_inf(table[name])).as_py()]


def _value(table: type[Table], key: str, limits: Limits, side: str, *, outside: bool = False) -> Any:
    """Return a value for `key`: the limit, or a number outside it, or a list with that."""
    limit = limits.low if side == "low" else limits.high
    limit = 0.0 if limit is None else limit
    for name, towards in (("gt", math.inf), ("lt", -math.inf)):
        if any(getattr(m, name, None) == limit for m in table.model_fields[key].metadata):
            limit = (
                limit + int(math.copysign(1, towards))
                if key in ("seed", "mounting_seed")
                else math.nextafter(float(limit), towards)
            )
    if outside:
        limit = limit + (-1 if side == "low" else 1) * max(1, abs(limit))
    annotation = str(table.model_fields[key].annotation)
    shown = table.model_fields[key].default
    if "tuple" not in annotation:
        whole = table.model_fields[key].annotation is int or annotation.startswith("int")
        return int(limit) if whole else float(limit)
    if key == "points_m":
        return [[limit, 0.0, 2.0], [0.1, 0.0, 2.0]]
    if key == "times_s":
        return [limit, 5.0] if side == "low" else [0.0, limit]
    if key in ("photodiodes", "hold_s", "hold_ranges_m"):
        return [limit]
    first = {"from_m": [0.4, -0.3, 4.0], "to_m": [0.0, 0.0, 2.0]}.get(key, [0.0, 0.0, 3.0])
    rest = list(shown)[1:] if isinstance(shown, tuple) and shown else first[1:]
    return [limit, *rest] if key != "box_m" else [limit] * 3


def _count(values: dict[str, Any]) -> int:
    """Return a number of craft that do not start inside each other."""
    sizes = [value for key, value in values.items() if key in ("spacing_m", "radius_m", "length_m")]
    return 1 if "box_m" in values or any(size < 1 for size in sizes) else 3


def _inline(values: dict[str, Any]) -> str:
    return ", ".join(f"{key} = {toml_value(value)}" for key, value in values.items())


def _motion(motion: str, craft: str = "", table: str = "") -> str:
    return ALONE.format(motion=motion, table=f"{craft}\n{table}")


def _text(table: type[Table], values: dict[str, Any]) -> str:
    """Return a scenario in which `table` has these values and is in use."""
    name, kind, said = table.__name__, kind_of(table), _inline(values)
    if kind and table.__module__.endswith("faults"):
        timed = {"at_s": 0.0, **NEEDS.get(kind, {})}
        if "probability_per_s" in values:
            timed.pop("at_s")
        fault = f"[[fault]]\nkind = '{kind}'\n" + "\n".join(
            f"{key} = {toml_value(value)}" for key, value in {**timed, **values}.items()
        )
        model = "model = 'cubesat12u'" if kind == "thruster-stuck" else ""
        return _motion(HOLD, model) + fault
    if kind in ("formation", "drift", "hold", "tumble", "ring", "keep"):
        motion = _inline({"kind": kind, **NEEDS.get(kind, {}), **values})
        return f"[swarm]\ncount = {_count(values)}\nfeedback = 'truth'\nmotion = {{ {motion} }}"
    if kind == "dock":
        speeds = (
            {"closing_speed_m_s": 1e-6, "speed_m_s": 100.0} if {"closing_speed_m_s", "speed_m_s"} & set(values) else {}
        )
        motion = _inline({"kind": kind, **NEEDS["dock"], **speeds, **values})
        return (
            f"[swarm]\ncount = 0\n[[craft]]\nname = 'a'\nmodel = 'servicer'\nfeedback = 'estimate'\n"
            f"motion = {{ {motion} }}\n[[craft]]\nname = 'b'\nmodel = 'berth'\nlighthouse = false\n"
            "motion = { kind = 'hold', position_m = [0.0, 0.45, 0.35], attitude = { facing = false } }\n"
        )
    if kind:
        room = WANDER.get(next(iter(values)), {}) if kind == "wander" else {}
        return _motion(_inline({"kind": kind, **NEEDS.get(kind, {}), **room, **values}))
    if name == "Attitude":
        return _motion(f"{HOLD}, attitude = {{ {said} }}")
    if name == "Figure":
        shape = {"shape": "line", "length_m": 1.0} if "length_m" in values else {"shape": "ring", "radius_m": 1.0}
        figures = [{**shape, **values}] if "at_s" not in values or not values["at_s"] else [shape, {**shape, **values}]
        motion = _inline({"kind": "formation", "figures": figures})
        return f"[swarm]\ncount = {_count(values)}\nmotion = {{ {motion} }}"
    if name == "Criterion":
        limit = {} if {"min", "max"} & set(values) else {"max": 1.0}
        return (
            _motion(HOLD)
            + f"[[criteria]]\nmeasure = 'adop_deg_per_rad'\n{said.replace(', ', chr(10))}\n"
            + "\n".join(f"{key} = {value}" for key, value in limit.items())
        )
    return _of_the_rest(name, values, said)


def _of_the_rest(name: str, values: dict[str, Any], said: str) -> str:
    lines = "\n".join(f"{key} = {toml_value(value)}" for key, value in values.items())
    if name == "Scenario":
        return f"{lines}\n{_motion(HOLD)}"
    if name == "Swarm":
        return f"[swarm]\n{lines}\n[[craft]]\nmotion = {{ {HOLD} }}"
    if name in ("Disturbance", "Scatter", "Actuation"):
        return _motion(HOLD, "model = 'cubesat12u'", f"{name.lower()} = {{ {said} }}")
    if name in ("Ccd", "Outage"):
        more = PARTNERS.get(next(iter(values)), {})
        ccd = {"target": "t", **more, **values} if name == "Ccd" else {"target": "t", "outages": [{**more, **values}]}
        return (
            "[swarm]\ncount = 0\n[[craft]]\nname = 'a'\nmodel = 'chaser'\nlighthouse = false\n"
            "motion = { kind = 'hold', position_m = [0.0, 2.5, 12.0], "
            "attitude = { facing = false, pitch_deg = 180.0 } }\n"
            f"ccd = {{ {_inline(ccd)} }}\n[[craft]]\nname = 't'\nmodel = 'marker-target'\n"
            "motion = { kind = 'hold', position_m = [0.0, 2.5, 4.0], attitude = { facing = false } }\n"
        )
    if name == "Lidar":
        more = PARTNERS.get(next(iter(values)), {})
        lidar = {"target": "t", "resolution_deg": 2.0, **more, **values}
        fast = "[lighthouse]\nrate_hz = 300.0\n" if "rate_hz" in values else ""
        return (
            "[swarm]\ncount = 0\n[[craft]]\nname = 'a'\nmodel = 'inspector'\n"
            "motion = { kind = 'hold', position_m = [3.0, 0.0, 12.0], "
            "attitude = { facing = false, pitch_deg = 180.0 } }\n"
            f"lidar = {{ {_inline(lidar)} }}\n[[craft]]\nname = 't'\nmodel = 'satellite'\npassive = true\n"
            "motion = { kind = 'tumble', position_m = [0.0, 0.0, 12.0], attitude = { facing = false } }\n" + fast
        )
    if name in ("Station", "Pointing", "Plane"):
        station = {"Station": said, "Pointing": f"attitude = {{ {said} }}", "Plane": f"plane_1 = {{ {said} }}"}[name]
        stations = f"[[station]]\nname = 's'\n{station}\n[[station]]\nname = 't'\nposition_m = [2.0, 0.0, 1.0]\n"
        return _motion(HOLD) + stations + "attitude = { towards_m = [0.0, 0.0, 2.0] }\n"
    if name == "Pair":
        places = zip("ab", (0.0, 0.5), strict=True)
        two = "".join(
            f"[[craft]]\nname = '{n}'\nmotion = {{ kind = 'hold', position_m = [{x}, 0.0, 3.0] }}\n" for n, x in places
        )
        return f"[swarm]\ncount = 0\n{two}[[pair]]\ncraft = 'a'\nto = 'b'\n{said}\n"
    head = {
        "Physics": "physics",
        "Orbit": "orbit",
        "Lighthouse": "lighthouse",
        "Fan": "lighthouse.fan_x",
        "Navigation": "navigation",
        "FanSigma": "navigation.fan_sigma",
        "Integrity": "navigation.integrity",
        "Quiet": "navigation.quiet",
    }[name]
    if name in ("Lighthouse", "Orbit", "Integrity"):
        partner = PARTNERS.get(next(iter(values)), {})
        lines += "".join(f"\n{key} = {min(value, 1000)}" for key, value in partner.items())
    quiet = "\n[lighthouse]\nangle_noise_arcsec = 0.0\n" if name == "Navigation" else ""
    return _motion(HOLD) + f"[{head}]\n{lines}\n{quiet}"


def main() -> int:
    """Fly all cases, and return the exit code."""
    wrong = 0
    with tempfile.TemporaryDirectory() as name:
        for number, case in enumerate(cases()):
            label = f"{number} {case.table}.{case.key} {case.side}"
            try:
                settings = load_case(case, Path(name))
                if (case.table, case.key, case.side) in COSTLY:
                    continue
                found = infinite_columns(settings, Path(name))
                said = f"infinite: {', '.join(found)}" if found else ""
            except SwarmError as error:
                said = f"refused: {error!s:.300}"
            except Exception as error:
                place = traceback.extract_tb(error.__traceback__)[-1]
                said = f"{type(error).__name__}: {error!s:.200} at {place.filename}:{place.lineno}"
            if said:
                wrong += 1
                print(label, said, flush=True)
        print(f"{number + 1} cases, {wrong} do not fly")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
