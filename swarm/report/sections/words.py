"""The figures in words: what they mean, and what is wrong with single craft."""

from swarm.report.findings import findings, inspections, warnings
from swarm.report.page import Section
from swarm.report.subject import Subject


def section(subject: Subject) -> Section | None:
    """Return the section; None where there is nothing to say."""
    summary = subject.summary
    swarm = summary.get("swarm")
    if not swarm:
        return None
    # The delta-v has a card.
    said = [*findings(swarm, effort=False), *inspections(summary.get("lidar") or {}), *warnings(summary["craft"])]
    return Section("What the figures say", [f"{finding.text}." for finding in said]) if said else None
