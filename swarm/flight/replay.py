"""Replay of a real Lighthouse 1.0 recording by the on-board code of simulated craft: one object, one station at a time.

A recording contains no truth: the true columns stay null, and the pose that the recording's own software found goes
into the peer columns. The station's factory calibration is subtracted from the angles before any other step.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimators.arrays import Floats
from estimators.calibration.problem import Noise
from swarm.assets import find_model
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.flight.recordings.libsurvive import Recording, read_libsurvive
from swarm.flight.recordings.station_calibration import StationCalibration, read_calibration
from swarm.flight.recordings.windows import Source, Window, Windows
from swarm.flight.simulate import untold
from swarm.hardware import Photodiodes
from swarm.messages import Signals, no_pulses
from swarm.onboard.computer import Computer, Known
from swarm.onboard.decoder import PulseDecoder
from swarm.onboard.inspection import Inspection, InspectionSettings
from swarm.onboard.navigation import Navigator
from swarm.onboard.settings import NavigationSettings
from swarm.results.angles import believed
from swarm.results.period import Period
from swarm.results.progress import Progress
from swarm.results.records import Peer
from swarm.results.run_folder import Run
from swarm.results.run_writer import writing_run
from swarm.results.scene import Scene
from swarm.scenario import Scenario, for_replay
from swarm.sensors.sight import Sight
from swarm.world.craft import visuals


def replay(
    recording: str | Path,
    *,
    object_name: str | None = None,
    lighthouse: int = 0,
    calibration: str | Path | None = None,
    source: Source = "pulses",
    scenario: Scenario | None = None,
    out: str | Path | None = None,
    force: bool = False,
    record: bool = True,
    progress: Callable[[Progress], None] | None = None,
) -> Run:
    """Replay the light that an object of a recording saw from one station, and write the run.

    Args:
        recording: file written by libsurvive.
        object_name: name of the tracked object, such as HMD.
        lighthouse: number of the station.
        calibration: file of the station's known errors, in libsurvive's format or this project's.
        source: raw "pulses", or the "angles" that the recording's own software derived from them.
        scenario: other navigation settings, as `for_replay` makes them.
        out: folder of the run, by default `runs/<recording>-0`.
        force: replace an existing run.
        record: write recording.rrd.
        progress: function called after every period.

    Returns:
        The run, opened.

    Raises:
        SwarmError: the recording or the calibration cannot be read, or the folder cannot be written.
    """
    settings, tell = scenario if scenario is not None else for_replay(Path(recording)), progress or untold
    playback = Playback(recording, settings, object_name or "", lighthouse, calibration, source)
    with writing_run(
        settings,
        out,
        playback.scene,
        force=force,
        duration_s=playback.duration_s,
        record=record,
        angles=playback.believed if settings.recording.angles else None,
    ) as writer:
        for period in playback.fly():
            writer.append(period)
            tell(writer.progress)
    return writer.run


class Playback:
    """Light that one object saw from one station, through the same computer as a simulated craft's.

    log, windows: the recording. layout: the object's photodiodes as assumed. believed: layout, fan errors and noise,
    for a calibration. scene: description for telemetry and recording. duration_s: length of the recording [s].
    """

    def __init__(
        self,
        recording: str | Path,
        settings: Scenario,
        object_name: str,
        lighthouse: int,
        calibration: str | Path | None = None,
        source: Source = "pulses",
    ) -> None:
        """Read the recording.

        Args:
            recording: file written by libsurvive.
            settings: scenario with the navigation settings.
            object_name: name of the tracked object, such as HMD.
            lighthouse: number of the station.
            calibration: file of the station's known errors, in libsurvive's format or this project's.
            source: raw "pulses", or the "angles" that the recording's own software derived from them.

        Raises:
            SwarmError: the recording or the calibration cannot be read.
        """
        self.log = read_libsurvive(recording, object_name)
        known = read_calibration(calibration, lighthouse) if calibration is not None else None
        self.windows = Windows(self.log, lighthouse, source, known.pose if known else None)
        self.layout = _layout(self.log, known)
        self.duration_s = len(self.windows) * self.windows.frame_s
        navigation = self._navigation(settings, known)
        self._computer = Computer(
            PulseDecoder(
                self.layout.present, self.windows.tick_s, frame_s=self.windows.frame_s, slot=self.windows.slot
            ),
            Navigator(self.layout, navigation),
            Inspection((), InspectionSettings(navigation.frame_s)),
        )
        s, rho = navigation.angle_noise_rad, navigation.rotor_correlation
        noise = Noise(s * float(np.sqrt(1 - rho)), s * float(np.sqrt(rho)))
        self.believed = believed((self.log.device,), self.layout, (navigation.fan_x, navigation.fan_y), noise)
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
        for frame, window in enumerate(self.windows):
            first_s = window.time_s if first_s is None else first_s
            known = self._step(window)
            yield Period(
                frame=frame,
                time_s=window.time_s - first_s,
                truth=None,
                sight=np.where(known.angles.lit, Sight.LIT, Sight.OUTSIDE),
                angles=known.angles,
                estimate=known.estimate,
                peer=Peer(window.peer_position, window.peer_quaternion),
            )

    def _step(self, window: Window) -> Known:
        if window.pulses is not None:
            return self._computer.step(Signals(window.pulses))
        assert window.angles is not None
        return self._computer.navigate(window.angles, Signals(no_pulses(1)))

    def _navigation(self, settings: Scenario, known: StationCalibration | None) -> NavigationSettings:
        navigation = builders.navigation(settings)
        # A real station's noise is only guessed: the distribution of its residuals is not known.
        untested = replace(navigation.integrity, residual_test=False, tick_s=None)
        navigation = replace(navigation, frame_s=self.windows.frame_s, integrity=untested)
        if known is None:
            return navigation
        return replace(navigation, fan_x=known.fan_x, fan_y=known.fan_y)


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
