"""The columns of telemetry.parquet, their units and meanings, and the names behind its codes.

What is not known is null: never NaN, zero or a default pose.
"""

import json
from collections.abc import Sequence

import pyarrow as pa

from swarm.results.columns import ccd as ccd_columns
from swarm.results.columns import guidance as guidance_columns
from swarm.results.columns import integrity as integrity_columns
from swarm.results.columns.ccd import CCD_STATES
from swarm.results.columns.extra import Extra

STATUS = ("searching", "tracking", "coasting", "ambiguous")
"""Names of the status codes 0 to 3."""
SENSORS = ("none", "lighthouse", "stereo", "lighthouse+stereo", "camera", "lighthouse+camera", "lidar")
"""Names of the sensor codes 0 to 6: whose pose the filter took in; both cameras are "stereo", the main one "camera";
"lidar": that of a craft which somebody else observes."""
NAMES = {"status": STATUS, "sensor": SENSORS, "ccd": CCD_STATES}
"""The columns of names: their codes are kept, with null for a code beyond the names."""
_WITHOUT_SENSORS = "craft_without_sensors"
FUSED = "fused"
"""Observer of an estimate that several LiDARs make together."""


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


def schema(
    replay: bool = False,
    ccd: bool = False,
    lidar: bool = False,
    extra: Sequence[Extra] = (),
    without_sensors: Sequence[str] = (),
) -> pa.Schema:
    """Columns in order, each with its `unit` and `meaning` as field metadata.

    replay: with the peer's pose. ccd: with what the cameras found. lidar: with whose observation an estimate is.
    extra: and these, at the end. without_sensors: names of craft that navigate by nothing, kept in the metadata.
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
    return pa.schema(fields, {_WITHOUT_SENSORS: json.dumps(list(without_sensors))} if without_sensors else None)


def bystanders(schema: pa.Schema) -> list[str]:
    """The craft without sensors that the schema of a run's telemetry names."""
    said = (schema.metadata or {}).get(_WITHOUT_SENSORS.encode())
    return list(json.loads(said)) if said else []


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
        "This page is made from the schema (`swarm.results.columns.schema.column_reference`).",
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
