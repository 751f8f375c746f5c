"""Replay of a recording of real light by the on-board code of simulated craft: one object.

One station of Lighthouse 1.0 is replayed here, period by period as that code takes a single lighthouse; several
stations and Lighthouse 2.0 by `station_replay`.

A recording contains no truth: the true columns stay null, and the pose that the recording's own software found goes
into the peer columns. The station's factory calibration is subtracted from the angles before any other step.
"""

import shlex
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.lighthouse.integrity import Sweeps
from estimators.lighthouse.sweep import correct
from swarm.assets import find_model, own_recording
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.flight.live_replay import live_playback
from swarm.flight.recordings.consistency import Consistency, Sample, assess
from swarm.flight.recordings.contents import only_object
from swarm.flight.recordings.formats import Format, recording_format
from swarm.flight.recordings.libsurvive import Recording, WorldPose, read_libsurvive
from swarm.flight.recordings.live_lines import NAME, LiveLines
from swarm.flight.recordings.object_light import configuration_beside, read_object
from swarm.flight.recordings.receiver import Receiver
from swarm.flight.recordings.station_calibration import StationCalibration, read_calibration
from swarm.flight.recordings.stations_file import read_stations
from swarm.flight.recordings.trajectory import read_trajectory
from swarm.flight.recordings.windows import Source, Windows
from swarm.flight.simulate import untold
from swarm.flight.station_replay import StationPlayback, choose_stations
from swarm.flight.truth import GivenTruth, NoTruth, truth_for
from swarm.hardware import Photodiodes
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.navigation import Estimate, Navigator
from swarm.onboard.own_navigators import rows_of
from swarm.onboard.settings import NavigationSettings, Status
from swarm.results.angles import believed
from swarm.results.filter_history import keeps_history
from swarm.results.period import Period
from swarm.results.progress import Progress
from swarm.results.records import Peer
from swarm.results.run_folder import Run, refuse_run
from swarm.results.run_writer import RunWriter, writing_run
from swarm.results.scene import Scene
from swarm.scenario import Scenario, checked, for_replay
from swarm.scenario.text import changed, toml_value
from swarm.sensors.sight import Sight
from swarm.units import ARCSEC
from swarm.user_text import read_text, user_path
from swarm.world.craft import visuals

GUESSED_NOISE_ARCSEC = 20.0
"""Noise of an angle where the recording does not tell it."""
LEAST_NOISE_ARCSEC = 0.1
"""Noise of an angle that is taken where rounding to ticks explains all that was found."""
LEAST_OWN_SHARE = 0.05
"""Least share of the noise's variance that is taken for the photodiodes' own."""
TRIALS, TRIAL_PERIODS, TRIAL_STEP = 4, 400, 3
"""Stretches of a recording from which its noise is found, their length, and one in how many periods counts."""
NONE_FALSE: Ints = np.zeros(0, dtype=np.int64)
UNTESTED = Consistency(None, NONE_FALSE, np.zeros(0))


class _Asked(NamedTuple):
    """Arguments of a replay, as `replay` has them."""

    object_name: str | None
    lighthouse: int | None
    calibration: str | Path | None
    stations: str | Path | None
    source: Source
    truth: str | Path | None
    imu: bool


def replay(
    recording: str | Path | LiveLines,
    *,
    object_name: str | None = None,
    lighthouse: int | None = None,
    calibration: str | Path | None = None,
    stations: str | Path | None = None,
    source: Source = "pulses",
    truth: str | Path | None = None,
    imu: bool = True,
    scenario: Scenario | None = None,
    out: str | Path | None = None,
    force: bool = False,
    record: bool = True,
    live: bool = False,
    progress: Callable[[Progress], None] | None = None,
    tell: Callable[[str], None] | None = None,
) -> Run:
    """Replay the light that an object of a recording saw, write the run, and return it, opened.

    Args:
        recording: file written by libsurvive, or a Crazyflie's event log; or lines as they come.
        object_name: name of the tracked object, such as HMD; None if only one saw light.
        lighthouse: number of the only station, of Lighthouse 2.0 its channel; None: all whose place is known.
        calibration: file of the stations' known errors in libsurvive's format, or of one station's in this project's.
        stations: file of stations, as `swarm survey` writes it; None: what the recording and files beside it know.
        source: raw "pulses", or the "angles" that the recording's own software derived from them.
        truth: trajectory of the object from another system, such as motion capture.
        imu: take in the gyroscope and accelerometer of an object that moves, where the recording has them.
        scenario: other navigation settings, as `for_replay` makes them.
        out: folder of the run, by default `runs/<recording>-0`.
        force: replace an existing run.
        record: write recording.rrd.
        live: show the run in the viewer meanwhile.
        progress: function called after every period.
        tell: function called with every sentence about the recording: what of it is lost, or left out.

    Raises:
        SwarmError: a file cannot be read, or the truth does not fit, or the folder cannot be written.
    """
    path, note = _file_of(recording, truth), tell or _untold
    settings, told = for_replay(path) if scenario is None else checked(scenario), progress or untold
    refuse_run(settings.name, settings.seed, out, force)
    builders.plug_ins(settings, "navigator")  # a mistake there is told before the light is read
    asked = _Asked(object_name, lighthouse, calibration, stations, source, truth, imu)
    command = _command(path, settings, asked)
    trajectory = None if truth is None else read_trajectory(truth)  # likewise
    playback = _playback(recording, settings, asked, note)
    given = truth_for(trajectory, playback)
    for sentence in (*playback.notes, *given.notes):
        note(sentence)
    opened = partial(writing_run, out=out, force=force, record=record, live=live, command=command)
    return _flown(playback, given, opened, told, note)


def _flown(
    playback: "Playback | StationPlayback",
    given: GivenTruth | NoTruth,
    opened: Callable[..., AbstractContextManager[RunWriter]],
    told: Callable[[Progress], None],
    tell: Callable[[str], None],
) -> Run:
    """Fly a playback, write it, and return its run, opened.

    Args:
        playback: light of one object.
        given: truth.
        opened: opens the run's folder, with what the user asked for.
        told: function called after every period.
        tell: function called with sentences about what was lost on the way.
    """
    found = given.summary()
    with opened(
        playback.settings,
        scene=playback.scene._replace(truth=given.known),
        duration_s=playback.duration_s,
        angles=playback.believed if playback.settings.recording.angles else None,
        history=playback.history,
        found=found,
    ) as writer:
        for period in given.give(playback.fly()):
            writer.append(period)
            told(writer.progress)
        found.update(playback.end(tell))
    return writer.run


def _file_of(recording: str | Path | LiveLines, truth: str | Path | None) -> Path:
    """Return the file of a recording; lines as they come have none, but the name of their runs, and no truth."""
    if not isinstance(recording, LiveLines):
        return Path(recording)
    if truth is not None:
        raise SwarmError("--truth: it is aligned with a whole flight, and of lines as they come none is whole")
    return Path(NAME)


def _untold(note: str) -> None:
    """Tell a sentence to nobody."""


def _playback(
    recording: str | Path | LiveLines,
    settings: Scenario,
    asked: _Asked,
    tell: Callable[[str], None],
) -> "Playback | StationPlayback":
    """Return the playback of a recording: by poses for one station of Lighthouse 1.0, by rows for all else.

    Args:
        recording: file of the recording, or lines as they come.
        settings: scenario with the navigation settings.
        asked: what was asked for.
        tell: gets a sentence while lines as they come have nothing to fly by.
    """
    object_name, lighthouse, calibration, stations, source = asked[:5]
    file = None if stations is None else read_stations(stations)
    if isinstance(recording, LiveLines):
        return live_playback(recording, settings, object_name, lighthouse, calibration, file, source, tell)
    crazyflie = recording_format(recording) is Format.CRAZYFLIE
    name = object_name if crazyflie else object_name or only_object(recording)
    if crazyflie and calibration is not None:
        raise SwarmError(
            f"--calibration: {recording} is a Crazyflie's log: its system-config.yaml is taken, or --stations"
        )
    log = None if crazyflie else read_libsurvive(recording, name or "")
    if log is not None and file is None and (lighthouse is not None or _is_own_format(calibration)):
        if not log.rotors.any():
            return Playback(log, settings, lighthouse or 0, calibration, source)
        if _is_own_format(calibration):
            raise SwarmError(f"{calibration}: of Lighthouse 1.0, and {log.device!r} saw 2.0: give --stations")
    light = read_object(recording, name, source, calibration, log)
    chosen = choose_stations(light, file, lighthouse)
    if log is not None and file is None and light.light.generation == "1.0" and len(chosen.placed) == 1:
        beside = calibration or configuration_beside(log.path)
        playback = Playback(log, settings, chosen.placed[0].number, beside, source)
        if len(light.light.stations()) > 1:
            playback.notes += chosen.notes
        return playback
    return StationPlayback(light, settings, chosen, given=file is not None, imu=asked.imu)


def _is_own_format(calibration: str | Path | None) -> bool:
    """Return whether a calibration is of this project's format, which is one station's."""
    return calibration is not None and not read_text(
        user_path(calibration), str(calibration), "a calibration file"
    ).lstrip().startswith(('"', "{"))


def _command(
    recording: Path,
    settings: Scenario,
    asked: _Asked,
) -> str:
    """Return the command that repeats a replay: its arguments, and every setting that is not the usual one.

    Args:
        recording: file, or the name of lines as they come.
        settings: settings as the user gave them.
        asked: what was asked for.
    """
    object_name, lighthouse, calibration, stations, source, truth, imu = asked
    own = own_recording(recording)
    from_pipe = recording == Path(NAME)
    words = ["swarm", "replay", own.name if own is not None else "-" if from_pipe else str(recording)]
    words += ["--object", object_name] if object_name is not None else []
    words += ["--lighthouse", str(lighthouse)] if lighthouse is not None else []
    words += ["--stations", str(stations)] if stations is not None else []
    # A recording that comes with the program brings its calibration, unless another one is given.
    brought = own is not None and calibration is not None and Path(calibration) == own.calibration
    words += ["--calibration", str(calibration)] if calibration is not None and not brought else []
    words += ["--from", source] if source != "pulses" else []
    words += ["--truth", str(truth)] if truth is not None else []
    words += [] if imu else ["--no-imu"]
    usual = for_replay(recording)
    words += ["--seed", str(settings.seed)] if settings.seed != usual.seed else []
    for key, value in changed(usual, settings):
        words += ["--set", f"{key}={toml_value(value)}"]
    return shlex.join(words)


class Playback:
    """Light that one object saw from one station, through the same computer as a simulated craft's.

    log, windows: the recording. settings: the scenario, with the noise that was found. layout: the object's photodiodes
    as assumed. found: noise and false photodiodes. believed: layout, fan errors and noise, for a calibration. scene:
    description for telemetry and recording. duration_s: length of the recording [s]. begin_s: first epoch on the
    recording's clock. marks_s: instants there that a motion capture system saw, too. notes: sentences about what of the
    recording is lost, left out, or found. history: whether estimates carry the filter's prediction.
    """

    def __init__(
        self,
        log: Recording,
        settings: Scenario,
        lighthouse: int,
        calibration: str | Path | None = None,
        source: Source = "pulses",
    ) -> None:
        """Prepare the replay.

        Args:
            log: the recording of one object.
            settings: scenario with the navigation settings; the noise, if unset, is found in the recording.
            lighthouse: number of the station.
            calibration: file of the station's known errors, in libsurvive's format or this project's.
            source: raw "pulses", or the "angles" that the recording's own software derived from them.

        Raises:
            SwarmError: the recording or the calibration cannot be read.
        """
        self.log = log
        self._known = read_calibration(calibration, lighthouse) if calibration is not None else None
        station = _station(self.log, lighthouse, self._known)
        self.windows = Windows(self.log, lighthouse, source, station)
        self.layout = _layout(self.log, self._known)
        self.duration_s = len(self.windows) * self.windows.frame_s
        self.begin_s, self.marks_s = self.windows.begin_s, np.zeros(0)
        self.notes = self.log.losses.sentences()
        if station is None and len(self.log.peer_time_s):
            self.notes.append(
                f"where station {lighthouse} is in the recording's own frame is not known, so the peer columns stay "
                "empty: give its --calibration, with a pose or an id"
            )
        self.found = self._assess(settings) if settings.navigation.integrity.residual_test is not False else UNTESTED
        self.settings = _with_noise(settings, self.found)
        self.notes += _findings(self.found, settings, self.settings)
        self.history = settings.swarm.navigator is None and keeps_history(settings.recording.filter, len(self.windows))
        navigation = self._navigation_of(self.settings, tested=self.found.noise_rad is not None)
        self._navigation = replace(navigation, history=self.history)
        fans = self._navigation.fan_x, self._navigation.fan_y
        self.believed = believed((self.log.device,), self.layout, fans, builders.assumed_angle_noise(self.settings))
        self.scene = Scene(
            craft=(self.log.device,),
            visuals=[()],
            photodiodes=self.layout,
            lighthouse=visuals(find_model(settings.lighthouse.model)),
            field_deg=settings.lighthouse.field_deg,
            replay=True,
        )

    def fly(self) -> Iterator[Period]:
        """Play one lighthouse period after the other, to the end of the recording; times count from the first one."""
        first_s: float | None = None
        settings = self._navigation
        navigator, receiver = self._begin(settings, self.found.false)
        own = builders.own_navigators(self.settings, settings, builders.of_one_lighthouse(self.layout, settings))
        for frame, window in enumerate(self.windows):
            first_s = window.time_s if first_s is None else first_s
            angles, left_out = receiver.receive(window, navigator.expected_angles(receiver.turn_s))
            time_s, light = window.time_s - first_s, partial(rows_of, angles, settings)
            estimate = own.step(navigator.step(angles), light, navigator.tracks, None, time_s)
            integrity = estimate.integrity
            dropped = np.where(integrity.dropped < 0, integrity.dropped, integrity.dropped + left_out)
            yield Period(
                frame=frame,
                time_s=time_s,
                truth=None,
                sight=np.where(angles.lit, Sight.LIT, Sight.OUTSIDE),
                angles=angles,
                estimate=estimate._replace(integrity=integrity._replace(dropped=dropped)),
                peer=Peer(window.peer_position, window.peer_quaternion),
            )

    def end(self, tell: Callable[[str], None]) -> dict[str, Any]:
        """Return what the summary has of the light itself: nothing; and tell nothing, for all was known before."""
        return {}

    def _begin(self, navigation: NavigationSettings, false: Ints) -> tuple[Navigator, Receiver]:
        return Navigator(self.layout, navigation), Receiver(self.windows, false)

    def _assess(self, settings: Scenario) -> Consistency:
        """Return the noise and the false photodiodes, from a replay that believes every photodiode."""
        navigation = self._navigation_of(_with_noise(settings, UNTESTED), tested=False)
        samples: list[Sample] = []
        stretch = max(len(self.windows) // TRIALS, TRIAL_PERIODS)
        for frame, window in enumerate(self.windows):
            within = frame % stretch
            if within == 0:
                navigator, receiver = self._begin(navigation, NONE_FALSE)
            if within >= TRIAL_PERIODS:
                continue
            angles = receiver.receive(window, navigator.expected_angles(receiver.turn_s)).angles
            estimate = navigator.step(angles)
            if estimate.pnp.solved[0] and estimate.status[0] == Status.TRACKING and frame % TRIAL_STEP == 0:
                samples.append(_sample(angles, estimate, self.layout, navigation))
        return assess(samples)

    def _navigation_of(self, settings: Scenario, *, tested: bool) -> NavigationSettings:
        navigation = builders.navigation(settings)
        test = tested and navigation.integrity.residual_test
        # The rotor's speed is not monitored: a real object's clock is off by more than the rotor.
        integrity = replace(navigation.integrity, residual_test=test, tick_s=None)
        navigation = replace(navigation, frame_s=self.windows.frame_s, integrity=integrity)
        if self._known is None:
            return navigation
        return replace(navigation, fan_x=self._known.fan_x, fan_y=self._known.fan_y)


def _station(log: Recording, lighthouse: int, known: StationCalibration | None) -> WorldPose | None:
    """Return the station's pose in the recording's own world: the calibration's, or that of its lines."""
    if known is not None and known.pose is not None:
        return known.pose
    return log.station(lighthouse, None if known is None else known.identity)


def _sample(angles: SweepAngles, estimate: Estimate, layout: Photodiodes, navigation: NavigationSettings) -> Sample:
    theta = correct(angles.theta, (navigation.fan_x, navigation.fan_y))
    moves = float(navigation.motion_compensation)
    sweeps = Sweeps(
        theta=theta,
        lit=angles.lit & np.isfinite(theta).all(axis=2),
        point_m=layout.point_m,
        offset_s=angles.offset_s,
        angular_rate=moves * estimate.angular_rate,
        velocity=moves * estimate.velocity,
    )
    return Sample(sweeps, estimate.pnp.rotation, estimate.pnp.position)


def _with_noise(settings: Scenario, found: Consistency) -> Scenario:
    """Return the settings with the noise of an angle: as they give it, or as found, or as guessed."""
    table = settings.navigation
    if table.angle_noise_arcsec is not None:
        return settings
    noise = GUESSED_NOISE_ARCSEC
    if found.noise_rad is not None:
        # What was found is the part that photodiodes do not share; the rotor's cannot be told from motion. Rounding to
        # ticks is in it, and the craft adds that of its own clock once more.
        own_share = 1 - (0.0 if table.rotor_correlation is None else table.rotor_correlation)
        own = np.sqrt(max(found.noise_rad**2 - builders.timing_noise(settings).own_rad ** 2, 0.0))
        noise = float(own / np.sqrt(max(own_share, LEAST_OWN_SHARE))) / ARCSEC
        noise = max(noise, LEAST_NOISE_ARCSEC)
    table = table.model_copy(update={"angle_noise_arcsec": noise})
    return settings.model_copy(update={"navigation": table})


def _findings(found: Consistency, given: Scenario, settings: Scenario) -> list[str]:
    """Return sentences about the noise and the false photodiodes."""
    out = [
        f"photodiode {k} contradicts the others in {100 * share:.0f} % of its periods and is left out: it sees a "
        "constant reflection, or is not where CONFIG has it"
        for k, share in zip(found.false.tolist(), found.share.tolist(), strict=True)
    ]
    noise = settings.navigation.angle_noise_arcsec
    if given.navigation.angle_noise_arcsec is not None:
        return out
    if found.noise_rad is None:
        return [
            *out,
            f"the noise is guessed, {noise:.0f} arcsec, and residuals are not tested: too little light tells it",
        ]
    return [
        *out,
        f"the angles agree to {found.noise_rad / ARCSEC:.1f} arcsec, 1 sigma; "
        f"with the rotor's share navigation.angle_noise_arcsec = {noise:.1f}",
    ]


def _layout(log: Recording, known: StationCalibration | None) -> Photodiodes:
    """Return the object's photodiodes at their design positions, or at those of a calibration."""
    found = known.places(log.device) if known is not None else None
    if found is None:
        return log.photodiodes
    point_m: Floats = found[None]
    if point_m.shape != log.photodiodes.point_m.shape:
        raise SwarmError(
            f"the calibration places {point_m.shape[1]} photodiodes, but {log.device!r} in {log.path} has "
            f"{log.photodiodes.point_m.shape[1]}"
        )
    return log.photodiodes._replace(point_m=point_m)
