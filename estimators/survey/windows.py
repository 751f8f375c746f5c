"""Windows of an object's light: stretches at rest, averaged, and short windows of motion.

The angles of one photodiode and fan of one station are a *stream*. In bins of `BIN_S` each stream has its median. Bins
belong to one stretch at rest as long as the root mean square of the streams' shifts from the stretch's mean is within
`AT_REST` of its standard deviations and the streams scatter no more within the bin than at rest: a stretch becomes one
window, a row per stream, the mean of the angles without outliers. However long it lasts it says what one look says,
with less noise: systematic errors do not average out.

What moves is cut into windows of `MOTION_S`, short enough for constant rates: a hand's 5 m/s^2 leave 0.6 mm at their
ends. At most `MOST` of those that two stations saw are taken, evenly in time.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.survey.problem import Rows

BIN_S = 0.25
MOTION_S = 0.06
"""Two periods of two Lighthouse 1.0 stations, or three turns of a Lighthouse 2.0 rotor [s]."""
LEAST_REST_S = 0.7
AT_REST = 3.0
"""Shift [standard deviations of a bin's median] up to which streams are at rest, RMS over the streams."""
FLOOR_RAD = 3e-5
"""Smallest standard deviation of a bin's median that is believed [rad]."""
SHAKE_RAD = 3e-4
"""Scatter of a stream within a bin beyond which the object moves: four times a real one's at rest [rad]."""
OUTLIER = 4.0
"""Angles farther from their stream's median [standard deviations] are no part of its mean."""
LEAST_SHARE = 0.2
"""A stream with fewer hits than this share of the fullest one's is a reflection or worse."""
MOST = 160
FEWEST_ROWS = 6
"""Rows of one station that make it count as seen in a window: three photodiodes by both fans."""
OWN_RAD = {"1.0": 6e-5, "2.0": 2e-5}
"""Noise of one hit before anything is known [rad]: real stations at rest."""


class Seen(NamedTuple):
    """N hits of one object in order of time, (N,) each: time_s, station (index), fan, photodiode, angle [rad]."""

    time_s: Floats
    station: Ints
    fan: Ints
    photodiode: Ints
    angle: Floats

    def of(self, rows: Ints | Bools) -> "Seen":
        """Return some of the hits."""
        return Seen._make(column[rows] for column in self)


class Cut(NamedTuple):
    """The windows of one object. rows: their rows, windows numbered from 0. moving (W,). begin_s, end_s (W,): of each,
    on the object's clock.
    """

    rows: Rows
    moving: Bools
    begin_s: Floats
    end_s: Floats


def cut(
    seen: Seen,
    point: Floats,
    turn_s: Floats,
    own: Floats,
    *,
    stations: int = 2,
    most: int = MOST,
    rest: bool = True,
) -> Cut:
    """Return the windows of one object's light.

    Args:
        seen: the light.
        point: (K, 3) [m], photodiodes in the object's frame.
        turn_s: duration of a turn per station [s], (S,).
        own: noise of one hit per station [rad], (S,).
        stations: number of stations that must have seen a window.
        most: moving windows at most.
        rest: whether stretches at rest are averaged.
    """
    stretches = _at_rest(seen) if rest else []
    spans = list(stretches)
    chosen = _moving(seen, stretches, stations, most)
    windows = sorted([(b, e, False) for b, e in spans] + [(b, e, True) for b, e in chosen])
    parts: list[Rows] = []
    kept: list[tuple[float, float, bool]] = []
    sweeps = 0
    for begin, end, moves in windows:
        inside = seen.of(np.arange(*np.searchsorted(seen.time_s, [begin, end])))
        rows = _single(inside, (begin + end) / 2, turn_s, own) if moves else _averaged(inside, own)
        if np.count_nonzero(np.bincount(rows.station, minlength=1) >= FEWEST_ROWS) < stations:
            continue
        parts.append(rows._replace(window=np.full(len(rows.angle), len(kept)), sweep=rows.sweep + sweeps))
        sweeps = int(parts[-1].sweep.max()) + 1
        kept.append((begin, end, moves))
    joined = join(parts)
    joined = joined._replace(point=point[joined.photodiode])
    spans_ = np.array([(b, e) for b, e, _ in kept]).reshape(-1, 2)
    return Cut(joined, np.array([m for _, _, m in kept], dtype=np.bool_), spans_[:, 0], spans_[:, 1])


def join(parts: list[Rows]) -> Rows:
    """Return several windows' rows as one."""
    empty = Rows(
        *(np.zeros(0, dtype=np.int64),) * 3, np.zeros((0, 3)), *(np.zeros(0),) * 4, *(np.zeros(0, np.int64),) * 2
    )
    return Rows(*(np.concatenate(columns) for columns in zip(*(parts or [empty]), strict=True)))


def _streams(seen: Seen) -> tuple[Ints, int]:
    """Return the number of each hit's stream, and how many there are."""
    if not len(seen.time_s):
        return np.zeros(0, dtype=np.int64), 0
    key = (seen.station * 2 + seen.fan) * (int(seen.photodiode.max()) + 1) + seen.photodiode
    names, stream = np.unique(key, return_inverse=True)
    return stream, len(names)


def _at_rest(seen: Seen) -> list[tuple[float, float]]:
    """Return the stretches in which nothing moves, (begin, end) [s]."""
    if len(seen.time_s) < 2:
        return []
    stream, count = _streams(seen)
    first = float(seen.time_s[0])
    number = np.floor((seen.time_s - first) / BIN_S).astype(np.int64)
    edges = np.flatnonzero(np.diff(number)) + 1
    out: list[tuple[float, float]] = []
    total, weight, begin, end = np.zeros(count), np.zeros(count), -1, -1

    def close() -> None:
        if end > begin >= 0 and (end - begin) * BIN_S >= LEAST_REST_S:
            out.append((first + begin * BIN_S, first + end * BIN_S))

    for hits in np.split(np.arange(len(number)), edges):
        bin_ = int(number[hits[0]])
        middle, spread, n = _medians(seen.angle[hits], stream[hits], count)
        told = n >= 2
        still = np.any(told) and float(np.median(spread[told])) < SHAKE_RAD
        if begin >= 0 and (not still or bin_ > end + int(1 / BIN_S)):
            close()
            begin = -1
        if not still:
            continue
        sigma = np.sqrt(1.57 * spread**2 / np.maximum(n, 1) + FLOOR_RAD**2)
        both = told & (weight > 0)
        if begin >= 0 and np.any(both):
            shift = (middle[both] - total[both] / weight[both]) / sigma[both]
            if np.sqrt(np.median(shift**2) / 0.455) > AT_REST:
                close()
                begin = -1
        if begin < 0:
            total, weight, begin = np.zeros(count), np.zeros(count), bin_
        total[told] += middle[told] * n[told]
        weight[told] += n[told]
        end = bin_ + 1
    close()
    return out


def _medians(angle: Floats, stream: Ints, count: int) -> tuple[Floats, Floats, Ints]:
    """Return median, robust standard deviation and number of hits per stream, (count,) each."""
    order = np.lexsort((angle, stream))
    n = np.bincount(stream, minlength=count)
    begin = np.concatenate([[0], np.cumsum(n)])[:-1]
    middle, spread = np.zeros(count), np.zeros(count)
    some = n > 0
    middle[some] = angle[order][(begin + n // 2)[some]]
    away = np.abs(angle - middle[stream])
    spread[some] = 1.4826 * away[np.lexsort((away, stream))][(begin + n // 2)[some]]
    return middle, spread, n


def _averaged(seen: Seen, own: Floats) -> Rows:
    """Return a row per stream of a stretch at rest."""
    stream, count = _streams(seen)
    middle, spread, n = _medians(seen.angle, stream, count)
    limit = OUTLIER * np.maximum(spread, FLOOR_RAD)
    inlier = np.abs(seen.angle - middle[stream]) <= limit[stream]
    n = np.bincount(stream[inlier], minlength=count)
    mean = np.bincount(stream[inlier], seen.angle[inlier], minlength=count) / np.maximum(n, 1)
    first = np.unique(stream, return_index=True)[1]
    station = seen.station[first]
    most = np.zeros(int(station.max()) + 1 if len(station) else 1, dtype=np.int64)
    np.maximum.at(most, station, n)
    keep = np.flatnonzero(n >= np.maximum(LEAST_SHARE * most[station], 1))
    sigma = np.maximum(spread, own[station]) / np.sqrt(np.maximum(n, 1))
    zero = np.zeros(len(keep))
    return Rows(
        station[keep],
        seen.fan[first][keep],
        np.zeros(len(keep), dtype=np.int64),
        np.zeros((len(keep), 3)),
        zero,
        mean[keep],
        sigma[keep],
        zero,
        np.arange(len(keep)),
        seen.photodiode[first][keep],
    )


def _single(seen: Seen, epoch_s: float, turn_s: Floats, own: Floats) -> Rows:
    """Return a row per hit of a window of motion."""
    count = len(seen.time_s)
    sweep = np.zeros(count, dtype=np.int64)
    last = 0
    for s in np.unique(seen.station):
        for f in (0, 1):
            mine = np.flatnonzero((seen.station == s) & (seen.fan == f))
            if len(mine):
                turn = np.concatenate([[0], np.cumsum(np.diff(seen.time_s[mine]) > turn_s[s] / 2)])
                sweep[mine] = last + turn
                last = int(sweep[mine].max()) + 1
    sigma = own[seen.station]
    return Rows(
        seen.station,
        seen.fan,
        np.zeros(count, dtype=np.int64),
        np.zeros((count, 3)),
        seen.time_s - epoch_s,
        seen.angle,
        sigma,
        sigma.copy(),
        sweep,
        seen.photodiode,
    )


def _moving(seen: Seen, rest: list[tuple[float, float]], stations: int, most: int) -> list[tuple[float, float]]:
    """Return windows outside the stretches at rest that enough stations saw, at most `most`, evenly in time."""
    if not len(seen.time_s):
        return []
    free = np.ones(len(seen.time_s), dtype=np.bool_)
    for begin, end in rest:
        free[np.arange(*np.searchsorted(seen.time_s, [begin, end]))] = False
    first = float(seen.time_s[0])
    number = np.floor((seen.time_s - first) / MOTION_S).astype(np.int64)
    good = []
    for hits in np.split(np.arange(len(number)), np.flatnonzero(np.diff(number)) + 1):
        if free[hits].all() and np.count_nonzero(np.bincount(seen.station[hits]) >= FEWEST_ROWS) >= stations:
            good.append(int(number[hits[0]]))
    if len(good) > most:
        good = [good[i] for i in np.linspace(0, len(good) - 1, most).astype(np.int64)]
    return [(first + n * MOTION_S, first + (n + 1) * MOTION_S) for n in good]
