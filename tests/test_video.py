"""swarm video: the camera sees everything, the fans are in the field, and the file plays where the libraries are."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from estimators.rotation import exp
from swarm.assets import find_model
from swarm.errors import SwarmError
from swarm.exports.video import FAN_TURN_S, FROM_Z_UP, Options, fans, half_angle_deg, low_corner, video, view_of
from swarm.flight.simulate import simulate
from swarm.hardware import Photodiodes
from swarm.results.replayed import FILE, read_replayed, replayed_bytes
from swarm.results.scene import Scene, StationScene
from swarm.scenario import load
from swarm.world.picture import FIELD_DEG, Picture, Subject

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("ratio", [16 / 9, 1.0, 9 / 16])
def test_the_camera_sees_the_lighthouse_and_every_craft(ratio: float) -> None:
    position = np.random.default_rng(4).uniform([-3, -1, 1], [2, 2, 9], size=(50, 4, 3))
    view = view_of(position, [np.zeros(3)], ratio)
    points = np.concatenate([position.reshape(-1, 3), np.zeros((1, 3))]) - view.eye_m
    ahead = (view.target_m - view.eye_m) / np.linalg.norm(view.target_m - view.eye_m)
    right = np.cross(ahead, [0.0, -1.0, 0.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    assert up[1] < 0, "up in the picture is -y of the lighthouse"
    high = np.abs(points @ up) / (points @ ahead)
    wide = np.abs(points @ right) / (points @ ahead)
    assert (points @ ahead > 0).all()
    assert 0.5 < max(high.max(), wide.max() / ratio) / np.tan(np.radians(FIELD_DEG / 2)) < 1


def test_each_fan_sweeps_its_half_of_the_turn_within_the_field() -> None:
    seen = []
    for time_s in np.linspace(0.0, FAN_TURN_S, 41)[:-1]:
        (wedge,) = fans(120.0, 30.0, 5.0, float(time_s))
        one, other = wedge.corners_m
        assert not wedge.tip_m.any(), "light comes from the lighthouse"
        assert np.allclose([np.linalg.norm(one), np.linalg.norm(other)], 5.0)
        assert np.isclose(np.degrees(np.arccos(one @ other / 25)), 60)
        ahead, axle = (one + other) / np.linalg.norm(one + other), np.abs(other - one)
        assert np.degrees(np.arccos(ahead[2])) <= 60 + 1e-9
        seen.append((int(axle[1] < axle[0]), ahead))
    assert [fan for fan, _ in seen] == [0] * 20 + [1] * 20
    assert all(ahead[1] == 0 for fan, ahead in seen if fan == 0), "fan X turns about y"
    assert all(ahead[0] == 0 for fan, ahead in seen if fan == 1), "fan Y turns about x"


def test_fans_are_as_wide_as_the_craft_need_within_the_field() -> None:
    place = np.array([[[0.0, np.tan(np.radians(40)), 1.0], [np.nan, 0.0, 1.0]]])
    assert np.isclose(half_angle_deg(120.0, place), 44)
    assert half_angle_deg(70.0, place) == 35
    assert half_angle_deg(120.0, place * [1, 0, 1]) == half_angle_deg(120.0, np.full((2, 1, 3), np.nan)) == 12


def test_crowds_are_drawn_in_the_colours_of_their_models(monkeypatch: pytest.MonkeyPatch) -> None:
    # MuJoCo draws 1000 materials at most, and each copy of a craft has its own.
    made: list[Any] = []
    monkeypatch.setattr("mujoco.Renderer", lambda model, *_, **__: made.append(model))
    path = find_model("cubesat6u")
    for count in (2, 400):
        Picture([Subject(f"c{i}", path, False) for i in range(count)], [], 96, 64, 0)
    few, many = made
    each = few.ngeom // 2
    assert few.nmat > 0
    assert many.nmat == 0
    assert many.ngeom == 400 * each
    ink = np.where(few.geom_matid[:, None] < 0, few.geom_rgba, few.mat_rgba[few.geom_matid])
    assert np.array_equal(many.geom_rgba[-each:], ink[:each])


def test_the_object_is_shown_near_by_where_nothing_else_is() -> None:
    position = np.random.default_rng(4).uniform([-3, -1, 1], [2, 2, 9], size=(50, 1, 3))
    view = view_of(position, [np.zeros(3)], 16 / 9)
    ahead = (view.target_m - view.eye_m) / np.linalg.norm(view.target_m - view.eye_m)
    right = np.cross(ahead, [0.0, -1.0, 0.0])
    up = np.cross(right, ahead)
    wide = np.tan(np.radians(FIELD_DEG / 2)) / np.linalg.norm(right)
    for high, low in ((0.8, True), (-0.8, False), (0.0, False)):
        at = view.eye_m + 5 * (ahead + 0.8 * 16 / 9 * wide * right + high * wide * up)
        assert low_corner(view, at[None], 16 / 9) is low


def test_a_replay_keeps_its_object_and_stations(tmp_path: Path) -> None:
    draw = np.random.default_rng(1)
    points, normals = draw.normal(size=(2, 1, 5, 3))
    layout = Photodiodes(points, normals, np.array([[True, True, False, True, True]]))
    at = StationScene("0", exp(draw.normal(size=3)), draw.normal(size=3), "2.0")
    scene = Scene(["a"], [()], layout, [], 120.0, replay=True, stations=[at], up="z")
    file = tmp_path / FILE
    file.parent.mkdir()
    assert read_replayed(tmp_path) is None
    file.write_bytes(replayed_bytes(scene))
    kept = read_replayed(tmp_path)
    assert kept is not None
    assert np.array_equal(kept.point_m, points[0, [0, 1, 3, 4]])
    assert np.array_equal(kept.normal, normals[0, [0, 1, 3, 4]])
    (station,) = kept.stations
    assert (station.name, station.generation, kept.up) == ("0", "2.0", "z")
    assert np.array_equal(station.rotation, at.rotation)
    assert np.array_equal(station.position, at.position)
    for damage in (b'{"photodiodes"', b'"point_m": [1', b"[[", b"NaN"):
        file.write_bytes(replayed_bytes(scene).replace(b'"position_m": [', damage + b"["))
        with pytest.raises(SwarmError, match=r"replayed\.json"):
            read_replayed(tmp_path)


def test_a_frame_with_z_up_is_drawn_upright() -> None:
    assert np.allclose(FROM_Z_UP @ [0, 0, 1], [0, -1, 0])
    assert np.isclose(np.linalg.det(FROM_Z_UP), 1)


@pytest.mark.parametrize(
    ("file", "options", "message"),
    [
        ("a.avi", Options(), "a video ends in .mp4"),
        ("a.mp4", Options(width=99), "the width 99 must be an even number"),
        ("a.mp4", Options(fps=0), "--fps"),
        ("a.mp4", Options(speed=float("nan")), "--speed"),
    ],
)
def test_mistakes(file: str, options: Options, message: str, tmp_path: Path) -> None:
    with pytest.raises(SwarmError, match=message):
        video("no/run", tmp_path / file, options)
    assert not list(tmp_path.iterdir())


def test_without_the_library_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(SwarmError, match=r"pip install \'\.\[video\]\'"):
        video("no/run", tmp_path / "a.mp4")


def test_a_video_plays(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="needs the extra video")
    simulate(load("formation", {"duration_s": 0.2, "swarm.count": 2}), out=tmp_path / "run", record=False)
    file = tmp_path / "run.mp4"
    words = [str(tmp_path / "run"), str(file), "--size", "320x180", "--fps", "10"]
    done = subprocess.run(
        [sys.executable, "-m", "swarm", "video", *words], capture_output=True, text=True, cwd=ROOT, check=False
    )
    if "cannot draw" in done.stderr:
        pytest.skip("this machine has no library that draws without a screen")
    assert done.returncode == 0, done.stderr
    with av.open(str(file)) as container:
        stream = container.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert (stream.width, stream.height, stream.average_rate) == (320, 180, 10)
    assert len(pictures) == 2
    middle = pictures[0][40:130].astype(int)
    assert ((middle[..., 1] - middle[..., 0] > 15).sum()) > 20, "green beams"
    words = [str(tmp_path / "run"), str(tmp_path / "run.png"), "--size", "320x180", "--at", "0.01"]
    subprocess.run([sys.executable, "-m", "swarm", "video", *words], check=True, cwd=ROOT)
    with Image.open(tmp_path / "run.png") as drawn:
        assert drawn.size == (320, 180)
    assert [path.name for path in tmp_path.iterdir() if path.suffix in (".tmp", ".mp4")] == ["run.mp4"]
