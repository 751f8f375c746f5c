"""Search of one craft's rows for those of false photodiodes, by their innovations."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.lighthouse.innovation import noise_of
from estimators.lighthouse.integrity import AngleNoise, dropped_sets
from estimators.lighthouse.rows import Packed, Rows, linearise
from estimators.state import State


def agreeing(
    rows: Rows,
    stations: Packed,
    point_m: Floats,
    state: State,
    covariance: Floats,
    noise: Sequence[AngleNoise],
    gate: Floats,
    places: Mapping[int, Floats] | None = None,
) -> Bools | None:
    """Return the rows (n,) of one craft without those of photodiodes that must be false; None if the rest never agrees.

    The search is that for a pose (`estimators.lighthouse.integrity`), by the innovations, those that lie farthest from
    the prediction first. At least half of them remain. A photodiode may be false before one station, as by a
    reflection, and honest before another; of several stations, each is tried as a whole as well.

    Args:
        rows: the rows that do not agree with the prediction.
        stations: stations that they name.
        point_m: (K, 3) [m], photodiodes in the body frame.
        state: predicted state of the craft, without the craft axis.
        covariance: (12, 12), its covariance.
        noise: noise of the rows of each station.
        gate: (n + 1,), the largest normalised innovation squared of 0, 1, ... rows that is believed.
        places: covariances (12, 12) of errors that all rows of a station share, as errors of the craft's own state.
    """
    y, h = linearise(rows, stations, point_m, state.rotation, state.position, state.velocity, state.angular_rate)
    front = np.isfinite(y)
    y, h = np.where(front, y, 0.0), np.where(front[:, None], h, 0.0)
    s = h @ covariance @ h.T + noise_of(rows, noise)
    for station, own in (places or {}).items():
        there = h * (rows.station == station)[:, None]
        s += there @ own @ there.T
    seen = rows.station * len(point_m) + rows.photodiode
    lit = np.unique(seen[front])

    def without(dropped: Sequence[int]) -> tuple[float, Bools]:
        kept: Bools = front & ~np.isin(seen, dropped)
        at = np.flatnonzero(kept)
        square = float(y[at] @ np.linalg.solve(s[np.ix_(at, at)], y[at]))
        return square / float(gate[len(at)]), kept

    away = [float(np.max(np.abs(y / np.sqrt(np.diag(s)))[front & (seen == k)])) for k in lit]
    far = lit[np.argsort(away, kind="stable")[::-1]]
    for subsets in _with_stations(dropped_sets(lit, far, len(lit) // 2), lit, len(point_m)):
        share, kept = min((without(dropped) for dropped in subsets), key=lambda found: found[0])
        if share <= 1:
            return kept
    return None


def _with_stations(
    sets: Iterator[list[tuple[int, ...]]], lit: Ints, photodiodes: int
) -> Iterator[list[tuple[int, ...]]]:
    """Yield the sets of a search, and behind the single photodiodes those of each whole station, if there are several.

    Args:
        sets: of the search.
        lit: (n,), photodiodes, numbered on from one station to the next.
        photodiodes: number before each station.
    """
    yield from islice(sets, 1)
    stations = np.unique(lit // photodiodes)
    if len(stations) > 1:
        yield [tuple(lit[lit // photodiodes == station].tolist()) for station in stations]
    yield from sets
