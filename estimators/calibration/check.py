"""Check of a calibration where it was not made: residuals of poses solved with it, against what noise alone leaves.

A pose is solved from its angles, which takes six degrees of freedom out of them, and with them nearly all of the
rotor's error: what a whole fan has in common looks like a motion. With r the residuals, P = J (J^T J)^-1 J^T over a
pose's n photodiodes, and the noise of (19), own^2 I + rotor^2 1 1^T per fan,

    E |r|^2 = tr (I - P) Cov = own^2 (2 n - 6) + rotor^2 sum_fan (n - 1^T P 1)

Unlike the residual's RMS over s, which is far below 1 for any rig, the ratio of |r|^2 to this is 1 if all that is left
is noise.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.calibration.model import fan_errors, place, predict
from estimators.calibration.problem import Noise
from estimators.lighthouse.pnp import PoseSolution, refine
from estimators.lighthouse.sweep import correct


class Sightings(NamedTuple):
    """Angles and motion of N poses, each with its own row of up to K photodiodes.

    theta (N, K, 2) [rad] as measured, lit (N, K), offset_s (N, K, 2), angular_rate (N, 3), velocity (N, 3).
    """

    theta: Floats
    lit: Bools
    offset_s: Floats
    angular_rate: Floats
    velocity: Floats


class Fit(NamedTuple):
    """Poses solved with a calibration; expected: (N,), E |r|^2 [rad^2], NaN where not solved."""

    pose: PoseSolution
    expected: Floats

    @property
    def ratio(self) -> float:
        """The root of the sum of |r|^2 over the expected sum, over the poses solved; NaN without one."""
        good = self.pose.solved & (self.expected > 0)
        total = float(self.expected[good].sum())
        return float(np.sqrt(self.pose.cost[good].sum() / total)) if total > 0 else float("nan")

    @property
    def median_ratio(self) -> float:
        """The same ratio of the median pose, which a few wrong angles do not move; a little below `ratio`."""
        good = self.pose.solved & (self.expected > 0)
        return float(np.sqrt(np.median(self.pose.cost[good] / self.expected[good]))) if good.any() else float("nan")


def solve_poses(
    seen: Sightings, fans: Floats, point_m: Floats, rotation: Floats, position: Floats, noise: Noise
) -> Fit:
    """Solve every pose as on board, with the calibrated fans and photodiodes.

    Args:
        seen: the angles of N poses.
        fans: (2, 5), the fans' numbers, taken off the angles.
        point_m: (N, K, 3) [m], photodiodes in the body frame.
        rotation: (N, 3, 3), start R_l_b.
        position: (N, 3) [m], start; a pose that starts with NaN is not solved.
        noise: of one angle.

    Raises:
        ValueError: as `refine` does.
    """
    theta = correct(seen.theta, fan_errors(fans))
    start: Bools = np.isfinite(position.sum(axis=1) + seen.velocity.sum(axis=1))
    lit: Bools = seen.lit & np.isfinite(theta).all(axis=-1) & start[:, None]
    rate, velocity = (np.nan_to_num(rates) for rates in (seen.angular_rate, seen.velocity))
    pose = refine(theta, lit, point_m, rotation, position, seen.offset_s, rate, velocity)
    lit &= pose.solved[:, None]

    row, k, fan = (i.ravel() for i in np.indices(seen.theta.shape))
    on = lit[row, k]
    row, k, fan = row[on], k[on], fan[on]
    at, turn, arm = place(
        point_m[row, k], pose.rotation[row], pose.position[row], rate[row], velocity[row], seen.offset_s[row, k, fan]
    )
    slope = predict(at, fan, np.zeros((2, 5))).point
    jacobian = np.zeros((*seen.theta.shape, 6))
    back = np.einsum("mji,mj->mi", turn, slope)
    jacobian[row, k, fan] = np.concatenate([np.cross(arm, back), slope], axis=1)
    normal = np.einsum("nkfa,nkfb->nab", jacobian, jacobian)
    normal[~pose.solved] = np.eye(6)
    shared = jacobian.sum(axis=1)
    taken = np.einsum("nfa,nfa->n", shared, np.swapaxes(np.linalg.solve(normal, np.swapaxes(shared, 1, 2)), 1, 2))
    count = lit.sum(axis=1)
    expected = noise.own_rad**2 * (2 * count - 6) + noise.rotor_rad**2 * (2 * count - taken)
    return Fit(pose, np.where(pose.solved, expected, np.nan))
