"""The verdicts on the scenario's criteria: a card each, and a table."""

from collections.abc import Mapping, Sequence
from typing import Any

from swarm.report.measured import measured
from swarm.report.page import Column, Fact, Section, Table
from swarm.report.run_table import about, outcome
from swarm.report.subject import Subject
from swarm.units import split_unit

WORDS = {True: "PASS", False: "FAIL", None: "NOT JUDGED"}
MOST_CARDS = 24


def cards(verdicts: Sequence[Mapping[str, Any]]) -> list[Fact]:
    """Return a card per criterion, the missed ones first."""
    order = sorted(verdicts, key=lambda verdict: (True, None, False).index(verdict["held"]), reverse=True)
    out, told = list[Fact](), dict[str, str]()
    for verdict in order[:MOST_CARDS]:
        name, why = verdict["name"], verdict.get("why") or ""
        shared = told.get(why)
        if why:
            told.setdefault(why, _spoken(name))
        out.append(_card(verdict, f"For the same reason as {shared}" if shared else why[:1].upper() + why[1:]))
    return out


def verdict_line(verdicts: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Return the verdict on the run in one line, and its kind: "pass", "fail", or "" where there are no criteria."""
    if not verdicts:
        return "", ""
    missed = sum(verdict["held"] is False for verdict in verdicts)
    open_ = sum(verdict["held"] is None for verdict in verdicts)
    later = f"; {open_} not judged, because the run ended before" if open_ else ""
    if missed:
        return f"FAIL: {missed} of {len(verdicts)} criteria missed{later}", "fail"
    judged = len(verdicts) - open_
    if not judged:
        return f"Not judged: the run ended before the time of its {open_} criteria", ""
    return f"PASS: {'all ' if not open_ else ''}{judged} criteria held{later}", "pass"


def section(subject: Subject) -> Section | None:
    """Return the section; None without criteria."""
    if not subject.verdicts:
        return None
    rows = [[v["name"], outcome(v).lower(), about(v), *measured(v), v.get("why") or ""] for v in subject.verdicts]
    heads = ["criterion", "", "craft", "value", "limits", "why"]
    if not any(row[-1] for row in rows):
        heads, rows = heads[:-1], [row[:-1] for row in rows]
    return Section("Criteria", (), (), [Table([Column(head) for head in heads], rows, left=3)])


def _card(verdict: Mapping[str, Any], why: str) -> Fact:
    name, whose, (value, limits) = _spoken(verdict["name"]), about(verdict), measured(verdict)
    meaning = limits + (f", {whose}" if whose != "all" else "")
    kind = {True: "pass", False: "fail", None: ""}[verdict["held"]]
    return Fact(name, value, ". ".join([meaning, *([why] if why else [])]), kind, WORDS[verdict["held"]])


def _spoken(name: str) -> str:
    return split_unit(name)[0].replace("_", " ")
