"""Telemetry: one row per craft and lighthouse period, in columns, on disk while the run is still going.

All poses are body poses in the lighthouse frame at the period's epoch. The errors are active and left,
R_true = Exp([d]x) R_est and p_true = p_est + dp, and with the 6x6 pose part P of the EKF's covariance

    NEES = e^T P^-1 e,   e = (d, dp),

which has a mean of 6 where the filter is consistent. What is not known is null: never NaN, zero or a default pose.

Rows gather in memory for about two seconds of flight and then become a row group of the file that grows in the folder
`telemetry.parquet.partial`: whatever is there can be read, however the run ended. `close` makes it `telemetry.parquet`.
`swarm.results.reading` reads either form.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from swarm.results.columns.column import Group
from swarm.results.columns.core import core, errors_in
from swarm.results.columns.schema import schema
from swarm.results.files import TELEMETRY
from swarm.results.parquet import GrowingParquet
from swarm.results.period import Period
from swarm.results.records import Equipment, Errors
from swarm.results.table import TelemetryTable

PERIODS_PER_PART = 120
ROWS_PER_GROUP = 65_536
"""Rows of a row group at most: about 35 MB."""


class Telemetry:
    """Writes the telemetry of one run into its folder: `append` every period, `close` at the end.

    Rows wait in one (columns, rows) block of doubles, which the groups of columns fill for all craft at once.
    """

    def __init__(
        self,
        folder: Path,
        craft: Sequence[str],
        groups: Sequence[Group] = (),
        without_sensors: Sequence[str] = (),
        equipment: Sequence[Equipment] = (),
        angle_noise_rad: float | None = None,
        taken: Callable[[TelemetryTable], None] = lambda rows: None,
    ) -> None:
        """Begin the file.

        Args:
            folder: The run's folder.
            craft: Names of the craft, in the order of every period's rows.
            groups: Groups of columns beside the core, in the order of the file.
            without_sensors: Names of craft that navigate by nothing.
            equipment: What each craft navigates by; empty: unknown.
            angle_noise_rad: Standard deviation of a sweep angle that the craft assume [rad]; None: unknown.
            taken: Function called with all rows once they are written, group by group; they are the next rows'
                workspace, and not to be kept.

        Raises:
            SwarmError: The folder cannot be written.
        """
        self._craft_count, self._taken = len(craft), taken
        self._core = core(craft)
        self._groups = (self._core, *groups)
        self._columns = [column for group in self._groups for column in group.columns]
        self._schema = schema(groups, without_sensors, equipment, angle_noise_rad)
        periods = max(1, min(PERIODS_PER_PART, ROWS_PER_GROUP // max(1, len(craft))))
        self._block = np.full((len(self._columns), periods * len(craft)), np.nan)
        self._rows = 0
        fields: list[pa.Field] = list(self._schema)
        self._file = GrowingParquet(
            folder / TELEMETRY,
            self._schema,
            ROWS_PER_GROUP,
            split=[field.name for field in fields if field.type == pa.float64()],
            use_dictionary=[field.name for field in fields if pa.types.is_dictionary(field.type)],
            write_statistics=["time_s", "frame"],
        )

    def append(self, period: Period) -> Errors:
        """Add one period of all craft and return its errors. Raises SwarmError on a full disk."""
        block = self._block[:, self._rows : self._rows + self._craft_count]
        row = 0
        for group in self._groups:
            group.fill(period, block[row : row + len(group.columns)])
            row += len(group.columns)
        errors = errors_in(block)
        self._rows += self._craft_count
        if self._rows == self._block.shape[1]:
            self._flush()
        return errors

    def _flush(self) -> None:
        if not self._rows:
            return
        values = self._block[:, : self._rows]
        arrays = [column.array(value) for column, value in zip(self._columns, values, strict=True)]
        self._file.write(pa.Table.from_arrays(arrays, schema=self._schema))
        self._rows = 0
        self._taken(TelemetryTable.of_rows(self._schema, values, [column.names for column in self._columns]))

    def close(self) -> None:
        """Write what is left and complete the file. Raises SwarmError on a full disk: what was written stays."""
        self._flush()
        self._block = self._block[:, :0].copy()  # no row will wait any more
        self._file.close()
