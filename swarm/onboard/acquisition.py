"""From no pose to one pose: cold start, and the ambiguity that a small target seen from afar can have.

Four photodiodes in one plane, or a rig that is small against its distance, often fit two poses almost equally
well (the mirror image about the line of sight). The sum of squared angle residuals over the noise variance is
minus twice the log-likelihood, so two hypotheses are told apart by the difference D of their costs, added up over
the periods in which both were refined:

    D = sum over periods of (cost_second - cost_best) / s^2

With independent noise of variance s^2 the chance that the wrong pose leads by D is at most Q(sqrt D), whatever
the geometry: DECISIVE = 25 is 5 sigma, 3e-7. Until then the craft says that it is ambiguous, and gives no pose.
The part of the noise that a whole sweep shares shifts all angles alike and tells no hypothesis from another, so s
is the independent part; where the best fit is worse than s (a rig out of calibration), the fit's own scatter counts.
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.pnp import refine
from estimators.pnp_start import cold_start

DECISIVE = 25.0
"""Difference of the costs, in units of the noise variance, that decides between two poses (5 sigma)."""
SAME_POSE_RAD = 1e-3
"""Two refined hypotheses closer than this have run into one minimum: far below the tens of degrees between mirrors."""


class Sighting(NamedTuple):
    """What one craft saw in one period: theta (K, 2) [rad], lit (K,), point_m (K, 3), offset_s (K, 2)."""

    theta: Floats
    lit: Bools
    point_m: Floats
    offset_s: Floats


class Hypotheses(NamedTuple):
    """The poses that one craft may have, best first: rotation (M, 3, 3), position (M, 3) [m], evidence (M,).

    evidence: cost over noise variance, added up since the search began.
    """

    rotation: Floats
    position: Floats
    evidence: Floats

    @property
    def decided(self) -> bool:
        """Whether the first pose is certain: alone, or ahead of the second by DECISIVE."""
        return len(self.evidence) == 1 or (
            len(self.evidence) > 1 and float(self.evidence[1] - self.evidence[0]) >= DECISIVE
        )


NONE = Hypotheses(np.empty((0, 3, 3)), np.empty((0, 3)), np.empty(0))


def search(sighting: Sighting, noise_rad: float) -> Hypotheses:
    """Every pose that fits one period's angles, from nothing: empty where the photodiodes do not determine one.

    noise_rad: the independent part of the angle noise [rad]. The craft is taken to be at rest within the period.
    """
    rest = np.zeros(3)
    found = cold_start(sighting.theta, sighting.lit, sighting.point_m, sighting.offset_s, rest, rest)
    if len(found.cost) == 0:
        return NONE
    return Hypotheses(found.rotation, found.position, found.cost / _variance(found.cost, sighting, noise_rad))


def follow(before: Hypotheses, sighting: Sighting, noise_rad: float) -> Hypotheses:
    """The same poses one period later, refined with this period's angles, with its evidence added.

    A pose that no longer converges is given up; poses that run into one minimum become one.
    """
    count = len(before.evidence)
    rest = np.zeros((count, 3))
    lit = np.repeat(sighting.lit[None], count, axis=0)
    solution = refine(
        np.repeat(sighting.theta[None], count, axis=0),
        lit,
        np.repeat(sighting.point_m[None], count, axis=0),
        before.rotation,
        before.position,
        np.repeat(sighting.offset_s[None], count, axis=0),
        rest,
        rest,
    )
    keep = np.flatnonzero(solution.solved)
    if len(keep) == 0:
        return NONE
    evidence = before.evidence[keep] + solution.cost[keep] / _variance(solution.cost[keep], sighting, noise_rad)
    order = keep[np.argsort(evidence, kind="stable")]
    rotation = solution.rotation[order]
    distinct = [i for i in range(len(order)) if np.all(rot.angle_between(rotation[:i], rotation[i]) > SAME_POSE_RAD)]
    return Hypotheses(rotation[distinct], solution.position[order][distinct], np.sort(evidence)[distinct])


def _variance(cost: Floats, sighting: Sighting, noise_rad: float) -> float:
    """Noise variance [rad^2]: the design value, or the best fit's own scatter where that is larger."""
    redundancy = 2 * int(np.count_nonzero(sighting.lit)) - 6
    return max(noise_rad**2, float(cost.min()) / redundancy)
