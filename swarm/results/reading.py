"""Reading a run's telemetry: the one file of a run that was closed, or the parts that a stopped one has left."""

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from swarm.errors import SwarmError
from swarm.results.files import PARTS, TELEMETRY


def part_files(folder: Path) -> list[Path]:
    """Return the parts of a run that is not closed, in order."""
    return sorted((folder / PARTS).glob("part-*.arrow"))


def read_telemetry(folder: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """Return the telemetry of the run in `folder`: the whole, or what a stopped run has left (perhaps no row at all).

    columns: only these, if given. Raises SwarmError where a file is damaged.
    """
    file, parts = folder / TELEMETRY, part_files(folder)
    try:
        if file.exists():
            if not file.is_file():
                raise SwarmError(f"cannot read the telemetry in {folder}: {file.name} is a folder")
            return pq.read_table(file, columns=columns, partitioning=None)
        if parts:
            return pa.concat_tables([_read_part(part, columns) for part in parts])
    except (OSError, ValueError, pa.ArrowException) as error:
        raise SwarmError(f"cannot read the telemetry in {folder}: {error}") from error
    empty = _nothing().empty_table()
    return empty.select(columns) if columns is not None else empty


def telemetry_columns(folder: Path) -> list[str]:
    """Return the names of the columns that the run in `folder` has."""
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
