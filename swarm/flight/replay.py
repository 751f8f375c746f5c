"""Feed a real Lighthouse 1.0 recording to the on-board code of simulated craft: one object, one station at a time.

There is no truth in a recording: the true columns stay null, and the pose that the recording's own software found goes
into the peer columns. What the station's factory calibration knows is taken off the angles before anything else.
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
from swarm.hardware import Photodiodes
from swarm.onboard.decoder import PulseDecoder, SweepAngles
from swarm.onboard.navigation import Estimate, Navigator
from swarm.results.angles import believed
from swarm.results.period import Period
from swarm.results.progress import Progress
from swarm.results.recording.scene import Scene
from swarm.results.records import Peer
from swarm.results.run_folder import Run
from swarm.results.run_writer import writing_run
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
    """Replay what `object_name` saw of station `lighthouse` in a libsurvive `recording`; the run, opened.

    calibration: the station's known errors, libsurvive's file or ours. source: the raw "pulses", or the "angles" that
    the recording's own software made of them. scenario: of `for_replay`, for other navigation settings. The rest as in
    `simulate`. Raises SwarmError, as `read_libsurvive` and `read_calibration` do.
    """
    settings = scenario if scenario is not None else for_replay(Path(recording))
    playback = Playback(recording, settings, object_name or "", lighthouse, calibration, source)
    log, layout, windows = playback.log, playback.layout, playback.windows
    scene = Scene(
        craft=(log.device,),
        visuals=[()],
        photodiodes=layout,
        lighthouse=visuals(find_model(settings.lighthouse.model)),
        field_deg=settings.lighthouse.field_deg,
        replay=True,
    )
    duration_s = len(windows) * windows.frame_s
    first_s: float | None = None
    about = playback.believed if settings.recording.angles else None
    with writing_run(settings, out, scene, force=force, duration_s=duration_s, record=record, angles=about) as writer:
        for frame, (window, angles, estimate) in enumerate(playback):
            first_s = window.time_s if first_s is None else first_s
            peer = Peer(window.peer_position, window.peer_quaternion)
            sight = np.where(angles.lit, Sight.LIT, Sight.OUTSIDE)
            writer.append(Period(frame, window.time_s - first_s, None, sight, angles, estimate, peer))
            if progress is not None:
                progress(writer.progress)
    return writer.run


class Playback:
    """What one object saw of one station, through the same on-board code; iterate for (window, angles, estimate).

    log, windows: the recording. layout: the object's photodiodes as believed. believed: that and the station's errors.
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
        """Arguments as of `replay`. Raises SwarmError."""
        self.log = read_libsurvive(recording, object_name)
        known = read_calibration(calibration, lighthouse) if calibration is not None else None
        self.windows = Windows(self.log, lighthouse, source, known.pose if known else None)
        self.layout = _layout(self.log, known)
        self._decoder = PulseDecoder(
            self.layout.present, self.windows.tick_s, frame_s=self.windows.frame_s, slot=self.windows.slot
        )
        navigation = builders.navigation(settings)
        # A real station's noise is only guessed: what its residuals should be is not known.
        untested = replace(navigation.integrity, residual_test=False, tick_s=None)
        navigation = replace(navigation, frame_s=self.windows.frame_s, integrity=untested)
        if known is not None:
            navigation = replace(navigation, fan_x=known.fan_x, fan_y=known.fan_y)
        self._navigator = Navigator(self.layout, navigation)
        s, rho = navigation.angle_noise_rad, navigation.rotor_correlation
        noise = Noise(s * float(np.sqrt(1 - rho)), s * float(np.sqrt(rho)))
        self.believed = believed((self.log.device,), self.layout, (navigation.fan_x, navigation.fan_y), noise)

    def __iter__(self) -> Iterator[tuple[Window, SweepAngles, Estimate]]:
        for window in self.windows:
            angles = _angles(window, self._decoder)
            yield window, angles, self._navigator.step(angles)


def _angles(window: Window, decoder: PulseDecoder) -> SweepAngles:
    if window.pulses is not None:
        return decoder.decode(window.pulses)
    assert window.angles is not None
    return window.angles


def _layout(log: Recording, known: StationCalibration | None) -> Photodiodes:
    """The object's photodiodes as its maker says, or as a calibration has found them."""
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
