"""Navigation of C craft side by side: prediction, the update with every sensor's pose, and the resulting estimate.

Per lighthouse period and craft, all to the epoch:

    own orders and orbit -> prediction              swarm.onboard.tracks
    lighthouse -> pose with covariance s^2 H         swarm.onboard.lighthouse_fix
               or its sweep angles, one by one       swarm.onboard.single_sweeps
    cameras -> pose with covariance                  swarm.onboard.ccd
    each pose -> EKF                                 estimators.filter

Every craft uses its own angles, layout and filter; no operation mixes rows of the craft axis.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import FilterBank
from estimators.filter.smoother import Prediction
from estimators.lidar.symmetry import Symmetry
from estimators.lighthouse.dop import Dilution
from estimators.lighthouse.innovation import RowBatch, rows_of_sweeps
from estimators.lighthouse.pnp import PoseSolution
from estimators.lighthouse.rows import Station
from estimators.lighthouse.sweep import lighthouse_1
from estimators.state import State
from swarm.hardware import Photodiodes
from swarm.messages import Command, Signals
from swarm.onboard.ccd import CameraFix, CcdCalibration, CcdFix
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.filters import filters, tracks_of
from swarm.onboard.integrity import Integrity
from swarm.onboard.lighthouse_fix import Light, LighthouseFix
from swarm.onboard.mirror_images import MirrorImages
from swarm.onboard.reference_craft import ReferenceCraft
from swarm.onboard.relative import RelativeNavigation, RelativePoses
from swarm.onboard.row_separation import RowSeparation
from swarm.onboard.separation import Separation
from swarm.onboard.settings import MIN_LIT, Coupling, NavigationSettings, Sensor, status_codes
from swarm.onboard.shared_errors import SharedErrors
from swarm.onboard.single_sweeps import SingleSweeps, SweepsTaken
from swarm.onboard.tracks import Filtered, PoseFix, Taken, Tracks

LIGHTHOUSE, LOOSE, TIGHT = int(Sensor.LIGHTHOUSE), int(Coupling.LOOSE), int(Coupling.TIGHT)
"""The codes as plain numbers, which NumPy takes at once."""


class Estimate(NamedTuple):
    """Estimates of C craft at one epoch; NaN where unknown.

    status: codes of `Status`, (C,). visible: number of photodiodes seen by both fans, (C,). pnp: this period's own
    poses. dilution: dilution of precision at those poses, or at the filter's prediction where there is none. rotation
    (C, 3, 3), position (C, 3) [m], angular_rate (C, 3) [rad/s], velocity (C, 3) [m/s] and covariance (C, 12, 12),
    ordered (attitude, angular rate, position, velocity): the filter's, in the lighthouse frame. nis: normalised
    innovation squared of this period's pose, or of its single sweeps, (C,). missed_sync, rejected: counts of the
    decoder, (C,). sensor: codes of `Sensor`, (C,). ccd: the cameras' results; None if no craft has any. integrity:
    integrity of the craft's own poses. coupling: codes of `Coupling`, (C,). rows: number of single sweeps in the
    filter, (C,). prediction: the filters before this period's measurements, where the settings ask for the history of
    the filter. stations: number of stations whose light went into the filter, (C,), station_rows: number of rows of
    each of S stations, (C, S); None with one station only.
    symmetry: of inspected craft whose shape is symmetric, by index; their pose means its whole class.
    relative: where named craft are to others; None without pairs.
    """

    status: Ints
    visible: Ints
    pnp: PoseSolution
    dilution: Dilution
    rotation: Floats
    position: Floats
    angular_rate: Floats
    velocity: Floats
    covariance: Floats
    nis: Floats
    missed_sync: Ints
    rejected: Ints
    sensor: Ints
    ccd: CcdFix | None
    integrity: Integrity
    coupling: Ints
    rows: Ints
    prediction: Prediction | None = None
    stations: Ints | None = None
    station_rows: Ints | None = None
    symmetry: Mapping[int, Symmetry] = MappingProxyType({})
    relative: RelativePoses | None = None

    @property
    def state(self) -> State:
        """The filter's state."""
        return State(
            rotation=self.rotation, position=self.position, velocity=self.velocity, angular_rate=self.angular_rate
        )


class Navigator:
    """The navigation computers of C craft: `step` takes one period's signals and returns each craft's estimate."""

    def __init__(
        self,
        photodiodes: Photodiodes,
        settings: NavigationSettings,
        cameras: Sequence[CcdCalibration] = (),
        inertia: Floats | None = None,
    ) -> None:
        """Start with craft whose own states are unknown.

        Args:
            photodiodes: layout that each craft assumes for itself (nominal or calibrated).
            settings: settings of every craft's navigation.
            cameras: calibrations of the craft that carry a pair of cameras, in the order of their images.
            inertia: (C, 3, 3) [kg m^2], body frame, of craft that turn freely; NaN for the others; None: of none.
        """
        s, craft = settings, photodiodes.craft_count
        self.settings = s
        self.tracks = tracks_of(craft, s, inertia)
        self._light = LighthouseFix(photodiodes.point_m, s)
        self._sweeps = SingleSweeps(photodiodes.point_m, s)
        self._images = MirrorImages(filters(craft, s, inertia), self.tracks, self._sweeps)
        self._cameras = CameraFix(cameras)
        station = Station(s.station.rotation, s.station.position, lighthouse_1(s.fan_x, s.fan_y))
        self._reference: ReferenceCraft | None = None
        if s.reference:
            fans, common = (s.fan_x, s.fan_y), s.relations.common_rad[0]
            self._reference = ReferenceCraft(s.reference, photodiodes.point_m, fans, s.noise, common)
        self._shared = SharedErrors(s.relations, [station], [s.noise], photodiodes.point_m)
        self._relative = RelativeNavigation(s.relations, self._shared, s.integrity.risk)
        by_rows = s.coupling == "tight"
        self._separation = Separation(s.integrity, photodiodes.present.shape, s.station.rotation, by_rows=by_rows)
        self._beside = RowSeparation(s, photodiodes.point_m, 1, inertia, by_rows=by_rows)
        self._beside_sweeps = SingleSweeps(self._beside.point_m, s)

    def forget(self, mask: Bools) -> None:
        """Forget all results of the craft of the mask (C,), as after a restart of their computers."""
        self.tracks.forget(mask)
        self._light.forget(mask)
        self._images.forget(mask)
        self._beside.forget(mask)

    def expected_angles(self, turn_s: float, craft: Ints | None = None) -> Floats:
        """Return the angles (N, K, 2) [rad] at which the next sweeps should meet the photodiodes, NaN without a track.

        turn_s: one turn of the rotor [s]. craft: (N,), the craft that are asked for; None: all.
        """
        return self._light.expected(self.tracks, turn_s, craft)

    def step(self, angles: SweepAngles, signals: Signals | None = None, command: Command | None = None) -> Estimate:
        """Advance every craft by one lighthouse period, to the epoch of `angles`.

        Args:
            angles: sweep angles from every craft's decoder.
            signals: the other signals that the craft receive; required if any craft has cameras.
            command: orders of the craft to their actuators for this period, from its beginning to its end.
        """
        tracks, shared, s = self.tracks, self._shared, self.settings
        angles = self._referred(angles)
        self._separation.begin(tracks.bank, s.frame_s)
        prediction = shared.predict(tracks, command, s.frame_s, history=s.history)
        self._images.predict(command)
        self._beside.begin(command)
        open_before = self._images.open
        light, fix = self._light.find(angles, tracks, open_before)
        fixes, taken = [fix], [tracks.take_in(fix)]
        shared.poses(lambda: self._solved_from(angles, light), fix, taken[0], tracks.bank)
        self._separation.poses(fix, taken[0], tracks.bank, separated=True)
        before = tracks.bank.covariance if self._separation.wanted else None
        sweeps = self._single(angles, light, fix, tracks)
        if before is not None:
            self._separation.rows(sweeps.fresh, before, tracks.bank)
        self._images.step(sweeps)
        self._images.start(self._light.pairs)
        shared.rows(sweeps.batch, sweeps.kept, sweeps.fresh, tracks.bank)
        seen = None
        if signals is not None and signals.images is not None:
            seen, fix = self._cameras.find(signals.images, tracks)
            fixes.append(fix)
            taken.append(tracks.take_in(fix))
            shared.poses(None, fix, taken[-1], tracks.bank)
            self._separation.poses(fix, taken[-1], tracks.bank, separated=False)
            self._beside.pose(fix)
            seen = seen._replace(nis=taken[-1].nis)
        pose, refused, decided = taken[0].fresh, taken[0].refused, sweeps.decided
        for more in taken[1:]:
            pose, refused = pose | more.fresh, refused | more.refused
        tracks.count(
            pose | decided,
            sweeps.fresh & ~decided,
            # Three photodiodes that contradict the filter do not prove it wrong: it coasts.
            refused | (sweeps.refused & (light.visible >= MIN_LIT)),
        )
        shared.end(tracks.bank)
        self._beside.step(sweeps.batch, sweeps.kept, tracks.bank, self._give)
        estimate = self._estimate(angles, light, seen, fixes, taken, sweeps)
        if prediction is None:
            return estimate
        # A filter that was stopped in this period has no estimate that could be smoothed, nor one that was two.
        return estimate._replace(prediction=prediction.ended(tracks.bank, tracks.bank.active & ~open_before))

    def _referred(self, angles: SweepAngles) -> SweepAngles:
        """Return the angles without the errors of their sweeps that a reference craft has found, if there is one."""
        if self._reference is None:
            return angles
        found = self._reference.observe(angles)
        s = self.settings
        noise = s.noise if found is None else found.noise
        self._light.assume(noise)
        self._sweeps.assume(noise)
        self._beside_sweeps.assume(noise)
        if found is None:
            self._shared.assume([noise], s.relations.common_rad)
            return angles
        self._shared.assume([noise], [found.common_rad], self._reference.point_m, found.used)
        return found.taken_off(angles)

    def _solved_from(self, angles: SweepAngles, light: Light) -> RowBatch:
        """Return the sweep angles that this period's poses were solved from, as rows."""
        instants = angles.offset_s if self.settings.motion_compensation else np.zeros_like(angles.offset_s)
        return rows_of_sweeps(np.where(light.screened.lit[..., None], light.theta, np.nan), instants)

    def _single(self, angles: SweepAngles, light: Light, fix: PoseFix, tracks: Tracks) -> SweepsTaken:
        """Update the filters whose craft use single sweeps in this period."""
        without = ~fix.known & (self.settings.coupling != "loose")
        return self._sweeps.take_in(light.theta, angles.offset_s, without, tracks)

    def _give(self, rows: RowBatch, kept: Bools, mask: Bools, bank: FilterBank) -> Bools:
        """Give rows to the separated filters; return whose were accepted."""
        return mask & self._beside_sweeps.give(rows, kept, mask, bank)[0].accepted

    def _integrity(self, light: Light, taken: Taken, sweeps: SweepsTaken, after: Filtered) -> Integrity:
        """Return the integrity of poses and filters; rows of as many photodiodes as decide a pose count as one."""
        pose = taken._replace(fresh=taken.fresh | sweeps.decided)
        self._separation.end(light.linear, taken.fresh, after, self._light.own_rad)
        since_s, fault = self.tracks.since_update_s, sweeps.fault
        if self._beside.wanted:
            # Each photodiode is missing in a filter of its own, also among single sweeps.
            separated, fault = self._beside.levels(self.tracks.bank, after, since_s), np.zeros_like(fault)
        else:
            separated = self._separation.levels(after, since_s)
        found = self._light.levels(light, pose, after, fault, separated)
        if not sweeps.dropped.any():
            return found
        return found._replace(dropped=np.where(sweeps.dropped != 0, sweeps.dropped, found.dropped))

    def _estimate(
        self,
        angles: SweepAngles,
        light: Light,
        seen: CcdFix | None,
        fixes: Sequence[PoseFix],
        taken: Sequence[Taken],
        sweeps: SweepsTaken,
    ) -> Estimate:
        after = self._images.reported(self.tracks.filtered())
        alone = after.covariance
        after = after._replace(covariance=self._shared.widened(alone))
        integrity = self._integrity(light, taken[0], sweeps, after)
        relative: RelativePoses | None = None
        if self._relative.wanted:
            relative = self._relative.step(after.active, after.state, alone, integrity.levels)
        sensor = sweeps.fresh * LIGHTHOUSE
        for fix, became in zip(fixes, taken, strict=True):
            sensor |= became.fresh * fix.sensor
        coupling = taken[0].fresh * LOOSE
        coupling[sweeps.fresh & after.active] = TIGHT
        ambiguous = self._light.undecided | self._images.hidden
        return Estimate(
            status=status_codes(after.active, ambiguous, self.tracks.since_update_s, self.tracks.since_pose_s),
            visible=light.visible,
            pnp=light.screened.solution,
            dilution=light.dilution,
            rotation=after.state.rotation,
            position=after.state.position,
            angular_rate=after.state.angular_rate,
            velocity=after.state.velocity,
            covariance=after.covariance,
            nis=taken[0].nis if sweeps.batch is None else np.where(np.isfinite(sweeps.nis), sweeps.nis, taken[0].nis),
            missed_sync=angles.missed_sync,
            rejected=angles.rejected,
            sensor=sensor,
            ccd=seen,
            integrity=integrity,
            coupling=coupling,
            rows=sweeps.rows,
            relative=relative,
        )
