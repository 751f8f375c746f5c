"""Groups of columns: what goes in as doubles comes out as numbers, names and booleans, null where NaN."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from synthetic_run import PERIOD_S, estimate_of, period_of, truth_at

from swarm.results.columns.column import Column, Group
from swarm.results.columns.schema import schema
from swarm.results.files import TELEMETRY as FILE
from swarm.results.telemetry import Telemetry

COLUMNS = (
    Column("range_m", "m", "a number"),
    Column("fired", "1", "a whole number", "whole"),
    Column("alert", "", "yes or no", "yes"),
    Column("phase", "", "a name", "state", ("hold", "final")),
)


def fill(period, out):
    nothing = np.nan
    out[:] = np.array([[1.25, 3, 1, 1], [nothing, nothing, nothing, nothing], [0.0, 0, 0, 0]]).T


GROUP = Group(COLUMNS, fill)


def test_extra_columns_come_back_as_they_went_in(tmp_path):
    out, rng = Telemetry(tmp_path, ["a", "b", "c"], [GROUP]), np.random.default_rng(0)
    # More periods than one part holds, so that dictionaries of several parts are joined.
    for k in range(130):
        truth = truth_at(k * PERIOD_S, 3)
        out.append(period_of(k * PERIOD_S, k, truth, estimate_of(truth, rng)))
    out.close()
    table = pq.read_table(tmp_path / FILE)
    assert table.column_names == schema([GROUP]).names
    rows = table.select([column.name for column in COLUMNS]).to_pylist()
    assert rows[-3:] == rows[:3] == [
        {"range_m": 1.25, "fired": 3, "alert": True, "phase": "final"},
        {"range_m": None, "fired": None, "alert": None, "phase": None},
        {"range_m": 0.0, "fired": 0, "alert": False, "phase": "hold"},
    ]  # fmt: skip


def test_without_extra_columns_nothing_has_changed():
    assert schema([GROUP]).names[: len(schema())] == schema().names
    assert pa.types.is_dictionary(schema([GROUP]).field("phase").type)
