"""The scenarios, studies, craft models and recordings that come along, as `swarm list` and `swarm list NAME` tell them.

Every kind is a class here: its heading, one line and figures about each file of it, and all about one of them.
"""

import tomllib
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from swarm.assets import CRAFT, RECORDING, SCENARIO, STUDY, Kind, find_scenario
from swarm.cli.takes import RUN_S, START_S, Work, flight_s, in_words
from swarm.studies.papers.catalogue import MACHINE
from swarm.user_text import dotted_keys

RATE_HZ = 60.0
"""Lighthouse periods per second, where a scenario does not set it."""
DURATION_S = 30.0
"""Default of duration_s."""


class Entry:
    """One file that comes along.

    kind: its kind. head: heading of the kind's list. columns: headings of the figures beside a description.
    """

    kind: ClassVar[Kind]
    head: ClassVar[str]
    columns: ClassVar[tuple[str, ...]] = ()

    def __init__(self, name: str, path: Path) -> None:
        """Take the name, and the file of that name."""
        self.name, self.path = name, path

    @property
    def description(self) -> str:
        """One line about it."""
        raise NotImplementedError

    @property
    def figures(self) -> tuple[str, ...]:
        """Figures beside the description, one per column."""
        return ()

    @property
    def paragraphs(self) -> list[str]:
        """The text about it; indented lines are to stay as they are."""
        raise NotImplementedError

    @property
    def facts(self) -> dict[str, str]:
        """Facts by their headings."""
        raise NotImplementedError

    @property
    def use(self) -> str:
        """A command that uses it."""
        return self.kind.use.format(self.name)


class _Tables(Entry):
    """A TOML file with a key `description`, and a comment at its head."""

    @cached_property
    def _text(self) -> str:
        return self.path.read_text(encoding="utf-8")

    @cached_property
    def data(self) -> dict[str, Any]:
        """Its tables."""
        return tomllib.loads(self._text)

    @property
    def description(self) -> str:
        """The value of the key."""
        return str(self.data.get("description", ""))

    @property
    def paragraphs(self) -> list[str]:
        """The description, and the comment."""
        out: list[str] = []
        for line in self._text.splitlines():
            if not line.startswith("#"):
                break
            words = line.removeprefix("#").removeprefix(" ")
            if words.startswith("  "):
                out.append(f"  {words.strip()}")
            elif out and not out[-1].startswith("  "):
                out[-1] = f"{out[-1]} {words.strip()}"
            else:
                out.append(words.strip())
        return [f"{self.description}.", *out]


class ScenarioEntry(_Tables):
    """A scenario."""

    kind = SCENARIO
    head = "Scenarios: swarm run NAME"
    columns = ("craft", "flown\ns")

    @property
    def craft(self) -> int:
        """Number of craft."""
        return int(self.data.get("swarm", {}).get("count", 0)) + len(self._single)

    @property
    def duration_s(self) -> float:
        """Simulated time [s]."""
        return float(self.data.get("duration_s", DURATION_S))

    @property
    def _single(self) -> list[dict[str, Any]]:
        return list(self.data.get("craft", ()))

    @property
    def figures(self) -> tuple[str, ...]:
        """Number of craft, and simulated time [s]."""
        return str(self.craft), f"{self.duration_s:g}"

    def takes_s(self, duration_s: float, craft: int | None = None) -> float:
        """Return the processor time of a flight [s], also of another number of craft."""
        cameras, lidars = (sum(key in table for table in self._single) for key in ("ccd", "lidar"))
        rate_hz = float(self.data.get("lighthouse", {}).get("rate_hz", RATE_HZ))
        work = Work(self.craft if craft is None else craft, cameras, lidars, len(self.data.get("station", ())))
        return flight_s(duration_s * rate_hz, work)

    @property
    def facts(self) -> dict[str, str]:
        """Craft, motions, sensors, faults, criteria, and the time that it takes."""
        data, single, swarm = self.data, self._single, self.data.get("swarm", {})
        # A table of none is only the manner in which single craft are flown.
        many = [swarm] * bool(swarm.get("count"))
        models = [table.get("model", "mockup") for table in [*many, *single]]
        kinds = [table.get("motion", {}).get("kind", "hold") for table in [*many, *single]]
        lit = bool(many) or any(table.get("lighthouse", not table.get("passive")) for table in single)
        sensors = ["lighthouse photodiodes"] * lit
        for name, key in (("stereo cameras", "ccd"), ("LiDAR", "lidar")):
            sensors += [name] * any(key in table for table in single)
        criteria = data.get("criteria", ())
        return _told(
            {
                "craft": f"{self.craft}: {', '.join(dict.fromkeys(models))}",
                "motion": ", ".join(dict.fromkeys(kind for kind in kinds if kind)),
                "sensors": ", ".join(sensors),
                "faults": ", ".join(dict.fromkeys(fault["kind"] for fault in data.get("fault", ()))),
                "criteria": f"{len(criteria)}, exit code 1 if one does not hold" if criteria else "",
                "flown": f"{self.duration_s:g} s",
                "takes": f"{in_words(START_S + self.takes_s(self.duration_s))} on {MACHINE}",
                "file": str(self.path),
            }
        )


class StudyEntry(_Tables):
    """A study."""

    kind = STUDY
    head = "Studies: swarm study NAME"
    columns = ("runs", "flown\ns")

    @cached_property
    def base(self) -> ScenarioEntry:
        """The scenario that it flies."""
        path = find_scenario(str(self.data["base"]))
        return ScenarioEntry(path.stem, path)

    @cached_property
    def grid(self) -> dict[str, Any]:
        """Its keys, each with a list of values."""
        return dict(dotted_keys(self.data.get("grid", {})))

    @property
    def runs(self) -> int:
        """Number of runs."""
        seeds = self.data.get("seeds", 1)
        count = max(int(self.data.get("samples", 0)), 1) * (seeds if isinstance(seeds, int) else len(seeds))
        for values in self.grid.values():
            count *= len(values)
        return count

    @property
    def duration_s(self) -> float:
        """Simulated time of a run [s]."""
        overrides = self.data.get("overrides", ())
        said = [text.partition("=")[2] for text in overrides if text.startswith("duration_s=")]
        return float(said[-1]) if said else self.base.duration_s

    @property
    def figures(self) -> tuple[str, ...]:
        """Number of runs, and simulated time of one [s]."""
        return str(self.runs), f"{self.duration_s:g}"

    @property
    def facts(self) -> dict[str, str]:
        """The scenario, the number of runs and their differences, and the time that all take."""
        each = [self.base.takes_s(self.duration_s, count) for count in self.grid.get("swarm.count", [None])]
        grid = "; ".join(f"{key} = {value}" for key, value in self.grid.items())
        took = in_words(self.runs * (RUN_S + sum(each) / len(each)))
        return _told(
            {
                "scenario": f"{self.data['base']}, {self.duration_s:g} s each",
                "runs": str(self.runs),
                "differ in": ", ".join(filter(None, [grid, "seed" if self.data.get("seeds", 1) != 1 else ""])),
                "random": ", ".join(self.data.get("random", {})),
                "takes": f"{took} in all, by the time of one core",
                "file": str(self.path),
            }
        )


class _Described(Entry):
    """A file that a README or a page beside it describes."""

    @property
    def page(self) -> Path:
        """The README or the page."""
        raise NotImplementedError

    @cached_property
    def _first_paragraph(self) -> str:
        """The first paragraph of prose, on one line; empty where there is none."""
        if not self.page.is_file():
            return ""
        blocks = self.page.read_text(encoding="utf-8").split("\n\n")
        said = next((block for block in blocks if block.strip() and block.lstrip()[0] not in "#|-!"), "")
        return " ".join(said.split()).replace("`", "")

    @property
    def description(self) -> str:
        """The first sentence of the page."""
        return self._first_paragraph.partition(". ")[0].removesuffix(".")

    @property
    def paragraphs(self) -> list[str]:
        """The first paragraph of the page."""
        return [self._first_paragraph] if self._first_paragraph else []


class CraftEntry(_Described):
    """A craft model."""

    kind = CRAFT
    head = 'Craft: model = "NAME" in a scenario'

    @property
    def page(self) -> Path:
        """The model's README."""
        return self.path.with_name("README.md")

    @property
    def facts(self) -> dict[str, str]:
        """Mass, and what the craft carries."""
        from swarm.world.craft import load_craft

        craft = load_craft(self.path, passive=True)
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
        carries = carried or "nothing that navigates"
        return {"mass": f"{craft.mass:.4g} kg", "carries": carries, "file": str(self.path)}

    @property
    def use(self) -> str:
        """A command that flies it."""
        return f'swarm run formation --set swarm.model="{self.name}"'


class RecordingEntry(_Described):
    """A recording."""

    kind = RECORDING
    head = "Recordings: swarm replay NAME"

    @property
    def page(self) -> Path:
        """The page of the same name."""
        return self.path.with_name(f"{self.name}.md")

    @property
    def facts(self) -> dict[str, str]:
        """The command that lists its contents."""
        return {"contents": f"swarm replay {self.name} --list", "file": str(self.path)}


ENTRIES: tuple[type[Entry], ...] = (ScenarioEntry, StudyEntry, CraftEntry, RecordingEntry)
"""All kinds, in the order of the list."""


def entries() -> dict[type[Entry], list[Entry]]:
    """Return all files that come along, by their kind, each kind by name."""
    return {kind: [kind(name, path) for name, path in sorted(kind.kind.known().items())] for kind in ENTRIES}


def _told(facts: Mapping[str, str]) -> dict[str, str]:
    """Return the facts that say something."""
    return {head: fact for head, fact in facts.items() if fact}
