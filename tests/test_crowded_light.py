"""Visibility of the shipped models in crowds of 10 and 100 against MuJoCo's own ray, ray by ray; and its parts."""

import mujoco
import numpy as np
import pytest
from test_visibility import L_FACES, L_VERTICES, brute_force, unit

from estimators.arrays import Floats
from estimators.frame import Frame
from estimators.rotation import matrix_from_quaternion
from swarm.assets import find_model, models
from swarm.hardware import Photodiodes, pad
from swarm.scenario import Lighthouse
from swarm.sensors.broad_phase import Placed, cell_of, met_into, place_into, sort_into_cells
from swarm.sensors.hits import HULL, OTHER, hull_hit
from swarm.sensors.sight import Sight
from swarm.sensors.solids import read_solids
from swarm.sensors.visibility import Visibility
from swarm.world.craft import load_craft

SHAPE = mujoco.mjtGeom


VARIED = sorted(set(models()) - {"shuttle"}, key=lambda name: (name != "satellite", name))
"""The shipped models, the satellite in every crowd; without the shuttle, whose nine metres leave a crowd no light."""


def shipped_crowd(count: int, names: list[str]) -> tuple[mujoco.MjModel, Photodiodes, list[int]]:
    """`count` craft of these models in turn, in the world's model, and their layout."""
    spec = mujoco.MjSpec()
    spec.copy_during_attach = True
    spec.worldbody.add_body(name="lighthouse").add_geom(type=SHAPE.mjGEOM_SPHERE, size=[0.05, 0, 0])
    craft = [load_craft(find_model(names[i % len(names)]), passive=True) for i in range(count)]
    for i, model in enumerate(craft):
        model.spec.option = spec.option
        spec.worldbody.add_frame().attach_body(model.spec.worldbody.bodies[0], f"{i}/", "")
    compiled = spec.compile()
    bodies = [int(body) for body in compiled.jnt_bodyid]
    return compiled, pad([m.point_m for m in craft], [m.normal for m in craft]), bodies


def crowded(rng: np.random.Generator, count: int, spread_m: float, around: bool) -> tuple[Floats, Floats]:
    """Poses in a cone that is full of craft, some facing the lighthouse, some anyhow, one perhaps around its source."""
    depth = rng.uniform(0.2, 8.0, count)
    across = rng.normal(0, spread_m, (count, 2)) * depth[:, None]
    position = np.column_stack([across, depth])
    position[0] *= 0.05 if around else 1.0
    turn = unit(np.array([0.0, 0.0, 1.0, 0.0]) + 0.5 * rng.standard_normal((count, 4)))
    return position, np.where(rng.random((count, 1)) < 0.7, turn, unit(rng.standard_normal((count, 4))))


@pytest.mark.parametrize("count", [10, 100])
@pytest.mark.parametrize("names", [["mockup"], ["cubesat6u"], VARIED])
def test_equal_to_mujocos_ray_for_the_shipped_models(
    names: list[str], count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, layout, bodies = shipped_crowd(count, names)
    monkeypatch.setattr("test_visibility.bodies", lambda _model, _craft: bodies)
    station = Lighthouse()
    visibility = Visibility(model, layout, bodies, model.body("lighthouse").id, station)
    # The satellite's dish is not convex: of the shipped models it alone needs MuJoCo's own ray.
    assert (OTHER in visibility._solids.kind) == ("satellite" in names)
    rng = np.random.default_rng(count)
    seen = []
    # A hundred craft with large ones among them would leave no light at all in a narrow cone.
    for spread_m in (0.3, 0.8) if len(names) == 1 or count == 10 else (1.0, 1.7):
        for i in range(6 if count == 10 else 2):
            position, quaternion = crowded(rng, count, spread_m, around=i == 1)
            state = visibility.state(position, quaternion)
            np.testing.assert_array_equal(state, brute_force(model, layout, position, quaternion, station))
            seen.append(state[layout.present])
    share = np.bincount(np.concatenate(seen), minlength=3) / np.concatenate(seen).size
    assert share.min() > 0.003, "all three answers must be common"


def test_a_scene_that_stands_still_shades_too() -> None:
    """Geoms on bodies that no craft carries, a tilted plane among them, are in the light as the craft are."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_body(name="lighthouse")
    spec.worldbody.add_geom(type=SHAPE.mjGEOM_BOX, size=[0.1, 0.1, 0.01], pos=[0.3, 0, 1])
    spec.worldbody.add_geom(type=SHAPE.mjGEOM_PLANE, size=[1, 1, 0.1], pos=[0, -1, 0], euler=[-90, 0, 0])
    spec.worldbody.add_geom(type=SHAPE.mjGEOM_BOX, size=[0.1, 0.1, 0.01], pos=[-0.3, 0, 1], rgba=[1, 1, 1, 0])
    body = spec.worldbody.add_body(name="craft-0")
    body.add_freejoint()
    body.add_geom(type=SHAPE.mjGEOM_BOX, size=[0.02, 0.02, 0.001])
    model = spec.compile()
    layout = pad([np.array([[0.0, 0.0, -0.001]])], [np.array([[0.0, 0.0, -1.0]])])
    visibility = Visibility(model, layout, [model.body("craft-0").id], model.body("lighthouse").id, Lighthouse())
    places = np.array([[0.6, 0, 2.0], [0, 0, 2.0], [0, -2.0, 1.2], [-0.6, 0, 2.0]])
    answer = [int(visibility.state(place[None], np.array([[1.0, 0, 0, 0]]))[0, 0]) for place in places]
    expected = [
        int(brute_force(model, layout, place[None], np.array([[1.0, 0, 0, 0]]), Lighthouse())[0, 0]) for place in places
    ]
    assert answer == expected == [Sight.BLOCKED, Sight.LIT, Sight.BLOCKED, Sight.LIT]


def test_a_convex_mesh_is_its_planes_and_any_other_is_mujocos() -> None:
    model, _, bodies = shipped_crowd(1, ["mockup"])
    solids, _ = read_solids(model, bodies, model.body("lighthouse").id)
    assert solids.kind.tolist() == [HULL]
    # The half of a rhombicuboctahedron: one base, eight sides, four squares and four triangles above, one top.
    assert len(solids.plane) == 1 + 8 + 8 + 1

    spec = mujoco.MjSpec()
    spec.add_mesh(name="ell", uservert=L_VERTICES.ravel(), userface=L_FACES.ravel())
    body = spec.worldbody.add_body(name="craft-0")
    body.add_freejoint()
    body.add_geom(type=SHAPE.mjGEOM_MESH, meshname="ell")
    model = spec.compile()
    solids, geoms = read_solids(model, [1], -1)
    assert solids.kind.tolist() == [OTHER]
    assert geoms.tolist() == [0]


def test_hull_hit_is_mujocos_mesh_ray_also_from_inside() -> None:
    model, _, bodies = shipped_crowd(1, ["mockup"])
    solids, geoms = read_solids(model, bodies, model.body("lighthouse").id)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(2)
    hits = 0
    for i in range(2000):
        # Half of them start within the sphere around it.
        o = rng.standard_normal(3) * (0.03 if i % 2 else 0.3)
        d = unit(rng.standard_normal(3) * 0.05 - (o if i % 2 == 0 else 0.0))
        first = mujoco.mj_rayMesh(model, data, int(geoms[0]), o, d)
        reach = float(rng.uniform(0.01, 0.6))
        hit = hull_hit(solids.plane, 0, len(solids.plane), o, (d[0], d[1], d[2]), reach, asked=True)
        assert hit == (0 <= first < reach)
        hits += hit
    assert 500 < hits < 1900


def test_the_grid_misses_no_sphere_that_a_ray_meets() -> None:
    rng = np.random.default_rng(3)
    count, half_width = 200, float(np.tan(np.deg2rad(60)))
    position = np.column_stack([rng.uniform(-3, 3, (count, 2)), rng.uniform(-1, 4, count)])
    quaternion, shape = unit(rng.standard_normal((count, 4))), np.append(np.arange(count), -1)
    centre, radius = rng.normal(0, 0.1, (count, 3)), rng.uniform(0.01, 0.8, count)
    placed = Placed(np.tile(np.eye(3), (count + 1, 1, 1)), *(np.zeros((count + 1, 3)) for _ in range(3)))
    near = np.zeros(count, dtype=np.bool_)
    extent = np.linalg.norm(centre, axis=1) + radius
    place_into(position, quaternion, np.eye(3), np.zeros(3), extent, 20.0, shape, centre, placed, near)
    assert near.all()
    at = position + np.einsum("cij,cj->ci", matrix_from_quaternion(quaternion), centre)
    np.testing.assert_allclose(placed.centre[:-1], at, atol=1e-14)
    grid = sort_into_cells(placed, shape, np.append(radius, 0.0), 24, half_width)
    for u, v in rng.uniform(-half_width, half_width, (3000, 2)):
        ray = unit(np.array([u, v, 1.0]))
        along = np.maximum(at @ ray, 0.0)
        meets = np.flatnonzero(np.linalg.norm(at - along[:, None] * ray, axis=1) < radius)
        cell = cell_of(u, 24, half_width) * 24 + cell_of(v, 24, half_width)
        listed = grid.owner[grid.start[cell] : grid.start[cell + 1]]
        # A sphere around the origin is met by every ray; one that a ray meets only behind the origin by none.
        assert set(meets) <= set(listed.tolist())
    assert len(grid.owner) < count * 24 * 24 / 4, "the grid must tell craft apart"


def test_every_owner_that_a_ray_to_a_craft_meets_is_known_beforehand() -> None:
    rng = np.random.default_rng(4)
    count, half_width = 300, float(np.tan(np.deg2rad(60)))
    placed = Placed(np.tile(np.eye(3), (count + 1, 1, 1)), *(np.zeros((count + 1, 3)) for _ in range(3)))
    placed.centre[:] = np.column_stack([rng.uniform(-3, 3, (count + 1, 2)), rng.uniform(-1, 6, count + 1)])
    shape, radius = np.zeros(count + 1, dtype=np.int64), np.exp(rng.uniform(-4, -0.5, count + 1))
    shape[::7] = -1  # what has photodiodes, but no surface, shades nothing
    grid = sort_into_cells(placed, shape, radius, 24, half_width)
    met, listed, blockers = np.empty(count + 1, dtype=np.int64), 0, 0
    for c in range(count):
        known = met[: met_into(c, placed, grid, radius, met)].tolist()
        assert len(set(known)) == len(known)
        assert c not in known
        listed += len(known)
        for place in placed.centre[c] + radius[c] * unit(rng.standard_normal((20, 3))):
            if not np.all(np.abs(place[:2]) < half_width * place[2]):
                continue
            reach = np.linalg.norm(place)
            along = np.clip(placed.centre @ (place / reach), 0, reach)
            meets = np.linalg.norm(placed.centre - along[:, None] * place / reach, axis=1) < radius
            meets[c], meets[shape < 0] = False, False
            blockers += meets.sum()
            assert set(np.flatnonzero(meets)) <= set(known)
    assert blockers > 3000
    assert listed < count * count / 8, "few craft are in the way of one"


def test_a_crowd_that_moves_is_seen_as_if_for_the_first_time() -> None:
    """Step by step, less and more than the slack, out of the light's reach and back, and a station that moves."""
    model, layout, bodies = shipped_crowd(60, ["mockup", "cubesat6u"])
    arguments = model, layout, bodies, model.body("lighthouse").id, Lighthouse()
    visibility, rng = Visibility(*arguments), np.random.default_rng(5)
    position, quaternion = crowded(rng, 60, 0.3, around=False)
    states = []
    for step in range(40):
        position += rng.normal(0, 1e-3 if step % 8 else 0.05, position.shape)
        quaternion = unit(quaternion + 0.05 * rng.standard_normal(quaternion.shape))
        position[0] *= 100 if step == 10 else 0.01 if step == 20 else 1
        if step == 30:
            frame = Frame(matrix_from_quaternion(unit(np.array([1.0, 0.02, -0.03, 0.0]))), np.array([0.1, 0.0, -0.2]))
            visibility.move(frame)
        first = Visibility(*arguments) if step < 30 else Visibility(*arguments, frame)
        states.append(visibility.state(position, quaternion))
        np.testing.assert_array_equal(states[-1], first.state(position, quaternion))
    assert np.count_nonzero(np.diff(states, axis=0)) > 500
    assert np.bincount(np.ravel(states)).min() > 1000
