"""Protection levels by separation of solutions where sweep angles go into the filter row by row.

Beside a craft's filter run others, one per set S of rows that may be false all the time: those of one station, of one
photodiode, or of two. Each takes in the craft's rows but those of its set, from a prediction of its own. If S is false
and nothing else, what it tells is right, so that

    |x - x_S| + K sqrt(tr P_S)                      max over all sets, and K sqrt(tr P)

bounds the error of the craft's own filter (Brown and McBurney 1988), whatever S does. Poses of one lighthouse need no
filter beside (`swarm.onboard.separation`).

Such a filter starts where the craft's own one is, of which it must know nothing: with a covariance so wide that the
first light forgets it. Until rows without S have decided a pose it bounds nothing.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import FilterBank
from estimators.filter.error_state import process_noise_into
from estimators.lighthouse.innovation import RowBatch
from estimators.lighthouse.separation import sets_of
from estimators.state import STATES, State
from swarm.messages import Command
from swarm.onboard.filters import tracks_of
from swarm.onboard.integrity import Separated
from swarm.onboard.row_counts import decides, numbers
from swarm.onboard.separation import ATTITUDE, POSITION
from swarm.onboard.settings import NavigationSettings
from swarm.onboard.tracks import Filtered, PoseFix

WIDE = np.diag(np.repeat([0.1, 1.0, 0.1, 1.0], 3) ** 2)
"""Covariance of a filter that starts."""
HARDER = (4.0, 16.0, 64.0)
"""Factors of the accelerations that a manoeuvre is taken to have, tried one after the other."""

Give = Callable[[RowBatch, Bools, Bools, FilterBank], Bools]
"""Gives the kept rows of the craft of a mask to filters; returns whose were accepted."""


class RowSets(NamedTuple):
    """Sets of rows that may be false, S in all: station (S,), its index, or -1; photodiodes (S, 2), or -1."""

    station: Ints
    photodiodes: Ints

    @classmethod
    def of(cls, stations: int, photodiodes: int, settings: NavigationSettings) -> "RowSets":
        """Return the sets that the settings of the integrity ask for.

        Args:
            stations: number of stations.
            photodiodes: largest number of photodiodes of a craft.
            settings: settings of the navigation.
        """
        asked = settings.integrity
        single = np.arange(stations if asked.false_stations else 0, dtype=np.int64)
        points = sets_of(photodiodes, asked.false_photodiodes) if asked.false_photodiodes else sets_of(0, 1)
        station = np.concatenate([single, np.full(len(points), -1, dtype=np.int64)])
        return cls(station, np.concatenate([np.full((len(single), 2), -1, dtype=np.int64), points]))


class RowSeparation:
    """The separated filters of C craft: `begin` with every prediction, `step` with the rows, `levels`. wanted: whether
    the settings ask for any; if not, nothing is done.
    """

    def __init__(
        self, settings: NavigationSettings, point_m: Floats, stations: int, inertia: Floats | None, *, by_rows: bool
    ) -> None:
        """Begin with filters that have not been started.

        Args:
            settings: of the navigation.
            point_m: (C, K, 3) [m], photodiodes in the body frames.
            stations: number of stations.
            inertia: (C, 3, 3) [kg m^2] of craft that turn freely; NaN for the others; None: of none.
            by_rows: whether all light goes into the filters row by row.
        """
        s, self._craft = settings, len(point_m)
        self._sets = RowSets.of(stations, point_m.shape[1], s)
        self._size = len(self._sets.station) if by_rows else 0
        self.wanted = self._size > 0
        self._settings, self._quantile = s, -float(ndtri(s.integrity.risk / 2))
        self._unseen = s.integrity.unseen_acceleration_m_s2, s.integrity.unseen_angular_acceleration_rad_s2
        self.point_m = np.ascontiguousarray(np.repeat(point_m, self._size, axis=0))
        if not self.wanted:
            return
        self._source = np.repeat(np.arange(self._craft), self._size)
        turning = None if inertia is None else np.repeat(inertia, self._size, axis=0)
        self._tracks = tracks_of(len(self.point_m), s, turning)
        self._decided, self._posed = np.zeros((2, len(self.point_m)), dtype=np.bool_)
        self._push = [np.empty((STATES, STATES)) for _ in HARDER]
        for factor, out in zip(HARDER, self._push, strict=True):
            linear, angular = s.acceleration_noise_m_s2, s.angular_acceleration_noise_rad_s2
            process_noise_into(s.frame_s, factor * linear, factor * angular, out)

    def forget(self, mask: Bools) -> None:
        """Forget the filters of the craft of the mask (C,)."""
        if self.wanted:
            self._tracks.forget(np.repeat(mask, self._size))

    def begin(self, command: Command | None) -> None:
        """Predict every filter to the next epoch; `command` has the orders of the C craft, if known."""
        if self.wanted:
            orders = None if command is None else command.of(self._source)
            self._tracks.predict(orders)

    def pose(self, fix: PoseFix) -> None:
        """Give poses of a sensor that none of the sets spoils, such as cameras, to all filters."""
        if self.wanted:
            parts = (np.repeat(p, self._size, axis=0) if isinstance(p, np.ndarray) else p for p in fix)
            known = PoseFix._make(parts)
            taken = self._tracks.take_in(known._replace(known=known.known & self._tracks.bank.active))
            self._posed = taken.fresh

    def step(self, rows: RowBatch | None, kept: Bools, bank: FilterBank, give: Give) -> None:
        """Give a period's rows to the filters, each without those of its set, and start those of craft that have one.

        Args:
            rows: of the C craft; None: none.
            kept: (N,), those that the craft's own filters have used, or refused all together. What they left out as
                false the others try first: one of them holds that it is the rest that is.
            bank: the craft's own filters afterwards.
            give: gives rows of C S craft, numbered as `point_m`, to filters.
        """
        if not self.wanted:
            return
        own, active = self._tracks.bank, np.repeat(bank.active, self._size)
        own.stop(own.active & ~active)
        self._decided &= own.active
        accepted, refused = np.zeros((2, len(active)), dtype=np.bool_)
        decided = np.zeros_like(accepted)
        if rows is not None:
            many, others, agreed = self._without(rows, kept)
            number, sources = numbers(many, others, self.point_m.shape[1])
            decided, asked = decides(number, sources), own.active & (number > 0)
            accepted = give(many, others.copy(), asked, own)
            refused = asked & ~accepted
            if refused.any():
                # Something beside its set is false, or the craft is pushed.
                number, sources = numbers(many, agreed, self.point_m.shape[1])
                decided = np.where(accepted, decided, decides(number, sources))
                refused &= number > 0
                found = give(many, agreed.copy(), refused, own)
                accepted, refused = accepted | found, refused & ~found
            for noise in self._push:
                if not (again := refused & decided).any():
                    break
                own.adopt(again, own.state, own.covariance + noise)
                found = give(many, agreed.copy(), again, own)
                accepted, refused = accepted | found, refused & ~found
        posed, self._posed = self._posed, np.zeros_like(self._posed)
        self._decided |= (accepted & decided) | posed
        self._tracks.count((accepted & decided) | posed, accepted & ~decided, refused & decided)
        self._decided &= own.active
        if (fresh := active & ~own.active).any():
            state = State._make(np.repeat(part, self._size, axis=0) for part in bank.state)
            own.adopt(fresh, state, np.tile(WIDE, (len(fresh), 1, 1)))
            self._tracks.count(fresh, ~active, ~active)

    def _without(self, rows: RowBatch, kept: Bools) -> tuple[RowBatch, Bools, Bools]:
        """Return the rows of every filter beside, the mask of those that are not of its set, and of those of them that
        are kept.
        """
        size, count = self._size, np.repeat(np.diff(rows.first), self._size)
        first = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
        which = np.arange(first[-1]) - np.repeat(first[:-1] - np.repeat(rows.first[:-1], size), count)
        many = RowBatch._make((first, *(np.ascontiguousarray(part[which]) for part in rows[1:])))
        of_set = np.repeat(np.tile(np.arange(size), self._craft), count)
        false = many.station == self._sets.station[of_set]
        false |= (many.photodiode[:, None] == self._sets.photodiodes[of_set]).any(axis=1)
        return many, ~false, ~false & kept[which]

    def levels(self, bank: FilterBank, after: Filtered, since_update_s: Floats) -> Separated | None:
        """Return the protection levels of the craft's filters, infinite where a set tells nothing; None: not wanted.

        Args:
            bank: the craft's own filters.
            after: the same, with everything in their covariances that craft consider.
            since_update_s: (C,), time without light [s].
        """
        if not self.wanted:
            return None
        beside, shape = self._tracks.filtered(), (self._craft, self._size)
        own = Filtered(after.active, bank.state, bank.covariance)
        away = np.stack([_apart(own, beside, self._size), _turned(own, beside, self._size)])
        out, parts = np.empty((2, self._craft)), (POSITION, ATTITUDE)
        for i, part in enumerate(parts):
            total, alone, other = (_trace(f.covariance, part) for f in (after, own, beside))
            # What craft consider beside their filters is in every solution.
            wider = np.maximum(total - alone, 0.0)[:, None] + other.reshape(shape)
            level = away[i] + self._quantile * np.sqrt(wider)
            level = np.where((beside.active & self._decided).reshape(shape), level, np.inf)
            out[i] = np.maximum(self._quantile * np.sqrt(total), level.max(axis=1))
        out += np.outer(self._unseen, since_update_s**2 / 2)
        out[1] = np.degrees(out[1])
        return Separated(out, np.asarray(after.active.copy(), dtype=np.bool_))


def _trace(covariance: Floats, part: slice) -> Floats:
    out: Floats = np.trace(covariance[:, part, part], axis1=1, axis2=2)
    return out


def _apart(own: Filtered, beside: Filtered, size: int) -> Floats:
    away = beside.state.position.reshape(-1, size, 3) - own.state.position[:, None]
    out: Floats = np.linalg.norm(away, axis=2)
    return out


def _turned(own: Filtered, beside: Filtered, size: int) -> Floats:
    """Return the angles (C, S) [rad] between attitudes; of small ones the sine of half of them is what is left."""
    other = beside.state.rotation.reshape(-1, size, 3, 3)
    half = np.linalg.norm(other - own.state.rotation[:, None], axis=(2, 3)) / np.sqrt(8)
    out: Floats = 2 * np.arcsin(np.minimum(half, 1.0))
    return out
