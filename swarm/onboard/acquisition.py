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

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse.pnp import PoseSolution, refine
from estimators.lighthouse.pnp_start import cold_starts

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


def advance(before: Sequence[Hypotheses], sightings: Sequence[Sighting], noise_rad: float) -> list[Hypotheses]:
    """What several craft make of this period: those that have hypotheses follow them, those left without one search.

    Each craft's answer is its own, bit for bit, in whatever company it is asked.
    """
    out = list(before)
    following = [i for i, hypotheses in enumerate(before) if len(hypotheses.evidence)]
    for i, hypotheses in zip(
        following,
        _follow_all([before[i] for i in following], [sightings[i] for i in following], noise_rad),
        strict=True,
    ):
        out[i] = hypotheses
    searching = [i for i, hypotheses in enumerate(out) if not len(hypotheses.evidence)]
    for i, hypotheses in zip(searching, _search_all([sightings[i] for i in searching], noise_rad), strict=True):
        out[i] = hypotheses
    return out


def search(sighting: Sighting, noise_rad: float) -> Hypotheses:
    """Every pose that fits one period's angles, from nothing: empty where the photodiodes do not determine one.

    noise_rad: the independent part of the angle noise [rad]. The craft is taken to be at rest within the period.
    """
    return _search_all([sighting], noise_rad)[0]


def follow(before: Hypotheses, sighting: Sighting, noise_rad: float) -> Hypotheses:
    """The same poses one period later, refined with this period's angles, with its evidence added.

    A pose that no longer converges is given up; poses that run into one minimum become one.
    """
    return _follow_all([before], [sighting], noise_rad)[0]


def _search_all(sightings: Sequence[Sighting], noise_rad: float) -> list[Hypotheses]:
    if not sightings:
        return []
    rest = np.zeros((len(sightings), 3))
    out = []
    for sighting, found in zip(sightings, cold_starts(*_stacked(sightings), rest, rest), strict=True):
        if len(found.cost):
            variance = _variance(found.cost, sighting, noise_rad)
            out.append(Hypotheses(found.rotation, found.position, found.cost / variance))
        else:
            out.append(NONE)
    return out


def _follow_all(before: Sequence[Hypotheses], sightings: Sequence[Sighting], noise_rad: float) -> list[Hypotheses]:
    if not before:
        return []
    count = [len(hypotheses.evidence) for hypotheses in before]
    theta, lit, point, offset = _stacked([one for one, many in zip(sightings, count, strict=True) for _ in range(many)])
    rotation = np.concatenate([hypotheses.rotation for hypotheses in before])
    position = np.concatenate([hypotheses.position for hypotheses in before])
    rest = np.zeros((len(lit), 3))
    solution = refine(theta, lit, point, rotation, position, offset, rest, rest)
    out, first = [], 0
    for hypotheses, sighting, many in zip(before, sightings, count, strict=True):
        out.append(_updated(hypotheses, solution, slice(first, first + many), sighting, noise_rad))
        first += many
    return out


def _stacked(sightings: Sequence[Sighting]) -> tuple[Floats, Bools, Floats, Floats]:
    theta, lit, point, offset = (np.stack(part) for part in zip(*sightings, strict=True))
    return theta, lit, point, offset


def _updated(
    before: Hypotheses, solution: PoseSolution, own: slice, sighting: Sighting, noise_rad: float
) -> Hypotheses:
    """One craft's hypotheses with their refined poses, the rows `own`, and with this period's evidence added."""
    keep = np.flatnonzero(solution.solved[own])
    if len(keep) == 0:
        return NONE
    cost = solution.cost[own][keep]
    evidence = before.evidence[keep] + cost / _variance(cost, sighting, noise_rad)
    order = keep[np.argsort(evidence, kind="stable")]
    rotation = solution.rotation[own][order]
    distinct = [i for i in range(len(order)) if np.all(rot.angle_between(rotation[:i], rotation[i]) > SAME_POSE_RAD)]
    return Hypotheses(rotation[distinct], solution.position[own][order][distinct], np.sort(evidence)[distinct])


def _variance(cost: Floats, sighting: Sighting, noise_rad: float) -> float:
    """Noise variance [rad^2]: the design value, or the best fit's own scatter where that is larger."""
    redundancy = 2 * int(np.count_nonzero(sighting.lit)) - 6
    return max(noise_rad**2, float(cost.min()) / redundancy)
