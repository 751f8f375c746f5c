"""Light of one object as its lines come, period by period as these become complete.

The lines are read and decoded as those of a file are (`LibsurviveReader`, `decode_rotor_log`, `PulseLight`,
`RowWindows`), a little at a time. A period is complete when every sweep in it can be decoded: of Lighthouse 2.0 when
the rotors have passed their next zero, for a turn is measured from zero to zero; of 1.0 when the station's own period
has ended. Its rows are then those of the file.
"""

import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from estimators.arrays import Bools
from estimators.lighthouse.rotor import CHANNEL_CLOCK_HZ, CHANNEL_TICKS
from swarm.errors import SwarmError
from swarm.flight.recordings.framing import RATE_HZ
from swarm.flight.recordings.hits import joined
from swarm.flight.recordings.latency import Latency
from swarm.flight.recordings.libsurvive import Forgotten, WorldPose
from swarm.flight.recordings.live_lines import WAIT_S, Line, LiveLines
from swarm.flight.recordings.live_start import Learnt
from swarm.flight.recordings.object_clock import TICK_S
from swarm.flight.recordings.object_light import ObjectLight, saw_second, second_light
from swarm.flight.recordings.pulse_light import PulseLight, own_angles
from swarm.flight.recordings.row_windows import SWEEP_GAP_S, RowWindow, RowWindows, Span
from swarm.flight.recordings.windows import Source

SETTLE_S = {"1.0": 2 / RATE_HZ + 2 * SWEEP_GAP_S, "2.0": max(CHANNEL_TICKS) / CHANNEL_CLOCK_HZ + 2 * SWEEP_GAP_S}
"""Time after its end at which a period is complete [s]: a turn of the station, and the rest of a sweep, twice."""
KEEPS_UP = 3
"""Periods that become complete at once, at most, where the start has been caught up with."""
DARK_S = 0.5
"""Time without light [s] after which periods go on without: hosts log events up to some tenths of a second late."""
ZEROS_S, HITS_S, POSES_S = 1.2, 0.15, 2.0
"""Light that is kept behind the last complete period [s]: zeros as long as gaps are bridged, hits, and poses."""
PULSES_S = 0.6
"""Raw pulses of Lighthouse 1.0 that are kept [s]: some twenty periods tell whose flashes are whose."""


class LightPart:
    """The light of one object that is recent."""

    def __init__(self, learnt: Learnt, source: Source) -> None:
        """Take the reader of the lines, and whether raw "pulses" or "angles" count."""
        self._reader, self._light, self._source = learnt.reader, learnt.light, source
        self._second = learnt.light.light.generation == "2.0"
        self._pulses, self._hits = PulseLight(), joined([])

    def decoded(self, *, whole: bool) -> ObjectLight:
        """Return what is kept; `whole` says that no more comes."""
        recording, clock = self._reader.recording(whole=whole), self._reader.clock
        if self._second or saw_second(recording):
            try:
                hits = second_light(recording, self._source).hits
            except SwarmError:  # dark
                hits = joined([])
        elif self._source == "angles":
            hits = own_angles(recording)
        else:
            until = np.inf if whole else (clock.newest or 0) - SWEEP_GAP_S / TICK_S
            hits = self._hits = joined([self._hits, self._pulses.decode(recording, until)])
        zero_s = float(clock.time_s(np.zeros(())))
        return self._light._replace(
            light=self._light.light._replace(hits=hits),
            inertial=recording.inertial._replace(time_s=zero_s + TICK_S * recording.inertial.time_s),
            time_0_s=zero_s,
            time_1=TICK_S,
            peer_time_s=recording.peer_time_s,
            peer=recording.peer,
        )

    def forget(self, tick: float) -> None:
        """Forget light long before a tick, behind which all periods are complete."""
        pulses = not self._second and self._source == "pulses"
        hits = tick - (PULSES_S if pulses else HITS_S) / TICK_S
        before_s = float(self._reader.clock.time_s(np.array(tick))) - POSES_S
        self._reader.forget(Forgotten(tick - ZEROS_S / TICK_S, hits), before_s)
        self._hits = self._hits.of(self._hits.tick >= tick - HITS_S / TICK_S)


class LiveWindows:
    """The periods of light as it comes.

    latency: from each line to its estimate. late: number of lines that came after their period was closed.
    """

    def __init__(self, lines: LiveLines, learnt: Learnt, source: Source, begun: RowWindows) -> None:
        """Go on from what was learnt.

        Args:
            lines: as they come.
            learnt: the first ones.
            source: raw "pulses" or "angles".
            begun: periods of what was learnt; the first one stays the first.
        """
        self._lines, self._reader = lines, learnt.reader
        self._part = LightPart(learnt, source)
        self._zero_tick, self._frame_s = begun.first_tick, begun.frame_s
        self._settle_s = SETTLE_S.get(learnt.light.light.generation, max(SETTLE_S.values()))
        self._came_s = time.monotonic()
        self._since_s = np.inf
        self.latency, self.late = Latency(), 0

    def periods(
        self, numbers: Sequence[int], false: Bools, peer: Callable[[ObjectLight], WorldPose]
    ) -> Iterator[RowWindow]:
        """Yield the periods as they become complete, once; whoever takes the next one is done with the one before.

        Args:
            numbers: of the stations, in the order in which rows name them.
            false: (S, K), photodiodes that are left out before a station.
            peer: returns the recording's own poses in the world of the stations.
        """
        done = 0
        over = False
        while not over:
            lines = self._lines.take(WAIT_S)
            over = self._lines.ended
            self._read(lines, done)
            end = self._complete(quiet=not lines)
            if end <= done and not over:
                continue
            light = self._part.decoded(whole=over)
            if over:
                end = max(done, self._lit(light))
            few = end - done <= KEEPS_UP
            span = Span(self._zero_tick, done, end)
            for window in RowWindows(light, numbers, self._frame_s, peer(light), false, span):
                yield window
                done += 1
                self.latency.told(self._tick(done), time.monotonic(), self._since_s)
            if few:
                # What came while the program was starting has been flown: from now on it keeps up.
                self._since_s = min(self._since_s, time.monotonic())
            self._part.forget(self._tick(done))

    def _tick(self, period: int) -> float:
        """Return the tick at which a period begins."""
        return self._zero_tick + period * self._frame_s / TICK_S

    def _period(self, tick: float) -> int:
        """Return the number of the period of a tick."""
        return int((tick - self._zero_tick) * TICK_S // self._frame_s)

    def _read(self, lines: Sequence[Line], done: int) -> None:
        closed, clock = self._tick(done), self._reader.clock
        for line in lines:
            before = clock.last
            self._reader.read(line.text, line.number)
            if clock.last is not None and clock.last != before:
                self._came_s = line.came_s
                self.latency.came(clock.last, line.came_s)
                self.late += clock.last < closed

    def _complete(self, *, quiet: bool) -> int:
        """Return the number of periods that are complete; `quiet` says that no line has come meanwhile."""
        dark_s = max(time.monotonic() - self._came_s - DARK_S, 0.0) if quiet else 0.0
        return self._period((self._reader.clock.newest or 0) + (dark_s - self._settle_s) / TICK_S)

    def _lit(self, light: ObjectLight) -> int:
        """Return the number of periods up to the last light."""
        tick = light.light.hits.tick
        return self._period(float(tick.max())) + 1 if len(tick) else 0
