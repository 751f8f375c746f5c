"""Truth from another system, aligned in time and in space with what was estimated from light.

Cameras have their own clock, frame and marker. With an estimate (R_i, p_i) of the body at t_i and the truth m(t),

    R_a p_i + R_a R_i l + t_a = m(t'_i),      t' = a + (1 + b) t

R_a, t_a is one rigid transformation, l the marker's place on the body, estimated where attitudes are known, b the
difference of the clocks' rates, estimated where the recording is long.

1. Clocks: marks that both saw, the first and the last, tell a and b. Without marks a is searched: distances between
   places do not depend on frames, so the shift is best at which those of the estimate are those of the truth.
2. Space: of rigid transformations through a few samples the one that most samples agree with (RANSAC), closed form.
3. All together by least squares with Cauchy's loss (`scipy.optimize.least_squares`), a within `REACH_S` of step 1.

An object that keeps to its place tells neither clocks nor turn: that is a `SwarmError`.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from swarm.errors import SwarmError
from swarm.flight.recordings.trajectory import Trajectory

REACH_S = 0.1
"""Largest error of marks, and of the shift that is searched [s]."""
RATE_REACH = 0.02
"""Largest difference between two clocks' rates: a Crazyflie's logger is 1.1 % slow."""
GAP_STEPS = 4.0
"""Steps of the truth beyond which it has a gap, in which it is not interpolated."""
LEAST_SPREAD_M = 0.05
"""Places of an object closer than this are one."""
FEWEST = 8
"""Samples that an alignment needs."""
MOST = 800
"""Samples that are used for it: more say no more."""
LEVER_SIGMA_M = 0.1
"""Prior standard deviation of a marker's place on the body along each axis [m]: one attitude alone leaves it open."""
SCALE_M = 0.005
"""Residual of half weight [m]: a good alignment of a real flight leaves 6 mm."""
FAR_M = 0.15
"""Largest residual of a sample that agrees with a rigid transformation in RANSAC [m]."""
LEAST_OVERLAP = 0.3
"""Least overlap of a shift, relative to the largest of all shifts."""
SAME_M = 1e-3
"""Difference of two median distances that says nothing about which shift is better [m]."""
_LONG_S = 10.0
_SEARCH_STEP_S = 0.08
_MOST_SHIFTS = 6000
_TRIALS = 200
_PAIRS = 300


class Clock(NamedTuple):
    """Time of the truth, offset_s + rate t, of a time t of the recording."""

    offset_s: float
    rate: float

    def of(self, time_s: Floats) -> Floats:
        """Return times of the truth [s]."""
        out: Floats = self.offset_s + self.rate * np.asarray(time_s)
        return out


class Alignment(NamedTuple):
    """An alignment. clock: of the truth. rotation (3, 3), translation (3,) [m]: R_a, t_a, into the truth's frame.
    lever: l (3,) [m], None if it was not estimated. samples: number of estimates that the truth has, residual_m: their
    distances from it (N,). how: of the clocks, in words.
    """

    clock: Clock
    rotation: Floats
    translation: Floats
    lever: Floats | None
    samples: int
    residual_m: Floats
    how: str

    def sentences(self) -> list[str]:
        """Return the alignment in words."""
        rate = (self.clock.rate - 1) * 1e6
        middle, most, largest = (1e3 * float(np.quantile(self.residual_m, q)) for q in (0.5, 0.9, 1.0))
        out = [
            f"the truth's clock is the recording's {self.clock.offset_s:+.4f} s, {rate:+.0f} ppm ({self.how})",
            f"{self.samples} estimates beside the truth: distance {middle:.1f} mm median, {most:.1f} mm for 90 %, "
            f"{largest:.0f} mm at most, after one rigid transformation",
        ]
        if self.lever is not None:
            place = ", ".join(f"{1e3 * x:+.1f}" for x in self.lever)
            out.append(f"the marker sits at ({place}) mm in the body's axes")
        return out

    def summary(self) -> dict[str, object]:
        """Return the alignment for summary.json."""
        return {
            "clock_offset_s": self.clock.offset_s,
            "clock_rate_ppm": (self.clock.rate - 1) * 1e6,
            "clock_from": self.how,
            "rotation_wxyz": rot.quaternion_from_matrix(self.rotation[None])[0].tolist(),
            "translation_m": self.translation.tolist(),
            "marker_m": None if self.lever is None else self.lever.tolist(),
            "samples": self.samples,
            "median_mm": 1e3 * float(np.median(self.residual_m)),
        }


def interpolated(truth: Trajectory, time_s: Floats) -> Floats:
    """Return the truth's positions (N, 3) [m] at times (N,) on its own clock; NaN outside and in gaps."""
    known = truth.time_s
    if len(known) < 2:
        return np.full((len(time_s), 3), np.nan)
    after = np.clip(np.searchsorted(known, time_s), 1, len(known) - 1)
    step = known[after] - known[after - 1]
    good = (time_s >= known[0]) & (time_s <= known[-1]) & (step < GAP_STEPS * float(np.median(np.diff(known))))
    out = np.stack([np.interp(time_s, known, column) for column in truth.position.T], axis=1)
    out[~good] = np.nan
    return out


def rigid(points: Floats, places: Floats) -> tuple[Floats, Floats]:
    """Return the rotation (3, 3) and translation (3,) [m] that bring points nearest to places, (N, 3) each (Kabsch)."""
    mean, middle = points.mean(axis=0), places.mean(axis=0)
    u, _, vt = np.linalg.svd((places - middle).T @ (points - mean))
    turn: Floats = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return turn, middle - turn @ mean


def clock_of_marks(marks_s: Floats, truth: Trajectory) -> Clock | None:
    """Return the clock that two marks or more tell, which the cameras saw as their first and last instant.

    None where they do not fit: the truth would run faster or slower than any clock.
    """
    if len(marks_s) < 2 or len(truth.time_s) < 2 or not marks_s[-1] > marks_s[0]:
        return None
    rate = float((truth.time_s[-1] - truth.time_s[0]) / (marks_s[-1] - marks_s[0]))
    # A mark is good to a few milliseconds.
    if abs(rate - 1) > RATE_REACH + 2 * REACH_S / float(marks_s[-1] - marks_s[0]):
        return None
    return Clock(float(truth.time_s[0] - rate * marks_s[0]), rate)


def align(
    time_s: Floats, position: Floats, rotation: Floats | None, truth: Trajectory, marks_s: Floats | None = None
) -> Alignment:
    """Return the alignment of a truth with an estimated trajectory.

    Args:
        time_s: of the estimates, (N,) [s], growing.
        position: (N, 3) [m].
        rotation: (N, 3, 3) R_w_b, None where attitudes are not known.
        truth: the truth.
        marks_s: times of the recording that the cameras saw as the truth's first and last instant, if there are any.

    Raises:
        SwarmError: estimate and truth do not overlap, or do not fit, or the object keeps to one place.
    """
    good = np.isfinite(position).all(axis=1)
    rows = np.flatnonzero(good)
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), MOST)).astype(np.int64)] if len(rows) else rows
    t, p = time_s[rows], position[rows]
    r = None if rotation is None else rotation[rows]
    if len(t) < FEWEST:
        raise SwarmError(f"{truth.path}: only {len(t)} estimates to align the truth with, and {FEWEST} are needed")
    if np.linalg.norm(np.ptp(p, axis=0)) < LEAST_SPREAD_M:
        raise SwarmError(
            f"{truth.path}: the object moves by {1e3 * np.linalg.norm(np.ptp(p, axis=0)):.0f} mm, too little to tell "
            f"how the truth's frame is turned; {1e3 * LEAST_SPREAD_M:.0f} mm are needed"
        )
    clock = None if marks_s is None else clock_of_marks(marks_s, truth)
    how = "marks that the cameras saw, then the motion"
    if clock is None:
        clock, how = _searched(t, p, truth), "the motion"
    places = interpolated(truth, clock.of(t))
    seen = np.isfinite(places).all(axis=1)
    if np.count_nonzero(seen) < FEWEST:
        raise SwarmError(
            f"{truth.path}: the truth has only {np.count_nonzero(seen)} of {len(t)} estimated instants, and {FEWEST} "
            "are needed"
        )
    start = agreed(p[seen], places[seen])
    free_rate = bool(np.ptp(t) > _LONG_S)
    return _refined(t, p, r, truth, clock, start, how, free_rate=free_rate)


def _searched(t: Floats, p: Floats, truth: Trajectory) -> Clock:
    """Return the shift at which distances between places agree best."""
    low, high = float(truth.time_s[0] - t[-1]), float(truth.time_s[-1] - t[0])
    count = int(min((high - low) / _SEARCH_STEP_S + 1, _MOST_SHIFTS))
    # Pairs that are near in time, so that a short truth has many of them, too.
    rng = np.random.default_rng(1)
    reach = min(np.ptp(t), np.ptp(truth.time_s)) / 2
    one = rng.integers(0, len(t), _PAIRS)
    other = np.searchsorted(t, t[one] + rng.uniform(0.1, 1.0, _PAIRS) * reach)
    inside = other < len(t)
    one, other = one[inside], other[inside]
    apart = np.linalg.norm(p[one] - p[other], axis=1)
    shifts, score, overlap = np.linspace(low, high, count), np.full(count, np.inf), np.zeros(count)
    for i, shift in enumerate(shifts.tolist()):
        away = np.linalg.norm(interpolated(truth, t[one] + shift) - interpolated(truth, t[other] + shift), axis=1)
        both = np.isfinite(away)
        overlap[i] = np.count_nonzero(both)
        if overlap[i] >= FEWEST:
            # A short overlap fits by chance: it must be the better for it.
            score[i] = float(np.median(np.abs(away[both] - apart[both]))) / np.sqrt(overlap[i])
    score[overlap < LEAST_OVERLAP * overlap.max()] = np.inf
    if not np.isfinite(score).any():
        raise SwarmError(
            f"{truth.path}: the truth, {truth.time_s[-1] - truth.time_s[0]:.1f} s long, overlaps nowhere with the "
            f"estimate, {t[-1] - t[0]:.1f} s long"
        )
    # Of an object that rests now and then, many neighbouring shifts are as good: the middle one.
    good = score < 1.5 * float(score.min()) + SAME_M / np.sqrt(np.maximum(overlap, 1.0))
    first = last = int(np.argmax(np.where(good, overlap, -1.0)))
    good &= overlap > 0.9 * overlap[first]
    while first > 0 and good[first - 1]:
        first -= 1
    while last + 1 < count and good[last + 1]:
        last += 1
    return Clock(float(shifts[first] + shifts[last]) / 2, 1.0)


def agreed(points: Floats, places: Floats) -> tuple[Floats, Floats]:
    """Return the rigid transformation, rotation (3, 3) and translation (3,) [m], that most samples agree with.

    Args:
        points: (N, 3) [m], three or more that are not on a line.
        places: (N, 3) [m], where they are to be brought.
    """
    rng = np.random.default_rng(1)
    most, best = -1, (np.eye(3), np.zeros(3))
    for _ in range(_TRIALS):
        rows = rng.choice(len(points), min(4, len(points)), replace=False)
        trial = rigid(points[rows], places[rows])
        near = int(np.count_nonzero(_apart(points, places, trial) < FAR_M))
        if near > most:
            most, best = near, trial
    for _ in range(3):
        near_ = _apart(points, places, best) < FAR_M
        if np.count_nonzero(near_) < 3:
            break
        best = rigid(points[near_], places[near_])
    return best


def _apart(points: Floats, places: Floats, transformation: tuple[Floats, Floats]) -> Floats:
    turn, shift = transformation
    out: Floats = np.linalg.norm(points @ turn.T + shift - places, axis=1)
    return out


def _refined(
    t: Floats,
    p: Floats,
    r: Floats | None,
    truth: Trajectory,
    clock: Clock,
    start: tuple[Floats, Floats],
    how: str,
    *,
    free_rate: bool,
) -> Alignment:
    """Return the least-squares alignment from a start.

    Args:
        t: times (N,) [s].
        p: positions (N, 3) [m].
        r: attitudes (N, 3, 3), None if not known.
        truth: the truth.
        clock: its start.
        start: rotation and translation to start from.
        how: where the clock comes from.
        free_rate: whether the clocks' rates are compared, too.
    """
    middle = float(t.mean())
    spread = float(np.ptp(t)) / 2

    def parts(x: Floats) -> tuple[Floats, Floats, Floats, Clock]:
        # The rate turns about the middle of the samples, in seconds at their ends.
        rate = clock.rate + (x[7] / spread if free_rate else 0.0)
        shifted = Clock(float(clock.of(np.array(middle))) + x[6] - rate * middle, rate)
        return rot.exp(x[:3]) @ start[0], x[3:6], x[8:11], shifted

    def residual(x: Floats) -> Floats:
        turn, shift, lever, moved = parts(x)
        body = p if r is None else p + r @ lever
        away = body @ turn.T + shift - interpolated(truth, moved.of(t))
        out: Floats = np.where(np.isfinite(away), away, 0.0).ravel()
        prior = lever / LEVER_SIGMA_M * SCALE_M if r is not None else np.zeros(0)
        return np.concatenate([out, prior])

    limit = np.full(11, np.inf)
    limit[6:8] = REACH_S
    limit[8:11] = np.inf if r is not None else 1e-12
    x0 = np.concatenate([np.zeros(3), start[1], np.zeros(5)])
    scale = np.concatenate([np.full(3, 0.1), np.full(3, 0.1), np.full(2, 0.01), np.full(3, 0.01)])
    found = least_squares(
        residual, x0, bounds=(-limit, limit), loss="cauchy", f_scale=SCALE_M, x_scale=scale, max_nfev=50
    )
    turn, shift, lever, moved = parts(found.x)
    body = p if r is None else p + r @ lever
    away = np.linalg.norm(body @ turn.T + shift - interpolated(truth, moved.of(t)), axis=1)
    kept = away[np.isfinite(away)]
    middle_m = float(np.median(kept)) if len(kept) >= FEWEST else np.inf
    if middle_m > FAR_M:
        raise SwarmError(
            f"{truth.path}: the truth does not fit the estimate: their median distance is {1e3 * middle_m:.0f} mm "
            f"at best, more than {1e3 * FAR_M:.0f} mm"
        )
    return Alignment(moved, turn, shift, lever if r is not None else None, len(kept), kept, how)


def brought(alignment: Alignment, places: Floats) -> Floats:
    """Return places of the truth's frame (N, 3) [m] in the estimate's frame."""
    out: Floats = (places - alignment.translation) @ alignment.rotation
    return out


def true_positions(
    alignment: Alignment, truth: Trajectory, time_s: Floats, rotation: Floats | None
) -> tuple[Floats, Bools]:
    """Return the body's true positions in the estimate's frame (N, 3) [m], and whether there is truth (N,).

    The marker's place is taken off with the estimated attitude: 1 degree moves a marker that is 30 mm off by 0.5 mm.

    Args:
        alignment: of the truth.
        truth: the truth.
        time_s: instants of the recording (N,) [s].
        rotation: estimated R_w_b (N, 3, 3), needed where the alignment has a lever.
    """
    places = brought(alignment, interpolated(truth, alignment.clock.of(time_s)))
    if alignment.lever is not None and rotation is not None:
        places = places - rotation @ alignment.lever
    return places, np.asarray(np.isfinite(places).all(axis=1), dtype=np.bool_)
