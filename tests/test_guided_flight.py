"""Guided craft in the whole simulation: they dock, latch, change formation, by their own estimates; and what is not
possible is said."""

import numpy as np
import pyarrow.compute as pc
import pytest

import swarm
from estimators.rotation import matrix_from_quaternion
from swarm.assets import find_model, models
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.hardware import docked_pose, placed
from swarm.onboard.guidance.phase import Phase
from swarm.results.columns.guidance import PHASES
from swarm.world.craft import load_craft
from swarm.world.world import CraftStart, World

NOWHERE = np.array([1.0, 0.0, 0.0, 0.0])
SHORT_DOCKING = (
    "duration_s=23",
    "craft[0].motion.from_m=[0.1, 0.4, 1.6]",
    "craft[0].motion.hold_ranges_m=[0.4]",
    "craft[0].motion.hold_s=[0.5]",
    "criteria[4].max=0.5",
)


def column(run, name, craft=None):
    table = run.telemetry if craft is None else run.telemetry.filter(pc.equal(run.telemetry["craft"], craft))
    return table[name].to_numpy()


@pytest.fixture(scope="module")
def docking(tmp_path_factory):
    out = tmp_path_factory.mktemp("docking")
    return swarm.simulate(swarm.load("docking", SHORT_DOCKING), out=out / "run", record=False)


def test_phases_have_the_names_of_the_columns():
    assert tuple(phase.name.lower() for phase in Phase if phase != Phase.NONE) == PHASES
    assert len(PHASES) == Phase.NONE


def test_a_short_docking_holds_every_criterion(docking):
    assert docking.summary["criteria_held"], docking.summary["criteria"]


def test_the_berth_has_no_sensor_and_is_no_part_of_the_swarms_figures(docking):
    craft, swarm_wide = docking.summary["craft"], docking.summary["swarm"]
    assert craft["berth"]["navigates"] is False
    assert craft["berth"]["tracking_share"] is None
    assert swarm_wide["tracking_share"] == craft["servicer"]["tracking_share"]
    assert swarm_wide["delta_v_m_s"] == craft["servicer"]["delta_v_m_s"]
    assert swarm_wide["contact_periods"] > 0


def test_docked_it_stays_on_the_port_without_thrust(docking):
    phase = column(docking, "phase", "servicer")
    after = np.flatnonzero(phase == "docked")[5:]
    assert len(after) > 60
    assert np.ptp(column(docking, "docking_range_m", "servicer")[after]) < 1e-3
    assert np.ptp(column(docking, "delta_v_m_s", "servicer")[after]) == 0
    # Of the rows before it, docked is the last phase and wait the first.
    order = [p for i, p in enumerate(phase) if i == 0 or p != phase[i - 1]]
    assert order == ["wait", "transfer", "hold", "final", "docked"]


def test_docking_columns_are_the_geometry_of_the_truth(docking):
    """At the epoch of one row in the middle of the way, by the two models' ports and the true poses."""
    k = 300
    table = docking.telemetry
    own, target = (load_craft(find_model(name)).port for name in ("servicer", "berth"))
    poses = {}
    for name in ("servicer", "berth"):
        row = table.filter(pc.equal(table["craft"], name)).slice(k, 1).to_pylist()[0]
        quaternion = np.array([row[f"true_q{a}"] for a in "wxyz"])
        poses[name] = matrix_from_quaternion(quaternion), np.array([row[f"true_p{a}_m"] for a in "xyz"]), row
    assert own is not None
    assert target is not None
    here, there = placed(own, *poses["servicer"][:2]), placed(target, *poses["berth"][:2])
    away = there.rotation.T @ (here.position - there.position)
    row = poses["servicer"][2]
    assert row["docking_range_m"] == pytest.approx(away[2], abs=1e-9)
    assert row["docking_lateral_m"] == pytest.approx(np.hypot(away[0], away[1]), abs=1e-9)
    assert poses["berth"][2]["docking_range_m"] is None
    assert poses["berth"][2]["phase"] is None


def test_a_latch_keeps_two_craft_as_they_are_and_their_momentum():
    own, target = (load_craft(models()[name]).port for name in ("servicer", "berth"))
    assert own is not None
    assert target is not None
    rotation, position = docked_pose(own, target)
    start = [
        CraftStart("berth", models()["berth"], np.array([0.0, 0, 2]), NOWHERE, np.zeros(3), np.zeros(3)),
        CraftStart(
            "servicer",
            models()["servicer"],
            position + np.array([0.001, 0, 2.004]),
            np.array([0.0, 1.0, 0.0, 0.0]),
            np.array([0.0, 0.0, -0.03]),
            np.zeros(3),
        ),
    ]
    assert np.allclose(rotation, np.diag([1.0, -1.0, -1.0]))
    world = World(start, find_model("lighthouse"), latches=[(1, 0)])
    none, latched = np.zeros((2, 3)), None
    for _ in range(60):
        truth = world.advance(none, none)
        if latched is None and truth.contact.all():
            world.latch(0)
            latched = truth.position[-1, 1] - truth.position[-1, 0]
    assert latched is not None
    total = world.mass @ truth.velocity[-1]
    assert np.allclose(total, [0, 0, -0.03 * 24], atol=1e-6)
    velocity = total / world.mass.sum()
    # MuJoCo's weld is a stiff spring: what is left of the blow dies away within its 20 ms.
    assert np.allclose(truth.velocity[-1], velocity, atol=2e-4)
    assert np.allclose(truth.position[-1, 1] - truth.position[-1, 0], latched, atol=5e-4)


@pytest.mark.long
def test_a_few_craft_change_formation_and_come_to_rest_in_their_places(tmp_path):
    changes = (
        "duration_s=14",
        "swarm.count=4",
        'swarm.motion.figures=[{at_s=0.0,shape="ring",radius_m=0.8},{at_s=1.0,shape="tetrahedron",radius_m=0.8}]',
        "swarm.motion.speed_m_s=0.25",
        "criteria[2].from_s=13",
    )
    run = swarm.simulate(swarm.load("formation-reconfigure", changes), out=tmp_path / "run", record=False)
    assert run.summary["criteria_held"], run.summary["criteria"]
    assert set(column(run, "phase")) == {"keep", "transfer"}
    corner = np.stack([column(run, f"true_p{a}_m")[-4:] for a in "xyz"], axis=1)
    edges = np.linalg.norm(corner[:, None] - corner[None], axis=2)[np.triu_indices(4, 1)]
    assert np.allclose(edges, 0.8 * np.sqrt(8 / 3), atol=0.01)
    # The filters hear of the thrust that was ordered: their promise holds in the transfer too.
    assert 4.0 < run.summary["swarm"]["nees"]["mean"] < 7.5


def test_craft_circle_a_large_target_on_thrusters_by_their_own_estimates(tmp_path):
    run = swarm.simulate(
        swarm.load("inspection", ("duration_s=4", "criteria[3].max=1.0")), out=tmp_path / "run", record=False
    )
    assert run.summary["criteria_held"], run.summary["criteria"]
    place = np.stack([column(run, f"true_p{a}_m", "craft-1") for a in "xyz"], axis=1) - [0, 0, 6.0]
    # On its circle of 2.6 m, at 4 deg/s: within what thrusters and start errors leave.
    assert np.allclose(np.linalg.norm(place[120:], axis=1), 2.6, atol=0.05)
    turned = place[120] @ place[-1] / (np.linalg.norm(place[120]) * np.linalg.norm(place[-1]))
    assert np.degrees(np.arccos(turned)) == pytest.approx(4.0 * (len(place) - 121) / 60, abs=0.5)


def test_scatter_is_drawn_per_craft_and_is_as_wide_as_it_says():
    changes = (
        "swarm.count=200",
        "swarm.scatter.position_m=0.01",
        "criteria=[]",
        "swarm.motion.figures[0].radius_m=40.0",
    )
    scenario = swarm.load("formation-reconfigure", (*changes, "lighthouse.range_max_m=100"))
    motions = builders.fleet(scenario)
    off = builders.start(scenario, motions).position - motions.start().position
    # Standard error of a standard deviation from 600 draws: 3 %.
    assert off.std() == pytest.approx(0.01, rel=0.12)
    fewer = swarm.load("formation-reconfigure", (*changes, "swarm.count=3"))
    few = builders.fleet(fewer)
    # A craft's draw does not depend on how many there are; their places do, and subtract with rounding.
    assert np.allclose(builders.start(fewer, few).position - few.start().position, off[:3], atol=1e-12)


def test_what_does_not_broadcast_is_not_heard_and_craft_without_guidance_fly_as_ever():
    flight = Flight(swarm.load("docking", SHORT_DOCKING))
    flight.period(0)
    flight.period(1)
    assert flight.pilot.guidance is not None
    heard = flight.pilot.guidance._air.heard()
    assert not heard.known[1], "the berth has no lighthouse on board, and says nothing"
    plain = Flight(swarm.load("formation"))
    assert plain.pilot.guidance is None
    assert plain.period(0).guided is None


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (("craft[0].motion.target=birth",), "did you mean 'berth'"),
        (("craft[0].motion.target=servicer",), "its own target"),
        (("craft[1].motion.kind=tumble",), "must hold its position"),
        (("craft[0].motion.hold_s=[1.0]",), r"has 1 times for 2 hold_ranges_m"),
        (("craft[0].motion.hold_ranges_m=[0.4, 1.5]",), "must come nearer"),
        (("craft[0].motion.closing_speed_m_s=0.5",), "at most speed_m_s"),
        (('pair=[{craft="servicer",to="berth"}]',), "sees no light has no estimate"),
    ],
)
def test_mistakes_in_a_docking_are_named(changes, message):
    with pytest.raises(SwarmError, match=message):
        swarm.load("docking", changes)


def test_a_model_without_a_port_cannot_be_docked_to():
    scenario = swarm.load("docking", ("craft[1].model=mockup",))
    with pytest.raises(SwarmError, match=r"motion.target = 'berth'.*mockup.xml has no docking port"):
        builders.fleet(scenario)


@pytest.mark.parametrize(
    ("figures", "message"),
    [
        ('[{at_s=1.0,shape="ring",radius_m=1.0}]', "the craft start: at 0"),
        ('[{shape="ring",radius_m=1.0},{shape="line",length_m=1.0}]', "must be later"),
        ('[{shape="ring"}]', "a ring needs it"),
        ('[{shape="line",radius_m=1.0,length_m=2.0}]', "means nothing to a line"),
        ('[{shape="projected-circle",radius_m=1.0,tilt_deg=3.0}]', "as the orbit has it"),
    ],
)
def test_mistakes_in_a_formation_are_named(figures, message):
    with pytest.raises(SwarmError, match=message):
        swarm.load("formation-reconfigure", (f"swarm.motion.figures={figures}",))


def test_figures_that_move_with_a_craft_need_a_pair_of_each_member():
    leader = 'craft=[{name="leader",motion={kind="tumble",position_m=[0.0,0.0,3.0]}}]'
    few = ("swarm.count=1", leader, "swarm.motion.about=leader")
    with pytest.raises(SwarmError, match=r"craft-0 must navigate relative to leader: add a \[\[pair\]\]"):
        swarm.load("formation-reconfigure", few)
    with pytest.raises(SwarmError, match="did you mean 'leader'"):
        swarm.load("formation-reconfigure", (*few[:2], "swarm.motion.about=leadr"))
    paired = swarm.load("formation-reconfigure", (*few, 'pair=[{craft="craft-0",to="leader"}]'))
    flight = Flight(paired)
    start = builders.fleet(paired).start().position
    for frame in range(8):
        period = flight.period(frame)
    # The first figure turns meanwhile by less than its members move in eight periods.
    assert period.guided is not None
    assert period.guided.reference_m[0] == pytest.approx(start[0], abs=0.05)


def test_a_projected_circle_needs_an_orbit():
    scenario = swarm.load("formation-reconfigure", ('swarm.motion.figures=[{shape="projected-circle",radius_m=1.0}]',))
    with pytest.raises(SwarmError, match=r"projected-circle.*\[orbit\]"):
        builders.fleet(scenario)
