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
from swarm.results.disk import writing

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
    """Return the table in a Parquet file; columns: only these. Raises SwarmError where it cannot be read."""
    try:
        return pq.read_table(file, columns=columns)
    except (OSError, pa.ArrowException) as error:
        raise SwarmError(f"cannot read {file}: {error}") from error


class GrowingParquet:
    """A Parquet file that grows as `NAME.partial` until it is complete: work that was killed leaves none."""

    def __init__(self, file: Path, schema: pa.Schema) -> None:
        """Begin the file. Raises SwarmError where it cannot be written."""
        self._final, self._partial = file, file.with_name(file.name + PARTIAL)
        with writing(self._partial):
            self._file = pq.ParquetWriter(self._partial, schema, compression="snappy")

    def write(self, table: Table) -> None:
        """Add rows. Raises SwarmError on a full disk."""
        with writing(self._partial):
            self._file.write_table(table)

    def close(self) -> None:
        """Complete the file. Raises SwarmError on a full disk."""
        with writing(self._final):
            self._file.close()
            self._partial.replace(self._final)
