"""Telemetry: one row per craft and lighthouse period, in columns, on disk while the run is still going.

All poses are body poses in the lighthouse frame at the period's epoch. The errors are active and left,
R_true = Exp([d]x) R_est and p_true = p_est + dp, and with the 6x6 pose part P of the EKF's covariance

    NEES = e^T P^-1 e,   e = (d, dp),

which has a mean of 6 where the filter is consistent. What is not known is null: never NaN, zero or a default pose.

Rows gather in memory for about two seconds of flight and then become a part of the folder `telemetry.parquet.partial`,
an Arrow file, written under another name and renamed: whatever is there can be opened, however the run ended. `close`
streams the parts into one `telemetry.parquet`. `read_telemetry` reads either form.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from swarm.errors import SwarmError
from swarm.results import ccd_columns, guidance_columns, integrity_columns
from swarm.results.ccd_columns import CCD_STATES, CcdFix
from swarm.results.disk import writing
from swarm.results.extra_columns import Extra
from swarm.results.rows import rows_into

if TYPE_CHECKING:
    from estimators.dop import Dilution
    from estimators.pnp import PoseSolution

FILE = "telemetry.parquet"
PARTS = FILE + ".partial"
STATUS = ("searching", "tracking", "coasting", "ambiguous")
"""Names of the status codes 0 to 3."""
SENSORS = ("none", "lighthouse", "stereo", "lighthouse+stereo", "camera", "lighthouse+camera", "lidar")
"""Names of the sensor codes 0 to 6: whose pose the filter took in; both cameras are "stereo", the main one "camera";
"lidar": that of a craft which somebody else observes."""
NAMES = {"status": STATUS, "sensor": SENSORS, "ccd": CCD_STATES}
"""The columns of names: their codes are kept, with null for a code beyond the names."""
FUSED = "fused"
"""Observer of an estimate that several LiDARs make together."""
PERIODS_PER_PART = 120
ROWS_PER_GROUP = 65_536
"""Rows of a part at most, and of a row group of the final file: about 35 MB."""


class Truth(NamedTuple):
    """The true state of C craft at the epoch, in the lighthouse frame.

    position: (C, 3) [m]. quaternion: (C, 4) wxyz of R_l_b. velocity: (C, 3) [m/s]. angular_rate: (C, 3) [rad/s].
    contact: (C,), touched something during the period.
    """

    position: Floats
    quaternion: Floats
    velocity: Floats
    angular_rate: Floats
    contact: Bools


class Peer(NamedTuple):
    """Somebody else's answer for the same epoch, in a replay; not the truth. NaN where there is none.

    position: (C, 3) [m]. quaternion: (C, 4) wxyz.
    """

    position: Floats
    quaternion: Floats


class Errors(NamedTuple):
    """Errors and the EKF's own opinion of them at one epoch, each (C,); NaN where truth or estimate is missing."""

    pnp_position_error_m: Floats
    pnp_attitude_error_deg: Floats
    position_error_m: Floats
    attitude_error_deg: Floats
    position_sigma_m: Floats
    attitude_sigma_deg: Floats
    nees: Floats


class Estimate(Protocol):
    """What telemetry reads of the navigation's estimate at one epoch, lighthouse frame; NaN where unknown."""

    @property
    def status(self) -> Ints:
        """(C,) index into STATUS."""

    @property
    def visible(self) -> Ints:
        """(C,) photodiodes seen by both fans."""

    @property
    def pnp(self) -> "PoseSolution":
        """The PnP solution of this period."""

    @property
    def dilution(self) -> "Dilution":
        """Its dilution of precision."""

    @property
    def rotation(self) -> Floats:
        """(C, 3, 3) R_l_b."""

    @property
    def position(self) -> Floats:
        """(C, 3) [m]."""

    @property
    def angular_rate(self) -> Floats:
        """(C, 3) [rad/s]."""

    @property
    def velocity(self) -> Floats:
        """(C, 3) [m/s]."""

    @property
    def covariance(self) -> Floats:
        """(C, 12, 12) of attitude, angular rate, position, velocity."""

    @property
    def nis(self) -> Floats:
        """(C,)."""

    @property
    def sensor(self) -> Ints:
        """(C,) index into SENSORS."""

    @property
    def ccd(self) -> CcdFix | None:
        """What the cameras found, where there are any."""

    @property
    def missed_sync(self) -> Ints:
        """(C,)."""

    @property
    def rejected(self) -> Ints:
        """(C,) pulses."""


def _column(name: str, kind: pa.DataType, unit: str, meaning: str) -> pa.Field:
    required = name in ("time_s", "frame", "craft", "status", "sensor", "visible")
    return pa.field(name, kind, nullable=not required, metadata={"unit": unit, "meaning": meaning})


def _pose(prefix: str, whose: str) -> list[pa.Field]:
    return [
        *(_column(f"{prefix}_p{a}_m", pa.float64(), "m", f"{whose}: position, {a}") for a in "xyz"),
        *(_column(f"{prefix}_q{a}", pa.float64(), "1", f"{whose}: attitude quaternion, {a} (w >= 0)") for a in "wxyz"),
    ]


def _rates(prefix: str, whose: str) -> list[pa.Field]:
    return [
        *(_column(f"{prefix}_v{a}_m_s", pa.float64(), "m/s", f"{whose}: velocity, {a}") for a in "xyz"),
        *(_column(f"{prefix}_w{a}_rad_s", pa.float64(), "rad/s", f"{whose}: angular rate, {a}") for a in "xyz"),
    ]


def schema(replay: bool = False, ccd: bool = False, lidar: bool = False, extra: Sequence[Extra] = ()) -> pa.Schema:
    """Columns in order, each with its `unit` and `meaning` as field metadata.

    replay: with the peer's pose. ccd: with what the cameras found. lidar: with whose observation an estimate is.
    extra: and these, at the end.
    """
    f64, i16, i32 = pa.float64(), pa.int16(), pa.int32()
    fields = [
        _column("time_s", f64, "s", "the epoch: middle of the lighthouse period"),
        _column("frame", i32, "1", "number of the lighthouse period"),
        _column("craft", pa.dictionary(i32, pa.string()), "", "name of the craft"),
        _column("status", pa.dictionary(pa.int8(), pa.string()), "", ", ".join(STATUS)),
        _column(
            "sensor",
            pa.dictionary(pa.int8(), pa.string()),
            "",
            f"the filter took in: {', '.join(SENSORS)}",
        ),
        _column("visible", i16, "1", "photodiodes seen by both fans"),
        *_pose("true", "truth"),
        *_pose("pnp", "PnP solution of this period alone"),
        *_pose("ekf", "filter's estimate"),
        _column("adop_deg_per_rad", f64, "deg/rad", "attitude dilution of precision, per radian of angle noise (22)"),
        _column("pdop_m_per_rad", f64, "m/rad", "position dilution of precision, per radian of angle noise (22)"),
        _column("pnp_iterations", i16, "1", "Levenberg-Marquardt iterations; null where PnP was not attempted"),
        _column("residual_rad", f64, "rad", "RMS of the PnP solution's angle residuals"),
        _column("pnp_position_error_m", f64, "m", "distance of the PnP solution from the truth"),
        _column("pnp_attitude_error_deg", f64, "deg", "angle of the PnP solution from the truth (25)"),
        _column("position_error_m", f64, "m", "distance of the filter's estimate from the truth"),
        _column("attitude_error_deg", f64, "deg", "angle of the filter's estimate from the truth (25)"),
        _column("position_sigma_m", f64, "m", "root of the trace of the filter's position covariance"),
        _column("attitude_sigma_deg", f64, "deg", "root of the trace of the filter's attitude covariance"),
        _column("nees", f64, "1", "squared pose error normalised by the filter's covariance, 6 degrees of freedom"),
        _column("nis", f64, "1", "squared innovation normalised by its covariance, 6 degrees of freedom"),
        _column("missed_sync", i16, "1", "sync flashes of the period that were predicted instead of seen"),
        _column("rejected_pulses", i32, "1", "pulses of the period that belonged to nothing"),
        _column("contact", pa.bool_(), "", "touched something during the period"),
        *_rates("true", "truth"),
        *_rates("ekf", "filter's estimate"),
    ]
    if replay:
        fields += _pose("peer", "pose that came with the recording, not the truth")
    if ccd:
        states = f"what became of the period's images: {', '.join(CCD_STATES)}"
        fields.append(_column("ccd", pa.dictionary(pa.int8(), pa.string()), "", states))
        fields += [_column(name, i16, unit, meaning) for name, unit, meaning in ccd_columns.COUNTS]
        fields += [_column(name, f64, unit, meaning) for name, unit, meaning in ccd_columns.FLOATS]
    if lidar:
        meaning = f"whose LiDAR the estimate of a passive craft rests on; {FUSED!r}: of several; null: its own estimate"
        fields.append(_column("observer", pa.dictionary(pa.int32(), pa.string()), "", meaning))
    fields += [_column(column.name, column.type, column.unit, column.meaning) for column in extra]
    return pa.schema(fields)


def column_reference() -> str:
    """The text of docs/telemetry.md: every column with type, unit and meaning."""
    lines = [
        "# telemetry.parquet",
        "",
        "One row per craft and lighthouse period, ordered by frame, then craft. Poses are of the craft's body in the",
        "lighthouse frame (x right, y down, z forward) at the epoch, quaternions wxyz; rates and velocities are in the",
        "lighthouse frame. What is not known is null, never zero. Numbers in brackets are equations of source 1",
        "(DOI 10.19650/j.cnki.cjsi.J2311957). In a replay all `true_*` and error columns are null. The file itself has",
        "`unit` and `meaning` as metadata of each field.",
        "",
        "This page is made from the schema (`swarm.results.telemetry.column_reference`).",
        "",
        "| column | type | unit | meaning |",
        "|---|---|---|---|",
    ]
    ordinary, replay = len(schema()), len(schema(replay=True))
    cameras = len(schema(replay=True, ccd=True))
    for i, field in enumerate(schema(replay=True, ccd=True, lidar=True)):
        kind = "string" if pa.types.is_dictionary(field.type) else str(field.type)
        unit, meaning = field.metadata[b"unit"].decode(), field.metadata[b"meaning"].decode()
        only = "" if i < ordinary else "; only in a replay" if i < replay else "; only with cameras"
        only = only if i < cameras else "; only with LiDARs"
        lines.append(f"| `{field.name}` | {kind} | {unit} | {meaning}{only} |")
    lines += [
        "",
        "A simulated run has further columns at the end ([integrity](integrity.md), [faults](faults.md),",
        "[guidance](guidance.md); those of thrusters and wheels are in [actuation](actuation.md)):",
        "",
    ]
    lines += ["| column | type | unit | meaning |", "|---|---|---|---|"]
    for column in (*integrity_columns.COLUMNS, integrity_columns.fault_column(["none"])):
        kind = "string" if column.names else str(column.type)
        only = "; only with [[fault]] tables" if column.names else ""
        lines.append(f"| `{column.name}` | {kind} | {column.unit} | {column.meaning}{only} |")
    for column in (*guidance_columns.COLUMNS, *guidance_columns.DOCKING_COLUMNS):
        kind = "string" if column.names else str(column.type)
        only = "with guided craft" if column in guidance_columns.COLUMNS else "where a craft docks"
        lines.append(f"| `{column.name}` | {kind} | {column.unit} | {column.meaning}; only {only} |")
    return "\n".join(lines) + "\n"


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
    ) -> None:
        """observer: of a run with LiDARs, whose observation each craft's estimate is, None where its own."""
        self._folder, self._craft = folder, list(craft)
        self._schema = schema(replay, ccd, observer is not None, extra)
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
            for group in _groups(_part_files(self._folder)):
                writer.write_table(group, row_group_size=ROWS_PER_GROUP)
        with writing(final):
            temporary.replace(final)
            for part in _part_files(self._folder):
                part.unlink()
            folder.rmdir()


def _nullable(value: Floats) -> pa.Array:
    """Doubles (n,) as an array that shares their memory, null where they are not finite."""
    finite = np.isfinite(value)
    if finite.all():
        return pa.Array.from_buffers(pa.float64(), len(value), [None, pa.py_buffer(value)], null_count=0)
    valid = pa.py_buffer(np.packbits(finite, bitorder="little"))
    return pa.Array.from_buffers(pa.float64(), len(value), [valid, pa.py_buffer(value)])


def _part_files(folder: Path) -> list[Path]:
    return sorted((folder / PARTS).glob("part-*.arrow"))


def _read_part(part: Path, columns: Sequence[str] | None = None) -> pa.Table:
    with pa.OSFile(str(part), "rb") as file:
        names = pa.ipc.open_file(file).schema.names
        wanted = None if columns is None else [names.index(name) for name in columns]
        table = pa.ipc.open_file(file, options=pa.ipc.IpcReadOptions(included_fields=wanted)).read_all()
    return table if columns is None else table.select(columns)


def _groups(parts: list[Path]) -> Iterator[pa.Table]:
    """Tables of about one row group each, from parts that may be much smaller."""
    waiting: list[pa.Table] = []
    for part in parts:
        waiting.append(_read_part(part))
        if sum(len(table) for table in waiting) >= ROWS_PER_GROUP:
            yield pa.concat_tables(waiting)
            waiting = []
    if waiting:
        yield pa.concat_tables(waiting)


def read_telemetry(folder: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """The telemetry of the run in `folder`: the whole, or what a stopped run has left (perhaps no row at all).

    columns: only these, if given. Raises SwarmError where a file is damaged.
    """
    file, parts = folder / FILE, _part_files(folder)
    try:
        if file.exists():
            return pq.read_table(file, columns=columns)
        if parts:
            return pa.concat_tables([_read_part(part, columns) for part in parts])
    except (OSError, pa.ArrowException) as error:
        raise SwarmError(f"cannot read the telemetry in {folder}: {error}") from error
    empty = schema().empty_table()
    return empty.select(columns) if columns is not None else empty


def telemetry_columns(folder: Path) -> list[str]:
    """The columns that the run in `folder` has."""
    file, parts = folder / FILE, _part_files(folder)
    names: list[str] = schema().names
    if file.exists():
        names = pq.read_schema(file).names
    elif parts:
        with pa.OSFile(str(parts[0]), "rb") as part:
            names = pa.ipc.open_file(part).schema.names
    return names


def values(table: pa.Table, name: str) -> NDArray[np.float64]:
    """A numeric column as doubles, NaN where null."""
    out: NDArray[np.float64] = table.column(name).cast(pa.float64()).to_numpy()
    return out
