"""Reading a run's telemetry: the one file of a run that was closed, or the parts that a stopped one has left.

What a smoother has found, `smooth.parquet`, has the same rows in the same order: its columns are read as further
columns of the telemetry.
"""

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from swarm.errors import SwarmError
from swarm.results.files import PARTS, SMOOTH, TELEMETRY
from swarm.results.parquet import parts_in

PREFIX = "smooth_"
"""Beginning of the names of a smoother's columns."""


def part_files(folder: Path) -> list[Path]:
    """Return the parts of a run that is not closed, in order."""
    return parts_in(folder / PARTS)


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
        smoothed = _read_file(folder / SMOOTH, names)
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
    file, parts = folder / TELEMETRY, part_files(folder)
    try:
        if file.exists():
            if not file.is_file():
                raise SwarmError(f"cannot read the telemetry in {folder}: {file.name} is a folder")
            return _read_file(file, columns)
        if parts:
            return pa.concat_tables([_read_part(part, columns) for part in parts])
    except (OSError, ValueError, KeyError, pa.ArrowException) as error:
        raise SwarmError(f"cannot read the telemetry in {folder}: {error}") from error
    empty = _nothing().empty_table()
    return empty.select(columns) if columns is not None else empty


def telemetry_columns(folder: Path) -> list[str]:
    """Return the names of the columns that the run in `folder` has."""
    return flown_columns(folder) + _smoothed_columns(folder)


def flown_columns(folder: Path) -> list[str]:
    """Return the names of the columns that its flight has left, without those of a smoother."""
    file, parts = folder / TELEMETRY, part_files(folder)
    try:
        if file.exists():
            schema = pq.read_schema(file)
        elif parts:
            with pa.OSFile(str(parts[0]), "rb") as part:
                schema = pa.ipc.open_file(part).schema
        else:
            schema = _nothing()
    except (OSError, pa.ArrowException) as error:
        raise SwarmError(f"cannot read the telemetry in {folder}: {error}") from error
    names: list[str] = schema.names
    return names


class RowReader:
    """Rows of a telemetry by their numbers, for those who do not want all of them in memory.

    `rows` reads no more than the parts, or the row groups of the file, that the rows are in.
    """

    def __init__(self, folder: Path, columns: Sequence[str]) -> None:
        """Open the telemetry of the run in `folder`, for some columns. Raises SwarmError where it is damaged."""
        self._folder, self._columns = folder, list(columns)
        self._parts = part_files(folder)
        self._kept: dict[int, pa.Table] = {}
        file = folder / TELEMETRY
        try:
            self._file = pq.ParquetFile(file, memory_map=True) if file.exists() else None
            if self._file is not None:
                about = self._file.metadata
                sizes = [about.row_group(i).num_rows for i in range(about.num_row_groups)]
            else:
                sizes = [len(_read_part(part, ["frame"])) for part in self._parts]
        except (OSError, ValueError, pa.ArrowException) as error:
            raise SwarmError(f"cannot read the telemetry in {folder}: {error}") from error
        self._ends = [sum(sizes[: i + 1]) for i in range(len(sizes))]

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    def rows(self, first: int, past: int) -> pa.Table:
        """Return the rows from `first` on, before `past`. Raises SwarmError where a file is damaged."""
        groups = [i for i, end in enumerate(self._ends) if end > first and self._begin(i) < past]
        # Blocks follow each other: what the last one needed of a group, the next one may need too.
        self._kept = {i: self._kept[i] if i in self._kept else self._group(i) for i in groups}
        table = pa.concat_tables(self._kept[i] for i in groups)
        return table.slice(first - self._begin(groups[0]), past - first)

    def _begin(self, group: int) -> int:
        return self._ends[group - 1] if group else 0

    def _group(self, group: int) -> pa.Table:
        try:
            if self._file is not None:
                return self._file.read_row_group(group, columns=self._columns, use_threads=False)
            return _read_part(self._parts[group], self._columns)
        except (OSError, ValueError, KeyError, pa.ArrowException) as error:
            raise SwarmError(f"cannot read the telemetry in {self._folder}: {error}") from error


def _read_file(file: Path, columns: Sequence[str] | None) -> pa.Table:
    """Return columns of a Parquet file, all if None. Raises KeyError where there is no such column.

    One column is read in one thread: several take more than twice the time of the processor, and memory of their own.
    """
    with pq.ParquetFile(file, memory_map=True) as opened:
        table = opened.read(columns, use_threads=columns is None)
    return table if columns is None else table.select(columns)


def _read_part(part: Path, columns: Sequence[str] | None) -> pa.Table:
    with pa.OSFile(str(part), "rb") as file:
        names = pa.ipc.open_file(file).schema.names
        wanted = None if columns is None else [names.index(name) for name in columns]
        table = pa.ipc.open_file(file, options=pa.ipc.IpcReadOptions(included_fields=wanted)).read_all()
    return table if columns is None else table.select(columns)


def _nothing() -> pa.Schema:
    """Return the columns of a run that has written nothing."""
    # The columns know the navigation's records, which take a second to import: only such a run pays for it.
    from swarm.results.columns.schema import schema

    return schema()
