"""From a hull to a layout: candidate places, the search among them, a finer search around the best.

The search sees a lattice of poses. What it finds is ranked again on a second sample, which it has not seen, and that
names the layout; the figures of the report come from a third.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Ints
from estimators.layout import design as layout_design
from estimators.layout.error import WORST, Sightings, sightings
from estimators.lighthouse.pnp import FEWEST_LIT
from swarm.errors import SwarmError
from swarm.studies.layout.even import farthest_points, outermost
from swarm.studies.layout.poses import Poses, lattice
from swarm.studies.layout.prediction import Prediction, Task, predict, second_sample
from swarm.studies.layout.sight import lit
from swarm.world.hull import Mount

SAMPLES = 8000
"""Places that are tried on the hull."""
CANDIDATES = 250
"""Places that the search chooses from, evenly spread among the samples."""
POSES = 4800
"""Poses of the search, by which unsolvable ones are counted."""
EVERY = 8
"""At every n-th of them the errors are predicted."""
EXPOSING_POSES = 200
"""Poses that show whether a place sees the light at all."""
NEAR = 1.5
"""The finer search goes this many times the candidates' spacing around each photodiode."""
FINER = 25
"""Places that it tries around each."""


class Places(NamedTuple):
    """fine: all places that see the light; coarse: those that the search chooses from, about spacing_m apart, and
    what they see at the poses of the search.
    """

    fine: Mount
    coarse: Mount
    spacing_m: float
    poses: Poses
    seen: Sightings


class Found(NamedTuple):
    """A layout, and its prediction on the second sample."""

    mount: Mount
    prediction: Prediction


def places(task: Task) -> Places:
    """Return where photodiodes could sit. Raises SwarmError where fewer than four places are lit at any pose."""
    fine = task.hull.mounts(SAMPLES)
    exposed = lit(task.hull, fine, task.station, lattice(task.within, EXPOSING_POSES)).any(axis=0)
    if np.count_nonzero(exposed) < FEWEST_LIT:
        raise SwarmError(f"{task.hull.path}: the light reaches no place on the hull at any of these poses")
    fine = fine.at(np.flatnonzero(exposed))
    chosen = farthest_points(fine.point_m, min(CANDIDATES, len(fine.point_m)), outermost(fine.point_m))
    coarse = fine.at(chosen)
    # The last of the farthest points is as near to another as any two are.
    spacing = float(np.linalg.norm(coarse.point_m[:-1] - coarse.point_m[-1], axis=1).min())
    poses = lattice(task.within, POSES)
    return Places(fine, coarse, spacing, poses, _seen(task, coarse, poses))


def find(task: Task, at: Places, count: int, *, quick: bool = False, seed: int = 0) -> Found:
    """Search the best layout.

    Args:
        task: What the layout is for.
        at: Places for photodiodes.
        count: Number of photodiodes.
        quick: Search from fewer starts, for a first impression.
        seed: Seed of the search.

    Raises:
        SwarmError: The hull has fewer places.
    """
    if count > len(at.coarse.point_m):
        raise SwarmError(f"--photodiodes {count}: the hull has only {len(at.coarse.point_m)} places for photodiodes")
    if quick:
        designs = layout_design.design(at.seen, count, task.share, seed=seed, starts=60, finalists=4, rounds=0)
        mounts = [at.coarse.at(design.chosen) for design in designs]
    else:
        designs = layout_design.design(at.seen, count, task.share, seed=seed)
        mounts = [at.coarse.at(design.chosen) for design in designs]
        mounts += [_finer(task, at, mount) for mount in mounts[:2]]
    predictions = predict(task, mounts, second_sample(task.within))
    found = (Found(mount, prediction) for mount, prediction in zip(mounts, predictions, strict=True))
    return min(found, key=lambda each: _rank(each, task))


def _seen(task: Task, mount: Mount, poses: Poses) -> Sightings:
    reached = lit(task.hull, mount, task.station, poses)
    return sightings(poses.rotation, poses.position, reached, mount.point_m, task.mix, EVERY)


def _finer(task: Task, at: Places, mount: Mount) -> Mount:
    """Exchange each photodiode of a layout for places between the coarse ones around it."""
    near: list[Ints] = []
    for i, point in enumerate(mount.point_m):
        around = np.flatnonzero(np.linalg.norm(at.fine.point_m - point, axis=1) <= NEAR * at.spacing_m)
        around = around[at.fine.normal[around] @ mount.normal[i] > 0]
        if len(around) > FINER:
            around = around[farthest_points(at.fine.point_m[around], FINER, outermost(at.fine.point_m[around]))]
        near.append(around)
    fine = at.fine.at(np.unique(np.concatenate(near)))
    both = Mount(np.concatenate([mount.point_m, fine.point_m]), np.concatenate([mount.normal, fine.normal]))
    start = np.arange(len(mount.point_m))
    found = layout_design.refine_design(_seen(task, both, at.poses), [start], task.share)[0]
    return both.at(found.chosen)


def _rank(found: Found, task: Task) -> tuple[float, float]:
    """Fewer unsolvable poses beyond those that the percentile forgives, then a lighter tail: smaller is better."""
    error = np.sort(found.prediction.error)
    last = max(int(task.share * len(error)), 1)
    first = max(int((task.share - layout_design.TAIL) * len(error)), 0)
    tail = np.minimum(error[first:last], WORST)
    return max(0.0, found.prediction.unsolvable - (1 - task.share)), float(np.mean(np.log(tail)))
