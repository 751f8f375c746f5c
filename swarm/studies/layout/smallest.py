"""The smallest number of photodiodes for a wanted precision."""

from collections.abc import Callable
from math import degrees, inf, isfinite

import numpy as np

from estimators.layout.error import percentile
from swarm.errors import SwarmError
from swarm.studies.layout.prediction import Prediction, Task
from swarm.studies.layout.search import Places, find

PHOTODIODES_MAX = 64


def smallest(
    task: Task,
    at: Places,
    least: int,
    attitude_deg: float | None,
    position_mm: float | None,
    say: Callable[[str], None],
) -> int:
    """Return the least number of photodiodes whose predicted errors, at the percentile, are as wanted.

    Quick searches, up in steps that grow with what is missing (the errors of photodiodes at the same places fall with
    the root of their number), then down by halves; a longer search might do with fewer.

    Args:
        task: What the layout is for.
        at: Places for photodiodes.
        least: The number below which no layout is enough.
        attitude_deg: Wanted attitude error [deg]; None: any will do.
        position_mm: Wanted position error [mm]; None: any will do.
        say: Is told each step.

    Raises:
        SwarmError: The largest number is not enough; the message says what it reaches.
    """
    most = min(PHOTODIODES_MAX, len(at.coarse.point_m))
    count = min(most, least)
    too_few = count - 1
    while True:
        found = find(task, at, count, quick=True).prediction
        say(_figures(found, task, count))
        ratio = _ratio(found, task, attitude_deg, position_mm)
        if ratio <= 1:
            break
        if count >= most:
            wanted = [f"{attitude_deg:g}°"] if attitude_deg is not None else []
            wanted += [f"{position_mm:g} mm"] if position_mm is not None else []
            raise SwarmError(f"{_figures(found, task, count)}; wanted: {', '.join(wanted)}")
        too_few = count
        # Half of what the root law asks for, because better places are found too; blind poses tell nothing.
        more = min((ratio**2 - 1) / 2, 1.0) if isfinite(ratio) else 0.25
        count = min(most, count + max(1, round(more * count)))
    while count - too_few > 1:
        middle = (too_few + count) // 2
        found = find(task, at, middle, quick=True).prediction
        say(_figures(found, task, middle))
        if _ratio(found, task, attitude_deg, position_mm) <= 1:
            count = middle
        else:
            too_few = middle
    return count


def meets(found: Prediction, task: Task, attitude_deg: float | None, position_mm: float | None) -> bool:
    """Tell whether the errors at the percentile are as wanted.

    Args:
        found: Prediction of a layout.
        task: What the layout is for.
        attitude_deg: Wanted attitude error [deg]; None: any will do.
        position_mm: Wanted position error [mm]; None: any will do.
    """
    return _ratio(found, task, attitude_deg, position_mm) <= 1


def _ratio(found: Prediction, task: Task, attitude_deg: float | None, position_mm: float | None) -> float:
    """Return the larger of the errors at the percentile over what is wanted."""
    share = task.share
    attitude = degrees(percentile(found.attitude_rad, share)) / (inf if attitude_deg is None else attitude_deg)
    position = 1e3 * percentile(found.position_m, share) / (inf if position_mm is None else position_mm)
    return inf if _blind(found, task) else float(np.nanmax([attitude, position]))


def _blind(found: Prediction, task: Task) -> bool:
    """Return whether more poses are unsolvable than are forgiven; where one photodiode may be lost, none is."""
    return found.unsolvable_with_one_lost > 0 if task.losses else found.unsolvable > 1 - task.share


def _figures(found: Prediction, task: Task, count: int) -> str:
    share, lost = task.share, " with one lost" if task.losses else ""
    unsolvable = found.unsolvable_with_one_lost if task.losses else found.unsolvable
    blind = f"{count} photodiodes{lost} leave {100 * unsolvable:.1f} % of the poses unsolvable"
    if _blind(found, task):
        return blind
    attitude, position = degrees(percentile(found.attitude_rad, share)), 1e3 * percentile(found.position_m, share)
    return f"{blind}, {100 * share:g} % are within {attitude:.3f}° and {position:.2f} mm"
