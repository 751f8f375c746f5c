"""Telemetry: one row per craft and lighthouse period, in columns, on disk while the run is still going.

All poses are body poses in the lighthouse frame at the period's epoch. The errors are active and left,
R_true = Exp([d]x) R_est and p_true = p_est + dp, and with the 6x6 pose part P of the EKF's covariance

    NEES = e^T P^-1 e,   e = (d, dp),

which has a mean of 6 where the filter is consistent. What is not known is null: never NaN, zero or a default pose.

Rows gather in memory for about two seconds of flight and then become a part of the folder `telemetry.parquet.partial`,
an Arrow file, written under another name and renamed: whatever is there can be opened, however the run ended. `close`
streams the parts into one `telemetry.parquet`. `swarm.results.reading` reads either form.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from swarm.results.columns.column import Group
from swarm.results.columns.core import core, errors_in
from swarm.results.columns.schema import schema
from swarm.results.disk import replacing, writing
from swarm.results.files import PARTS, TELEMETRY
from swarm.results.parquet import write_part
from swarm.results.period import Period
from swarm.results.reading import part_files
from swarm.results.records import Equipment, Errors

PERIODS_PER_PART = 120
ROWS_PER_GROUP = 65_536
"""Rows of a part at most, and of a row group of the final file: about 35 MB."""


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
    ) -> None:
        """Make the folder of parts.

        Args:
            folder: The run's folder.
            craft: Names of the craft, in the order of every period's rows.
            groups: Groups of columns beside the core, in the order of the file.
            without_sensors: Names of craft that navigate by nothing.
            equipment: What each craft navigates by; empty: unknown.
            angle_noise_rad: Standard deviation of a sweep angle that the craft assume [rad]; None: unknown.

        Raises:
            SwarmError: The folder cannot be written.
        """
        self._folder, self._craft_count = folder, len(craft)
        self._core = core(craft)
        self._groups = (self._core, *groups)
        self._columns = [column for group in self._groups for column in group.columns]
        self._schema = schema(groups, without_sensors, equipment, angle_noise_rad)
        periods = max(1, min(PERIODS_PER_PART, ROWS_PER_GROUP // max(1, len(craft))))
        self._block = np.full((len(self._columns), periods * len(craft)), np.nan)
        self._rows = self._parts = 0
        with writing(folder / PARTS):
            (folder / PARTS).mkdir()

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

    def _table(self) -> pa.Table:
        values = self._block[:, : self._rows]
        arrays = [column.array(value) for column, value in zip(self._columns, values, strict=True)]
        return pa.Table.from_arrays(arrays, schema=self._schema)

    def _flush(self) -> None:
        if not self._rows:
            return
        write_part(self._folder / PARTS, self._parts, self._table())
        self._parts += 1
        self._rows = 0

    def close(self) -> None:
        """Write what is left and join the parts into one file. Raises SwarmError on a full disk: the parts stay."""
        self._flush()
        self._block = self._block[:, :0].copy()  # no row will wait any more
        folder, final = self._folder / PARTS, self._folder / TELEMETRY
        doubles = [field.name for field in self._schema if field.type == pa.float64()]
        with (
            replacing(final, folder / "joined.tmp") as temporary,
            pq.ParquetWriter(
                temporary,
                self._schema,
                compression="snappy",
                use_dictionary=[field.name for field in self._schema if pa.types.is_dictionary(field.type)],
                use_byte_stream_split=doubles,
                write_statistics=["time_s", "frame"],
            ) as writer,
        ):
            for group in _groups(part_files(self._folder)):
                writer.write_table(group, row_group_size=ROWS_PER_GROUP)
        with writing(final):
            for part in part_files(self._folder):
                part.unlink()
            folder.rmdir()


def _groups(parts: list[Path]) -> Iterator[pa.Table]:
    """Tables of about one row group each, from parts that may be much smaller."""
    waiting: list[pa.Table] = []
    for part in parts:
        # Mapped, not copied: nobody writes to a part any more.
        with pa.memory_map(str(part)) as file:
            waiting.append(pa.ipc.open_file(file).read_all())
        if sum(len(table) for table in waiting) >= ROWS_PER_GROUP:
            yield pa.concat_tables(waiting)
            waiting = []
    if waiting:
        yield pa.concat_tables(waiting)
