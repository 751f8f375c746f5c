"""Profile of a pose along what ranges determine least: whether all rays together want it elsewhere.

The ranges of a smooth body say next to nothing of some motion, a cylinder's turn about its own axis or a plate's within
its plane. There a registration rests on a few edges; where these are matched with others than their own, neither its
residual nor its covariance tells. With N the normal matrix of the ranges alone, in units in which attitude and position
weigh the same, and u its weakest direction, the poses

    R(s) = Exp([s u_d]x) R,   p(s) = p + s u_p

are compared with every ray, those that did not return included (`estimators.lidar.agreement`), which gives a cost c(s).
Its likelihood exp(-(c(s) - min c) / 2 k) has the mean s and the variance v, and the pose there is known to

    P = (N + u u^T / v)^-1

and v is no less than the square of half the way that the pose has come: two answers of one scan that differ are no more
certain than that. A ray that disagrees costs 16, which is right for a point off a surface and far too much for one that
passes a rim within its jitter: k makes it one unit of logarithm.
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lidar.agreement import WORST, agreement
from estimators.lidar.registration import WEAK_ATTITUDE_RAD, WEAK_POSITION, normal_equations
from estimators.lidar.scan import Scan
from estimators.lidar.shape import Shape

REACH, STEPS = 3.5, 29
"""Ends of the profile in units of a weak direction (10 degrees, or 0.18 of the radius), and number of poses."""
FINER = 5
"""The steps about the best pose are so much finer."""
ROUNDS, WEAK = 2, 1e5
"""Rounds, and what ranges know of the second weakest direction, in squared inverse units, up to which it has a profile,
too: of a cylinder they tell neither the turn about its axis nor the place along it.
"""
FOLLOWED, HELD = 3, 1e8
"""Steps in which the others follow, and the firmness that holds the profile's own directions."""
SOFTER = WORST / 2
"""The k of the likelihood."""


class Profiled(NamedTuple):
    """The pose that all rays prefer along a profile. rotation: (3, 3), target to scanner. position: (3,) [m].

    covariance: (6, 6), ordered (attitude, position). sigma: along the profile, above 1 where it is not determined.
    cost, overlap: of `Agreement`.
    """

    rotation: Floats
    position: Floats
    covariance: Floats
    sigma: float
    cost: float
    overlap: float


def profiled(scan: Scan, shape: Shape, rotation: Floats, position: Floats) -> Profiled | None:
    """Return the pose that all rays prefer along the direction that ranges determine least; None without ranges.

    Args:
        scan: of the target and its surroundings.
        shape: of the target.
        rotation: (3, 3), of a registration.
        position: (3,) [m], likewise.
    """
    unit = np.array([WEAK_ATTITUDE_RAD] * 3 + [WEAK_POSITION * shape.radius_m] * 3)
    before, start = (rotation, position), agreement(scan, shape, rotation, position)
    for _ in range(ROUNDS):
        normal, _ = normal_equations(scan.returns, shape, rotation, position)
        if not normal.any():
            return None
        known, vector = np.linalg.eigh(normal * unit[:, None] * unit)
        count = 2 if known[1] < WEAK else 1
        s = np.linspace(-REACH, REACH, STEPS)
        for along in (unit[:, None] * vector[:, :count]).T:
            coarse = s[np.argmin(_costs(scan, shape, rotation, position, along, s))]
            rotation, position = _moved(rotation, position, coarse * along)
        # The others follow, by ranges alone.
        rotation, position = _followed(scan, shape, rotation, position, unit, vector[:, :count])
    s = np.linspace(-REACH, REACH, STEPS) / FINER
    variance = np.empty(count)
    for k, along in enumerate((unit[:, None] * vector[:, :count]).T):
        cost = _costs(scan, shape, rotation, position, along, s)
        likelihood = np.exp(-(cost - cost.min()) / 2 / SOFTER)
        likelihood /= likelihood.sum()
        mean = float(likelihood @ s)
        variance[k] = float(likelihood @ (s - mean) ** 2) + (s[1] - s[0]) ** 2 / 12
        rotation, position = _moved(rotation, position, mean * along)
    seen = agreement(scan, shape, rotation, position)
    # As far as the pose that it started from is not ruled out, it may be that one.
    way = np.concatenate([rot.log(rotation @ before[0].T), position - before[1]]) / unit
    doubt = 1 / (1 + np.exp(min(max(start.cost - seen.cost, 0.0) / 2 / SOFTER, 700.0)))
    variance += doubt * (vector[:, :count].T @ way) ** 2
    known[:count] = 1 / variance
    covariance = unit[:, None] * ((vector / np.maximum(known, 1e-12)) @ vector.T) * unit
    return Profiled(rotation, position, covariance, float(np.sqrt(variance.max())), seen.cost, seen.overlap)


def _followed(
    scan: Scan, shape: Shape, rotation: Floats, position: Floats, unit: Floats, held: Floats
) -> tuple[Floats, Floats]:
    """Return a pose after steps by ranges alone, across directions `held` (6, k), in units, in which it stays.

    Ranges say little along these, but not nothing: free to, they would lead the pose away from what all rays prefer.
    """
    firm = HELD * held @ held.T + np.eye(6)
    for _ in range(FOLLOWED):
        normal, right = normal_equations(scan.returns, shape, rotation, position)
        step = unit * np.linalg.solve(normal * unit[:, None] * unit + firm, unit * right)
        rotation, position = _moved(rotation, position, step)
    return rotation, position


def _moved(rotation: Floats, position: Floats, step: Floats) -> tuple[Floats, Floats]:
    """Return a pose moved by `step` (6,)."""
    return rot.exp(step[:3]) @ rotation, position + step[3:]


def _costs(scan: Scan, shape: Shape, rotation: Floats, position: Floats, along: Floats, s: Floats) -> Floats:
    """Return the costs of the poses at `s` (n,) along a direction (6,)."""
    return np.array([agreement(scan, shape, *_moved(rotation, position, x * along)).cost for x in s])
