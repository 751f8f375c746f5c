"""Tracking: the pose of a target of known shape from one scan, starting from where it is believed to be.

Registration from the prediction (`estimators.lidar.registration`); then every ray against what the result predicts
(`estimators.lidar.agreement`). The target is lost where the surface does not determine the pose, the residual is not
noise, too few rays agree, or the registration walked away from the prediction.

`chain` is the paper's own tracking (section 1.3): each scan against the previous *scan*, principal components first,
(15) to (19), then point to plane; its errors add up along the track. It is here to be compared.
"""

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lidar.agreement import agreement
from estimators.lidar.point_cloud import align_principal
from estimators.lidar.point_cloud import checked as checked_points
from estimators.lidar.pose_search import search
from estimators.lidar.profile import Profiled, profiled
from estimators.lidar.registration import JUMP, Approach, Registration, shifted
from estimators.lidar.scan import Edges, Scan, checked
from estimators.lidar.shape import Shape

Pose = tuple[Floats, Floats]
"""Rotation (3, 3) and position (3,) [m]."""
AROUND = rot.exp(np.concatenate([np.radians(angle) * axes for angle in (10, 20) for axes in (np.eye(3), -np.eye(3))]))
"""Turns of the prediction that are tried where it leads to no agreement."""
TRIED = 3
CLEARLY = 0.7
"""Cost, against another's, below which a pose explains the rays better even if it is not determined."""

HALF = 0.5
"""Likewise, for a pose that takes the place of one that is determined: the least cost is below that of the truth."""
APART_RAD = 0.025
"""Turn, or shift against the radius, below which a profile does not take the place of a registration."""
SAME, HOPEFUL = 0.01, 2.0
"""Turn [rad], or shift against the radius, below which starts or rough registrations are one pose; cost of such a
registration, against the best's, up to which it may yet become better.
"""
BETTER = 25.0
"""Squared sigmas by which ranges must fit better without edges than with them, for these to be false: six parameters
gain so much by chance in one of 3000 scans.
"""


class Outcome(Enum):
    """The result of tracking by one scan."""

    TRACKED = "tracked"
    TOO_FEW = "too few returns"
    UNDETERMINED = "undetermined"
    RESIDUAL = "residual too large"
    OVERLAP = "overlap too small"
    WALKED_AWAY = "far from the prediction"


@dataclass(frozen=True)
class TrackingSettings:
    """Settings of the tracking. fewest: returns. reach: how far from the surface returns may lie at the start, against
    the shape's radius.

    overlap_sure, walk_sure_rad: with fewer rays that agree, or an attitude further from the prediction, other starts
    near the prediction are tried, and registration without edges; however far, not where overlap_certain of them do.
    overlap_profile: with fewer rays that agree, all rays
    are asked for a better pose along what ranges determine least. residual_most: RMS, against the noise and what the
    jitter of the rays makes at the target's range.
    overlap_least: share of the rays that must agree. walk_most_rad: how far the attitude may be from the prediction.
    """

    fewest: int = 25
    overlap_sure: float = 0.93
    overlap_certain: float = 0.97
    overlap_profile: float = 0.95
    walk_sure_rad: float = 0.05
    reach: float = 0.15
    residual_most: float = 3.0
    overlap_least: float = 0.7
    walk_most_rad: float = 0.35


class Track(NamedTuple):
    """The target in the scanner's frame: rotation (3, 3), position (3,) [m]; covariance (6, 6), ordered (attitude,
    position). outcome: whether to believe it. residual_m: RMS. overlap: share of the rays that agree. points: returns.
    """

    rotation: Floats
    position: Floats
    covariance: Floats
    outcome: Outcome
    residual_m: float
    overlap: float
    points: int

    @property
    def tracked(self) -> bool:
        """True where the pose can be believed."""
        return self.outcome is Outcome.TRACKED


def track(
    scan: Scan, shape: Shape, rotation: Floats, position: Floats, settings: TrackingSettings | None = None
) -> Track:
    """Return the target's pose from a scan, near the predicted pose.

    Args:
        scan: of the target and its surroundings.
        shape: of the target.
        rotation: (3, 3), predicted.
        position: (3,) [m], predicted.
        settings: None: the usual ones.

    Raises:
        ValueError: the scan is none (`scan.checked`), or the prediction is not finite.
    """
    s = settings or TrackingSettings()
    if not (np.isfinite(rotation).all() and np.isfinite(position).all()):
        raise ValueError("rotation, position: the prediction is not finite")
    # About its own middle, whatever its origin.
    fit = _tracked(scan, shape.centred, rotation, position + rotation @ shape.centre, s)
    if not shape.centre.any():
        return fit
    place = fit.position - fit.rotation @ shape.centre
    return fit._replace(position=place, covariance=shifted(fit, place))


def _tracked(scan: Scan, shape: Shape, rotation: Floats, position: Floats, s: TrackingSettings) -> Track:
    """Return the pose of a target whose shape is about its origin."""
    part = checked(scan).around(position, (1 + s.reach) * shape.radius_m)
    returns = part.returns
    number = len(returns.point)
    if number < s.fewest:
        return Track(rotation, position, np.full((6, 6), np.nan), Outcome.TOO_FEW, np.nan, np.nan, number)
    edges, reach_m = part.edges(JUMP * shape.radius_m), s.reach * shape.radius_m
    first = Approach(returns, shape, rotation, position, reach_m)
    fit = first.registered(edges)
    seen = agreement(part, shape, fit.rotation, fit.position)
    walked = float(rot.angle_between(fit.rotation, rotation)) > s.walk_sure_rad
    if not seen.overlap >= (s.overlap_certain if walked else s.overlap_sure):
        # Perhaps a neighbouring minimum, or edges that are matched with others: whatever explains the rays best wins.
        near = search(part, shape, AROUND @ rotation)
        approaches = [first]
        for start in zip(near.rotation[:TRIED], near.position[:TRIED], strict=True):
            # From where one has come to, another leads nowhere else.
            if not any(_same(start, each.pose, shape) for each in approaches):
                approaches.append(Approach(returns, shape, *start, reach_m))
        for approach, known in _elsewhere(part, shape, approaches, edges, fit, seen.cost):
            other = approach.registered(known)
            agrees = agreement(part, shape, other.rotation, other.position)
            # Where only false edges determined the pose, that it is not determined is the better answer. The ranges
            # alone always fit a little better without edges, which is no reason to do without.
            enough = CLEARLY * seen.cost if other.degenerate else seen.cost - (0.0 if known else BETTER)
            if agrees.cost < enough:
                fit, seen = other, agrees
    if not seen.overlap >= s.overlap_profile:
        # Perhaps edges, matched with others, have moved it where ranges say nothing; all rays together do.
        better = profiled(part, shape, fit.rotation, fit.position)
        if better is not None and better.cost < HALF * seen.cost and _apart(better, fit, shape):
            turn, place = better.rotation, better.position
            fit = fit._replace(rotation=turn, position=place, covariance=better.covariance, degenerate=better.sigma > 1)
            seen = agreement(part, shape, turn, place)
    overlap = seen.overlap
    outcome = Outcome.TRACKED
    if fit.degenerate:
        outcome = Outcome.UNDETERMINED
    elif fit.residual_m > s.residual_most * np.hypot(scan.noise_m, scan.jitter_rad * np.linalg.norm(fit.position)):
        outcome = Outcome.RESIDUAL
    elif not overlap >= s.overlap_least:
        outcome = Outcome.OVERLAP
    elif float(rot.angle_between(fit.rotation, rotation)) > s.walk_most_rad:
        outcome = Outcome.WALKED_AWAY
    return Track(fit.rotation, fit.position, fit.covariance, outcome, fit.residual_m, overlap, number)


def _elsewhere(
    scan: Scan, shape: Shape, approaches: list[Approach], edges: Edges, fit: Registration, cost: float
) -> list[tuple[Approach, Edges | None]]:
    """Return approaches near the prediction that may explain the rays better than a registration does, each with the
    edges to be used: those that, roughly registered with edges or without, come to a pose of their own.
    """
    out: list[tuple[Approach, Edges | None]] = []
    for known in (edges, None):
        met = [(fit.rotation, fit.position)] if known else []
        for approach in approaches:
            other = approach.registered(known, rough=True)
            pose = other.rotation, other.position
            if any(_same(pose, each, shape) for each in met):
                continue
            met.append(pose)
            if agreement(scan, shape, *pose).cost < HOPEFUL * cost:
                out.append((approach, known))
    return out


def _same(one: Pose, other: Pose, shape: Shape) -> bool:
    """Return whether two poses are nearer to each other than rough registrations of one minimum are."""
    turned = float(rot.angle_between(one[0], other[0]))
    return turned < SAME and float(np.linalg.norm(one[1] - other[1])) < SAME * shape.radius_m


def _apart(better: Profiled, fit: Registration, shape: Shape) -> bool:
    """Return whether two poses are further apart than the choice of edges at one place makes them."""
    turned = float(rot.angle_between(better.rotation, fit.rotation))
    return turned > APART_RAD or float(np.linalg.norm(better.position - fit.position)) > APART_RAD * shape.radius_m


def chain(scan: Scan, previous: Scan, rotation: Floats, position: Floats) -> tuple[Floats, Floats]:
    """Track as the paper does: return the pose (3, 3), (3,) of a scan from that of the previous one.

    Principal components where they help, then point-to-plane registration of scan with scan.

    Args:
        scan: of the target alone.
        previous: likewise.
        rotation: (3, 3), pose of the previous scan.
        position: (3,) [m], likewise.

    Raises:
        ValueError: a scan has fewer than 12 returns.
    """
    point, before = checked_points(scan.point, 12), checked_points(previous.point, 12)
    tree = cKDTree(before)
    spread = np.linalg.norm(np.ptp(before, axis=0))
    # Neighbours on one line alone would not make a plane.
    normal = _normals(before, tree, 1.5 * scan.spacing_rad * float(np.median(np.linalg.norm(before, axis=1))))
    coarse = align_principal(before, point, np.eye(3))
    turn, shift = np.eye(3), point.mean(axis=0) - before.mean(axis=0)
    if coarse.determined and _gap(point, tree, coarse.rotation, coarse.translation) < _gap(point, tree, turn, shift):
        turn, shift = coarse.rotation, coarse.translation
    width = 0.1 * float(spread)
    for _ in range(40):
        back = (point - shift) @ turn
        distance, index = tree.query(back, distance_upper_bound=width)
        found = np.isfinite(distance)
        m, n = before[np.where(found, index, 0)], normal[np.where(found, index, 0)]
        error = np.sum(n * (back - m), axis=1)
        scale = max(3 * scan.noise_m, 0.3 * width)
        weight = np.where(found & (np.abs(error) < scale), (1 - (error / scale) ** 2) ** 2, 0.0)
        turned, across = m @ turn.T, n @ turn.T
        jacobian = np.concatenate([np.cross(turned, across), across], axis=1)
        a = jacobian.T @ (weight[:, None] * jacobian)
        # What does not overlap well enough to be determined stays as it is.
        step = np.linalg.solve(a + 1e-6 * np.trace(a) * np.eye(6), jacobian.T @ (weight * error))
        turn, shift = rot.exp(step[:3]) @ turn, shift + step[3:]
        if np.linalg.norm(step) < 1e-5:
            break
        width = max(0.8 * width, 0.02 * float(spread))
    return turn @ rotation, turn @ position + shift


def _gap(point: Floats, tree: cKDTree, rotation: Floats, translation: Floats) -> float:
    return float(np.median(tree.query((point - translation) @ rotation)[0]))


def _normals(point: Floats, tree: cKDTree, radius_m: float) -> Floats:
    """Return normals (n, 3), towards the scanner, by principal components of the neighbours within `radius_m`."""
    out = np.empty_like(point)
    for i, members in enumerate(tree.query_ball_point(point, radius_m)):
        near = point[members] - point[members].mean(axis=0)
        out[i] = np.linalg.eigh(near.T @ near)[1][:, 0]
    turned: Floats = np.where(np.sum(out * point, axis=1, keepdims=True) > 0, -out, out)
    return turned
