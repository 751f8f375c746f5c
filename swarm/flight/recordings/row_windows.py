"""Light of several stations divided into the periods of a filter: rows of one craft, with the recording's own pose.

Stations of different rotors share no period; the filter's clock is the object's own. A sweep belongs to the period in
which it first meets the object: it is never divided. Periods follow each other without a gap, so that a filter keeps
time in the dark.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.lighthouse.innovation import of_one
from estimators.lighthouse.rows import Rows
from swarm.flight.recordings.crazyflie import Inertial
from swarm.flight.recordings.hits import Hits
from swarm.flight.recordings.libsurvive import WorldPose
from swarm.flight.recordings.object_light import ObjectLight
from swarm.flight.recordings.windows import blended
from swarm.onboard.inertial import InertialLight
from swarm.onboard.stations import RowLight

SWEEP_GAP_S = 0.004
"""Time between neighbouring hits of one fan [s] beyond which they are of two sweeps: an eighth of a turn's half."""


INERTIAL_GAP_S = 0.03
"""Longest time between samples of an inertial sensor [s] over which these are interpolated."""


class RowWindow(NamedTuple):
    """One period of one craft. time_s: its epoch since the first period's begin. light: its rows. left_out: number of
    photodiodes among them that were left out as false. peer_position (1, 3) [m], peer_quaternion (1, 4) wxyz: the
    recording's own pose at the epoch, NaN if there is none.
    """

    time_s: float
    light: RowLight
    left_out: int
    peer_position: Floats
    peer_quaternion: Floats


class Span(NamedTuple):
    """Periods `first` to before `end`, of which number zero begins at a tick."""

    zero_tick: float
    first: int
    end: int


class RowWindows:
    """The periods of a recording, in order; iterate for `RowWindow`s.

    frame_s: period of the filter [s]. first_tick: begin of period zero.
    """

    def __init__(
        self,
        source: ObjectLight,
        numbers: Sequence[int],
        frame_s: float,
        peer: WorldPose,
        false: Bools,
        span: Span | None = None,
    ) -> None:
        """Divide the light.

        Args:
            source: light of one object.
            numbers: of the stations, in the order in which rows name them.
            frame_s: period of the filter [s].
            peer: the recording's own poses in the world of the stations.
            false: (S, K), photodiodes that are left out before a station.
            span: the periods; None: all, from the first hit to the last.
        """
        light = source.light
        hits = light.hits.of(np.isin(light.hits.station, numbers))
        self.frame_s, self._tick_s, self._false = frame_s, light.tick_s, false
        sweep, begin = _sweeps(hits, light.tick_s)
        first_tick = float(hits.tick.min()) if len(hits.tick) else 0.0
        self.first_tick = first_tick if span is None else span.zero_tick
        self._begin_s = float(source.time_s(np.array(self.first_tick)))
        period = np.floor((begin - self.first_tick) * light.tick_s / frame_s).astype(np.int64)
        order = np.argsort(period, kind="stable")
        self._hits, self._sweep, period = hits.of(order), sweep[order], period[order]
        place = np.full(1 + max(numbers, default=0), -1)
        place[list(numbers)] = np.arange(len(numbers))
        self._station = place[self._hits.station]
        if span is None:
            span = Span(first_tick, 0, int(period[-1]) + 1 if len(period) else 0)
        self._span, count = span, span.end - span.first
        self._edges = np.searchsorted(period, np.arange(span.first, span.end + 1))
        self._at = WorldPose(np.full((count, 3), np.nan), np.full((count, 4), np.nan))
        at = np.arange(span.first, span.end, dtype=np.float64) + 0.5
        epochs = self.first_tick + at * (frame_s / light.tick_s)
        self._inertial = shown(source.inertial, source.time_s(epochs), frame_s)
        within, poses = blended(source.peer_time_s, peer, source.time_s(epochs))
        self._at.position[within], self._at.quaternion[within] = poses

    @property
    def has_inertial(self) -> bool:
        """Return whether the object's gyroscope and accelerometer were recorded."""
        return self._inertial is not None

    @property
    def begin_s(self) -> float:
        """Return the begin of the first period on the recording's clock [s]."""
        return self._begin_s

    def __len__(self) -> int:
        return len(self._edges) - 1

    def __iter__(self) -> Iterator[RowWindow]:
        for i in range(self._span.first, self._span.end):
            yield self.window(i)

    def _shown(self, place: int) -> InertialLight | None:
        if self._inertial is None:
            return None
        return InertialLight._make(part[place : place + 1] for part in self._inertial)

    def window(self, i: int) -> RowWindow:
        """Return period number `i`."""
        place = i - self._span.first
        own = slice(self._edges[place], self._edges[place + 1])
        hits, station = self._hits.of(np.arange(own.start, own.stop)), self._station[own]
        epoch = self.first_tick + (i + 0.5) * self.frame_s / self._tick_s
        false = self._false[station, hits.photodiode]
        rows = Rows(
            station,
            hits.fan,
            hits.photodiode,
            _counted(self._sweep[own], station * 2 + hits.fan),
            (hits.tick - epoch) * self._tick_s,
            hits.angle,
        )
        none = np.zeros(1, dtype=np.int64)
        left_out = len(np.unique(np.stack([station, hits.photodiode])[:, false], axis=1).T) if false.any() else 0
        batch = of_one(Rows._make(part[~false] for part in rows))
        return RowWindow(
            (i + 0.5) * self.frame_s,
            RowLight(batch, none, none, self._shown(place)),
            left_out,
            self._at.position[place : place + 1],
            self._at.quaternion[place : place + 1],
        )


def shown(inertial: Inertial, epoch_s: Floats, frame_s: float) -> InertialLight | None:
    """Return what inertial sensors showed in each of N periods, as N objects would have it; None without sensors.

    Args:
        inertial: samples on the clock of the epochs.
        epoch_s: (N,) [s].
        frame_s: period, before each epoch [s].
    """
    inertial = Inertial._make(part[np.argsort(inertial.time_s, kind="stable")] for part in inertial)
    time_s = inertial.time_s
    if len(time_s) < 2:
        return None
    after = np.clip(np.searchsorted(time_s, epoch_s), 1, len(time_s) - 1)
    before = np.clip(np.searchsorted(time_s, epoch_s - frame_s), 1, len(time_s) - 1)
    longest = np.maximum(time_s[after] - time_s[after - 1], time_s[before] - time_s[before - 1])
    samples = np.diff(np.searchsorted(time_s, np.stack([epoch_s - frame_s, epoch_s])), axis=0)[0]
    good = (epoch_s - frame_s >= time_s[0]) & (epoch_s <= time_s[-1]) & (longest < INERTIAL_GAP_S)
    good &= samples >= np.floor(frame_s / INERTIAL_GAP_S)

    def at(instant_s: Floats, column: Floats) -> Floats:
        out: Floats = np.where(good, np.interp(instant_s, time_s, column), np.nan)
        return out

    step = np.diff(time_s)[:, None] * (inertial.acceleration[1:] + inertial.acceleration[:-1]) / 2
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
    force = [(at(epoch_s, column) - at(epoch_s - frame_s, column)) / frame_s for column in total.T]
    rate = [[at(epoch_s - age, column) for column in inertial.rate.T] for age in (0.0, frame_s)]
    return InertialLight(np.stack(rate[0], axis=1), np.stack(rate[1], axis=1), np.stack(force, axis=1))


def _sweeps(hits: Hits, tick_s: float) -> tuple[Ints, Floats]:
    """Return the sweep that each hit is of, as a number per station and fan, and the tick at which that began, (N,)."""
    sweep, begin = np.zeros(len(hits.tick), dtype=np.int64), np.zeros(len(hits.tick))
    key = hits.station * 2 + hits.fan
    for k in np.unique(key):
        own = np.flatnonzero(key == k)
        own = own[np.argsort(hits.tick[own], kind="stable")]
        new = np.diff(hits.tick[own]) * tick_s > SWEEP_GAP_S
        number = np.concatenate([[0], np.cumsum(new)])
        sweep[own] = number
        begin[own] = hits.tick[own][np.concatenate([[0], 1 + np.flatnonzero(new)])][number]
    return sweep, begin


def _counted(sweep: Ints, fan: Ints) -> Ints:
    """Return sweeps numbered from zero in each fan, (N,)."""
    out = np.zeros(len(sweep), dtype=np.int64)
    for f in np.unique(fan):
        own = fan == f
        out[own] = np.unique(sweep[own], return_inverse=True)[1]
    return out
