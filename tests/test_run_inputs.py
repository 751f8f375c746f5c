"""Runs travel: the files that a scenario names are in the run's folder, which is read and flown again anywhere."""

import shutil
from pathlib import Path, PurePosixPath

import mujoco
import numpy as np
import pytest

import swarm
from swarm.assets import models
from swarm.errors import SwarmError
from swarm.results.inputs import inputs_of
from swarm.results.run_folder import RunFolder
from swarm.scenario import load, to_toml
from swarm.world.craft import load_craft
from swarm.world.model_copy import Copies

TETRAHEDRON = "v 0.3 0 0\nv -0.2 0.3 0\nv -0.2 -0.3 0\nv 0 0 {top}\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
SITES = "\n".join(
    f'<site name="photodiode{i}" pos="{x} {y} 0.3"/>' for i, (x, y) in enumerate([(1, 1), (1, -1), (-1, 1), (-1, -2)])
)
OWN = """<mujoco model="own">
  <!-- a comment -->
  <compiler meshdir="{meshdir}" texturedir="pictures"/>
  <include file="parts/assets.xml"/>
  <worldbody><body name="own">
    <geom type="mesh" mesh="hull"/><geom type="mesh" mesh="far" pos="0 0 0.1"/><include file="parts/sites.xml"/>
  </body></worldbody>
</mujoco>"""
ASSETS = """<mujoco><asset>
  <mesh file="hull.obj"/><mesh name="far" file="{far}"/>
  <texture name="skin" type="2d" file="skin.png"/>
</asset></mujoco>"""
PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c4944415408d763f8cfc0000003010100"
    "18dd8db00000000049454e44ae426082"
)


@pytest.fixture
def cad(tmp_path: Path) -> Path:
    """A model whose parts lie in many folders, one of them named from the root of the disk."""
    home = tmp_path / "cad"
    for name in ("meshes", "pictures", "parts", "far"):
        (home / name).mkdir(parents=True)
    (home / "own.xml").write_text(OWN.format(meshdir="meshes"))
    (home / "parts" / "assets.xml").write_text(ASSETS.format(far=home / "far" / "hull.obj"))
    (home / "parts" / "sites.xml").write_text(f"<mujoco>{SITES}</mujoco>")
    (home / "meshes" / "hull.obj").write_text(TETRAHEDRON.format(top=0.5))
    (home / "far" / "hull.obj").write_text(TETRAHEDRON.format(top=0.9))
    (home / "pictures" / "skin.png").write_bytes(PIXEL)
    return home


def write(copies: Copies, folder: Path) -> None:
    for name, data in copies.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)


def test_a_copied_model_needs_nothing_but_its_folder_and_is_the_same_craft(cad: Path, tmp_path: Path) -> None:
    before = load_craft(cad / "own.xml")
    copies = Copies()
    name = copies.add_model(cad / "own.xml")
    write(copies, tmp_path / "copy")
    shutil.rmtree(cad)
    after = load_craft(tmp_path / "copy" / name)
    for field in ("mass", "com_m", "inertia", "point_m", "normal"):
        np.testing.assert_array_equal(getattr(after, field), getattr(before, field))
    for one, other in zip(after.surfaces, before.surfaces, strict=True):
        np.testing.assert_array_equal(one.vertex[one.face], other.vertex[other.face])
    needed = {Path(file).resolve() for file in mujoco.mju_getXMLDependencies(str(tmp_path / "copy" / name))}
    assert needed == {(tmp_path / "copy" / file).resolve() for file in copies.files}


def test_a_file_that_many_name_is_copied_once_and_equal_names_do_not_collide(cad: Path) -> None:
    (cad / "other.xml").write_text((cad / "own.xml").read_text().replace('model="own"', 'model="other"'))
    (cad / "parts" / "own.xml").write_text(f'<mujoco><worldbody><body name="b">{SITES}</body></worldbody></mujoco>')
    copies = Copies()
    assert copies.add_model(cad / "own.xml") == PurePosixPath("own.xml")
    assert copies.add_model(cad / "own.xml") == PurePosixPath("own.xml")
    assert copies.add_model(cad / "parts" / "own.xml") == PurePosixPath("2/own.xml")
    assert copies.add_model(cad / "other.xml") == PurePosixPath("other.xml")
    assert copies.add_model(cad / "meshes" / "hull.obj") == PurePosixPath("hull.obj")
    assert sorted(map(str, copies.files)) == ["2/hull.obj", "2/own.xml", "hull.obj", "other.xml", "own.xml", "skin.png"]


@pytest.mark.parametrize("name", sorted(models()))
def test_every_shipped_model_can_be_copied(name: str, tmp_path: Path) -> None:
    copies = Copies()
    copied = copies.add_model(models()[name])
    write(copies, tmp_path)
    before, after = load_craft(models()[name], passive=True), load_craft(tmp_path / copied, passive=True)
    np.testing.assert_array_equal(after.point_m, before.point_m)
    np.testing.assert_array_equal(after.inertia, before.inertia)
    needed = {Path(file).resolve() for file in mujoco.mju_getXMLDependencies(str(tmp_path / copied))}
    assert needed == {(tmp_path / file).resolve() for file in copies.files}


def test_a_run_is_flown_again_where_it_was_moved_to_with_the_same_numbers(cad: Path, tmp_path: Path) -> None:
    (tmp_path / "known.toml").write_text("[fan_x]\nphase_rad = 0.001\n[fan_y]\n")
    mine = tmp_path / "mine.toml"
    mine.write_text(
        f'duration_s = 0.1\nseed = 4\n[swarm]\ncount = 2\nmodel = "{cad / "own.xml"}"\n'
        'motion = {kind = "hold", position_m = [0, 0, 5], spacing_m = 4.0}\n[navigation]\ncalibration = "known.toml"\n'
    )
    run = swarm.simulate(mine, out=tmp_path / "run", record=False)
    assert run.scenario is not None
    assert str(tmp_path) not in run.scenario
    for file in (mine, tmp_path / "known.toml"):
        file.unlink()
    shutil.rmtree(cad)
    moved = (tmp_path / "run").rename(tmp_path / "elsewhere")
    again = swarm.simulate(moved / "scenario.toml", out=tmp_path / "again", record=False)
    assert again.telemetry.equals(swarm.open_run(moved).telemetry)
    in_place = swarm.simulate(moved / "scenario.toml", out=moved, force=True, record=False)
    assert in_place.telemetry.equals(again.telemetry)
    assert in_place.scenario == again.scenario


def test_force_replaces_the_inputs_and_keeps_what_a_user_put_there(tmp_path: Path) -> None:
    scenario = load("docking")
    made = inputs_of(scenario)
    assert {craft.model for craft in made.scenario.craft} == {"inputs/berth.xml", "inputs/servicer.xml"}

    def write_run(force: bool) -> None:
        with RunFolder(tmp_path / "run", force) as folder:
            folder.write_scenario(to_toml(made.scenario), made.files)
            folder.finish({})

    write_run(force=False)
    (tmp_path / "run" / "inputs" / "old.xml").touch()
    write_run(force=True)
    assert {PurePosixPath("inputs", p.name) for p in (tmp_path / "run" / "inputs").iterdir()} == set(made.files)
    assert load(tmp_path / "run" / "scenario.toml").craft_names == scenario.craft_names
    (tmp_path / "run" / "inputs" / "notes.txt").write_text("mine")
    with pytest.raises(SwarmError, match="holds files that lighthouse-swarm did not write"):
        write_run(force=True)
    assert (tmp_path / "run" / "inputs" / "notes.txt").read_text() == "mine"


def test_force_replaces_inputs_whatever_they_are_called_and_refuses_before_it_deletes(tmp_path: Path) -> None:
    def write_run(force: bool, files: dict[PurePosixPath, bytes]) -> None:
        with RunFolder(tmp_path / "run", force) as folder:
            folder.write_scenario("seed = 1", files)
            folder.finish({})

    write_run(False, {PurePosixPath("inputs", name): b"1" for name in ("cal.txt", "HULL.STL", "2/cal.txt")})
    write_run(True, {PurePosixPath("inputs", name): b"2" for name in ("mine", "HULL.STL")})
    run = tmp_path / "run"
    assert sorted(str(p.relative_to(run)) for p in run.rglob("*")) == [
        "inputs", "inputs/HULL.STL", "inputs/mine", "scenario.toml", "summary.json",
    ]  # fmt: skip
    assert (run / "inputs" / "HULL.STL").read_bytes() == b"2"
    # Killed while it replaced the run: the files are known all the same.
    marker = run / "summary.json"
    marker.write_text(marker.read_text().replace("complete", "running"))
    (run / "inputs" / "deep").mkdir()
    (run / "inputs" / "deep" / "notes.txt").write_text("mine")
    before = {p: p.read_bytes() for p in run.rglob("*") if p.is_file()}
    with pytest.raises(SwarmError, match="inputs/deep holds files that lighthouse-swarm did not write"):
        write_run(True, {})
    assert {p: p.read_bytes() for p in run.rglob("*") if p.is_file()} == before
    (run / "inputs" / "deep" / "notes.txt").unlink()
    write_run(True, {})
    assert sorted(p.name for p in run.iterdir()) == ["scenario.toml", "summary.json"]


def test_a_model_that_cannot_be_read_is_one_message(tmp_path: Path) -> None:
    with pytest.raises(SwarmError, match=r"none.xml cannot be read: No such file"):
        Copies().add_model(tmp_path / "none.xml")
