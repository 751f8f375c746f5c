"""Every ray of the program against MuJoCo's `mj_ray`, one by one: LiDAR, cameras, photodiodes, places on a hull.

Not one geom is hidden from rays because it does not collide, is of a late group, or has neighbours on its body.
"""

from itertools import product
from pathlib import Path

import mujoco
import numpy as np
import pytest

from estimators.arrays import Floats
from swarm import scenario
from swarm.assets import lighthouses, models
from swarm.flight.flight import Flight
from swarm.hardware import pad
from swarm.scenario import Lighthouse
from swarm.sensors.lidar import Lidar, Mount
from swarm.sensors.sight import Sight
from swarm.sensors.visibility import THICKNESS_M, Visibility
from swarm.units import si
from swarm.world.craft import load_craft
from swarm.world.hull import Hull
from swarm.world.rays import FEW, Rays, free_joint_address
from swarm.world.surface import surface
from swarm.world.world import CraftStart, World

VISUAL = 'contype="0" conaffinity="0"'
# A bowl and a bent sheet: open surfaces. MuJoCo's triangles face both ways.
BOWL = "0 0 -.2  .3 0 0  .1 .28 .02  -.25 .17 0  -.24 -.18 .03  .1 -.29 0"
BOWL_FACES = "0 1 2  0 2 3  0 3 4  0 4 5  0 5 1"
KINDS = {
    "visual only": f"""<geom type="box" size=".1 .1 .1"/><geom type="box" size=".6 .02 .2" pos=".7 0 0" {VISUAL}/>
        <geom type="cylinder" size=".2 .02" pos="-.2 .1 .4" {VISUAL}/><geom size=".1" pos="0 -.7 0" {VISUAL}/>""",
    "nothing collides": f"""<geom type="box" size=".1 .3 .1" {VISUAL}/><geom size=".2" pos=".4 0 0" {VISUAL}/>""",
    "transparent": """<geom type="box" size=".3 .3 .3" rgba="1 1 1 0"/><geom type="box" size=".1 .1 .1"/>
        <geom size=".2" pos=".4 0 0" material="glass"/><geom size=".2" pos="-.4 0 0" material="glass" rgba="1 1 1 1"/>
        <geom size=".1" pos="0 .4 0" material="grey" rgba="1 1 1 0"/>
        <geom size=".1" pos="0 -.4 0" rgba="1 1 1 .01"/>""",
    "groups": "".join(
        f'<geom type="capsule" size=".06 .2" pos="{0.25 * (g - 2.5)} 0 {0.1 * g}" group="{g}"/>' for g in range(6)
    ),
    "visual groups": f"""<geom type="box" size=".1 .1 .1" group="3"/>
        <geom type="ellipsoid" size=".5 .1 .2" pos=".3 0 0" group="2" {VISUAL}/>
        <geom type="box" size=".3 .3 .01" pos="0 0 .4" group="5" {VISUAL}/>""",
    "open surface": f"""<geom type="mesh" mesh="bowl"/><geom type="mesh" mesh="bowl" pos=".5 0 .2" {VISUAL}/>""",
    "bodies below": f"""<geom type="box" size=".1 .1 .1"/><body pos=".5 0 0" euler="20 0 30">
        <geom type="box" size=".3 .1 .01" {VISUAL}/><body pos="0 .4 0"><geom size=".15"/></body></body>""",
}
ASSETS = f"""<asset><material name="glass" rgba="1 1 1 0"/><material name="grey" rgba=".5 .5 .5 1"/>
    <mesh name="bowl" inertia="shell" vertex="{BOWL}" face="{BOWL_FACES}"/>
    <hfield name="hill" nrow="3" ncol="3" size="1 1 .3 .1" elevation="0 1 0 1 2 1 0 1 0"/></asset>"""
STATION = f"""<body name="station" pos="0 0 -.5"><geom type="box" size=".1 .1 .1"/></body>
    <body name="ground"><geom type="plane" size="2 2 .1" pos="0 -3 0" zaxis="0 1 0"/>
    <geom type="plane" size="0 0 .1" pos="0 0 9" zaxis="0 0 -1" {VISUAL}/>
    <geom type="hfield" hfield="hill" pos="2 0 2" {VISUAL}/></body>"""


def scene_of(kind: str, copies: int) -> tuple[mujoco.MjModel, list[int]]:
    """Some free craft of one kind, with a lighthouse, two planes and a height field."""
    craft = "".join(
        f'<body name="craft-{i}"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{KINDS[kind]}</body>'
        for i in range(copies)
    )
    # Geoms of one craft may overlap, and no step is taken.
    text = f"<mujoco>{ASSETS}<worldbody>{STATION}{craft}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(text)
    return model, [model.body(f"craft-{i}").id for i in range(copies)]


def shipped_scene(name: str, copies: int) -> tuple[mujoco.MjModel, list[int]]:
    at = np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3)
    starts = [
        CraftStart(f"{name}-{i}", models()[name], np.array([0.0, 9.0 * i, 9.0]), *at, True) for i in range(copies)
    ]
    world = World(starts, lighthouses()["lighthouse"])
    return world.model, world.craft_bodies.tolist()


SCENES = [("shipped", name) for name in models()] + [("made", kind) for kind in KINDS]


def made(source: str, name: str, copies: int) -> tuple[mujoco.MjModel, list[int]]:
    return shipped_scene(name, copies) if source == "shipped" else scene_of(name, copies)


def unit(v: Floats) -> Floats:
    out: Floats = v / np.linalg.norm(v, axis=-1, keepdims=True)
    return out


def size_of(model: mujoco.MjModel, body: int) -> float:
    """The reach of a craft's surfaces from its origin [m]."""
    own = model.geom_bodyid == body
    return float((np.linalg.norm(model.geom_pos[own], axis=1) + model.geom_rbound[own]).max())


def scattered(rng: np.random.Generator, craft: int, size: float = 1.0) -> tuple[Floats, Floats]:
    """Poses of craft before the lighthouse: near, far, and on the line of sight of each other."""
    position = size * np.column_stack([rng.normal(0, 1.0, (craft, 2)), rng.uniform(1.0, 6.0, craft)])
    return position, unit(rng.standard_normal((craft, 4)))


def placed(model: mujoco.MjModel, bodies: list[int], position: Floats, quaternion: Floats) -> mujoco.MjData:
    data = mujoco.MjData(model)
    for body, p, q in zip(bodies, position, quaternion, strict=True):
        start = free_joint_address(model, body)
        data.qpos[start : start + 7] = [*p, *q]
    mujoco.mj_kinematics(model, data)
    return data


def one_by_one(
    model: mujoco.MjModel, data: mujoco.MjData, origin: Floats, direction: Floats, without: int = -1
) -> tuple[Floats, Floats, Floats]:
    """The reference: distance, geom and normal of every ray by `mj_ray` on the model as it is."""
    distance, geom, normal = np.empty(len(direction)), np.empty(len(direction)), np.zeros((len(direction), 3))
    which = np.empty(1, dtype=np.int32)
    for i, (start, ray) in enumerate(zip(np.broadcast_to(origin, direction.shape), direction, strict=True)):
        distance[i] = mujoco.mj_ray(model, data, start.copy(), ray, None, True, without, which, normal[i])
        geom[i] = which[0]
    return distance, geom, normal


@pytest.mark.parametrize(("source", "name"), SCENES)
def test_rays_are_mujocos_own(source: str, name: str) -> None:
    rng = np.random.default_rng(1)
    met = [0, 0]
    for copies, spread in product((1, 9), (0.02, 0.3, 3.0)):
        model, bodies = made(source, name, copies)
        rays = Rays(model, bodies)
        poses = scattered(rng, copies)
        rays.place(*poses)
        data = placed(model, bodies, *poses)
        for target in (poses[0][0], np.array([0.0, 0.0, 1.0])):
            # Also straight up, down and from inside a craft, where angles about z mean nothing.
            for origin in (np.zeros(3), target - [0, 0, 2.0], rng.normal(0, 2, 3) + target, target + 1e-3):
                direction = unit(unit(target - origin + 1e-9) + spread * rng.standard_normal((40, 3)))
                without = int(rng.choice([-1, 1, bodies[0]]))
                wanted = one_by_one(model, data, origin, direction, without)
                for found in (
                    rays.cast(origin, direction, without_body=without),
                    rays.cast(np.tile(origin, (40, 1)), direction, without_body=without),
                ):
                    for a, b in zip(found, wanted, strict=True):
                        np.testing.assert_array_equal(a, b)
                reach = 2.5
                near = (wanted[0] >= 0) & (wanted[0] <= reach)
                short = rays.cast(origin, direction, reach, without)
                np.testing.assert_array_equal((short.distance >= 0) & (short.distance <= reach), near)
                np.testing.assert_array_equal(short.distance[near], wanted[0][near])
                met[0] += int(np.count_nonzero(wanted[0] >= 0))
                met[1] += int(np.count_nonzero(wanted[0] < 0))
    assert met[0] > 200
    assert met[1] > 200 or source == "made"


def test_what_stands_alone_is_left_out_or_not_by_its_sphere() -> None:
    """A scene of more than FEW geoms: most are left out of a narrow batch, and nothing that is met."""
    model, bodies = scene_of("visual only", 20)
    assert model.ngeom > FEW
    rays, rng = Rays(model, bodies), np.random.default_rng(4)
    poses = scattered(rng, 20)
    rays.place(*poses)
    within = rays._within_reach(np.zeros(3), unit(np.array([[0.0, 0.0, 1.0], [0.02, 0.0, 1.0]])), 50.0)
    assert 0 < np.count_nonzero(within) < 0.7 * model.ngeom


@pytest.mark.parametrize(("source", "name"), SCENES)
def test_photodiodes_and_cameras_see_what_mujocos_rays_see(source: str, name: str) -> None:
    rng, copies = np.random.default_rng(2), 4
    model, bodies = made(source, name, copies)
    station = Lighthouse(field_deg=170.0, range_min_m=0.01, range_max_m=99.0, incidence_max_deg=89.0)
    limits, own = si(station), model.body("station" if source == "made" else 1).id
    size = size_of(model, bodies[0])
    point = rng.uniform(-size, size, (copies, 24, 3))
    layout = pad(list(point), list(unit(rng.standard_normal((copies, 24, 3)))))
    visibility = Visibility(model, layout, bodies, own, station)
    seen: list[int] = []
    for _ in range(4):
        position, quaternion = scattered(rng, copies, size)
        data = placed(model, bodies, position, quaternion)
        turn = np.array([data.xmat[body].reshape(3, 3) for body in bodies])
        p = np.einsum("cij,ckj->cki", turn, point) + position[:, None]
        n = np.einsum("cij,ckj->cki", turn, layout.normal)
        distance = np.linalg.norm(p, axis=-1)
        first = one_by_one(model, data, np.zeros(3), (p / distance[..., None]).reshape(-1, 3), own)[0].reshape(4, 24)
        inside = (np.abs(p[..., :2]) <= np.tan(limits.field_rad / 2) * p[..., 2:]).all(axis=-1)
        inside &= -np.sum(n * p, axis=-1) >= np.cos(limits.incidence_max_rad) * distance
        hidden = (first >= 0) & (first < distance - THICKNESS_M)
        wanted = np.where(inside, np.where(hidden, Sight.BLOCKED, Sight.LIT), Sight.OUTSIDE)
        np.testing.assert_array_equal(visibility.state(position, quaternion), wanted)
        seen += wanted.ravel().tolist()

        camera, ends = position[0] + size * np.array([0.0, 0.5, -1.5]), p.reshape(-1, 3)
        for through, without in ((False, -1), (True, own)):
            blocked = visibility.blocked(camera, ends, position, quaternion, through_lighthouse=through)
            far = np.linalg.norm(ends - camera, axis=1)
            hit = one_by_one(model, data, camera, (ends - camera) / far[:, None], without)[0]
            np.testing.assert_array_equal(blocked, (hit >= 0) & (hit < far - THICKNESS_M))
    assert min(seen.count(s) for s in (Sight.BLOCKED, Sight.LIT)) > 5


@pytest.mark.parametrize(("source", "name"), SCENES)
def test_a_perfect_lidar_measures_what_mujocos_rays_say(source: str, name: str) -> None:
    table = scenario.Lidar(
        target="x",
        lines=16,
        vertical_field_deg=40,
        horizontal_field_deg=60,
        resolution_deg=0.5,
        range_noise_mm=0,
        jitter_deg=0,
        dropout_probability=0,
        incidence_max_deg=90,
        range_min_m=0.01,
        range_max_m=60,
    )
    model, bodies = made(source, name, 3)
    size, rng = size_of(model, bodies[0]), np.random.default_rng(3)
    above = size * np.array([0.0, 0.0, 2.0])
    lidar = Lidar(model, bodies, [Mount(0, np.eye(3), above)], table, 0, [0])
    position = np.array([0.0, 0.0, 4.0]) + size * np.array([[0.0, 0.0, 0.0], [2.5, 0.0, 2.0], [4.0, 1.0, 2.5]])
    quaternion = np.vstack([[1.0, 0, 0, 0], unit(rng.standard_normal((2, 4)))])
    scan = lidar.still(position, quaternion)[0]
    data = placed(model, bodies, position, quaternion)
    hit, _, normal = one_by_one(model, data, position[0] + above, scan.direction)
    # The returns that fade away with incidence and range are few; none may be wrong, and none may come from nothing.
    back = np.isfinite(scan.range_m)
    np.testing.assert_allclose(scan.range_m[back], hit[back], rtol=0, atol=1e-12)
    slant = np.abs(np.sum(normal * scan.direction, axis=1))
    sure = (hit >= 0) & (hit < 30) & (slant > np.cos(np.radians(45)))
    # At 45 of 90 degrees, and at 30 m of 60, (1/2)^8 of them are lost.
    assert np.count_nonzero(sure) > 10
    assert back[sure].mean() > 0.95


def test_an_inspector_knows_all_surfaces_that_its_rays_meet(tmp_path: Path) -> None:
    """Late groups and what does not collide included, what is fully transparent left out; drawn or not."""

    def vertices(kind: str) -> int:
        path = tmp_path / "target.xml"
        text = f"<mujoco>{ASSETS}<worldbody><body>{KINDS[kind]}</body></worldbody></mujoco>"
        path.write_text(text.replace("<mujoco>", '<mujoco><compiler discardvisual="true"/>'))
        point, face = surface(path)
        assert face.max() < len(point)
        model = mujoco.MjModel.from_xml_string(text.replace("<body>", '<body name="t"><freejoint/>'))
        rng, data = np.random.default_rng(5), mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        # The surface is all that rays meet: none meets anything farther out.
        reach = np.linalg.norm(point, axis=1).max()
        start = unit(rng.standard_normal((300, 3))) * (reach + 0.01)
        across = unit(np.cross(start, rng.standard_normal((300, 3))))
        assert (one_by_one(model, data, start, across)[0] < 0).all()
        return len(face)

    assert vertices("groups") > 6 * 100
    box = 12
    assert vertices("visual groups") > 2 * box + 100
    assert vertices("open surface") == 10
    sphere = vertices("nothing collides") - box
    assert vertices("transparent") == box + 2 * sphere
    (tmp_path / "glass.xml").write_text(
        '<mujoco><worldbody><body><geom type="box" size=".1 .1 .1" rgba="1 1 1 0"/></body></worldbody></mujoco>'
    )
    with pytest.raises(Exception, match="nothing to see"):
        surface(tmp_path / "glass.xml")


def test_a_target_looks_the_same_whether_its_parts_collide_or_not(tmp_path: Path) -> None:
    """The scans of a flight, ray by ray, and the shape that they are compared with."""
    scans, known = [], []
    target = f"<mujoco><worldbody><body>{KINDS['visual only']}</body></worldbody></mujoco>"
    for name, text in (("visual", target), ("collide", target.replace(VISUAL, ""))):
        path = tmp_path / f"{name}.xml"
        path.write_text(text)
        motion = {"kind": "tumble", "position_m": [0.0, 0.0, 12.0], "angular_rate_deg_s": [20.0, 40.0, -15.0]}
        watch = {"kind": "hold", "position_m": [4.0, 0.0, 12.0], "attitude": {"facing": False, "pitch_deg": 180.0}}
        settings = scenario.validate(
            {
                "name": name,
                "duration_s": 0.3,
                "swarm": {"count": 0},
                "craft": [
                    {"name": "inspector", "model": "inspector", "lidar": {"target": "target"}, "motion": watch},
                    {"name": "target", "model": str(path), "passive": True, "motion": motion},
                ],
            },
            [],
            file=name,
            folder=tmp_path,
        )
        periods = list(Flight(settings).fly())
        scans.append([scan for period in periods for scan in period.scans])
        known.append(surface(path))
    np.testing.assert_array_equal(known[0][0], known[1][0])
    assert len(scans[0]) == len(scans[1]) > 0
    for one, other in zip(*scans, strict=True):
        np.testing.assert_equal(one, other)


def test_visual_parts_that_the_file_would_discard_stay(tmp_path: Path) -> None:
    path = tmp_path / "craft.xml"
    body = f"<body><freejoint/>{KINDS['visual only']}</body>"
    path.write_text(f'<mujoco><compiler discardvisual="true"/><worldbody>{body}</worldbody></mujoco>')
    assert len(load_craft(path, passive=True).surfaces) == 4


def test_places_on_a_hull_are_also_on_parts_that_do_not_collide(tmp_path: Path) -> None:
    path = tmp_path / "craft.xml"
    panel = f'<geom type="box" size=".3 .01 .2" pos=".5 0 0" group="4" {VISUAL}/>'
    path.write_text(f'<mujoco><worldbody><body><geom size=".1"/>{panel}</body></worldbody></mujoco>')
    mount = Hull(path).mounts(800)
    on_panel = np.abs(np.abs(mount.point_m[:, 1]) - 0.0105) < 1e-6
    assert np.count_nonzero(on_panel & (mount.point_m[:, 0] > 0.2)) > 100
