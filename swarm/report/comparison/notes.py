"""Sentences about a comparison of runs: what they do not have in common, and what a ratio therefore does not say."""

from collections.abc import Callable, Sequence
from itertools import takewhile
from typing import Any

from swarm.report.comparison.settings import Setting, is_replay
from swarm.report.subject import Subject
from swarm.results.files import HISTORY

SAME_TIME = 0.01
"""Durations that differ by less than this share are one duration."""


def notes(subjects: Sequence[Subject], labels: Sequence[str], settings: Sequence[Setting]) -> list[str]:
    """Return the sentences.

    Args:
        subjects: The runs.
        labels: The letter of each.
        settings: The settings in which they differ.
    """
    made = (
        _no_figures(subjects, labels),
        _incomplete(subjects, labels),
        _no_truth(subjects, labels),
        _scenarios(subjects, labels),
        _times(subjects),
        _sensors(subjects, labels),
        _smoothed(subjects, labels),
        _seeds(settings),
        _versions(subjects, labels),
    )
    return [note for note in made if note]


def _those(subjects: Sequence[Subject], labels: Sequence[str], chosen: Callable[[Subject], bool]) -> list[str]:
    return [label for subject, label in zip(subjects, labels, strict=True) if chosen(subject)]


def _verb(names: Sequence[str], one: str, several: str) -> str:
    return f"{_and(names)} {one if len(names) == 1 else several}"


def _and(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _no_figures(subjects: Sequence[Subject], labels: Sequence[str]) -> str:
    empty = _those(subjects, labels, lambda one: not one.summary.get("swarm"))
    return f"{_verb(empty, 'has', 'have')} not one lighthouse period recorded." if empty else ""


def _incomplete(subjects: Sequence[Subject], labels: Sequence[str]) -> str:
    stopped = _those(subjects, labels, lambda one: one.run.status != "complete")
    return f"{_verb(stopped, 'is', 'are')} not complete: the figures are those until then." if stopped else ""


def _no_truth(subjects: Sequence[Subject], labels: Sequence[str]) -> str:
    replays = _those(subjects, labels, is_replay)
    if not replays:
        return ""
    told = f"{_verb(replays, 'replays', 'replay')} real light, of which no truth is known: no errors, no NEES."
    if len(replays) == len(labels):
        return told
    return f"{told} A replay and a simulated flight have only the light in common; their ratio compares two things."


def _scenarios(subjects: Sequence[Subject], labels: Sequence[str]) -> str:
    flown: dict[str, list[str]] = {}
    for subject, label in zip(subjects, labels, strict=True):
        if not is_replay(subject):
            flown.setdefault(str(subject.scenario.get("name")), []).append(label)
    if len(flown) < 2:
        return ""
    told = "; ".join(f"{_verb(names, 'flies', 'fly')} {name}" for name, names in flown.items())
    return f"{told}: a ratio compares whole scenarios, not one change."


def _times(subjects: Sequence[Subject]) -> str:
    times = [float(seconds) for one in subjects if (seconds := one.summary.get("duration_s"))]
    if len(times) < 2 or max(times) - min(times) <= SAME_TIME * max(times):
        return ""
    return "The runs are of different length, and each figure is of the whole run."


def _sensors(subjects: Sequence[Subject], labels: Sequence[str]) -> str:
    mixed = _those(subjects, labels, lambda one: bool(one.summary.get("groups")))
    if not mixed:
        return ""
    return f"The craft of {_and(mixed)} carry different sensors: no error of the whole swarm, but those of each group."


def _smoothed(subjects: Sequence[Subject], labels: Sequence[str]) -> str:
    def has(subject: Subject) -> bool:
        return any(key.startswith("smooth_") for key in subject.summary.get("swarm") or ())

    without = _those(subjects, labels, lambda one: not has(one))
    some = 0 < len(without) < len(labels)
    if not some:
        return ""
    never = _those(subjects, labels, lambda one: not has(one) and not (one.run.folder / HISTORY).exists())
    unkept = f" ({_verb(never, 'has', 'have')} no history of filters to be smoothed)" if never else ""
    way = "; swarm smooth does it" if len(never) < len(without) else ""
    return f"{_verb(without, 'is', 'are')} not smoothed{way}{unkept}."


def _seeds(settings: Sequence[Setting]) -> str:
    seeds = next((row.values for row in settings if row.key == "seed"), ())
    if len(set(seeds)) < 2:
        return ""
    alone = len(settings) == 1
    told = "Only the seeds differ: the differences are chance." if alone else "Seeds differ: a part of each is chance."
    return f"{told} Many seeds: swarm study."


def _versions(subjects: Sequence[Subject], labels: Sequence[str]) -> str:
    """Return in which programs the runs differ: the same scenario may give other numbers."""
    found = [_flown_by(subject) for subject in subjects]
    names = dict.fromkeys(name for one in found for name in one)
    other = [name for name in names if len({one.get(name) for one in found if one}) > 1]
    if not other:
        return ""
    told = []
    for name in other:
        versions = [f"{label} {one.get(name, '?')}" for label, one in zip(labels, found, strict=True)]
        told.append(f"{name} ({', '.join(versions)})")
    return f"Flown by different versions: {'; '.join(told)}."


def _flown_by(subject: Subject) -> dict[str, str]:
    lines = takewhile(lambda line: line.startswith("#"), (subject.run.scenario or "").splitlines())
    words: list[Any] = [line.removeprefix("#").split() for line in lines]
    return {pair[0]: pair[1] for pair in words if len(pair) == 2 and pair[1][:1].isdigit()}
