"""The door to pyarrow for all rooms above: tables of named columns, and files that appear when they are complete.

table_of([column("gap_m", gap, "m", "distance of the ports"), column("state", words, "", "its state", "text")])
"""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import Table

from swarm.errors import SwarmError
from swarm.results.disk import replacing, writing

__all__ = ["GrowingParquet", "NamedColumn", "Table", "column", "open_parquet", "read_table", "table_of", "write_table"]
PARTIAL, ROWS = ".partial", "rows"
"""The end of the name of a file's folder while it is not complete, and its rows in there."""
PARTIAL_FILES = (ROWS, "part-*.footer", "part-*.tmp", "joined.tmp")
"""Names of all files in such a folder."""
MAGIC = b"PAR1"
"""How a Parquet file begins and ends."""
COMPRESSION = "snappy"
WORTH_IT = 7 / 8
"""A column is compressed, its bytes split before, where that leaves less of it than this: of noise it leaves nine
tenths, and takes as long as all else that is done to write it, or longer.
"""
TRIED_AGAIN = 16
"""After so many groups of rows all columns are compressed once, to see what is left of them."""
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
        opened = open_parquet(file)
        if opened is None:
            raise FileNotFoundError(f"there is no {file.name}")
        with opened:
            table = opened.read(columns)
    except (OSError, pa.ArrowException) as error:
        raise SwarmError(f"cannot read {file}: {error}") from error
    return table if columns is None else table.select(columns)


def open_parquet(file: Path, mapped: bool = True) -> pq.ParquetFile | None:
    """Return a Parquet file, or what there is of one that was never completed; None where there is neither.

    mapped: map it into memory. Raises OSError, ValueError or pa.ArrowException where it is damaged.
    """
    if file.exists():
        return pq.ParquetFile(file, memory_map=mapped)
    footers = footers_of(file)
    if not footers:
        return None
    return pq.ParquetFile(_folder(file) / ROWS, metadata=_together(footers), memory_map=mapped)


def _together(footers: Iterable[Path]) -> pq.FileMetaData:
    first, *rest = map(pq.read_metadata, footers)
    for each in rest:
        first.append_row_groups(each)
    return first


def is_there(file: Path) -> bool:
    """Tell whether there is a Parquet file, or something of one that was never completed."""
    return file.exists() or bool(footers_of(file))


def footers_of(file: Path) -> list[Path]:
    """Return the footers of the groups of rows of a Parquet file that is not complete, in order."""
    return sorted(_folder(file).glob("part-*.footer"))


def _folder(file: Path) -> Path:
    return file.with_name(file.name + PARTIAL)


class GrowingParquet:
    """A Parquet file that grows by groups of rows in the folder `NAME.partial` until it is complete.

    The groups are appended to one file there, and the footer of each is put beside it under another name and renamed:
    whatever has a footer can be read by `open_parquet`, however the work ended. At the end the footer of all groups is
    appended; only groups of few rows are written a second time, as larger ones.
    """

    def __init__(
        self, file: Path, schema: pa.Schema, rows: int = 0, split: Sequence[str] = (), **encoding: Any
    ) -> None:
        """Begin the file.

        Args:
            file: The file.
            schema: Its columns.
            rows: Groups of less than an eighth of so many rows are joined to some of about so many at the end.
            split: Columns of numbers whose bytes are split, the first ones of all numbers before the second ones.
            encoding: Options of `pyarrow.parquet.ParquetWriter`.

        Raises:
            SwarmError: It cannot be written.
        """
        self._final, self._folder, self._schema, self._joined_rows = file, _folder(file), schema, rows
        self._encoding: dict[str, Any] = {"write_batch_size": max(1024, rows), **encoding}
        self._split, self._compression = split, dict.fromkeys(schema.names, COMPRESSION)
        self._parts = self._bytes = 0
        with writing(self._folder):
            self._folder.mkdir()
            (self._folder / ROWS).touch()

    def write(self, table: Table, number: int | None = None) -> None:
        """Add rows, as a group of their own.

        Args:
            table: The rows.
            number: Place of the group among all, for one who does not write them in order; None: behind the last.

        Raises:
            SwarmError: The disk is full.
        """
        part = self._folder / f"part-{self._parts if number is None else number:05d}.footer"
        with replacing(part, part.with_suffix(".tmp")) as temporary:
            self._append(table).write_metadata_file(temporary)
        self._parts += 1
        if self._parts % TRIED_AGAIN == 0:
            self._compression = dict.fromkeys(self._compression, COMPRESSION)

    def _append(self, table: Table) -> pq.FileMetaData:
        """Append a group of rows, and return its footer."""
        with self._appended():
            with pa.OSFile(str(self._folder / ROWS), "ab") as file:
                # The writer only begins at place 0, and from then on counts by where its bytes go: to the end.
                os.lseek(file.fileno(), 0, os.SEEK_SET)
                with self._writer(file) as writer:
                    writer.write_table(table, row_group_size=max(1, len(table)))
            # Not by its collector of metadata, whose own error would hide that of a full disk.
            footer: pq.FileMetaData = writer.writer.metadata
            groups = [footer.row_group(i) for i in range(footer.num_row_groups)]
            chunks = [group.column(i) for group in groups for i in range(group.num_columns)]
            begins = [chunk.dictionary_page_offset or chunk.data_page_offset for chunk in chunks]
            if min(begins, default=self._bytes) < self._bytes:
                raise RuntimeError("pyarrow has not counted from the beginning of the file")
            ends = [begin + chunk.total_compressed_size for begin, chunk in zip(begins, chunks, strict=True)]
            self._bytes = max(ends, default=self._bytes)
        self._compression = {
            chunk.path_in_schema: COMPRESSION
            if chunk.total_compressed_size < WORTH_IT * chunk.total_uncompressed_size
            else "none"
            for chunk in chunks
        }
        return footer

    def _writer(self, file: Any) -> pq.ParquetWriter:
        split = [name for name in self._split if self._compression[name] == COMPRESSION]
        return pq.ParquetWriter(
            file, self._schema, compression=self._compression, use_byte_stream_split=split, **self._encoding
        )

    @contextmanager
    def _appended(self) -> Iterator[None]:
        """Cut what the block has written behind the last group: its own footer, or what there was no room for."""
        try:
            yield
        finally:
            os.truncate(self._folder / ROWS, self._bytes)

    def close(self) -> None:
        """Complete the file. Raises SwarmError on a full disk: what was written stays in the folder."""
        footers = footers_of(self._final)
        with writing(self._final):
            whole = _together(footers) if footers else None
            if whole is None or whole.num_rows * 8 < self._joined_rows * whole.num_row_groups:
                with (
                    replacing(self._final, self._folder / "joined.tmp") as joined,
                    self._writer(joined) as writer,
                ):
                    for table in self._tables():
                        writer.write_table(table, row_group_size=max(1, len(table)))
                (self._folder / ROWS).unlink()
            else:
                self._end(whole)
            for footer in footers:
                footer.unlink()
            self._folder.rmdir()

    def _end(self, whole: pq.FileMetaData) -> None:
        """Append the footer of all groups, and let the file take its place."""
        alone = pa.BufferOutputStream()
        whole.write_metadata_file(alone)
        footer = alone.getvalue()[len(MAGIC) :]
        with self._appended():
            with (self._folder / ROWS).open("ab") as file:
                file.write(footer)
            self._bytes += len(footer)
        (self._folder / ROWS).replace(self._final)

    def _tables(self) -> Iterator[Table]:
        """Yield the groups, joined to tables of about as many rows as are wanted."""
        waiting: list[Table] = []
        opened = open_parquet(self._final)
        if opened is None:
            return
        with opened:
            for group in range(opened.num_row_groups):
                waiting.append(opened.read_row_group(group, use_threads=False))
                if sum(map(len, waiting)) >= self._joined_rows:
                    yield pa.concat_tables(waiting)
                    waiting = []
        if waiting:
            yield pa.concat_tables(waiting)
