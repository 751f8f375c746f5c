"""Telemetry against plain loops with SciPy's rotations, and against kills, full disks and missing values."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.spatial.transform import Rotation
from synthetic_run import PERIOD_S, estimate_of, lost, period_of, truth_at

from estimators.rotation import xyzw_from_wxyz
from swarm.errors import SwarmError
from swarm.results import telemetry
from swarm.results.columns.actuation import ACTUATION
from swarm.results.columns.ccd import CCD
from swarm.results.columns.column import TYPES, Column
from swarm.results.columns.faults import faults
from swarm.results.columns.groups import column_reference
from swarm.results.columns.guidance import DOCKING, GUIDANCE
from swarm.results.columns.integrity import integrity
from swarm.results.columns.observer import observer
from swarm.results.columns.pairs import pairs
from swarm.results.columns.peer import PEER
from swarm.results.columns.schema import schema
from swarm.results.columns.smooth import COLUMNS as SMOOTH
from swarm.results.columns.station_rows import station_rows
from swarm.results.files import PARTS
from swarm.results.files import TELEMETRY as FILE
from swarm.results.reading import read_telemetry
from swarm.results.records import Peer
from swarm.results.telemetry import Telemetry

ROOT = Path(__file__).parents[1]


def names(count):
    return [f"craft-{i}" for i in range(count)]


def write(folder, periods=10, craft=3, seed=1, close=True):
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(seed)
    out = Telemetry(folder, names(craft))
    for k in range(periods):
        truth = truth_at(k * PERIOD_S, craft)
        out.append(period_of((k + 0.5) * PERIOD_S, k, truth, estimate_of(truth, rng)))
    if close:
        out.close()
    return read_telemetry(folder)


def test_errors_and_nees_are_those_of_a_plain_loop(tmp_path):
    craft, rng = 5, np.random.default_rng(3)
    truth = truth_at(1.7, craft)
    # Errors of half a radian: small-angle shortcuts would show.
    estimate = estimate_of(truth, rng, attitude_sigma_rad=0.3, position_sigma_m=0.2)
    out = Telemetry(tmp_path, names(craft))
    out.append(period_of(1.7, 102, truth, estimate))
    out.close()
    rows = read_telemetry(tmp_path).to_pylist()
    keep = [0, 1, 2, 6, 7, 8]
    for i, row in enumerate(rows):
        true = Rotation.from_quat(xyzw_from_wxyz(truth.quaternion[i]))
        turn = (true * Rotation.from_matrix(estimate.rotation[i]).inv()).as_rotvec()
        shift = truth.position[i] - estimate.position[i]
        pose_covariance = estimate.covariance[i][np.ix_(keep, keep)]
        e = np.concatenate([turn, shift])
        pnp_turn = (true * Rotation.from_matrix(estimate.pnp.rotation[i]).inv()).magnitude()
        # Both are double precision over a few dozen operations on numbers near one.
        close: dict[str, Any] = {"rel": 1e-10}
        assert row["attitude_error_deg"] == pytest.approx(np.degrees(np.linalg.norm(turn)), **close)
        assert row["position_error_m"] == pytest.approx(np.linalg.norm(shift), **close)
        assert row["pnp_attitude_error_deg"] == pytest.approx(np.degrees(pnp_turn), **close)
        pnp_shift = np.linalg.norm(truth.position[i] - estimate.pnp.position[i])
        assert row["pnp_position_error_m"] == pytest.approx(pnp_shift, **close)
        assert row["nees"] == pytest.approx(e @ np.linalg.inv(pose_covariance) @ e, **close)
        assert row["position_sigma_m"] == pytest.approx(np.sqrt(np.trace(pose_covariance[3:, 3:])), **close)
        sigma = np.degrees(np.sqrt(np.trace(pose_covariance[:3, :3])))
        assert row["attitude_sigma_deg"] == pytest.approx(sigma, **close)
        ekf = Rotation.from_quat([row["ekf_qx"], row["ekf_qy"], row["ekf_qz"], row["ekf_qw"]])
        assert (ekf.inv() * Rotation.from_matrix(estimate.rotation[i])).magnitude() < 1e-12
        assert row["ekf_qw"] >= 0
        assert (row["craft"], row["frame"], row["status"], row["visible"]) == (f"craft-{i}", 102, "tracking", 9)
        assert row["true_vy_m_s"] == truth.velocity[i, 1]
        assert row["ekf_wz_rad_s"] == estimate.angular_rate[i, 2]


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 3.0, np.pi - 1e-7])
def test_attitude_error_beside_its_singular_angles(tmp_path, angle):
    truth = truth_at(0.0, 1)
    estimate = estimate_of(truth, np.random.default_rng(0))
    axis = np.array([0.6, 0.0, 0.8])
    true = Rotation.from_quat(xyzw_from_wxyz(truth.quaternion[0]))
    turned = (Rotation.from_rotvec(-angle * axis) * true).as_matrix()
    out = Telemetry(tmp_path, names(1))
    errors = out.append(period_of(0.0, 0, truth, estimate._replace(rotation=turned[None])))
    # Quaternions of rounded matrices carry about 1e-16 in each component, twice that in the angle.
    assert errors.attitude_error_deg[0] == pytest.approx(np.degrees(angle), abs=1e-13)


def test_what_is_not_known_is_null(tmp_path):
    truth = truth_at(0.0, 3)
    out = Telemetry(tmp_path, names(3))
    out.append(period_of(0.0, 0, truth, lost(estimate_of(truth, np.random.default_rng(0)), 1)))
    out.close()
    row = read_telemetry(tmp_path).to_pylist()[1]
    missing = {name for name, value in row.items() if value is None}
    known = {"time_s", "frame", "craft", "status", "sensor", "visible", "missed_sync", "rejected_pulses", "contact"}
    known |= {"coupling", "rows"}
    assert missing == {name for name in row if name not in known and not name.startswith("true_")}
    assert row["status"] == "searching"
    for column in read_telemetry(tmp_path).select([f.name for f in schema() if f.type == pa.float64()]).columns:
        assert not np.isnan(column.drop_null().to_numpy()).any()


def test_a_covariance_that_is_not_positive_definite_has_no_nees(tmp_path):
    truth = truth_at(0.0, 2)
    estimate = estimate_of(truth, np.random.default_rng(0))
    estimate.covariance[0, 0, 7] = estimate.covariance[0, 7, 0] = 1.0  # a correlation far above one
    errors = Telemetry(tmp_path, names(2)).append(period_of(0.0, 0, truth, estimate))
    assert np.isnan(errors.nees[0])
    assert np.isfinite(errors.nees[1])


def test_a_replay_has_the_peer_and_no_truth(tmp_path):
    truth = truth_at(0.0, 2)
    out = Telemetry(tmp_path, names(2), groups=[PEER])
    peer = Peer(truth.position, -truth.quaternion)
    out.append(period_of(0.0, 0, None, estimate_of(truth, np.random.default_rng(0)), peer))
    out.append(period_of(0.1, 1, None, estimate_of(truth, np.random.default_rng(0))))
    out.close()
    table = read_telemetry(tmp_path)
    assert table.schema.equals(schema([PEER]))
    first, later = table.to_pylist()[0], table.to_pylist()[2]
    absent = [n for n in first if n.startswith("true_") or "error" in n or n in ("nees", "contact")]
    assert len(absent) == 19
    assert all(first[name] is None for name in absent)
    assert first["peer_px_m"] == truth.position[0, 0]
    assert first["peer_qw"] == abs(truth.quaternion[0, 0])
    assert later["peer_px_m"] is None
    assert first["position_sigma_m"] is not None


def test_same_run_same_file(tmp_path):
    write(tmp_path / "a", periods=300)
    write(tmp_path / "b", periods=300)
    assert (tmp_path / "a" / FILE).read_bytes() == (tmp_path / "b" / FILE).read_bytes()


def test_a_craft_has_the_same_figures_alone_and_in_a_swarm(tmp_path):
    craft = 7
    truth = truth_at(0.3, craft)
    estimate = estimate_of(truth, np.random.default_rng(5))

    def only(values, i):
        if isinstance(values, tuple):
            return type(values)(*(only(v, i) for v in values))
        return None if values is None else values[i : i + 1]

    (tmp_path / "swarm").mkdir()
    swarm = Telemetry(tmp_path / "swarm", names(craft)).append(period_of(0.3, 18, truth, estimate))
    for i in range(craft):
        folder = tmp_path / f"alone-{i}"
        folder.mkdir()
        alone = Telemetry(folder, [f"craft-{i}"]).append(period_of(0.3, 18, only(truth, i), only(estimate, i)))
        for a, b in zip(alone, swarm, strict=True):
            assert a[0] == b[i]


def test_parts_and_the_whole_hold_the_same(tmp_path):
    partial = write(tmp_path / "partial", periods=250, close=False)
    whole = write(tmp_path / "whole", periods=250)
    assert len(whole) == 750
    assert len(partial) == 2 * telemetry.PERIODS_PER_PART * 3
    assert partial.equals(whole.slice(0, len(partial)))
    assert not (tmp_path / "whole" / PARTS).exists()
    assert whole.schema.equals(schema(), check_metadata=True)
    assert read_telemetry(tmp_path / "whole", ["nees"]).column_names == ["nees"]


def test_memory_is_bounded_by_rows_not_by_the_length_of_the_run(tmp_path):
    out = Telemetry(tmp_path, names(1000))
    assert out._block.nbytes < 40e6
    (tmp_path / "long").mkdir()
    write(tmp_path / "long", periods=200, craft=400)
    metadata = pq.ParquetFile(tmp_path / "long" / FILE).metadata
    assert max(metadata.row_group(i).num_rows for i in range(metadata.num_row_groups)) <= telemetry.ROWS_PER_GROUP


KILLED = """
import sys
sys.path.insert(0, {tests!r})
from pathlib import Path
from test_telemetry import estimate_of, names, period_of, truth_at, PERIOD_S, Telemetry, np
rng, out, k = np.random.default_rng(1), Telemetry(Path({folder!r}), names(3)), 0
while True:
    truth = truth_at(k * PERIOD_S, 3)
    out.append(period_of((k + 0.5) * PERIOD_S, k, truth, estimate_of(truth, rng)))
    k += 1
    if k == 400:
        print("ready", flush=True)
"""


def test_a_killed_run_leaves_what_it_had(tmp_path):
    (tmp_path / "killed").mkdir()
    code = KILLED.format(tests=str(ROOT / "tests"), folder=str(tmp_path / "killed"))
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, env=environment) as run:
        assert run.stdout is not None
        assert run.stdout.readline() == b"ready\n"
        run.send_signal(signal.SIGKILL)
    left = read_telemetry(tmp_path / "killed")
    assert len(left) >= 3 * 3 * telemetry.PERIODS_PER_PART
    expected = write(tmp_path / "whole", periods=len(left) // 3)
    assert left.equals(expected)


def test_a_run_killed_while_it_joins_its_parts_can_be_read(tmp_path):
    write(tmp_path, periods=250, close=False)
    (tmp_path / PARTS / "joined.tmp").write_bytes(b"PAR1 half a file")
    assert len(read_telemetry(tmp_path)) == 2 * telemetry.PERIODS_PER_PART * 3


def test_a_run_that_wrote_nothing_is_an_empty_table(tmp_path):
    assert read_telemetry(tmp_path).equals(schema().empty_table())
    assert read_telemetry(tmp_path, ["nees", "craft"]).column_names == ["nees", "craft"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_disk_says_where_and_keeps_the_parts(tmp_path):
    out = Telemetry(tmp_path, names(3))
    truth = truth_at(0.0, 3)
    for k in range(telemetry.PERIODS_PER_PART):
        out.append(period_of(k * PERIOD_S, k, truth, estimate_of(truth, np.random.default_rng(k))))
    (tmp_path / PARTS / "joined.tmp").symlink_to("/dev/full")
    with pytest.raises(SwarmError, match=r"telemetry\.parquet: the disk is full"):
        out.close()
    assert len(read_telemetry(tmp_path)) == 3 * telemetry.PERIODS_PER_PART


def test_a_damaged_file_is_one_message(tmp_path):
    (tmp_path / FILE).write_bytes(b"not a parquet file at all")
    with pytest.raises(SwarmError, match="cannot read the telemetry"):
        read_telemetry(tmp_path)


def test_the_column_reference_is_in_step():
    page = ROOT / "docs" / "telemetry.md"
    assert page.read_text(encoding="utf-8") == column_reference(), (
        "write swarm.results.columns.groups.column_reference() to docs/telemetry.md"
    )
    further = [
        PEER,
        CCD,
        observer((), ()),
        integrity(False),
        station_rows(()),
        pairs((), ()),
        ACTUATION,
        GUIDANCE,
        DOCKING,
        faults(()),
    ]
    assert column_reference().count("\n| `") == len(schema(further)) + len(SMOOTH)


@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize("rows", [0, 1, 8, 77])
def test_a_column_on_disk_is_that_of_pyarrow_s_own_conversion(kind, rows):
    value = np.random.default_rng(rows).integers(0, 2, rows).astype(float)
    value[::3], value[1::5] = np.nan, np.inf
    array = Column("x", "1", "a number", kind, ("low", "high")).array(value)
    array.validate(full=True)
    assert not np.isinf(value).any()
    told = [None if not np.isfinite(v) else v for v in value]
    if kind in ("state", "name"):
        told = [None if v is None else ("low", "high")[int(v)] for v in told]
    elif kind != "number":
        told = [None if v is None else int(v) for v in told]
    assert array.type == TYPES[kind]
    assert array.to_pylist() == told
