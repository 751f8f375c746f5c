"""Reading a run's telemetry: the one file of a run that was closed, or the parts that a stopped one has left."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from swarm.errors import SwarmError
from swarm.results.columns.schema import schema

FILE = "telemetry.parquet"
PARTS = FILE + ".partial"


def part_files(folder: Path) -> list[Path]:
    """The parts of a run that is not closed, in order."""
    return sorted((folder / PARTS).glob("part-*.arrow"))


def read_part(part: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """One part; columns: only these, if given."""
    with pa.OSFile(str(part), "rb") as file:
        names = pa.ipc.open_file(file).schema.names
        wanted = None if columns is None else [names.index(name) for name in columns]
        table = pa.ipc.open_file(file, options=pa.ipc.IpcReadOptions(included_fields=wanted)).read_all()
    return table if columns is None else table.select(columns)


def read_telemetry(folder: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """The telemetry of the run in `folder`: the whole, or what a stopped run has left (perhaps no row at all).

    columns: only these, if given. Raises SwarmError where a file is damaged.
    """
    file, parts = folder / FILE, part_files(folder)
    try:
        if file.exists():
            return pq.read_table(file, columns=columns)
        if parts:
            return pa.concat_tables([read_part(part, columns) for part in parts])
    except (OSError, pa.ArrowException) as error:
        raise SwarmError(f"cannot read the telemetry in {folder}: {error}") from error
    empty = schema().empty_table()
    return empty.select(columns) if columns is not None else empty


def telemetry_columns(folder: Path) -> list[str]:
    """The columns that the run in `folder` has."""
    file, parts = folder / FILE, part_files(folder)
    names: list[str] = schema().names
    if file.exists():
        names = pq.read_schema(file).names
    elif parts:
        with pa.OSFile(str(parts[0]), "rb") as part:
            names = pa.ipc.open_file(part).schema.names
    return names


def values(table: pa.Table, name: str) -> NDArray[np.float64]:
    """A numeric column as doubles, NaN where null."""
    out: NDArray[np.float64] = table.column(name).cast(pa.float64()).to_numpy()
    return out
