"""A recording divided into periods: the input of the on-board code, one lighthouse period of one craft at a time.

Windows follow each other without a gap; where the recording has no data they are empty, so that a decoder and a filter
that advance by one period per window keep time. There are two sources:

- "pulses": the raw pulses from shortly before the station's X flash to shortly before its next one, for a
  `PulseDecoder` to decode; only the times of those flashes are read from them here.
- "angles": libsurvive's own sweep angles.

A station looks along -z with y up in libsurvive's convention and along +z with y down in this project's: turned by pi
about x. Hence, for its pose (R_w_s, t_s) and an object's (R_w_o, t_o) in libsurvive's world w, with F = diag(1, -1, -1)
and l this project's lighthouse frame:

    R_l_o = F R_w_s^T R_w_o,    t_l = F R_w_s^T (t_o - t_s)
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import Literal, NamedTuple, get_args

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.recordings.framing import RATE_HZ, TURN_TICKS, Framing, frame_angles, frame_pulses, x_flash
from swarm.flight.recordings.libsurvive import Recording, WorldPose
from swarm.flight.recordings.object_clock import TICK_S
from swarm.messages import Pulses

LEAD_S = 600e-6
"""Time from a window's start to its X flash [s]: after the last sweep, before the other station's flash (417 us)."""
PEER_REACH_S = 0.05
"""Largest distance in time [s] from the epoch to the two peer poses, one on either side, that are interpolated."""
_FROM_SURVIVE = np.diag([1.0, -1.0, -1.0])

Source = Literal["pulses", "angles"]


class Sweeps(NamedTuple):
    """Angles of one period as the recording has them, any number of one photodiode and fan.

    epoch_tick: epoch [ticks]. photodiode, fan: (N,). angle_rad: angle since the fan's flash, (N,). offset_s: instant
    minus the epoch, (N,).
    """

    epoch_tick: int
    photodiode: Ints
    fan: Ints
    angle_rad: Floats
    offset_s: Floats


class Window(NamedTuple):
    """One period of one craft (C = 1).

    time_s: epoch on the recording's clock. pulses, sweeps: data of this period, None for the other source.
    peer_position (1, 3) [m], peer_quaternion (1, 4) wxyz: the recording's own pose of the object at the epoch, in this
    project's lighthouse frame, NaN if there is none.
    """

    time_s: float
    pulses: Pulses | None
    sweeps: Sweeps | None
    peer_position: Floats
    peer_quaternion: Floats


class Windows:
    """The periods of one station in a recording, in order; iterate for `Window`s.

    start: tick of each period's X flash, (N,). frame_s: time from one epoch to the next [s]. tick_s: tick of the
    object's clock [s]. slot: station for a `PulseDecoder` to follow. photodiodes: the object's layout.
    """

    def __init__(
        self, recording: Recording, lighthouse: int, source: Source = "pulses", station: WorldPose | None = None
    ) -> None:
        """Find the periods of the station.

        Args:
            recording: recording of one object.
            lighthouse: libsurvive's number of the station.
            source: raw "pulses" or decoded "angles".
            station: pose of the station, for the peer's poses (default: LH_POSE).

        Raises:
            SwarmError: the recording has no data of this station from this source.
        """
        if source not in get_args(Source):
            raise SwarmError(
                f"source {source!r} is neither 'pulses' nor 'angles'{did_you_mean(source, get_args(Source))}"
            )
        if lighthouse not in (0, 1):
            raise SwarmError(f"lighthouse must be 0 or 1, not {lighthouse}")
        self._recording, self._lighthouse, self._source = recording, lighthouse, source
        framing = _framing(recording, lighthouse, source)
        if len(framing.start) == 0:
            first_generation = len(recording.pulses.rise_tick) or len(recording.angles.middle_tick)
            if recording.rotors.any() and not first_generation:
                raise SwarmError(
                    f"{recording.path}: {recording.device!r} saw Lighthouse 2.0 stations, and here only the periods of "
                    "Lighthouse 1.0 are read; swarm replay takes both"
                )
            what = "raw pulses (C lines)" if source == "pulses" else "sweep angles (A lines)"
            other = len(_framing(recording, 1 - lighthouse, source).start)
            raise SwarmError(
                f"{recording.path}: no period of lighthouse {lighthouse} among the {what} of {recording.device!r}"
                + (f"; of lighthouse {1 - lighthouse} there are {other}" if other else "")
            )
        self.start = framing.start
        self.frame_s, self.tick_s = framing.turns / RATE_HZ, TICK_S
        self.slot = 1 if framing.turns == 2 and lighthouse == 0 else 0
        self.photodiodes = recording.photodiodes
        log = recording.pulses if source == "pulses" else recording.angles
        tick = recording.pulses.rise_tick if source == "pulses" else recording.angles.middle_tick
        # The host logs each event some milliseconds late, irregularly: fit one straight line to all of them.
        line = np.polynomial.Polynomial.fit(tick, log.time_s, 1)
        self._time_s = line(self.start + TURN_TICKS / 2)
        self._peer = _peer_poses(recording, self._time_s, station or recording.station(lighthouse))

    @property
    def begin_s(self) -> float:
        """Return the first epoch on the recording's clock [s]."""
        return float(self._time_s[0])

    def __len__(self) -> int:
        return len(self.start)

    def __iter__(self) -> Iterator[Window]:
        cut: Iterator[tuple[Pulses | None, Sweeps | None]]
        if self._source == "pulses":
            cut = ((pulses, None) for pulses in self.pulses(0, len(self)))
        else:
            cut = ((None, sweeps) for sweeps in self._cut_angles())
        for i, (pulses, sweeps) in enumerate(cut):
            yield Window(
                float(self._time_s[i]), pulses, sweeps, self._peer.position[i : i + 1], self._peer.quaternion[i : i + 1]
            )

    def pulses(self, first: int, end: int) -> Iterator[Pulses]:
        """Yield the raw pulses of the periods from `first` to before `end`."""
        log = self._recording.pulses
        period = self.frame_s / TICK_S
        edges = np.append(self.start, self.start[-1] + period)[first : end + 1] - LEAD_S / TICK_S
        index = np.searchsorted(log.rise_tick, edges)
        for begin, last in pairwise(index):
            yield Pulses(
                log.photodiode[None, begin:last].astype(np.int16),
                log.rise_tick[None, begin:last],
                log.width_tick[None, begin:last].astype(np.int32),
                np.array([last - begin], dtype=np.int32),
            )

    def _cut_angles(self) -> Iterator[Sweeps]:
        log = self._recording.angles
        rows = np.flatnonzero(log.lighthouse == self._lighthouse)
        flash = x_flash(log)[rows]
        order = np.argsort(flash, kind="stable")
        rows, flash = rows[order], flash[order]
        period = self.frame_s / TICK_S
        index = np.searchsorted(flash, np.append(self.start, self.start[-1] + period) - period / 8)
        for start, first, last in zip(self.start, index[:-1], index[1:], strict=True):
            epoch, row = round(start + TURN_TICKS / 2), rows[first:last]
            offset_s = (log.middle_tick[row] - epoch) * TICK_S
            yield Sweeps(epoch, log.photodiode[row], log.fan[row], log.angle_rad[row] + np.pi / 2, offset_s)


def _framing(recording: Recording, lighthouse: int, source: Source) -> Framing:
    if source == "pulses":
        return frame_pulses(recording.pulses, lighthouse)
    return frame_angles(recording.angles, lighthouse)


def _peer_poses(recording: Recording, time_s: Floats, station: WorldPose | None) -> WorldPose:
    """Return the recording's own poses of the object at the times (N,), NaN if none, in the lighthouse frame."""
    position, quaternion = np.full((len(time_s), 3), np.nan), np.full((len(time_s), 4), np.nan)
    if station is None:
        return WorldPose(position, quaternion)
    within, world = blended(recording.peer_time_s, recording.peer, time_s)
    to_ours = _FROM_SURVIVE @ rot.matrix_from_quaternion(station.quaternion).T
    position[within] = (world.position - station.position) @ to_ours.T
    quaternion[within] = rot.quaternion_from_matrix(to_ours @ rot.matrix_from_quaternion(world.quaternion))
    return WorldPose(position, quaternion)


def blended(known: Floats, peer: WorldPose, time_s: Floats) -> tuple[Bools, WorldPose]:
    """Return which times (N,) lie between two near poses of a series, and the poses in between at those times.

    Args:
        known: times of the series, (M,) [s], in order.
        peer: its poses.
        time_s: (N,) [s].
    """
    if len(known) < 2:
        return np.zeros(len(time_s), dtype=np.bool_), WorldPose(np.zeros((0, 3)), np.zeros((0, 4)))
    after = np.clip(np.searchsorted(known, time_s), 1, len(known) - 1)
    before = after - 1
    within = (known[before] >= time_s - PEER_REACH_S) & (known[after] <= time_s + PEER_REACH_S)
    within &= (known[before] <= time_s) & (time_s <= known[after])
    before, after, at = before[within], after[within], time_s[within]
    share = ((at - known[before]) / np.maximum(known[after] - known[before], 1e-9))[:, None]
    p, q = peer.position, peer.quaternion
    nearer = np.where(np.sum(q[before] * q[after], axis=1, keepdims=True) < 0, -q[after], q[after])
    blend = (1 - share) * q[before] + share * nearer
    position = (1 - share) * p[before] + share * p[after]
    return within, WorldPose(position, blend / np.linalg.norm(blend, axis=1, keepdims=True))
