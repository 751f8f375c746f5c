"""The papers' experiments, repeated: how one is found, run and written.

An experiment is an entry of `swarm.studies.papers.catalogue` and a module with the function `run(request) -> Outcome`.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from swarm.errors import SwarmError, did_you_mean
from swarm.studies.papers.catalogue import EXPERIMENTS, Experiment

if TYPE_CHECKING:
    from swarm.studies.papers.results import Reproduction


def find(name: str) -> Experiment:
    """Return the experiment of this name. Raises SwarmError with the nearest name that there is."""
    if name not in EXPERIMENTS:
        raise SwarmError(f"no experiment {name!r}{did_you_mean(name, EXPERIMENTS)}")
    return EXPERIMENTS[name]


def reproduce(
    name: str,
    *,
    out: str | Path | None = None,
    force: bool = False,
    seed: int | None = None,
    sizes: Mapping[str, int] | None = None,
    quick: bool = False,
    shapes: str | Path | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> "Reproduction":
    """Repeat the experiment `name` and write its results.

    Args:
        name: One of EXPERIMENTS.
        out: Folder of the results; default `runs/<name>-<seed>`.
        force: Replace what an earlier experiment left there.
        seed: Replaces the experiment's own seed.
        sizes: Replace the experiment's sizes, by name.
        quick: Take the sizes of a first look instead of the full experiment's.
        shapes: Folder of the shapes that `lidar-shapes` scans; default: those of this package.
        progress: Is told now and then the share that is done, and what is being done.

    Returns:
        The results, and the folder that holds them.

    Raises:
        SwarmError: There is no such experiment or size, a value is wrong, or `out` cannot be written.
    """
    experiment = find(name)
    chosen = {**experiment.sizes, **(experiment.quick if quick else {})}
    for size, value in (sizes or {}).items():
        if size not in chosen:
            taken = " and ".join(f"--{known}" for known in chosen) or "none"
            raise SwarmError(f"--{size}: {name} has no such size; it takes {taken}")
        if value < 1:
            raise SwarmError(f"--{size}: {value}: must be at least 1")
        chosen[size] = value
    if shapes is not None and not experiment.takes_shapes:
        raise SwarmError(f"--shapes: {name} scans no shapes of a folder; lidar-shapes does")
    from swarm.results.owned_folder import folder_of, refuse_taken
    from swarm.studies.papers.experiment import Outcome, Request
    from swarm.studies.papers.results import CONTENTS, write

    seed = experiment.seed if seed is None else seed
    if seed < 0:
        raise SwarmError(f"--seed: {seed}: must be at least 0")
    folder = folder_of(name, seed, out)
    refuse_taken(folder, CONTENTS, force)
    request = Request(seed, chosen, progress or (lambda share, what: None), Path(shapes) if shapes else None)
    outcome: Outcome = import_module(f"{__name__}.{name.replace('-', '_')}").run(request)
    return write(folder, name, experiment, request, outcome, force)
