"""The values that a shell proposes after a command: names that come along, and results.

`swarm --install-completion` teaches them to the shell. Each function takes the letters of a word so far. Where no
name begins so, the shell proposes files. A mistake, such as an installation without its scenarios, proposes nothing.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from swarm.errors import SwarmError

if TYPE_CHECKING:
    from swarm.assets import Kind

RUNS = "runs"
"""Folder of results, as `swarm.results.owned_folder.RUNS`, which is too heavy for an answer to a key."""


def scenarios(incomplete: str) -> list[str]:
    """Return the scenarios."""
    from swarm.assets import SCENARIO

    return _known((SCENARIO,), incomplete)


def studies(incomplete: str) -> list[str]:
    """Return the studies."""
    from swarm.assets import STUDY

    return _known((STUDY,), incomplete)


def models(incomplete: str) -> list[str]:
    """Return the craft models."""
    from swarm.assets import CRAFT

    return _known((CRAFT,), incomplete)


def models_and_scenarios(incomplete: str) -> list[str]:
    """Return the craft models and the scenarios."""
    from swarm.assets import CRAFT, SCENARIO

    return _known((CRAFT, SCENARIO), incomplete)


def recordings(incomplete: str) -> list[str]:
    """Return the recordings."""
    from swarm.assets import RECORDING

    return _known((RECORDING,), incomplete)


def everything(incomplete: str) -> list[str]:
    """Return all that comes along."""
    from swarm.assets import KINDS

    return _known(KINDS, incomplete)


def pages(incomplete: str) -> list[str]:
    """Return the pages of the documentation."""
    from swarm.assets import pages as known

    try:
        return _beginning(known(), incomplete)
    except SwarmError:
        return []


def experiments(incomplete: str) -> list[str]:
    """Return the papers' experiments."""
    from swarm.studies.papers.catalogue import EXPERIMENTS

    return _beginning(EXPERIMENTS, incomplete)


def runs(incomplete: str) -> list[str]:
    """Return the folders of runs."""
    return _results(incomplete, "summary.json")


def results(incomplete: str) -> list[str]:
    """Return the folders of runs and studies."""
    return _results(incomplete, "summary.json", "study.json")


def _known(kinds: "Iterable[Kind]", incomplete: str) -> list[str]:
    try:
        return _beginning((name for kind in kinds for name in kind.known()), incomplete)
    except SwarmError:
        return []


def _results(incomplete: str, *markers: str) -> list[str]:
    """Return the folders with one of these files: where the word points to, or in `runs/`, as a path or by name."""
    folder, slash, _ = incomplete.rpartition("/")
    if slash:
        return _beginning((f"{folder}/{name}" for name in _marked(Path(folder or "/"), markers)), incomplete)
    inside = _marked(Path(RUNS), markers)
    # The word must begin a proposal: `form` begins the name formation-7, which commands take for runs/formation-7.
    return _beginning([*_marked(Path(), markers), *(f"{RUNS}/{name}" for name in inside)], incomplete) or _beginning(
        inside, incomplete
    )


def _marked(place: Path, markers: Iterable[str]) -> list[str]:
    """Return the names of the folders in `place` that hold one of the files."""
    try:
        return sorted({file.parent.name for marker in markers for file in place.glob(f"*/{marker}")})
    except OSError:
        return []


def _beginning(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
