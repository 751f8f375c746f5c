"""All about one scenario, study, craft model or recording that comes along, for `swarm list NAME`.

The time is that of a processor of 2021 that does little else, by what `benchmarks/whole_loop.py` measures (docs/
performance.md): per period of 1/60 s a fixed part, a part per craft, and one per pair of cameras and per LiDAR.
"""

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarm.cli.list import craft_count, description, duration_s, flat, read, run_count

if TYPE_CHECKING:
    from rich.console import Console

    from swarm.assets import Kind

START_S, RUN_S = 2.0, 0.5
PERIOD_S, CRAFT_S, CAMERAS_S, LIDAR_S = 1.7e-3, 18e-6, 1.5e-3, 4e-3
RATE_HZ = 60.0
MOST_WIDTH = 88


def print_about(console: "Console", kind: "Kind", name: str) -> None:
    """Print all about the one of this name."""
    from rich.text import Text

    path = kind.known()[name]
    width = min(console.width, MOST_WIDTH)
    console.print(Text(f"{name}, a {kind.what}", "bold"))
    text, facts = _text(kind.what, name, path), _facts(kind.what, path)
    for paragraph in text:
        for line in [paragraph] if paragraph.startswith("  ") else textwrap.wrap(paragraph, width):
            console.print(line, highlight=False, markup=False, soft_wrap=True)
        console.print()
    column = max(map(len, facts))
    for head, fact in facts.items():
        room = max(width - column - 2, 20)
        lines = textwrap.wrap(fact, room, break_on_hyphens=False, break_long_words=False) or [""]
        for i, line in enumerate(lines):
            console.print(f"{head if i == 0 else '':<{column}}  {line}", highlight=False, markup=False, soft_wrap=True)
    use = f'swarm run formation --set swarm.model="{name}"' if kind.what == "craft model" else kind.use.format(name)
    console.print(f"\n{use}", style="bold", highlight=False, markup=False, soft_wrap=True)


def _text(what: str, name: str, path: Path) -> list[str]:
    """Return the paragraphs about it: the description, and the comment at the head of its file, or its README's."""
    if what in ("scenario", "study"):
        return [f"{description(what, name, path)}.", *_head(path.read_text(encoding="utf-8"))]
    readme = path.with_name("README.md" if what == "craft model" else f"{name}.md")
    if not readme.is_file():
        return []
    blocks = readme.read_text(encoding="utf-8").split("\n\n")
    said = (block for block in blocks if block.strip() and block.lstrip()[0] not in "#|-!")
    return [" ".join(block.split()).replace("`", "") for block in said][:1]


def _head(text: str) -> list[str]:
    """Return the paragraphs of the comment that a TOML file begins with; indented lines stay as they are."""
    out: list[str] = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        words = line.removeprefix("#").removeprefix(" ")
        if words.startswith("  "):
            out.append(f"  {words.strip()}")
        elif out and not out[-1].startswith("  "):
            out[-1] = f"{out[-1]} {words.strip()}"
        else:
            out.append(words.strip())
    return out


def _facts(what: str, path: Path) -> dict[str, str]:
    if what == "scenario":
        return _scenario_facts(read(path)) | {"file": str(path)}
    if what == "study":
        return _study_facts(read(path)) | {"file": str(path)}
    if what == "craft model":
        return _craft_facts(path) | {"file": str(path)}
    return {"contents": f"swarm replay {path.name.partition('.')[0]} --list", "file": str(path)}


def _scenario_facts(data: dict[str, Any]) -> dict[str, str]:
    single = data.get("craft", [])
    models = [table.get("model", "mockup") for table in [data.get("swarm", {})] * bool(data.get("swarm")) + single]
    kinds = [table.get("motion", {}).get("kind", "hold") for table in [data.get("swarm", {}), *single]]
    lit = bool(data.get("swarm")) or any(table.get("lighthouse", not table.get("passive")) for table in single)
    sensors = ["lighthouse photodiodes"] * lit
    sensors += [name for name, key in (("stereo cameras", "ccd"), ("LiDAR", "lidar")) if any(key in t for t in single)]
    parts = {
        "craft": f"{craft_count(data)}: {', '.join(dict.fromkeys(models))}",
        "motion": ", ".join(dict.fromkeys(kind for kind in kinds if kind)),
        "sensors": ", ".join(sensors),
        "faults": ", ".join(dict.fromkeys(fault["kind"] for fault in data.get("fault", ()))),
        "criteria": f"{len(data['criteria'])}, exit code 1 if one does not hold" if data.get("criteria") else "",
        "flown": f"{duration_s(data):g} s",
        "takes": _told(START_S + _flight_s(data, craft_count(data), duration_s(data))),
    }
    return {head: fact for head, fact in parts.items() if fact}


def _study_facts(data: dict[str, Any]) -> dict[str, str]:
    from swarm.assets import find_scenario

    base = read(find_scenario(str(data["base"])))
    seconds, values = duration_s(base, data.get("overrides", ())), dict(flat(data.get("grid", {})))
    counts = values.get("swarm.count", [])
    each = [_flight_s(base, count, seconds) for count in counts or [craft_count(base)]]
    runs = run_count(data)
    grid = "; ".join(f"{key} = {value}" for key, value in values.items())
    parts = {
        "scenario": f"{data['base']}, {seconds:g} s each",
        "runs": str(runs),
        "differ in": ", ".join(filter(None, [grid, "seed" if data.get("seeds", 1) != 1 else ""])),
        "random": ", ".join(data.get("random", {})),
        "takes": _told(runs * (RUN_S + sum(each) / len(each)), " in all, by the time of one core"),
    }
    return {head: fact for head, fact in parts.items() if fact}


def _craft_facts(path: Path) -> dict[str, str]:
    from swarm.world.craft import load_craft

    craft = load_craft(path, passive=True)
    numbers = (
        (len(craft.point_m), "photodiodes"),
        (len(craft.cameras.position_m), "cameras"),
        (len(craft.lights.point_m), "lights"),
        (len(craft.thrusters.point_m), "thrusters"),
        (len(craft.wheels.axis), "reaction wheels"),
        (int(craft.lidar is not None), "LiDAR"),
        (int(craft.port is not None), "docking port"),
    )
    carried = ", ".join(f"{count} {what}" for count, what in numbers if count)
    return {"mass": f"{craft.mass:.4g} kg", "carries": carried or "nothing that navigates"}


def _flight_s(data: dict[str, Any], craft: int, seconds: float) -> float:
    """Return the processor time of a flight [s]."""
    single = data.get("craft", ())
    cameras, lidars = (sum(key in table for table in single) for key in ("ccd", "lidar"))
    return seconds * RATE_HZ * (PERIOD_S + CRAFT_S * craft + CAMERAS_S * cameras + LIDAR_S * lidars)


def _told(seconds: float, where: str = " on a core that does little else") -> str:
    if seconds < 90:
        return f"about {max(round(seconds / 5) * 5, 5)} s{where}"
    return f"about {round(seconds / 60)} min{where}" if seconds < 5400 else f"about {seconds / 3600:.1f} h{where}"
