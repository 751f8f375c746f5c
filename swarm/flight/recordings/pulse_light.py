"""Light of Lighthouse 1.0 in a recording: raw pulses, decoded as on board station by station, become `Hits`.

A recording may come in parts: the decoders go on from the last whole period of the part before.
"""

import numpy as np

from estimators.arrays import Bools
from swarm.errors import SwarmError
from swarm.flight.recordings.hits import Hits, joined
from swarm.flight.recordings.libsurvive import Recording
from swarm.flight.recordings.object_clock import TICK_S
from swarm.flight.recordings.windows import LEAD_S, Windows
from swarm.onboard.decoder import PulseDecoder

STATIONS = (0, 1)
"""Numbers of Lighthouse 1.0 stations."""
FORGET_S = 0.5
"""Time without a whole period after which a decoder begins anew [s]: a multiple of what its predictions reach."""


class PulseLight:
    """The decoders of one object's pulses, one for each station."""

    def __init__(self) -> None:
        """Begin without a pulse."""
        self._decoders: dict[int, PulseDecoder] = {}
        self._last: dict[int, float] = {}

    def decode(self, recording: Recording, until: float = np.inf) -> Hits:
        """Return the hits of the periods that no part before has given.

        Args:
            recording: a part of the object's light: all that has come, but for what is long since decoded.
            until: tick up to which the light is complete; periods that end later wait.
        """
        return joined([self._of_station(recording, station, until) for station in STATIONS])

    def _of_station(self, recording: Recording, station: int, until: float) -> Hits:
        """Return one station's hits; none where it gives no period."""
        try:
            windows = Windows(recording, station, "pulses")
        except SwarmError:
            return joined([])
        decoder = self._decoders.get(station)
        if decoder is None:
            decoder = self._decoders[station] = PulseDecoder(
                windows.photodiodes.present, windows.tick_s, frame_s=windows.frame_s, slot=windows.slot
            )
        period = windows.frame_s / TICK_S
        last, start = self._last.get(station, -np.inf), windows.start
        fresh = np.flatnonzero((start > last + period / 2) & (start + period - LEAD_S / TICK_S <= until))
        if not len(fresh):
            return joined([])
        if start[fresh[0]] - last > FORGET_S / TICK_S:
            nobody: Bools = np.ones(1, dtype=np.bool_)
            decoder.forget(nobody)
        self._last[station] = float(start[fresh[-1]])
        parts = []
        for pulses in windows.pulses(int(fresh[0]), int(fresh[-1]) + 1):
            angles = decoder.decode(pulses)
            photodiode, fan = np.nonzero(np.isfinite(angles.theta[0]))
            tick = angles.epoch_tick[0] + angles.offset_s[0, photodiode, fan] / TICK_S
            angle = angles.theta[0, photodiode, fan] - np.pi / 2
            parts.append(Hits(np.full(len(fan), station), fan, photodiode, tick, angle))
        return joined(parts)


def own_angles(recording: Recording) -> Hits:
    """Return the hits as the recording's own software has decoded them."""
    log = recording.angles
    return joined([Hits(log.lighthouse, log.fan, log.photodiode, log.middle_tick, log.angle_rad)])
