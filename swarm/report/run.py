"""The page of one run: its verdicts and a few figures as cards, then its sections, each from a file of its own."""

import shlex
from collections.abc import Callable
from itertools import takewhile

from swarm.report.findings import LEAST_DELTA_V, colour, meaning
from swarm.report.numbers import number
from swarm.report.page import Fact, Page, Section
from swarm.report.sections import (
    consistency,
    craft,
    criteria,
    effort,
    errors,
    faults,
    geometry,
    guidance,
    protection,
    relative,
    smoothed,
    stations,
    trajectory,
    visibility,
    words,
)
from swarm.report.subject import Subject
from swarm.results.run_folder import SCENARIO

SECTIONS: tuple[Callable[[Subject], Section | None], ...] = (
    words.section,
    trajectory.section,
    guidance.section,
    errors.section,
    consistency.section,
    relative.section,
    protection.section,
    smoothed.section,
    geometry.section,
    visibility.section,
    stations.section,
    effort.section,
    faults.section,
    criteria.section,
    craft.section,
)
"""The sections in their order on the page; one that has nothing to say is left out."""
SHORTER = 0.99
"""A run of less than this share of the duration in its scenario.toml was cut short."""
REPLAY = "swarm replay "
"""Beginning of the line in the head of a replay's scenario.toml that repeats it."""


def run_page(subject: Subject) -> Page:
    """Return the page of one run."""
    run, told = subject.run, subject.scenario.get("description")
    head = [line.removeprefix("# ") for line in takewhile(lambda line: line.startswith("#"), _lines(subject))]
    versions = [line for line in head if len(line.split()) == 2 and line.split()[1][:1].isdigit()]
    verdict, kind = criteria.verdict_line(subject.verdicts)
    warning = ""
    if run.status != "complete":
        warning = f"This run is not complete ({run.summary.get('reason', 'it was killed')})."
    return Page(
        title=f"Run: {run.folder.name}",
        subtitle=f"{told.rstrip('.')}. {extent(subject)}." if isinstance(told, str) and told else extent(subject),
        verdict=verdict,
        verdict_kind=kind,
        facts=[*criteria.cards(subject.verdicts), *facts(subject)],
        sections=sections(subject),
        warning=warning,
        reproduce=_reproduce(subject),
        commands=_commands(subject, head),
        versions=versions,
        source_name=SCENARIO,
        source=run.scenario or "",
    )


def facts(subject: Subject) -> list[Fact]:
    """Return the run in a few figures."""
    swarm = subject.summary.get("swarm")
    if not swarm:
        return []
    craft = subject.summary.get("craft") or {}
    count = sum(bool(figures.get("navigates", True)) for figures in craft.values())
    share = number(swarm.get("tracking_share"), scale=100)
    who = f"{count} craft that {'navigates' if count == 1 else 'navigate'}" if count < len(craft) else f"{count} craft"
    out = [Fact("Tracking", f"{share} %", f"of the time, {who}")]
    for name, what, unit, scale in (("Position", "position", "m", 1000), ("Attitude", "attitude", "deg", 1)):
        shown = " mm" if unit == "m" else "°"
        rms, largest = (number(swarm.get(f"ekf_{what}_{which}_{unit}"), scale=scale) for which in ("rms", "max"))
        out.append(Fact(f"{name} error, RMS", f"{rms}{shown}", f"at most {largest}{shown}"))
    if nees := swarm.get("nees"):
        hit = "; it touched something" if swarm.get("contact_periods") and colour(nees) == "yellow" else ""
        out.append(Fact("NEES, mean", number(nees["mean"]), f"{meaning(nees)}{hit} (6 is exact)"))
    if (delta_v := swarm.get("delta_v_m_s") or 0.0) >= LEAST_DELTA_V:
        out.append(Fact("Delta-v", f"{number(delta_v)} m/s", "per craft that navigates, mean"))
    out += smoothed.facts(swarm)
    return [fact for fact in out if not fact.value.startswith("–")]


def extent(subject: Subject) -> str:
    """Return how many craft flew for how long, or of what light a replay is."""
    if not subject.recorded:
        return "nothing recorded"
    count, seconds = subject.summary["craft_count"], subject.summary["duration_s"]
    if subject.series.replayed:
        return f"{seconds:.1f} s of recorded light replayed"
    planned = float(subject.scenario.get("duration_s") or 0.0)
    if seconds < SHORTER * planned:
        return f"{count} craft, only {seconds:.1f} s of {planned:g} s flown"
    return f"{count} craft, {seconds:.1f} s flown"


def sections(subject: Subject) -> list[Section]:
    """Return the sections of a run's page."""
    if not subject.recorded:
        return [Section("Nothing was recorded", ["Not one lighthouse period was recorded."])]
    return [made for section in SECTIONS if (made := section(subject)) is not None]


def _lines(subject: Subject) -> list[str]:
    return (subject.run.scenario or "").splitlines()


def _reproduce(subject: Subject) -> str:
    if subject.recorded and subject.series.replayed:
        return "The same recording with the same settings gives the same numbers; the settings below have every value."
    return "The scenario below has every value and the seed."


def _commands(subject: Subject, head: list[str]) -> list[str]:
    """Return the command that repeats the run: for a replay the one in the head of its scenario, if it is there."""
    replayed = [f"{line} --out again" for line in head if line.startswith(REPLAY)]
    if replayed or (subject.recorded and subject.series.replayed):
        return replayed
    folder = subject.run.folder
    return [f"swarm run {shlex.quote(str(folder / SCENARIO))} --out again"] if subject.run.scenario else []
