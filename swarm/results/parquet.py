"""The door to pyarrow for all rooms above: tables of named columns, and files that appear when they are complete.

table_of([column("gap_m", gap, "m", "distance of the ports"), column("state", words, "", "its state", "text")])
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import Table

from swarm.errors import SwarmError
from swarm.results.disk import replacing, writing

__all__ = ["GrowingParquet", "NamedColumn", "Table", "column", "read_table", "table_of", "write_table"]
PARTIAL = ".partial"
"""The end of the name of a file that is not complete."""
Kind = Literal["text", "yes", "whole", "number"]
_TYPES: Mapping[Kind, pa.DataType] = {
    "text": pa.string(),
    "yes": pa.bool_(),
    "whole": pa.int64(),
    "number": pa.float64(),
}


class NamedColumn(NamedTuple):
    """One column of a table, with its unit and its meaning as metadata."""

    field: pa.Field
    array: pa.Array


def column(name: str, values: Any, unit: str, meaning: str = "", kind: Kind | None = None) -> NamedColumn:
    """Return a column.

    Args:
        name: Its name.
        values: Array or sequence, (n,); None and NaN become null.
        unit: Its unit, kept as metadata.
        meaning: Its meaning, kept as metadata if there is one.
        kind: Its type on disk; None: as the values are.
    """
    array = pa.array(values, None if kind is None else _TYPES[kind], from_pandas=True)
    metadata = {"unit": unit} | ({"meaning": meaning} if meaning else {})
    return NamedColumn(pa.field(name, array.type, metadata=metadata), array)


def table_of(columns: Iterable[NamedColumn]) -> Table:
    """Return the table of these columns."""
    fields, arrays = zip(*columns, strict=True)
    return pa.Table.from_arrays(list(arrays), schema=pa.schema(list(fields)))


def write_table(table: Table, file: Path) -> None:
    """Write a Parquet file. Raises OSError; `OwnedFolder.replace` makes it one step and one message."""
    pq.write_table(table, file)


def read_table(file: Path, columns: Sequence[str] | None = None) -> Table:
    """Return the table in a Parquet file; columns: only these. Raises SwarmError where it cannot be read.

    Where there is no such file, but the parts of one that was never completed, these are read.
    """
    try:
        parts = () if file.exists() else parts_of(file)
        if parts:
            whole = pa.concat_tables(_mapped(part) for part in parts)
            return whole if columns is None else whole.select(columns)
        return pq.read_table(file, columns=columns, partitioning=None)
    except (OSError, pa.ArrowException) as error:
        raise SwarmError(f"cannot read {file}: {error}") from error


def is_there(file: Path) -> bool:
    """Tell whether there is a Parquet file, or the parts of one that was never completed."""
    return file.exists() or bool(parts_of(file))


def parts_of(file: Path) -> list[Path]:
    """Return the parts of a Parquet file that is not complete, in order."""
    return parts_in(file.with_name(file.name + PARTIAL))


def parts_in(folder: Path) -> list[Path]:
    """Return the parts in a folder, in order."""
    return sorted(folder.glob("part-*.arrow"))


def write_part(folder: Path, number: int, table: Table, options: pa.ipc.IpcWriteOptions | None = None) -> None:
    """Write a part into a folder, under another name first, so that whatever is there is whole.

    Args:
        folder: The folder.
        number: Place of the part among all.
        table: Its rows.
        options: How they are written.

    Raises:
        SwarmError: The disk is full.
    """
    part = folder / f"part-{number:05d}.arrow"
    with (
        replacing(part, part.with_suffix(".tmp")) as temporary,
        pa.OSFile(str(temporary), "wb") as file,
        pa.ipc.new_file(file, table.schema, options=options) as writer,
    ):
        writer.write_table(table)


def _mapped(part: Path) -> Table:
    # Mapped, not copied: nobody writes to a part any more.
    with pa.memory_map(str(part)) as file:
        return pa.ipc.open_file(file).read_all()


class GrowingParquet:
    """A Parquet file that grows by parts in the folder `NAME.partial` until it is complete.

    A part is an Arrow file, written under another name and renamed: whatever is there can be read by `read_table`,
    however the work ended.
    """

    def __init__(self, file: Path, schema: pa.Schema) -> None:
        """Begin the file. Raises SwarmError where it cannot be written."""
        self._final, self._folder, self._schema = file, file.with_name(file.name + PARTIAL), schema
        self._parts = 0
        with writing(self._folder):
            self._folder.mkdir()

    def write(self, table: Table, number: int | None = None) -> None:
        """Add rows, as a part of their own.

        Args:
            table: The rows.
            number: Place of the part among all, for one who does not write them in order; None: behind the last.

        Raises:
            SwarmError: The disk is full.
        """
        write_part(self._folder, self._parts if number is None else number, table)
        self._parts += 1

    def close(self) -> None:
        """Join the parts into the file. Raises SwarmError on a full disk: the parts stay."""
        parts = parts_of(self._final)
        with (
            replacing(self._final, self._folder / "joined.tmp") as joined,
            pq.ParquetWriter(joined, self._schema, compression="snappy") as writer,
        ):
            for part in parts:
                writer.write_table(_mapped(part))
        with writing(self._final):
            for part in parts:
                part.unlink()
            self._folder.rmdir()
