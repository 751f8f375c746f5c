"""Reading a run's telemetry: the one file of a run that was closed, or what a stopped one has left of it.

What a smoother has found, `smooth.parquet`, has the same rows in the same order: its columns are read as further
columns of the telemetry.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from swarm.errors import SwarmError
from swarm.results.files import SMOOTH, SUMMARY, TELEMETRY
from swarm.results.parquet import open_parquet

PREFIX = "smooth_"
"""Beginning of the names of a smoother's columns."""


def read_telemetry(folder: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """Return the telemetry of the run in `folder`: the whole, or what a stopped run has left (perhaps no row at all).

    columns: only these, if given. Raises SwarmError where a file is damaged.
    """
    if columns is None:
        return _joined(folder, _read_flown(folder, None), _smoothed_columns(folder))
    # By their names: a column of the flight is read without a look into the other file.
    smoothed = [name for name in columns if name.startswith(PREFIX) and (folder / SMOOTH).is_file()]
    flown = [name for name in columns if name not in smoothed]
    return _joined(folder, _read_flown(folder, flown or ["frame"]), smoothed).select(columns)


def _joined(folder: Path, flown: pa.Table, names: Sequence[str]) -> pa.Table:
    """Return the telemetry with these columns of the smoother."""
    if not names:
        return flown
    try:
        with pq.ParquetFile(folder / SMOOTH, memory_map=True) as opened:
            smoothed = _read(opened, names)
    except (OSError, ValueError, KeyError, pa.ArrowException) as error:
        raise SwarmError(f"cannot read {folder / SMOOTH}: {error}") from error
    if len(smoothed) != len(flown):
        raise SwarmError(
            f"{folder / SMOOTH} has {len(smoothed)} rows, and the telemetry {len(flown)}: one of them was changed; "
            "smooth the run again with --force"
        )
    for field in smoothed.schema:
        flown = flown.append_column(field, smoothed.column(field.name))
    return flown


def _smoothed_columns(folder: Path) -> list[str]:
    """Return the names of the columns that a smoother has added; none without one."""
    file = folder / SMOOTH
    if not file.is_file():
        return []
    try:
        return [name for name in pq.read_schema(file).names if name.startswith(PREFIX)]
    except (OSError, pa.ArrowException) as error:
        raise SwarmError(f"cannot read {file}: {error}") from error


def _read_flown(folder: Path, columns: Sequence[str] | None) -> pa.Table:
    try:
        with _opened(folder) as opened:
            return _read(opened, columns)
    except _DAMAGED as error:
        raise SwarmError(f"cannot read the telemetry in {folder}: {error}") from error


_DAMAGED = (OSError, ValueError, KeyError, pa.ArrowException)
"""What pyarrow raises where a file is damaged, or has no such column."""


def _opened(folder: Path, mapped: bool = True) -> pq.ParquetFile:
    """Return the telemetry of the run in `folder`, opened, or mapped into memory. Raises one of _DAMAGED."""
    opened = open_parquet(folder / TELEMETRY, mapped)
    if opened is not None:
        return opened
    if _had_rows(folder):
        raise FileNotFoundError(f"{TELEMETRY} is missing")
    # The columns know the navigation's records, which take a second to import: only a run without rows pays for it.
    from swarm.results.columns.schema import schema

    nothing = pa.BufferOutputStream()
    pq.write_table(schema().empty_table(), nothing)
    return pq.ParquetFile(pa.BufferReader(nothing.getvalue()))


def _had_rows(folder: Path) -> bool:
    """Return whether the summary in a folder is of rows that were there once."""
    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(summary, dict) and bool(summary.get("periods"))


def telemetry_columns(folder: Path) -> list[str]:
    """Return the names of the columns that the run in `folder` has."""
    return flown_columns(folder) + _smoothed_columns(folder)


def flown_columns(folder: Path) -> list[str]:
    """Return the names of the columns that its flight has left, without those of a smoother."""
    names: list[str] = flown_schema(folder).names
    return names


def flown_schema(folder: Path) -> pa.Schema:
    """Return the schema of the columns that the flight of the run in `folder` has left."""
    try:
        with _opened(folder) as opened:
            return opened.schema_arrow
    except _DAMAGED as error:
        raise SwarmError(f"cannot read the telemetry in {folder}: {error}") from error


class RowReader:
    """Rows of a telemetry by their numbers, for those who do not want all of them in memory.

    `rows` reads no more than the row groups of the file that the rows are in.
    """

    def __init__(self, folder: Path, columns: Sequence[str]) -> None:
        """Open the telemetry of the run in `folder`, for some columns. Raises SwarmError where it is damaged."""
        self._folder, self._columns = folder, list(columns)
        self._kept: dict[int, pa.Table] = {}
        try:
            # A file that is mapped counts as memory once it was read.
            self._file = _opened(folder, mapped=False)
        except _DAMAGED as error:
            raise SwarmError(f"cannot read the telemetry in {folder}: {error}") from error
        about = self._file.metadata
        sizes = [about.row_group(i).num_rows for i in range(about.num_row_groups)]
        self.schema: pa.Schema = self._file.schema_arrow
        """The schema of all columns."""
        self._ends = [sum(sizes[: i + 1]) for i in range(len(sizes))]

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    def rows(self, first: int, past: int) -> pa.Table:
        """Return the rows from `first` on, before `past`. Raises SwarmError where a file is damaged."""
        groups = [i for i, end in enumerate(self._ends) if end > first and self._begin(i) < past]
        # Blocks follow each other: what the last one needed of a group, the next one may need too.
        self._kept = {i: self._kept[i] if i in self._kept else self.group(i, self._columns) for i in groups}
        table = pa.concat_tables(self._kept[i] for i in groups)
        return table.slice(first - self._begin(groups[0]), past - first)

    def _begin(self, group: int) -> int:
        return self._ends[group - 1] if group else 0

    @property
    def groups(self) -> int:
        """Number of the groups of rows that were written together."""
        return len(self._ends)

    def group(self, number: int, columns: Sequence[str]) -> pa.Table:
        """Return columns of one group of rows. Raises SwarmError where a file is damaged."""
        try:
            table = self._file.read_row_group(number, columns=list(columns), use_threads=False)
        except _DAMAGED as error:
            raise SwarmError(f"cannot read the telemetry in {self._folder}: {error}") from error
        return table.select(columns)


def _read(opened: pq.ParquetFile, columns: Sequence[str] | None) -> pa.Table:
    """Read columns of a Parquet file, all if None. Raises KeyError where there is no such column.

    One column is read in one thread: several take more than twice the time of the processor, and memory of their own.
    """
    table = opened.read(columns, use_threads=columns is None)
    return table if columns is None else table.select(columns)
