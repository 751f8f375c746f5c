"""The telemetry columns of relative navigation: where other craft are in a craft's own axes, and how well it knows."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.rotation import matrix_from_quaternion, quaternion_from_matrix
from swarm.onboard.relative import RelativePoses
from swarm.results.columns.column import Column, Group, pose_columns
from swarm.results.period import Period
from swarm.results.records import Truth

_POSE = np.array([0, 1, 2, 6, 7, 8])


def _columns(name: str, shown: bool) -> list[Column]:
    """Return the columns of craft that navigate relative to the craft `name`."""
    prefix = f"to_{name}"
    return [
        *pose_columns(prefix, f"{name} in the axes of this craft, as it knows it"),
        Column(
            f"{prefix}_position_error_m",
            "m",
            "distance of that position from the truth",
            plot=f"position error to {name}" if shown else "",
        ),
        Column(f"{prefix}_attitude_error_deg", "deg", "angle of that attitude from the truth"),
        Column(
            f"{prefix}_position_sigma_m",
            "m",
            "root of the trace of that position's covariance",
            plot=f"position sigma to {name}" if shown else "",
        ),
        Column(f"{prefix}_attitude_sigma_deg", "deg", "root of the trace of that attitude's covariance"),
        Column(f"{prefix}_nees", "1", "squared error of that pose normalised by its covariance, 6 degrees of freedom"),
        Column(f"{prefix}_independent_sigma_m", "m", "position sigma as if the errors of both were independent"),
        Column(f"{prefix}_independent_nees", "1", "squared error normalised as if they were independent"),
        Column(f"{prefix}_bound_sigma_m", "m", "position sigma that holds for any correlation of both"),
        Column(f"{prefix}_position_protection_m", "m", "protection level of that position"),
        Column(f"{prefix}_attitude_protection_deg", "deg", "protection level of that attitude"),
        Column(f"{prefix}_message_bytes", "B", f"size of the message by which {name} tells its estimate"),
        Column(f"{prefix}_alert", "", "one of both is above the pair's limit, or there is no relative pose", "yes"),
    ]


PER_PAIR = len(_columns("", shown=False))


def pairs(craft: Sequence[str], between: Sequence[tuple[int, int]]) -> Group:
    """Return the group of a run.

    Args:
        craft: names of all craft; without any, the group is one for the reference.
        between: (who knows, of whom), by index.
    """
    targets = list(dict.fromkeys(to for _, to in between))
    names = [craft[to] for to in targets] or ["NAME"]
    columns = tuple(column for name in names for column in _columns(name, shown=bool(craft)))
    return Group(columns, partial(_fill, targets), "with [[pair]] tables, of craft that navigate relative to NAME")


def _fill(targets: Sequence[int], period: Period, out: Floats) -> None:
    out[:] = np.nan
    found = period.estimate.relative
    if found is None:
        return
    for n, (craft, to) in enumerate(zip(found.craft.tolist(), found.to.tolist(), strict=True)):
        row = targets.index(to) * PER_PAIR
        if np.isfinite(found.position[n]).all():
            out[row : row + PER_PAIR, craft] = _of(n, found, period.truth)
        else:
            out[row + PER_PAIR - 1, craft] = found.alert[n]


def _of(n: int, found: RelativePoses, truth: Truth | None) -> Floats:
    """Return the values of one pair, (PER_PAIR,)."""
    turn = quaternion_from_matrix(found.rotation[n])
    own, independent = found.covariance[n], found.independent[n]
    spread = [_root(covariance, 6) for covariance in (own, independent, found.bound[n])]
    error = np.full(6, np.nan)
    if truth is not None:
        error = relative_error(found.rotation[n], found.position[n], truth, int(found.craft[n]), int(found.to[n]))
    return np.array(
        [
            *found.position[n],
            *(turn if turn[0] >= 0 else -turn),
            np.linalg.norm(error[3:]),
            np.degrees(np.linalg.norm(error[:3])),
            spread[0],
            np.degrees(_root(own, 0)),
            _normalised(error, own),
            spread[1],
            _normalised(error, independent),
            spread[2],
            found.position_level_m[n],
            np.degrees(found.attitude_level_rad[n]),
            found.message_bytes[n],
            found.alert[n],
        ]
    )


def relative_error(rotation: Floats, position: Floats, truth: Truth, craft: int, to: int) -> Floats:
    """Return the error (6,) of a relative pose: attitude [rad] from the left, and position [m], in the craft's axes.

    Args:
        rotation: (3, 3), attitude of the other craft in the craft's axes.
        position: (3,) [m], its position there.
        truth: of all craft.
        craft: index of the craft.
        to: index of the other one.
    """
    own, other = (matrix_from_quaternion(truth.quaternion[i]) for i in (craft, to))
    turn = rot.log(own.T @ other @ rotation.T)
    return np.concatenate([turn, own.T @ (truth.position[to] - truth.position[craft]) - position])


def _root(covariance: Floats, first: int) -> float:
    return float(np.sqrt(np.trace(covariance[first : first + 3, first : first + 3])))


def _normalised(error: Floats, covariance: Floats) -> float:
    if not np.isfinite(error).all():
        return np.nan
    return float(error @ np.linalg.solve(covariance[np.ix_(_POSE, _POSE)], error))
