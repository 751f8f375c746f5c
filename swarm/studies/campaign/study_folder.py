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
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from swarm.errors import SwarmError, did_you_mean
from swarm.results.disk import FolderLock, write_text, writing
from swarm.results.run_folder import PROGRAM, RUNS
from swarm.scenario.text import toml_value
from swarm.studies.campaign.plan import PlannedRun
from swarm.studies.campaign.task import HEAD, LOST, SECONDS
from swarm.units import written_unit

STUDY, STATE, ROWS, JOURNAL, TELEMETRY = "study.toml", "study.json", "runs.parquet", "journal.jsonl", "telemetry"
REPORT, FIGURES = "report.html", "figures"
PARQUET_SHARE = 0.05
"""Share of the time that may go into replacing the Parquet file meanwhile."""

Row = dict[str, Any]


class FinishedStudy(NamedTuple):
    """A study on disk. state: study.json. rows: runs.parquet, or what the journal has where that is older."""

    folder: Path
    state: dict[str, Any]
    rows: pa.Table

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
        return (self.folder / STUDY).read_text(encoding="utf-8")


@dataclass
class StudyFolder:
    """A study's folder while its runs come in: `add` each, `write_state` when something has changed for good."""

    path: Path
    parameters: Sequence[str]
    rows: dict[str, Row]
    lock: FolderLock | None = None

    def __post_init__(self) -> None:
        self._written_s, self._cost_s = time.monotonic(), 0.0

    @classmethod
    def open(
        cls, path: Path, runs: Sequence[PlannedRun], versions: Sequence[str], *, force: bool, resume: bool
    ) -> "StudyFolder":
        """A new folder, or with `resume` one with the rows of an earlier start; `force` empties it.

        Nobody else can write there until `release`. Raises SwarmError where there is a study already, or files in the
        way, or where the earlier start does not fit: another version, or finished runs that this study does not plan.
        """
        with writing(path):
            path.mkdir(parents=True, exist_ok=True)
        lock = FolderLock(path)
        try:
            return cls._claim(path, runs, versions, lock, force=force, resume=resume)
        except BaseException:
            lock.release()
            raise

    @classmethod
    def _claim(
        cls,
        path: Path,
        runs: Sequence[PlannedRun],
        versions: Sequence[str],
        lock: FolderLock,
        *,
        force: bool,
        resume: bool,
    ) -> "StudyFolder":
        parameters = list(dict.fromkeys(key for run in runs for key in run.parameters))
        state = _state_of(path)
        if state is None:
            _refuse_strangers(path)
        elif force:
            _empty(path)
        elif not resume and _rows_of(path):
            raise SwarmError(f"{path} holds a study already; --resume continues it, --force starts again")
        kept = _kept(path, runs, versions, state) if state is not None and not force else {}
        return cls(path, parameters, kept, lock)

    @cached_property
    def _journal(self) -> Any:
        return (self.path / JOURNAL).open("a", encoding="utf-8")

    def add(self, row: Row, telemetry: bytes | None = None) -> None:
        """Take one finished run. Raises SwarmError where it cannot be written."""
        if telemetry is not None:
            place = self.path / TELEMETRY
            with writing(place):
                place.mkdir(exist_ok=True)
                file = place / f"{row['key']}.parquet"
                file.with_suffix(".tmp").write_bytes(telemetry)
                file.with_suffix(".tmp").replace(file)
        with writing(self.path / JOURNAL):
            self._journal.write(json.dumps(row, allow_nan=False) + "\n")
            self._journal.flush()
            os.fsync(self._journal.fileno())
        self.rows[row["key"]] = row
        if time.monotonic() - self._written_s > self._cost_s / PARQUET_SHARE + 1.0:
            self.write_rows()

    def write_rows(self) -> None:
        """Replace runs.parquet by all rows there are."""
        began = time.monotonic()
        table = table_of(self.rows.values(), self.parameters)
        file = self.path / ROWS
        with writing(file):
            pq.write_table(table, file.with_suffix(".tmp"))
            file.with_suffix(".tmp").replace(file)
        self._written_s = time.monotonic()
        self._cost_s = self._written_s - began

    def write_state(self, status: str, **content: Any) -> None:
        """Replace study.json."""
        head = {"program": PROGRAM, "kind": "study", "status": status, "parameters": list(self.parameters)}
        write_text(self.path / STATE, json.dumps({**head, **content}, indent=2) + "\n")

    def pause(self) -> None:
        """Nothing more comes for now."""
        if "_journal" in self.__dict__:
            self._journal.close()
            del self.__dict__["_journal"]
        self.write_rows()

    def close(self) -> None:
        """Nothing more will come: everything is in runs.parquet, and the journal has done its work."""
        self.pause()
        (self.path / JOURNAL).unlink(missing_ok=True)

    def release(self) -> None:
        """Others may write there."""
        if self.lock is not None:
            self.lock.release()


def open_study(path: str | Path) -> FinishedStudy:
    """The study in the folder `path`, or `runs/<path>`. Raises SwarmError where there is none."""
    folder = Path(path)
    if not folder.exists() and (RUNS / folder).is_dir():
        folder = RUNS / folder
    state = _state_of(folder)
    if state is None:
        known = [str(file.parent) for file in RUNS.glob(f"*/{STATE}")]
        missing = "there is no such folder" if not folder.exists() else f"it has no {STATE} of {PROGRAM}"
        raise SwarmError(f"{path} is not a study: {missing}{did_you_mean(str(path), known)}")
    rows = _rows_of(folder)
    return FinishedStudy(folder, state, table_of(rows.values(), state.get("parameters", [])))


def is_study(path: str | Path) -> bool:
    """Whether `path`, or `runs/<path>`, is the folder of a study."""
    return any(_state_of(folder) is not None for folder in (Path(path), RUNS / path))


def table_of(rows: Iterable[Row], parameters: Sequence[str]) -> pa.Table:
    """Rows in order of their numbers; columns: the head, the parameters, the metrics, seconds."""
    ordered = sorted(rows, key=lambda row: int(row["run"]))
    names = dict.fromkeys([*HEAD, *parameters])
    for row in ordered:
        names |= dict.fromkeys(row)
    names.pop(SECONDS, None)
    fields, columns = [], []
    for name in [*names, SECONDS]:
        column = _column([row.get(name) for row in ordered], name in ("key", "status", "reason"))
        fields.append(pa.field(name, column.type, metadata={"unit": written_unit(name)}))
        columns.append(column)
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))


def _column(values: list[Any], is_text: bool) -> pa.Array:
    """One column of one type: numbers stay numbers, what else is mixed or nested becomes TOML text."""
    kinds = {type(value) for value in values if value is not None}
    if is_text or kinds == {str}:
        return pa.array(values, pa.string())
    if kinds == {bool}:
        return pa.array(values, pa.bool_())
    if kinds == {int}:
        return pa.array(values, pa.int64())
    if kinds <= {int, float}:
        return pa.array([None if value is None else float(value) for value in values], pa.float64())
    return pa.array([None if value is None else toml_value(value) for value in values], pa.string())


def _state_of(folder: Path) -> dict[str, Any] | None:
    try:
        state = json.loads((folder / STATE).read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError) as error:
        raise SwarmError(f"cannot read {folder / STATE}: {error}") from error
    return state if isinstance(state, dict) and state.get("program") == PROGRAM else None


def _rows_of(folder: Path) -> dict[str, Row]:
    rows: dict[str, Row] = {}
    try:
        if (folder / ROWS).exists():
            rows |= {row["key"]: row for row in pq.read_table(folder / ROWS).to_pylist()}
        if (folder / JOURNAL).exists():
            for line in (folder / JOURNAL).read_text(encoding="utf-8").splitlines(keepends=True):
                if line.endswith("\n"):  # else the program was killed while it wrote
                    row = json.loads(line)
                    rows[row["key"]] = row
    except (OSError, ValueError, pa.ArrowException) as error:
        raise SwarmError(f"cannot read the runs in {folder}: {error}") from error
    return rows


def _kept(path: Path, runs: Sequence[PlannedRun], versions: Sequence[str], state: Mapping[str, Any]) -> dict[str, Row]:
    """The rows of an earlier start that this one need not compute again."""
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


def _refuse_strangers(path: Path) -> None:
    for name in (STUDY, STATE, ROWS, JOURNAL, TELEMETRY, "summary.json"):
        if (path / name).exists():
            raise SwarmError(
                f"{path / name} is not a study's, and a study would write there; move it away or choose another --out"
            )


def _empty(path: Path) -> None:
    with writing(path):
        for file in (path / TELEMETRY).glob("*.parquet"):
            file.unlink()
        for name in (STUDY, ROWS, JOURNAL, REPORT):
            (path / name).unlink(missing_ok=True)
