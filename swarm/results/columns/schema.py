"""The schema of telemetry.parquet, from the groups of columns that a run has."""

import json
from collections.abc import Sequence
from itertools import groupby

import pyarrow as pa

from swarm.results.columns.column import Group
from swarm.results.columns.core import COLUMNS
from swarm.results.files import ANGLE_NOISE, EQUIPMENT, WITHOUT_SENSORS
from swarm.results.records import Equipment


def schema(
    groups: Sequence[Group] = (),
    without_sensors: Sequence[str] = (),
    equipment: Sequence[Equipment] = (),
    angle_noise_rad: float | None = None,
) -> pa.Schema:
    """Return the columns in order: the core's, then those of the groups, with unit and meaning as metadata.

    Args:
        groups: Groups of columns beside the core.
        without_sensors: Names of craft that navigate by nothing, kept in the schema's metadata.
        equipment: What each craft navigates by, kept there too.
        angle_noise_rad: Standard deviation of a sweep angle that the craft assume [rad], kept there too.
    """
    fields = [column.field for columns in (COLUMNS, *(group.columns for group in groups)) for column in columns]
    said = {WITHOUT_SENSORS: json.dumps(list(without_sensors))} if without_sensors else {}
    if equipment:
        alike = [(each, len(list(run))) for each, run in groupby(equipment)]
        said[EQUIPMENT] = json.dumps([[count, each.photodiodes, list(each.sensors)] for each, count in alike])
    if angle_noise_rad is not None:
        said[ANGLE_NOISE] = repr(angle_noise_rad)
    return pa.schema(fields, said or None)
