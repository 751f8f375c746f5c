"""Log of a Crazyflie with the lighthouse deck: sweep angles, raw pulses, inertial measurements and marks.

    lhAngle(sensor, basestation, sweep, angle, ...)      the firmware's decoded angle [rad], nothing taken off
    lhUartFrame(sensor, basestation, offset, timestampFPGA, ...)    a pulse as the receiver reports it, 24 MHz, 24 bits
    fixedFrequency(gyro.x, ..., acc.x, ...)              [deg/s] and [g], in the body frame
    lhCrossingBeam(x, y, z, delta)                       the firmware's position between two rays, and their distance
    activeMarkerModeChanged(mode)                        marks that the cameras of a motion capture system see, too

The deck's four photodiodes lie in one plane; body frame x forward, y left, z up. A pulse's `offset` is 0 where the
receiver did not find the rotor's zero, and so it is throughout in Lighthouse 1.0, whose flashes it does not report:
there, angles are all. A number of a station that hardly ever comes with an offset stands for an unknown one.
"""

import math
from array import array
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.lighthouse.rotor import CHANNEL_TICKS
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.recordings.event_log import Event, EventLog, EventType
from swarm.flight.recordings.hits import Hits, Light, Lost, joined
from swarm.flight.recordings.line_values import as_rows
from swarm.flight.recordings.rotor_light import FRAME_HZ, FrameLog, decode_frames

POINT_M = np.array([[-0.015, 0.0075, 0.0], [-0.015, -0.0075, 0.0], [0.015, 0.0075, 0.0], [0.015, -0.0075, 0.0]])
"""Photodiodes of the lighthouse deck in the body frame, (4, 3) [m]."""
NORMAL = np.tile([0.0, 0.0, 1.0], (4, 1))
GRAVITY = 9.80665
"""Standard gravity [m/s^2], the unit of the logged accelerations."""
ANGLE_TICK_S = 1e-6
"""Tick of the times at which angles were logged [s]."""
_FRAME_WRAP = 1 << 24
_NEEDED = {
    "lhAngle": ("sensor", "basestation", "sweep", "angle"),
    "lhUartFrame": ("sensor", "basestation", "offset", "timestampFPGA"),
    "fixedFrequency": ("gyro.x", "gyro.y", "gyro.z", "acc.x", "acc.y", "acc.z"),
    "lhCrossingBeam": ("x", "y", "z", "delta"),
    "activeMarkerModeChanged": ("mode",),
}
_OPTIONAL = ("fixedFrequency", "lhCrossingBeam")
"""Events that are left aside where they lack a variable: users choose what they log, and nothing rests on them."""
_PLACED = 0.05
"""Share of pulses with an offset above which they are of Lighthouse 2.0; of 1.0 some have one by accident."""
_FOLLOW = 0.01
"""Share of the difference between the logger's clock and the receiver's that is followed at each pulse."""
_STEP_S = 1.0
"""Largest step in time between neighbouring events [s]: a larger one back is damage, a larger one ahead needs the event
after it to confirm it."""


class Inertial(NamedTuple):
    """Inertial measurements in the body frame. time_s (N,), rate (N, 3) [rad/s], acceleration (N, 3) [m/s^2]."""

    time_s: Floats
    rate: Floats
    acceleration: Floats


class Crossings(NamedTuple):
    """The firmware's own positions. time_s (N,), position (N, 3) [m] in the client's world, apart_m (N,): the distance
    between the two stations' rays.
    """

    time_s: Floats
    position: Floats
    apart_m: Floats


class CrazyflieLog(NamedTuple):
    """One log.

    angles: decoded by the firmware; their ticks are the times of logging [us]. frames: raw pulses. inertial, crossing:
    empty where not logged. mark_s: times at which the active marker was switched on or off, (M,). begin_s, end_s: of
    all events, 0 without any. counts: number of events by name. damaged: number of events with impossible values. lost:
    why and where the log ends early, empty where it is whole.
    """

    path: Path
    version: int
    angles: Hits
    frames: FrameLog
    inertial: Inertial
    crossing: Crossings
    mark_s: Floats
    begin_s: float
    end_s: float
    counts: dict[str, int]
    damaged: int
    lost: str

    def has_rotors(self) -> bool:
        """Return whether the raw pulses tell the zeros of Lighthouse 2.0 rotors."""
        placed = np.count_nonzero((self.frames.channel >= 0) & (self.frames.offset > 0))
        return bool(placed > _PLACED * len(self.frames.tick))

    def light(self, generation: str = "") -> Light:
        """Return the hits: of the raw pulses where they tell the rotors' zeros, else the firmware's angles.

        Args:
            generation: of the stations, where it is known from elsewhere.
        """
        return decode_frames(self.frames) if self.has_rotors() else self.decoded(generation)

    def decoded(self, generation: str = "") -> Light:
        """Return the firmware's angles; `generation` is that of the stations, where it is known."""
        return Light(generation, ANGLE_TICK_S, self.angles, Lost(), {})


def read_crazyflie(path: str | Path) -> CrazyflieLog:
    """Read a Crazyflie's event log, as far as it is good.

    Raises:
        SwarmError: the file cannot be read, or is no such log, or an event lacks a variable.
    """
    reader = _Reader(Path(path))
    log = EventLog(Path(path))
    for event in log:
        reader.read(event)
    return reader.log(log)


class _Reader:
    """Collector of the events of one log.

    A log may have several types of event of one name. An event whose time leaps ahead waits for the next one to agree:
    one damaged time would make all later ones steps back.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._counts: Counter[str] = Counter()
        self._columns: dict[EventType, tuple[int, ...] | None] = {}
        self._leap: Event | None = None
        self._rows: dict[str, array[float]] = {name: array("d") for name in _NEEDED}
        self._begin_s = self._end_s = 0.0
        self._damaged = 0

    def read(self, event: Event) -> None:
        if event.kind not in self._columns:
            self._columns[event.kind] = self._places(event.kind)
        if self._leap is not None:
            if event.time_s >= self._leap.time_s - _STEP_S:
                self._take(self._leap)
            else:
                self._damaged += 1
            self._leap = None
        if not self._counts or event.time_s > self._end_s + _STEP_S:
            self._leap = event
        elif event.time_s >= self._end_s - _STEP_S:
            self._take(event)
        else:
            self._damaged += 1

    def _take(self, event: Event) -> None:
        name = event.kind.name
        self._begin_s = event.time_s if not self._counts else self._begin_s
        self._end_s = max(self._end_s, event.time_s)
        self._counts[name] += 1
        columns = self._columns[event.kind]
        if columns is None:
            return
        values = [float(event.values[i]) for i in columns]
        if _possible(name, values):
            self._rows[name].extend((event.time_s, *values))
        else:
            self._damaged += 1

    def _places(self, kind: EventType) -> tuple[int, ...] | None:
        """Return the places of an event's variables; None for an event that is not read, or lacks optional ones."""
        if kind.name not in _NEEDED:
            return None
        needed, there = _NEEDED[kind.name], kind.variables
        missing = next((name for name in needed if name not in there), None)
        if missing is None:
            return tuple(there.index(name) for name in needed)
        if kind.name in _OPTIONAL:
            return None
        raise SwarmError(f"{self._path}: event {kind.name!r} has no variable {missing!r}{did_you_mean(missing, there)}")

    def log(self, source: EventLog) -> CrazyflieLog:
        """Return the collected data as arrays; `source` has been read to its end."""
        if self._leap is not None:
            # Nothing contradicts the last event.
            self._take(self._leap)
            self._leap = None
        table = {name: as_rows(values, 1 + len(_NEEDED[name])) for name, values in self._rows.items()}
        angle, inertial, crossing = (table[name] for name in ("lhAngle", "fixedFrequency", "lhCrossingBeam"))
        station, fan, photodiode = (angle[:, i].astype(np.int64) for i in (2, 3, 1))
        return CrazyflieLog(
            path=self._path,
            version=source.version,
            angles=joined([Hits(station, fan, photodiode, np.round(angle[:, 0] / ANGLE_TICK_S), angle[:, 4])]),
            frames=_frames(table["lhUartFrame"]),
            inertial=Inertial(inertial[:, 0], np.radians(inertial[:, 1:4]), inertial[:, 4:7] * GRAVITY),
            crossing=Crossings(crossing[:, 0], crossing[:, 1:4], crossing[:, 4]),
            mark_s=table["activeMarkerModeChanged"][:, 0],
            begin_s=self._begin_s,
            end_s=self._end_s,
            counts=dict(self._counts),
            damaged=self._damaged,
            lost=source.lost,
        )


def _possible(name: str, values: list[float]) -> bool:
    """Return whether an event's values can be."""
    if not all(map(math.isfinite, values)):
        return False
    if name == "lhAngle":
        sensor, station, sweep, angle = values
        return _numbered(sensor, station) and sweep in (0, 1) and abs(angle) < math.pi
    if name == "lhUartFrame":
        sensor, station, offset, stamp = values
        return _numbered(sensor, station) and 0 <= offset < max(CHANNEL_TICKS) / 2 and 0 <= stamp < _FRAME_WRAP
    return True


def _numbered(sensor: float, station: float) -> bool:
    """Return whether the deck has this photodiode, and a station can have this number."""
    return 0 <= sensor < len(POINT_M) and 0 <= station < len(CHANNEL_TICKS)


def _frames(table: Floats) -> FrameLog:
    """Return the pulses of rows (time, sensor, station, offset, stamp)."""
    station, offset = table[:, 2].astype(np.int64), table[:, 3].astype(np.int64)
    number = np.bincount(station, minlength=len(CHANNEL_TICKS))
    placed = np.bincount(station[offset > 0], minlength=len(CHANNEL_TICKS))
    channel = np.where((placed > _PLACED * number)[station], station, -1)
    tick = _unwrapped(table[:, 0], table[:, 4])
    return FrameLog(table[:, 0], table[:, 1].astype(np.int64), channel, offset, tick)


def _unwrapped(time_s: Floats, stamp: Floats) -> Floats:
    """Return stamps of a counter that wraps every 0.7 s as ticks without wraps.

    The logger's time tells the number of wraps: what it and the counter tell of the time since the pulse before must
    differ by less than half a wrap, whatever the drift between the two clocks.
    """
    out = np.empty(len(stamp))
    late = 0.0
    for i, (now, counter) in enumerate(zip((time_s * FRAME_HZ).tolist(), stamp.tolist(), strict=True)):
        if i == 0:
            late = now - counter
        tick = counter + _FRAME_WRAP * round((now - late - counter) / _FRAME_WRAP)
        late += _FOLLOW * (now - late - tick)
        out[i] = tick
    return out
