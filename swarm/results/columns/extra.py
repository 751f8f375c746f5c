"""Telemetry columns that only some runs have, beside the schema's own: each by name, unit and meaning, in groups.

A run's groups are known before its first period. Every period brings one block of doubles (C, N), a column per entry in
the order of the groups, NaN where there is nothing to say: numbers, codes of names and yes (1) or no (0) alike.
"""

from typing import Literal, NamedTuple

import numpy as np
import pyarrow as pa

from estimators.arrays import Floats

Kind = Literal["number", "count", "yes"]


class Extra(NamedTuple):
    """One column. kind: doubles, whole numbers or booleans; names: what the codes 0, 1, ... stand for, if they do.

    plot: title with which the recording plots these numbers for every craft that it shows in detail; none: not.
    """

    name: str
    unit: str
    meaning: str
    kind: Kind = "number"
    names: tuple[str, ...] = ()
    plot: str = ""

    @property
    def type(self) -> pa.DataType:
        """The column's type on disk."""
        if self.names:
            return pa.dictionary(pa.int8(), pa.string())
        return {"number": pa.float64(), "count": pa.int32(), "yes": pa.bool_()}[self.kind]

    def array(self, value: Floats) -> pa.Array:
        """The column of these doubles (n,), null where they are NaN."""
        missing = np.isnan(value)
        if self.names:
            code = np.where(missing, 0, value).astype(np.int8)
            return pa.DictionaryArray.from_arrays(pa.array(code, mask=missing), pa.array(self.names))
        if self.kind == "number":
            return pa.array(value, mask=missing)
        return pa.array(np.where(missing, 0, value).astype(self.type.to_pandas_dtype()), self.type, mask=missing)
