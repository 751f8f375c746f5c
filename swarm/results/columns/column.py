"""The one way to declare telemetry: a column, and a group of columns that a run has together.

A group fills its rows of a block of doubles (columns, craft), NaN where a value is unknown; `Column.array` turns a
row into the column on disk, with null for NaN. Everything that deals with columns walks a list of groups:
the schema, the writer, the recording's plots and docs/telemetry.md.
"""

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
import pyarrow as pa

from estimators.arrays import Floats
from estimators.kernel import kernel
from swarm.results.period import Period

Kind = Literal["number", "whole", "small", "yes", "state", "name"]
TYPES: dict[Kind, pa.DataType] = {
    "number": pa.float64(),
    "whole": pa.int32(),
    "small": pa.int16(),
    "yes": pa.bool_(),
    "state": pa.dictionary(pa.int8(), pa.string()),
    "name": pa.dictionary(pa.int32(), pa.string()),
}


class Column(NamedTuple):
    """One column. kind: its type on disk. names: meanings of the codes 0, 1, ... of a "state" or a "name".

    plot: title under which the recording shows the column for every craft that it shows in detail: numbers as a plot,
    states as a lane; empty: not shown. required: never null.
    """

    name: str
    unit: str
    meaning: str
    kind: Kind = "number"
    names: tuple[str, ...] = ()
    plot: str = ""
    required: bool = False

    @property
    def field(self) -> pa.Field:
        """The column's field in the schema, with `unit` and `meaning` as metadata."""
        metadata = {"unit": self.unit, "meaning": self.meaning}
        return pa.field(self.name, TYPES[self.kind], nullable=not self.required, metadata=metadata)

    def array(self, value: Floats) -> pa.Array:
        """Return the column of contiguous doubles (n,), null where not finite, which becomes NaN in `value` as well;
        numbers are not copied.
        """
        kind, rows, known = TYPES[self.kind], len(value), np.isfinite(value)
        valid, everywhere = None, bool(known.all())
        if not everywhere:
            value[np.flatnonzero(~known)] = np.nan
            valid = pa.py_buffer(np.packbits(known, bitorder="little"))
        if self.kind == "number":
            return pa.Array.from_buffers(kind, rows, [valid, pa.py_buffer(value)])
        stored = kind.index_type if self.kind in ("state", "name") else kind
        codes = np.zeros(rows, dtype=stored.to_pandas_dtype())
        np.copyto(codes, value, casting="unsafe", where=True if everywhere else known)
        if self.kind == "yes":
            codes = np.packbits(codes, bitorder="little")
        array = pa.Array.from_buffers(stored, rows, [valid, pa.py_buffer(codes)])
        return array if stored is kind else pa.DictionaryArray.from_arrays(array, pa.array(self.names, pa.string()))


class Group(NamedTuple):
    """Columns that a run has together.

    fill: writes one period's values into a block of doubles (len(columns), C), NaN where unknown. only: in which runs
    the columns are, for the reference; empty: in all.
    """

    columns: tuple[Column, ...]
    fill: Callable[[Period, Floats], None]
    only: str = ""


def pose_columns(prefix: str, whose: str) -> list[Column]:
    """Return the seven columns of a pose."""
    return [
        *(Column(f"{prefix}_p{a}_m", "m", f"{whose}: position, {a}") for a in "xyz"),
        *(Column(f"{prefix}_q{a}", "1", f"{whose}: attitude quaternion, {a} (w >= 0)") for a in "wxyz"),
    ]


def rate_columns(prefix: str, whose: str) -> list[Column]:
    """Return the six columns of velocity and angular rate."""
    return [
        *(Column(f"{prefix}_v{a}_m_s", "m/s", f"{whose}: velocity, {a}") for a in "xyz"),
        *(Column(f"{prefix}_w{a}_rad_s", "rad/s", f"{whose}: angular rate, {a}") for a in "xyz"),
    ]


@kernel
def fill_pose(position: Floats, quaternion: Floats, out: Floats) -> None:
    """Write poses into the rows of `pose_columns`.

    Args:
        position: (C, 3) [m].
        quaternion: (C, 4), of either sign.
        out: (7, C).
    """
    for c in range(out.shape[1]):
        sign = -1.0 if quaternion[c, 0] < 0 else 1.0
        for i in range(3):
            out[i, c] = position[c, i]
        for i in range(4):
            out[3 + i, c] = sign * quaternion[c, i]
