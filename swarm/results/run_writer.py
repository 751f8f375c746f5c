"""One door for all that a run writes: folder, scenario, telemetry, recording, summary; one `append` per period."""

import platform
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, NoReturn, Protocol, TypeVar

import numpy as np

from swarm.errors import PlaceError, SwarmError
from swarm.onboard.settings import by_light
from swarm.results.angles import AngleWriter, Believed
from swarm.results.columns.groups import groups_of
from swarm.results.columns.schema import schema
from swarm.results.criteria import check_measures, judge, summary_of
from swarm.results.filter_history import HistoryWriter
from swarm.results.inputs import inputs_of
from swarm.results.lidar_scans import ScanWriter
from swarm.results.owned_folder import STOPPED
from swarm.results.period import Period
from swarm.results.progress import Progress
from swarm.results.replayed import FILE as REPLAYED
from swarm.results.replayed import replayed_bytes
from swarm.results.run_folder import Run, RunFolder, open_run
from swarm.results.scene import NullRecording, Recorder, Scene
from swarm.results.summary import Account, summarise_run
from swarm.results.table import TelemetryTable
from swarm.results.telemetry import Telemetry
from swarm.scenario import Scenario, craft, to_toml
from swarm.scenario.motions.dock import Dock
from swarm.version import VERSION

VERSIONS = ("mujoco", "numpy", "scipy", "numba", "filterpy", "rerun-sdk")
"""Packages that a run's numbers depend on."""
W = TypeVar("W", bound="Closes")


class Closes(Protocol):
    """Anything that is completed at the end of a run."""

    def close(self) -> None:
        """Write what is left. Raises SwarmError on a full disk."""


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
        history: HistoryWriter | None = None,
    ) -> None:
        """Take the open writers.

        Args:
            telemetry: Writes the telemetry.
            recording: Draws the run.
            craft_count: Craft that navigate, for the progress.
            duration_s: Length of the run [s].
            angles: Writes the sweep angles, if they are wanted.
            scans: Writes the LiDARs' scans, if there are LiDARs.
            history: Writes what the filters predicted and believed, if it is wanted.
        """
        self.notice = recording.notice
        self._telemetry, self._recording, self._angles, self._scans = telemetry, recording, angles, scans
        self._history = history
        self._craft_count, self._duration_s = craft_count, duration_s
        self._time_s, self._status = 0.0, np.zeros(0, dtype=np.int64)

    def append(self, period: Period) -> None:
        """Take one period of all craft. Raises SwarmError on a full disk."""
        self._recording.append(period, self._telemetry.append(period))
        if self._angles is not None:
            self._angles.append(period.frame, period.angles)
        if self._scans is not None:
            self._scans.append(period)
        if self._history is not None:
            self._history.append(period)
        self._time_s, self._status = period.time_s, period.estimate.status

    @property
    def progress(self) -> Progress:
        """The state of the run."""
        tracking = int(np.count_nonzero(by_light(self._status)))
        return Progress(self._time_s, self._duration_s, tracking, self._craft_count, self.notice)


def check_criteria(scenario: Scenario, scene: Scene) -> None:
    """Raise SwarmError where a criterion is about nothing that a run of this scene measures."""
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
    history: bool = False,
    command: str = "",
    found: Mapping[str, Any] | None = None,
) -> Iterator[RunWriter]:
    """Open a run's folder for the block; it is closed however the block ends.

    A run that is stopped, by Ctrl-C or an error, is summarised as far as it went and marked as interrupted, and what
    stopped it is raised on. At the end of a complete run the scenario's criteria are judged.

    Args:
        scenario: What is flown.
        out: The folder; None: `runs/<scenario>-<seed>`.
        scene: What does not change during the run.
        force: Replace a run that is there.
        duration_s: Length of the run [s].
        record: Write recording.rrd.
        live: Show the recording meanwhile.
        angles: What the craft believe, where their sweep angles are written.
        history: Keep the history of the filters; their estimates carry the predictions.
        command: The command that repeats the run, where it is not `swarm run` of its scenario.
        found: What else the summary of a complete run has, by key.

    Raises:
        SwarmError: Nothing can be written, or a criterion measures what this run does not.
    """
    check_criteria(scenario, scene)
    # Read before the folder is emptied: they may be in it, in a run that is flown again in its own place.
    inputs = inputs_of(scenario, models=not scene.replay)
    with RunFolder.create(scenario.name, scenario.seed, out, force) as folder:
        head = [*versions(), *inputs.plug_ins, *([command] if command else [])]
        replayed = {REPLAYED: replayed_bytes(scene)} if scene.replay else {}
        folder.write_scenario(to_toml(inputs.scenario, head), inputs.files | replayed)
        account = Account(scene.craft, scene.without_sensors, scene.equipment)
        try:
            with ExitStack() as stack:
                scans = stack.enter_context(_closing(ScanWriter(folder.path, scene.craft))) if scene.lidar else None
                beliefs = stack.enter_context(_closing(AngleWriter(folder.path, angles))) if angles else None
                past = stack.enter_context(_closing(HistoryWriter(folder.path, len(scene.craft)))) if history else None
                about = scene.without_sensors, scene.equipment, scene.angle_noise_rad
                telemetry = Telemetry(folder.path, scene.craft, groups_of(scene), *about, account.take)
                stack.enter_context(_closing(telemetry))
                recording = _recorder(folder, scene, (record and scenario.recording.enabled) or live, live)
                stack.enter_context(_closing(recording))
                count = len(scene.craft) - len(scene.without_sensors)
                writer = RunWriter(telemetry, recording, count, duration_s, beliefs, scans, past)
                yield writer
        except BaseException as stop:
            _raise_on(stop, _interrupt(folder, _reason(stop)))
        folder.finish({**summarise_run(folder.path, account), **(found or {}), **_judged(scenario, folder.path)})
        writer.run = open_run(folder.path)


def _judged(scenario: Scenario, folder: Path) -> dict[str, Any]:
    """Return what the scenario's criteria say of a run, for its summary."""
    motions = [(each.name, each.table.motion) for each in craft(scenario)]
    closing = {name: motion.closing_speed_m_s for name, motion in motions if isinstance(motion, Dock)}
    return summary_of(judge(scenario.criteria, TelemetryTable.of_run(folder), closing))


def _interrupt(folder: RunFolder, reason: str) -> Mapping[str, Any] | None:
    """Mark the run as interrupted, with its figures as far as it went, which are returned if there are any.

    What cannot be written is passed over.
    """
    # A second failure (the disk is still full) must not hide the first.
    summary = None
    with suppress(SwarmError):
        summary = summarise_run(folder.path)
    with suppress(SwarmError):
        folder.interrupt(reason, summary)
    return summary


def _raise_on(stop: BaseException, kept: Mapping[str, Any] | None) -> NoReturn:
    """Raise what stopped a run; of a full disk with the seconds of flight that its summary has."""
    # Of places, only a full disk has other ways than another place.
    if isinstance(stop, PlaceError) and stop.ways and kept:
        raise PlaceError(f"{stop.fault}, {kept['duration_s']:.1f} s of flight", *stop.ways) from stop
    raise stop


@contextmanager
def _closing(writer: W) -> Iterator[W]:
    """Close the writer after the block; if the block has failed, a failure to close does not hide why."""
    try:
        yield writer
    except BaseException:
        with suppress(SwarmError):
            writer.close()
        raise
    writer.close()


def _recorder(folder: RunFolder, scene: Scene, record: bool, live: bool) -> Recorder:
    if not record:
        return NullRecording()
    # rerun takes most of a second to import: only who records pays for it.
    from swarm.results.recording.recording import Recording

    return Recording(folder.recording, scene, live=live)


def versions() -> list[str]:
    """Return the versions that a run's numbers depend on, a line each."""
    return [
        f"lighthouse-swarm {VERSION}",
        f"Python {platform.python_version()}",
        *(f"{name} {version(name)}" for name in VERSIONS),
    ]


def _reason(stop: BaseException) -> str:
    return STOPPED if isinstance(stop, KeyboardInterrupt) else str(stop) or type(stop).__name__
