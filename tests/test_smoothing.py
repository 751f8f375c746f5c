"""`swarm smooth`: what it writes of a run against a smoother of another make, and every run that it cannot smooth."""

import io
import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from rerun.chunk import RrdReader
from rich.console import Console
from synthetic_run import PERIOD_S, estimate_of, period_of, truth_at
from typer.testing import CliRunner

import swarm
from estimators.filter.smoother import Models, Prediction
from estimators.rotation import exp, left_jacobian, log, matrix_from_quaternion
from estimators.state import STATES, State
from swarm.cli.app import app
from swarm.errors import SwarmError
from swarm.report.run_table import print_report
from swarm.results import filter_history
from swarm.results.disk import FolderLock
from swarm.results.filter_history import History, HistoryWriter, keeps_history
from swarm.results.parquet import GrowingParquet
from swarm.results.reading import read_telemetry
from swarm.results.run_folder import RunFolder
from swarm.results.telemetry import Telemetry

OVERRIDES = ["swarm.count=2", "duration_s=1.5", "fault=[{kind='restart', craft=['craft-1'], at_s=0.8, for_s=0.2}]"]


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Two craft, one of whose computers restarts; the history is in several parts."""
    folder = tmp_path_factory.mktemp("runs") / "flown"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(filter_history, "PERIODS", 35)
        swarm.simulate(swarm.load("drift", OVERRIDES), out=folder)
    return folder


@pytest.fixture
def run(flown, tmp_path):
    return Path(shutil.copytree(flown, tmp_path / "run"))


@pytest.fixture(scope="module")
def smoothed(flown, tmp_path_factory):
    shares: list[float] = []
    folder = shutil.copytree(flown, tmp_path_factory.mktemp("runs") / "smoothed")
    made = swarm.smooth(folder, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1
    return made


def made_of(share, weight, mean, covariance):
    """The models before, of those after, (L,), (L, 12) and (L, 12, 12), and their shares (L, L)."""
    parts = share * weight[:, None]
    before = parts.sum(axis=0)
    parts = parts / np.where(before > 0, before, 1)
    x = parts.T @ mean
    off = mean[:, None] - x
    p = np.einsum("ji,jab->iab", parts, covariance) + np.einsum("ji,jia,jib->iab", parts, off, off)
    return before, x, p


def rts(history, filtered):
    """The smoother of textbooks for every model of motion, in float64 matrices and with inverses, craft by craft."""
    periods, craft = filtered["rotation"].shape[:2]
    out = {name: value.copy() for name, value in filtered.items()}
    models, unit = history["models"], np.eye(STATES)
    for c in range(craft):
        for k in range(periods - 1, -1, -1):
            here = Models(*(part[k, c] for part in models))
            if k == periods - 1 or not history["continued"][k + 1, c]:
                weight, mean, covariance = here.probability, here.last_mean, here.last_covariance
                continue
            ahead = {name: value[k + 1, c] for name, value in history.items() if name != "models"}
            of = Models(*(part[k + 1, c] for part in models))
            later = {name: value[k + 1, c] for name, value in out.items()}
            weight, mean, covariance = made_of(of.moved, weight, mean, covariance)
            weight[weight <= 1e-9] = 0
            turn = log(later["rotation"] @ ahead["rotation"].T)
            far, there = np.concatenate([turn, later["rest"] - ahead["rest"]]), unit.copy()
            there[:3, :3] = np.linalg.inv(left_jacobian(turn))
            back = np.linalg.inv(ahead["transition"])
            for j in np.flatnonzero(weight).tolist():
                scale = np.repeat(of.sigma[j, ::-1], 6)
                before = back @ (of.covariance[j] - scale[:, None] * of.noise * scale) @ back.T
                gain = before @ ahead["transition"].T @ np.linalg.inv(of.covariance[j])
                mean[j] = back @ of.mean[j] + gain @ (far + there @ mean[j] - of.mean[j])
                covariance[j] = before + gain @ (there @ covariance[j] @ there.T - of.covariance[j]) @ gain.T
            weight, mean, covariance = made_of(of.mixed, weight, mean, covariance)
            weight[weight <= 1e-9] = 0
            weight /= weight.sum()
            _, x, p = made_of(np.ones((len(weight), 1)), weight, mean, covariance)
            turned = unit.copy()
            turned[:3, :3] = left_jacobian(x[0, :3])
            out["rotation"][k, c] = exp(x[0, :3]) @ out["rotation"][k, c]
            out["rest"][k, c] += x[0, 3:]
            out["covariance"][k, c] = turned @ p[0] @ turned.T
            mean, covariance = (mean - x) @ turned.T, turned @ covariance @ turned.T
    return out


def test_the_columns_are_those_of_another_smoother(smoothed):
    table, craft = smoothed.telemetry, 2

    def of(*names):
        return np.stack([table.column(name).to_numpy() for name in names], axis=-1).reshape(-1, craft, len(names))

    def rest(prefix):
        return of(*(f"{prefix}_{name}" for name in (
            "wx_rad_s", "wy_rad_s", "wz_rad_s", "px_m", "py_m", "pz_m", "vx_m_s", "vy_m_s", "vz_m_s")))  # fmt: skip

    def turn(prefix):
        return matrix_from_quaternion(of(*(f"{prefix}_q{a}" for a in "wxyz")))

    blocks = [block for _, block in History(smoothed.folder, craft).blocks()][::-1]
    assert [len(block.frame) for block in blocks] == [35, 35, 20]
    state = [np.concatenate([getattr(b.prediction.state, name) for b in blocks]) for name in State._fields]
    history = {
        "continued": np.concatenate([b.prediction.continued for b in blocks]),
        "rotation": state[0],
        "rest": np.concatenate([state[3], state[1], state[2]], axis=-1),
        "models": Models(
            *(np.concatenate(parts) for parts in zip(*(b.prediction.models for b in blocks), strict=True))
        ),
        "transition": np.concatenate([b.prediction.transition for b in blocks]),
    }
    covariance = np.concatenate([b.covariance for b in blocks])
    expected = rts(history, {"rotation": turn("ekf"), "rest": rest("ekf"), "covariance": covariance})
    np.testing.assert_allclose(turn("smooth"), expected["rotation"], atol=1e-9)
    np.testing.assert_allclose(rest("smooth"), expected["rest"], atol=1e-9)
    sigma = np.sqrt(np.trace(expected["covariance"][..., 6:9, 6:9], axis1=-2, axis2=-1))
    np.testing.assert_allclose(of("smooth_position_sigma_m")[..., 0], sigma, rtol=1e-9)

    # Errors and NEES, from the columns of the truth.
    d = log(turn("true") @ np.swapaxes(expected["rotation"], -1, -2))
    e = np.concatenate([d, of(*(f"true_p{a}_m" for a in "xyz")) - expected["rest"][..., 3:6]], axis=-1)
    pose = expected["covariance"][..., [[0], [1], [2], [6], [7], [8]], [0, 1, 2, 6, 7, 8]]
    nees = np.einsum("kci,kci->kc", e, np.linalg.solve(pose, e[..., None])[..., 0])
    np.testing.assert_allclose(of("smooth_nees")[..., 0], nees, rtol=1e-7)
    np.testing.assert_allclose(
        of("smooth_attitude_error_deg")[..., 0], np.degrees(np.linalg.norm(d, axis=-1)), rtol=1e-7
    )


def test_a_restart_ends_what_can_be_smoothed(smoothed):
    rows = [row for row in smoothed.telemetry.to_pylist() if row["craft"] == "craft-1"]
    off = [k for k, row in enumerate(rows) if row["ekf_px_m"] is None]
    assert len(off) >= 10
    assert all((row["smooth_px_m"] is None) == (row["ekf_px_m"] is None) for row in rows)
    last = rows[off[0] - 1]
    assert last["smooth_px_m"] == last["ekf_px_m"]
    assert rows[off[0] - 2]["smooth_px_m"] != rows[off[0] - 2]["ekf_px_m"]


def test_the_file_stands_alone_and_the_telemetry_is_untouched(smoothed, flown):
    table = pq.read_table(smoothed.folder / "smooth.parquet")
    telemetry = smoothed.folder / "telemetry.parquet"
    assert telemetry.read_bytes() == (flown / "telemetry.parquet").read_bytes()
    for name in ("time_s", "frame", "craft"):
        assert table.column(name).to_pylist() == pq.read_table(telemetry).column(name).to_pylist()
    assert all(table.schema.field(name).metadata[b"meaning"] for name in table.column_names)
    some = read_telemetry(smoothed.folder, ["smooth_nees", "frame"])
    assert some.column_names == ["smooth_nees", "frame"]


def test_the_summary_has_its_figures_and_keeps_the_others(smoothed, flown):
    before, after = (json.loads((folder / "summary.json").read_text()) for folder in (flown, smoothed.folder))
    for name, figures in (("swarm", before["swarm"]), *before["craft"].items()):
        now = after["swarm"] if name == "swarm" else after["craft"][name]
        assert {key: now[key] for key in figures} == figures
    assert after["status"] == "complete"
    error = smoothed.telemetry.column("smooth_position_error_m").to_numpy()
    rms = np.sqrt(np.nanmean(error**2))
    assert after["swarm"]["smooth_position_rms_m"] == pytest.approx(rms)
    assert after["swarm"]["smooth_to_ekf_position_ratio"] == pytest.approx(rms / after["swarm"]["ekf_position_rms_m"])
    assert after["swarm"]["smooth_to_ekf_position_ratio"] < 1 / 1.5
    assert after["swarm"]["smooth_nees"]["samples"] == np.count_nonzero(np.isfinite(error))


@pytest.mark.parametrize("width", [80, 200])
def test_the_table_has_the_nees_of_the_smoothed_estimates_beside_that_of_the_filter(smoothed, width):
    out = io.StringIO()
    print_report(Console(file=out, width=width), smoothed.summary, smoothed.folder)
    first, second, *lines = out.getvalue().splitlines()
    swarm = smoothed.summary["swarm"]
    row = next(line for line in lines if line.startswith("swarm "))
    end = first.index("smoothed", second.index("NEES") - 8) + len("smoothed")
    assert second[:end].endswith("NEES")
    assert float(row[:end].split()[-1]) == pytest.approx(swarm["smooth_nees"]["mean"], abs=0.05)
    assert f"{swarm['nees']['mean']:.3g}" in row[end:].split()


def test_the_recording_gets_its_lines(smoothed):
    recording, more = smoothed.recording, smoothed.smoothed_recording
    (one,), (other,) = (RrdReader(str(file)).recordings() for file in (recording, more))
    assert one == other
    rows: dict[int, Any] = {}
    for chunk in RrdReader(str(more)).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == "/detail/craft-0/position_error/smoothed" and "frame" in batch.schema.names:
            rows |= dict(
                zip(batch.column("frame").to_pylist(), batch.column("Scalars:scalars").to_pylist(), strict=True)
            )
    expected = [row for row in smoothed.telemetry.to_pylist() if row["craft"] == "craft-0"]
    assert sorted(rows) == list(range(90))
    for k, row in enumerate(expected):
        np.testing.assert_allclose(
            rows[k], [1e3 * row["smooth_position_error_m"], 3e3 * row["smooth_position_sigma_m"]]
        )
    entities = {chunk.entity_path for chunk in RrdReader(str(more)).stream()}
    assert {"/world/smoothed", "/detail/craft-0/nees/smoothed", "/detail/craft-0/attitude_error/smoothed"} <= entities


def test_it_is_done_again_only_by_force(run):
    first = swarm.smooth(run).telemetry
    with pytest.raises(SwarmError, match=r"is smoothed already; --force \(force=True\) does it again"):
        swarm.smooth(run)
    again = swarm.smooth(swarm.open_run(run), force=True)
    assert again.telemetry == first
    assert not (run / "smooth.parquet.partial").exists()
    # A new run in the same folder takes everything of the old one away.
    RunFolder(run, force=True).release()
    assert [file.name for file in run.iterdir()] == ["summary.json"]


@pytest.mark.parametrize("left", [0, 200, -100])
def test_a_damaged_result_is_replaced_by_force(run, left):
    first = swarm.smooth(run).telemetry
    file = run / "smooth.parquet"
    file.write_bytes(file.read_bytes()[:left])
    with pytest.raises(SwarmError, match=r"cannot read .*smooth.parquet"):
        swarm.open_run(run).telemetry.num_rows  # noqa: B018
    assert swarm.smooth(run, force=True).telemetry == first


def test_a_lock_that_cannot_be_taken_says_why(run, monkeypatch):
    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("swarm.results.disk.os.open", refuse)
    with pytest.raises(SwarmError, match=r"cannot write .*run: no permission to write there"):
        swarm.smooth(run)


def test_a_run_without_a_recording_gets_none(run):
    (run / "recording.rrd").unlink()
    made = swarm.smooth(run)
    assert made.recording is None
    assert made.smoothed_recording is None


@pytest.mark.parametrize("left", [0, 3, 5000])
def test_a_torn_recording_does_not_stop_it(run, left):
    file = run / "recording.rrd"
    file.write_bytes(file.read_bytes()[:left])
    assert swarm.smooth(run).telemetry.column("smooth_px_m").null_count < 180


def test_the_viewer_shows_both_recordings_as_one(smoothed, monkeypatch):
    shown = []

    def view(*files, **more):
        shown.append((files, more))
        return 0

    monkeypatch.setattr("swarm.results.recording.viewer.view", view)
    assert CliRunner().invoke(app, ["view", str(smoothed.folder)]).exit_code == 0
    assert shown == [((smoothed.recording,), {"web": False, "more": [smoothed.smoothed_recording]})]


def test_without_a_history_it_says_how_to_get_one(run):
    shutil.rmtree(run / "filter.history")
    with pytest.raises(SwarmError, match=r"has no filter.history: fly or replay it again with --set recording.filter"):
        swarm.smooth(run)


def test_what_is_no_run_is_refused(tmp_path):
    with pytest.raises(SwarmError, match="is not a run: there is no such folder"):
        swarm.smooth(tmp_path / "nothing")


def test_a_run_that_is_being_written_is_refused(run):
    lock = FolderLock(run)
    with pytest.raises(SwarmError, match="is being written by another program"):
        swarm.smooth(run)
    lock.release()
    assert swarm.smooth(run).summary["swarm"]["smooth_nees"]


def test_a_folder_that_cannot_be_written_is_named_and_left_alone(run):
    # In the place of the parts stands a file: what a read-only folder does too, where the tests do not run as root.
    (run / "smooth.parquet.partial").write_text("mine")
    before = (run / "summary.json").read_bytes()
    with pytest.raises(SwarmError, match=r"cannot write in .*run: .*copy the run to where you may write"):
        swarm.smooth(run)
    assert (run / "summary.json").read_bytes() == before
    assert (run / "smooth.parquet.partial").read_text() == "mine"


@pytest.mark.parametrize("damage", ["torn", "other"])
def test_a_damaged_history_is_named_and_nothing_is_lost(run, damage):
    part = run / "filter.history" / "part-00001.arrow"
    if damage == "torn":
        part.write_bytes(part.read_bytes()[:1000])
    else:
        shutil.copy(run / "filter.history" / "part-00000.arrow", part)
    before = (run / "summary.json").read_bytes()
    with pytest.raises(SwarmError, match="part-00001.arrow" if damage == "torn" else "periods before or after"):
        swarm.smooth(run)
    assert (run / "summary.json").read_bytes() == before
    assert not list(run.glob("smooth*"))


def made_run(folder, periods, craft=3, without=(), closed=True):
    """A folder of a run whose filters are at rest, without navigation."""
    rng, names = np.random.default_rng(3), [f"craft-{i}" for i in range(craft)]
    with RunFolder(folder) as marked:
        telemetry, history = Telemetry(folder, names, (), without), HistoryWriter(folder, craft)
        for k in range(periods):
            truth = truth_at(k * PERIOD_S, craft, 0.0)
            estimate = estimate_of(truth, rng)
            wide = estimate.covariance + 1e-4 * np.eye(STATES)
            f = np.broadcast_to(np.eye(STATES), wide.shape)
            state = State(estimate.rotation, estimate.position, estimate.velocity, estimate.angular_rate)
            period = period_of(k * PERIOD_S, k, truth, estimate)
            telemetry.append(period)
            more = period.estimate._asdict() | {"prediction": Prediction(np.full(craft, k > 0), state, wide, f)}
            known: Any = SimpleNamespace(**more)
            history.append(period._replace(estimate=known))
        if closed:
            history.close()
            telemetry.close()
            marked.finish({})
        else:
            marked._ended = True
    return folder


def test_a_run_that_was_killed_is_smoothed_as_far_as_it_was_written(tmp_path):
    # 150 periods of which 120 are in the first part, and the history's was lost.
    folder = made_run(tmp_path / "killed", 250, closed=False)
    assert swarm.open_run(folder).status == "running"
    shutil.copytree(folder, tmp_path / "less")
    made = swarm.smooth(folder)
    assert (made.status, made.summary["reason"]) == ("interrupted", "the program was killed")
    assert made.telemetry.num_rows == 240 * 3
    assert made.telemetry.column("smooth_px_m").null_count == 0
    (tmp_path / "less" / "filter.history" / "part-00001.arrow").unlink()
    less = swarm.smooth(tmp_path / "less").telemetry
    assert less.num_rows == 240 * 3
    assert less.column("smooth_px_m").slice(0, 360).null_count == 0
    assert less.column("smooth_px_m").slice(360).null_count == 360


def test_a_run_without_navigation_is_refused(tmp_path):
    folder = made_run(tmp_path / "dark", 2, craft=1, without=["craft-0"])
    with pytest.raises(SwarmError, match=r"no craft of .*dark navigates, so there is nothing to smooth"):
        swarm.smooth(folder)
    with pytest.raises(SwarmError, match="empty has no rows of telemetry"):
        swarm.smooth(made_run(tmp_path / "empty", 0))


def test_rows_by_numbers_are_those_of_the_whole(run):
    from swarm.results.reading import RowReader

    whole, reader = read_telemetry(run, ["frame", "ekf_px_m"]), RowReader(run, ["frame", "ekf_px_m"])
    assert len(reader) == len(whole)
    for first, past in ((100, 180), (17, 101), (0, 1)):
        assert reader.rows(first, past).to_pydict() == whole.slice(first, past - first).to_pydict()


def test_a_long_run_of_many_keeps_its_history_only_if_asked():
    assert keeps_history(None, 8 * 1800)
    assert not keeps_history(None, 1000 * 3600)
    assert keeps_history(True, 1000 * 3600)
    assert not keeps_history(False, 1)


def test_a_run_keeps_none_where_it_shall_not(tmp_path):
    made = swarm.simulate(
        swarm.load("drift", ["swarm.count=1", "duration_s=0.1", "recording.filter=false"]),
        out=tmp_path / "run",
        record=False,
    )
    assert not (made.folder / "filter.history").exists()


def test_memory_holds_one_part_of_the_history_at_a_time(run, monkeypatch):
    """However many parts: none is read before the one behind it has been smoothed and written."""
    events = []
    blocks, write = History.blocks, GrowingParquet.write

    def reading(self):
        for number, block in blocks(self):
            events.append(("read", number))
            yield number, block

    def writing(self, table, number=None):
        events.append(("write", number))
        write(self, table, number)

    monkeypatch.setattr(History, "blocks", reading)
    monkeypatch.setattr(GrowingParquet, "write", writing)
    swarm.smooth(run)
    assert events == [(what, number) for number in (2, 1, 0) for what in ("read", "write")]


def test_the_command_prints_the_gain_and_refuses_what_it_cannot_smooth(run):
    done = CliRunner().invoke(app, ["smooth", str(run)])
    assert (done.exit_code, "Smoothed error over the filter's" in done.stdout) == (0, True), done.output
    again = CliRunner().invoke(app, ["smooth", str(run)])
    assert again.exit_code == 2
    assert "is smoothed already" in again.stderr
