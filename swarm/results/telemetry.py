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

from estimators.arrays import Floats
from swarm.results.columns import ccd as ccd_columns
from swarm.results.columns.ccd import CCD_STATES
from swarm.results.columns.extra import Extra
from swarm.results.columns.schema import NAMES, schema
from swarm.results.disk import writing
from swarm.results.reading import FILE, PARTS, part_files
from swarm.results.records import Errors, Estimate, Peer, Truth
from swarm.results.rows import rows_into

PERIODS_PER_PART = 120
ROWS_PER_GROUP = 65_536
"""Rows of a part at most, and of a row group of the final file: about 35 MB."""
_FLOATS = [field.name for field in schema(replay=True, ccd=True) if field.type == pa.float64()]
_INTS = ["frame", "status", "sensor", "visible", "pnp_iterations", "missed_sync", "rejected_pulses", "contact"]
_CCD_INTS = ["ccd", *(name for name, _, _ in ccd_columns.COUNTS)]


class Telemetry:
    """Writes the telemetry of one run into its folder: `append` every period, `close` at the end.

    rows wait in one (columns, rows) block, so that a period is a few slice assignments for all craft at once.
    """

    def __init__(
        self,
        folder: Path,
        craft: Sequence[str],
        replay: bool = False,
        ccd: bool = False,
        observer: Sequence[str | None] | None = None,
        extra: Sequence[Extra] = (),
        without_sensors: Sequence[str] = (),
    ) -> None:
        """observer: of a run with LiDARs, whose observation each craft's estimate is, None where its own.

        without_sensors: craft that navigate by nothing.
        """
        self._folder, self._craft = folder, list(craft)
        self._schema = schema(replay, ccd, observer is not None, extra, without_sensors)
        self._observer = list(observer or ())
        self._extra = {column.name: column for column in extra}
        periods = max(1, min(PERIODS_PER_PART, ROWS_PER_GROUP // max(1, len(craft))))
        self._capacity = periods * len(craft)
        self._floats = np.full((len(_FLOATS), self._capacity), np.nan)
        self._ints = np.zeros((len(_INTS) + len(_CCD_INTS), self._capacity), dtype=np.int64)
        self._more = np.full((len(extra), self._capacity), np.nan)
        vector, quaternion = np.full((len(craft), 3), np.nan), np.full((len(craft), 4), np.nan)
        self._no_truth = Truth(vector, quaternion, vector, vector, np.zeros(len(craft), dtype=np.bool_))
        self._no_peer = Peer(vector, quaternion)
        self._rows = self._parts = 0
        with writing(folder / PARTS):
            (folder / PARTS).mkdir()

    def append(
        self,
        time_s: float,
        frame: int,
        truth: Truth | None,
        estimate: Estimate,
        peer: Peer | None = None,
        extra: Floats | None = None,
    ) -> Errors:
        """Add one period of all craft (epoch `time_s` [s]) and return its errors. Raises SwarmError on a full disk.

        extra: (C, N), the values of the run's extra columns.
        """
        pnp, precision = estimate.pnp, estimate.dilution
        true, other = self._no_truth if truth is None else truth, self._no_peer if peer is None else peer
        errors, flat = np.empty((len(Errors._fields), len(self._craft))), np.ascontiguousarray
        rows_into(
            time_s,
            flat(true.position),
            flat(true.quaternion),
            flat(true.velocity),
            flat(true.angular_rate),
            flat(pnp.rotation),
            flat(pnp.position),
            flat(estimate.rotation),
            flat(estimate.position),
            flat(estimate.velocity),
            flat(estimate.angular_rate),
            flat(estimate.covariance),
            flat(precision.adop_deg_per_rad),
            flat(precision.pdop_m_per_rad),
            flat(pnp.residual_rad),
            flat(estimate.nis),
            flat(other.position),
            flat(other.quaternion),
            errors,
            self._floats,
            self._rows,
        )
        at = slice(self._rows, self._rows + len(self._craft))
        ccd = estimate.ccd
        if ccd is not None:
            self._floats[-len(ccd_columns.FLOATS) :, at] = ccd_columns.floats(ccd, true.position, true.quaternion).T
        if extra is not None:
            self._more[:, at] = extra.T
        contact = -1 if truth is None else truth.contact
        e = estimate
        counts = (frame, e.status, e.sensor, e.visible, e.pnp.iterations, e.missed_sync, e.rejected, contact)
        by_cameras = () if ccd is None else (ccd.state, *ccd.lights.T)
        for row, value in enumerate((*counts, *by_cameras)):
            self._ints[row, at] = value
        self._rows += len(self._craft)
        if self._rows == self._capacity:
            self._flush()
        return Errors(*errors)

    def _table(self) -> pa.Table:
        rows = self._rows
        floats = dict(zip(_FLOATS, self._floats, strict=True))
        ints = dict(zip((*_INTS, *_CCD_INTS), self._ints, strict=True))
        more = dict(zip(self._extra, self._more, strict=True))
        names = np.tile(np.arange(len(self._craft), dtype=np.int32), rows // max(1, len(self._craft)))
        columns: list[pa.Array] = []
        for field in self._schema:
            if field.name == "craft":
                columns.append(pa.DictionaryArray.from_arrays(names, pa.array(self._craft, pa.string())))
            elif field.name == "observer":
                tiled = self._observer * (rows // max(1, len(self._craft)))
                columns.append(pa.array(tiled, pa.string()).dictionary_encode())
            elif field.name in more:
                columns.append(self._extra[field.name].array(more[field.name][:rows]))
            elif field.name in NAMES:
                code, known = ints[field.name][:rows].astype(np.int8), pa.array(NAMES[field.name])
                columns.append(pa.DictionaryArray.from_arrays(pa.array(code, mask=code >= len(known)), known))
            elif field.name in ints:
                value = ints[field.name][:rows]
                no_cameras = ints["ccd"][:rows] >= len(CCD_STATES)
                null = {
                    "pnp_iterations": value == 0,
                    "contact": value < 0,
                    **dict.fromkeys(_CCD_INTS, no_cameras),
                }.get(field.name)
                columns.append(pa.array(value.astype(field.type.to_pandas_dtype()), field.type, mask=null))
            else:
                value = floats[field.name][:rows]
                columns.append(_nullable(value))
        return pa.Table.from_arrays(columns, schema=self._schema)

    def _flush(self) -> None:
        if not self._rows:
            return
        part = self._folder / PARTS / f"part-{self._parts:05d}.arrow"
        temporary = part.with_suffix(".tmp")
        with writing(part):
            with pa.OSFile(str(temporary), "wb") as file, pa.ipc.new_file(file, self._schema) as writer:
                writer.write_table(self._table())
            temporary.replace(part)
        self._parts += 1
        self._rows = 0

    def close(self) -> None:
        """Write what is left and join the parts into one file. Raises SwarmError on a full disk: the parts stay."""
        self._flush()
        folder, final = self._folder / PARTS, self._folder / FILE
        temporary = folder / "joined.tmp"
        doubles = [field.name for field in self._schema if field.type == pa.float64()]
        with (
            writing(final),
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
            temporary.replace(final)
            for part in part_files(self._folder):
                part.unlink()
            folder.rmdir()


def _nullable(value: Floats) -> pa.Array:
    """Doubles (n,) as an array that shares their memory, null where they are not finite."""
    finite = np.isfinite(value)
    if finite.all():
        return pa.Array.from_buffers(pa.float64(), len(value), [None, pa.py_buffer(value)], null_count=0)
    valid = pa.py_buffer(np.packbits(finite, bitorder="little"))
    return pa.Array.from_buffers(pa.float64(), len(value), [valid, pa.py_buffer(value)])


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
