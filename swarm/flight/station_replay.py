"""Replay of the light that one object saw of several stations, of either generation, by the code of simulated craft.

The stations' poses and calibrations come from a file of stations, from libsurvive's configuration or a Crazyflie's
system-config.yaml beside the recording, or from the recording's own lines. A station of which no pose is known is left
out; with one station alone, its frame is the world.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.row_motion import HandMotion
from estimators.lighthouse.sweep import FanErrors
from estimators.lighthouse.tilted import TiltedErrors
from estimators.state import State
from swarm.assets import find_model
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.flight.recordings.crazyflie import GRAVITY
from swarm.flight.recordings.libsurvive import WorldPose
from swarm.flight.recordings.object_light import ObjectLight
from swarm.flight.recordings.row_consistency import RowConsistency, RowSample, assess_rows
from swarm.flight.recordings.row_likelihood import Likely, likely
from swarm.flight.recordings.row_windows import RowWindow, RowWindows
from swarm.flight.recordings.stations_file import PlacedStation, PlacedStations
from swarm.hardware import Photodiodes
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.inertial import InertialSensors
from swarm.onboard.own_navigators import Rowed
from swarm.onboard.place_errors import PlaceSigma
from swarm.onboard.settings import NavigationSettings
from swarm.onboard.stations import StationNavigator
from swarm.results.filter_history import keeps_history
from swarm.results.period import Period
from swarm.results.records import Peer
from swarm.results.scene import Scene, StationScene
from swarm.scenario import Scenario
from swarm.sensors.sight import Sight
from swarm.units import ARCSEC
from swarm.world.craft import visuals

FRAME_S = {"1.0": 1 / 30, "2.0": 1 / 50}
"""Period of the filter [s] by generation, in which all stations sweep once."""
HANDLED: dict[str, float] = {
    "acceleration_noise_m_s2": 15.0,
    "angular_acceleration_noise_deg_s2": 2000.0,
    "coast_limit_s": 0.2,
}
"""Settings of navigation for an object that a hand moves, where the user gives no other and the recording does not tell
them: within a fifth of a second in the dark a hand takes it half a metre from where it was going."""
AT_REST_M_S2 = 1.0
"""Random acceleration of an object up to which it is at rest [m/s^2]."""
SEARCH_AGAIN_S = 0.05
"""Time without light after which an object in a hand is searched for again [s]."""
COAST_SHOWN_S, REJECTIONS_IN_HAND = 0.5, 3
"""Time without light [s] that an object may have whose inertial sensors show its motion; and successive periods in
which light contradicts the filter of one without, until it is lost."""
LEAST_MOTION: dict[str, float] = {"acceleration_noise_m_s2": 2.0, "angular_acceleration_noise_deg_s2": 300.0}
"""What a hand is taken to do at least, also where it keeps still throughout the stretches that were looked at."""
PLACE_M = 1e-4
"""By how much photodiodes are off their places [m], 1 sigma: what a user's object is made to."""
GUESSED_OWN_RAD, GUESSED_SHARED_RAD = 1e-4, 1e-3
"""Noise with which a recording is flown to find its own."""
TRIALS, TRIAL_PERIODS = 8, 120
"""Stretches of a recording from which its noise is found, and their length."""
DISAGREEMENT_RAD = 3e-4
"""Noise of whole sweeps [rad] beyond which it is not the rotors', but of places or calibrations."""
FEWEST_FORCES = 50
"""Number of specific forces that tell the direction of gravity."""
ASLOPE_RAD = 0.3
"""Angle between it and the world's z up to which z is taken to be up: motion is in it as well."""
LEVEL_M_S2, FOUND_M_S2, UNKNOWN_M_S2 = 0.5, 2.0, 10.0
"""Standard deviation of gravity per axis in a world whose z is up, where forces tell it, and where nothing does."""
FEWEST_ROWS = 8
"""Rows that a period needs for its redundancy to count."""


class Chosen(NamedTuple):
    """Stations of a replay. placed: in order. notes: sentences about those that are left out. world: whether their
    poses are in one frame of the room's, and not the one station's own.
    """

    placed: list[PlacedStation]
    notes: list[str]
    world: bool


def choose_stations(
    source: ObjectLight, file: PlacedStations | None, lighthouse: int | None, awaited: Sequence[int] = ()
) -> Chosen:
    """Return the stations by which an object navigates.

    Args:
        source: light of the object.
        file: stations of a file; None: those that the recording, or a file beside it, knows.
        lighthouse: number of the only station; None: all that were seen.
        awaited: numbers of further stations that the object may come to see.

    Raises:
        SwarmError: there is no light of any station, or none of the one asked for.
    """
    seen = sorted({*source.light.stations(), *awaited})
    if lighthouse is not None and lighthouse not in seen:
        raise SwarmError(f"{source.path}: {source.name!r} saw no light of station {lighthouse}; it saw {_listed(seen)}")
    wanted = seen if lighthouse is None else [lighthouse]
    placed = {n: source.placed[n] for n in wanted if n in source.placed}
    if file is not None:
        placed = {n: found for n in wanted if (found := _in_file(file, n, source)) is not None}
    if placed:
        where = "the file of stations does" if file is not None else "the recording and what is beside it do"
        notes = [f"station {n} is left out: {where} not tell where it stands" for n in wanted if n not in placed]
        if file is not None and source.placed:
            notes.insert(0, "the file of stations takes the place of those poses and calibrations")
        return Chosen([placed[n] for n in wanted if n in placed], notes, True)
    # Nobody knows where anything stands: the station that was seen most is the world.
    most = max(wanted, key=lambda n: int(np.count_nonzero(source.light.hits.station == n)))
    notes = [
        f"where the stations stand is not known: station {most} is taken alone, its frame is the world"
        + (f", {_listed([n for n in wanted if n != most])} left out" if len(wanted) > 1 else "")
    ]
    return Chosen([_at_origin(source, most)], notes, False)


def _listed(numbers: Sequence[int]) -> str:
    return ("station " if len(numbers) == 1 else "stations ") + ", ".join(map(str, numbers))


def _in_file(file: PlacedStations, number: int, source: ObjectLight) -> PlacedStation | None:
    """Return a station of a file by its number, or by the id that the recording knows; None if it has none."""
    known = source.placed.get(number)
    if known is not None and known.identity is not None:
        for station in file.stations:
            if station.identity == known.identity:
                return station._replace(number=number)
    return file.numbered(number)


def _at_origin(source: ObjectLight, number: int) -> PlacedStation:
    generation = source.light.generation
    perfect = (TiltedErrors(), TiltedErrors()) if generation == "2.0" else (FanErrors(), FanErrors())
    errors = source.errors.get(number, perfect)
    return PlacedStation(f"station {number}", number, generation, None, np.eye(3), np.zeros(3), errors)


def _unless_given(settings: Scenario, given: Scenario, values: Mapping[str, float]) -> Scenario:
    """Return settings with these values of navigation, but for those keys that the user gave."""
    told = given.navigation.model_fields_set
    changes = {key: value for key, value in values.items() if key not in told}
    return settings.model_copy(update={"navigation": settings.navigation.model_copy(update=changes)})


class StationPlayback:
    """Light that one object saw of several stations, through the same navigator as simulated craft.

    settings: the scenario, with the noise that was found. noise: of each station. found: noise and false photodiodes.
    scene: description for telemetry and recording. duration_s: length of the recording [s]. begin_s: instant of time
    zero on the recording's clock. marks_s: instants there that a motion capture system saw, too. notes: sentences about
    what of the recording is lost, left out, or found. history: whether estimates carry the filter's prediction.
    believed: None, for the angles of several stations are in no file.
    """

    believed = None

    def __init__(
        self,
        source: ObjectLight,
        settings: Scenario,
        chosen: Chosen,
        *,
        given: bool,
        imu: bool = True,
    ) -> None:
        """Prepare the replay of one object.

        Args:
            source: its light.
            settings: scenario with the navigation settings; the noise, if unset, is found in the recording.
            chosen: the stations.
            given: whether they are those of a file of stations, which has their calibrations as well.
            imu: whether the recording's gyroscope and accelerometer, if it has them, go into the filter.
        """
        given_settings, settings = settings, _unless_given(settings, settings, HANDLED)
        self.source, self.layout = source, source.photodiodes
        self.placed = chosen.placed
        self._stations = [placed.station for placed in chosen.placed]
        self.notes = [*source.notes, *chosen.notes]
        if settings.recording.angles:
            self.notes.append("angles.parquet holds the angles of one Lighthouse 1.0 station only: give --lighthouse")
        self.notes += [
            f"the calibration of station {placed.number} is not known: its fans are taken as perfect"
            for placed in chosen.placed
            if not given and placed.number not in source.errors
        ]
        peer = peer_in_world(source, self.placed, chosen.world)
        numbers = [placed.number for placed in chosen.placed]
        shape = len(numbers), self.layout.point_m.shape[1]
        nobody: Bools = np.zeros(shape, dtype=np.bool_)
        frame_s = FRAME_S.get(source.light.generation, min(FRAME_S.values()))
        self.windows = RowWindows(source, numbers, frame_s, peer, nobody)
        self.duration_s = len(self.windows) * frame_s
        self.begin_s, self.marks_s = self.windows.begin_s, source.marks_s
        self.found = RowConsistency(None, nobody, np.zeros(shape))
        self._forces: list[Floats] = []
        self._inertial: InertialSensors | None = None
        if settings.navigation.integrity.residual_test is not False:
            self.found = self._assess(settings)
        if self.found.false.any():
            self.windows = RowWindows(source, numbers, frame_s, peer, self.found.false)
        self.likely = self._likely(given_settings)
        if imu and self.windows.has_inertial and not self._at_rest():
            self._inertial = _sensors(self._forces, level=chosen.world)
        self.noise = self._noise(settings)
        if self._inertial is not None:
            settings = _unless_given(settings, given_settings, {"coast_limit_s": COAST_SHOWN_S})
        self.settings = self._with_noise(self._with_motion(settings, given_settings))
        self.notes += self._findings(settings)
        self.history = settings.swarm.navigator is None and keeps_history(settings.recording.filter, len(self.windows))
        tested = self.found.noise is not None
        navigation = self._navigation_of(self.settings, tested=tested)
        self._navigation = replace(navigation, history=self.history, places=self._places())
        self.scene = _scene(source, settings, chosen)

    def fly(self) -> Iterator[Period]:
        """Play one period of the filter after the other, to the end of the recording."""
        navigator = StationNavigator(self.layout, self._navigation, self._stations, self.noise)
        known = builders.of_stations(self.layout, self._stations, self.noise)
        own = builders.own_navigators(self.settings, self._navigation, known)
        for frame, window in enumerate(self.periods()):
            light = partial(Rowed, window.light.rows, tuple(self._stations))
            estimate = own.step(navigator.step(window.light), light, navigator.tracks, None, window.time_s)
            integrity = estimate.integrity
            dropped = np.where(integrity.dropped < 0, integrity.dropped, integrity.dropped + window.left_out)
            lit = np.zeros(self.layout.present.shape, dtype=np.bool_)
            lit[0, window.light.rows.photodiode] = True
            yield Period(
                frame=frame,
                time_s=window.time_s,
                truth=None,
                sight=np.where(lit, Sight.LIT, Sight.OUTSIDE),
                angles=_no_angles(self.layout),
                estimate=estimate._replace(integrity=integrity._replace(dropped=dropped)),
                peer=Peer(window.peer_position, window.peer_quaternion),
            )

    def periods(self) -> Iterator[RowWindow]:
        """Yield the light, period by period."""
        return iter(self.windows)

    def end(self, tell: Callable[[str], None]) -> dict[str, Any]:
        """Return what the summary has of the light itself: nothing; and tell nothing, for all was known before."""
        return {}

    def _assess(self, settings: Scenario) -> RowConsistency:
        """Return the noise and the false photodiodes, from a replay that believes every photodiode."""
        guess = [AngleNoise(GUESSED_OWN_RAD, GUESSED_SHARED_RAD)] * len(self._stations)
        navigation = replace(self._navigation_of(settings, tested=False), gate_probability=1.0)
        samples: list[RowSample] = []
        count = len(self.windows)
        stretch = max(count // TRIALS, TRIAL_PERIODS)
        for begin in range(0, count, stretch):
            navigator = StationNavigator(self.layout, navigation, self._stations, guess)
            for i in range(begin, min(begin + TRIAL_PERIODS, count)):
                rows = self.windows.window(i).light
                estimate = navigator.step(rows)
                if estimate.pnp.solved[0] and len(rows.rows.angle) >= FEWEST_ROWS:
                    state = State(
                        estimate.pnp.rotation[0],
                        estimate.pnp.position[0],
                        estimate.velocity[0],
                        estimate.angular_rate[0],
                    )
                    samples.append(RowSample(rows.rows.of(0), state))
                    if rows.inertial is not None:
                        self._forces.append(state.rotation @ rows.inertial.force[0])
        return assess_rows(samples, self._stations, self.layout.point_m[0], guess)

    def _likely(self, given: Scenario) -> Likely | None:
        """Return the most likely noise and motion, None where the recording does not tell them or nothing is asked."""
        table = given.navigation
        if table.integrity.residual_test is False or self.found.noise is None:
            return None
        own = [noise.own_rad for noise in self.found.noise]
        return likely(self.windows, self._stations, self.layout.point_m[0], HandMotion(), own)

    def _at_rest(self) -> bool:
        """Return whether the object has been found to be at rest."""
        return self.likely is not None and self.likely.acceleration_m_s2 <= AT_REST_M_S2

    def _with_motion(self, settings: Scenario, given: Scenario) -> Scenario:
        """Return the settings with the hand's motion as found, but for what the user gave."""
        if self.likely is None:
            return settings
        found = {
            "acceleration_noise_m_s2": self.likely.acceleration_m_s2,
            "angular_acceleration_noise_deg_s2": float(np.degrees(self.likely.angular_acceleration_rad_s2)),
        }
        settings = _unless_given(settings, given, {key: max(value, LEAST_MOTION[key]) for key, value in found.items()})
        quiet = settings.navigation.quiet
        if self._at_rest() or "craft" in quiet.model_fields_set:
            return settings
        # A hand pushes all the time: the one model that was found, and none that is quieter.
        table = settings.navigation.model_copy(update={"quiet": quiet.model_copy(update={"craft": "none"})})
        return settings.model_copy(update={"navigation": table})

    def _noise(self, settings: Scenario) -> list[AngleNoise]:
        """Return the noise of each station's rows: as the settings give it, or as found, or as guessed."""
        table = settings.navigation
        if table.angle_noise_arcsec is None and self.likely is not None:
            return self.likely.noise
        if table.angle_noise_arcsec is None and self.found.noise is not None:
            return self.found.noise
        if table.angle_noise_arcsec is None:
            return [AngleNoise(GUESSED_OWN_RAD, GUESSED_SHARED_RAD)] * len(self._stations)
        sigma, share = table.angle_noise_arcsec * ARCSEC, table.rotor_correlation or 0.0
        one = AngleNoise(float(sigma * np.sqrt(max(1 - share, 1e-6))), float(sigma * np.sqrt(share)))
        return [one] * len(self._stations)

    def _with_noise(self, settings: Scenario) -> Scenario:
        """Return the settings with the noise of an angle, the stations' mean."""
        if settings.navigation.angle_noise_arcsec is not None:
            return settings
        square = float(np.mean([own**2 + shared**2 for own, shared in self.noise]))
        table = settings.navigation.model_copy(update={"angle_noise_arcsec": float(np.sqrt(square)) / ARCSEC})
        return settings.model_copy(update={"navigation": table})

    def _navigation_of(self, settings: Scenario, *, tested: bool) -> NavigationSettings:
        navigation = builders.navigation(settings)
        test = tested and navigation.integrity.residual_test
        integrity = replace(navigation.integrity, residual_test=test, tick_s=None)
        return replace(
            navigation,
            frame_s=self.windows.frame_s,
            integrity=integrity,
            place_sigma_m=PLACE_M,
            hand=HandMotion(),
            search_again_s=SEARCH_AGAIN_S,
            inertial=self._inertial,
            rejections_limit=navigation.rejections_limit if self._inertial is not None else REJECTIONS_IN_HAND,
        )

    def _places(self) -> PlaceSigma:
        """Return how far the stations, as their file tells, and the photodiodes may be off."""
        return PlaceSigma(
            np.array([placed.pose_covariance for placed in self.placed]),
            np.array([placed.systematic_rad for placed in self.placed]),
            PLACE_M,
            np.array([noise.own_rad for noise in self.noise]),
        )

    def _told_noise(self, of_periods: list[AngleNoise]) -> list[AngleNoise]:
        """Return the noise that is told: of single periods, in which what an object at rest shows all the time counts;
        of one that moves, in which motion would count as well, that of the filter's innovations.
        """
        moves = self.likely is not None and self.likely.acceleration_m_s2 > AT_REST_M_S2
        return self.likely.noise if self.likely is not None and moves else of_periods

    def _findings(self, given: Scenario) -> list[str]:
        """Return sentences about the noise and the false photodiodes."""
        out = [
            f"photodiode {k} contradicts the others in {100 * self.found.share[s, k]:.0f} % of its periods before "
            f"{self.placed[s].name} and is left out there: it sees a constant reflection, or is not where it should be"
            for s, k in np.argwhere(self.found.false).tolist()
        ]
        if given.navigation.angle_noise_arcsec is not None:
            return out
        if self.found.noise is None:
            return [*out, "the noise is guessed, and rows are not tested: too little light tells it"]
        told = self._told_noise(self.found.noise)
        for placed, noise in zip(self.placed, told, strict=True):
            alone = len(self.placed) == 1
            text = f"{placed.name}: photodiodes of a sweep agree to {1e6 * noise.own_rad:.0f} urad, 1 sigma"
            out.append(text if alone else f"{text}, its sweeps with the others' to {1e6 * noise.shared_rad:.0f} urad")
        shared = told[0].shared_rad
        if len(self.placed) > 1 and shared > DISAGREEMENT_RAD:
            out.append(
                f"the stations contradict each other by {1e3 * shared:.1f} mm per metre of distance: where they stand, "
                "or their calibrations, are off by more than their light; swarm survey finds both"
            )
        if self._inertial is not None:
            out.append("the gyroscope and accelerometer are taken in, with their biases (--no-imu: light alone)")
        if self.likely is not None:
            turning = np.degrees(self.likely.angular_acceleration_rad_s2)
            out.append(
                f"the object moves as if pushed at random by {self.likely.acceleration_m_s2:.1f} m/s^2 and "
                f"{turning:.0f} deg/s^2, 1 sigma"
            )
        return out


def _scene(source: ObjectLight, settings: Scenario, chosen: Chosen) -> Scene:
    """Return the description of an object and its stations for telemetry and recording."""
    return Scene(
        craft=(source.name,),
        visuals=[()],
        photodiodes=source.photodiodes,
        lighthouse=visuals(find_model(settings.lighthouse.model)),
        field_deg=settings.lighthouse.field_deg,
        replay=True,
        stations=[StationScene(p.name, p.rotation, p.position, p.generation) for p in chosen.placed],
        up="z" if chosen.world else "-y",
    )


def _sensors(forces: Sequence[Floats], *, level: bool) -> InertialSensors:
    """Return what is known of gravity in the world, where the median of forces (3,) on a moving object points to.

    Args:
        forces: specific forces in the world, as an accelerometer shows them.
        level: whether z is up in the world, unless they contradict it.
    """
    shown = np.reshape(forces, (-1, 3))
    shown = shown[np.isfinite(shown).all(axis=1)]
    if len(shown) < FEWEST_FORCES:
        return InertialSensors((0.0, 0.0, 0.0), UNKNOWN_M_S2)
    up = np.median(shown, axis=0) / np.linalg.norm(np.median(shown, axis=0))
    if level and up[2] > np.cos(ASLOPE_RAD):
        return InertialSensors((0.0, 0.0, GRAVITY), LEVEL_M_S2)
    return InertialSensors((GRAVITY * float(up[0]), GRAVITY * float(up[1]), GRAVITY * float(up[2])), FOUND_M_S2)


def peer_in_world(source: ObjectLight, stations: Sequence[PlacedStation], world: bool) -> WorldPose:
    """Return the recording's own poses of the object in the world of the stations, NaN where that is not known.

    Args:
        source: light of the object.
        stations: as the replay places them.
        world: whether these places are in the room's frame.
    """
    peer = source.peer
    here = next((p for p in stations if p.number in source.placed), None)
    if here is None or not len(source.peer_time_s):
        return WorldPose(np.full_like(peer.position, np.nan), np.full_like(peer.quaternion, np.nan))
    there = source.placed[here.number]
    if not world:
        here = here._replace(rotation=np.eye(3), position=np.zeros(3))
    turn = here.rotation @ there.rotation.T
    position = (peer.position - there.position) @ turn.T + here.position
    quaternion = rot.quaternion_from_matrix(turn @ rot.matrix_from_quaternion(peer.quaternion))
    return WorldPose(position, quaternion)


def _no_angles(layout: Photodiodes) -> SweepAngles:
    """Return the angles of a period as the decoder of one station has them: none."""
    craft, photodiodes = layout.present.shape
    theta: Floats = np.full((craft, photodiodes, 2), np.nan)
    none = np.zeros(craft, dtype=np.int64)
    return SweepAngles(theta, np.zeros_like(theta), np.zeros((craft, photodiodes), dtype=np.bool_), none, none, none)
