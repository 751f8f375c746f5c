"""Everything that a run writes, behind one `append` per period: folder, scenario, telemetry, recording, summary."""

import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path

import numpy as np

from swarm import __version__
from swarm.errors import SwarmError
from swarm.onboard.settings import Status
from swarm.results.angles import AngleWriter, Believed
from swarm.results.columns.groups import groups_of
from swarm.results.columns.schema import schema
from swarm.results.criteria import check_measures, judge, summary_of
from swarm.results.lidar_scans import ScanWriter
from swarm.results.period import Period
from swarm.results.progress import Progress
from swarm.results.recording.scene import NullRecording, Recorder, Scene
from swarm.results.run_folder import Run, RunFolder, open_run
from swarm.results.summary import summarise_run
from swarm.results.table import TelemetryTable
from swarm.results.telemetry import Telemetry
from swarm.scenario import Scenario, to_toml

VERSIONS = ("mujoco", "numpy", "scipy", "numba", "filterpy", "rerun-sdk")
"""What a run's numbers depend on."""


class RunWriter:
    """Takes the periods of one run. run: that run, opened, once `writing_run` has closed it."""

    run: Run

    def __init__(
        self,
        telemetry: Telemetry,
        recording: Recorder,
        craft_count: int,
        duration_s: float,
        angles: AngleWriter | None = None,
        scans: ScanWriter | None = None,
    ) -> None:
        self.notice = recording.notice
        self._telemetry, self._recording, self._angles, self._scans = telemetry, recording, angles, scans
        self._craft_count, self._duration_s = craft_count, duration_s
        self._started_s = time.perf_counter()
        self._time_s, self._tracking = 0.0, 0

    def append(self, period: Period) -> None:
        """Take one period of all craft. Raises SwarmError on a full disk."""
        self._recording.append(period, self._telemetry.append(period))
        if self._angles is not None:
            self._angles.append(period.frame, period.angles)
        if self._scans is not None and period.truth is not None:
            self._scans.append(period.time_s, period.frame, period.scans, period.truth)
        self._time_s = period.time_s
        self._tracking = int(np.count_nonzero(period.estimate.status == Status.TRACKING))

    @property
    def progress(self) -> Progress:
        """How far the run is."""
        wall_s = time.perf_counter() - self._started_s
        return Progress(
            self._time_s, self._duration_s, self._time_s / wall_s, self._tracking, self._craft_count, self.notice
        )


def check_criteria(scenario: Scenario, scene: Scene) -> None:
    """Raises SwarmError where a criterion is about nothing that a run of this scene measures."""
    check_measures(scenario.criteria, schema(groups_of(scene)), scenario.name)


@contextmanager
def writing_run(
    scenario: Scenario,
    out: str | Path | None,
    scene: Scene,
    *,
    force: bool,
    duration_s: float,
    record: bool = True,
    live: bool = False,
    angles: Believed | None = None,
) -> Iterator[RunWriter]:
    """A run's folder, `runs/<scenario>-<seed>` or `out`, open for the block; closed however the block ends.

    force: replace a run that is there. record: write recording.rrd of `scene`; live: show it meanwhile. angles: what
    the craft believe, for a run that writes their sweep angles. A run that is stopped, by Ctrl-C or an error, is
    summarised as far as it went and marked as interrupted, and what stopped it is raised on; the scenario's criteria
    are judged at the end. Raises SwarmError where nothing can be written, or where a criterion measures what this run
    does not.
    """
    check_criteria(scenario, scene)
    with RunFolder.create(scenario.name, scenario.seed, None if out is None else Path(out), force) as folder:
        folder.write_scenario(to_toml(scenario, versions()))
        telemetry = Telemetry(folder.path, scene.craft, groups_of(scene), scene.without_sensors)
        recording: Recorder = NullRecording()
        if (record and scenario.recording.enabled) or live:
            # rerun takes most of a second to import: only who records pays for it.
            from swarm.results.recording.recording import Recording

            recording = Recording(folder.recording, scene, live=live)
        angle_writer = AngleWriter(folder.path, angles) if angles is not None else None
        scan_writer = ScanWriter(folder.path, scene.craft) if scene.lidar else None
        navigating = len(scene.craft) - len(scene.without_sensors)
        writer = RunWriter(telemetry, recording, navigating, duration_s, angle_writer, scan_writer)
        try:
            yield writer
        except BaseException as stop:
            # A second failure (the disk is still full) must not hide the first, nor keep the rest from closing.
            with suppress(SwarmError):
                recording.close()
            with suppress(SwarmError):
                telemetry.close()
            if angle_writer is not None:
                with suppress(SwarmError):
                    angle_writer.close()
            if scan_writer is not None:
                with suppress(SwarmError):
                    scan_writer.close()
            summary = None
            with suppress(SwarmError):
                summary = summarise_run(folder.path)
            with suppress(SwarmError):
                folder.interrupt(_reason(stop), summary)
            raise
        recording.close()
        telemetry.close()
        if angle_writer is not None:
            angle_writer.close()
        if scan_writer is not None:
            scan_writer.close()
        verdicts = judge(scenario.criteria, TelemetryTable.of_run(folder.path))
        folder.finish({**summarise_run(folder.path), **summary_of(verdicts)})
        writer.run = open_run(folder.path)


def versions() -> list[str]:
    """The versions that a run's numbers depend on, a line each."""
    return [
        f"lighthouse-swarm {__version__}",
        f"Python {platform.python_version()}",
        *(f"{name} {version(name)}" for name in VERSIONS),
    ]


def _reason(stop: BaseException) -> str:
    return "stopped by the user" if isinstance(stop, KeyboardInterrupt) else str(stop) or type(stop).__name__
