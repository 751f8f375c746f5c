"""The judgement of layouts at poses that no search has seen: predicted, and measured by solving noisy angles.

Layouts are compared by the q-th percentile of the mixed error over the poses. A pose that a layout cannot solve has an
infinite error. Where that makes a percentile infinite, two more comparisons stay finite:

- same poses: over the poses that both layouts solve. It leaves out what only one of them can do, and grants the other
  its easiest poses.
- same share: the error that the layout keeps to for as many of all poses as the other one keeps to the q-th percentile
  of those that it solves: its best, against the other's best, of the same number.
"""

from collections.abc import Sequence
from math import isfinite, nan
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.layout.error import WANTED_LIT, percentile
from estimators.lighthouse.pose_trials import scatter
from estimators.rotation import angle_between
from swarm.onboard.acquisition import Sighting, search
from swarm.studies.design.poses import Poses
from swarm.studies.layout.prediction import Prediction, Task, mixed, predict
from swarm.world.hull import Mount

POSES = 6000
SEED = 2
TRIED_EVERY = 2
"""Every n-th pose is measured too."""
TRIALS = 60
COLD_EVERY = 20
"""Every n-th solvable pose is solved from nothing."""
RIGHT_RAD = np.pi / 36
"""A mirror pose is tens of degrees off, noise at most one or two."""


class Measured(NamedTuple):
    """By Monte Carlo, per pose that was tried (P,): attitude_rad, position_m and the mixed error, inf where a pose is
    not solvable or a trial was not solved. failed: share of the trials at solvable poses that were not. found: of
    some solvable poses, the share at which one period's angles give the right pose from nothing, and no other.
    """

    attitude_rad: Floats
    position_m: Floats
    error: Floats
    failed: float
    found: float


class Judged(NamedTuple):
    """One layout, predicted at all poses and, unless left out, measured at some of them (`tried`)."""

    name: str
    mount: Mount
    predicted: Prediction
    measured: Measured | None


class Comparison(NamedTuple):
    """A layout's error and another's: at the percentile over all poses, over the poses that both solve (their share
    of all), and over the same share of all poses; each a pair (ours, theirs). NaN where there are no such poses.
    """

    all_poses: tuple[float, float]
    same_poses: tuple[float, float]
    both_solve: float
    same_share: tuple[float, float]
    share: float

    def ratios(self) -> tuple[float, float, float]:
        """Ours over theirs, in the three ways: 0 where only theirs is infinite, NaN where both are."""
        return _ratio(self.all_poses), _ratio(self.same_poses), _ratio(self.same_share)


def sample(task: Task) -> Poses:
    """Return the poses that judge."""
    return task.poses(POSES, SEED)


def judge(task: Task, layouts: Sequence[tuple[str, Mount]], measured: Sequence[str]) -> list[Judged]:
    """Judge every layout.

    Args:
        task: What the layouts are for.
        layouts: Names and layouts.
        measured: Names of the layouts that are measured by Monte Carlo too.
    """
    poses = sample(task)
    predictions = predict(task, [mount for _, mount in layouts], poses)
    return [
        Judged(name, mount, found, _measured(task, mount, poses, found) if name in measured else None)
        for (name, mount), found in zip(layouts, predictions, strict=True)
    ]


def tried(error: Floats) -> Floats:
    """Return an error's values at the poses that are measured, of those at all poses (P,)."""
    return error[::TRIED_EVERY]


def _measured(task: Task, mount: Mount, poses: Poses, found: Prediction) -> Measured:
    rotation, position = poses.rotation[::TRIED_EVERY], poses.position[::TRIED_EVERY]
    solvable = np.isfinite(tried(found.error))
    lit = found.lit[::TRIED_EVERY] & solvable[:, None]
    mix = task.mix
    made = scatter(
        rotation, position, lit, mount.point_m, mix.angle_noise_rad, mix.rotor_correlation, TRIALS, seed=SEED
    )
    good = made.failed == 0
    attitude, distance = np.where(good, made.attitude_rad, np.inf), np.where(good, made.position_m, np.inf)
    failed = float(made.failed[solvable].mean()) if solvable.any() else nan
    return Measured(attitude, distance, mixed(mix, attitude, distance), failed, _found(task, mount, poses, found))


def _found(task: Task, mount: Mount, poses: Poses, found: Prediction) -> float:
    """Return the share of poses that the on-board search decides on, rightly, from one period with noise."""
    mix, rng = task.mix, np.random.default_rng([SEED, 1])
    own = mix.angle_noise_rad * np.sqrt(1 - mix.rotor_correlation)
    right = []
    for i in np.flatnonzero(np.isfinite(found.error))[::COLD_EVERY]:
        p = mount.point_m @ poses.rotation[i].T + poses.position[i]
        shared = mix.angle_noise_rad * np.sqrt(mix.rotor_correlation) * rng.standard_normal(2)
        theta = np.arctan2(p[:, 2:], p[:, :2]) + shared + own * rng.standard_normal((len(p), 2))
        first = search(Sighting(theta, found.lit[i], mount.point_m, np.zeros((len(p), 2))), own)
        near = first.decided and angle_between(first.rotation[0], poses.rotation[i]) < RIGHT_RAD
        right.append(bool(near))
    return float(np.mean(right)) if right else nan


def compare(ours: Floats, theirs: Floats, share: float) -> Comparison:
    """Compare two layouts' errors at the same poses.

    Args:
        ours: Errors of one layout (P,).
        theirs: Errors of the other one (P,).
        share: The percentile, as a share.
    """
    both = np.isfinite(ours) & np.isfinite(theirs)
    both_solve = float(np.mean(both))
    part = share * float(np.mean(np.isfinite(theirs)))
    nothing = (nan, nan)
    return Comparison(
        (percentile(ours, share), percentile(theirs, share)),
        (percentile(ours[both], share), percentile(theirs[both], share)) if both.any() else nothing,
        both_solve,
        (percentile(ours, part), percentile(theirs, part)) if part > 0 else nothing,
        part,
    )


def lit_share(found: Prediction, least: int = WANTED_LIT) -> float:
    """Return the share of poses at which at least `least` photodiodes are lit."""
    return float(np.mean(np.count_nonzero(found.lit, axis=1) >= least))


def _ratio(pair: tuple[float, float]) -> float:
    ours, theirs = pair
    if not isfinite(ours):
        return nan if not isfinite(theirs) else np.inf
    return ours / theirs if isfinite(theirs) else 0.0
