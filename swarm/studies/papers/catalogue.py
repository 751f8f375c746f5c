"""The catalogue of the papers' experiments: names, sources and sizes, without what runs them.

Listing them imports nothing heavy. An experiment is one entry here and one module of this package, whose name is the
entry's with underscores, with a function `run(request) -> Outcome` (`swarm.studies.papers.experiment`).
"""

from collections.abc import Mapping
from typing import NamedTuple

LIGHTHOUSE = "Chen et al., lighthouse"
STEREO = "Zhang et al., binocular CCD"
LIDAR = "Feng et al., LiDAR"
BESIDE = "Flight and papers"
SHAPES = "Real shapes by LiDAR"


class Experiment(NamedTuple):
    """One experiment of a paper.

    source, figure: the paper, and the figure or table there. about: one line. sizes: what makes the experiment smaller,
    by the name of the command line's option, with the full experiment's value. quick: the sizes of a first look.
    takes_s, quick_takes_s: processor time of both [s], on one core of `MACHINE`. seed: of every random draw.
    takes_shapes: whether it scans the shapes of a folder, where it is given one.
    """

    source: str
    figure: str
    about: str
    sizes: Mapping[str, int]
    quick: Mapping[str, int]
    takes_s: float
    quick_takes_s: float
    seed: int = 1
    takes_shapes: bool = False

    def sample(self, sizes: Mapping[str, int]) -> str:
        """Return in words which of the full experiment's sizes are smaller in `sizes`; "full" where none is."""
        smaller = [f"{sizes[name]} of {full} {name}" for name, full in self.sizes.items() if sizes[name] < full]
        return ", ".join(smaller) or "full"


MACHINE = "a virtual server of 2021 that does nothing else"


EXPERIMENTS: dict[str, Experiment] = {
    "lighthouse-static": Experiment(
        LIGHTHOUSE,
        "figure 5",
        "precision at rest, predicted by ADOP and PDOP against measured",
        {"poses": 50, "frames": 3600},
        {"poses": 10, "frames": 600},
        takes_s=10,
        quick_takes_s=6,
    ),
    "lighthouse-dynamic": Experiment(
        LIGHTHOUSE,
        "table 2",
        "accuracy in the hand, error by error, and what removes it",
        {"runs": 10, "seconds": 30},
        {"runs": 2, "seconds": 8},
        takes_s=180,
        quick_takes_s=60,
    ),
    "lighthouse-error-budget": Experiment(
        LIGHTHOUSE,
        "table 1",
        "what every source of error contributes, at rest and moving",
        {"draws": 400, "poses": 25},
        {"draws": 40, "poses": 25},
        takes_s=24,
        quick_takes_s=9,
    ),
    "stereo-accuracy": Experiment(
        STEREO,
        "figure 3",
        "the closed form's own accuracy, exact images (poses: per metre)",
        {"poses": 512},
        {"poses": 64},
        takes_s=6,
        quick_takes_s=5,
    ),
    "stereo-mounting": Experiment(
        STEREO,
        "figure 4",
        "a light 1 mm off its place: error against distance (poses: per metre)",
        {"poses": 512},
        {"poses": 64},
        takes_s=6,
        quick_takes_s=5,
    ),
    "stereo-noise": Experiment(
        STEREO,
        "figure 5",
        "1 um (3 sigma): measured against propagated error (poses: per metre)",
        {"poses": 512, "draws": 20},
        {"poses": 64, "draws": 20},
        takes_s=15,
        quick_takes_s=8,
    ),
    "stereo-baseline": Experiment(
        STEREO,
        "section 2.2",
        "error against baseline and focal length, (16) to (24) over the measured",
        {"draws": 20000},
        {"draws": 4000},
        takes_s=13,
        quick_takes_s=7,
    ),
    "stereo-fallback": Experiment(
        STEREO,
        "section 2",
        "the backup camera fails and comes back: jumps, and the filter's NEES",
        {"runs": 8},
        {"runs": 2},
        takes_s=180,
        quick_takes_s=45,
    ),
    "lidar-acquisition": Experiment(
        LIDAR,
        "figure 5",
        "attitude from one scan: on the turntable, and from any attitude",
        {"poses": 125, "draws": 1000},
        {"poses": 10, "draws": 40},
        takes_s=1500,
        quick_takes_s=80,
    ),
    "lidar-tracking": Experiment(
        LIDAR,
        "figure 6",
        "tracking random turns, with and without accumulation",
        {"runs": 5, "frames": 25},
        {"runs": 2, "frames": 10},
        takes_s=80,
        quick_takes_s=17,
    ),
    "lidar-turn": Experiment(
        LIDAR,
        "figure 7",
        "tracking through a full turn, with and without accumulation",
        {"poses": 72},
        {"poses": 24},
        takes_s=50,
        quick_takes_s=25,
    ),
    "lidar-shapes": Experiment(
        SHAPES,
        "docs/lidar.md",
        "spacecraft from any attitude: right, flagged, silently wrong",
        {"draws": 200},
        {"draws": 2},
        takes_s=5400,
        quick_takes_s=80,
        takes_shapes=True,
    ),
    "beside": Experiment(
        BESIDE,
        "docs/beside.md",
        "precision at the ranges of StarFOX, Proba-3 and Vive, beside theirs",
        {"draws": 2000},
        {"draws": 200},
        takes_s=10,
        quick_takes_s=6,
    ),
}
"""Every experiment by its name, in the order of the papers."""
