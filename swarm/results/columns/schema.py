"""The schema of telemetry.parquet, from the groups of columns that a run has."""

import json
from collections.abc import Sequence

import pyarrow as pa

from swarm.results.columns.column import Group
from swarm.results.columns.core import COLUMNS
from swarm.results.files import WITHOUT_SENSORS


def schema(groups: Sequence[Group] = (), without_sensors: Sequence[str] = ()) -> pa.Schema:
    """Return the columns in order: the core's, then those of the groups, with unit and meaning as metadata.

    without_sensors: names of craft that navigate by nothing, kept in the schema's metadata.
    """
    fields = [column.field for columns in (COLUMNS, *(group.columns for group in groups)) for column in columns]
    return pa.schema(fields, {WITHOUT_SENSORS: json.dumps(list(without_sensors))} if without_sensors else None)
