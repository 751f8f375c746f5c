"""Navigation of C craft by several stations: every sweep angle is a row of its own, of whatever station and generation.

Stations of different rotors share no period, so the filter has a clock of its own. Per period of it and craft, all to
its epoch:

    own orders and orbit -> prediction                         swarm.onboard.tracks
    rows of all stations -> filter, gated together             estimators.lighthouse.innovation
    rows that contradict the prediction, not each other -> filter, with a wider prediction
    rows that contradict each other -> without a false photodiode or station, if the others agree with it
    a craft without a filter -> search among all poses         swarm.onboard.row_search
    cameras -> pose with covariance                            swarm.onboard.ccd

The pose of a period's rows alone is solved as well; it is reported, and gives dilution of precision and protection
levels. A craft whose rows fit two poses has none. `swarm.onboard.navigation` is the same for one station whose pose is
solved first; both give the same `Estimate`.
"""

from collections.abc import Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import FilterBank, UpdateResult, gates
from estimators.filter.error_state import POSE_COLUMNS, process_noise_into
from estimators.filter.smoother import Prediction
from estimators.kernel import kernel
from estimators.lighthouse.dop import Dilution
from estimators.lighthouse.innovation import (
    Innovations,
    RowBatch,
    StationArrays,
    innovations,
    light_of,
    sigmas_into,
)
from estimators.lighthouse.integrity import AngleNoise, shown_to_gate
from estimators.lighthouse.pnp import PoseSolution
from estimators.lighthouse.row_faults import row_faults
from estimators.lighthouse.row_pose import RowPose, solve_rows
from estimators.lighthouse.row_screen import agreeing
from estimators.lighthouse.row_snooping import snooped
from estimators.lighthouse.row_sums import condense
from estimators.lighthouse.rows import Rows, Station, expect_into, packed, row_into
from estimators.state import STATES, State
from swarm.hardware import Photodiodes
from swarm.messages import Command, Signals
from swarm.onboard.ccd import CameraFix, CcdCalibration, CcdFix
from swarm.onboard.filters import tracks_of
from swarm.onboard.inertial import Inertial, InertialLight
from swarm.onboard.integrity import Integrity
from swarm.onboard.motion_search import MotionSearch
from swarm.onboard.mounts import Mount, Mounts
from swarm.onboard.navigation import Estimate
from swarm.onboard.place_errors import PlaceErrors
from swarm.onboard.reference_craft import ReferenceRows
from swarm.onboard.relative import RelativeNavigation
from swarm.onboard.rivals import CHOICE_RAD, CHOICE_RATIO
from swarm.onboard.row_counts import decides, numbers
from swarm.onboard.row_search import Found, RowSearch, scatter
from swarm.onboard.row_separation import HARDER, RowSeparation
from swarm.onboard.settings import Coupling, NavigationSettings, Sensor, status_codes
from swarm.onboard.shared_errors import SharedErrors
from swarm.onboard.tracks import Filtered, Motion, PoseFix, Taken, Tracks

HAND_HARDER = (4.0,)
"""Factors of the accelerations that a manoeuvre is taken to have, of a hand."""
STRANGE_SHARE, STRANGE_SIGMAS = 0.8, 6.0
"""Share of the innovations' squares that counts a period later, and by how many standard deviations their sum may
exceed what it should be."""
_POSE = 6
_TABLE = 32


class RowLight(NamedTuple):
    """Light of C craft in one period of the filter.

    rows: sweep angles of all stations. rejected: number of pulses that became no row, (C,). missed_sync: number of
    flashes that a craft expected and did not see, (C,). inertial: what its gyroscope and accelerometer showed.
    """

    rows: RowBatch
    rejected: Ints
    missed_sync: Ints
    inertial: InertialLight | None = None


class _Rowed(NamedTuple):
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


class StationNavigator:
    """The navigation computers of C craft before several stations: `step` takes one period's light.

    tracks: the filters. rows: those of the last period, of stations that ride on craft as if they stood still in it.
    """

    def __init__(
        self,
        photodiodes: Photodiodes,
        settings: NavigationSettings,
        stations: Sequence[Station],
        noise: Sequence[AngleNoise],
        cameras: Sequence[CcdCalibration] = (),
        inertia: Floats | None = None,
        mounts: Sequence[Mount] = (),
    ) -> None:
        """Start with craft whose own states are unknown.

        Args:
            photodiodes: layout that each craft assumes for itself.
            settings: settings of every craft's navigation; those of one station, its noise and its fans are not used.
            stations: all stations, with the errors of their fans as the craft know them.
            noise: noise of the rows of each.
            cameras: calibrations of the craft that carry a pair of cameras, in the order of their images.
            inertia: (C, 3, 3) [kg m^2], body frame, of craft that turn freely; NaN for the others; None: of none.
            mounts: stations that ride on craft, in the order of `Signals.bearers`.
        """
        s, craft = settings, photodiodes.craft_count
        self.settings, self._stations, self._noise = s, list(stations), list(noise)
        self._packed = packed(self._stations)
        self._light = light_of(self._packed, self._noise)
        self._point_m = np.ascontiguousarray(photodiodes.point_m)
        self.tracks = tracks_of(craft, s, inertia)
        self._search: RowSearch | MotionSearch
        if s.hand is None:
            self._search = RowSearch(self._point_m, self._stations, self._noise, s.frame_s, s.place_sigma_m)
        else:
            self._search = MotionSearch(self._point_m, self._stations, self._noise, s.frame_s, s.hand)
        self._cameras = CameraFix(cameras)
        self._mounts = Mounts(mounts, self._point_m, s.frame_s)
        self._shared = SharedErrors(s.relations, self._stations, self._noise, self._point_m, self._mounts.carried)
        self._places = PlaceErrors(s.places, self._stations, self._noise, photodiodes)
        self._inertial = None if s.inertial is None else Inertial(craft, s.inertial)
        self._relative = RelativeNavigation(s.relations, self._shared, s.integrity.risk)
        self._reference: ReferenceRows | None = None
        if s.reference:
            shared = s.relations.common_rad, s.relations.turn_s
            self._reference = ReferenceRows(s.reference, self._point_m, self._stations, self._noise, *shared)
        self._beside = RowSeparation(s, self._point_m, len(self._stations), inertia, by_rows=True)
        self._undecided, self._doubted = np.zeros((2, craft), dtype=np.bool_)
        self._strange = np.zeros((2, craft))
        # Nothing but light tells where a hand carries an object: whom it contradicts, is lost.
        self._any_refusal_counts = s.hand is not None and s.inertial is None
        self._held = np.zeros((2, craft))
        self._quantile = -float(ndtri(s.integrity.risk / 2))
        self._unit_rad = float(np.sqrt(np.mean([own**2 + shared**2 for own, shared in self._noise])))

    @property
    def stations(self) -> list[Station]:
        """The stations as the craft know them; those that ride on craft are replaced in every period."""
        return self._stations

    def _place(self) -> None:
        """Take stations to be where they are now."""
        self._packed = packed(self._stations)
        self._light = light_of(self._packed, self._noise)
        self._shared.place(self._stations)

    @property
    def photodiodes(self) -> int:
        """Number of photodiodes of a craft."""
        return int(self._point_m.shape[1])

    def expected_angles(self, craft: Ints, station: Ints, photodiode: Ints, offset_s: Floats) -> Floats:
        """Return where hits are expected at instants after the epoch to come, as `BeamDecoder.decode` asks for.

        Args:
            craft: (N,).
            station: (N,).
            photodiode: (N,).
            offset_s: (N,) [s].

        Returns:
            Angles of both planes, (N, 2) [rad].
        """
        out = np.empty((len(craft), 2))
        asked = craft, station, photodiode, offset_s + self.settings.frame_s
        expect_into(asked, self.tracks.bank.state, self._point_m, self._packed, out)
        return out

    def sigmas_away(self, craft: Ints, rows: Rows) -> Floats:
        """Return by how many standard deviations rows are off where craft expect them, (N,); NaN where they do not.

        Where stations or photodiodes may be off by what nobody knows, nobody knows how far off a row may be.

        Args:
            craft: of every row, (N,).
            rows: with their instants after the epoch to come.
        """
        out = np.full(len(craft), np.nan)
        bank, s = self.tracks.bank, self.settings
        if s.integrity.residual_test:
            later = rows._replace(offset_s=rows.offset_s + s.frame_s)
            motion = bank.state, bank.covariance
            sigmas_into(craft, later, self._light, self._point_m, motion, s.acceleration_noise_m_s2, out)
        return out

    def forget(self, mask: Bools) -> None:
        """Forget all results of the craft of the mask (C,), as after a restart of their computers."""
        self.tracks.forget(mask)
        self._beside.forget(mask)
        self._search.forget(mask)
        self._undecided[mask], self._held[:, mask] = False, 0.0
        self._doubted[mask], self._strange[:, mask] = False, 0.0

    def step(self, light: RowLight, signals: Signals | None = None, command: Command | None = None) -> Estimate:
        """Advance every craft by one period of the filter, to its epoch.

        Args:
            light: rows of every craft.
            signals: the other signals that the craft receive; required if any craft has cameras.
            command: orders of the craft to their actuators for this period.
        """
        tracks, shared, s = self.tracks, self._shared, self.settings
        prediction = self._predict(command, light.inertial)
        self._beside.begin(command)
        self.rows = light.rows
        if self._mounts:
            bearers = None if signals is None else signals.bearers
            self.rows = self._mounts.place(light.rows, bearers, self._stations, tracks)
            self._place()
        rows, rivals = self._usable(self.rows)
        self._gather(rows, light.inertial)
        lit = numbers(rows, np.ones(len(rows.angle), dtype=np.bool_), self._point_m.shape[1])
        pose = self._pose(rows, decides(*lit))
        fix = shared.placed(self._found(tracks), rows)
        taken = tracks.take_in(fix)
        shared.poses(lambda: rows, fix, taken, tracks.bank, alone=False)
        rowed = self._take_in(light._replace(rows=rows), ~fix.known, pose)
        shared.rows(rows, rowed.kept, rowed.fresh, tracks.bank)
        fixes, fates, seen = [fix], [taken], None
        if signals is not None and signals.images is not None:
            seen, camera = self._cameras.find(signals.images, tracks)
            fixes.append(camera)
            fates.append(tracks.take_in(camera))
            shared.poses(None, camera, fates[-1], tracks.bank)
            self._beside.pose(camera)
            seen = seen._replace(nis=fates[-1].nis)
        decided = decides(rowed.photodiodes, rowed.stations)
        if s.hand is not None:
            # One fan alone measures one angle of three.
            decided &= _fans(rows, rowed.kept & np.repeat(rowed.fresh, np.diff(rows.first))) > 1
            self._doubt(rows, rowed)
            decided &= ~self._doubted
        fresh, refused = (np.any([part[i] for part in fates], axis=0) for i in (0, 1))
        tracks.count(
            fresh | (rowed.fresh & decided),
            rowed.fresh & ~decided,
            # A few photodiodes that contradict the filter do not prove it wrong: it coasts.
            refused | (rowed.refused & (decides(*lit) | self._any_refusal_counts)),
        )
        shared.end(tracks.bank)
        self._beside.step(rows, rowed.kept, tracks.bank, self._give)
        used = light._replace(rows=rows, rejected=light.rejected + rivals)
        estimate = self._estimate(used, lit[0], pose, seen, list(zip(fixes, fates, strict=True)), rowed)
        if prediction is None:
            return estimate
        return estimate._replace(prediction=prediction.ended(tracks.bank, tracks.bank.active))

    def _usable(self, rows: RowBatch) -> tuple[RowBatch, Ints]:
        """Return the rows that go into the filters, and the number of `_chosen`'s that do not, (C,)."""
        rows, rivals = self._chosen(rows)
        rows = self._referred(rows)
        if not self.settings.motion_compensation:
            rows = rows._replace(offset_s=np.zeros_like(rows.offset_s))
        return rows, rivals

    def _predict(self, command: Command | None, shown: InertialLight | None) -> Prediction | None:
        """Predict every filter to the epoch, by orders and inertial sensors too; return what a smoother needs."""
        s, bank = self.settings, self.tracks.bank
        self._places.begin(bank, s.frame_s)
        if self._inertial is not None:
            self._inertial.begin(bank, s.frame_s)
        made = self._shared.predict(self.tracks, command, s.frame_s, history=s.history)
        if self._inertial is None or shown is None:
            return made
        return self._carried_on(self._inertial, shown, made)

    def _carried_on(self, inertial: Inertial, shown: InertialLight, made: Prediction | None) -> Prediction | None:
        """Move predictions on by what gyroscopes and accelerometers showed; return them as a smoother needs them."""
        s, bank = self.settings, self.tracks.bank
        hand = s.acceleration_noise_m_s2, s.angular_acceleration_noise_rad_s2
        coupling = inertial.carry(bank, shown, s.frame_s, hand)
        self._places.moved(coupling)
        if made is not None:
            made = made._replace(state=bank.state, covariance=bank.covariance, transition=coupling @ made.transition)
        self._doubted |= inertial.rates(bank, shown, self._places)
        return made

    def _chosen(self, rows: RowBatch) -> tuple[RowBatch, Ints]:
        """Return the rows without those that share photodiode and sweep, and the number of rows left out, (C,).

        Of several, the one that the track expects is kept, if it stands out as in `swarm.onboard.rivals`.
        """
        out, kept = np.zeros(len(self._point_m), dtype=np.int64), np.ones(len(rows.angle), dtype=np.bool_)
        bank = self.tracks.bank
        _choose(rows, self._light, self._point_m, bank.active, bank.state, kept, out)
        return (rows.where(kept) if out.any() else rows), out

    def _referred(self, rows: RowBatch) -> RowBatch:
        """Return the rows without the errors of their sweeps that reference craft have found, if there are any."""
        if self._reference is None:
            return rows
        found = self._reference.observe(rows)
        self._noise, self._light = found.noise, light_of(self._packed, found.noise)
        self._shared.assume(found.noise, found.common_rad, self._reference.point_m, found.used)
        return found.rows

    def _gather(self, rows: RowBatch, shown: InertialLight | None) -> None:
        """Keep the rows for a search, and for one of objects in hands what tells how much states contradict sensors."""
        inertial, hand = self._inertial, self.settings.hand
        if not isinstance(self._search, MotionSearch) or inertial is None or shown is None or hand is None:
            self._search.gather(rows)
        else:
            self._search.gather(rows, partial(inertial.cost, shown=shown, push_m_s2=hand.acceleration))

    def _pose(self, rows: RowBatch, decided: Bools) -> RowPose:
        """Return the poses of this period's rows alone, from the predictions, of the craft with a filter.

        With tight coupling none is asked for: a search alone solves poses.

        Args:
            rows: as used.
            decided: (C,), whether the rows decide a pose.
        """
        bank = self.tracks.bank
        mask = bank.active & decided & (self.settings.coupling != "tight")
        return solve_rows(rows, np.ones(len(rows.angle), dtype=np.bool_), mask, self._light, self._point_m, bank.state)

    def _found(self, tracks: Tracks) -> PoseFix:
        """Return the poses of the craft that search, where one is certain."""
        if isinstance(self._search, MotionSearch):
            return self._carried(self._search, tracks)
        craft, bank = len(self._point_m), tracks.bank
        active, lost = bank.active, tracks.lost(self.settings.search_again_s)
        known = np.zeros(craft, dtype=np.bool_)
        rotation, position = np.full((craft, 3, 3), np.nan), np.full((craft, 3), np.nan)
        covariance, coupling = np.full((2, craft, 6, 6), np.nan)
        for c in np.flatnonzero(lost | ~active).tolist():
            found = self._search.search(c)
            self._undecided[c] = found.undecided
            which = self._which(found, bank.state.of(c) if active[c] else None)
            if which is None or found.pose is None:
                continue
            known[c], self._undecided[c] = True, False
            rotation[c], position[c] = found.pose.rotation[which], found.pose.position[which]
            covariance[c] = found.pose.covariance[which] * scatter(found.pose, which)
            coupling[c] = found.pose.coupling[which]
            self._search.settle(c)
        sensor = np.full(craft, Sensor.LIGHTHOUSE, dtype=np.int64)
        # Searches take the craft to be at rest: what their motion does is in the coupling, also for a filter that runs.
        return PoseFix(known, rotation, position, covariance, coupling, coupling, sensor)

    def _carried(self, search: MotionSearch, tracks: Tracks) -> PoseFix:
        """Return the states of objects in hands: of those that search, and of those whose filter is wrong."""
        bank, lost = tracks.bank, tracks.lost(self.settings.search_again_s)
        active, state, covariance = bank.active, bank.state, bank.covariance
        known = np.zeros(len(active), dtype=np.bool_)
        for c in range(len(active)):
            if lost[c] or not active[c]:
                found = search.search(c)
                self._undecided[c] = found.undecided
            else:
                found = search.watched(c, state.of(c), covariance[c], doubted=bool(self._doubted[c]))
            if found.state is not None or found.confirmed or not active[c]:
                self._doubted[c], self._strange[:, c] = False, 0.0
            if found.state is None:
                continue
            known[c], self._undecided[c] = True, False
            for own, given in zip((*state, covariance), (*found.state, found.covariance), strict=True):
                own[c] = given
            if found.rows is not None:
                self._places.started(c, found.rows, state.of(c), covariance[c])
            if self._inertial is not None:
                self._inertial.started(c)
        sensor = np.full(len(active), Sensor.LIGHTHOUSE, dtype=np.int64)
        pose = covariance[:, POSE_COLUMNS[:, None], POSE_COLUMNS]
        still = np.zeros_like(pose)
        motion = Motion(state, covariance)
        return PoseFix(known, state.rotation, state.position, pose, still, still, sensor, motion=motion)

    @staticmethod
    def _which(found: Found, state: State | None) -> int | None:
        """Return the pose that a search has found, None if none is certain; a filter's prediction chooses."""
        if found.pose is None:
            return None
        if found.certain:
            return 0
        if state is None:
            return None
        return int(np.argmin(rot.angle_between(found.pose.rotation, state.rotation)))

    def _take_in(self, light: RowLight, mask: Bools, pose: RowPose) -> _Rowed:
        """Update the filters of the craft of the mask with their rows; `pose` of the rows alone."""
        rows, bank, craft, most = light.rows, self.tracks.bank, len(mask), self._point_m.shape[1]
        mask = mask & bank.active
        kept = np.repeat(mask, np.diff(rows.first))
        out = _Rowed(
            fresh=np.zeros(craft, dtype=np.bool_),
            refused=np.zeros(craft, dtype=np.bool_),
            nis=np.full(craft, np.nan),
            rows=np.zeros(craft, dtype=np.int64),
            photodiodes=np.zeros(craft, dtype=np.int64),
            stations=np.zeros(craft, dtype=np.int64),
            dropped=np.zeros(craft, dtype=np.int64),
            kept=kept,
        )
        if self.settings.hand is not None and self.settings.integrity.residual_test:
            self._snoop(rows, mask, out)
        found = self._update(rows, mask, out)
        if out.refused.any():
            # The filters of refused rows are still at their predictions.
            before, covariance = bank.state, bank.covariance
            # Whom an accelerometer shows what pushes it is not pushed otherwise.
            shown = np.zeros_like(mask) if light.inertial is None else light.inertial.known
            self._manoeuvre(rows, pose, out, found, ~shown)
        again = np.zeros(craft, dtype=np.bool_)
        for c in np.flatnonzero(out.refused & self.settings.integrity.residual_test).tolist():
            own = rows.of(c)
            gate = gates(self.settings.gate_probability, len(own.angle))
            places = self._shared.of_stations(c)
            keep = agreeing(own, self._packed, self._point_m[c], before.of(c), covariance[c], self._noise, gate, places)
            out.dropped[c] = -1
            if keep is not None:
                kept[rows.first[c] : rows.first[c + 1]] = keep
                seen = own.station * most + own.photodiode
                out.dropped[c] = len(np.unique(seen)) - len(np.unique(seen[keep]))
                again[c] = True
        if again.any():
            self._update(rows, again, out, found)
        photodiodes, stations = numbers(rows, kept & np.repeat(out.fresh, np.diff(rows.first)), most)
        out.photodiodes[:], out.stations[:] = photodiodes, stations
        return out._replace(found=found)

    def _doubt(self, rows: RowBatch, rowed: _Rowed) -> None:
        """Doubt filters of objects in hands whose innovations are too large over some periods, or whose mirror image
        is near before the only station that sees them; until a search or the watch has decided.
        """
        bank = self.tracks.bank
        assert isinstance(self._search, MotionSearch)
        state, covariance = bank.state, bank.covariance
        for c in np.flatnonzero(rowed.fresh & bank.active).tolist():
            self._strange[:, c] = STRANGE_SHARE * self._strange[:, c] + (rowed.nis[c], rowed.rows[c])
            square, number = self._strange[:, c]
            strange = square > number + STRANGE_SIGMAS * np.sqrt(2 * number)
            own = rows.of(c)
            self._doubted[c] |= strange or self._search.mirror_doubtful(c, own, state.of(c), covariance[c])

    def _snoop(self, rows: RowBatch, mask: Bools, out: _Rowed) -> None:
        """Leave the rows of the craft of the mask out that contradict the others."""
        bank, most = self.tracks.bank, self._point_m.shape[1]
        state, covariance = bank.state, bank.covariance
        for c in np.flatnonzero(mask & (np.diff(rows.first) > 0)).tolist():
            own = rows.of(c)
            keep = snooped(own, self._packed, self._point_m[c], state.of(c), covariance[c], self._noise)
            out.kept[rows.first[c] : rows.first[c + 1]] = keep
            out.dropped[c] = len(np.unique((own.station * most + own.photodiode)[~keep]))

    def _manoeuvre(self, rows: RowBatch, pose: RowPose, out: _Rowed, found: Innovations, mask: Bools) -> None:
        """Try again with a wider prediction where the rows agree with each other and not with it: the craft is pushed
        harder than its model has it. No photodiode is false then.
        """
        s, bank = self.settings, self.tracks.bank
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
            self._update(rows, again, out, found)

    def _update(self, rows: RowBatch, mask: Bools, out: _Rowed, found: Innovations | None = None) -> Innovations:
        """Give the kept rows of the craft of the mask to their filters, write their fate, and return their innovations.

        found: innovations of the other craft, updated; None: there are none yet.
        """
        bank = self.tracks.bank
        found = innovations(rows, out.kept, mask, self._packed, self._point_m, bank.state, self._noise, found)
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

    def _give(self, rows: RowBatch, kept: Bools, mask: Bools, bank: FilterBank) -> Bools:
        """Give rows to the separated filters; return whose were accepted."""
        found = innovations(rows, kept, mask, self._packed, self._beside.point_m, bank.state, self._noise)
        asked = mask & (found.number > 0)
        return asked & _given(found, asked, bank)[0].accepted

    def _estimate(
        self,
        light: RowLight,
        visible: Ints,
        pose: RowPose,
        seen: CcdFix | None,
        fixes: Sequence[tuple[PoseFix, Taken]],
        rowed: _Rowed,
    ) -> Estimate:
        """Return the estimate of the period.

        Args:
            light: with the rows as used, and those that shared photodiode and sweep among the rejected.
            visible: number of photodiodes that were seen, (C,).
            pose: of the rows alone.
            seen: results of the cameras.
            fixes: poses of all sensors and their fates, those of searches first.
            rowed: fate of the rows.
        """
        after, limit = self.tracks.filtered(), self.settings.residual_limit_rad
        alone = self._shared.alone(after.covariance)
        widened = self._places.widened(self._shared.widened(after.covariance))
        if self._inertial is not None:
            widened += self._inertial.of_biases()
        after = after._replace(covariance=widened)
        pose = pose._replace(solved=pose.solved & (pose.residual_rad < limit))
        integrity = self._integrity(light.rows, pose, rowed, after)
        relative = self._relative.step(after.active, after.state, alone, integrity.levels)
        sensor = np.where(rowed.fresh, Sensor.LIGHTHOUSE, Sensor.NONE)
        for fix, became in fixes:
            sensor = np.where(became.fresh, sensor | fix.sensor, sensor)
        coupling = np.where(fixes[0][1].fresh, Coupling.LOOSE, Coupling.NONE)
        return Estimate(
            status=status_codes(after.active, self._undecided, self.tracks.since_update_s, self.tracks.since_pose_s),
            visible=visible,
            pnp=_as_solution(pose),
            dilution=self._dilution(pose),
            rotation=after.state.rotation,
            position=after.state.position,
            angular_rate=after.state.angular_rate,
            velocity=after.state.velocity,
            covariance=after.covariance,
            nis=np.where(np.isfinite(rowed.nis), rowed.nis, fixes[0][1].nis),
            missed_sync=light.missed_sync,
            rejected=light.rejected,
            sensor=sensor.astype(np.int64),
            ccd=seen,
            integrity=integrity,
            coupling=np.where(rowed.fresh & after.active, Coupling.TIGHT, coupling).astype(np.int64),
            rows=rowed.rows,
            stations=rowed.stations,
            station_rows=_of_stations(light.rows, rowed, len(self._stations)),
            relative=relative,
        )

    def _dilution(self, pose: RowPose) -> Dilution:
        """Return the dilution of precision at the poses, for stations with the noise that they have on average."""
        craft, unit = len(pose.solved), self._unit_rad
        covariance = np.where(pose.solved[:, None, None], pose.covariance, np.nan) / unit**2
        turn, place = (np.trace(covariance[:, i : i + 3, i : i + 3], axis1=1, axis2=2) for i in (0, 3))
        none = np.full(craft, np.nan)
        return Dilution(covariance, np.degrees(np.sqrt(turn)), np.sqrt(place), pose.coupling, none, none)

    def _integrity(self, rows: RowBatch, pose: RowPose, rowed: _Rowed, after: Filtered) -> Integrity:
        """Return protection levels: of the noise, and of a false photodiode that the gate would have missed."""
        s, craft = self.settings.integrity, len(pose.solved)
        active, _, covariance = after
        self._held[:, ~active] = 0.0
        fresh = rowed.fresh & active
        if s.residual_test and rowed.found is not None and fresh.any():
            slopes = row_faults(rows, rowed.kept, fresh, rowed.found, self._light, covariance, np.zeros(craft))
            table = _shown(self.settings.gate_probability, s.missed_detection, int(rowed.rows.max()))
            missed = table[rowed.rows[fresh]]
            self._held[:, fresh] = missed * slopes[0, fresh], missed * np.degrees(slopes[1, fresh])
        with np.errstate(invalid="ignore"):
            spread = [np.sqrt(np.trace(covariance[:, i : i + 3, i : i + 3], axis1=1, axis2=2)) for i in (6, 0)]
            alone = [np.sqrt(np.trace(pose.covariance[:, i : i + 3, i : i + 3], axis1=1, axis2=2)) for i in (3, 0)]
        levels = np.empty((4, craft))
        for i, unit in enumerate((1.0, 180 / np.pi)):
            levels[i] = np.where(pose.solved, self._quantile * unit * alone[i] + self._held[i], np.nan)
            levels[2 + i] = self._quantile * unit * spread[i] + self._held[i]
        separated = self._beside.levels(self.tracks.bank, after, self.tracks.since_update_s)
        if separated is not None:
            # Sets of photodiodes take the place of the fault that the gate would have missed; a station does not.
            own = separated.levels if s.false_photodiodes else np.fmax(levels[2:], separated.levels)
            levels[2:] = np.where(active, own, np.nan)
        limits = s.alert_position_m, float(np.rad2deg(s.alert_attitude_rad))
        watched = [i for i, limit in enumerate(limits) if np.isfinite(limit)]
        alert = np.zeros(craft, dtype=np.bool_)
        for i in watched:
            alert |= ~(levels[2 + i] <= limits[i])
        return Integrity(rowed.dropped, levels[0], levels[1], levels[2], levels[3], alert, bool(watched))


def _given(found: Innovations, asked: Bools, bank: FilterBank) -> tuple[UpdateResult, Innovations, Ints]:
    """Give innovations to the filters of a mask; return their fate, what went in, and the numbers of rows, (C,)."""
    sums, angles = condense(found, asked, bank.covariance)
    return bank.update(asked, sums.y, sums.h, np.ones_like(sums.y), sums.number, sums.pivot, angles), sums, angles


def _shown(gate_probability: float, missed_detection: float, most: int) -> Floats:
    """Return the roots of the least noncentralities that the gate on 0, 1, ... rows does not miss, `most` or more."""
    return _shown_table(gate_probability, missed_detection, -(-most // _TABLE) * _TABLE)


@cache
def _shown_table(gate_probability: float, missed_detection: float, most: int) -> Floats:
    return np.sqrt(shown_to_gate(gates(gate_probability, most), missed_detection))


@kernel
def _choose(
    rows: RowBatch, light: StationArrays, point: Floats, active: Bools, state: State, kept: Bools, out: Ints
) -> None:
    """Take the rows that share photodiode and sweep off `kept` (N,), but for the one expected; write their numbers.

    out: (C,), number of rows left out. The rows of one sweep stand together.
    """
    unused = np.empty(STATES)
    for c in range(len(out)):
        begin = rows.first[c]
        while begin < rows.first[c + 1]:
            end = begin + 1
            while end < rows.first[c + 1] and (
                rows.station[end] == rows.station[begin]
                and rows.fan[end] == rows.fan[begin]
                and rows.sweep[end] == rows.sweep[begin]
            ):
                end += 1
            for r in range(begin, end):
                k, rivals, best, nearest, second = rows.photodiode[r], 0, -1, np.inf, np.inf
                for other in range(begin, end):
                    if rows.photodiode[other] != k:
                        continue
                    if other < r:
                        rivals = 0
                        break
                    rivals += 1
                if rivals < 2:
                    continue
                for other in range(r, end):
                    if rows.photodiode[other] != k:
                        continue
                    kept[other] = False
                    if not active[c]:
                        continue
                    s = rows.station[other]
                    away = abs(
                        row_into(
                            rows.offset_s[other],
                            rows.angle[other],
                            light.rotation[s],
                            light.position[s],
                            light.fans[light.first[s] + rows.fan[other]],
                            point[c, k],
                            state.rotation[c],
                            state.position[c],
                            state.velocity[c],
                            state.angular_rate[c],
                            unused,
                        )
                    )
                    if away < nearest:
                        best, nearest, second = other, away, nearest
                    elif away < second:
                        second = away
                out[c] += rivals
                if nearest <= CHOICE_RAD and nearest < CHOICE_RATIO * second:
                    kept[best] = True
                    out[c] -= 1
            begin = end


def _fans(rows: RowBatch, kept: Bools) -> Ints:
    """Return the number of fans that the kept rows of each craft come from, (C,)."""
    craft = np.repeat(np.arange(len(rows.first) - 1), np.diff(rows.first))
    pairs = np.unique(np.stack([craft, rows.station, rows.fan])[:, kept], axis=1)
    out: Ints = np.bincount(pairs[0], minlength=len(rows.first) - 1)
    return out


def _of_stations(rows: RowBatch, rowed: _Rowed, stations: int) -> Ints:
    """Return the number of rows of each station that went into each filter, (C, S)."""
    craft = np.repeat(np.arange(len(rowed.fresh)), np.diff(rows.first))
    used = rowed.kept & rowed.fresh[craft]
    count = np.bincount(craft[used] * stations + rows.station[used], minlength=len(rowed.fresh) * stations)
    out: Ints = count.reshape(len(rowed.fresh), stations)
    return out


def _as_solution(pose: RowPose) -> PoseSolution:
    """Return poses as those of a solver of one station."""
    rotation = np.where(pose.solved[:, None, None], pose.rotation, np.nan)
    position = np.where(pose.solved[:, None], pose.position, np.nan)
    cost = np.where(pose.solved, pose.residual_rad**2 * pose.rows, np.nan)
    return PoseSolution(
        rotation, position, pose.solved, pose.iterations, np.sqrt(cost / np.maximum(pose.rows, 1)), cost
    )
