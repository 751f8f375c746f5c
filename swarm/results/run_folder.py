"""The folder that a run leaves: `scenario.toml`, `telemetry.parquet`, `summary.json`, `recording.rrd`, and
`angles.parquet` where it was asked for, `scans.parquet` where there are LiDARs.

`summary.json` is written first and says what the folder is worth: its `status` is "running" until the run has ended,
then "complete" or "interrupted" (with a `reason`); a run that was killed stays "running" for ever. It also says which
program wrote it, and that is the licence to replace the folder's files under `--force`: nothing else is ever deleted.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import pyarrow as pa

from swarm.errors import SwarmError, did_you_mean
from swarm.results import angles, lidar_scans
from swarm.results.disk import FolderLock, write_text, writing
from swarm.results.reading import FILE, PARTS, read_telemetry

PROGRAM = "lighthouse-swarm"
RUNS = Path("runs")
SCENARIO, SUMMARY, RECORDING = "scenario.toml", "summary.json", "recording.rrd"
Status = Literal["running", "complete", "interrupted"]


def _version() -> str | None:
    try:
        return version(PROGRAM)
    except PackageNotFoundError:
        return None


def _summary_of(folder: Path) -> dict[str, Any] | None:
    """The summary in `folder` if it is one of this program's, else None. Raises SwarmError where it is damaged."""
    try:
        text = (folder / SUMMARY).read_text(encoding="utf-8")
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise SwarmError(f"cannot read {folder / SUMMARY}: {error}") from error
    try:
        summary = json.loads(text)
    except json.JSONDecodeError as error:
        raise SwarmError(f"{folder / SUMMARY} is damaged: {error}") from error
    return summary if isinstance(summary, dict) and summary.get("program") == PROGRAM else None


class RunFolder:
    """A new run's folder. As a context manager it marks the run as interrupted if the block fails.

    After the block `finish` must have been called: a run without a summary is not complete.
    """

    def __init__(self, path: Path, force: bool = False) -> None:
        """Create `path`, or with `force` empty it of an earlier run's files.

        Raises SwarmError where there is a run already, where files stand in the way, or where nothing can be written.
        """
        self.path = path
        self._finished = False
        with writing(path):
            if path.exists() and not path.is_dir():
                raise SwarmError(f"cannot write {path}: a file is in its place; choose another --out")
            path.mkdir(parents=True, exist_ok=True)
        self._lock = FolderLock(path)
        try:
            self._claim(force)
        except BaseException:
            self._lock.release()
            raise

    def _claim(self, force: bool) -> None:
        path = self.path
        ours = _summary_of(path) is not None
        if ours and not force:
            raise SwarmError(
                f"{path} holds a run already; --force (force=True) replaces it, --out (out=...) writes elsewhere"
            )
        if not ours:
            for name in (SUMMARY, SCENARIO, FILE, PARTS, RECORDING, angles.FILE, lidar_scans.FILE):
                if (path / name).exists():
                    raise SwarmError(
                        f"{path / name} was not written by {PROGRAM}, and a run would replace it; move it away "
                        "or choose another --out"
                    )
        self._write_summary("running", {})
        self._remove_earlier()

    @classmethod
    def create(cls, scenario: str, seed: int, out: Path | None = None, force: bool = False) -> "RunFolder":
        """The folder `runs/<scenario>-<seed>`, or `out`."""
        return cls(out if out is not None else RUNS / f"{scenario}-{seed}", force)

    @property
    def recording(self) -> Path:
        """Where the recording goes."""
        return self.path / RECORDING

    def _remove_earlier(self) -> None:
        parts = self.path / PARTS
        with writing(self.path):
            for name in (SCENARIO, FILE, RECORDING, *(f for m in (angles, lidar_scans) for f in (m.FILE, m.PARTIAL))):
                (self.path / name).unlink(missing_ok=True)
            if parts.is_dir():
                for file in [*parts.glob("part-*.arrow"), *parts.glob("part-*.tmp"), parts / "joined.tmp"]:
                    file.unlink(missing_ok=True)
                if any(parts.iterdir()):
                    raise SwarmError(f"{parts} holds files that {PROGRAM} did not write; move them away")
                parts.rmdir()

    def _write_summary(self, status: Status, content: Mapping[str, Any]) -> None:
        head = {"program": PROGRAM, "version": _version(), "status": status}
        try:
            text = json.dumps({**head, **content}, indent=2, allow_nan=False)
        except ValueError as error:
            raise ValueError("a summary has null where a figure is missing, never NaN") from error
        write_text(self.path / SUMMARY, text + "\n")

    def write_scenario(self, text: str) -> None:
        """Write the resolved scenario, TOML `text`. Raises SwarmError where it cannot be written."""
        write_text(self.path / SCENARIO, text)

    def finish(self, summary: Mapping[str, Any]) -> None:
        """The run is complete: replace the marker by its summary (JSON-able, no NaN)."""
        self._write_summary("complete", summary)
        self._finished = True
        self._lock.release()

    def interrupt(self, reason: str, summary: Mapping[str, Any] | None = None) -> None:
        """The run ended early because of `reason`: say so, with a summary of what there is."""
        self._write_summary("interrupted", {"reason": reason, **(summary or {})})
        self._finished = True

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.release()
        if self._finished:
            return
        if kind is None:
            raise RuntimeError(f"the run in {self.path} ended without a summary")
        reason = "stopped by the user" if issubclass(kind, KeyboardInterrupt) else f"{kind.__name__}: {error}"
        try:
            self.interrupt(reason)
        except SwarmError:
            # The first error is what the user must see; on a full disk "running" stays, which is also true.
            return


@dataclass(frozen=True)
class Run:
    """A run on disk. status: "complete", "interrupted", or "running", which a killed run stays for ever."""

    folder: Path
    status: Status
    summary: dict[str, Any]

    @cached_property
    def telemetry(self) -> pa.Table:
        """One row per craft and lighthouse period (docs/telemetry.md), read when first asked for."""
        return read_telemetry(self.folder)

    @property
    def scenario(self) -> str | None:
        """The resolved scenario's TOML text, or None where the run was stopped before it was written."""
        file = self.folder / SCENARIO
        return file.read_text(encoding="utf-8") if file.exists() else None

    @property
    def recording(self) -> Path | None:
        """The recording, or None where the run was made without."""
        file = self.folder / RECORDING
        return file if file.exists() else None


def _runs_in(folder: Path) -> list[Path]:
    return sorted(file.parent for file in folder.glob(f"*/{SUMMARY}")) if folder.is_dir() else []


def open_run(path: str | Path) -> Run:
    """Open the run in the folder `path`, or `runs/<path>` where there is no such folder.

    Raises SwarmError where it is not a run, and names the nearest that is.
    """
    folder = Path(path)
    if not folder.exists() and (RUNS / folder).is_dir():
        folder = RUNS / folder
    summary = _summary_of(folder)
    if summary is None:
        missing = "there is no such folder" if not folder.exists() else f"it has no {SUMMARY} of {PROGRAM}"
        known = [str(run) for run in {*_runs_in(folder), *_runs_in(folder.parent), *_runs_in(RUNS)}]
        raise SwarmError(f"{path} is not a run: {missing}{did_you_mean(str(path), known)}")
    return Run(folder, summary.get("status", "running"), summary)
