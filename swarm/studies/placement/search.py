"""From candidates to places: the coarse search, then smaller and smaller steps around the best.

The search sees a lattice of poses. What it finds is ranked again at a second sample, which it has not seen; the figures
of the report come from a third.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Ints
from estimators.placement import search as exchange
from estimators.placement.search import Views
from swarm.errors import SwarmError
from swarm.studies.design.poses import Poses
from swarm.studies.placement.candidates import Stand, candidates, moved
from swarm.studies.placement.task import Task, fixed_views, views
from swarm.tables import counted

POSES = 200
SECOND_POSES = 600
SECOND_SEED = 1
STARTS = 6
"""Random choices that are improved, of up to four stations; of more, fewer."""
FINALISTS = 2
"""Choices that are moved in smaller steps."""
STEPS = (0.5, 0.25, 0.125, 0.06)
"""Lengths of the steps, in distances between neighbouring places."""
TURN_RAD = np.radians(24.0)
"""Turn at a step of one such distance."""
ROUNDS = 2
"""Times that the stations are moved by each step."""


class Places(NamedTuple):
    """Candidates at the poses of the search.

    stands: N candidates. spot: (N,), the place of each. seen, fixed: measurements of the candidates, and of the
    stations that stand already.
    """

    stands: list[Stand]
    spot: Ints
    poses: Poses
    seen: Views
    fixed: Views


class Found(NamedTuple):
    """A placement, its views at the poses of the search, and its objective at the second sample."""

    stands: list[Stand]
    seen: Views
    objective: float


def places(task: Task) -> Places:
    """Return the candidates and what they measure. Raises SwarmError where a station may stand nowhere."""
    stands, poses = candidates(task.site), task.poses(POSES)
    spot = np.unique([stand.position for stand in stands], axis=0, return_inverse=True)[1].ravel()
    return Places(stands, spot, poses, views(task, task.stations(stands), poses), fixed_views(task, poses))


def find(task: Task, at: Places, count: int, *, seed: int = 0, quick: bool = False) -> Found:
    """Search the best placement.

    Args:
        task: the task.
        at: the candidates.
        count: number of stations.
        seed: seed of the search.
        quick: leave out the smaller steps, for a first impression.

    Raises:
        SwarmError: there are fewer candidates.
    """
    if count > (room := len(np.unique(at.spot))):
        raise SwarmError(f"--stations {count}: there are only {counted(room, 'place')} where a station may stand")
    starts = 1 if quick else max(1, round(STARTS * min(1.0, 4 / count)))
    choices = exchange.choose(
        at.seen, at.spot, count, task.share, losses=task.losses, fixed=at.fixed, starts=starts, seed=seed
    )
    found = [([at.stands[i] for i in choice.chosen], at.seen.at(choice.chosen)) for choice in choices[:FINALISTS]]
    if not quick:
        found += [_finer(task, at, stands, seen) for stands, seen in found]
    poses = task.poses(SECOND_POSES, SECOND_SEED)
    fixed = fixed_views(task, poses)
    ranked = [
        Found(stands, seen, _objective(task, fixed.joined(views(task, task.stations(stands), poses))))
        for stands, seen in found
    ]
    return min(ranked, key=lambda each: each.objective)


def _objective(task: Task, stations: Views) -> float:
    error = exchange.errors(stations, task.losses)
    return float(exchange.objective(np.minimum(error, exchange.WORST), task.share))


def _finer(task: Task, at: Places, stands: list[Stand], seen: Views) -> tuple[list[Stand], Views]:
    """Move the stations in smaller and smaller steps as long as that helps."""
    for step in STEPS:
        for _ in range(ROUNDS):
            near = [moved(stand, task.site, step * task.site.spacing, step * TURN_RAD) for stand in stands]
            around = [stand for each in near for stand in each]
            both = seen.joined(views(task, task.stations(around), at.poses))
            start = np.arange(len(stands))
            # A neighbour takes the place of its own station, or of none.
            spot = np.concatenate([start, np.repeat(start, [len(each) for each in near])])
            found = exchange.improve(both, spot, start, task.share, losses=task.losses, fixed=at.fixed).chosen
            if np.array_equal(found, start):
                break
            every = [*stands, *around]
            stands, seen = [every[i] for i in found], both.at(found)
    return stands, seen
