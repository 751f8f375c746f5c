"""The refusal of a layout that cannot be had: the reason, at which pose, and what would help."""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.lighthouse.pnp import FEWEST_LIT
from swarm.errors import SwarmError
from swarm.studies.design.poses import Poses
from swarm.studies.layout.judgement import Judged, sample
from swarm.studies.layout.prediction import Task
from swarm.studies.layout.search import Places


def refuse_too_few(task: Task, at: Places, count: int | None) -> int:
    """Refuse a number of photodiodes of which no layout solves every pose with one lost.

    Args:
        task: What the layout is for.
        at: Places for photodiodes.
        count: Number of photodiodes; None: any.

    Returns:
        The number below which no layout is enough.

    Raises:
        SwarmError: There is no such layout; the message says why.
    """
    needed = FEWEST_LIT + task.losses
    seen = np.count_nonzero(at.reached, axis=1)
    if (least := at.fewest(task.losses)) is None:
        worst, blind = int(np.argmin(seen)), seen < needed
        raise SwarmError(
            f"{task.hull.path.name}: no layout keeps every pose solvable with one photodiode lost: at "
            f"{_percent(blind)} of the poses the light reaches fewer than {needed} of the hull's "
            f"{len(at.coarse.point_m)} places, as at {_where(at.poses, worst)}, {seen[worst]} of them. Narrow the "
            f"poses{_zones(task)}, or give --losses 0"
        )
    if count is not None and count < least:
        raise SwarmError(
            f"--photodiodes {count}: too few to keep every pose solvable with one photodiode lost: each must see "
            f"{needed}, and whatever the layout, that takes {least} or more on {task.hull.path.name}. Give more, "
            "narrow the poses (--cone-deg), or give --losses 0"
        )
    return least


def refuse_unsolved(task: Task, judged: Judged, least: int) -> None:
    """Refuse a layout that leaves poses unsolvable with one photodiode lost.

    Args:
        task: What the layout is for.
        judged: The layout, at poses that its search has not seen.
        least: The number below which no layout is enough.

    Raises:
        SwarmError: There are such poses; the message names one.
    """
    blind = np.isinf(judged.predicted.lost)
    if not blind.any():
        return
    lit, count = np.count_nonzero(judged.predicted.lit, axis=1), len(judged.mount.point_m)
    worst = int(np.argmin(np.where(blind, lit, count + 1)))
    raise SwarmError(
        f"--photodiodes {count}: the best layout found leaves {_percent(blind)} of the poses unsolvable with one "
        f"photodiode lost, as {_where(sample(task), worst)}, where {lit[worst]} are lit and "
        f"{FEWEST_LIT + task.losses} that determine the pose are needed; no layout does with fewer than {least}. Give "
        f"more, narrow the poses{_zones(task)}, or give --losses 0"
    )


def _where(poses: Poses, index: int) -> str:
    """Return a pose in words: from where the light comes, in the body frame."""
    place: Floats = poses.position[index]
    distance = float(np.linalg.norm(place))
    light = -poses.rotation[index].T @ place / distance
    return f"with the light from ({light[0]:.2f}, {light[1]:.2f}, {light[2]:.2f}) in the body frame at {distance:.2f} m"


def _percent(of: Bools) -> str:
    return f"{max(100 * float(np.mean(of)), 0.01):.2g} %"


def _zones(task: Task) -> str:
    return " or the keep-out zones" if task.keep_out is not None and task.keep_out.zones else ""
