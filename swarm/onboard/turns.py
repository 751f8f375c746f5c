"""Sweep angles from the pulses of one or two Lighthouse 1.0 stations that take turns: one decoder each.

In modes b and c both stations flash every half turn and sweep one turn each (`swarm.onboard.decoder`). A craft tells
which station is which by the order of their flashes, so it follows a station once it has seen both at once; from then
on that station's own flashes are enough. Every row is referred to the middle of the period, by the nominal time between
the station's own epoch and that.
"""

import numpy as np

from estimators.arrays import Bools
from estimators.lighthouse.innovation import RowBatch, gathered, rows_of_sweeps
from estimators.lighthouse.rows import Rows
from swarm.messages import Pulses
from swarm.onboard.decoder import SLOT_S, PulseDecoder
from swarm.onboard.stations import RowLight


class TurnDecoder:
    """The timing circuits of C craft before one or two stations: `decode` takes each one's pulses of one period."""

    def __init__(
        self, present: Bools, tick_s: float, rate_hz: float, stations: int, field_half_angle_rad: float
    ) -> None:
        """Begin without any flash.

        Args:
            present: photodiodes of each craft, (C, K).
            tick_s: tick of the craft's clocks [s].
            rate_hz: turns of the rotors per second [Hz].
            stations: number of stations, one or two.
            field_half_angle_rad: largest angle from boresight of an accepted sweep [rad].
        """
        self._decoders = [
            PulseDecoder(
                present,
                tick_s,
                rate_hz=rate_hz,
                frame_s=stations / rate_hz,
                slot=slot,
                field_half_angle_rad=field_half_angle_rad,
            )
            for slot in range(stations)
        ]
        # From the middle of the period to the middle of the station's own turn, half a turn after its X flash.
        self._later_s = [(slot + 0.5 - stations / 2) / rate_hz + slot * SLOT_S for slot in range(stations)]

    def forget(self, mask: Bools) -> None:
        """Forget every flash of the craft of the mask (C,)."""
        for decoder in self._decoders:
            decoder.forget(mask)

    def decode(self, pulses: Pulses) -> RowLight:
        """Return the rows of every craft in one period."""
        found = [decoder.decode(pulses) for decoder in self._decoders]
        craft, parts = len(pulses.total), list[Rows]()
        whose = []
        for station, (angles, later_s) in enumerate(zip(found, self._later_s, strict=True)):
            batch: RowBatch = rows_of_sweeps(angles.theta, angles.offset_s + later_s)
            whose.append(np.repeat(np.arange(craft), np.diff(batch.first)))
            parts.append(Rows._make(batch[1:])._replace(station=np.full(len(batch.angle), station, dtype=np.int64)))
        rows = Rows._make(np.concatenate(column) for column in zip(*parts, strict=True))
        # A pulse of one station belongs to nothing for the decoder that does not follow the other.
        rejected = np.min([angles.rejected for angles in found], axis=0)
        missed = np.sum([angles.missed_sync for angles in found], axis=0)
        return RowLight(gathered(np.concatenate(whose), rows, craft), rejected, missed)
