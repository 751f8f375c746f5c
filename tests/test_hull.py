"""Hull: places for photodiodes against closed forms and the convex hull; a refitted craft is the same craft."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from estimators.arrays import Floats
from swarm.assets import models
from swarm.errors import SwarmError
from swarm.world.craft import load_craft
from swarm.world.hull import FLAT_M, HOUSING_M, PROUD_M, RIM, Hull, Mount
from swarm.world.refit import refit

RADIUS, HALF = 0.05, 0.08
CAN = f'<geom type="cylinder" size="{RADIUS} {HALF}"/>'
BARE = f'<mujoco><worldbody><body name="can">{CAN}</body></worldbody></mujoco>'


def hull(tmp_path: Path, text: str) -> Hull:
    path = tmp_path / "craft.xml"
    path.write_text(text)
    return Hull(path)


def new_places(mount: Mount, shipped: Mount) -> Mount:
    return mount.at(np.arange(len(mount.point_m) - len(shipped.point_m)))


def test_places_on_the_mockup_are_on_its_faces_and_off_its_edges() -> None:
    craft = Hull(models()["mockup"])
    mount = new_places(craft.mounts(3000), craft.shipped)
    plane = ConvexHull(craft.visuals[0].mesh.vertex).equations
    height = mount.point_m @ plane[:, :3].T + plane[:, 3]
    on = np.argmax(height, axis=1)
    # The model's vertices are single precision: 1e-8 m.
    np.testing.assert_allclose(height.max(axis=1), PROUD_M, atol=1e-7)
    np.testing.assert_allclose(mount.normal, plane[on, :3], atol=1e-6)
    # Along the face, the plane of another face is reached at height / sin(angle between them): not within the housing.
    # The rim is tried at RIM points, and may hang over the edge until it has fallen by FLAT_M: faces meet at 35.3 deg.
    other = ~np.isclose(plane[:, :3] @ mount.normal.T, 1.0).T
    slope = np.linalg.norm(np.cross(mount.normal[:, None], plane[None, :, :3]), axis=2)
    foot = mount.point_m - PROUD_M * mount.normal
    reach = -(foot @ plane[:, :3].T + plane[:, 3]) / np.maximum(slope, 1e-9)
    least = HOUSING_M * np.cos(np.pi / RIM) - FLAT_M / np.tan(np.deg2rad(35.26))
    assert least > 1.9e-3
    assert np.where(other & (slope > 1e-3), reach, np.inf).min() > least


def test_places_are_even_by_area() -> None:
    craft = Hull(models()["mockup"])
    mount = new_places(craft.mounts(6000), craft.shipped)
    edge, margin = 0.05178, HOUSING_M
    base = 2 * (1 + np.sqrt(2)) * (edge - 2 * margin * np.tan(np.pi / 8)) ** 2
    top = (edge - 2 * margin) ** 2
    count = [int(np.sum(mount.normal @ axis > 0.999)) for axis in ([0, 0, -1], [0, 0, 1])]
    # Low discrepancy: the count's error is that of a boundary, some per cent; FLAT_M moves the margin a little.
    assert count[0] / count[1] == pytest.approx(base / top, rel=0.05)


def test_places_on_a_cylinder_are_on_the_round_surface_itself(tmp_path: Path) -> None:
    """The samples lie on chords, up to 0.4 mm inside it."""
    mount = hull(tmp_path, BARE).mounts(2000)
    side = np.abs(mount.normal[:, 2]) < 0.5
    across = mount.point_m[side][:, :2]
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), RADIUS + PROUD_M, atol=1e-9)
    np.testing.assert_allclose(mount.normal[side][:, :2], across / np.linalg.norm(across, axis=1)[:, None], atol=1e-9)
    assert np.abs(mount.point_m[side][:, 2]).max() < HALF
    np.testing.assert_allclose(np.abs(mount.point_m[~side][:, 2]), HALF + PROUD_M, atol=1e-9)


def test_no_place_under_another_part(tmp_path: Path) -> None:
    text = """<mujoco><worldbody><body name="b"><geom type="box" size=".1 .1 .1"/>
        <geom type="box" size=".05 .05 .02" pos="0 0 .12"/><geom type="sphere" size=".3" rgba="1 1 1 0"/>
        </body></worldbody></mujoco>"""
    mount = hull(tmp_path, text).mounts(3000)
    x, y, z = mount.point_m.T
    under = (np.abs(x) < 0.05) & (np.abs(y) < 0.05) & (np.abs(z - 0.1) < 0.01)
    assert not under.any()
    # A fully transparent geom is no surface.
    assert np.abs(mount.point_m).max() < 0.15


def test_the_photodiodes_that_are_there_are_places_too() -> None:
    craft = Hull(models()["cubesat6u"])
    shipped = load_craft(models()["cubesat6u"])
    np.testing.assert_array_equal(craft.shipped.point_m, shipped.point_m)
    np.testing.assert_array_equal(craft.mounts(500).point_m[-20:], shipped.point_m)


def test_a_hull_without_photodiodes_or_without_a_place(tmp_path: Path) -> None:
    assert len(hull(tmp_path, BARE).shipped.point_m) == 0
    with pytest.raises(SwarmError, match=r"no place for a photodiode.*5 mm across"):
        hull(tmp_path, BARE.replace(f"{RADIUS} {HALF}", "0.002 0.002")).mounts(500)
    with pytest.raises(SwarmError, match=r"cannot be read|does not compile"):
        Hull(tmp_path / "none.xml")


def some_mount(craft: Hull, count: int = 7) -> Mount:
    every = craft.mounts(400)
    return every.at(np.linspace(0, len(every.point_m) - 1, count).astype(np.int64))


@pytest.mark.parametrize("name", ["mockup", "cubesat6u"])
def test_refit_keeps_everything_but_the_photodiodes(name: str, tmp_path: Path) -> None:
    before = load_craft(models()[name])
    craft = Hull(models()[name])
    mount = some_mount(craft)
    target = tmp_path / "deep" / "new.xml"
    target.parent.mkdir()
    target.write_text(refit(craft.path, mount, target, "a test -- of ours"))
    after = load_craft(target)
    # MuJoCo writes six digits.
    np.testing.assert_allclose(after.point_m, mount.point_m, atol=1e-6)
    np.testing.assert_allclose(after.normal, mount.normal, atol=1e-5)
    assert after.mass == pytest.approx(before.mass, rel=1e-5)
    np.testing.assert_allclose(after.inertia, before.inertia, rtol=1e-5, atol=1e-9)
    assert len(after.visuals) == len(before.visuals)
    for a, b in zip(after.visuals, before.visuals, strict=True):
        np.testing.assert_allclose(a.mesh.vertex, b.mesh.vertex, atol=1e-6)
    spec = mujoco.MjSpec.from_file(str(target))
    model = spec.compile()
    old = mujoco.MjSpec.from_file(str(craft.path)).compile()
    # They look as the old ones do.
    assert model.site_size[0] == pytest.approx(old.site_size[0])
    assert model.site_matid[0] == old.site_matid[0]


PARTS = """<mujoco model="parts"><compiler meshdir="assets" angle="degree"/>
  <asset><mesh name="wedge" file="wedge.obj"/></asset>
  <worldbody><body name="parts" pos="1 2 3" euler="0 0 30"><freejoint/>
    <geom type="mesh" mesh="wedge"/>
    <body name="arm" pos="0 0 0.1"><geom type="box" size=".05 .05 .05"/>
      <site name="photodiode0" size=".004" type="sphere"/><site name="photodiode1"/></body>
    <site name="camera" pos="0 0 0.2"/>
  </body></worldbody></mujoco>"""
WEDGE = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize("place", ["other/folder", "."])
def test_refit_finds_meshes_from_wherever_it_is_written(tmp_path: Path, place: str) -> None:
    (tmp_path / "src" / "assets").mkdir(parents=True)
    (tmp_path / "src" / "assets" / "wedge.obj").write_text(WEDGE)
    source = tmp_path / "src" / "parts.xml"
    source.write_text(PARTS)
    craft = Hull(source)
    mount = some_mount(craft, 5)
    target = tmp_path / "src" / place / "new.xml"
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(refit(source, mount, target, "test"))
    after = load_craft(target)
    np.testing.assert_allclose(after.point_m, mount.point_m, atol=1e-6)
    names = [site.name for site in mujoco.MjSpec.from_file(str(target)).sites]
    assert sorted(names) == ["camera", *(f"photodiode{i}" for i in range(5))]


def test_refit_draws_photodiodes_on_a_craft_that_had_none(tmp_path: Path) -> None:
    craft = hull(tmp_path, BARE)
    target = tmp_path / "new.xml"
    target.write_text(refit(craft.path, some_mount(craft), target, "test"))
    model = mujoco.MjSpec.from_file(str(target)).compile()
    assert model.site_size[0, 0] == pytest.approx(0.0015)
    assert model.site_type[0] == mujoco.mjtGeom.mjGEOM_CYLINDER


def test_clear_is_free_of_the_hull(tmp_path: Path) -> None:
    craft = hull(tmp_path, BARE)
    above = np.array([[RADIUS + 1e-3, 0.0, 0.0], [-RADIUS - 1e-3, 0.0, 0.0]])
    towards: Floats = np.array([1.0, 0.0, 0.0])
    np.testing.assert_array_equal(craft.clear(above, towards), [True, False])
