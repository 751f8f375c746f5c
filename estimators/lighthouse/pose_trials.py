"""Monte Carlo of a static pose: how far poses solved from noisy angles scatter about the truth, against (18).

At each of P poses the angles (2) of the lit photodiodes get the noise of (19): for every trial one draw per fan with
sqrt(rho) s, shared by all photodiodes, and one per angle with sqrt(1 - rho) s. Each trial is solved by
`estimators.lighthouse.pnp.refine` from the true pose, so what scatters is the minimum next to the truth; a mirror pose
that fits as well is a matter of the first fix, not of precision. Errors are root mean squares about the truth, whole
vectors.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.lighthouse.pnp import refine
from estimators.lighthouse.projection import checked, checked_lit
from estimators.rotation import angle_between

BATCH = 50_000
"""Solves at once: bounds the memory."""


class Scatter(NamedTuple):
    """Errors per pose (P,): attitude_rad and position_m, RMS over the trials that were solved, NaN for none; failed,
    the share of trials that were not.
    """

    attitude_rad: Floats
    position_m: Floats
    failed: Floats


def scatter(
    rotation: Floats,
    position: Floats,
    lit: Bools,
    point_m: Floats,
    angle_noise_rad: float,
    rotor_correlation: float,
    trials: int,
    seed: int,
) -> Scatter:
    """Solve every pose `trials` times.

    Args:
        rotation: (P, 3, 3) R_l_b.
        position: (P, 3) [m], lighthouse frame.
        lit: (P, K).
        point_m: (K, 3) [m], body frame.
        angle_noise_rad: s.
        rotor_correlation: rho of (19).
        trials: per pose.
        seed: of the noise.

    Raises:
        ValueError: shapes do not fit `lit`.
    """
    lit = checked_lit(lit)
    poses, photodiodes = lit.shape
    point = checked("point_m", point_m, (photodiodes, 3))
    rotation = checked("rotation", rotation, (poses, 3, 3))
    position = checked("position", position, (poses, 3))
    rng = np.random.default_rng(seed)
    p = np.einsum("pij,kj->pki", rotation, point) + position[:, None]
    theta = np.arctan2(p[..., 2:], p[..., :2])
    out = Scatter(np.full(poses, np.nan), np.full(poses, np.nan), np.ones(poses))
    size = max(BATCH // trials, 1)
    for first in range(0, poses, size):
        part = slice(first, min(first + size, poses))
        shape = (part.stop - first, trials)
        noise = np.sqrt(rotor_correlation) * rng.standard_normal((*shape, 1, 2))
        noise = noise + np.sqrt(1 - rotor_correlation) * rng.standard_normal((*shape, photodiodes, 2))

        def each(array: Floats, shape: tuple[int, int] = shape) -> Floats:
            return np.repeat(array, shape[1], axis=0)

        count = shape[0] * trials
        still = np.zeros((count, photodiodes, 2)), np.zeros((count, 3)), np.zeros((count, 3))
        solution = refine(
            (theta[part, None] + angle_noise_rad * noise).reshape(-1, photodiodes, 2),
            np.repeat(lit[part], trials, axis=0),
            np.broadcast_to(point, (count, photodiodes, 3)),
            each(rotation[part]),
            each(position[part]),
            *still,
        )
        attitude = angle_between(solution.rotation, each(rotation[part])).reshape(shape)
        distance = np.linalg.norm(solution.position - each(position[part]), axis=1).reshape(shape)
        solved = solution.solved.reshape(shape)
        out.attitude_rad[part], out.position_m[part] = _rms(attitude, solved), _rms(distance, solved)
        out.failed[part] = 1 - solved.mean(axis=1)
    return out


def _rms(error: Floats, solved: Bools) -> Floats:
    """Return the RMS over the solved trials (P, trials), per pose; NaN where there is none."""
    count = np.count_nonzero(solved, axis=1)
    total = np.sum(np.where(solved, error, 0.0) ** 2, axis=1)
    mean = np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0)
    out: Floats = np.sqrt(mean)
    return out
