"""What a craft's model file must be: anything else is refused with what it is, and how to come to an MJCF."""

from pathlib import Path

import mujoco
import pytest
from typer.testing import CliRunner

from swarm.cli.app import app
from swarm.errors import SwarmError
from swarm.world.craft import load_craft
from swarm.world.hull import Hull
from swarm.world.refit import refit

URDF = """<?xml version="1.0"?><!-- a box --><robot name="r"><link name="base"><inertial><mass value="2"/>
    <inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size=".1 .1 .2"/></geometry></visual></link></robot>"""
BODY = '<body name="{}"><freejoint/><geom size=".1"/></body>'
FILES: dict[str, tuple[str | bytes, str]] = {
    "robot.xml": (URDF, r"robot\.xml is a URDF, a craft is MJCF: to convert it, .*discardvisual"),
    "robot.urdf": (URDF, "is a URDF, a craft is MJCF"),
    "model.sdf": ('<sdf version="1.6"><model name="m"/></sdf>', "is an SDF, a craft is MJCF: .*sdf2mjcf"),
    "page.xml": ("<html><body/></html>", "is XML, but no MJCF: its root element is <html>; a craft is MJCF"),
    "ns.xml": ('<x:robot xmlns:x="http://x"/>', "is a URDF"),
    "part.xml": ("<mujocoinclude/>", "a part that an MJCF includes"),
    "flight.toml": ("duration_s = 3\n[swarm]\ncount = 1\n", "is TOML, a scenario or a study, not a craft's model"),
    "flight.xml": ("[[craft]]\nname = 'a'\n", "is TOML, a scenario or a study"),
    "other.toml": ("a = 1\n", "is TOML, not a craft's model"),
    "empty.xml": ("", r"empty\.xml is empty; a craft is MJCF, an OBJ or an STL"),
    "blank.xml": (" \n\t\n", "is empty"),
    "zeros.xml": (bytes(100), "is empty"),
    "noise.xml": (bytes(range(256)), "is neither XML nor a mesh"),
    "comment.xml": ("<!-- nothing -->", "is no XML: "),
    "open.xml": ("<mujoco><worldbody>", r"does not compile: XML parse error"),
    "list.txt": ("hello", "is neither XML nor a mesh"),
    "mesh.ply": ("ply\n", "is a format that is not read: export an OBJ or an STL"),
    "model.mjb": (b"\x01\x02", "is a compiled MuJoCo model"),
    "nothing.xml": (
        "<mujoco/>",
        "exactly one root body is needed, found 0 .none.; put the craft's geoms into a <body>",
    ),
    "world.xml": ('<mujoco><worldbody><geom size=".1"/></worldbody></mujoco>', "found 0 .none.; put"),
    "two.xml": (
        f"<mujoco><worldbody>{BODY.format('a')}{BODY.format('b')}</worldbody></mujoco>",
        r"found 2 \('a', 'b'\); a craft is one rigid body: give each its own file",
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_another_file_is_refused_with_what_it_is(name: str, tmp_path: Path) -> None:
    content, message = FILES[name]
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(SwarmError, match=message) as raised:
        load_craft(path, passive=True)
    assert str(path) in str(raised.value)


def test_the_command_ends_with_2_and_names_the_key(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(URDF)
    scenario = tmp_path / "flight.toml"
    scenario.write_text('[swarm]\ncount = 1\nmodel = "robot.xml"\n')
    for command in (["check", str(scenario)], ["run", str(scenario), "--out", str(tmp_path / "out")]):
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 2, result.output
        words = " ".join(result.output.split())
        assert "swarm.model = " in words
        assert "a URDF, a craft is MJCF" in words
    assert not (tmp_path / "out").exists()


def test_the_conversion_that_the_message_gives_keeps_the_shape(tmp_path: Path) -> None:
    settings = '<mujoco><compiler discardvisual="false" fusestatic="false"/></mujoco>'
    (tmp_path / "robot.urdf").write_text(URDF.replace('<robot name="r">', f'<robot name="r">{settings}'))
    spec = mujoco.MjSpec.from_file(str(tmp_path / "robot.urdf"))
    spec.compile()
    (tmp_path / "craft.xml").write_text(spec.to_xml())
    craft = load_craft(tmp_path / "craft.xml", passive=True)
    assert craft.mass == pytest.approx(2.0)
    assert [part.vertex.max(axis=0).tolist() for part in craft.surfaces] == [pytest.approx([0.05, 0.05, 0.1])]


def test_a_bare_mesh_is_refitted_as_an_mjcf(tmp_path: Path) -> None:
    path = tmp_path / "block.obj"
    corner = [f"v {x} {y} {z}" for x in (0, 0.2) for y in (0, 0.3) for z in (0, 0.1)]
    quads = ["f 1 2 4 3", "f 5 7 8 6", "f 1 5 6 2", "f 3 4 8 7", "f 1 3 7 5", "f 2 6 8 4"]
    path.write_text("\n".join(corner + quads))
    mount = Hull(path).mounts(100)
    target = tmp_path / "craft.xml"
    target.write_text(refit(path, mount, target, "a block"))
    craft = load_craft(target)
    assert len(craft.point_m) == len(mount.point_m)
    assert sum(len(part.face) for part in craft.surfaces) == 12
    assert craft.mass == pytest.approx(load_craft(path, passive=True).mass, rel=1e-5)


def layout(places: list[str]) -> str:
    sites = "".join(f'<site name="photodiode{i}" pos="{place}"/>' for i, place in enumerate(places))
    return f'<mujoco><worldbody><body><geom size=".05"/>{sites}</body></worldbody></mujoco>'


@pytest.mark.parametrize(
    ("places", "message"),
    [
        (["0 0 .1"] * 3, "3 photodiodes .*, at least 4 are needed"),
        (["0.3 0.1 .1"] * 5, "all 5 photodiodes are at one point .*never determines a pose"),
        ([f"{x} {2 * x} {0.1 - x}" for x in (-0.04, -0.02, 0, 0.03, 0.05)], "all 5 photodiodes are on one line"),
        (["0 0 0", "1 1 1", "0 0 0", "1 1 1"], "all 4 photodiodes are on one line"),
        (["0 0 0", "1e-6 0 0", "0 1e-6 0", "0 0 1e-6"], "at one point .within 0.01 mm."),
        (["0 0 .1", "0 1 .1", "1 0 .1", "0 0 .1", "0 1 .1"], "5 photodiodes, but at 3 places only: at least 4"),
        (["nan 0 0", "0 1 0", "1 0 0", "0 0 1"], "site 'photodiode0': pos = 'nan 0 0': must be within 10000 m"),
        (["1 0 0", "0 1e40 0", "1 0 0", "0 0 1"], "site 'photodiode1': pos = '0 1e.40 0': must be within"),
    ],
)
def test_photodiodes_that_never_determine_a_pose_are_refused(places: list[str], message: str, tmp_path: Path) -> None:
    path = tmp_path / "craft.xml"
    path.write_text(layout(places))
    with pytest.raises(SwarmError, match=message) as raised:
        load_craft(path)
    assert str(path) in str(raised.value)
    if "site" not in message:
        # A craft that does not navigate may carry any.
        assert len(load_craft(path, passive=True).point_m) == len(places)


def test_four_places_in_a_plane_fly_and_so_do_photodiodes_close_together(tmp_path: Path) -> None:
    path = tmp_path / "craft.xml"
    for places in (["0 0 0", "0 1 0", "1 0 0", "1 1 0"], ["0 0 0", "0 0 0", "1 0 0", "0 1e-3 0", "0 0 1e-3"]):
        path.write_text(layout(places))
        assert len(load_craft(path).point_m) == len(places)


@pytest.mark.parametrize("normal", ['zaxis="0 0 0"', 'quat="0 0 0 0"'])
def test_a_photodiode_without_a_direction_is_refused(normal: str, tmp_path: Path) -> None:
    path = tmp_path / "craft.xml"
    path.write_text(layout(["0 0 .1", "0 1 .1", "1 0 .1", "1 1 .1"]).replace('pos="0 0 .1"', f'pos="0 0 .1" {normal}'))
    with pytest.raises(SwarmError, match=r"does not compile: .*(zaxis too small|zero quaternion)"):
        load_craft(path)
