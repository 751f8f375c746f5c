"""The papers' experiments, done again: a registry by name, and how one is run and written.

An experiment is a module here with one function, `run(request: Request) -> Outcome` (`swarm.studies.papers.results`),
and one entry below. Modules are imported when they run, so that listing them costs nothing.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from swarm.errors import SwarmError, did_you_mean

if TYPE_CHECKING:
    from swarm.studies.papers.results import Outcome, Reproduction, Request

RUNS = Path("runs")
LIGHTHOUSE = "Chen et al., lighthouse"
STEREO = "Zhang et al., binocular CCD"
LIDAR = "Feng et al., LiDAR"


class Experiment(NamedTuple):
    """One experiment of a paper.

    source, figure: whose, and which figure or table. about: one line. module: where its `run` is. sizes: what makes it
    smaller, by the name of the command line's option, with the full experiment's value. seed: of every random draw.
    """

    source: str
    figure: str
    about: str
    module: str
    sizes: Mapping[str, int]
    seed: int = 1

    @property
    def run(self) -> Callable[["Request"], "Outcome"]:
        """The function that does it."""
        function: Callable[[Request], Outcome] = import_module(self.module).run
        return function


EXPERIMENTS: dict[str, Experiment] = {
    "lighthouse-static": Experiment(
        LIGHTHOUSE,
        "figure 5",
        "precision at rest, predicted by ADOP and PDOP against measured",
        "swarm.studies.papers.lighthouse_static",
        {"poses": 50, "frames": 3600},
    ),
    "lighthouse-dynamic": Experiment(
        LIGHTHOUSE,
        "table 2",
        "accuracy in the hand, error by error, and what removes it",
        "swarm.studies.papers.lighthouse_dynamic",
        {"runs": 10, "seconds": 30},
    ),
    "lighthouse-error-budget": Experiment(
        LIGHTHOUSE,
        "table 1",
        "what every source of error contributes, at rest and moving",
        "swarm.studies.papers.lighthouse_error_budget",
        {"draws": 400, "poses": 25},
    ),
    "stereo-accuracy": Experiment(
        STEREO,
        "figure 3",
        "the closed form's own accuracy, exact images (poses: per metre)",
        "swarm.studies.papers.stereo_accuracy",
        {"poses": 512},
    ),
    "stereo-mounting": Experiment(
        STEREO,
        "figure 4",
        "a light 1 mm off its place: error against distance (poses: per metre)",
        "swarm.studies.papers.stereo_mounting",
        {"poses": 512},
    ),
    "stereo-noise": Experiment(
        STEREO,
        "figure 5",
        "1 um (3 sigma): measured against propagated error (poses: per metre)",
        "swarm.studies.papers.stereo_noise",
        {"poses": 512, "draws": 20},
    ),
    "stereo-baseline": Experiment(
        STEREO,
        "section 2.2",
        "error against baseline and focal length, (16) to (24) over the measured",
        "swarm.studies.papers.stereo_baseline",
        {"draws": 20000},
    ),
    "stereo-fallback": Experiment(
        STEREO,
        "section 2",
        "the backup camera fails and comes back: jumps, and the filter's NEES",
        "swarm.studies.papers.stereo_fallback",
        {"runs": 8},
    ),
    "lidar-acquisition": Experiment(
        LIDAR,
        "figure 5",
        "attitude from one scan: on the turntable, and from any attitude",
        "swarm.studies.papers.lidar_acquisition",
        {"poses": 125, "draws": 1000},
    ),
    "lidar-tracking": Experiment(
        LIDAR,
        "figure 6",
        "tracking random turns, with and without accumulation",
        "swarm.studies.papers.lidar_tracking",
        {"runs": 5, "frames": 25},
    ),
    "lidar-turn": Experiment(
        LIDAR,
        "figure 7",
        "tracking through a full turn, with and without accumulation",
        "swarm.studies.papers.lidar_turn",
        {"poses": 72},
    ),
}


def find(name: str) -> Experiment:
    """The experiment of this name. Raises SwarmError with the nearest one that there is."""
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
    progress: Callable[[float, str], None] | None = None,
) -> "Reproduction":
    """Do the experiment `name` again and write it to `out` (default `runs/<name>-<seed>`).

    force: replace what an earlier one left there. seed: instead of the experiment's own. sizes: instead of the full
    ones, by name. progress: told now and then the share that is done, and what is being done. Raises SwarmError.
    """
    experiment = find(name)
    chosen = {**experiment.sizes}
    for size, value in (sizes or {}).items():
        if size not in chosen:
            taken = " and ".join(f"--{known}" for known in chosen) or "none"
            raise SwarmError(f"--{size}: {name} has no such size; it takes {taken}")
        if value < 1:
            raise SwarmError(f"--{size}: {value}: must be at least 1")
        chosen[size] = value
    # Everything heavy from here on.
    from swarm.studies.papers.results import Request, ResultFolder

    seed = experiment.seed if seed is None else seed
    if seed < 0:
        raise SwarmError(f"--seed: {seed}: must be at least 0")
    folder = ResultFolder(Path(out) if out is not None else RUNS / f"{name}-{seed}", force)
    outcome = experiment.run(Request(seed, chosen, progress or (lambda share, what: None)))
    return folder.write(name, experiment, seed, chosen, outcome)
