"""From candidates to places: the coarse search, then smaller and smaller steps around the best.

The search sees a lattice of poses. What it finds is ranked again at a second sample, which it has not seen; the figures
of the report come from a third.
"""

from typing import NamedTuple

import numpy as np

from estimators.placement import search as exchange
from estimators.placement.search import Views
from swarm.errors import SwarmError
from swarm.studies.design.poses import Poses
from swarm.studies.placement.candidates import Stand, candidates, moved
from swarm.studies.placement.task import Task, fixed_views, views

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
    """The candidates, and what they and the stations that stand already measure at the poses of the search."""

    stands: list[Stand]
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
    return Places(stands, poses, views(task, task.stations(stands), poses), fixed_views(task, poses))


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
    if count > len(at.stands):
        raise SwarmError(f"--stations {count}: there are only {len(at.stands)} places where a station may stand")
    starts = 1 if quick else max(1, round(STARTS * min(1.0, 4 / count)))
    choices = exchange.choose(at.seen, count, task.share, losses=task.losses, fixed=at.fixed, starts=starts, seed=seed)
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
            around = [
                near for stand in stands for near in moved(stand, task.site, step * task.site.spacing, step * TURN_RAD)
            ]
            both = seen.joined(views(task, task.stations(around), at.poses))
            start = np.arange(len(stands))
            found = exchange.improve(both, start, task.share, losses=task.losses, fixed=at.fixed).chosen
            if np.array_equal(found, start):
                break
            every = [*stands, *around]
            stands, seen = [every[i] for i in found], both.at(found)
    return stands, seen
