"""`swarm layout`: poses, sight by brute force, comparisons by hand, the smallest number, and the command as a whole."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from scipy.stats import kstest

import swarm
from estimators.arrays import Floats
from estimators.rotation import matrix_from_quaternion, quaternion_from_matrix
from swarm.assets import find_model, models
from swarm.cli import app as cli
from swarm.errors import SwarmError
from swarm.sensors.visibility import Visibility
from swarm.studies.design.even import even_spreads, farthest_points, least_distance
from swarm.studies.design.poses import PoseRange, Poses, lattice
from swarm.studies.design.sight import lit
from swarm.studies.layout import judgement, search, smallest, study
from swarm.studies.layout.judgement import compare, judge
from swarm.studies.layout.prediction import Prediction, Task, predict
from swarm.studies.layout.request import Request, task
from swarm.world.craft import load_craft
from swarm.world.hull import Mount
from swarm.world.world import CraftStart, World

WITHIN = PoseRange((1.0, 3.0), np.pi, np.pi / 6)


def directions(poses: Poses) -> tuple[Floats, Floats]:
    """The direction to the lighthouse in the body frame, and the craft's in the lighthouse's (P, 3)."""
    out = poses.position / np.linalg.norm(poses.position, axis=1, keepdims=True)
    return -np.einsum("pji,pj->pi", poses.rotation, out), out


@pytest.mark.parametrize("seed", [None, 0, 5])
def test_poses_are_uniform_attitudes_in_range(seed: int | None) -> None:
    poses = lattice(WITHIN, 2000, seed)
    identity = poses.rotation @ np.swapaxes(poses.rotation, 1, 2)
    np.testing.assert_allclose(identity, np.broadcast_to(np.eye(3), identity.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(poses.rotation), 1.0, atol=1e-12)
    assert set(np.linalg.norm(poses.position, axis=1).round(9)) == {1.0, 3.0}
    _, out = directions(poses)
    assert out[:, 2].min() >= np.cos(WITHIN.off_axis_rad) - 1e-12
    # A rotation's angle a is distributed as (a - sin a) / pi on SO(3); a lattice is closer to it than a random sample,
    # which exceeds 0.03 with 2000 once in 20.
    angle = np.arccos(np.clip((np.trace(poses.rotation, axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert kstest(angle, lambda a: (a - np.sin(a)) / np.pi).statistic < 0.03
    near = np.linalg.norm(poses.position, axis=1) < 2
    assert abs(near.mean() - 0.5) < 0.01
    assert np.abs(directions(poses)[0][near].mean(axis=0)).max() < 0.05


def test_a_cone_holds_the_front_towards_the_lighthouse() -> None:
    poses = lattice(PoseRange((2.0,), np.deg2rad(40), 0.0), 500)
    to_light, out = directions(poses)
    np.testing.assert_allclose(out, np.tile([0.0, 0.0, 1.0], (500, 1)), atol=1e-12)
    assert to_light[:, 2].min() == pytest.approx(np.cos(np.deg2rad(40)), abs=2e-3)
    assert to_light[:, 2].min() >= np.cos(np.deg2rad(40))


def some_places(asked: Task, count: int) -> Mount:
    every = asked.hull.mounts(600)
    return every.at(np.linspace(0, len(every.point_m) - 1, count).astype(np.int64))


@pytest.mark.parametrize("name", ["mockup", "cubesat6u"])
def test_sight_is_a_ray_from_the_lighthouse_to_each_place(name: str) -> None:
    """By hand: the craft stays where its file has it, and the light moves around it; one `mj_ray` each."""
    asked = task(Request(name, 12))
    mount, poses = some_places(asked, 60), lattice(WITHIN, 150, 3)
    found = lit(asked.hull, mount, asked.station, poses)
    model = asked.hull.model
    data = mujoco.MjData(model)
    data.qpos[:] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    geom = np.zeros(1, dtype=np.int32)
    expected = np.zeros_like(found)
    for p in range(len(found)):
        turn, place = poses.rotation[p], poses.position[p]
        source = -turn.T @ place
        for k in range(found.shape[1]):
            x, y, z = turn @ mount.point_m[k] + place
            ray = mount.point_m[k] - source
            far = float(np.linalg.norm(ray))
            within = z > 0 and max(abs(np.arctan2(x, z)), abs(np.arctan2(y, z))) <= np.deg2rad(60)
            facing = -ray @ mount.normal[k] >= far * np.cos(np.deg2rad(80))
            if within and facing and 0.3 <= far <= 20:
                hit = mujoco.mj_ray(model, data, source, ray / far, None, True, -1, geom)
                expected[p, k] = hit < 0 or hit >= far - 1e-3
    np.testing.assert_array_equal(found, expected)
    assert 0.1 < found.mean() < 0.5


def test_sight_is_what_the_simulator_sees() -> None:
    """The same craft in a world with the lighthouse's own body: what flies later."""
    asked = task(Request("cubesat6u", 20))
    poses = lattice(WITHIN, 40, 4)
    found = lit(asked.hull, asked.hull.shipped, asked.station, poses)
    quaternion = quaternion_from_matrix(poses.rotation)
    start = CraftStart("a", models()["cubesat6u"], poses.position[0], quaternion[0], np.zeros(3), np.zeros(3))
    world = World([start], find_model("lighthouse"))
    sight = Visibility(world.model, world.photodiodes, world.craft_bodies, world.lighthouse_body, asked.station)
    for p in range(len(found)):
        np.testing.assert_array_equal(sight.lit(poses.position[p][None], quaternion[p][None])[0], found[p])


def test_a_prediction_does_not_depend_on_the_layouts_beside_it() -> None:
    asked = task(Request("mockup", 12))
    poses = lattice(WITHIN, 60)
    one, other = asked.hull.shipped, some_places(asked, 9)
    alone, (first, second) = predict(asked, [one], poses)[0], predict(asked, [one, other], poses)
    np.testing.assert_array_equal(alone.error, first.error)
    assert second.lit.shape == (60, 9)
    np.testing.assert_array_equal(np.isinf(second.error), second.lit.sum(axis=1) < 4)
    expected = np.hypot(first.attitude_rad / asked.mix.attitude_rad, first.position_m / asked.mix.position_m)
    np.testing.assert_array_equal(first.error, expected)


def test_comparisons_by_hand() -> None:
    inf = np.inf
    ours = np.array([1.0, 2.0, 3.0, 4.0, inf, 1.0, 1.0, 1.0])
    theirs = np.array([2.0, 2.0, 2.0, inf, inf, inf, inf, 4.0])
    made = compare(ours, theirs, 0.75)
    assert made.all_poses == (3.0, inf)
    # Both solve the first three and the last one; the third smallest of four each.
    assert made.same_poses == (2.0, 2.0)
    assert made.both_solve == 0.5
    # They solve half of the poses: 3/4 of it is 3/8 of all, the third smallest of eight.
    assert made.share == 0.375
    assert made.same_share == (1.0, 2.0)
    assert made.ratios() == (0.0, 1.0, 0.5)
    assert np.isnan(compare(theirs, theirs, 0.75).ratios()[0])
    assert compare(theirs, ours, 0.75).ratios()[0] == inf
    assert np.isnan(compare(ours, np.full(8, inf), 0.75).ratios()).all() is np.False_
    assert np.isnan(compare(ours, np.full(8, inf), 0.75).same_poses).all()


def test_a_spread_is_even() -> None:
    point = np.random.default_rng(0).random((400, 3))
    spreads = even_spreads(point, 8, 5)
    distances = [least_distance(point[chosen]) for chosen in spreads]
    assert distances == sorted(distances, reverse=True)
    chosen = farthest_points(point, 8, 3)
    assert chosen[0] == 3
    # Gonzalez: no point is farther from the chosen ones than the chosen ones from each other.
    reach = np.linalg.norm(point[:, None] - point[chosen], axis=2).min(axis=1).max()
    assert reach <= least_distance(point[chosen])


def fake(attitude_deg: float, position_mm: float, blind: float = 0.0) -> Prediction:
    count = 100
    bad = np.arange(count) < blind * count
    attitude = np.where(bad, np.inf, np.deg2rad(attitude_deg))
    position = np.where(bad, np.inf, 1e-3 * position_mm)
    error = np.where(bad, np.inf, 1.0)
    return Prediction(np.ones((count, 4), dtype=np.bool_), attitude, position, error, error)


@pytest.mark.parametrize("needed", [4, 5, 7, 13, 30])
def test_the_smallest_number_is_the_smallest(needed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, tries = task(Request("mockup", None, 0.1, 2.0, losses=0)), []

    def find(task: Task, at: object, count: int, quick: bool) -> search.Found:
        tries.append(count)
        mount = Mount(np.zeros((count, 3)), np.zeros((count, 3)))
        return search.Found(mount, fake(0.1, 2.0 * (needed / count) ** 0.5, 0.0 if count > 5 else 0.06))

    monkeypatch.setattr(smallest, "find", find)
    free = Mount(np.zeros((200, 3)), np.zeros((200, 3)))
    at = search.Places(free, free, 0.01, None, None, None)  # type: ignore[arg-type]
    said: list[str] = []
    assert smallest.smallest(asked, at, 4, 0.1, 2.0, said.append) == max(needed, 6)
    assert len(tries) == len(said) <= 12
    assert smallest.smallest(asked, at, 4, 0.1, None, said.append) == 6
    assert "unsolvable" in said[0]


def test_a_precision_out_of_reach_says_what_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = task(Request("mockup", None, 0.1, 2.0, losses=0))
    mount = Mount(np.zeros((4, 3)), np.zeros((4, 3)))
    monkeypatch.setattr(smallest, "find", lambda *a, **k: search.Found(mount, fake(0.2, 1.0)))
    free = Mount(np.zeros((20, 3)), np.zeros((20, 3)))
    at = search.Places(free, free, 0.01, None, None, None)  # type: ignore[arg-type]
    with pytest.raises(SwarmError, match=r"20 photodiodes .* within 0\.200° and 1\.00 mm; wanted: 0\.1°, 2 mm"):
        smallest.smallest(asked, at, 4, 0.1, 2.0, lambda text: None)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that takes a second: it finds no good layout, but takes every step."""
    small = {search: {"SAMPLES": 800, "CANDIDATES": 50, "POSES": 480, "EXPOSING_POSES": 60, "EVERY": 4, "FINER": 4}}
    small[judgement] = {"POSES": 400, "TRIALS": 20}
    small[study] = {"EVENS": 3}
    for module, values in small.items():
        for name, value in values.items():
            monkeypatch.setattr(module, name, value)
    monkeypatch.setattr("swarm.studies.layout.prediction.SECOND_POSES", 400)
    effort = {"starts": 20, "finalists": 3, "rounds": 1, "seed": 0}
    monkeypatch.setattr("estimators.layout.design.design.__kwdefaults__", effort)


@pytest.fixture
def command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Callable[..., tuple[int, str, str]]:
    """Runs `swarm ...` in this process, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["swarm", *arguments])
        return (cli.main(), *capsys.readouterr())

    return run


@pytest.mark.long
@pytest.mark.usefixtures("quick")
def test_a_layout_is_found_written_and_flies(command: Callable[..., tuple[int, str, str]]) -> None:
    code, out, err = command("layout", "mockup", "--photodiodes", "12", "--losses", "0", "--out", "my/model.xml")
    assert code == 0, err
    files = ["my/model.xml", "my/model-layout.json", "my/model-layout.png", "my/model-layout.svg"]
    assert out.splitlines()[-4:] == [str(Path(file)) for file in files]
    assert all(Path(file).stat().st_size > 1000 for file in files)
    made = json.loads(Path(files[1]).read_text(), parse_constant=pytest.fail)
    craft = load_craft(Path(files[0]))
    # What is judged is what is written, to MuJoCo's six digits.
    np.testing.assert_allclose(1e3 * craft.point_m, [each["point_mm"] for each in made["design"]], atol=1e-3)
    asked = task(Request("mockup", 12))
    again = judge(asked, [("designed", Mount(craft.point_m, craft.normal))], ["designed"])[0]
    layout = made["layouts"]["designed"]
    assert again.predicted.unsolvable == pytest.approx(layout["unsolvable_share"], abs=0.01)
    assert set(made["layouts"]) == {"designed", "even", "shipped"}
    # Even so poor a search leaves fewer poses unsolvable than the shipped layout, which faces front.
    assert layout["unsolvable_share"] < made["layouts"]["shipped"]["unsolvable_share"] / 2
    assert layout["measured"]["median_ratio_to_predicted"] == pytest.approx(1, abs=0.05)
    assert f"{100 * layout['unsolvable_share']:.1f}" in out
    ElementTree.parse(files[3])
    flight = swarm.simulate(
        swarm.load("formation", ["swarm.model=my/model.xml", "swarm.count=2", "duration_s=0.2"]),
        out="run",
        record=False,
    )
    assert flight.telemetry.num_rows == 24
    assert flight.summary["swarm"]["tracking_share"] > 0.5

    before = {file: Path(file).read_bytes() for file in files}
    code, _, err = command("layout", "mockup", "--photodiodes", "12", "--losses", "0", "--out", "my/model.xml")
    assert code == 2
    assert "my/model.xml is there already; --force replaces it" in err.replace("\\", "/")
    assert {file: Path(file).read_bytes() for file in files} == before
    # Same seed, same layout.
    assert (
        command("layout", "mockup", "--photodiodes", "12", "--losses", "0", "--out", "my/model.xml", "--force")[0] == 0
    )
    assert {file: Path(file).read_bytes() for file in files[:2]} == {file: before[file] for file in files[:2]}


@pytest.mark.usefixtures("quick")
def test_a_bare_hull_gets_the_fewest_photodiodes_that_do(command: Callable[..., tuple[int, str, str]]) -> None:
    Path("can.xml").write_text(
        '<mujoco><worldbody><body name="can"><geom type="cylinder" size=".1 .1"/></body></worldbody></mujoco>'
    )
    code, out, err = command("layout", "can.xml", "--attitude-deg", "0.5", "--cone-deg", "50", "--distance-m", "2")
    assert code == 0, err
    made = json.loads(Path("runs/layout-can-smallest/can-layout.json").read_text())
    assert set(made["layouts"]) == {"designed", "even"}
    assert made["photodiodes"] == len(load_craft(Path("runs/layout-can-smallest/can.xml")).point_m)
    assert re.search(r"layout: \d+ photodiodes with one lost leave", err)
    assert "The wanted precision is" in out
    assert load_craft(find_model("runs/layout-can-smallest")).point_m.shape[1] == 3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["mockup"], "how many photodiodes? give --photodiodes, or a precision"),
        (["mokcup", "--photodiodes", "12"], "no model 'mokcup'; did you mean 'mockup'?"),
        (["mockup", "--photodiodes", "3"], "--photodiodes 3: must be at least 4 and at most 64"),
        (["mockup", "--photodiodes", "4"], "--photodiodes 4: a pose needs 4, so with one lost none is left to spare"),
        (["mockup", "--photodiodes", "12", "--losses", "2"], "--losses 2: must be at least 0 and at most 1"),
        (["mockup", "--photodiodes", "12", "--craft", "a"], "--craft a: of which scenario? give --scene"),
        (
            ["mockup", "--photodiodes", "12", "--scene", "docking", "--distance-m", "2"],
            "--distance-m: with --scene, the flight of the craft says where it is",
        ),
        (
            ["cubesat6u", "--photodiodes", "12", "--keep-out", "radiator"],
            "--keep-out radiator: cubesat6u.xml has no body, geom or site of this name",
        ),
        (
            ["mockup", "--photodiodes", "12", "--keep-out", "0,0,0,1,0,1"],
            "--keep-out 0,0,0,1,0,1: each first number must be below the second",
        ),
        (["mockup", "--photodiodes", "12", "--position-mm", "0"], "--position-mm 0: must be above 0"),
        (["mockup", "--attitude-deg", "-1"], "--attitude-deg -1: must be above 0"),
        (
            ["mockup", "--photodiodes", "12", "--distance-m", "30"],
            "--distance-m 30: must be at least 0.3 and at most 20",
        ),
        (["mockup", "--photodiodes", "12", "--cone-deg", "0"], "--cone-deg 0: must be above 0 and at most 180"),
        (
            ["mockup", "--photodiodes", "12", "--off-axis-deg", "60"],
            "--off-axis-deg 60: must be at least 0 and below 60",
        ),
        (["mockup", "--photodiodes", "12", "--share", "1"], "--share 1: must be at least 0.5 and at most 0.99"),
        (
            ["mockup", "--photodiodes", "12", "--set", "swarm.count=3"],
            "a layout without --scene takes only lighthouse.*",
        ),
        (["mockup", "--photodiodes", "12", "--set", "lighthouse.feld_deg=3"], "unknown key; did you mean 'field_deg'"),
        (["mockup", "--photodiodes", "12", "--set", "lighthouse.angle_noise_arcsec=0"], "every layout is perfect"),
        (["mockup", "--photodiodes", "12", "--out", "my/model.txt"], "must end in .xml"),
        (
            ["own.xml", "--photodiodes", "12", "--out", "own.xml", "--force"],
            "is the model that the layout is designed for",
        ),
        (["tiny.xml", "--photodiodes", "12"], "tiny.xml: no place for a photodiode"),
        (["two.xml", "--photodiodes", "12"], "exactly one root body is needed, found 2"),
    ],
)
def test_mistakes(
    command: Callable[..., tuple[int, str, str]], arguments: list[str], message: str, tmp_path: Path
) -> None:
    body = '<body name="{}"><geom type="sphere" size="{}"/></body>'
    frame = "<mujoco><worldbody>{}</worldbody></mujoco>"
    (tmp_path / "own.xml").write_text(frame.format(body.format("a", 0.1)))
    (tmp_path / "tiny.xml").write_text(frame.format(body.format("a", 0.002)))
    (tmp_path / "two.xml").write_text(frame.format(body.format("a", 0.1) + body.format("b", 0.1)))
    before = sorted(tmp_path.rglob("*"))
    code, out, err = command("layout", *arguments)
    assert code == 2
    assert out == ""
    errors = [line for line in err.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert message in errors[0]
    assert "Traceback" not in err
    assert sorted(tmp_path.rglob("*")) == before


def test_quaternions_and_matrices_agree() -> None:
    """`sight` goes through quaternions; the predictions use the matrices."""
    poses = lattice(WITHIN, 100)
    again = matrix_from_quaternion(quaternion_from_matrix(poses.rotation))
    np.testing.assert_allclose(again, poses.rotation, atol=1e-12)
