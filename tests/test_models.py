"""The shipped models: they compile and run without a warning, and are what their READMEs say."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from estimators.rotation import exp
from swarm.assets import lighthouses, models
from swarm.world import shapes
from swarm.world.craft import load_craft, visuals

EVERY = models() | lighthouses()


@pytest.mark.parametrize("file", ["own", "scene"])
@pytest.mark.parametrize("name", EVERY)
def test_compiles_and_steps_one_second_without_a_warning(name, file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = EVERY[name] if file == "own" else EVERY[name].with_name("scene.xml")
    spec = mujoco.MjSpec.from_file(str(path))
    model = spec.compile()
    if file == "own":
        model.opt.gravity[:] = 0
    data = mujoco.MjData(model)
    data.qvel[:] = 0.5
    mujoco.mj_step(model, data, int(1 / model.opt.timestep))
    assert not any(data.warning.number)
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()
    assert data.ncon == 0, "a part collides with another part of the same craft"


@pytest.mark.parametrize("name", models())
def test_photodiodes_stand_just_above_the_surface_and_look_outward(name):
    """MuJoCo's ray, sent back along the normal from 1 m away, meets the surface within a millimetre of the site."""
    craft = load_craft(models()[name], passive=True)
    model = mujoco.MjModel.from_xml_path(str(models()[name]))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert len(craft.point_m) or name in ("satellite", "shuttle"), "they alone do not cooperate"
    assert np.allclose(np.linalg.norm(craft.normal, axis=1), 1, atol=1e-12)
    for point, normal in zip(craft.point_m, craft.normal, strict=True):
        geom = np.zeros(1, dtype=np.int32)
        distance = mujoco.mj_ray(model, data, point + 0.04 * normal, -normal, None, True, -1, geom)
        assert 0.0402 < distance < 0.0408


def lit_from(model, data, craft, direction, incidence_max_deg=80.0):
    """Photodiodes that light from far away along -direction reaches: MuJoCo's ray from each of them towards it."""
    facing = craft.normal @ direction >= np.cos(np.radians(incidence_max_deg))
    geom = np.zeros(1, dtype=np.int32)
    clear = [mujoco.mj_ray(model, data, point, direction, None, True, -1, geom) < 0 for point in craft.point_m]
    return facing & np.array(clear)


@pytest.mark.parametrize(("name", "least"), [("mockup", 8), ("cubesat6u", 6), ("cubesat12u", 6)])
def test_the_front_is_seen_by_enough_photodiodes_not_in_one_plane(name, least):
    craft = load_craft(models()[name])
    model = mujoco.MjModel.from_xml_path(str(models()[name]))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for off_deg in (0, 15, 30, 40, 50):
        for around in np.arange(0, 2 * np.pi, np.pi / 18):
            axis = np.array([np.cos(around), np.sin(around), 0.0])
            direction = exp(np.radians(off_deg) * axis) @ np.array([0.0, 0.0, 1.0])
            lit = lit_from(model, data, craft, direction)
            assert lit.sum() >= least
            point = craft.point_m[lit]
            # RMS distance from the best plane: the smallest singular value over the square root of the number.
            thickness = np.linalg.svd(point - point.mean(axis=0), compute_uv=False)[2] / np.sqrt(lit.sum())
            assert thickness > 0.004


def test_the_panels_shade_their_own_craft_and_the_back_sees_enough():
    craft = load_craft(models()["cubesat6u"])
    model = mujoco.MjModel.from_xml_path(str(models()["cubesat6u"]))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    from_right_front = exp(np.array([0.0, np.radians(40.0), 0.0])) @ np.array([0.0, 0.0, 1.0])
    lit = lit_from(model, data, craft, from_right_front)
    assert lit[8]
    assert not lit[9], "behind the right panel"
    assert lit_from(model, data, craft, np.array([0.0, 0.0, -1.0])).sum() >= 4


def test_mockup_has_the_size_and_the_inertia_of_a_uniform_solid():
    """Source 1's outer size; mass properties against a sum over tetrahedra of the hull (an independent integral)."""
    craft = load_craft(models()["mockup"])
    vertex = craft.visuals[0].mesh.vertex
    # The edge is given to 0.01 mm, the mesh is kept in single precision.
    assert np.allclose(np.ptp(vertex, axis=0), [0.125, 0.125, 0.0625], atol=2e-5)
    hull = ConvexHull(vertex)
    assert hull.volume == pytest.approx(604.8e-6, rel=1e-3)
    middle = vertex.mean(axis=0)
    second, first, volume = np.zeros((3, 3)), np.zeros(3), 0.0
    for triangle in vertex[hull.simplices]:
        corner = np.vstack([triangle, middle])
        v = abs(np.linalg.det(triangle - middle)) / 6
        total = corner.sum(axis=0)
        # The integral of x x^T over a tetrahedron: V / 20 (sum of the corners' x x^T + (sum x)(sum x)^T).
        second += v / 20 * (corner.T @ corner + np.outer(total, total))
        first += v * total / 4
        volume += v
    assert np.allclose(first / volume, craft.com_m, atol=1e-4)
    second *= craft.mass / volume
    inertia = np.trace(second) * np.eye(3) - second
    # The file's numbers have three digits; the origin is within 0.1 mm of the centroid.
    assert np.allclose(craft.inertia, inertia, rtol=3e-3, atol=1e-9)


def test_cubesat_has_the_inertia_of_its_boxes():
    craft = load_craft(models()["cubesat6u"])

    def box(mass, x, y, z):
        return mass / 12 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])

    panel = box(0.3, 0.3, 0.18, 0.004) + 0.3 * 0.205**2 * np.array([0, 1, 1])
    assert craft.mass == pytest.approx(8 + 2 * 0.3)
    assert np.allclose(np.diag(craft.inertia), box(8, 0.1, 0.2, 0.3) + 2 * panel, rtol=3e-3)


@pytest.mark.parametrize("name", models())
def test_readme_lists_the_photodiodes(name):
    craft = load_craft(models()[name], passive=True)
    text = models()[name].with_name("README.md").read_text()
    rows = re.findall(r"^\| (\d+) \| (\S+) \| (\S+) \| (\S+) \| \((.*)\) \|$", text, re.MULTILINE)
    assert [int(row[0]) for row in rows] == list(range(len(craft.point_m)))
    places = np.array([[float(x) for x in row[1:4]] for row in rows]).reshape(-1, 3)
    assert np.allclose(places, craft.point_m * 1e3, atol=0.051)
    listed = np.array([[float(x) for x in row[4].split(",")] for row in rows]).reshape(-1, 3)
    assert np.allclose(listed / np.linalg.norm(listed, axis=1, keepdims=True), craft.normal, atol=1e-6)


@pytest.mark.parametrize("name", EVERY)
def test_drawn_parts_are_closed_and_outward(name):
    """The divergence theorem: the signed volume of every part is positive, and every edge has its opposite."""
    for mesh, rgba in visuals(EVERY[name]):
        a, b, c = (mesh.vertex[mesh.face[:, i]] for i in range(3))
        assert np.sum(a * np.cross(b, c)) / 6 > 0
        edges = np.concatenate([mesh.face[:, [0, 1]], mesh.face[:, [1, 2]], mesh.face[:, [2, 0]]])
        assert {tuple(edge) for edge in edges} == {tuple(edge) for edge in edges[:, ::-1]}
        assert rgba.shape == (4,)
        assert np.all((rgba >= 0) & (rgba <= 1))


@pytest.mark.parametrize(
    ("mesh", "volume", "smaller"),
    [
        (shapes.box(np.array([0.1, 0.2, 0.3])), 8 * 0.006, 1e-12),
        # An inscribed 24-gon has 0.9886 of the circle's area; along the meridian the same again, less curved.
        (shapes.cylinder(0.1, 0.2), np.pi * 0.01 * 0.4, 0.012),
        (shapes.ellipsoid(np.array([0.1, 0.2, 0.3])), 4 / 3 * np.pi * 0.006, 0.04),
        (shapes.capsule(0.1, 0.2), np.pi * 0.01 * 0.4 + 4 / 3 * np.pi * 0.001, 0.04),
    ],
)
def test_primitive_shapes_enclose_their_volume(mesh, volume, smaller):
    a, b, c = (mesh.vertex[mesh.face[:, i]] for i in range(3))
    enclosed = np.sum(a * np.cross(b, c)) / 6
    assert (1 - smaller) * volume <= enclosed <= volume * (1 + 1e-12)


def test_documented_model_loads(tmp_path):
    text = (Path(__file__).parents[1] / "docs" / "models.md").read_text()
    path = tmp_path / "my_probe.xml"
    example = re.search(r"```xml\n(.*?)```", text, re.DOTALL)
    assert example is not None
    path.write_text(example[1])
    craft = load_craft(path)
    assert craft.mass == 1.5
    assert np.allclose(craft.normal, [[0, 0, 1]] * 5 + [[1, 0, 0]], atol=1e-12)
    assert not craft.com_m.any()
