"""The LiDAR that is simulated, the targets that it sees, and what a run with one leaves."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from lidar_target import box

from estimators import rotation as rot
from estimators.lidar.ray_cast import cast
from swarm import load, simulate
from swarm.assets import find_model
from swarm.errors import SwarmError
from swarm.flight.flight import Flight
from swarm.report.subject import Subject
from swarm.results.run_folder import open_run
from swarm.scenario import Lidar as Table
from swarm.sensors.lidar import Lidar, Mount
from swarm.studies.papers import reproduce
from swarm.studies.papers.experiment import quantiles
from swarm.studies.papers.lidar import Turntable, error_deg, turned
from swarm.world.surface import known_shape, surface
from swarm.world.world import CraftStart, World


def scanner(**values):
    return Table(target="target", horizontal_field_deg=60.0, resolution_deg=0.5, **values)


PERFECT = scanner(range_noise_mm=0.0, jitter_deg=0.0, dropout_probability=0.0)
HST = Path(__file__).parents[1] / ".." / "shared" / "data" / "spacecraft" / "HST.obj"
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def test_rays_go_where_the_lines_say_and_meet_what_the_mesh_says():
    """Ranges against the package's own ray casting at the same mesh; MuJoCo keeps meshes in single precision."""
    bench = Turntable(0, scanner=PERFECT)
    rotation = turned(np.array([30.0, -50.0, 70.0]))
    scan = bench.scan(rotation)
    elevation = np.unique(np.round(np.degrees(np.arcsin(scan.direction[:, 2])), 6))
    assert elevation == pytest.approx(np.linspace(-15, 15, 16), abs=1e-6)
    azimuth = np.degrees(np.arctan2(scan.direction[:, 1], scan.direction[:, 0]))
    assert np.diff(np.unique(np.round(azimuth, 6))) == pytest.approx(0.5, abs=1e-5)
    viewpoint = -rotation.T @ bench.position
    direction = scan.direction @ rotation
    hits = cast(bench.shape.mesh, viewpoint, direction)
    # A grazing ray may be lost, nothing else: there are no drop-outs here.
    assert not np.any(scan.returned & np.isinf(hits.distance))
    cosine = np.abs(np.sum(bench.shape.mesh.normal[hits.triangle] * direction, axis=1))
    clear = np.isfinite(hits.distance) & (cosine > np.cos(np.radians(45)))
    assert np.mean(scan.returned[clear]) > 0.99
    both = scan.returned & np.isfinite(hits.distance)
    # An edge may be met by one and missed by the other, by rounding.
    assert np.quantile(np.abs(scan.range_m[both] - hits.distance[both]), 0.99) < 1e-5


def test_noise_drop_outs_and_seeds():
    noisy = scanner()
    rotation = turned(np.zeros(3))
    truth = Turntable(0, scanner=PERFECT).scan(rotation).range_m
    bench = Turntable(3, scanner=noisy)
    off = np.array([bench.scan(rotation).range_m - truth for _ in range(20)])
    known = off[np.isfinite(off)]
    # Robust, since jitter moves rays across edges: 3 % is 4 sigma of 10 000 ranges, and some of the jitter.
    assert 1.4826 * np.median(np.abs(known)) == pytest.approx(0.01, rel=0.05)
    lost = np.isnan(off[:, np.isfinite(truth)])
    assert 0.005 < lost.mean() < 0.2
    again = Turntable(3, scanner=noisy)
    assert np.array_equal(again.scan(rotation).range_m - truth, off[0], equal_nan=True)
    assert not np.array_equal(Turntable(4, scanner=noisy).scan(rotation).range_m - truth, off[0], equal_nan=True)


def test_returns_fade_with_incidence_and_range():
    def share(distance, tilt_deg):
        settings = Table(target="target", horizontal_field_deg=10.0, lines=4, vertical_field_deg=1.0)
        bench = Turntable(1, "satellite", settings, distance)
        rotation = turned(np.array([0.0, tilt_deg, 0.0]))
        hits = cast(bench.shape.mesh, -rotation.T @ bench.position, bench._lidar._direction @ rotation)
        return np.mean(bench.scan(rotation).returned[np.isfinite(hits.distance)])

    near, far = share(5.0, 0.0), share(55.0, 0.0)
    # (1 - 0.01)(1 - (55/60)^8) = 0.50, and less where the surface is slanted.
    assert near > 0.9
    assert 0.2 < far < 0.55


def test_craft_hide_each_other_and_move_during_the_scan():
    """A plate stands between scanner and wall for the second half of the scan only: it flies."""
    still = np.zeros(3)
    inspector, satellite = find_model("inspector"), find_model("satellite")
    front = np.array([0.0, 0.0, 30.0])
    starts = [
        CraftStart("scanner", inspector, front, UPRIGHT, still, still),
        CraftStart("far", satellite, front + np.array([20.0, 0, 0]), UPRIGHT, still, still, passive=True),
        CraftStart("near", satellite, front + np.array([8.0, 60.0, 0]), UPRIGHT, still, still, passive=True),
    ]
    world = World(starts, find_model("lighthouse"))
    settings = Table(target="far", horizontal_field_deg=4.0, lines=4, vertical_field_deg=2.0, range_noise_mm=0.0)
    scanner = world.lidars[0]
    assert scanner is not None
    lidar = Lidar(world.model, world.craft_bodies, [Mount(0, *scanner)], settings, 0, [0])
    place = np.array([s.position for s in starts])
    clear = lidar.still(place, np.tile(UPRIGHT, (3, 1)))[0]
    assert np.nanmin(clear.range_m) > 18
    place[2] = front + np.array([8.0, 0, 0])
    hidden = lidar.still(place, np.tile(UPRIGHT, (3, 1)))[0]
    assert np.nanmax(hidden.range_m) < 10
    assert len(np.unique(hidden.time_s)) == 20
    assert np.ptp(hidden.time_s) == pytest.approx(0.1, rel=0.06)


@pytest.mark.parametrize("suffix", [".obj", ".stl"])
def test_a_bare_mesh_is_a_target(tmp_path, suffix):
    vertex, face = box((-1.0, -0.5, -0.25), (1.0, 0.5, 0.25))
    path = tmp_path / f"hulk{suffix}"
    if suffix == ".obj":
        lines = [f"v {x} {y} {z}" for x, y, z in vertex] + [f"f {a} {b} {c}" for a, b, c in face + 1]
        path.write_text("\n".join(lines))
    else:
        record = np.dtype([("n", "<3f4"), ("v", "<(3,3)f4"), ("a", "<u2")])
        triangles = np.zeros(len(face), dtype=record)
        triangles["v"] = vertex[face]
        path.write_bytes(bytes(80) + np.uint32(len(face)).tobytes() + triangles.tobytes())
    found, faces = surface(path)
    assert np.ptp(found, axis=0) == pytest.approx([2.0, 1.0, 0.5], abs=1e-6)
    assert len(faces) == 12
    assert known_shape(path).radius_m == pytest.approx(np.sqrt(1 + 0.25 + 0.0625), abs=1e-6)
    settings = load("inspect-satellite", [f'craft[1].model="{path}"'])
    Flight(settings)


@pytest.mark.skipif(not HST.exists(), reason="needs the mesh of a real spacecraft")
def test_a_real_spacecraft_is_acquired_from_its_mesh_alone():
    from estimators.lidar.acquisition import acquire

    bench = Turntable(1, HST, distance_m=24.0)
    truth = turned(np.array([20.0, 130.0, -50.0]))
    found = acquire(bench.scan(truth), bench.shape)
    assert found.found
    assert error_deg(truth, found.rotation) < 2.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (['craft[0].lidar.target="satelite"'], "no craft has this name; did you mean 'satellite'"),
        (["craft[1].passive=false"], "must be passive: a craft that navigates by itself is not inspected"),
        (["craft[0].lidar.rate_hz=120"], "at most one scan per lighthouse period, 60 Hz"),
        (["craft[0].lidar.range_min_m=80"], "must be below range_max_m = 60.0 m"),
        (["craft[0].lidar.lines=0"], "must be at least 1"),
    ],
)
def test_mistakes_are_named(changes, message):
    with pytest.raises(SwarmError) as caught:
        load("inspect-satellite", changes)
    assert message in str(caught.value)
    assert changes[0].split("=")[0] in str(caught.value)


def test_a_craft_without_a_place_for_a_lidar_is_named():
    with pytest.raises(SwarmError, match=r"craft\[0\].lidar: .*has no place for a LiDAR \(a site named 'lidar'\)"):
        Flight(load("inspect-satellite", ['craft[0].model="cubesat6u"']))


def test_a_run_leaves_poses_scans_and_a_summary(tmp_path):
    run = simulate(load("swarm-inspect", ["duration_s=1.2", "recording.enabled=false"]), out=tmp_path / "run")
    table = run.telemetry.to_pydict()
    rows = [i for i, name in enumerate(table["craft"]) if name == "satellite"]
    assert {table["sensor"][i] for i in rows} == {"none", "lidar"}
    assert {table["observer"][i] for i in rows} == {"fused"}
    assert {table["observer"][i] for i in range(len(table["craft"])) if i not in rows} == {None}
    known = [i for i in rows if table["status"][i] == "tracking"]
    assert len(known) > 0.8 * len(rows)
    assert max(table["attitude_error_deg"][i] for i in known[-20:]) < 0.6
    assert max(table["position_error_m"][i] for i in known[-20:]) < 0.02
    assert all(table["pnp_px_m"][i] is None for i in rows)

    scans = pq.read_table(tmp_path / "run" / "scans.parquet").to_pydict()
    assert set(scans["observer"]) == {"right", "left", "above"}
    assert len(scans["observer"]) == 3 * 12
    assert scans["outcome"].count("found") == 3
    assert scans["outcome"].count("tracked") == 33
    for name in ("measured_attitude_error_deg", "ekf_nees", "overlap"):
        assert all(value is not None for value in scans[name])
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["lidar"]["left"]["acquisitions"] == 1
    assert summary["craft"]["satellite"]["observed"] is True
    assert summary["craft"]["left"]["observed"] is False
    assert summary["swarm"]["samples"] == 3 * 72, "the target is none of the craft that find themselves"
    # Killed before it was summarised: its page has what its scans say.
    (tmp_path / "run" / "summary.json").write_text(json.dumps({"program": summary["program"], "status": "running"}))
    assert Subject(open_run(tmp_path / "run")).summary["lidar"] == summary["lidar"]


@pytest.mark.parametrize(
    ("name", "sizes", "rows"),
    [
        ("lidar-acquisition", {"poses": 2, "draws": 2}, 4),
        ("lidar-tracking", {"runs": 1, "frames": 4}, 4),
        ("lidar-turn", {"poses": 4}, 4),
    ],
)
def test_the_experiments_in_small(name, sizes, rows, tmp_path):
    reproduce(name, out=tmp_path / "it", sizes=sizes)
    found = json.loads((tmp_path / "it" / "comparison.json").read_text())
    assert pq.read_table(tmp_path / "it" / "data.parquet").num_rows == rows
    mean = [line["ours"] for line in found["comparison"] if line["quantity"] == "mean error"]
    assert mean[0] < 1.5
    assert (tmp_path / "it" / "figure.png").stat().st_size > 10_000


def test_errors_and_their_distribution():
    turn = rot.exp(np.radians([[0, 0, 3.0], [0, 4.0, 0]]))
    found = error_deg(np.stack([np.eye(3)] * 2), turn)
    assert found == pytest.approx([3.0, 4.0], abs=1e-9)
    assert np.isnan(error_deg(np.eye(3), np.full((3, 3), np.nan)))
    assert quantiles(np.array([1.0, 2.0, 9.0, np.nan])) == pytest.approx(
        {"mean": 4.0, "median": 2.0, "95 %": 8.3, "largest": 9.0}
    )
