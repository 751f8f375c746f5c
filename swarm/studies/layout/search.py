"""From a hull to a layout: candidate places, the search among them, a finer search around the best.

The search sees a lattice of poses. What it finds is ranked again on a second sample, which it has not seen, and that
names the layout; the figures of the report come from a third.

Where one photodiode may be lost, the search sees the field a little narrower and light a little less slanting than they
are, so that what holds at its poses holds between them too; poses of the second sample that its best layout does not
solve all the same are added to its own, and it goes on from there.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Ints
from estimators.layout import design as layout_design
from estimators.layout.error import WORST, Sightings, sightings
from estimators.lighthouse.pnp import FEWEST_LIT
from swarm.errors import SwarmError
from swarm.studies.design.bound import fewest
from swarm.studies.design.even import farthest_points, outermost
from swarm.studies.design.poses import Poses
from swarm.studies.design.sight import lit
from swarm.studies.layout.prediction import SECOND_POSES, SECOND_SEED, Prediction, Task, predict, second_sample
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
SPARE_DEG = 1.0
"""Margin of the field and of the incidence in a search that allows for a loss."""
EVERY_WITH_LOSS = 16
"""With a loss, errors take several times as long, and are predicted at fewer poses."""
REPAIRS = 4
"""Times that a search goes on with the poses that its layout does not solve."""


class Places(NamedTuple):
    """fine: all places that see the light; coarse: those that the search chooses from, about spacing_m apart, and
    what they see at the poses of the search, seen with the search's margin, reached (P, N) without it.
    """

    fine: Mount
    coarse: Mount
    spacing_m: float
    poses: Poses
    seen: Sightings
    reached: Bools

    def fewest(self, losses: int) -> int | None:
        """Return the number of photodiodes without which every layout leaves poses unsolvable; None: all places do."""
        return fewest(self.reached, FEWEST_LIT + losses)


class Found(NamedTuple):
    """A layout, and its prediction on the second sample."""

    mount: Mount
    prediction: Prediction


def places(task: Task) -> Places:
    """Return where photodiodes could sit. Raises SwarmError where fewer than four places are lit at any pose."""
    fine = task.hull.mounts(SAMPLES)
    if task.keep_out is not None:
        fine = fine.at(np.flatnonzero(task.keep_out.free(fine)))
        if len(fine.point_m) < FEWEST_LIT:
            told = ", ".join(task.keep_out.zones)
            raise SwarmError(f"{task.hull.path}: the keep-out zones leave no place for photodiodes: {told}")
    exposed = lit(task.hull, fine, task.station, task.poses(EXPOSING_POSES), task.scene).any(axis=0)
    if np.count_nonzero(exposed) < FEWEST_LIT:
        raise SwarmError(f"{task.hull.path}: the light reaches no place on the hull at any of these poses")
    fine = fine.at(np.flatnonzero(exposed))
    chosen = farthest_points(fine.point_m, min(CANDIDATES, len(fine.point_m)), outermost(fine.point_m))
    coarse = fine.at(chosen)
    # The last of the farthest points is as near to another as any two are.
    spacing = float(np.linalg.norm(coarse.point_m[:-1] - coarse.point_m[-1], axis=1).min())
    poses = task.poses(POSES)
    reached = lit(task.hull, coarse, task.station, poses, task.scene)
    return Places(fine, coarse, spacing, poses, _seen(task, coarse, poses), reached)


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
    effort = {"starts": 60, "finalists": 4, "rounds": 0} if quick else {}
    designs = layout_design.design(at.seen, count, task.share, seed=seed, losses=task.losses, **effort)
    mounts = [at.coarse.at(design.chosen) for design in designs]
    mounts += [] if quick else [_finer(task, at, mount) for mount in mounts[:2]]
    poses = second_sample(task)
    best = _best(task, mounts, poses)
    for repair in range(REPAIRS if task.losses else 0):
        failing = np.flatnonzero(np.isinf(best.prediction.lost))
        if not len(failing):
            break
        moment = None if poses.moment is None else poses.moment[failing]
        more = Poses(poses.rotation[failing], poses.position[failing], moment)
        poses = task.poses(SECOND_POSES, SECOND_SEED + 100 + repair)
        best = _best(task, [best.mount, _finer(task, at, best.mount, more)], poses)
    return best


def _best(task: Task, mounts: list[Mount], poses: Poses) -> Found:
    """Return the layout that ranks first at these poses."""
    found = (Found(mount, made) for mount, made in zip(mounts, predict(task, mounts, poses), strict=True))
    return min(found, key=lambda each: _rank(each, task))


def _seen(task: Task, mount: Mount, poses: Poses, every: int | None = None) -> Sightings:
    station = task.station
    if task.losses:
        spare = {
            "field_deg": station.field_deg - 2 * SPARE_DEG,
            "incidence_max_deg": station.incidence_max_deg - SPARE_DEG,
        }
        station = station.model_copy(update=spare)
    reached = lit(task.hull, mount, station, poses, task.scene)
    if every is None:
        every = EVERY_WITH_LOSS if task.losses else EVERY
    return sightings(poses.rotation, poses.position, reached, mount.point_m, task.mix, every)


def _finer(task: Task, at: Places, mount: Mount, more: Poses | None = None) -> Mount:
    """Exchange each photodiode of a layout for places between the coarse ones around it; more: further poses."""
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
    seen = _seen(task, both, at.poses)
    if more is not None:
        also = _seen(task, both, more, 1)
        row, lit_at = np.concatenate([seen.row, also.row]), np.concatenate([seen.lit, also.lit])
        seen = seen._replace(row=row, lit=lit_at, reached=np.concatenate([seen.reached, also.reached]))
    found = layout_design.refine_design(seen, [start], task.share, task.losses)[0]
    return both.at(found.chosen)


def _rank(found: Found, task: Task) -> tuple[float, float]:
    """Fewer unsolvable poses beyond those that are forgiven, then a lighter tail: smaller is better."""
    made = found.prediction
    error = np.sort(made.lost if task.losses else made.error)
    last = max(int(task.share * len(error)), 1)
    first = max(int((task.share - layout_design.TAIL) * len(error)), 0)
    tail = np.minimum(error[first:last], WORST)
    beyond = made.unsolvable_with_one_lost if task.losses else max(0.0, made.unsolvable - (1 - task.share))
    return beyond, float(np.mean(np.log(tail)))
