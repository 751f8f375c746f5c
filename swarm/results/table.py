"""A run's telemetry as arrays: columns are read one by one when they are asked for, missing values are NaN.

rows = TelemetryTable.of_run(folder)
error = rows.column("position_error_m")[rows.by_light]
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
import pyarrow as pa

from estimators.arrays import Bools, Floats, Ints
from swarm.errors import SwarmError, did_you_mean
from swarm.onboard.settings import BY_LIGHT
from swarm.results.files import ANGLE_NOISE, EQUIPMENT, WITHOUT_SENSORS
from swarm.results.reading import RowReader, flown_columns, flown_schema, read_telemetry, telemetry_columns
from swarm.results.records import Equipment

BLOCK = 65_536
"""Rows of a block of a table that is in memory."""


class _Source(ABC):
    """A source of columns for all parts of a table; what the file says of its craft is read once."""

    @abstractmethod
    def load(self, name: str) -> tuple[Floats, Sequence[str] | None]:
        """Return a column as doubles, NaN where null, and the names that they stand for; None of numbers."""

    @abstractmethod
    def blocks(self) -> Iterator["_Source"]:
        """Yield sources of the rows, block by block."""

    @property
    @abstractmethod
    def schema(self) -> pa.Schema:
        """The columns of the flight, and what the file says of them all."""

    @cached_property
    def metadata(self) -> dict[bytes, bytes]:
        """The metadata of the file."""
        return self.schema.metadata or {}

    @cached_property
    def equipment(self) -> list[Equipment]:
        """The equipment of every craft, in the order of the names; none where the file does not say."""
        runs = json.loads(self.metadata.get(EQUIPMENT.encode(), b"[]"))
        return [Equipment(photodiodes, tuple(sensors)) for count, photodiodes, sensors in runs for _ in range(count)]


class _InRows(_Source):
    """Rows that wait for their file, as doubles already."""

    def __init__(self, schema: pa.Schema, values: Floats, names: Sequence[Sequence[str]]) -> None:
        self._schema, self._values, self._names = schema, values, names

    @property
    def schema(self) -> pa.Schema:
        return self._schema

    def load(self, name: str) -> tuple[Floats, Sequence[str] | None]:
        row = self._schema.get_field_index(name)
        return self._values[row], self._names[row] if _is_of_names(self._schema.field(row).type) else None

    def blocks(self) -> Iterator[_Source]:
        return iter([self])


class _InArrow(_Source):
    """Columns as pyarrow has them."""

    @abstractmethod
    def table(self, name: str) -> pa.Table:
        """Return a table of one column."""

    def load(self, name: str) -> tuple[Floats, Sequence[str] | None]:
        table = self.table(name)
        column = table.column(name)
        return _codes(column) if _is_of_names(column.type) else (doubles(table, name), None)


class _InMemory(_InArrow):
    """A table that is in memory."""

    def __init__(self, table: pa.Table) -> None:
        self._table = table

    @property
    def schema(self) -> pa.Schema:
        return self._table.schema

    def table(self, name: str) -> pa.Table:
        return self._table.select([name])

    def blocks(self) -> Iterator[_Source]:
        return (_InMemory(self._table.slice(first, BLOCK)) for first in range(0, len(self._table), BLOCK))


class _InFolder(_InArrow):
    """The telemetry in a run's folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @cached_property
    def schema(self) -> pa.Schema:
        return flown_schema(self._folder)

    def table(self, name: str) -> pa.Table:
        return read_telemetry(self._folder, [name])

    def blocks(self) -> Iterator[_Source]:
        reader = RowReader(self._folder, [])
        return (_Block(reader, number) for number in range(reader.groups))


class _Block(_InArrow):
    """The rows of the telemetry in a run's folder that were written together."""

    def __init__(self, reader: RowReader, number: int) -> None:
        self._reader, self._number = reader, number

    @property
    def schema(self) -> pa.Schema:
        return self._reader.schema

    def table(self, name: str) -> pa.Table:
        return self._reader.group(self._number, [name])

    def blocks(self) -> Iterator[_Source]:
        return iter([self])


class TelemetryTable:
    """Columns as doubles, (rows,): numbers as they are, names as codes, which index `names_of`; null is NaN.

    columns: names of all columns. A column that was read stays in memory until `forget`.
    """

    def __init__(self, source: _Source, columns: Sequence[str]) -> None:
        self.columns = tuple(columns)
        self._source = source
        self._place: Ints | None = None
        self._rows = slice(None)
        self._values: dict[str, Floats] = {}
        self._names: dict[str, Sequence[str]] = {}

    @classmethod
    def of_rows(cls, schema: pa.Schema, values: Floats, names: Sequence[Sequence[str]]) -> "TelemetryTable":
        """Return a table of rows that are doubles already, and are not copied.

        Args:
            schema: The columns.
            values: Their values, (columns, rows), NaN where unknown.
            names: Of every column of words, what its codes stand for.
        """
        return cls(_InRows(schema, values, names), schema.names)

    @classmethod
    def of(cls, table: pa.Table) -> "TelemetryTable":
        """Return a table that is in memory."""
        return cls(_InMemory(table), table.column_names)

    @classmethod
    def of_run(cls, folder: Path) -> "TelemetryTable":
        """Return the telemetry in a run's folder. Reading a column raises SwarmError where a file is damaged."""
        return cls(_InFolder(folder), telemetry_columns(folder))

    @classmethod
    def of_flight(cls, folder: Path) -> "TelemetryTable":
        """Return the same without what a smoother has found, which is not even opened."""
        return cls(_InFolder(folder), flown_columns(folder))

    def column(self, name: str) -> Floats:
        """Return one column."""
        if name not in self._values:
            self._expect(name)
            value, names = self._source.load(name)
            if names is not None:
                self._names[name] = names
            self._values[name] = value if self._place is None else np.empty(len(value))
            if self._place is not None:
                self._values[name][self._place] = value
        return self._values[name][self._rows]

    def blocks(self) -> Iterator["TelemetryTable"]:
        """Yield the rows block by block, in the order of the source; none of what a smoother has found.

        Reading a column raises SwarmError where a file is damaged.
        """
        return (TelemetryTable(source, self.columns) for source in self._source.blocks())

    def _expect(self, name: str) -> None:
        if name not in self.columns:
            raise SwarmError(f"the telemetry has no column {name!r}{did_you_mean(name, self.columns)}")

    def names_of(self, column: str) -> Sequence[str]:
        """Return what the codes of a column of names stand for."""
        self.column(column)
        if column not in self._names:
            raise SwarmError(f"the telemetry's column {column!r} must be of words, and is of numbers")
        return self._names[column]

    def being(self, column: str, name: str) -> Bools:
        """Return whether the column says `name`, (rows,)."""
        names, codes = self.names_of(column), self.column(column)
        return codes == names.index(name) if name in names else np.zeros(len(codes), dtype=np.bool_)

    @property
    def by_light(self) -> Bools:
        """Return whether light went into the filter, as a pose or as single sweeps, (rows,)."""
        one, other = (self.being("status", status.name.lower()) for status in BY_LIGHT)
        return one | other

    def stacked(self, *names: str) -> Floats:
        """Return several columns side by side, (rows, len(names))."""
        return np.stack([self.column(name) for name in names], axis=1)

    def position(self, prefix: str) -> Floats:
        """Return positions (rows, 3) [m]; prefix: "true", "pnp", "ekf", "peer"."""
        return self.stacked(*(f"{prefix}_p{a}_m" for a in "xyz"))

    def quaternion(self, prefix: str) -> Floats:
        """Return quaternions (rows, 4)."""
        return self.stacked(*(f"{prefix}_q{a}" for a in "wxyz"))

    @property
    def frame(self) -> Ints:
        """Number of each row's period, (rows,)."""
        return self.column("frame").astype(np.int64)

    @property
    def craft(self) -> Ints:
        """Index of each row's craft in `names_of("craft")`, (rows,)."""
        return self.column("craft").astype(np.int64)

    @property
    def without_sensors(self) -> list[str]:
        """Names of the craft that navigate by nothing."""
        said = self._said(WITHOUT_SENSORS)
        return list(json.loads(said)) if said else []

    @property
    def equipment(self) -> dict[str, Equipment]:
        """The equipment by which each craft navigates; empty where the file does not say."""
        each, names = self._source.equipment, self.names_of("craft")
        return dict(zip(names, each, strict=True)) if len(each) == len(names) else {}

    @property
    def angle_noise_rad(self) -> float | None:
        """Standard deviation of a sweep angle that the craft assume [rad]; None where the file does not say."""
        said = self._said(ANGLE_NOISE)
        return float(said) if said else None

    def _said(self, key: str) -> bytes | None:
        """Return an entry of the file's metadata."""
        return self._source.metadata.get(key.encode())

    def __len__(self) -> int:
        return len(self.column("craft"))

    def ordered(self, order: Ints) -> "TelemetryTable":
        """Return the same rows in another order (rows,); it reads its columns anew."""
        out = TelemetryTable(self._source, self.columns)
        # Where each row goes, in the order in which they are read: what is read is read once, and in order.
        out._place = np.empty_like(order)
        out._place[order] = np.arange(len(order))
        return out

    def part(self, first: int, past: int) -> "TelemetryTable":
        """Return the rows from `first` on, before `past`; columns are read once for all parts."""
        out = TelemetryTable(self._source, self.columns)
        out._place, out._rows, out._values, out._names = self._place, slice(first, past), self._values, self._names
        return out

    def forget(self) -> None:
        """Drop the columns that were read, for all parts, and give their memory back."""
        self._values.clear()
        pa.default_memory_pool().release_unused()


def doubles(table: pa.Table, name: str) -> Floats:
    """Return a column of numbers as doubles, NaN where null. Raises SwarmError where they are no numbers."""
    column = table.column(name)
    try:
        out: Floats = column.cast(pa.float64()).to_numpy()
    except (pa.ArrowException, ValueError):
        raise SwarmError(f"the telemetry's column {name!r} must be of numbers, and is of {column.type}") from None
    return out


def _codes(column: pa.ChunkedArray) -> tuple[Floats, list[str]]:
    """Return a column of words as codes, NaN where null, and the words."""
    if pa.types.is_string(column.type):
        # A file that another program has written again: the same words, without their numbers.
        column = column.dictionary_encode()
    chunks = column.unify_dictionaries().chunks
    codes = [chunk.indices.to_numpy(zero_copy_only=False) for chunk in chunks] or [np.zeros(0)]
    return np.concatenate(codes).astype(np.float64), chunks[0].dictionary.to_pylist() if chunks else []


def _is_of_names(kind: pa.DataType) -> bool:
    return bool(pa.types.is_dictionary(kind) or pa.types.is_string(kind))
