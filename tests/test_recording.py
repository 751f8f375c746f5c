"""What is in a recording, read back with rerun's own reader; what it draws, against equations; kills and viewers."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from synthetic_run import PERIOD_S, Estimate, estimate_of, lost, period_of, truth_at

from estimators.rotation import matrix_from_quaternion, wxyz_from_xyzw, xyzw_from_wxyz
from swarm.errors import SwarmError
from swarm.hardware import pad
from swarm.results import scene as recorder
from swarm.results.columns.peer import PEER
from swarm.results.recording import crowd, drawing, plots, viewer
from swarm.results.recording.batch import kept
from swarm.results.recording.blueprint import _view
from swarm.results.recording.estimates import ENLARGED
from swarm.results.recording.lighthouse import FAN_TURN_S
from swarm.results.recording.recording import Recording
from swarm.results.records import Errors, Peer, Truth
from swarm.results.scene import NullRecording, Scene
from swarm.results.telemetry import Telemetry
from swarm.sensors.sight import Sight
from swarm.world.shapes import box

ROOT = Path(__file__).parents[1]


class Flown(NamedTuple):
    """What went into a recording."""

    frame: int
    time_s: float
    truth: Truth | None
    estimate: Estimate
    peer: Peer | None
    errors: Errors


GREY = np.array([0.5, 0.5, 0.5, 1.0])


def scene_of(craft, detail=()):
    angle = np.arange(6) * np.pi / 3
    points = [np.stack([0.05 * np.cos(angle), 0.05 * np.sin(angle), 0.04 + 0 * angle], axis=1)] * craft
    layout = pad(points, [np.tile([0.0, 0.0, 1.0], (6, 1))] * craft)
    part = (box(np.array([0.06, 0.06, 0.03])), GREY)
    return Scene([f"craft-{i}" for i in range(craft)], [[part]] * craft, layout, [part], 120.0, detail)


def fly(folder, craft=3, periods=90, scene=None, replay=False, lost_at=5, faults=None):
    """A recording and the periods that went into it. Craft 1 knows nothing in one period, and has a dark photodiode."""
    folder.mkdir(exist_ok=True)
    scene = (scene or scene_of(craft))._replace(replay=replay)
    rng = np.random.default_rng(4)
    telemetry = Telemetry(folder, scene.craft, [PEER] if replay else ())
    recording = Recording(folder / "recording.rrd", scene)
    flown = []
    for k in range(periods):
        truth = truth_at(k * PERIOD_S, craft)
        estimate = estimate_of(truth, rng)
        if k == lost_at:
            estimate = lost(estimate, 1)
        sight = np.full((craft, 6), Sight.LIT)
        sight[1 % craft, 2], sight[1 % craft, 3] = Sight.BLOCKED, Sight.OUTSIDE
        time_s = (k + 0.5) * PERIOD_S
        true, peer = (None, Peer(truth.position, truth.quaternion)) if replay else (truth, None)
        now = period_of(time_s, k, true, estimate, peer, sight)
        now = now if faults is None else now._replace(fault=np.full(craft, faults[k]))
        errors = telemetry.append(now)
        flown.append(Flown(k, time_s, true, estimate, peer, errors))
        recording.append(now, errors)
    recording.close()
    return folder / "recording.rrd", flown


def read(path, entity, column=None):
    """Rows of an entity's column, all its temporal chunks in order of frame; without column: its column names."""
    rows: dict[int, Any] = {}
    names: set[str] = set()
    for chunk in RrdReader(str(path)).stream():
        if chunk.entity_path != f"/{entity}":
            continue
        batch = chunk.to_record_batch()
        names |= set(batch.schema.names)
        if column in batch.schema.names and not chunk.is_static:
            rows |= dict(zip(batch.column("frame").to_pylist(), batch.column(column).to_pylist(), strict=True))
    return [rows[frame] for frame in sorted(rows)] if column else names


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("flight"))


def test_poses_are_those_of_truth_and_estimate(flight):
    path, flown = flight
    for entity, position, rotation in (
        ("world/craft/craft-1", lambda p: p.truth.position[1], lambda p: matrix_from_quaternion(p.truth.quaternion[1])),
        ("world/estimate/craft-1", lambda p: p.estimate.position[1], lambda p: p.estimate.rotation[1]),
    ):
        at = np.array(read(path, entity, "Transform3D:translation"))[:, 0]
        turn = np.array(read(path, entity, "Transform3D:quaternion"))[:, 0]
        assert len(at) == len(flown)
        for k, period in enumerate(flown):
            # rerun keeps single precision: 6e-8 of 3 m, and of a quaternion's components.
            np.testing.assert_allclose(at[k], position(period), atol=5e-7)
            if np.isfinite(position(period)).all():
                difference = Rotation.from_quat(turn[k]).inv() * Rotation.from_matrix(rotation(period))
                assert difference.magnitude() < 1e-6
    hidden = read(path, "world/estimate/craft-1", "Transform3D:translation")[5]
    assert np.isnan(hidden).all()


def test_times_are_those_of_the_epochs(flight):
    path, flown = flight
    frames, times = [], []
    for chunk in RrdReader(str(path)).stream():
        if chunk.entity_path == "/swarm/nees" and not chunk.is_static:
            batch = chunk.to_record_batch()
            frames += batch.column("frame").to_pylist()
            times += [t.value if hasattr(t, "value") else t for t in batch.column("sim_time").cast("int64").to_pylist()]
    assert frames == [p.frame for p in flown]
    np.testing.assert_allclose(np.array(times) * 1e-9, [p.time_s for p in flown], atol=1e-9)


def test_plots_are_the_telemetry_in_their_units(flight):
    path, flown = flight
    swarm = np.array(read(path, "swarm/position_error", "Scalars:scalars"))
    np.testing.assert_allclose(swarm[:, :3], [1e3 * p.errors.position_error_m for p in flown])
    sigma = [3e3 * np.sqrt(np.nanmean(p.errors.position_sigma_m**2)) for p in flown]
    np.testing.assert_allclose(swarm[:, 3], sigma)
    single = np.array(read(path, "detail/craft-0/attitude_error", "Scalars:scalars"))
    for row, period in zip(single, flown, strict=True):
        e = period.errors
        expected = [e.pnp_attitude_error_deg[0], e.attitude_error_deg[0], 3 * e.attitude_sigma_deg[0]]
        np.testing.assert_allclose(row, expected)
    nees = np.array(read(path, "swarm/nees", "Scalars:scalars"))
    for k, (n, period) in enumerate(zip([3] * 5 + [2] + [3] * 84, flown, strict=True)):
        band = chi2.ppf([0.025, 0.975], 6 * n) / n
        np.testing.assert_allclose(nees[k], [np.nanmean(period.errors.nees), *band], rtol=1e-9)


@pytest.mark.parametrize(("craft", "crowd", "legend"), [(3, False, True), (8, False, False), (40, True, True)])
def test_the_swarms_3_sigma_has_a_name_in_the_title_or_in_a_legend(craft, crowd, legend):
    names, colours = [f"craft-{i}" for i in range(craft)], [0xFFFFFFFF] * craft
    with_sigma = [plot for plot in plots.swarm_plots(names, colours, crowd, False) if plots.SWARM_SIGMA in plot.lines]
    assert [plot.entity for plot in with_sigma] == ["swarm/position_error", "swarm/attitude_error"]
    for plot in with_sigma:
        assert plot.title.endswith("; white: 3σ (RMS)")
        shown: Any = _view(plot).properties["PlotLegend"]
        assert shown.visible.as_arrow_array().to_pylist() == [legend]


def test_states_rays_and_points(flight):
    path, flown = flight
    status = read(path, "status/craft-1", "StateChange:state")
    assert [row[0] for row in status[4:7]] == ["tracking", "searching", "tracking"]
    lit = read(path, "world/rays/lit", "LineStrips3D:strips")
    blocked = read(path, "world/rays/blocked", "LineStrips3D:strips")
    assert {len(row) for row in lit} == {3 * 6 - 2}
    assert {len(row) for row in blocked} == {1}
    body = scene_of(3).photodiodes.point_m[1, 2]
    for row, period in zip(blocked, flown, strict=True):
        end = matrix_from_quaternion(period.truth.quaternion[1]) @ body + period.truth.position[1]
        np.testing.assert_allclose(row[0], [np.zeros(3), end], atol=5e-7)
    colours = read(path, "world/craft/craft-1/photodiodes", "Points3D:colors")
    assert len(colours[0]) == 6
    assert len(set(colours[0])) == 3


def test_ellipsoids_are_three_sigma(flight):
    path, flown = flight
    half = read(path, "world/covariance", "Ellipsoids3D:half_sizes")
    assert [len(row) for row in half[4:7]] == [3, 2, 3]
    variance = np.linalg.eigvalsh(flown[0].estimate.covariance[0, 6:9, 6:9])
    np.testing.assert_allclose(np.sort(half[0][0]), 3 * ENLARGED * np.sqrt(variance), rtol=1e-5)


def test_points_of_an_ellipsoid_have_the_mahalanobis_distance_of_its_sigmas():
    rng = np.random.default_rng(0)
    a = rng.standard_normal((20, 3, 3))
    covariance = a @ np.swapaxes(a, 1, 2) + 1e-3 * np.eye(3)
    half, quaternion = drawing.ellipsoids(covariance, 3.0)
    for p, axes, q in zip(covariance, half, quaternion, strict=True):
        unit = rng.standard_normal(3)
        surface = Rotation.from_quat(xyzw_from_wxyz(q)).apply(axes * unit / np.linalg.norm(unit))
        # The worst condition number here is about 1e4, times rounding.
        assert surface @ np.linalg.solve(p, surface) == pytest.approx(9.0, rel=1e-9)


def test_the_drawn_fans_sweep_as_equation_2_says(flight):
    """At time t the fan stands at theta = w t: for fan X x/z = cot theta on its whole plane, for fan Y y/z."""
    path, flown = flight
    for fan, start, axis in (("x", 0.0, 0), ("y", 0.5, 1)):
        entity = f"world/fans/{fan}"
        at = np.array(read(path, entity, "Transform3D:translation"))[:, 0]
        turn = np.array(read(path, entity, "Transform3D:quaternion"))[:, 0]
        boresight = np.array([0.0, 0.0, 1.0])
        seen = 0
        # The first row of the file, at time 0, has the number of the first period and is replaced by it.
        for k, period in enumerate(flown):
            theta = 2 * np.pi * ((period.time_s / FAN_TURN_S - start) % 1)
            inside = abs(theta - np.pi / 2) <= np.radians(60)
            assert np.isfinite(at[k]).all() == inside
            if inside:
                direction = Rotation.from_quat(turn[k]).apply(boresight)
                assert direction[axis] / direction[2] == pytest.approx(1 / np.tan(theta), abs=1e-6)
                assert direction[1 - axis] == 0
                seen += 1
        assert seen == (70 if fan == "x" else 0)


def test_a_dark_lighthouse_has_no_fans(tmp_path):
    """Dark from the beginning, and in the middle; a fault of one craft leaves the fans alone."""
    faults = ("none", "lighthouse-dark", "photodiode-dead", "photodiode-dead + lighthouse-dark")
    codes = [1] * 20 + [2] * 20 + [3] * 20 + [0] * 10
    path, flown = fly(tmp_path / "dark", periods=len(codes), scene=scene_of(3)._replace(faults=faults), faults=codes)
    at = np.array(read(path, "world/fans/x", "Transform3D:translation"))[:, 0]
    theta = np.array([2 * np.pi * (period.time_s / FAN_TURN_S) for period in flown])
    inside = np.abs(theta - np.pi / 2) <= np.radians(60)
    assert inside[20:].all()
    lit = np.array(["lighthouse-dark" not in faults[code] for code in codes])
    np.testing.assert_array_equal(np.isfinite(at).all(axis=1), inside & lit)


def test_a_box_has_twelve_edges_and_normals_outward():
    part = [(box(np.array([1.0, 2.0, 3.0])), GREY)]
    edges = drawing.outline(part)
    lengths = np.sort(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1))
    np.testing.assert_allclose(lengths, np.repeat([2.0, 4.0, 6.0], 4))
    solid = drawing.solid(part)
    assert solid is not None
    assert solid.vertex.shape == (36, 3)
    assert (np.sum(solid.vertex * solid.normal, axis=1) > 0.9).all()
    assert drawing.solid([]) is None
    assert drawing.outline([]).shape == (0, 2, 3)


def test_the_field_is_as_wide_as_it_says():
    corner = drawing.field(np.radians(120), 2.0)[2][1]
    assert np.degrees(np.arctan2(corner[0], corner[2])) == pytest.approx(60)
    vertex, _ = drawing.fan(np.radians(120), 5.0)
    assert np.degrees(np.arctan2(vertex[-1, 1], vertex[-1, 2])) == pytest.approx(60)
    assert np.linalg.norm(vertex[1:], axis=1) == pytest.approx(5.0)


def test_a_large_swarm_is_a_crowd_with_few_entities(tmp_path):
    path, flown = fly(tmp_path, craft=100, periods=12, scene=scene_of(100, ("craft-7",)))
    entities = {chunk.entity_path for chunk in RrdReader(str(path)).stream()}
    # A few per state of the crowd, none per craft.
    assert len(entities) < 60
    assert "/world/craft/craft-7" in entities
    assert "/world/craft/craft-8" not in entities
    # Every craft but craft-7 is in the entity of its error, in the order of the craft, and nowhere else.
    error_mm = 1e3 * np.delete(flown[4].errors.position_error_m, 7)
    place = np.delete(flown[4].truth.position, 7, axis=0)
    quaternion = np.delete(flown[4].truth.quaternion, 7, axis=0)
    steps = (0.0, *crowd.ERRORS_MM, np.inf)
    drawn = 0
    for low, high, state in zip(steps, steps[1:], crowd.STATES, strict=False):
        mine = (error_mm > low) & (error_mm <= high)
        at = read(path, f"world/crowd/model-0/{state}", "InstancePoses3D:translations")
        if not mine.any():
            assert not at or np.isnan(at[1]).all()
            continue
        turns = read(path, f"world/crowd/model-0/{state}", "InstancePoses3D:quaternions")
        np.testing.assert_allclose(at[1], place[mine], atol=5e-7)
        np.testing.assert_allclose(wxyz_from_xyzw(np.array(turns[1])), quaternion[mine], atol=1e-6)
        drawn += len(at[1])
    assert drawn == 99
    errors = np.nan_to_num([np.delete(p.errors.position_error_m, 7) for p in flown[::4]]).max(axis=0)
    k = int(errors.argmax())
    worst = f"worst: craft-{k + (k >= 7)}, {1e3 * errors[k]:.3g} mm"
    assert read(path, "world/crowd/worst", "Points3D:labels") == [[worst]] * 3
    spread = read(path, "swarm/position_error", "Scalars:scalars")
    error = 1e3 * flown[4].errors.position_error_m
    known = error[np.isfinite(error)]
    np.testing.assert_allclose(spread[1][:3], [np.median(known), np.quantile(known, 0.95), known.max()])


def test_a_lost_craft_of_a_crowd_leaves_its_state_and_comes_back(tmp_path):
    path, flown = fly(tmp_path, craft=40, periods=10, lost_at=4)
    frames = [0, 2, 4, 6, 8]
    searching = read(path, "world/crowd/model-0/searching", "InstancePoses3D:translations")
    assert [np.isnan(row).all() for row in searching] == [frame != 4 for frame in frames]
    np.testing.assert_allclose(searching[2], [flown[4].truth.position[1]], atol=5e-7)
    tracking = np.zeros(len(frames), dtype=int)
    for state in list(crowd.STATES)[: len(crowd.ERRORS_MM) + 1]:
        rows = read(path, f"world/crowd/model-0/{state}", "InstancePoses3D:translations")
        # A state that nobody ever has is not there.
        tracking += [int(np.isfinite(row).all(axis=1).sum()) for row in rows] or 0
    assert tracking.tolist() == [39, 39, 38, 39, 39]
    assert read(path, "world/crowd/worst", "Points3D:labels")[0] == ["worst: craft-1, searching"]


def test_a_replay_draws_the_craft_at_its_estimate(tmp_path):
    path, flown = fly(tmp_path, craft=1, periods=5, replay=True)
    assert not read(path, "world/craft/craft-0")
    at = np.array(read(path, "world/estimate/craft-0", "Transform3D:translation"))[:, 0]
    np.testing.assert_allclose(at, [p.estimate.position[0] for p in flown], atol=5e-7)
    three = np.array(read(path, "detail/craft-0/position_y", "Scalars:scalars"))
    period = flown[3]
    expected = [period.estimate.pnp.position[0, 1], period.estimate.position[0, 1], period.peer.position[0, 1]]
    np.testing.assert_allclose(three[3], expected)


def test_values_are_kept_though_the_run_reuses_its_arrays():
    truth = truth_at(0.0, 2)
    estimate = estimate_of(truth, np.random.default_rng(0))
    errors, shown = Errors(*np.zeros((7, 2))), np.zeros((2, 0))
    now = period_of(0.0, 0, truth, estimate, sight=np.zeros((2, 6), dtype=np.int8))
    copies = kept(now, errors, shown, np.zeros(0, dtype=np.bool_))
    for values in (*copies.errors, *(getattr(copies, n) for n in copies._fields if n not in ("errors", "clouds"))):
        assert not any(np.shares_memory(values, given) for given in (*truth, *estimate[4:]))


KILLED = """
import sys
sys.path.insert(0, {tests!r})
import test_recording as t
t.fly(t.Path({folder!r}), periods=10**9)
"""


def test_a_killed_recording_opens(tmp_path):
    code = KILLED.format(tests=str(ROOT / "tests"), folder=str(tmp_path))
    file = tmp_path / "recording.rrd"
    with subprocess.Popen([sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": str(ROOT)}) as run:
        limit = time.monotonic() + 60
        while (not file.exists() or file.stat().st_size < 500_000) and time.monotonic() < limit:
            time.sleep(0.05)
        run.send_signal(signal.SIGKILL)
    checked = subprocess.run(
        [sys.executable, "-m", "rerun_cli", "rrd", "verify", "--check-footers=false", str(file)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert checked.returncode == 0, checked.stderr
    with pytest.warns(match="no footer"):
        rows = read(file, "world/craft/craft-0", "Transform3D:translation")
    assert len(rows) >= 60
    np.testing.assert_allclose(rows[30][0], truth_at(30 * PERIOD_S, 3).position[0], atol=5e-7)


def test_a_recording_that_cannot_be_written_says_where(tmp_path):
    with pytest.raises(SwarmError, match=r"missing/recording\.rrd"):
        Recording(tmp_path / "missing" / "recording.rrd", scene_of(1))


def test_without_a_display_the_recording_is_written_all_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr(viewer, "has_display", lambda: False)
    recording = Recording(tmp_path / "recording.rrd", scene_of(1), live=True)
    recording.close()
    assert "no display" in (recording.notice or "")
    assert (tmp_path / "recording.rrd").stat().st_size > 0
    with pytest.raises(SwarmError, match="--web"):
        viewer.view(tmp_path / "recording.rrd")
    with pytest.raises(SwarmError, match="there is no recording"):
        viewer.view(tmp_path / "nothing.rrd")


def test_the_null_recording_takes_everything_and_needs_no_rerun():
    null: recorder.Recorder = NullRecording()
    null.append(None, None)  # type: ignore[arg-type]
    null.close()
    assert null.notice is None
    code = "import sys, swarm.results.scene; sys.exit('rerun' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": str(ROOT)}, check=False)
    assert run.returncode == 0


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc/net")
def test_the_viewer_listens_on_this_machine_only(flight):
    port = viewer._free_port()
    command = viewer._command(str(flight[0]), "--serve-grpc", "--port", str(port))
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
    with subprocess.Popen(command, **quiet) as server:
        try:
            limit = time.monotonic() + 30
            listening: list[str] = []
            while not listening and time.monotonic() < limit:
                time.sleep(0.1)
                tables = [Path("/proc/net/tcp").read_text(), Path("/proc/net/tcp6").read_text()]
                sockets = [line.split() for table in tables for line in table.splitlines()]
                listening = [s[1].split(":")[0] for s in sockets if s[1].endswith(f":{port:04X}") and s[3] == "0A"]
            assert listening == [socket.inet_aton("127.0.0.1")[::-1].hex().upper()]
        finally:
            os.killpg(server.pid, signal.SIGTERM)


def test_a_crowds_spread_is_numpys_quantiles_row_by_row():
    rng = np.random.default_rng(11)
    for craft in (1, 2, 7, 100):
        x = rng.standard_normal((6, craft))
        x[rng.random(x.shape) < 0.3] = np.nan
        x[1], x[2] = rng.standard_normal(craft), np.nan
        known = ~np.isnan(x).all(axis=1)
        for shares in ((0.5, 0.95, 1.0), (0.5, 0.05, 0.0)):
            spread = plots._spread(x, shares)
            np.testing.assert_array_equal(spread[known], np.nanquantile(x[known], shares, axis=1).T)
            assert np.isnan(spread[~known]).all()
