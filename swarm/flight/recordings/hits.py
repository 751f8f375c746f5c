"""Hits: single sweeps of single photodiodes, in one form whatever file they come from.

A *hit* is (station, fan, photodiode, tick, angle). Angles count from boresight in the sense in which the rotor turns,
as both libsurvive and the Crazyflie have them: fan 0 of Lighthouse 1.0 positive to the left as the station looks, fan 1
positive upwards; the planes 0 and 1 of Lighthouse 2.0 both positive to the left. Nothing of the station's calibration
is taken off.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.lighthouse.rotor import share_of


class Hits(NamedTuple):
    """N hits of one object in order of time, (N,) each.

    station: its number in the recording, for Lighthouse 2.0 its channel. fan: 0 or 1. photodiode: index. tick: instant
    on the object's clock [ticks]. angle: [rad].
    """

    station: Ints
    fan: Ints
    photodiode: Ints
    tick: Floats
    angle: Floats

    def of(self, rows: Ints | Bools) -> "Hits":
        """Return some of the hits, by their indices or a mask."""
        return Hits(self.station[rows], self.fan[rows], self.photodiode[rows], self.tick[rows], self.angle[rows])


class Lost(NamedTuple):
    """Numbers of hits that give no angle, or a doubtful one.

    channel: of no known channel. zero: of stations whose rotor's zero is not known at that time. plane: that may be of
    either plane. shared: of two stations' sweeps at once. doubled: hits of a photodiode beyond the first in one sweep,
    which are kept: geometry tells the direct one. zeros: observations of a rotor's zero that fit no turn.
    """

    channel: int = 0
    zero: int = 0
    plane: int = 0
    shared: int = 0
    doubled: int = 0
    zeros: int = 0

    def sentences(self) -> list[str]:
        """Return a sentence for each kind."""
        told = (
            (self.channel, "hits of no known channel, left out"),
            (self.zero, "hits while their rotor's zero is not known, left out"),
            (self.plane, "hits that may be of either plane, left out"),
            (self.shared, "hits while two stations' sweeps met, left out"),
            (self.doubled, "second hits of a photodiode in one sweep, kept"),
            (self.zeros, "observations of a rotor's zero that fit no turn, left out"),
        )
        return [f"{text}: {number}" for number, text in told if number]


class Light(NamedTuple):
    """Hits of one object. generation: "1.0" or "2.0", empty if not known. tick_s: of the object's clock [s]. lost: hits
    without an angle. turn_s: mean duration of a rotor's turn per station [s], as measured.
    """

    generation: str
    tick_s: float
    hits: Hits
    lost: Lost
    turn_s: dict[int, float]

    def stations(self) -> list[int]:
        """Return the numbers of the stations that were seen."""
        return [int(station) for station in np.unique(self.hits.station)]

    def turns(self, station: int) -> int:
        """Return the number of turns of a station's rotor in which it was seen.

        Where the duration of a turn is not known: the number of sweeps that the photodiode and fan saw that saw most.
        """
        hits = self.hits.of(self.hits.station == station)
        if not len(hits.tick):
            return 0
        if station in self.turn_s:
            turn = self.turn_s[station] / self.tick_s
            zero = np.sort(hits.tick - share_of(hits.angle, hits.fan) * turn)
            return 1 + int(np.count_nonzero(np.diff(zero) > turn / 2))
        pairs = np.stack([hits.fan, hits.photodiode], axis=1)
        return int(np.unique(pairs, axis=0, return_counts=True)[1].max())


def joined(parts: list[Hits]) -> Hits:
    """Return several stations' hits as one, in order of time."""
    none = np.zeros(0)
    whole = Hits(
        np.concatenate([none.astype(np.int64), *(part.station for part in parts)]),
        np.concatenate([none.astype(np.int64), *(part.fan for part in parts)]),
        np.concatenate([none.astype(np.int64), *(part.photodiode for part in parts)]),
        np.concatenate([none, *(part.tick for part in parts)]),
        np.concatenate([none, *(part.angle for part in parts)]),
    )
    return whole.of(np.argsort(whole.tick, kind="stable"))
