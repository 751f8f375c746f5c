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
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import Packed, Rows, row_into
from estimators.lighthouse.sweep import HALF_PI
from estimators.pivot import PIVOT
from estimators.state import STATES, State

SWEEPS = 1 << 20
"""More sweeps of one fan than there are in a period."""


class RowBatch(NamedTuple):
    """Rows of C craft, those of craft c at first[c] to first[c + 1] - 1, in order of station, fan and sweep.

    first: (C + 1,). station, fan, photodiode: (N,), indices; fan within its station. sweep: (N,), tells the sweeps of
    one station's fan apart, each with a draw of the rotor's error. offset_s: (N,) [s], the instant minus the epoch.
    angle: (N,) [rad], from boresight.
    """

    first: Ints
    station: Ints
    fan: Ints
    photodiode: Ints
    sweep: Ints
    offset_s: Floats
    angle: Floats

    @property
    def most(self) -> int:
        """The largest number of rows of one craft."""
        return int((self.first[1:] - self.first[:-1]).max(initial=0))

    def of(self, craft: int, kept: Bools | None = None) -> Rows:
        """Return the rows of one craft; only those of a mask (N,), if one is given."""
        own = slice(self.first[craft], self.first[craft + 1])
        rows = Rows._make(part[own] for part in self[1:])
        return rows if kept is None else Rows._make(part[kept[own]] for part in rows)

    def where(self, kept: Bools) -> "RowBatch":
        """Return the rows of a mask (N,) only."""
        before = np.concatenate([[0], np.cumsum(kept)])
        return RowBatch._make((before[self.first], *(part[kept] for part in self[1:])))


def gathered(craft: Ints, rows: Rows, craft_count: int) -> RowBatch:
    """Return loose rows, in any order, as a batch.

    Args:
        craft: (N,), the craft of each row.
        rows: (N,).
        craft_count: number of craft C.
    """
    order = np.lexsort((rows.sweep, rows.fan, rows.station, craft))
    first = np.searchsorted(craft[order], np.arange(craft_count + 1)).astype(np.int64)
    return RowBatch._make((first, *(np.ascontiguousarray(part[order]) for part in rows)))


def of_one(rows: Rows) -> RowBatch:
    """Return the rows of one craft as a batch of one."""
    return gathered(np.zeros(len(rows.angle), dtype=np.int64), rows, 1)


class Innovations(NamedTuple):
    """Innovations of C craft with independent noise of variance one: y (C, m), h (C, m, 12), of which each craft has
    the first `number` (C,). pivot: (C, PIVOT), of `estimators.pivot`, in the centre of the photodiodes concerned.
    """

    y: Floats
    h: Floats
    number: Ints
    pivot: Floats


def rows_of_sweeps(theta: Floats, offset_s: Floats, mask: Bools | None = None) -> RowBatch:
    """Return the rows of one station's sweeps.

    Args:
        theta: (C, K, F) [rad], sweep angles since each fan's zero position; those that are finite become rows.
        offset_s: (C, K, F) [s], instants of the angles minus the epoch.
        mask: (C,), the craft concerned; None: all.
    """
    mask = np.ones(len(theta), dtype=np.bool_) if mask is None else mask
    first = np.empty(len(theta) + 1, dtype=np.int64)
    total = _count_into(theta, mask, first)
    out = RowBatch(first, *np.zeros((4, total), dtype=np.int64), *np.empty((2, total)))
    _gather(theta, offset_s, mask, out)
    return out


@kernel
def _count_into(theta: Floats, mask: Bools, first: Ints) -> int:
    """Write before which row those of each of C craft begin, and where the last ones end; return this number."""
    n = 0
    for c in range(len(mask)):
        first[c] = n
        if mask[c]:
            for k in range(theta.shape[1]):
                for fan in range(theta.shape[2]):
                    n += np.isfinite(theta[c, k, fan])
    first[len(mask)] = n
    return n


@kernel
def _gather(theta: Floats, offset: Floats, mask: Bools, out: RowBatch) -> None:
    """Write the rows, fan by fan, behind `out.first`."""
    n = 0
    for c in range(len(mask)):
        if mask[c]:
            for fan in range(theta.shape[2]):
                for k in range(theta.shape[1]):
                    if np.isfinite(theta[c, k, fan]):
                        out.fan[n], out.photodiode[n] = fan, k
                        out.offset_s[n], out.angle[n] = offset[c, k, fan], theta[c, k, fan] - HALF_PI
                        n += 1


class StationArrays(NamedTuple):
    """S stations with F fans in all, as kernels take them: rotation (S, 3, 3), position (S, 3) [m], first (S,): place
    of each one's first fan in fans (F, FAN); own, shared (S,): noise [rad].
    """

    rotation: Floats
    position: Floats
    first: Ints
    fans: Floats
    own: Floats
    shared: Floats


def light_of(stations: Packed, noise: Sequence[AngleNoise]) -> StationArrays:
    """Return stations and the noise of their rows as kernels take them.

    Raises ValueError where there is not one noise per station.
    """
    if len(noise) != len(stations.first):
        raise ValueError(f"noise: {len(noise)} for {len(stations.first)} stations")
    both = np.array(noise, dtype=np.float64).reshape(-1, 2)
    own, shared = (np.ascontiguousarray(both[:, i]) for i in (0, 1))
    return StationArrays(stations.rotation, stations.position, stations.first, stations.fans, own, shared)


def innovations(
    rows: RowBatch,
    kept: Bools,
    mask: Bools,
    light: StationArrays,
    point_m: Floats,
    state: State,
    out: Innovations | None = None,
) -> Innovations:
    """Return the innovations of the craft of the mask, from their predicted states.

    Args:
        rows: rows of the C craft.
        kept: (N,), the rows that are used; becomes False where the prediction has a photodiode not in front of its
            station, so that its row is left out as well.
        mask: (C,), the craft concerned.
        light: stations that the rows name, with the noise of their rows.
        point_m: (C, K, 3) [m], photodiodes in the body frames.
        state: predicted states.
        out: innovations of the same rows, in which those of the craft of the mask are put; None: new ones.
    """
    if out is None:
        craft, most = len(mask), rows.most
        out = Innovations(
            np.empty((craft, most)),
            np.empty((craft, most, STATES)),
            np.zeros(craft, dtype=np.int64),
            np.zeros((craft, PIVOT)),
        )
    _innovations_into(mask, rows, kept, light, np.ascontiguousarray(point_m), state, out)
    return out


@kernel
def _whiten(y: Floats, h: Floats, group: Ints, n: int, source: Ints, light: StationArrays) -> None:
    """Multiply y (m,) and H (m, 12) by W, in place.

    Args:
        y: (m,), of which n are used.
        h: (m, 12).
        group: (m,), tells the sweeps of the rows apart.
        n: number of rows.
        source: (m,), station of each row.
        light: stations with their noise.
    """
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
        own, shared = light.own[source[begin]], light.shared[source[begin]]
        share = (1 - own / np.sqrt(own * own + size * shared * shared)) / size
        over = 1 / own
        for k in range(begin, end):
            y[k] = (y[k] - share * mean) * over
            for i in range(STATES):
                h[k, i] = (h[k, i] - share * total[i]) * over
        begin = end


@kernel
def whitened_into(
    c: int,
    rows: RowBatch,
    kept: Bools,
    light: StationArrays,
    point: Floats,
    state: State,
    out: Innovations,
    work: Ints,
    drop: bool,
) -> tuple[float, bool]:
    """Write the innovations of one craft's kept rows, whitened; return the sum of squares before that [rad^2], and
    whether every photodiode is in front of its station.

    Args:
        c: the craft.
        rows: rows of C craft.
        kept: (N,), the rows that are used.
        light: stations with their noise.
        point: (C, K, 3) [m].
        state: of C craft.
        out: receives y, h, number and pivot of the craft.
        work: (2, m), workspace.
        drop: take rows of photodiodes that are not in front of their station off `kept`.
    """
    n = 0
    square, front = 0.0, True
    out.pivot[c] = 0.0
    for r in range(rows.first[c], rows.first[c + 1]):
        if not kept[r]:
            continue
        s = rows.station[r]
        fan = light.first[s] + rows.fan[r]
        residual = row_into(
            rows.offset_s[r],
            rows.angle[r],
            light.rotation[s],
            light.position[s],
            light.fans[fan],
            point[c, rows.photodiode[r]],
            state.rotation[c],
            state.position[c],
            state.velocity[c],
            state.angular_rate[c],
            out.h[c, n],
        )
        if np.isnan(residual):
            front = False
            if drop:
                kept[r] = False
        else:
            out.y[c, n], work[0, n], work[1, n] = residual, fan * SWEEPS + rows.sweep[r], s
            square += residual * residual
            for i in range(3):
                out.pivot[c, i] += point[c, rows.photodiode[r], i]
            n += 1
    out.number[c] = n
    for i in range(3):
        out.pivot[c, i] /= max(n, 1)
    _line_into(c, rows, kept, light, point[c], out.pivot[c])
    _whiten(out.y[c], out.h[c], work[0], n, work[1], light)
    return square, front


@kernel
def _line_into(c: int, rows: RowBatch, kept: Bools, light: StationArrays, point: Floats, pivot: Floats) -> None:
    """Write the line between two photodiodes, if all kept rows of a craft are of these and of one station.

    Args:
        c: the craft.
        rows: rows of C craft.
        kept: (N,), the rows that are used.
        light: stations.
        point: (K, 3) [m], photodiodes of the craft.
        pivot: (PIVOT,), receives it with the station's place; its line is zero before.
    """
    first, second, station = -1, -1, -1
    for r in range(rows.first[c], rows.first[c + 1]):
        if not kept[r]:
            continue
        k = rows.photodiode[r]
        if first < 0:
            first, station = k, rows.station[r]
        elif k != first and second < 0:
            second = k
        if rows.station[r] != station or (k != first and k != second):
            return
    if second >= 0:
        for i in range(3):
            pivot[3 + i] = point[second, i] - point[first, i]
            pivot[6 + i] = light.position[station, i]


@kernel
def _innovations_into(
    mask: Bools, rows: RowBatch, kept: Bools, light: StationArrays, point: Floats, state: State, out: Innovations
) -> None:
    """Write the innovations of every craft of the mask, and take the rows that have none off `kept`."""
    work = np.empty((2, out.y.shape[1]), np.int64)
    for c in range(len(mask)):
        if mask[c]:
            whitened_into(c, rows, kept, light, point, state, out, work, True)


@kernel
def sigmas_into(
    craft: Ints, rows: Rows, light: StationArrays, point: Floats, motion: tuple[State, Floats], push: float, out: Floats
) -> None:
    """Write by how many standard deviations rows are off where they are expected, NaN where nothing is.

    Args:
        craft: of every row, (N,).
        rows: N rows of any craft, with instants after the epoch of the states.
        light: stations with their noise.
        point: (C, K, 3) [m], photodiodes in the body frames.
        motion: states of C craft, NaN where not known, and their covariances (C, 12, 12).
        push: unknown acceleration since the epoch, standard deviation [m/s^2].
        out: (N,), receives them.
    """
    state, covariance = motion
    h = np.empty(STATES)
    for n in range(len(craft)):
        c, s, tau = craft[n], rows.station[n], rows.offset_s[n]
        residual = row_into(
            tau,
            rows.angle[n],
            light.rotation[s],
            light.position[s],
            light.fans[light.first[s] + rows.fan[n]],
            point[c, rows.photodiode[n]],
            state.rotation[c],
            state.position[c],
            state.velocity[c],
            state.angular_rate[c],
            h,
        )
        variance = light.own[s] ** 2 + light.shared[s] ** 2
        for i in range(STATES):
            for j in range(STATES):
                variance += h[i] * covariance[c, i, j] * h[j]
        for i in range(6, 9):
            variance += (h[i] * push * tau * tau / 2) ** 2
        out[n] = abs(residual) / np.sqrt(variance)


def noise_of(rows: Rows, noise: Sequence[AngleNoise]) -> Floats:
    """Return R (n, n) [rad^2] of the rows of one craft; `noise` of each station."""
    same = (rows.station[:, None] == rows.station) & (rows.fan[:, None] == rows.fan)
    same &= rows.sweep[:, None] == rows.sweep
    own, shared = (np.array(part)[rows.station] for part in zip(*noise, strict=True))
    out: Floats = own**2 * np.eye(len(same)) + shared**2 * same
    return out
