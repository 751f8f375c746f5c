"""Update of filters by rows of any stations: gated together, and searched for false ones where the gate refuses them.

Per craft, until one of these is accepted by the gate:

    all rows
    all rows with a wider prediction, if they agree with each other: a push that no model of motion has
    the rows without a false photodiode or station, if the others agree with the prediction
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import FilterBank, UpdateResult, gates
from estimators.filter.error_state import process_noise_into
from estimators.lighthouse.innovation import Innovations, RowBatch, innovations
from estimators.lighthouse.row_pose import RowPose
from estimators.lighthouse.row_screen import agreeing
from estimators.lighthouse.row_snooping import snooped
from estimators.lighthouse.row_sums import condense
from estimators.state import STATES
from swarm.onboard.inertial import Inertial, InertialLight
from swarm.onboard.known_stations import KnownStations
from swarm.onboard.place_errors import PlaceErrors
from swarm.onboard.row_counts import numbers
from swarm.onboard.row_separation import HARDER
from swarm.onboard.settings import NavigationSettings
from swarm.onboard.shared_errors import SharedErrors

HAND_HARDER = (4.0,)
"""Factors of the accelerations that a manoeuvre is taken to have, of a hand."""
_POSE = 6


class RowFate(NamedTuple):
    """Fate of the rows of C craft, (C,) each.

    fresh, refused: whether they went into the filter, or all were refused. nis: squared innovation normalised by its
    covariance. rows, photodiodes, stations: numbers in the filter. dropped: photodiodes left out as false, -1: none
    agreed. kept: the rows that went in, (N,). found: their innovations.
    """

    fresh: Bools
    refused: Bools
    nis: Floats
    rows: Ints
    photodiodes: Ints
    stations: Ints
    dropped: Ints
    kept: Bools
    found: Innovations | None = None


class RowUpdate:
    """Gives rows to the filters of C craft: `take_in`, and `give` to others that run beside them."""

    def __init__(
        self,
        settings: NavigationSettings,
        known: KnownStations,
        point_m: Floats,
        shared: SharedErrors,
        places: PlaceErrors,
        inertial: Inertial | None,
    ) -> None:
        """Begin.

        Args:
            settings: of every craft's navigation.
            known: the stations as the craft know them, in every period.
            point_m: (C, K, 3) [m], photodiodes in the body frames.
            shared: errors that filters of several craft share.
            places: errors of stations and photodiodes that no filter estimates.
            inertial: gyroscopes and accelerometers; None: there are none.
        """
        self._settings, self._known, self._point_m = settings, known, point_m
        self._shared, self._places, self._inertial = shared, places, inertial

    def take_in(
        self, rows: RowBatch, mask: Bools, pose: RowPose, bank: FilterBank, shown: InertialLight | None
    ) -> RowFate:
        """Update the filters of the craft of the mask with their rows.

        Args:
            rows: as used.
            mask: (C,).
            pose: of the rows alone.
            bank: the filters.
            shown: what gyroscopes and accelerometers showed.
        """
        known, s, craft, most = self._known, self._settings, len(mask), self._point_m.shape[1]
        mask = mask & bank.active
        kept = np.repeat(mask, np.diff(rows.first))
        fresh, refused = np.zeros((2, craft), dtype=np.bool_)
        number, photodiodes, stations, dropped = np.zeros((4, craft), dtype=np.int64)
        out = RowFate(fresh, refused, np.full(craft, np.nan), number, photodiodes, stations, dropped, kept)
        if s.hand is not None and s.integrity.residual_test:
            self._snoop(rows, mask, out, bank)
        found = self._update(rows, mask, out, bank)
        if out.refused.any():
            # The filters of refused rows are still at their predictions.
            before, covariance = bank.state, bank.covariance
            # Whom an accelerometer shows what pushes it is not pushed otherwise.
            told = np.zeros_like(mask) if shown is None else shown.known
            self._manoeuvre(rows, pose, out, found, ~told, bank)
        again = np.zeros(craft, dtype=np.bool_)
        for c in np.flatnonzero(out.refused & s.integrity.residual_test).tolist():
            own = rows.of(c)
            gate = gates(s.gate_probability, len(own.angle))
            places = self._shared.of_stations(c)
            keep = agreeing(own, known.packed, self._point_m[c], before.of(c), covariance[c], known.noise, gate, places)
            out.dropped[c] = -1
            if keep is not None:
                kept[rows.first[c] : rows.first[c + 1]] = keep
                seen = own.station * most + own.photodiode
                out.dropped[c] = len(np.unique(seen)) - len(np.unique(seen[keep]))
                again[c] = True
        if again.any():
            self._update(rows, again, out, bank, found)
        photodiodes[:], stations[:] = numbers(rows, kept & np.repeat(out.fresh, np.diff(rows.first)), most)
        return out._replace(found=found)

    def give(self, rows: RowBatch, kept: Bools, mask: Bools, bank: FilterBank, point_m: Floats) -> Bools:
        """Give kept rows to filters that run beside those of the craft; return whose were accepted.

        Args:
            rows: of the filters.
            kept: of the rows, (N,).
            mask: of the filters.
            bank: the filters.
            point_m: (filters, K, 3) [m], their photodiodes in the body frames.
        """
        found = innovations(rows, kept, mask, self._known.light, point_m, bank.state)
        asked = mask & (found.number > 0)
        return asked & _given(found, asked, bank)[0].accepted

    def _snoop(self, rows: RowBatch, mask: Bools, out: RowFate, bank: FilterBank) -> None:
        """Leave the rows of the craft of the mask out that contradict the others."""
        known, most = self._known, self._point_m.shape[1]
        state, covariance = bank.state, bank.covariance
        for c in np.flatnonzero(mask & (np.diff(rows.first) > 0)).tolist():
            own = rows.of(c)
            keep = snooped(own, known.packed, self._point_m[c], state.of(c), covariance[c], known.noise)
            out.kept[rows.first[c] : rows.first[c + 1]] = keep
            out.dropped[c] = len(np.unique((own.station * most + own.photodiode)[~keep]))

    def _manoeuvre(
        self, rows: RowBatch, pose: RowPose, out: RowFate, found: Innovations, mask: Bools, bank: FilterBank
    ) -> None:
        """Try again with a wider prediction where the rows agree with each other and not with it: the craft is pushed
        harder than its model has it. No photodiode is false then.
        """
        s = self._settings
        gate = gates(s.gate_probability, int(np.diff(rows.first).max()))
        agree = out.refused & pose.solved & mask
        agree[agree] &= pose.cost[agree] <= gate[np.maximum(pose.rows[agree] - _POSE, 0)]
        noise = np.empty((STATES, STATES))
        for factor in HARDER if s.hand is None else HAND_HARDER:
            again = agree & out.refused
            if not again.any():
                return
            process_noise_into(
                s.frame_s, factor * s.acceleration_noise_m_s2, factor * s.angular_acceleration_noise_rad_s2, noise
            )
            bank.adopt(again, bank.state, bank.covariance + noise)
            self._update(rows, again, out, bank, found)

    def _update(
        self, rows: RowBatch, mask: Bools, out: RowFate, bank: FilterBank, found: Innovations | None = None
    ) -> Innovations:
        """Give the kept rows of the craft of the mask to their filters, write their fate, and return their innovations.

        found: innovations of the other craft, updated; None: there are none yet.
        """
        known = self._known
        found = innovations(rows, out.kept, mask, known.light, self._point_m, bank.state, found)
        asked = mask & (found.number > 0)
        before = (bank.state, bank.covariance) if self._places.wanted or self._inertial is not None else None
        used = self._shared.with_bearers(found, rows, out.kept, asked)
        result, sums, angles = _given(used, asked, bank)
        out.fresh[asked], out.refused[asked] = result.accepted[asked], ~result.accepted[asked]
        out.nis[asked] = result.nis[asked]
        out.rows[asked] = np.where(result.accepted, angles, 0)[asked]
        if before is None:
            return found
        if self._places.wanted:
            self._places.rows(rows, out.kept, asked & result.accepted, before)
        if self._inertial is not None:
            for c in np.flatnonzero(asked & result.accepted).tolist():
                own = slice(sums.number[c])
                self._inertial.rows(c, sums.y[c, own], sums.h[c, own], bank, before[1][c])
        return found


def _given(found: Innovations, asked: Bools, bank: FilterBank) -> tuple[UpdateResult, Innovations, Ints]:
    """Give innovations to the filters of a mask; return their fate, what went in, and the numbers of rows, (C,)."""
    sums, angles = condense(found, asked, bank.covariance)
    return bank.update(asked, sums.y, sums.h, np.ones_like(sums.y), sums.number, sums.pivot, angles), sums, angles
