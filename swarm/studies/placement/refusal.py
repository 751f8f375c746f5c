"""The refusal of a placement that cannot be had: the reason, how many stations would do, and what else would help."""

from collections.abc import Callable

import numpy as np

from estimators.lighthouse.pnp import FEWEST_LIT
from estimators.placement.search import errors
from swarm.errors import SwarmError
from swarm.studies.design.bound import fewest_covering
from swarm.studies.placement.judgement import Judged
from swarm.studies.placement.search import Places, find
from swarm.studies.placement.task import Task
from swarm.tables import counted


def needed(task: Task, at: Places) -> int:
    """Return the number of stations below which no placement decides enough poses, at least one.

    Raises:
        SwarmError: all candidates together do not; the message names a pose.
    """
    lit = np.concatenate([at.fixed.lit, at.seen.lit]).T
    together = at.fixed.joined(at.seen)
    blind = np.isinf(errors(together, task.losses))
    least = fewest_covering(lit, FEWEST_LIT, task.share, 1 + task.losses)
    if least is None or np.mean(blind) > 1 - task.share + 1e-9:
        enough = np.minimum(lit, FEWEST_LIT).sum(axis=1)
        worst = int(np.argmin(np.where(blind, enough, FEWEST_LIT + 1)))
        raise SwarmError(
            f"no placement decides {100 * task.share:g} % of the poses{_lost(task)}: all {len(at.stands)} candidates "
            f"together leave {_percent(float(np.mean(blind)))} undecided, as at "
            f"({', '.join(f'{v:.2f}' for v in at.poses.position[worst])}) m, where "
            f"{counted(int(np.count_nonzero(lit[worst])), 'candidate')} see photodiodes. Let stations stand elsewhere "
            "(--room, --shell-m, --at), narrow the poses (--volume, --tilt-deg), or ask for a smaller --share"
        )
    return max(1, least - len(task.fixed))


def refuse_uncovered(task: Task, at: Places, judged: Judged, count: int, say: Callable[[str], None]) -> None:
    """Refuse a placement that leaves more poses undecided than are forgiven.

    Args:
        task: the task.
        at: the candidates.
        judged: the placement, at poses that its search has not seen.
        count: number of its stations.
        say: is told that more stations are tried.

    Raises:
        SwarmError: it does; the message says how many stations would do.
    """
    share = judged.decided_with_one_lost if task.losses else judged.decided
    if share is None or share >= task.share - 1e-9:
        return
    least = needed(task, at)
    said = f"--stations {count}: the best placement found decides {_percent(share)} of the poses{_lost(task)}, and "
    said += f"{100 * task.share:g} % are wanted; "
    said += f"no placement does with fewer than {least}" if least > 1 else "one might do"
    enough = fewest_found(task, at, max(count + 1, least), say)
    said += f", and {enough} are enough" if enough is not None else ""
    raise SwarmError(
        f"{said}. Give more stations, let them stand elsewhere (--room, --shell-m, --at), narrow the poses "
        "(--volume, --tilt-deg), or ask for a smaller --share"
    )


def fewest_found(task: Task, at: Places, first: int, say: Callable[[str], None]) -> int | None:
    """Return the least number of stations, from `first` on, for which a quick search decides enough poses.

    Args:
        task: the task.
        at: the candidates.
        first: number to begin with.
        say: is told each step.
    """
    for count in range(first, most_new(task, at) + 1):
        seen = at.fixed.joined(find(task, at, count, quick=True).seen)
        share = float(np.mean(np.isfinite(errors(seen, task.losses))))
        say(f"{counted(count, 'station')} decide {_percent(share)} of the poses{_lost(task)}")
        if share >= task.share:
            return count
    return None


def most_new(task: Task, at: Places) -> int:
    """Return the largest number of new stations: of those that can be told apart, one at each place."""
    return min(task.kind.most - len(task.fixed), len(np.unique(at.spot)))


def _lost(task: Task) -> str:
    return " with any one station lost" if task.losses else ""


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"
