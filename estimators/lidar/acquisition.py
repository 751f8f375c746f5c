"""Acquisition: the pose of a target of known shape from one scan, from nothing.

    1. the returns fall into objects; one that is no larger than the shape can be the target
    2. thousands of starts, each refined a little and scored          estimators.lidar.pose_search
    3. the best that differ: registration, point to plane, k-d tree   estimators.lidar.registration
       and what the best of these is easily mistaken for              estimators.lidar.likeness
    4. every ray against what each of them predicts                   estimators.lidar.agreement
    5. the best of all, if enough rays agree with it and no other pose agrees nearly as well

A scan that allows two poses is *ambiguous*: the better one is given, and that it is a guess is said. Poses that the
shape's own symmetry makes equal (`estimators.lidar.symmetry`) are one: any of them is the answer, and means all.
"""

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lidar.agreement import WORST, agreement
from estimators.lidar.likeness import mistaken
from estimators.lidar.pose_search import STARTS, Poses, distinct, rotations, search
from estimators.lidar.profile import profiled
from estimators.lidar.registration import JUMP, Approach, Registration, shifted
from estimators.lidar.scan import Edges, Returns, Scan, checked, clusters
from estimators.lidar.shape import Shape
from estimators.lidar.symmetry import symmetry

REACH_ROUGH, REACH = 0.12, 0.04
"""How far points may lie from the surface where a registration starts, against the radius: from the search, and from a
rough registration.
"""
FINE = 4
"""Rough registrations that are registered once more."""
ROUNDS = 3
"""At most so often what the best pose is mistaken for is looked at, and registered."""
CLEARLY = 0.8
"""Cost, against that of a finer registration, below which a rough one stays."""
SAME = 0.01
"""Turn [rad], or shift against the radius, below which two registrations have come to one pose."""
RAYS, HOPEFUL = 400, 3.0
"""Rays that tell where a rough pose belongs along what its points leave free; cost of such a one, against the best's,
up to which that is asked.
"""
LINKS = (0.6, 0.3, 0.1)
"""Returns nearer than this, against the shape's radius, belong to one object; the wider links first."""


class Verdict(Enum):
    """The usefulness of a scan."""

    FOUND = "found"
    AMBIGUOUS = "ambiguous"
    """Another pose agrees with the scan nearly as well."""
    UNDETERMINED = "undetermined"
    """The visible surface leaves a direction free: a single plane, for instance."""
    NOT_RECOGNISED = "not recognised"
    """No pose agrees with the scan: another object, or too much of it missing."""
    TOO_FEW = "too few returns"


@dataclass(frozen=True)
class AcquisitionSettings:
    """Settings of the acquisition. starts: rotations tried. candidates: of them refined and compared. apart_rad: poses
    nearer than this are one.

    fewest: returns without which nothing is tried. overlap_least: share of the rays that must agree. margin: cost that
    the runner-up must have more, against the best's own, or that of `rays_against` rays if more; or else, with
    `overlap_sure` of the best, `rays_against` rays must contradict it that do not contradict the best, and `unanimous`
    times as many as the other way round. overlap_edges: with fewer rays that agree, poses are tried without edges.
    size_slack: an object may be this much larger than the shape.
    """

    starts: int = STARTS
    candidates: int = 12
    apart_rad: float = 0.15
    fewest: int = 40
    overlap_least: float = 0.8
    margin: float = 1.0
    overlap_sure: float = 0.9
    overlap_edges: float = 0.97
    rays_against: int = 8
    unanimous: float = 6.0
    size_slack: float = 1.15


class Acquisition(NamedTuple):
    """The target in the scanner's frame: rotation (3, 3) R_s_t, position (3,) [m], NaN where there is none.

    covariance: (6, 6), ordered (attitude, position). verdict: whether to believe it. confidence: 0 to 1, above 0.5
    exactly where `verdict` is FOUND. overlap: share of the rays that agree. margin: how much worse the runner-up is.
    runner_up: its attitude (3, 3), NaN where there is none. residual_m: RMS. points: returns of the target.
    rivals: registrations of poses that differ, this one first, which further scans may tell apart (`evidence`).
    """

    rotation: Floats
    position: Floats
    covariance: Floats
    verdict: Verdict
    confidence: float
    overlap: float
    margin: float
    runner_up: Floats
    residual_m: float
    points: int
    rivals: tuple[Registration, ...] = ()

    @property
    def found(self) -> bool:
        """True where the pose can be believed, modulo the shape's symmetry."""
        return self.verdict is Verdict.FOUND

    def nearest(self, shape: Shape, attitude: Floats) -> "Acquisition":
        """Return the equivalent pose whose attitude is nearest to another; itself where the shape is not symmetric.

        Args:
            shape: of the target.
            attitude: (3, 3), the other attitude.
        """
        rotation, position = symmetry(shape).nearest(self.rotation, self.position, attitude)
        return self._replace(rotation=rotation, position=position, covariance=shifted(self, position))


class Candidate(NamedTuple):
    """A registration, and how a scan agrees with it: cost, overlap, rays and conflict (N,) of `Agreement`."""

    fit: Registration
    cost: float
    overlap: float
    rays: int
    conflict: Bools


def acquire(scan: Scan, shape: Shape, settings: AcquisitionSettings | None = None) -> Acquisition:
    """Return the pose of the target from one scan of it.

    Args:
        scan: of the target and its surroundings.
        shape: of the target.
        settings: None: the usual ones.

    Raises:
        ValueError: the scan is none (`checked`).
    """
    return about_origin(acquire_centred(scan, shape.centred, settings or AcquisitionSettings()), shape)


def about_origin(found: Acquisition, shape: Shape) -> Acquisition:
    """Return an acquisition of the shape about its middle as one about its own origin, without rivals."""
    found = found._replace(rivals=())
    if not shape.centre.any():
        return found
    position = found.position - found.rotation @ shape.centre
    return found._replace(position=position, covariance=shifted(found, position))


def acquire_centred(scan: Scan, shape: Shape, s: AcquisitionSettings) -> Acquisition:
    """Return the pose of a target whose shape is about its origin, as `acquire`, with rivals.

    Args:
        scan: of the target and its surroundings.
        shape: of the target.
        s: the settings.
    """
    best, tried = nothing(0), set[tuple[int, int, int]]()
    most = 0
    # Parts of the target may stand apart where what joins them was not hit; other things may stand near it.
    for members in (m for link in LINKS for m in clusters(checked(scan), link * shape.radius_m)):
        key = int(members[0]), int(members[-1]), len(members)
        own = scan.direction[members] * scan.range_m[members, None]
        if key in tried or _extent(own) > s.size_slack * shape.diameter_m:
            continue
        if len(members) < s.fewest:
            most = max(most, len(members))
            continue
        tried.add(key)
        found = _of_object(_alone(scan, members, own, shape), scan, shape, s)
        if found.confidence > best.confidence or not np.isfinite(best.position).all():
            best = found
        if found.found:
            break
    return best if tried else best._replace(points=most)


def nothing(points: int) -> Acquisition:
    """Return no pose: too few returns."""
    unknown = np.full((3, 3), np.nan)
    return Acquisition(
        unknown, unknown[0], np.full((6, 6), np.nan), Verdict.TOO_FEW, 0.0, np.nan, np.nan, unknown, np.nan, points
    )


def _extent(point: Floats) -> float:
    """Return at least the largest distance between two of these points, less 2 %."""
    centred = point - point.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    turned = centred @ axes.T
    first = turned[np.argmax(turned[:, 0])] - turned[np.argmin(turned[:, 0])]
    return float(max(np.linalg.norm(first), *np.ptp(turned, axis=0)))


def _alone(scan: Scan, members: np.ndarray, own: Floats, shape: Shape) -> Scan:
    """Return the rays towards one object, those beside it included, without what other objects returned."""
    other = scan.returned
    other[members] = False
    rest = scan.rays(~other)
    return rest.around((own.min(axis=0) + own.max(axis=0)) / 2, shape.diameter_m)


def _of_object(scan: Scan, everything: Scan, shape: Shape, s: AcquisitionSettings) -> Acquisition:
    point = scan.point
    group = symmetry(shape)
    found = search(scan, shape, group.one_of_each(rotations(s.starts)))
    poses = distinct(found, s.apart_rad / 2, s.candidates, group.angle_between)
    some = point[:: max(1, len(point) // 300)]
    edges = scan.edges(JUMP * shape.radius_m)
    rough = refined(scan, shape, poses, some, edges)
    # The best ones once more, with all points; and then what the best of all is mistaken for, until it stays the best.
    fine, asked = list[Candidate](), None
    for _ in range(ROUNDS):
        rough = _apart(sorted(rough, key=lambda c: c.cost), fine, shape)
        fine = sorted(fine + finely(scan, shape, rough[:FINE], edges, s), key=lambda c: c.cost)
        rough = rough[FINE:]
        if not fine or (asked is not None and not differ(fine[0].fit, asked, s, shape)):
            break
        asked = fine[0].fit
        rough += refined(scan, shape, mistaken(shape, asked.rotation, asked.position), some, edges)
    if not fine:
        return nothing(len(point))._replace(verdict=Verdict.NOT_RECOGNISED)
    others = [c for c in fine[1:] + rough if differ(c.fit, fine[0].fit, s, shape)]
    second = min(others, key=lambda c: c.cost, default=None)
    if second is not None and not any(second is c for c in fine):
        # As far as the best: a rough one would lose for being rough.
        fine = sorted(fine + finely(scan, shape, [second], edges, s), key=lambda c: c.cost)
        others = [c for c in fine[1:] + rough if differ(c.fit, fine[0].fit, s, shape)]
        second = min(others, key=lambda c: c.cost, default=None)
    best = fine[0]
    margin = margin_of(best, second, s) if second else np.inf
    # What else returned from where the target is said to be must be explained, too: this may be but a part of it.
    whole = agreement(everything.around(best.fit.position, shape.radius_m), shape, best.fit.rotation, best.fit.position)
    best = best._replace(overlap=min(best.overlap, whole.overlap) if whole.rays else 0.0)
    rivals = [c.fit for c in others if margin_of(best, c, s) < s.margin]
    out = answered(best.fit, second.fit if second else None, best.overlap, margin, s)
    return out._replace(points=len(point), rivals=(best.fit, *rivals[: s.candidates]))


def answered(
    best: Registration, second: Registration | None, overlap: float, margin: float, s: AcquisitionSettings
) -> Acquisition:
    """Return the answer that the best pose is, with points and rivals left open.

    Args:
        best: of all.
        second: the runner-up, if any.
        overlap: of the best.
        margin: of the runner-up.
        s: the settings.
    """
    verdict = Verdict.FOUND
    if overlap < s.overlap_least:
        verdict = Verdict.NOT_RECOGNISED
    elif best.degenerate:
        verdict = Verdict.UNDETERMINED
    elif margin < s.margin:
        verdict = Verdict.AMBIGUOUS
    confidence = 0.0 if best.degenerate else confidence_of(overlap, margin, s)
    runner_up = second.rotation if second else np.full((3, 3), np.nan)
    pose = best.rotation, best.position, best.covariance
    return Acquisition(*pose, verdict, confidence, overlap, margin, runner_up, best.residual_m, 0)


def margin_of(best: Candidate, second: Candidate, s: AcquisitionSettings) -> float:
    """Return how much worse the runner-up is, in units of what is enough: by its cost, or by the rays that decide.

    Args:
        best: of all.
        second: another.
        s: the settings.
    """
    against = int(np.count_nonzero(second.conflict & ~best.conflict))
    opposed = int(np.count_nonzero(best.conflict & ~second.conflict))
    return margin_by(best.cost, second.cost, best.overlap, (against, opposed), s)


def margin_by(cost: float, other: float, overlap: float, decide: tuple[int, int], s: AcquisitionSettings) -> float:
    """Return the same from sums over all rays.

    A small part may be all that tells two attitudes: of a thousand rays, the twenty that meet it. Where nearly all rays
    agree with the best, those that contradict but one of the two are counted, and must be many, and nearly unanimous.

    Args:
        cost: of the best.
        other: of the other.
        overlap: of the best.
        decide: how many rays contradict only the other, and only the best.
        s: the settings.
    """
    # A cost of few rays is small, and then one or two that contradict by chance are much.
    by_cost = (other - cost) / max(cost, s.rays_against * WORST)
    if overlap < s.overlap_sure:
        return by_cost
    against, opposed = decide
    return max(by_cost, s.margin * min(against / s.rays_against, against / (s.unanimous * max(opposed, 1))))


def confidence_of(overlap: float, margin: float, s: AcquisitionSettings) -> float:
    """Return the weaker of the two: how far overlap and margin are beyond their limits, a half at the limit itself.

    Args:
        overlap: of the best.
        margin: of the runner-up.
        s: the settings.
    """
    fits = overlap / s.overlap_least
    beyond = (overlap - s.overlap_least) / (1 - s.overlap_least)
    agrees = 0.5 * fits**4 if fits < 1 else 0.5 + 0.5 * beyond
    unique = 1 - 0.5 ** max(margin / s.margin, 0.0)
    return float(min(agrees, unique))


def refined(scan: Scan, shape: Shape, poses: Poses, point: Floats, edges: Edges) -> list[Candidate]:
    """Return rough registrations from poses, those that no ray says anything of left out.

    One that its points leave free is looked for along what they do.

    Args:
        scan: of the target.
        shape: of the target.
        poses: where they start.
        point: (n, 3) [m], those returns that are registered.
        edges: of the scan.
    """
    returns, reach_m = scan.returns._replace(point=point), REACH_ROUGH * shape.radius_m
    starts = zip(poses.rotation, poses.position, strict=True)
    fits = [Approach(returns, shape, *start, reach_m).registered(edges, rough=True) for start in starts]
    out = [c for c in (_compared(scan, shape, fit) for fit in fits) if c.rays]
    hopeful = HOPEFUL * min((c.cost for c in out), default=0.0)
    free = [c.fit.degenerate and c.cost < hopeful and np.isfinite(c.fit.residual_m) for c in out]
    return [_slid(scan, shape, returns, edges, c) if slides else c for c, slides in zip(out, free, strict=True)]


def _compared(scan: Scan, shape: Shape, fit: Registration) -> Candidate:
    """Return a registration beside what all rays say of it."""
    seen = agreement(scan, shape, fit.rotation, fit.position)
    return Candidate(fit, seen.cost, seen.overlap, seen.rays, seen.conflict)


def _slid(scan: Scan, shape: Shape, returns: Returns, edges: Edges, rough: Candidate) -> Candidate:
    """Return a rough registration once more from where the rays want it along what its points leave free, if better.

    What points leave free stays where the search had it: a plate slides within its plane, and neither its own points
    nor edges, out of reach, bring it back.
    """
    some = scan.rays(np.arange(0, len(scan.range_m), max(1, len(scan.range_m) // RAYS)))
    better = profiled(some, shape, rough.fit.rotation, rough.fit.position)
    if better is None:
        return rough
    approach = Approach(returns, shape, better.rotation, better.position, REACH * shape.radius_m)
    found = _compared(scan, shape, approach.registered(edges, rough=True))
    return found if found.cost < rough.cost else rough


def finely(
    scan: Scan, shape: Shape, candidates: list[Candidate], edges: Edges, s: AcquisitionSettings
) -> list[Candidate]:
    """Return rough registrations once more, with all points; where few rays agree, without edges if better.

    Perhaps edges were matched with others than their own. Rivals have the same chance: one that is spoilt so does not
    contradict the best. A rough one that all rays clearly prefer stays as it is.

    Args:
        scan: of the target.
        shape: of the target.
        candidates: the rough ones.
        edges: of the scan.
        s: the settings.
    """
    out = []
    for rough in candidates:
        start = rough.fit.rotation, rough.fit.position
        approach = Approach(scan.returns, shape, *start, REACH * shape.radius_m)
        found = [c for c in [_compared(scan, shape, approach.registered(edges))] if c.rays]
        if found and found[0].overlap < s.overlap_edges:
            plain = _compared(scan, shape, approach.registered())
            found += [plain] if plain.rays and not plain.fit.degenerate else []
        found = sorted(found, key=lambda c: c.cost)[:1]
        out += [rough] if not found or rough.cost < CLEARLY * found[0].cost else found
    return out


def _apart(candidates: list[Candidate], known: list[Candidate], shape: Shape) -> list[Candidate]:
    """Return the candidates that are neither a known pose nor one before them, to a hundredth."""
    out = list[Candidate]()
    for one in candidates:
        met = [c.fit for c in out + known]
        if not any(_distance(one.fit, fit, shape) < SAME for fit in met):
            out.append(one)
    return out


def _distance(a: Registration, b: Registration, shape: Shape) -> float:
    """Return how far two poses are apart, modulo symmetry: turn [rad], or shift against the radius, if more."""
    rotation, position = symmetry(shape).nearest(a.rotation, a.position, b.rotation)
    shift = float(np.linalg.norm(position - b.position)) / shape.radius_m
    return max(float(rot.angle_between(rotation, b.rotation)), shift)


def differ(a: Registration, b: Registration, s: AcquisitionSettings, shape: Shape) -> bool:
    """Return whether two poses are not one, and not equivalent by the shape's symmetry.

    Args:
        a: a pose.
        b: another.
        s: the settings.
        shape: of the target.
    """
    return _distance(a, b, shape) > s.apart_rad
