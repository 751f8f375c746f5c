"""Innovations of one period's rows of C craft, as a filter takes them in: whitened.

The rows of one fan in one sweep share the rotor's error (19): R = a^2 I + b^2 1 1^T, one draw per fan and sweep and
white in time, which is marginalised exactly, without a state. With n rows, the root of R^-1 is

    W = (I - c 1 1^T) / a,   c = (1 - a / sqrt(a^2 + n b^2)) / n,   W R W = I

so that W y = W H x + noise with unit variances, and W H, W y give the sums of Sherman and Morrison,

    H^T R^-1 H = [H^T H - k (H^T 1)(H^T 1)^T] / a^2,   k = b^2 / (a^2 + n b^2),   likewise H^T R^-1 y

The rows are linearised at the prediction, once: linearised again at the state that they lead to (the iterated filter)
they are no better where four or more photodiodes are lit, and bias the distance where one or two are, which leave the
attitude open. What makes few rows right is the correction about their photodiodes' centre (`estimators.pivot`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.integrity import AngleNoise, dropped_sets
from estimators.lighthouse.rows import Packed, Rows, linearise, row_into
from estimators.lighthouse.sweep import HALF_PI
from estimators.state import STATES, State

FORGOTTEN = 100.0
"""Factor of the covariance of a filter that follows a false photodiode for long: its own state counts a tenth."""
OVERSHOOT = 1.25
"""By how much a filter that has rates in its state exceeds a step that it follows: 21 % with the damping of a Kalman
filter of constant velocity, 1 / sqrt(2)."""


class RowBatch(NamedTuple):
    """Rows of C craft, those of craft c at first[c] to first[c + 1] - 1, in order of station and fan.

    first: (C + 1,). station, fan, photodiode: (N,), indices; fan within its station. offset_s: (N,) [s], the instant
    minus the epoch. angle: (N,) [rad], from boresight.
    """

    first: Ints
    station: Ints
    fan: Ints
    photodiode: Ints
    offset_s: Floats
    angle: Floats

    def of(self, craft: int) -> Rows:
        """Return the rows of one craft."""
        own = slice(self.first[craft], self.first[craft + 1])
        return Rows(self.station[own], self.fan[own], self.photodiode[own], self.offset_s[own], self.angle[own])


class Innovations(NamedTuple):
    """Innovations of C craft with independent noise of variance one: y (C, m), h (C, m, 12), of which each craft has
    the first `number` (C,). pivot: (C, 3) [m], the centre of the photodiodes that they come from, body frame.
    """

    y: Floats
    h: Floats
    number: Ints
    pivot: Floats


def rows_of_sweeps(theta: Floats, offset_s: Floats, used: Bools) -> RowBatch:
    """Return the rows of one station's sweeps.

    Args:
        theta: (C, K, F) [rad], sweep angles since each fan's zero position.
        offset_s: (C, K, F) [s], instants of the angles minus the epoch.
        used: (C, K, F), the angles that become rows.
    """
    count = np.count_nonzero(used.reshape(len(used), -1), axis=1)
    first = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    total = int(first[-1])
    out = RowBatch(first, *np.zeros((3, total), dtype=np.int64), *np.empty((2, total)))
    _gather(theta, offset_s, used, out)
    return out


@kernel
def _gather(theta: Floats, offset: Floats, used: Bools, out: RowBatch) -> None:
    """Write the rows, fan by fan, behind `out.first`."""
    craft, photodiodes, fans = used.shape
    n = 0
    for c in range(craft):
        for fan in range(fans):
            for k in range(photodiodes):
                if used[c, k, fan]:
                    out.fan[n], out.photodiode[n] = fan, k
                    out.offset_s[n], out.angle[n] = offset[c, k, fan], theta[c, k, fan] - HALF_PI
                    n += 1


def innovations(
    rows: RowBatch,
    kept: Bools,
    mask: Bools,
    stations: Packed,
    point_m: Floats,
    state: State,
    noise: AngleNoise,
) -> Innovations:
    """Return the innovations of the craft of the mask, from their predicted states.

    Args:
        rows: rows of the C craft.
        kept: (N,), the rows that are used; becomes False where the prediction has a photodiode not in front of its
            station, so that its row is left out as well.
        mask: (C,), the craft concerned.
        stations: stations that the rows name.
        point_m: (C, K, 3) [m], photodiodes in the body frames.
        state: predicted states.
        noise: noise of the rows.
    """
    craft = len(mask)
    most = int(np.diff(rows.first).max(initial=0))
    out = Innovations(
        np.empty((craft, most)), np.empty((craft, most, STATES)), np.zeros(craft, dtype=np.int64), np.zeros((craft, 3))
    )
    _innovations_into(
        mask,
        rows,
        stations.first[rows.station] + rows.fan,
        kept,
        stations.rotation,
        stations.position,
        stations.fans,
        np.ascontiguousarray(point_m),
        state,
        noise.own_rad,
        noise.shared_rad,
        out,
    )
    return out


@kernel
def _whiten(y: Floats, h: Floats, group: Ints, n: int, own: float, shared: float) -> None:
    """Multiply y (m,) and H (m, 12) by W, in place; `group` (m,) tells the fans of the n rows apart."""
    begin = 0
    total = np.empty(STATES)
    while begin < n:
        end = begin
        mean, total[:] = 0.0, 0.0
        while end < n and group[end] == group[begin]:
            mean += y[end]
            for i in range(STATES):
                total[i] += h[end, i]
            end += 1
        size = end - begin
        share = (1 - own / np.sqrt(own * own + size * shared * shared)) / size
        over = 1 / own
        for k in range(begin, end):
            y[k] = (y[k] - share * mean) * over
            for i in range(STATES):
                h[k, i] = (h[k, i] - share * total[i]) * over
        begin = end


@kernel
def _innovations_into(
    mask: Bools,
    rows: RowBatch,
    fan: Ints,
    kept: Bools,
    station_rotation: Floats,
    station_position: Floats,
    fans: Floats,
    point: Floats,
    state: State,
    own: float,
    shared: float,
    out: Innovations,
) -> None:
    """Write the innovations of every craft of the mask, and take the rows that have none off `kept`."""
    most = out.y.shape[1]
    group = np.empty(most, np.int64)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        n = 0
        for r in range(rows.first[c], rows.first[c + 1]):
            if not kept[r]:
                continue
            s = rows.station[r]
            residual = row_into(
                rows.offset_s[r],
                rows.angle[r],
                station_rotation[s],
                station_position[s],
                fans[fan[r]],
                point[c, rows.photodiode[r]],
                state.rotation[c],
                state.position[c],
                state.velocity[c],
                state.angular_rate[c],
                out.h[c, n],
            )
            if np.isnan(residual):
                kept[r] = False
                continue
            out.y[c, n], group[n] = residual, fan[r]
            for i in range(3):
                out.pivot[c, i] += point[c, rows.photodiode[r], i]
            n += 1
        out.number[c] = n
        for i in range(3):
            out.pivot[c, i] /= max(n, 1)
        _whiten(out.y[c], out.h[c], group, n, own, shared)


def fault_slopes(
    rows: Rows,
    stations: Packed,
    point_m: Floats,
    state: State,
    covariance: Floats,
    noise: AngleNoise,
    open_s: float,
) -> tuple[float, float]:
    """Return what a false photodiode among the rows of one craft does to its position [m] and attitude [rad].

    Photodiode k errs by b = (b_x, b_y). The gate sees the noncentrality b^T E^T S^-1 E b of it, with the selection E of
    its rows and S = H P H^T + R. A filter that follows the error in the end, as if it knew nothing, moves by

        o G b,   G = Q H^T (H Q H^T + R)^-1 E,   Q = `FORGOTTEN` P,   o = `OVERSHOOT`

    and the slope is the largest ratio of |o G b| to the root of the noncentrality, over b and k: with the least
    noncentrality L that the gate does not miss, the error is at most slope sqrt(L). One or two photodiodes leave turns
    and the distance open; there nothing takes back what the error has put into the rates, and their part grows with the
    time for which this has lasted.

    Args:
        rows: the rows that were taken in.
        stations: stations that they name.
        point_m: (K, 3) [m], photodiodes in the body frame.
        state: predicted state of the craft, without the craft axis.
        covariance: (12, 12), its covariance P.
        noise: noise of the rows.
        open_s: time for which the light has left a part of the pose open [s].
    """
    _, h = linearise(rows, stations, point_m, state.rotation, state.position, state.velocity, state.angular_rate)
    r = _noise_of(rows, noise)
    seen = h @ covariance @ h.T
    shown = np.linalg.inv(seen + r)
    gain = FORGOTTEN * covariance @ h.T @ np.linalg.inv(FORGOTTEN * seen + r)
    place, turn = 0.0, 0.0
    for k in np.unique(rows.photodiode):
        own = np.flatnonzero(rows.photodiode == k)
        root = np.linalg.inv(np.linalg.cholesky(shown[np.ix_(own, own)])).T
        moved = gain[:, own] @ root
        turned, rate, shifted, speed = (float(np.linalg.norm(moved[i : i + 3], 2)) for i in (0, 3, 6, 9))
        place, turn = max(place, shifted + open_s * speed), max(turn, turned + open_s * rate)
    return OVERSHOOT * place, OVERSHOOT * turn


def _noise_of(rows: Rows, noise: AngleNoise) -> Floats:
    """Return R (n, n) of the rows of one craft."""
    return noise.covariance((rows.station[:, None] == rows.station) & (rows.fan[:, None] == rows.fan))


def agreeing(
    rows: Rows,
    stations: Packed,
    point_m: Floats,
    state: State,
    covariance: Floats,
    noise: AngleNoise,
    gate: Floats,
) -> Bools | None:
    """Return the rows (n,) of one craft without those of photodiodes that must be false; None if the rest never agrees.

    The search is that for a pose (`estimators.lighthouse.integrity`), by the innovations, those that lie farthest from
    the prediction first. At least half of them remain.

    Args:
        rows: the rows that do not agree with the prediction.
        stations: stations that they name.
        point_m: (K, 3) [m], photodiodes in the body frame.
        state: predicted state of the craft, without the craft axis.
        covariance: (12, 12), its covariance.
        noise: noise of the rows.
        gate: (n + 1,), the largest normalised innovation squared of 0, 1, ... rows that is believed.
    """
    y, h = linearise(rows, stations, point_m, state.rotation, state.position, state.velocity, state.angular_rate)
    front = np.isfinite(y)
    y, h = np.where(front, y, 0.0), np.where(front[:, None], h, 0.0)
    s = h @ covariance @ h.T + _noise_of(rows, noise)
    lit = np.unique(rows.photodiode[front])

    def without(dropped: Sequence[int]) -> tuple[float, Bools]:
        kept: Bools = front & ~np.isin(rows.photodiode, dropped)
        at = np.flatnonzero(kept)
        square = float(y[at] @ np.linalg.solve(s[np.ix_(at, at)], y[at]))
        return square / float(gate[len(at)]), kept

    away = [float(np.max(np.abs(y / np.sqrt(np.diag(s)))[front & (rows.photodiode == k)])) for k in lit]
    far = lit[np.argsort(away, kind="stable")[::-1]]
    for subsets in dropped_sets(lit, far, len(lit) // 2):
        share, kept = min((without(dropped) for dropped in subsets), key=lambda found: found[0])
        if share <= 1:
            return kept
    return None
