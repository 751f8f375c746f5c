"""The folder that a run leaves: `scenario.toml`, `telemetry.parquet`, `summary.json`, `recording.rrd`, and
`angles.parquet` where it was asked for, `scans.parquet` where there are LiDARs, `filter.history/` for the smoother, and
what that has made of it: `smooth.parquet` and `smooth.rrd`. `summary.json` is its marker. `inputs/` holds the files
that the scenario names.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Any

import pyarrow as pa

from swarm.results.disk import writing
from swarm.results.files import (
    ANGLES,
    DRAWN,
    FIGURES,
    HISTORY,
    PARTS,
    RECORDING,
    REPORT,
    SCANS,
    SCENARIO,
    SMOOTH,
    SMOOTH_RECORDING,
    SUMMARY,
    TELEMETRY,
)
from swarm.results.inputs import FOLDER, PATTERNS
from swarm.results.owned_folder import PROGRAM, RUNS, Contents, OwnedFolder, Status, find, folder_of, refuse_taken
from swarm.results.parquet import PARTIAL, PARTIAL_FILES
from swarm.results.reading import read_telemetry
from swarm.user_text import read_text

__all__ = ["PROGRAM", "RUNS", "SCENARIO", "Run", "RunFolder", "open_run"]
CONTENTS = Contents(
    "a run",
    SUMMARY,
    (SCENARIO, TELEMETRY, RECORDING, ANGLES, SCANS, SMOOTH, SMOOTH_RECORDING, REPORT),
    {
        # Arrow files are those of the filters' history, and of what an earlier version has left.
        **dict.fromkeys(
            (PARTS, HISTORY, *(name + PARTIAL for name in (ANGLES, SCANS, SMOOTH))), ("part-*.arrow", *PARTIAL_FILES)
        ),
        FIGURES: DRAWN,
        FOLDER: PATTERNS,
    },
)


def refuse_run(scenario: str, seed: int, out: str | Path | None = None, force: bool = False) -> None:
    """Look whether a run may be written to its folder, before anything is built for it.

    Args:
        scenario: Name of the scenario.
        seed: Its seed.
        out: The folder, if not the usual one.
        force: Replace a run that is there.

    Raises:
        SwarmError: As `refuse_taken`.
    """
    refuse_taken(folder_of(scenario, seed, out), CONTENTS, force)


class RunFolder(OwnedFolder):
    """A new run's folder."""

    def __init__(self, path: Path, force: bool = False) -> None:
        """Create `path`, or with `force` empty it of an earlier run's files. Raises SwarmError, as `OwnedFolder`."""
        super().__init__(path, CONTENTS, force=force)

    @classmethod
    def create(cls, scenario: str, seed: int, out: str | Path | None = None, force: bool = False) -> "RunFolder":
        """Return the folder `runs/<scenario>-<seed>`, or `out`.

        Args:
            scenario: Name of the scenario.
            seed: Its seed.
            out: The folder, if not the usual one.
            force: Replace a run that is there.

        Raises:
            SwarmError: As `OwnedFolder`.
        """
        return cls(folder_of(scenario, seed, out), force)

    @property
    def recording(self) -> Path:
        """The recording's file."""
        return self.path / RECORDING

    def write_scenario(self, text: str, files: Mapping[PurePosixPath, bytes] = MappingProxyType({})) -> None:
        """Write the resolved scenario, TOML `text`, and the files that it names, by their paths in this folder.

        Raises SwarmError where they cannot be written.
        """
        self.list_inputs(map(str, files))
        for name, data in files.items():
            with writing(self.path / name):
                (self.path / name).parent.mkdir(parents=True, exist_ok=True)
            self.replace(str(name), lambda file, data=data: file.write_bytes(data))  # type: ignore[misc]
        self.write_text(SCENARIO, text)


@dataclass(frozen=True, repr=False)
class Run:
    """A run on disk. status: "complete", "interrupted", or "running", which a killed run stays for ever."""

    folder: Path
    status: Status
    summary: dict[str, Any]

    def __repr__(self) -> str:
        """Say in one line which run this is, and how it went."""
        return f"<Run {self.folder}: {', '.join(self._facts().values())}>"

    def _repr_html_(self) -> str:
        """Say it in a table, for notebooks."""
        rows = "".join(
            f"<tr><th>{escape(name)}</th><td>{escape(fact)}</td></tr>" for name, fact in self._facts().items()
        )
        return f"<table><caption>Run {escape(str(self.folder))}</caption>{rows}</table>"

    def _facts(self) -> dict[str, str]:
        """Return what a summary tells first, by its heading; a run that was killed, or edited, tells less."""
        whole, swarm = self.summary, self.summary.get("swarm")
        facts = {"status": str(self.status)}
        told = (
            ("craft", whole, "craft_count", 1.0, "{:.0f} craft"),
            ("flown", whole, "duration_s", 1.0, "{:.1f} s"),
            ("tracking", swarm, "tracking_share", 100.0, "{:.0f} % tracking"),
            ("position error, RMS", swarm, "ekf_position_rms_m", 1e3, "{:.3g} mm"),
            ("attitude error, RMS", swarm, "ekf_attitude_rms_deg", 1.0, "{:.3g} deg"),
        )
        for name, figures, key, scale, form in told:
            value = figures.get(key) if isinstance(figures, dict) else None
            if isinstance(value, int | float):
                facts[name] = form.format(scale * value)
        if isinstance(held := whole.get("criteria_held"), bool):
            facts["criteria"] = "criteria held" if held else "criteria missed"
        return facts

    @cached_property
    def telemetry(self) -> pa.Table:
        """One row per craft and lighthouse period (docs/telemetry.md), read when first asked for."""
        return read_telemetry(self.folder)

    @property
    def scenario(self) -> str | None:
        """The resolved scenario's TOML text, or None where the run was stopped before it was written."""
        file = self.folder / SCENARIO
        return read_text(file, str(file)) if file.exists() else None

    @property
    def recording(self) -> Path | None:
        """The recording, or None where the run was made without."""
        file = self.folder / RECORDING
        return file if file.exists() else None

    @property
    def smoothed_recording(self) -> Path | None:
        """The recording of what `swarm smooth` has found, which belongs to the other, or None."""
        file = self.folder / SMOOTH_RECORDING
        return file if file.exists() else None


def open_run(path: str | Path) -> Run:
    """Return the run in the folder `path`, or in `runs/<path>` where there is no such folder.

    Raises SwarmError where it is not a run, and names the nearest that is.
    """
    folder, summary = find(path, CONTENTS)
    return Run(folder, summary.get("status", "running"), summary)
