"""The figures in words: what they mean, and what is wrong with single craft."""

from swarm.report.findings import of_summary
from swarm.report.page import Section
from swarm.report.subject import Subject


def section(subject: Subject) -> Section | None:
    """Return the section; None where there is nothing to say."""
    if not subject.summary.get("swarm"):
        return None
    said = of_summary(subject.summary, cards=True)
    return Section("What the figures say", [f"{finding.text}." for finding in said]) if said else None
