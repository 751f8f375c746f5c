"""Faults in the pulses of one craft, between the light and the timing circuit.

All functions take and return a `Row`: one craft's pulses in order of rise. A flash is told from a sweep by its width,
as on board. Instants are seconds after the nominal start of the lighthouse period.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from swarm.messages import SYNC_WIDTH_S, Pulses


class Row(NamedTuple):
    """One craft's pulses: photodiode, rise [ticks], width [ticks], (P,) each."""

    photodiode: Ints
    rise: Ints
    width: Ints


class Clock(NamedTuple):
    """A lighthouse period on one craft's clock.

    start_tick: start of the period, not a whole number [ticks].
    tick_s: length of a tick [s].
    period_s: length of the period [s].
    """

    start_tick: float
    tick_s: float
    period_s: float

    def instant(self, row: Row) -> Floats:
        """Return the middle instants of pulses, (P,) [s]."""
        out: Floats = (row.rise + row.width / 2 - self.start_tick) * self.tick_s
        return out

    def fan(self, row: Row) -> Ints:
        """Return the fan, 0 or 1, in whose half of the period each pulse lies, (P,); flashes rise at its beginning."""
        late = (row.rise - self.start_tick) * self.tick_s >= 0.49 * self.period_s
        return late.astype(np.int64)

    def flash(self, row: Row) -> Bools:
        """Return which pulses are flashes, (P,)."""
        out: Bools = row.width * self.tick_s >= SYNC_WIDTH_S / 2
        return out

    def pulse(self, photodiode: Ints, instant_s: Floats, width_s: Floats) -> Row:
        """Return n pulses.

        Args:
            photodiode: photodiodes, (n,).
            instant_s: middle instants, (n,) [s].
            width_s: widths, (n,) [s].
        """
        width = np.maximum(1, np.rint(width_s / self.tick_s)).astype(np.int64)
        rise = np.rint(self.start_tick + instant_s / self.tick_s - width / 2).astype(np.int64)
        return Row(np.asarray(photodiode, dtype=np.int64), rise, width)


def row_of(pulses: Pulses, craft: int) -> Row:
    """Return the pulses of one craft."""
    total = int(pulses.total[craft])
    return Row(*(part[craft, :total].astype(np.int64) for part in pulses[:3]))


def with_rows(pulses: Pulses, rows: Mapping[int, Row]) -> Pulses:
    """Return the same pulses with those of some craft replaced."""
    most = pulses.rise_tick.shape[1]
    wider = ((0, 0), (0, max([0, *(len(row.rise) - most for row in rows.values())])))
    photodiode = np.pad(pulses.photodiode, wider, constant_values=-1)
    rise, width = np.pad(pulses.rise_tick, wider), np.pad(pulses.width_tick, wider)
    total = pulses.total.copy()
    for c, row in rows.items():
        count = len(row.rise)
        photodiode[c, count:] = -1
        photodiode[c, :count], rise[c, :count], width[c, :count] = row
        total[c] = count
    return Pulses(photodiode, rise, width, total)


def only(row: Row, keep: Bools) -> Row:
    """Return the pulses that `keep` (P,) selects."""
    return Row(*(part[keep] for part in row))


def joined(row: Row, more: Row) -> Row:
    """Return the pulses of both rows, in order of rise."""
    both = Row(*(np.concatenate(parts) for parts in zip(row, more, strict=True)))
    order = np.argsort(both.rise, kind="stable")
    return Row(*(part[order] for part in both))


def of_photodiodes(row: Row, photodiodes: Ints | tuple[int, ...]) -> Bools:
    """Return which pulses (P,) belong to one of these photodiodes."""
    out: Bools = np.isin(row.photodiode, np.asarray(photodiodes, dtype=np.int64))
    return out


def without_flashes(row: Row, clock: Clock, missed: NDArray[np.bool_]) -> Row:
    """Return the row without the missed flashes.

    Args:
        row: pulses of one craft.
        clock: the period on the craft's clock.
        missed: fans whose flash is missed, (2,).
    """
    return only(row, ~(clock.flash(row) & missed[clock.fan(row)]))


def moved(row: Row, clock: Clock, struck: Bools, shift_rad: Floats) -> Row:
    """Return the row with some sweeps delayed by the time in which the rotor turns by an angle.

    Args:
        row: pulses of one craft.
        clock: the period on the craft's clock.
        struck: photodiodes and fans whose sweeps are delayed, (K, 2).
        shift_rad: angle of the delay, (K, 2) [rad].
    """
    fan, sweep = clock.fan(row), ~clock.flash(row)
    change = np.where(struck, shift_rad, 0.0)[row.photodiode, fan] * clock.period_s / (2 * np.pi) / clock.tick_s
    rise = row.rise + np.rint(np.where(sweep, change, 0.0)).astype(np.int64)
    return joined(row._replace(rise=rise), Row(*np.zeros((3, 0), dtype=np.int64)))


class Register:
    """A stuck photodiode's timing register: it keeps the sweeps of the first period in which it saw both fans."""

    def __init__(self) -> None:
        self._held: Row | None = None
        self._at_s = np.zeros(0)

    def stuck(self, row: Row, clock: Clock, photodiode: int) -> Row:
        """Return the row with one photodiode's sweeps replaced by those in the register.

        Args:
            row: pulses of one craft.
            clock: the period on the craft's clock.
            photodiode: index of the stuck photodiode.
        """
        own = of_photodiodes(row, (photodiode,)) & ~clock.flash(row)
        if self._held is None:
            now = only(row, own)
            if set(clock.fan(now).tolist()) != {0, 1}:
                return row
            self._held, self._at_s = now, clock.instant(now)
        repeated = clock.pulse(self._held.photodiode, self._at_s, self._held.width.astype(np.float64) * clock.tick_s)
        return joined(only(row, ~own), repeated)
