"""The gallery of the documentation: every scenario that comes along, flown and drawn.

    python benchmarks/gallery.py                      # all: some minutes of a processor
    python benchmarks/gallery.py --only orbit drift   # these; the others keep what is known of them

Writes docs/gallery.md, and a picture per scenario in docs/gallery/. What was measured is in docs/gallery/gallery.json,
so that one scenario can be flown again without the others. Times are of the processor.
"""

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from swarm.world.offscreen import choose

choose()

from harness import machine, options  # noqa: E402

from swarm.assets import scenarios  # noqa: E402
from swarm.exports.video import Options, still  # noqa: E402
from swarm.flight.simulate import simulate  # noqa: E402
from swarm.report.numbers import number  # noqa: E402
from swarm.scenario import load  # noqa: E402

ROOT = Path(__file__).parents[1]
PAGE, FOLDER = ROOT / "docs" / "gallery.md", ROOT / "docs" / "gallery"
SIZE = Options(width=800, height=450)
AT = {"docking": 40.0, "ccd-docking": 20.0, "formation-reconfigure": 45.0, "crossing": 8.0}
"""Times of the pictures [s] of scenarios whose middle is not what they are about."""
SHORT = {"dotbots1000": 2.0, "constellation16": 2.0, "swarm1000": 1.0, "swarm-inspect": 6.0}
"""Times [s] after which the flights of large crowds end here: the picture and the errors are much the same later."""
FIRST = """# Gallery
<!-- figures: unmeasurable, the page is written by python benchmarks/gallery.py; times are of the machine -->

Every scenario that comes along, flown whole, but for large crowds, of which the first seconds are. The picture is one
of `swarm video RUN FILE.png`: the craft, the light that reaches them, and the axes of their bodies as they believe to
be turned. `swarm list NAME` tells more about one, and `swarm view RUN` shows all of it in the viewer. Times are
processor times on a busy machine ({machine}), with whatever had to be compiled: on an idle one they are shorter.{notes}
"""
MISSING = """ Scenarios without
a picture were not flown for this page yet."""
OLDER = """

The figures of these were measured before the filter had [several models of motion](filter.md), and have changed since:
{names}."""


def flown(name: str, folder: Path) -> dict[str, Any]:
    """Fly a scenario and draw it; return its figures."""
    scenario = load(name, {"duration_s": SHORT[name]} if name in SHORT else {})
    begin = time.process_time()
    run = simulate(scenario, out=folder / name)
    took_s = time.process_time() - begin
    still(run.folder, FOLDER / f"{name}.png", AT.get(name), SIZE)
    swarm = run.summary["swarm"]
    keys = ("tracking_share", "ekf_position_rms_m", "ekf_attitude_rms_deg")
    return {
        "processor_s": took_s,
        "criteria_held": run.summary.get("criteria_held"),
        "models": scenario.navigation.quiet.models,
        "groups": {
            group: {key: each.get(key) for key in keys} for group, each in run.summary.get("groups", {}).items()
        },
        **{key: swarm.get(key) for key in keys},
    }


def entry(name: str, figures: dict[str, Any] | None) -> str:
    """Return the part of the page about one scenario, without figures where it was not flown yet."""
    scenario = load(name)
    told = scenario.description.rstrip(".")
    facts = [f"{len(scenario.craft_names)} craft", f"{scenario.duration_s:g} s"]
    if figures is None:
        return "\n".join([f"## {name}", "", f"{told}.", "", f"`swarm run {name}`: {'; '.join(facts)}.", ""])
    part = f" for the first {SHORT[name]:g} s" if name in SHORT else ""
    facts.append(f"{figures['processor_s']:.0f} s of a processor{part}")
    results = [("", figures)] if figures["ekf_position_rms_m"] is not None else list(figures["groups"].items())
    for group, each in results:
        if each["ekf_position_rms_m"] is not None:
            errors = f"{number(each['ekf_position_rms_m'], scale=1e3)} mm and {number(each['ekf_attitude_rms_deg'])}°"
            facts.append(f"{group + ': ' if group else ''}errors of {errors} RMS")
    if figures["criteria_held"] is not None:
        facts.append("all criteria held" if figures["criteria_held"] else "not all criteria held")
    lines = [f"## {name}", "", f"{told}.", "", f"![{told}](gallery/{name}.png)", ""]
    return "\n".join([*lines, f"`swarm run {name}`: {'; '.join(facts)}.", ""])


def main() -> None:
    """Fly, draw and write the page."""
    asked = options(__doc__, only=([""], "fly only these scenarios"), page=(False, "fly nothing, write the page anew"))
    names = [] if asked.page else [name for name in asked.only if name] or list(scenarios())
    kept = FOLDER / "gallery.json"
    known: dict[str, Any] = json.loads(kept.read_text()) if kept.is_file() else {"scenarios": {}}
    FOLDER.mkdir(exist_ok=True)
    for name in names:
        with tempfile.TemporaryDirectory() as scratch:
            known["scenarios"][name] = flown(name, Path(scratch))
        known["machine"] = machine()["processor"]
        kept.write_text(json.dumps(known, indent=2) + "\n")
        print(name, known["scenarios"][name], file=sys.stderr)
    parts = [entry(name, known["scenarios"].get(name)) for name in scenarios()]
    old = [name for name in scenarios() if "models" not in known["scenarios"].get(name, {"models": 0})]
    notes = MISSING if set(scenarios()) - set(known["scenarios"]) else ""
    notes += OLDER.format(names=", ".join(old)) if old else ""
    parts.insert(0, FIRST.format(machine=known["machine"], notes=notes))
    PAGE.write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
