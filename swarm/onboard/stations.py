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
from functools import partial
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.filter.error_state import POSE_COLUMNS
from estimators.filter.smoother import Prediction
from estimators.lighthouse.dop import Dilution
from estimators.lighthouse.innovation import (
    RowBatch,
    sigmas_into,
)
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.pnp import PoseSolution
from estimators.lighthouse.row_pose import RowPose, solve_rows
from estimators.lighthouse.rows import Rows, Station, expect_into
from estimators.state import State
from swarm.hardware import Photodiodes
from swarm.messages import Command, Signals
from swarm.onboard.ccd import CameraFix, CcdCalibration, CcdFix
from swarm.onboard.filters import tracks_of
from swarm.onboard.inertial import Inertial, InertialLight
from swarm.onboard.known_stations import KnownStations
from swarm.onboard.motion_search import MotionSearch
from swarm.onboard.mounts import Mount, Mounts
from swarm.onboard.navigation import Estimate
from swarm.onboard.place_errors import PlaceErrors
from swarm.onboard.reference_craft import ReferenceRows
from swarm.onboard.relative import RelativeNavigation
from swarm.onboard.rival_rows import chosen
from swarm.onboard.row_counts import decides, numbers
from swarm.onboard.row_levels import RowLevels
from swarm.onboard.row_search import Found, RowSearch, scatter
from swarm.onboard.row_separation import RowSeparation
from swarm.onboard.row_update import RowFate, RowUpdate
from swarm.onboard.settings import Coupling, NavigationSettings, Sensor, status_codes
from swarm.onboard.shared_errors import SharedErrors
from swarm.onboard.tracks import Motion, PoseFix, Taken, Tracks

STRANGE_SHARE, STRANGE_SIGMAS = 0.8, 6.0
"""Share of the innovations' squares that counts a period later, and by how many standard deviations their sum may
exceed what it should be."""


class RowLight(NamedTuple):
    """Light of C craft in one period of the filter.

    rows: sweep angles of all stations. rejected: number of pulses that became no row, (C,). missed_sync: number of
    flashes that a craft expected and did not see, (C,). inertial: what its gyroscope and accelerometer showed.
    """

    rows: RowBatch
    rejected: Ints
    missed_sync: Ints
    inertial: InertialLight | None = None


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
        known = KnownStations(stations, noise)
        self.settings, self._known = s, known
        self._point_m = np.ascontiguousarray(photodiodes.point_m)
        self.tracks = tracks_of(craft, s, inertia)
        self._search: RowSearch | MotionSearch
        if s.hand is None:
            self._search = RowSearch(self._point_m, known.stations, known.noise, s.frame_s, s.place_sigma_m)
        else:
            self._search = MotionSearch(self._point_m, known.stations, known.noise, s.frame_s, s.hand)
        self._cameras = CameraFix(cameras)
        self._mounts = Mounts(mounts, self._point_m, s.frame_s)
        self._shared = SharedErrors(s.relations, known.stations, known.noise, self._point_m, self._mounts.carried)
        self._places = PlaceErrors(s.places, known.stations, known.noise, photodiodes)
        self._inertial = None if s.inertial is None else Inertial(craft, s.inertial)
        self._relative = RelativeNavigation(s.relations, self._shared, s.integrity.risk)
        self._reference: ReferenceRows | None = None
        if s.reference:
            shared = s.relations.common_rad, s.relations.turn_s
            self._reference = ReferenceRows(s.reference, self._point_m, known.stations, known.noise, *shared)
        self._beside = RowSeparation(s, self._point_m, len(known.stations), inertia, by_rows=True)
        self._update = RowUpdate(s, known, self._point_m, self._shared, self._places, self._inertial)
        self._levels = RowLevels(s, craft)
        self._undecided, self._doubted = np.zeros((2, craft), dtype=np.bool_)
        self._strange = np.zeros((2, craft))
        # Nothing but light tells where a hand carries an object: whom it contradicts, is lost.
        self._any_refusal_counts = s.hand is not None and s.inertial is None
        self._unit_rad = float(np.sqrt(np.mean([own**2 + shared**2 for own, shared in known.noise])))

    @property
    def stations(self) -> list[Station]:
        """The stations as the craft know them; those that ride on craft are replaced in every period."""
        return self._known.stations

    @property
    def noise(self) -> list[AngleNoise]:
        """Noise of the rows of each station, as the craft know it."""
        return self._known.noise

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
        expect_into(asked, self.tracks.bank.state, self._point_m, self._known.packed, out)
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
            sigmas_into(craft, later, self._known.light, self._point_m, motion, s.acceleration_noise_m_s2, out)
        return out

    def forget(self, mask: Bools) -> None:
        """Forget all results of the craft of the mask (C,), as after a restart of their computers."""
        self.tracks.forget(mask)
        self._beside.forget(mask)
        self._search.forget(mask)
        self._levels.forget(mask)
        self._undecided[mask] = self._doubted[mask] = False
        self._strange[:, mask] = 0.0

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
            self.rows = self._mounts.place(light.rows, bearers, self._known.stations, tracks)
            self._known.place()
            self._shared.place(self._known.stations)
        rows, rivals = self._usable(self.rows)
        self._gather(rows, light.inertial)
        lit = numbers(rows, np.ones(len(rows.angle), dtype=np.bool_), self._point_m.shape[1])
        pose = self._pose(rows, decides(*lit))
        fix = shared.placed(self._found(tracks), rows)
        taken = tracks.take_in(fix)
        shared.poses(lambda: rows, fix, taken, tracks.bank, alone=False)
        rowed = self._update.take_in(rows, ~fix.known, pose, tracks.bank, light.inertial)
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
        give = partial(self._update.give, point_m=self._beside.point_m)
        self._beside.step(rows, rowed.kept, tracks.bank, give)
        used = light._replace(rows=rows, rejected=light.rejected + rivals)
        estimate = self._estimate(used, lit[0], pose, seen, list(zip(fixes, fates, strict=True)), rowed)
        if prediction is None:
            return estimate
        return estimate._replace(prediction=prediction.ended(tracks.bank, tracks.bank.active))

    def _usable(self, rows: RowBatch) -> tuple[RowBatch, Ints]:
        """Return the rows that go into the filters, and the number of rivals of one sweep that do not, (C,)."""
        bank = self.tracks.bank
        rows, rivals = chosen(rows, self._known.light, self._point_m, bank.active, bank.state)
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

    def _referred(self, rows: RowBatch) -> RowBatch:
        """Return the rows without the errors of their sweeps that reference craft have found, if there are any."""
        if self._reference is None:
            return rows
        found = self._reference.observe(rows)
        self._known.assume(found.noise)
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
        return solve_rows(
            rows, np.ones(len(rows.angle), dtype=np.bool_), mask, self._known.light, self._point_m, bank.state
        )

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

    def _doubt(self, rows: RowBatch, rowed: RowFate) -> None:
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

    def _estimate(
        self,
        light: RowLight,
        visible: Ints,
        pose: RowPose,
        seen: CcdFix | None,
        fixes: Sequence[tuple[PoseFix, Taken]],
        rowed: RowFate,
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
            widened = widened + self._inertial.of_biases()
        after = after._replace(covariance=widened)
        pose = pose._replace(solved=pose.solved & (pose.residual_rad < limit))
        separated = self._beside.levels(self.tracks.bank, after, self.tracks.since_update_s)
        integrity = self._levels.step(light.rows, self._known.light, pose, rowed, after, separated)
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
            station_rows=_of_stations(light.rows, rowed, len(self._known.stations)),
            relative=relative,
        )

    def _dilution(self, pose: RowPose) -> Dilution:
        """Return the dilution of precision at the poses, for stations with the noise that they have on average."""
        craft, unit = len(pose.solved), self._unit_rad
        covariance = np.where(pose.solved[:, None, None], pose.covariance, np.nan) / unit**2
        turn, place = (np.trace(covariance[:, i : i + 3, i : i + 3], axis1=1, axis2=2) for i in (0, 3))
        none = np.full(craft, np.nan)
        return Dilution(covariance, np.degrees(np.sqrt(turn)), np.sqrt(place), pose.coupling, none, none)


def _fans(rows: RowBatch, kept: Bools) -> Ints:
    """Return the number of fans that the kept rows of each craft come from, (C,)."""
    craft = np.repeat(np.arange(len(rows.first) - 1), np.diff(rows.first))
    pairs = np.unique(np.stack([craft, rows.station, rows.fan])[:, kept], axis=1)
    out: Ints = np.bincount(pairs[0], minlength=len(rows.first) - 1)
    return out


def _of_stations(rows: RowBatch, rowed: RowFate, stations: int) -> Ints:
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
