"""The folder of a study: `study.toml`, `study.json`, `runs.parquet`, and `telemetry/` where it is kept.

    study.json      what the folder is worth: status running, complete or interrupted, how many runs, how long, on what
    runs.parquet    one row per run: number, key, status, reason, seed, parameters, metrics with units in names, seconds
    journal.jsonl   the same rows as they come, until the study is complete; a kill loses at most the line being written

A row is in the journal, on disk, before its run counts as finished; the Parquet file is replaced as a whole now and
then and at the end. Numbers pass through the journal unchanged: JSON writes the shortest text that reads back equal.
"""

import json
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TextIO

from swarm.errors import SwarmError
from swarm.results.disk import writing
from swarm.results.files import DRAWN, FIGURES, REPORT, SUMMARY
from swarm.results.owned_folder import Contents, OwnedFolder, Status, find, marker_in
from swarm.results.parquet import Kind, Table, column, read_table, table_of, write_table
from swarm.results.shape import Keys, Leaf, check_shape
from swarm.scenario.text import toml_value
from swarm.studies.campaign.plan import PlannedRun
from swarm.studies.campaign.task import HEAD, LOST, SECONDS
from swarm.units import written_unit
from swarm.user_text import parse_json, read_text

STUDY, STATE, ROWS, JOURNAL, TELEMETRY = "study.toml", "study.json", "runs.parquet", "journal.jsonl", "telemetry"
CONTENTS = Contents(
    "a study",
    STATE,
    (STUDY, ROWS, JOURNAL, REPORT),
    {TELEMETRY: ("*.parquet", "*.tmp"), FIGURES: DRAWN},
    "--resume continues it, --force starts again",
)
PARQUET_SHARE = 0.05
"""Share of the time that may go into replacing the Parquet file meanwhile."""

_KINDS: Mapping[type, Kind] = {str: "text", bool: "yes", int: "whole"}

_STATE = Keys(
    perhaps={
        "status": Leaf.TEXT,
        "name": Leaf.TEXT,
        "description": Leaf.TEXT,
        "command": Leaf.TEXT,
        "machine": Leaf.TEXT,
        "where": Leaf.TEXT,
        "parameters": [Leaf.TEXT],
        "versions": [Leaf.TEXT],
        "planned": Leaf.NUMBER,
        "wall_s": Leaf.NUMBER,
    }
)
_ROW = Keys(
    always={"run": Leaf.NUMBER, "key": Leaf.TEXT, "status": Leaf.TEXT, "seed": Leaf.NUMBER}, known={"reason": Leaf.TEXT}
)
Row = dict[str, Any]


class FinishedStudy(NamedTuple):
    """A study on disk. state: study.json. rows: runs.parquet, or what the journal has where that is older."""

    folder: Path
    state: dict[str, Any]
    rows: Table

    def __repr__(self) -> str:
        """Say in one line which study this is."""
        return f"<Study {self.folder}: {self.status}, {len(self.rows)} of {self.state.get('planned', '?')} runs>"

    @property
    def status(self) -> str:
        """complete, interrupted, or running, which a killed study stays for ever."""
        return str(self.state.get("status", "running"))

    @property
    def parameters(self) -> list[str]:
        """The keys that differ between runs, beside the seed."""
        return list(self.state.get("parameters", []))

    @property
    def text(self) -> str:
        """The study as TOML."""
        file = self.folder / STUDY
        return read_text(file, str(file), "a study")


class StudyFolder(OwnedFolder):
    """A study's folder while its runs come in: `add` each of them."""

    def __init__(
        self, path: Path, parameters: Sequence[str], rows: dict[str, Row], *, force: bool = False, keep: bool = False
    ) -> None:
        """Claim the folder; nobody else can write there until `release`.

        Args:
            path: The folder.
            parameters: Keys that differ between the runs.
            rows: Finished runs of an earlier start, by key.
            force: Replace a study that is there.
            keep: Go on with the study that is there.

        Raises:
            SwarmError: As `OwnedFolder`.
        """
        self.parameters, self.rows = parameters, rows
        self._journal: TextIO | None = None
        self._written_s, self._cost_s = time.monotonic(), 0.0
        super().__init__(path, CONTENTS, force=force, keep=keep)

    @classmethod
    def open(
        cls, path: Path, runs: Sequence[PlannedRun], versions: Sequence[str], *, force: bool, resume: bool
    ) -> "StudyFolder":
        """Claim a new folder, or one of an earlier start.

        Args:
            path: The folder.
            runs: The study's runs.
            versions: Versions of the program and its libraries.
            force: Empty the folder of an earlier start.
            resume: Keep the finished runs of an earlier start.

        Raises:
            SwarmError: There is a study already, files stand in the way, or the earlier start does not fit: another
                version, or finished runs that this study does not plan.
        """
        state = marker_in(path, CONTENTS)
        if state is None and (path / SUMMARY).exists():
            raise SwarmError(f"{path} holds a run, and a study would write there; choose another --out")
        parameters = list(dict.fromkeys(key for run in runs for key in run.parameters))
        keep = resume and not force
        # A study without a single finished run is nothing to protect.
        replace = force or (state is not None and not keep and not _rows_of(path))
        folder = cls(path, parameters, {}, force=replace, keep=keep)
        try:
            if keep and state is not None:
                folder.rows = _kept(path, runs, versions, state)
        except BaseException:
            folder.release()
            raise
        return folder

    def add(self, row: Row, telemetry: bytes | None = None) -> None:
        """Take one finished run, and its telemetry. Raises SwarmError where it cannot be written."""
        if telemetry is not None:
            with writing(self.path / TELEMETRY):
                (self.path / TELEMETRY).mkdir(exist_ok=True)
            self.replace(f"{TELEMETRY}/{row['key']}.parquet", lambda file: file.write_bytes(telemetry))
        with writing(self.path / JOURNAL):
            if self._journal is None:
                self._journal = (self.path / JOURNAL).open("a", encoding="utf-8")
            self._journal.write(json.dumps(row, allow_nan=False) + "\n")
            self._journal.flush()
            os.fsync(self._journal.fileno())
        self.rows[row["key"]] = row
        if time.monotonic() - self._written_s > self._cost_s / PARQUET_SHARE + 1.0:
            self.write_rows()

    def write_rows(self) -> None:
        """Replace runs.parquet by all rows there are."""
        began = time.monotonic()
        self.replace(ROWS, lambda file: write_table(rows_table(self.rows.values(), self.parameters), file))
        self._written_s = time.monotonic()
        self._cost_s = self._written_s - began

    def mark(self, status: Status, content: Mapping[str, Any] = MappingProxyType({})) -> None:
        """Replace study.json. Raises SwarmError where it cannot be written."""
        super().mark(status, {"kind": "study", "parameters": list(self.parameters), **content})

    def pause(self) -> None:
        """Write what has come in: nothing more comes for now."""
        if self._journal is not None:
            self._journal.close()
            self._journal = None
        self.write_rows()

    def finish(self, content: Mapping[str, Any]) -> None:
        """Mark the study as complete: everything is in runs.parquet, and the journal has done its work."""
        self.pause()
        (self.path / JOURNAL).unlink(missing_ok=True)
        super().finish(content)


def open_study(path: str | Path) -> FinishedStudy:
    """Return the study in the folder `path`, or `runs/<path>`. Raises SwarmError where there is none."""
    folder, state = find(path, CONTENTS)
    check_shape(state, _STATE, str(folder / STATE))
    return FinishedStudy(folder, state, rows_table(_rows_of(folder).values(), state.get("parameters", [])))


def rows_table(rows: Iterable[Row], parameters: Sequence[str]) -> Table:
    """Return rows in order of their numbers; columns: the head, the parameters, the metrics, seconds."""
    ordered = sorted(rows, key=lambda row: int(row["run"]))
    names = dict.fromkeys([*HEAD, *parameters])
    for row in ordered:
        names |= dict.fromkeys(row)
    names.pop(SECONDS, None)
    columns = []
    for name in [*names, SECONDS]:
        values = [row.get(name) for row in ordered]
        kind = "text" if name in ("key", "status", "reason") else _kind(values)
        if kind is None:
            kind, values = "text", [None if value is None else toml_value(value) for value in values]
        if kind == "number":
            values = [None if value is None else float(value) for value in values]
        columns.append(column(name, values, written_unit(name), kind=kind))
    return table_of(columns)


def _kind(values: list[Any]) -> Kind | None:
    """Return the one type of a column, so that numbers stay numbers; None where values are mixed or nested."""
    kinds = {type(value) for value in values if value is not None}
    for only, kind in _KINDS.items():
        if kinds == {only}:
            return kind
    return "number" if kinds <= {int, float} else None


def _rows_of(folder: Path) -> dict[str, Row]:
    rows: dict[str, Row] = {}
    if (folder / ROWS).exists():
        for row in read_table(folder / ROWS).to_pylist():
            check_shape(row, _ROW, str(folder / ROWS))
            rows[row["key"]] = row
    file = folder / JOURNAL
    if file.exists():
        for number, line in enumerate(read_text(file, str(file)).splitlines(keepends=True), start=1):
            if line.endswith("\n"):  # else the program was killed while it wrote
                row = parse_json(line, f"{file}, line {number},")
                check_shape(row if isinstance(row, dict) else [], _ROW, f"{file}, line {number}")
                rows[row["key"]] = row
    return rows


def _kept(path: Path, runs: Sequence[PlannedRun], versions: Sequence[str], state: Mapping[str, Any]) -> dict[str, Row]:
    """Return the rows of an earlier start that this one need not compute again."""
    rows = _rows_of(path)
    if not rows:
        return {}
    if differing := [f"{a} then, {b} now" for a, b in zip(state.get("versions", []), versions, strict=False) if a != b]:
        raise SwarmError(f"{path} was begun with other versions ({differing[0]}); --force starts again")
    planned = {run.key: run for run in runs}
    kept = {}
    for key, row in rows.items():
        if key not in planned:
            raise SwarmError(
                f"{path} has finished runs that this study does not plan, such as number {row['run']}; "
                "--out writes elsewhere, --force starts again"
            )
        if row["status"] != LOST:
            # Another sample or seed may have moved its number.
            kept[key] = {**row, **planned[key].parameters, "run": planned[key].number}
    return kept
