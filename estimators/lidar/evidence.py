"""Acquisition by several scans: poses between which one scan cannot decide, followed until all rays together can.

Of a nearly symmetric shape, a handful of a scan's rays tells its attitudes apart, too few to believe them. The poses
that an ambiguous acquisition leaves are all registered in every further scan, each from where it was and from where the
best one has it, and their costs and the rays that contradict one of two are added up. The rules are those of
one scan (`estimators.lidar.acquisition.margin_by`), of the sums: chance contradicts both alike, and a part that is
seen contradicts the wrong one again and again.

Rays of scans add up as long as they are of one target that moves little in between; what registers nowhere any more
begins anew.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.lidar.acquisition import (
    Acquisition,
    AcquisitionSettings,
    Candidate,
    Verdict,
    about_origin,
    acquire_centred,
    answered,
    differ,
    finely,
    margin_by,
    refined,
)
from estimators.lidar.likeness import mistaken
from estimators.lidar.pose_search import Poses
from estimators.lidar.registration import JUMP, Registration
from estimators.lidar.scan import Scan, checked
from estimators.lidar.shape import Shape
from estimators.lidar.symmetry import symmetry

LONGEST = 50
"""Scans after which everything begins anew: the right pose may not be among those that are followed."""
SOME = 300
"""Points of a rough registration."""


class _Rival:
    """A pose, and what all scans so far say of it. cost: sum. rays, conflicts: how many say something, and against it.

    seen: in the last scan.
    """

    def __init__(self, fit: Registration) -> None:
        self.fit = fit
        self.seen: Candidate | None = None
        self.cost, self.rays, self.conflicts = 0.0, 0, 0

    def add(self, seen: Candidate) -> None:
        """Take in what a scan says."""
        self.fit, self.seen = seen.fit, seen
        self.cost += seen.cost
        self.rays += seen.rays
        self.conflicts += int(np.count_nonzero(seen.conflict))


class Evidence:
    """All that the scans of one target have said of its pose, one after the other."""

    def __init__(self, shape: Shape, settings: AcquisitionSettings | None = None) -> None:
        """Take the target's shape; settings: None, the usual ones."""
        self._shape, self._centred = shape, shape.centred
        self._settings = settings or AcquisitionSettings()
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._rivals: list[_Rival] = []
        self._against = np.zeros((0, 0), dtype=np.int64)
        self.scans = 0

    def take(self, scan: Scan, turn: Floats | None = None, shift: Floats | None = None) -> Acquisition:
        """Return the pose by a scan and all before it.

        Args:
            scan: of the target and its surroundings.
            turn: (3, 3), from the scanner's frame at the last scan to that at this one; None: it has not turned.
            shift: (3,) [m], likewise; None: it has not moved.

        Raises:
            ValueError: the scan is none (`estimators.lidar.scan.checked`).
        """
        if self._rivals:
            turned, moved = np.eye(3) if turn is None else turn, np.zeros(3) if shift is None else shift
            for rival in self._rivals:
                fit = rival.fit
                rival.fit = fit._replace(rotation=turned @ fit.rotation, position=turned @ fit.position + moved)
            found = self._compared(checked(scan))
            if found is not None:
                if found.found or self.scans >= LONGEST:
                    self.forget()
                return about_origin(found, self._shape)
        self.forget()
        found = acquire_centred(scan, self._centred, self._settings)
        if found.verdict is Verdict.AMBIGUOUS:
            self._begin(scan, found)
        return about_origin(found, self._shape)

    def _begin(self, scan: Scan, found: Acquisition) -> None:
        """Follow the rivals of an acquisition, and let its own scan count."""
        self._rivals = [_Rival(fit) for fit in found.rivals]
        self._against = np.zeros((len(self._rivals), len(self._rivals)), dtype=np.int64)
        self._compared(checked(scan))

    def _compared(self, scan: Scan) -> Acquisition | None:
        """Return the answer of all scans, with the rivals in a further one; None where none of them is any more."""
        s, shape, first = self._settings, self._centred, self._rivals[0].fit
        self.scans += 1
        apart = max(float(np.linalg.norm(r.fit.position - first.position)) for r in self._rivals)
        part = scan.around(first.position, shape.radius_m + apart)
        if len(part.point) < s.fewest:
            return None
        self._add(part)
        if not self._rivals:
            return None
        best = self._rivals[0]
        overlap = 1 - best.conflicts / best.rays
        if overlap < s.overlap_least:
            return None
        margin, second = np.inf, None
        for k, other in enumerate(self._rivals[1:], 1):
            decide = int(self._against[k, 0]), int(self._against[0, k])
            more = margin_by(best.cost, other.cost, overlap, decide, s)
            if more < margin:
                margin, second = more, other.fit
        return answered(best.fit, second, overlap, margin, s)._replace(points=len(part.point))

    def _add(self, scan: Scan) -> None:
        """Register all rivals in a scan, and add up what it says, the best first.

        Those that are not there, or have come to the pose of a better one, are given up.
        """
        s, shape, point = self._settings, self._centred, scan.point
        edges, some = scan.edges(JUMP * shape.radius_m), point[:: max(1, len(point) // SOME)]
        likely: Poses | None = None
        kept: list[int] = []
        for k, rival in enumerate(self._rivals):
            starts = [(rival.fit.rotation, rival.fit.position)]
            if likely is not None:
                near = symmetry(shape).angle_between(likely.rotation, rival.fit.rotation) < s.apart_rad
                starts += list(zip(likely.rotation[near], likely.position[near], strict=True))
            turns, places = (np.array(part) for part in zip(*starts, strict=True))
            rough = refined(scan, shape, Poses(turns, places, np.zeros(len(turns))), some, edges)
            found = min(finely(scan, shape, rough, edges, s), key=lambda c: c.cost, default=None)
            if found is None or not all(differ(found.fit, self._rivals[j].fit, s, shape) for j in kept):
                continue
            rival.add(found)
            kept.append(k)
            likely = likely or mistaken(shape, found.fit.rotation, found.fit.position)
        kept.sort(key=lambda k: self._rivals[k].cost)
        self._rivals = [self._rivals[k] for k in kept]
        self._against = self._against[np.ix_(kept, kept)]
        conflicts = np.array([r.seen.conflict for r in self._rivals if r.seen is not None])
        for row, mine in zip(self._against, conflicts, strict=True):
            row += np.count_nonzero(mine & ~conflicts, axis=1)
