"""The prediction of a layout's errors: lit photodiodes by ray cast, then ADOP and PDOP (22), (24).

The mixed error of a pose is e, e^2 = (attitude / wanted attitude)^2 + (position / wanted position)^2; it is infinite
where the pose is not solvable, fewer than four photodiodes lit or ones that determine no pose.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.layout.error import Mix
from estimators.lighthouse.dop import dilution
from estimators.lighthouse.pnp import FEWEST_LIT
from swarm.scenario import Lighthouse
from swarm.studies.layout.poses import PoseRange, Poses, lattice
from swarm.studies.layout.sight import lit
from swarm.world.hull import Hull, Mount

SECOND_POSES = 6000
SECOND_SEED = 1


class Task(NamedTuple):
    """A hull, the lighthouse, the poses, and what counts as an error of one. share: q of the percentile."""

    hull: Hull
    station: Lighthouse
    within: PoseRange
    mix: Mix
    share: float


class Prediction(NamedTuple):
    """lit: (P, n). Per pose (P,): attitude_rad, position_m and the mixed error, inf where not solvable."""

    lit: Bools
    attitude_rad: Floats
    position_m: Floats
    error: Floats

    @property
    def unsolvable(self) -> float:
        """The share of poses that the layout cannot solve."""
        return float(np.mean(np.isinf(self.error)))


def second_sample(within: PoseRange) -> Poses:
    """Return poses that no search has seen, for the choice between its results."""
    return lattice(within, SECOND_POSES, SECOND_SEED)


def predict(task: Task, mounts: Sequence[Mount], poses: Poses) -> list[Prediction]:
    """Predict what every layout measures at poses at rest.

    Args:
        task: What the layouts are for.
        mounts: The layouts.
        poses: The poses.
    """
    every = Mount(np.concatenate([m.point_m for m in mounts]), np.concatenate([m.normal for m in mounts]))
    reached = np.split(lit(task.hull, every, task.station, poses), np.cumsum([len(m.point_m) for m in mounts])[:-1], 1)
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
    return Prediction(reached, _known(attitude), _known(position), mixed(task.mix, attitude, position))


def _known(error: Floats) -> Floats:
    out: Floats = np.where(np.isfinite(error), error, np.inf)
    return out
