"""Acquisition: from no pose to one pose, despite the ambiguity of a small target seen from afar.

Four photodiodes in one plane, or a rig that is small against its distance, often fit two poses almost equally
well (the mirror image about the line of sight). The sum of squared angle residuals over the noise variance is
minus twice the log-likelihood, so two hypotheses are distinguished by the difference D of their costs, summed over
the periods in which both were refined:

    D = sum over periods of (cost_second - cost_best) / s^2

With independent noise of variance s^2 the probability that the wrong pose leads by D is at most Q(sqrt D) for any
geometry: DECISIVE = 25 is 5 sigma, 3e-7. Until then the craft reports an ambiguity, and no pose.
The part of the noise that a whole sweep shares shifts all angles alike and does not distinguish hypotheses, so s
is the independent part; if the best fit is worse than s (a rig out of calibration), the fit's own scatter is used.
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
"""Angle below which two refined hypotheses are one minimum [rad]: far below the tens of degrees between mirrors."""


class Sighting(NamedTuple):
    """Sweep angles of one craft in one period.

    theta: (K, 2) [rad]. lit: photodiodes seen by both fans, (K,). point_m: positions of the photodiodes, (K, 3).
    offset_s: instants of the angles minus the epoch, (K, 2).
    """

    theta: Floats
    lit: Bools
    point_m: Floats
    offset_s: Floats


class Hypotheses(NamedTuple):
    """The candidate poses of one craft, best first.

    rotation: (M, 3, 3). position: (M, 3) [m]. evidence: cost over noise variance, summed since the search began, (M,).
    """

    rotation: Floats
    position: Floats
    evidence: Floats

    @property
    def decided(self) -> bool:
        """Return whether the first pose is certain: alone, or ahead of the second by DECISIVE."""
        return len(self.evidence) == 1 or (
            len(self.evidence) > 1 and float(self.evidence[1] - self.evidence[0]) >= DECISIVE
        )


NONE = Hypotheses(np.empty((0, 3, 3)), np.empty((0, 3)), np.empty(0))


def advance(before: Sequence[Hypotheses], sightings: Sequence[Sighting], noise_rad: float) -> list[Hypotheses]:
    """Return the hypotheses of several craft after this period: craft with hypotheses follow them, the others search.

    A craft whose hypotheses are all lost searches at once. Each craft's result is independent, bit for bit, of the
    other craft in the batch.

    Args:
        before: hypotheses of each craft before this period.
        sightings: this period's sweep angles of each craft.
        noise_rad: independent part of the angle noise [rad].
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
    """Return every pose that fits one period's angles, without a prediction; none if the angles do not determine one.

    noise_rad: independent part of the angle noise [rad]. The craft is assumed to be at rest within the period.
    """
    return _search_all([sighting], noise_rad)[0]


def follow(before: Hypotheses, sighting: Sighting, noise_rad: float) -> Hypotheses:
    """Return the same poses one period later, refined with this period's angles, with its evidence added.

    A pose that no longer converges is dropped; poses that converge to one minimum become one.

    Args:
        before: hypotheses before this period.
        sighting: this period's sweep angles.
        noise_rad: independent part of the angle noise [rad].
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
    """Return one craft's hypotheses with their refined poses, the rows `own`, and with this period's evidence added."""
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
    """Return the noise variance [rad^2]: the design value, or the best fit's own scatter if that is larger."""
    redundancy = 2 * int(np.count_nonzero(sighting.lit)) - 6
    return max(noise_rad**2, float(cost.min()) / redundancy)
