"""Visibility: against a ray by ray `mj_ray` loop in crowded random scenes, and against closed forms."""

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.rotation import matrix_from_quaternion
from swarm.hardware import Photodiodes, pad
from swarm.scenario import Lighthouse
from swarm.sensors.sight import Sight
from swarm.sensors.visibility import Visibility
from swarm.units import si

# An L-shaped prism: its convex hull covers the notch, its triangles do not.
OUTLINE = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]) * 0.08 - 0.08
L_VERTICES = np.vstack([np.column_stack([OUTLINE, np.full(6, z)]) for z in (-0.06, 0.06)])
L_CAPS = [[0, 2, 1], [0, 3, 2], [0, 5, 3], [5, 4, 3], [6, 7, 8], [6, 8, 9], [6, 9, 11], [11, 9, 10]]
L_SIDES = [f for i in range(6) for j in [(i + 1) % 6] for f in ([i, j, j + 6], [i, j + 6, i + 6])]
L_FACES = np.array(L_CAPS + L_SIDES)
FACE_NORMALS = np.vstack([np.eye(3), -np.eye(3)])


def add_craft(spec: mujoco.MjSpec, index: int, kind: int) -> None:
    """A free body: a box, an L-shaped mesh or a round shape, with thin panels on a body of their own."""
    body = spec.worldbody.add_body(name=f"craft-{index}")
    body.add_freejoint()
    if kind == 0:
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.06, 0.06, 0.06])
    elif kind == 1:
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="ell")
    elif kind == 2:
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.05, 0.06, 0])
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_ELLIPSOID, size=[0.02, 0.09, 0.03], pos=[0.1, 0, 0])
    else:
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.03, 0.08, 0])
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.05, 0, 0], pos=[0, 0.09, 0])
    panels = body.add_body(pos=[0, 0, 0.02])
    for side in (-1, 1):
        panels.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.15, 0.04, 0.002], pos=[side * 0.25, 0, 0])


def scene(rng: np.random.Generator, craft: int) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    spec.add_mesh(name="ell", uservert=L_VERTICES.ravel(), userface=L_FACES.ravel())
    house = spec.worldbody.add_body(name="lighthouse")
    house.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.05, 0.05, 0.05])
    for i in range(craft):
        add_craft(spec, i, int(rng.integers(4)))
    return spec.compile()


def random_layout(rng: np.random.Generator, craft: int) -> Photodiodes:
    """Photodiodes on the faces of a cube of 13 cm: outside the boxes, inside or outside of the other shapes."""
    points, normals = [], []
    for _ in range(craft):
        k = int(rng.integers(4, 14))
        normal = FACE_NORMALS[rng.integers(6, size=k)]
        point = rng.uniform(-0.065, 0.065, (k, 3))
        points.append(np.where(normal != 0, 0.065 * normal, point))
        normals.append(normal)
    return pad(points, normals)


def bodies(model: mujoco.MjModel, craft: int) -> list[int]:
    return [model.body(f"craft-{i}").id for i in range(craft)]


def unit(q: Floats) -> Floats:
    out: Floats = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return out


def brute_force(
    model: mujoco.MjModel, layout: Photodiodes, position: Floats, quaternion: Floats, station: Lighthouse
) -> NDArray[np.int8]:
    """Photodiode by photodiode in plain Python, every ray by MuJoCo's own single-ray function."""
    limits, data = si(station), mujoco.MjData(model)
    craft = len(position)
    for i, body in enumerate(bodies(model, craft)):
        start = model.jnt_qposadr[model.body_jntadr[body]]
        data.qpos[start : start + 7] = [*position[i], *quaternion[i]]
    mujoco.mj_forward(model, data)
    out: NDArray[np.int8] = np.full(layout.present.shape, Sight.OUTSIDE, dtype=np.int8)
    for c, k in np.argwhere(layout.present):
        body_rotation = data.xmat[bodies(model, craft)[c]].reshape(3, 3)
        p = position[c] + body_rotation @ layout.point_m[c, k]
        n = body_rotation @ layout.normal[c, k]
        d = np.sqrt(p @ p)
        tangent = np.tan(limits.field_rad / 2) * p[2]
        if p[2] <= 0 or abs(p[0]) > tangent or abs(p[1]) > tangent:
            continue
        if not limits.range_min_m <= d <= limits.range_max_m:
            continue
        if np.arccos(-(n @ p) / d) > limits.incidence_max_rad:
            continue
        first = mujoco.mj_ray(model, data, np.zeros(3), p / d, None, True, model.body("lighthouse").id, None)
        out[c, k] = Sight.BLOCKED if 0 <= first < d - 1e-3 else Sight.LIT
    return out


@pytest.mark.parametrize("seed", range(12))
def test_equal_to_a_ray_by_ray_loop_in_a_crowd(seed: int) -> None:
    rng = np.random.default_rng(seed)
    craft = 10
    model = scene(rng, craft)
    layout = random_layout(rng, craft)
    station = Lighthouse()
    visibility = Visibility(model, layout, bodies(model, craft), model.body("lighthouse").id, station)
    seen = []
    for spread in (0.2, 0.5, 1.5):
        for _ in range(4):
            # In a narrow cone around boresight, where rays pass the pole of spherical coordinates, and wide.
            depth = rng.uniform(0.2, 4.0, (craft, 1))
            position = np.hstack([rng.normal(0, spread, (craft, 2)) * np.minimum(depth, 1.0), depth])
            quaternion = unit(rng.normal(size=(craft, 4)))
            state = visibility.state(position, quaternion)
            np.testing.assert_array_equal(state, brute_force(model, layout, position, quaternion, station))
            np.testing.assert_array_equal(visibility.lit(position, quaternion), state == Sight.LIT)
            seen.append(state[layout.present])
    # The scenes are worth the name only if all three answers are common.
    share = np.bincount(np.concatenate(seen), minlength=3) / np.concatenate(seen).size
    assert share.min() > 0.05


def plate_scene() -> tuple[mujoco.MjModel, list[int]]:
    """One flat craft of 20 x 20 cm, one box of 10 x 10 x 2 cm, one empty lighthouse."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_body(name="lighthouse").add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0])
    for i, size in enumerate(([0.1, 0.1, 0.01], [0.05, 0.05, 0.01])):
        body = spec.worldbody.add_body(name=f"craft-{i}")
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size)
    model = spec.compile()
    return model, bodies(model, 2)


# Both face the lighthouse with their -z side.
FACING = np.array([[1.0, 0, 0, 0], [1.0, 0, 0, 0]])
FRONT = np.array([0.0, 0.0, -1.0])


def plate_visibility(photodiodes: Floats, station: Lighthouse = Lighthouse()) -> Visibility:  # noqa: B008
    model, craft = plate_scene()
    layout = pad([photodiodes, np.zeros((0, 3))], [np.tile(FRONT, (len(photodiodes), 1)), np.zeros((0, 3))])
    return Visibility(model, layout, craft, model.body("lighthouse").id, station)


def test_shadow_of_a_box_has_its_edges_where_similar_triangles_say() -> None:
    # The box's near face, at 0.99 m, casts the widest shadow.
    edge = 0.05 / 0.99 * 1.99
    x = np.array([0.0, edge - 1e-5, edge + 1e-5, 0.15])
    visibility = plate_visibility(np.column_stack([x, np.zeros(4), np.full(4, -0.01)]))
    state = visibility.state(np.array([[0, 0, 2.0], [0, 0, 1.0]]), FACING)
    assert state[0].tolist() == [Sight.BLOCKED, Sight.BLOCKED, Sight.LIT, Sight.LIT]
    assert state[1].tolist() == [Sight.OUTSIDE] * 4


def test_what_stands_behind_does_not_shade() -> None:
    visibility = plate_visibility(np.array([[0, 0, -0.01]]))
    assert visibility.lit(np.array([[0, 0, 2.0], [0, 0, 3.0]]), FACING)[0, 0]


def test_own_surface_shades_from_a_millimetre_of_depth() -> None:
    depth = np.array([0.0, 0.9e-3, 1.1e-3, 5e-3])
    visibility = plate_visibility(np.column_stack([np.zeros((4, 2)), -0.01 + depth]))
    state = visibility.state(np.array([[0, 0, 2.0], [0, 3.0, 9.0]]), FACING)
    assert state[0].tolist() == [Sight.LIT, Sight.LIT, Sight.BLOCKED, Sight.BLOCKED]


@pytest.mark.parametrize(
    ("position", "quaternion", "lit"),
    [
        ([0, 0, 19.9], [1, 0, 0, 0], True),
        ([0, 0, 20.1], [1, 0, 0, 0], False),
        ([0, 0, 0.32], [1, 0, 0, 0], True),
        ([0, 0, 0.3], [1, 0, 0, 0], False),
        ([1.72, 0, 1.01], [1, 0, 0, 0], True),
        ([1.74, 0, 1.01], [1, 0, 0, 0], False),
        ([0, -1.74, 1.01], [1, 0, 0, 0], False),
        ([1.72, 1.72, 1.01], [1, 0, 0, 0], True),
        ([0, 0, -2.0], [0, 0, 1, 0], False),
        ([0, 0, 2.0], [np.cos(np.deg2rad(39.5)), 0, np.sin(np.deg2rad(39.5)), 0], True),
        ([0, 0, 2.0], [np.cos(np.deg2rad(40.5)), 0, np.sin(np.deg2rad(40.5)), 0], False),
        ([0, 0, 2.0], [0, 0, 1, 0], False),
    ],
)
def test_limits(position: list[float], quaternion: list[float], lit: bool) -> None:
    visibility = plate_visibility(np.array([[0, 0, -0.01]]))
    rotation = matrix_from_quaternion(np.array(quaternion, dtype=np.float64))
    place = np.array(position) - rotation @ [0, 0, -0.01] + [0, 0, -0.01]
    state = visibility.state(np.array([place, [0, 0, -5.0]]), np.array([quaternion, [1, 0, 0, 0]]))
    assert state[0, 0] == (Sight.LIT if lit else Sight.OUTSIDE)


def test_wrong_hands_are_refused() -> None:
    model, craft = plate_scene()
    layout = pad([np.zeros((4, 3))] * 2, [np.zeros((4, 3))] * 2)
    house = model.body("lighthouse").id
    with pytest.raises(ValueError, match="no free joint"):
        Visibility(model, layout, [house, craft[0]], house, Lighthouse())
    with pytest.raises(ValueError, match="1 craft bodies, but layouts of 2"):
        Visibility(model, layout, craft[:1], house, Lighthouse())
    with pytest.raises(ValueError, match="poses of 2 craft"):
        Visibility(model, layout, craft, house, Lighthouse()).lit(np.zeros((3, 3)), np.zeros((3, 4)))


def test_a_lighthouse_that_would_shade_itself_is_refused() -> None:
    spec = mujoco.MjSpec()
    house = spec.worldbody.add_body(name="lighthouse")
    house.add_body(name="rotor").add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0])
    model = spec.compile()
    with pytest.raises(ValueError, match="'rotor' would shade"):
        Visibility(model, pad([], []), [], model.body("lighthouse").id, Lighthouse())
