"""The judgement of placements at poses that no search has seen, and the bound of what any placement reaches."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.layout.error import percentile
from estimators.lighthouse.pnp import FEWEST_LIT
from estimators.lighthouse.rows import Station
from estimators.placement.bound import least_error, with_one_lost
from estimators.placement.search import Views, errors
from swarm.studies.design.poses import Poses
from swarm.studies.placement.search import Found, Places
from swarm.studies.placement.task import Task, fixed_views, views

POSES = 2000
SEED = 2


class Judged(NamedTuple):
    """A placement at P poses: position_m and attitude_rad, 1 sigma, and the mixed error e, each (P,), inf where a pose
    is not decided; the same with the station lost that is missed most, None where that was not asked. lit: (N, P),
    photodiodes that each lights.
    """

    name: str
    stations: tuple[Station, ...]
    position_m: Floats
    attitude_rad: Floats
    error: Floats
    lit: Ints
    lost_position_m: Floats | None = None
    lost_attitude_rad: Floats | None = None
    lost_error: Floats | None = None

    @property
    def decided(self) -> float:
        """Share of poses that are decided."""
        return float(np.mean(np.isfinite(self.error)))

    @property
    def decided_with_one_lost(self) -> float | None:
        """Share of poses that stay decided whichever station is lost."""
        return None if self.lost_error is None else float(np.mean(np.isfinite(self.lost_error)))

    @property
    def from_nothing(self) -> float:
        """Share of poses at which one station alone lights enough photodiodes to find the pose without a start."""
        if not len(self.lit):
            return 0.0
        return float(np.mean((self.lit.max(axis=0) >= FEWEST_LIT) & np.isfinite(self.error)))


class Bound(NamedTuple):
    """Error e that no choice of candidates falls below at the poses of the search, at the percentile and the median;
    lost: at the percentile, with one lost. limit: with all candidates at once. reached, reached_lost: of the placement
    at the same poses. candidates: their number.
    """

    error: float
    median: float
    lost: float
    limit: float
    reached: float
    reached_median: float
    reached_lost: float
    candidates: int


def sample(task: Task) -> Poses:
    """Return the poses that judge."""
    return task.poses(POSES, SEED)


def judge(task: Task, placements: Sequence[tuple[str, Sequence[Station]]], poses: Poses) -> list[Judged]:
    """Judge placements, each together with the stations that stand already.

    Args:
        task: the task.
        placements: names and stations.
        poses: the poses.
    """
    fixed = fixed_views(task, poses)
    own = tuple(placed.station for placed in task.fixed)
    return [
        _judged(task, name, (*own, *stations), fixed.joined(views(task, stations, poses)))
        for name, stations in placements
    ]


def together(task: Task, name: str, at: Places) -> Judged:
    """Judge all candidates at once, with the stations that stand already, at the poses of the search.

    Args:
        task: the task.
        name: name of the result.
        at: the candidates.
    """
    seen = at.fixed.joined(at.seen)
    error = errors(seen)
    own = tuple(placed.station for placed in task.fixed)
    position, attitude = parts(task, seen, np.isfinite(error))
    return Judged(name, (*own, *task.stations(at.stands)), position, attitude, error, seen.lit)


def bound(task: Task, at: Places, found: Found) -> Bound:
    """Bound what any choice among the candidates and the found stations reaches at the poses of the search.

    Args:
        task: the task.
        at: the candidates.
        found: the placement.
    """
    every, count = at.seen.joined(found.seen), len(found.stands)
    mine = at.fixed.joined(found.seen)
    error, lost = errors(mine), errors(mine, 1)
    reached, half = percentile(error, task.share), percentile(error, 0.5)
    least = least_error(every, at.fixed, count, task.share, reached)
    whole = least_error(every, at.fixed, len(every.lit), task.share, np.inf)
    return Bound(
        least,
        least_error(every, at.fixed, count, 0.5, half),
        with_one_lost(least, count) if not len(at.fixed.lit) else least,
        whole,
        reached,
        half,
        percentile(lost, task.share),
        len(at.stands),
    )


def _judged(task: Task, name: str, stations: tuple[Station, ...], seen: Views) -> Judged:
    error, lost = errors(seen), errors(seen, 1)
    position, attitude = parts(task, seen, np.isfinite(error))
    worst = np.zeros((2, len(error)))
    stays = np.isfinite(lost)
    for n in range(len(seen.lit)):
        rest = seen.at(np.delete(np.arange(len(seen.lit)), n))
        worst = np.maximum(worst, parts(task, rest, stays))
    worst[:, ~stays] = np.inf
    return Judged(name, stations, position, attitude, error, seen.lit, worst[0], worst[1], lost)


def parts(task: Task, seen: Views, decided: Bools) -> tuple[Floats, Floats]:
    """Return position [m] and attitude [rad] errors (P,) of stations at the decided poses, inf elsewhere.

    Args:
        task: the task.
        seen: the stations at P poses.
        decided: (P,), poses that they determine.
    """
    position, attitude = np.full((2, len(decided)), np.inf)
    variance = np.diagonal(np.linalg.inv(seen.information.sum(axis=0)[decided]), axis1=-2, axis2=-1)
    attitude[decided] = task.unit[0] * np.sqrt(variance[:, :3].sum(axis=1))
    position[decided] = task.unit[1] * np.sqrt(variance[:, 3:].sum(axis=1))
    return position, attitude
