"""The world against closed forms, conservation laws, MuJoCo's own integration, and its messages."""

from typing import Any

import mujoco
import numpy as np
import pytest

from estimators import rotation as rot
from swarm.assets import find_model
from swarm.errors import SwarmError
from swarm.world import world as world_module
from swarm.world.assembly import assemble
from swarm.world.craft import load_craft, quiet
from swarm.world.world import CraftStart, World

LIGHTHOUSE = find_model("lighthouse")
T = 1 / 60
SITES = "".join(
    f'<site name="photodiode{i}" pos="{x} {y} 0.1"/>'
    for i, (x, y) in enumerate([(0, 0), (0.1, 0), (0, 0.1), (0.1, 0.1)])
)
BOX = '<geom type="box" size="0.1 0.1 0.1"/>'


def start(name="a", model="mockup", position=(0, 0, 3), quaternion=(1, 0, 0, 0), velocity=(0, 0, 0), rate=(0, 0, 0)):
    vectors: list[Any] = [np.array(v, dtype=float) for v in (position, quaternion, velocity, rate)]
    return CraftStart(name, find_model(model), *vectors)


def world(*starts, **options):
    return World(list(starts), LIGHTHOUSE, **options)


def coast(built, periods):
    nothing = np.zeros((len(built.names), 3))
    return [built.advance(nothing, nothing) for _ in range(periods)]


def own_model(tmp_path, body, name="own", head=""):
    path = tmp_path / f"{name}.xml"
    path.write_text(f"<mujoco>{head}<worldbody>{body}</worldbody></mujoco>")
    return path


# Motion


def spin_error_rad(steps_per_period, periods=60):
    """How far a free spin of the axisymmetric mockup ends from the closed form, after one second."""
    rate = np.array([0.5, 0.2, 1.5])
    built = world(start(rate=rate), steps_per_period=steps_per_period)
    transverse, axial = built.inertia[0, 0, 0], built.inertia[0, 2, 2]
    end = coast(built, periods)[-1]
    momentum = np.array([transverse, transverse, axial]) * rate
    # Precession about the momentum, and the body's own turn about its axis: R = Exp(L / I1 t) Exp(z (1 - I3/I1) w3 t).
    time = end.time_s[-1]
    about_axis = np.array([0, 0, (1 - axial / transverse) * rate[2] * time])
    exact = rot.exp(momentum / transverse * time) @ rot.exp(about_axis)
    return float(rot.angle_between(rot.matrix_from_quaternion(end.quaternion[-1, 0]), exact))


def test_torque_free_spin_of_a_symmetric_craft():
    """First-order integrator: the error shrinks with the step, by four from 8 to 32 steps (10 % for higher orders)."""
    coarse, fine = spin_error_rad(8), spin_error_rad(32)
    # One half step of nutation, h w^2 t / 2 = 1.3e-3 rad, is the scale of a first-order error.
    assert coarse < 1.5e-3
    assert coarse / fine == pytest.approx(4, rel=0.1)


def test_constant_force_gives_the_integrators_parabola():
    """Exact for semi-implicit Euler: p = p0 + v0 t + a t (t + h) / 2; the tolerance is rounding over 480 steps."""
    built = world(start(velocity=(0.1, 0, 0)))
    force = np.array([[0.01, -0.02, 0.03]])
    for _ in range(60):
        end = built.advance(force, np.zeros((1, 3)))
    acceleration, h = force[0] / built.mass[0], T / 8
    expected = np.array([0.1, 0, 3]) + acceleration * (1 + h) / 2
    assert np.allclose(end.position[-1, 0], expected, atol=1e-12)
    assert np.allclose(end.velocity[-1, 0], np.array([0.1, 0, 0]) + acceleration, atol=1e-12)
    assert end.time_s[-1] == pytest.approx(1.0, abs=1e-15)


def test_constant_torque_about_a_principal_axis():
    built = world(start(model="cubesat6u"))
    for _ in range(60):
        end = built.advance(np.zeros((1, 3)), np.array([[0, 0, 1e-3]]))
    assert np.allclose(end.angular_rate[-1, 0], [0, 0, 1e-3 / built.inertia[0, 2, 2]], atol=1e-12)


def test_periods_join_and_knots_are_evenly_spaced():
    first, second = coast(world(start(velocity=(0.1, 0.2, 0.3), rate=(1, 2, 3)), steps_per_period=12), 2)
    for field in ("position", "quaternion", "velocity", "angular_rate"):
        assert getattr(first, field).shape[:2] == (13, 1)
        assert np.array_equal(getattr(first, field)[-1], getattr(second, field)[0])
    assert np.allclose(np.concatenate([first.time_s, second.time_s[1:]]), np.arange(25) * T / 12, atol=1e-15)


def test_motion_between_knots_is_a_line_and_a_constant_turn():
    """The rule that sensors interpolate with, against the knots and against MuJoCo's own `mj_integratePos`."""
    built = world(start(model="cubesat6u", velocity=(0.3, -0.2, 0.1), rate=(0.8, -1.1, 0.6)))
    end = coast(built, 3)[-1]
    h = T / 8
    rotation = rot.matrix_from_quaternion(end.quaternion)[:, 0]
    # Rounding of a quaternion's product and its normalisation.
    assert np.allclose(end.position[1:], end.position[:-1] + h * end.velocity[1:], atol=1e-14)
    assert np.allclose(rotation[1:], rot.exp(h * end.angular_rate[1:, 0]) @ rotation[:-1], atol=1e-14)

    share = 0.3
    qpos = np.concatenate([end.position[4, 0], end.quaternion[4, 0]])
    qvel = np.concatenate([end.velocity[5, 0], rotation[5].T @ end.angular_rate[5, 0]])
    mujoco.mj_integratePos(built.model, qpos, qvel, share * h)
    line = (1 - share) * end.position[4, 0] + share * end.position[5, 0]
    slerp = rot.exp(share * rot.log(rotation[5] @ rotation[4].T)) @ rotation[4]
    assert np.allclose(qpos[:3], line, atol=1e-14)
    assert np.allclose(rot.matrix_from_quaternion(qpos[3:]), slerp, atol=1e-13)


def test_collision_conserves_momentum_and_is_reported():
    """Contact forces come in opposite pairs: the total stays to rounding; a bystander feels nothing."""
    built = world(
        start("left", position=(-0.3, 0.01, 3), velocity=(0.5, 0, 0)),
        start("right", "cubesat6u", position=(0.5, 0, 3), velocity=(-0.2, 0, 0)),
        start("bystander", position=(0, 1.5, 3), velocity=(0.01, 0, 0)),
    )
    before = np.array([0.4 * 0.5 - 8.6 * 0.2 + 0.4 * 0.01, 0, 0])
    truth = coast(built, 90)
    touched = np.array([t.contact for t in truth])
    assert touched[:, 0].any()
    assert np.array_equal(touched[:, 0], touched[:, 1])
    assert not touched[:, 2].any()
    assert not touched[0].any()
    after = (built.mass[:, None] * truth[-1].velocity[-1]).sum(axis=0)
    assert np.allclose(after, before, atol=1e-12)
    assert truth[-1].velocity[-1, 0, 0] < 0, "the light craft bounced off"
    assert np.array_equal(truth[-1].velocity[-1, 2], [0.01, 0, 0])


def test_a_craft_can_hit_the_lighthouse():
    truth = coast(world(start(position=(0, 0, 0.3), velocity=(0, 0, -1.0))), 30)
    assert any(t.contact[0] for t in truth)
    assert truth[-1].position[-1, 0, 2] > 0


def test_a_craft_flies_the_same_alone_and_in_company():
    """Bit for bit, without contact: MuJoCo treats free bodies independently."""
    one = start("one", "cubesat6u", velocity=(0.1, 0, 0), rate=(0.3, 0.2, 0.1))
    others = [start(f"other-{i}", position=(0.5 * i - 2, 1.5, 5), rate=(0, 1, 0)) for i in range(40)]
    alone, company = coast(world(one), 20)[-1], coast(world(*others, one), 20)[-1]
    assert np.array_equal(alone.position[:, 0], company.position[:, -1])
    assert np.array_equal(alone.quaternion[:, 0], company.quaternion[:, -1])


def test_inertial_wrench_gives_the_accelerations_that_were_asked_for(tmp_path):
    """Also where the centre of mass is off the origin: over one short period v and w grow by a T, alpha T."""
    body = f'<body><inertial pos="0.03 -0.02 0.05" mass="2" diaginertia="0.02 0.03 0.04"/>{BOX}{SITES}</body>'
    path = own_model(tmp_path, body)
    built = World(
        [
            CraftStart(
                "a", path, np.array([0, 0, 3.0]), np.array([0.8, 0.6, 0, 0]), np.zeros(3), np.array([0.3, 0.5, -0.2])
            )
        ],
        LIGHTHOUSE,
        rate_hz=6000.0,
    )
    acceleration, change = np.array([[0.1, -0.2, 0.3]]), np.array([[0.5, 0.4, -0.6]])
    truth = built.advance(*built.inertial_wrench(acceleration, change))
    t = truth.time_s[-1]
    # What is left is second order in the period: w alpha T = 1e-4 of the accelerations, and jerk terms like it.
    assert np.allclose((truth.velocity[-1] - truth.velocity[0]) / t, acceleration, atol=3e-4)
    assert np.allclose((truth.angular_rate[-1] - truth.angular_rate[0]) / t, change, atol=3e-4)


# Construction


def test_craft_are_attached_under_their_names_and_share_their_mesh():
    starts = [start(f"craft-{i}", ("mockup", "cubesat6u")[i % 2], (i % 7 - 3, i // 7 - 3, 6)) for i in range(40)]
    built = world(*starts)
    assert [built.model.body(int(b)).name for b in built.craft_bodies[:2]] == ["craft-0/mockup", "craft-1/cubesat6u"]
    assert [built.model.body(int(b)).name for b in built.craft_bodies] == [
        f"{s.name}/{('mockup', 'cubesat6u')[i % 2]}" for i, s in enumerate(starts)
    ]
    assert built.model.body(built.lighthouse_body).name == "lighthouse/lighthouse"
    assert built.model.nmesh == 1
    assert built.photodiodes.present.sum(axis=1).tolist() == [12, 20] * 20
    assert built.mass[:2].tolist() == [0.4, 8.6]
    assert built.visuals(0) is built.visuals(2)
    assert np.allclose(built.model.qpos0.reshape(-1, 7)[:, :3], [s.position for s in starts], atol=1e-12)


def test_world_without_gravity_steps_at_a_part_of_the_period():
    built = world(start(), rate_hz=50.0, steps_per_period=16)
    assert built.model.opt.timestep == pytest.approx(1 / 800)
    assert not np.any(built.model.opt.gravity)


def test_start_is_what_was_asked_for_even_if_not_normalised():
    truth = coast(world(start(quaternion=(2, 0, 0, 2), velocity=(1, 2, 3), rate=(0.1, 0.2, 0.3))), 1)[0]
    assert np.allclose(truth.quaternion[0, 0], np.array([1, 0, 0, 1]) / np.sqrt(2))
    assert np.allclose(truth.velocity[0, 0], [1, 2, 3])
    assert np.allclose(truth.angular_rate[0, 0], [0.1, 0.2, 0.3])


def test_own_model_with_and_without_a_free_joint_and_placed_anywhere_in_its_file(tmp_path):
    """The root body's frame is the body frame, whatever its pose or joint in the file."""
    bodies = [
        f"<body>{BOX}{SITES}</body>",
        f"<body><freejoint/>{BOX}{SITES}</body>",
        f'<body name="b" pos="1 2 3" euler="0 90 30"><freejoint align="true"/>{BOX}{SITES}</body>',
    ]
    paths = [own_model(tmp_path, body, f"own{i}") for i, body in enumerate(bodies)]
    q = np.array([0.6, 0, 0.8, 0])
    starts = [CraftStart(p.stem, p, np.array([i, 0, 3.0]), q, np.zeros(3), np.zeros(3)) for i, p in enumerate(paths)]
    built = World(starts, LIGHTHOUSE)
    truth = coast(built, 1)[0]
    assert np.allclose(truth.position[-1], [[0, 0, 3], [1, 0, 3], [2, 0, 3]], atol=1e-12)
    assert np.allclose(truth.quaternion[-1], q, atol=1e-12)
    assert np.allclose(built.photodiodes.point_m, built.photodiodes.point_m[0])
    assert np.allclose(built.model.qpos0.reshape(-1, 7)[:, 3:], q, atol=1e-12)


def test_parts_of_a_craft_are_fused_photodiodes_and_inertia_included(tmp_path):
    """Against MuJoCo's own kinematics and subtree mass of the file as it is written."""
    text = f"""<body name="root"><freejoint/>{BOX}<body name="arm" pos="0.3 0 0" euler="0 90 0">
        <geom name="tip" type="capsule" size="0.02 0.1"/><site name="photodiode10" pos="0 0 0.12"/>
        <body pos="0 0.1 0"><geom type="sphere" size="0.03"/><site name="photodiode9" zaxis="1 0 0"/></body></body>
        <site name="photodiode0" pos="0 0 0.1"/><site name="photodiode1" pos="0.1 0 0" zaxis="1 0 0"/></body>"""
    path = own_model(tmp_path, text)
    craft = load_craft(path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    order = [f"photodiode{i}" for i in (0, 1, 9, 10)]
    assert np.allclose(craft.point_m, [data.site(name).xpos for name in order], atol=1e-12)
    assert np.allclose(craft.normal, [data.site(name).xmat.reshape(3, 3)[:, 2] for name in order], atol=1e-12)
    assert craft.mass == pytest.approx(model.body_subtreemass[1])
    assert np.allclose(craft.com_m, data.subtree_com[1], atol=1e-12)
    # The joint-space inertia of the free joint holds the craft's inertia about the body's origin.
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    c = craft.com_m
    about_origin = craft.inertia + craft.mass * (c @ c * np.eye(3) - np.outer(c, c))
    assert np.allclose(full[3:, 3:], about_origin, rtol=1e-9, atol=1e-12)
    assert len(craft.visuals) == 3


def test_own_options_and_mesh_files_do_no_harm(tmp_path, monkeypatch):
    """Another integrator and gravity are ignored without a word; a mesh is found beside its model, not the caller."""
    folder = tmp_path / "probe"
    (folder / "parts").mkdir(parents=True)
    (folder / "parts" / "tetra.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    head = """<compiler meshdir="parts"/><option gravity="0 0 -9" integrator="RK4" timestep="0.1"/>
        <size nuser_geom="3"/>
        <asset><mesh name="tetra" file="tetra.obj" scale="0.1 0.1 0.1"/></asset>"""
    path = own_model(folder, f'<body><geom type="mesh" mesh="tetra"/>{SITES}</body>', head=head)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    spots = [
        CraftStart(f"p{i}", path, np.array([i, 0, 3.0]), np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3))
        for i in range(3)
    ]
    built = World(spots, LIGHTHOUSE)
    truth = coast(built, 1)[0]
    assert np.allclose(truth.velocity, 0, atol=1e-12)
    assert built.model.nmesh == 1
    assert not list(elsewhere.iterdir())


# Mistakes


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (f"<body>{BOX}</body>", r"own.xml: 0 photodiodes .* at least 4"),
        (
            f'<body>{BOX}<site name="photodiode0"/><site name="photodiode1"/><site name="led"/></body>',
            "own.xml: 2 photodiodes",
        ),
        (f"<body>{BOX}{SITES}</body><body>{BOX}</body>", "exactly one root body is needed, found 2"),
        ("", r"exactly one root body is needed, found 0 \(none\)"),
        (f'<body>{BOX}{SITES}<body><joint name="flap"/>{BOX}</body></body>', "joint 'flap' moves a part"),
        (f'<body><joint name="rail" type="slide"/>{BOX}{SITES}</body>', "joint 'rail' moves a part"),
        ('<body><geom type="bx"/></body>', "own.xml does not compile: .*invalid keyword: 'bx'"),
        ('<body><geom size="0"/></body>', "own.xml does not compile: .*size 0 must be positive"),
        (f"<body>{SITES}</body>", "own.xml does not compile: .*mass and inertia"),
    ],
)
def test_model_mistakes(tmp_path, body, message):
    path = own_model(tmp_path, body)
    with pytest.raises(SwarmError, match=message) as error:
        load_craft(path)
    assert str(path) in str(error.value)


def test_model_that_is_not_there(tmp_path):
    with pytest.raises(SwarmError, match=r"nowhere.xml cannot be read: No such file"):
        load_craft(tmp_path / "nowhere.xml")


def test_model_that_changed_is_read_again(tmp_path):
    path = own_model(tmp_path, f"<body>{BOX}{SITES}</body>")
    light = load_craft(path).mass
    assert load_craft(path) is load_craft(path)
    path = own_model(tmp_path, f'<body><geom type="box" size="0.1 0.1 0.2"/>{SITES}</body>')
    assert load_craft(path).mass == pytest.approx(2 * light)


def test_craft_inside_another_one():
    with pytest.raises(SwarmError, match=r"craft 'b' starts inside craft 'a': they overlap by \d+\.\d mm"):
        world(start("a"), start("c", position=(1, 0, 3)), start("b", "cubesat6u", position=(0.05, 0, 3)))


def test_craft_inside_the_lighthouse():
    with pytest.raises(SwarmError, match="craft 'a' starts inside the lighthouse"):
        world(start("a", position=(0, 0, 0.01)))


def test_overlap_is_measured():
    """Two boxes 10 mm into each other along their thinnest overlap."""
    with pytest.raises(SwarmError, match=r"overlap by 10\.0 mm"):
        world(start("a", "cubesat6u"), start("b", "cubesat6u", position=(0, 0.19, 3)))


def test_an_overlap_of_giants_says_that_lengths_are_metres(tmp_path):
    big = own_model(tmp_path, f'<body><geom type="box" size="100 100 200"/>{SITES}</body>')
    with pytest.raises(SwarmError, match=r"a model is 490 m across: lengths in MJCF are metres"):
        world(
            CraftStart("a", big, np.array([0, 0, 300.0]), np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3)),
            start("b", position=(0, 0, 300)),
        )


@pytest.mark.parametrize("geom", [BOX, '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'])
def test_one_photodiode_in_millimetres_is_refused_by_its_distance(tmp_path, geom):
    slip = '<site name="photodiode9" pos="-40 40 100.5"/>'
    with pytest.raises(SwarmError, match=r"photodiode9 is 115 m from the craft: lengths in MJCF are metres"):
        load_craft(own_model(tmp_path, f"<body>{geom}{SITES}{slip}</body>"))
    boom = '<site name="photodiode9" pos="-.4 .4 .9"/>'
    assert len(load_craft(own_model(tmp_path, f"<body>{geom}{SITES}{boom}</body>", "boom")).point_m) == 5


@pytest.mark.parametrize("name", ["a", "lighthouse"])
def test_two_of_one_name(name):
    with pytest.raises(SwarmError, match=f"two things are named '{name}'"):
        world(start("a"), start(name, position=(1, 1, 3)))


def test_instability_names_the_craft_and_the_time(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    built = world(start("good"), start("bad", position=(1, 0, 3)))
    coast(built, 2)
    with pytest.raises(SwarmError, match=r"craft 'bad': the simulation became unstable at 0\.03\d\d s"):
        built.advance(np.array([[0, 0, 0], [1e12, 0, 0]]), np.zeros((2, 3)))
    assert not list(tmp_path.iterdir()), "MuJoCo wrote its log"


def test_wrench_that_is_not_finite_names_the_craft():
    built = world(start("good"), start("bad", position=(1, 0, 3)))
    coast(built, 2)
    with pytest.raises(SwarmError, match=r"craft 'bad': force or torque is not finite at 0\.0333 s"):
        built.advance(np.zeros((2, 3)), np.array([[0, 0, 0], [0, np.nan, 0]]))


# Many craft


def test_groups_of_groups_are_attached_in_order(monkeypatch):
    """Three levels of groups of three: names, places and the shared mesh are as of one flat world."""
    monkeypatch.setattr("swarm.world.assembly.BATCH", 3)
    starts = [start(f"craft-{i}", ("mockup", "cubesat6u")[i % 2], (i % 5 - 2, i // 5 - 2, 6)) for i in range(23)]
    built = world(*starts)
    names = [built.model.body(int(body)).name for body in built.craft_bodies]
    assert names == [f"{s.name}/{s.model.stem}" for s in starts]
    assert np.array_equal(np.diff(built.craft_bodies), np.ones(22))
    assert built.craft_bodies[-1] == built.model.nbody - 1
    assert np.allclose(built.model.qpos0.reshape(-1, 7)[:, :3], [s.position for s in starts], atol=1e-12)
    assert built.model.nmesh == 1


def crowd(seed, count=14):
    """Craft of both models that fly towards their middle, where some of them hit each other."""
    rng = np.random.default_rng(seed)
    grid = np.array([(i % 3, i // 3 % 3, i // 9) for i in range(count)]) * 0.85 + [-0.85, -0.85, 3.0]
    return [
        start(
            f"c{i}",
            ("mockup", "cubesat6u")[i % 2],
            grid[i],
            rng.normal(size=4),
            -0.3 * (grid[i] - [0, 0, 3.85]) + rng.normal(0, 0.1, 3),
            rng.normal(size=3),
        )
        for i in range(count)
    ]


@pytest.mark.parametrize("seed", range(3))
def test_sparing_mujoco_the_search_for_contacts_changes_no_bit(seed, monkeypatch):
    """Against a world that looks for contacts in every period; there are some, and periods without."""
    spared = world(*crowd(seed))
    looked = []
    look = spared._look_for_contacts

    def noting(wanted):
        looked.append(wanted)
        return look(wanted)

    monkeypatch.setattr(spared, "_look_for_contacts", noting)
    always = world(*crowd(seed))
    monkeypatch.setattr(always._neighbourhood, "can_touch", lambda *_: True)
    touched = False
    for one, other in zip(coast(spared, 240), coast(always, 240), strict=True):
        for field in one._fields:
            assert np.array_equal(getattr(one, field), getattr(other, field)), field
        touched |= bool(one.contact.any())
    assert touched
    assert {True, False} == set(looked)


def test_craft_can_touch_exactly_where_their_spheres_can_meet():
    """Against all pairs in NumPy, with forces and with the lighthouse, in crowds about to touch or just not."""
    answers, changes, before = [], 0, False
    for seed in range(60):
        rng = np.random.default_rng(seed)
        built = world(start("a", "mockup"), start("b", "cubesat6u", (2, 0, 3)), start("c", "mockup", (0, 2, 3)))
        near = built._neighbourhood
        pose = np.concatenate(
            [rng.uniform(-0.6, 0.6, (3, 3)) + np.array([0, 0, 0.6]), np.tile([1.0, 0, 0, 0], (3, 1))], axis=1
        )
        rate, force = rng.normal(0, 0.5, (3, 6)), rng.normal(0, 1, (3, 3))
        # Then in small steps, where the gaps of the step before are known.
        for step in range(20):
            reach = near._radius * (1 + 1e-9)
            reach[:3] += (np.linalg.norm(rate[:, :3], axis=1) + np.linalg.norm(force, axis=1) / built.mass * T) * T
            centre = np.vstack([pose[:, :3], near._station_m])
            apart = np.linalg.norm(centre[:, None] - centre, axis=2) - reach[:, None] - reach
            expected = bool((apart[np.triu_indices(4, 1)] <= 0).any())
            assert near.can_touch(pose, rate, force, T) == expected
            pose[:, :3] += rng.normal(0, 0.02 if step % 5 else 0.1, (3, 3))
            if step == 0:
                answers.append(expected)
            changes += step > 0 and expected != before
            before = expected
    assert 10 < sum(answers) < 50
    assert changes > 50
    pose[0, 0] = np.nan
    assert near.can_touch(pose, rate, force, T), "what is not a number is MuJoCo's to find"


def test_the_spheres_hold_every_corner_of_the_craft():
    built = world(start("a", "mockup"), start("b", "cubesat6u", (2, 0, 3)))
    for i in range(2):
        points = np.concatenate([mesh.vertex for mesh, _ in built.visuals(i)])
        assert np.linalg.norm(points - built.com_m[i], axis=1).max() <= built._neighbourhood._radius[i]


def test_a_crowd_that_overlaps_is_refused_before_it_is_assembled(monkeypatch):
    sizes = []

    def counted(craft, *rest):
        sizes.append(len(craft))
        return assemble(craft, *rest)

    monkeypatch.setattr(world_module, "assemble", counted)
    crowd = [start(f"c{i}", position=(i, 0, 3)) for i in range(world_module.CROWD)]
    for place in ((5.1, 0, 3), (5, 0, 3)):
        with pytest.raises(SwarmError, match=r"craft 'late' starts inside craft 'c5': they overlap by [0-9.]+ mm"):
            world(*crowd, start("late", position=place))
    assert sizes == [2, 2]
    world(*crowd, start("late", position=(-1, 0, 3)))
    assert sizes == [2, 2, 2, 65]


def test_where_mujoco_gives_up_it_is_one_message():
    with pytest.raises(SwarmError, match=r"^MuJoCo gives up: mj_stackAlloc: out of memory, stack overflow$"), quiet():
        raise mujoco.FatalError("mj_stackAlloc: out of memory,\n  stack overflow")
