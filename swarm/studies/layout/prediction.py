"""The prediction of a layout's errors: lit photodiodes by ray cast, then ADOP and PDOP (22), (24).

The mixed error of a pose is e, e^2 = (attitude / wanted attitude)^2 + (position / wanted position)^2; it is infinite
where the pose is not solvable, fewer than four photodiodes lit or ones that determine no pose. The error with one lost
is the largest one that is left if any one of the lit photodiodes is dead or shadowed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.layout.error import Mix, lost_errors, sightings
from estimators.lighthouse.dop import dilution
from estimators.lighthouse.pnp import FEWEST_LIT
from swarm.scenario import Lighthouse
from swarm.studies.design.flown import Flown
from swarm.studies.design.poses import PoseRange, Poses, lattice
from swarm.studies.design.sight import lit
from swarm.world.hull import Hull, Mount
from swarm.world.keep_out import KeepOut

SECOND_POSES = 6000
SECOND_SEED = 1


class Task(NamedTuple):
    """A hull, the lighthouse, the poses, and what counts as an error of one.

    within: range of the poses, where there is no scene. share: q of the percentile. losses: photodiodes that may be
    lost at any pose, 0 or 1. keep_out: zones without photodiodes; None: none. scene: what else stands in the light.
    """

    hull: Hull
    station: Lighthouse
    within: PoseRange
    mix: Mix
    share: float
    losses: int = 0
    keep_out: KeepOut | None = None
    scene: Flown | None = None

    def poses(self, count: int, seed: int | None = None) -> Poses:
        """Return `count` poses of the range, or of the scene's flight; seed: shifts them."""
        if self.scene is not None:
            return self.scene.poses(count, 0 if seed is None else seed + 1)
        return lattice(self.within, count, seed)


class Prediction(NamedTuple):
    """lit: (P, n). Per pose (P,): attitude_rad, position_m and the mixed error, inf where not solvable; lost: the mixed
    error with one photodiode lost.
    """

    lit: Bools
    attitude_rad: Floats
    position_m: Floats
    error: Floats
    lost: Floats

    @property
    def unsolvable(self) -> float:
        """The share of poses that the layout cannot solve."""
        return float(np.mean(np.isinf(self.error)))

    @property
    def unsolvable_with_one_lost(self) -> float:
        """The share of poses that the layout cannot solve if the wrong photodiode is lost."""
        return float(np.mean(np.isinf(self.lost)))


def second_sample(task: Task) -> Poses:
    """Return poses that no search has seen, for the choice between its results."""
    return task.poses(SECOND_POSES, SECOND_SEED)


def predict(task: Task, mounts: Sequence[Mount], poses: Poses) -> list[Prediction]:
    """Predict what every layout measures at poses at rest.

    Args:
        task: What the layouts are for.
        mounts: The layouts.
        poses: The poses.
    """
    every = Mount(np.concatenate([m.point_m for m in mounts]), np.concatenate([m.normal for m in mounts]))
    seen = lit(task.hull, every, task.station, poses, task.scene)
    reached = np.split(seen, np.cumsum([len(m.point_m) for m in mounts])[:-1], 1)
    return [_predicted(task, mount, poses, seen) for mount, seen in zip(mounts, reached, strict=True)]


def mixed(mix: Mix, attitude_rad: Floats, position_m: Floats) -> Floats:
    """Return the mixed error e (P,); inf where one of both errors is missing.

    Args:
        mix: Errors of one.
        attitude_rad: Attitude errors (P,) [rad].
        position_m: Position errors (P,) [m].
    """
    return _known(np.hypot(attitude_rad / mix.attitude_rad, position_m / mix.position_m))


def _predicted(task: Task, mount: Mount, poses: Poses, reached: Bools) -> Prediction:
    count, photodiodes = reached.shape
    point = np.broadcast_to(mount.point_m, (count, photodiodes, 3))
    still = np.zeros((count, photodiodes, 2)), np.zeros((count, 3)), np.zeros((count, 3))
    enough = np.count_nonzero(reached, axis=1) >= FEWEST_LIT
    made = dilution(poses.rotation, poses.position, reached, point, *still, task.mix.rotor_correlation, enough)
    attitude = np.radians(made.adop_deg_per_rad) * task.mix.angle_noise_rad
    position = made.pdop_m_per_rad * task.mix.angle_noise_rad
    lost = lost_errors(
        sightings(poses.rotation, poses.position, reached, mount.point_m, task.mix), np.arange(photodiodes)
    )
    return Prediction(reached, _known(attitude), _known(position), mixed(task.mix, attitude, position), lost)


def _known(error: Floats) -> Floats:
    out: Floats = np.where(np.isfinite(error), error, np.inf)
    return out
