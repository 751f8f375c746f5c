"""What a scenario makes of each craft: authority by hand and by brute force, and the warnings."""

import re
from pathlib import Path

import numpy as np
import pytest

from swarm.flight.craft_facts import authority, facts, out_of_light
from swarm.flight.flight import Flight
from swarm.scenario import load

THRUSTERS = (
    (".1 .05 0", "1 0 0"),
    (".1 -.05 0", "1 0 0"),
    ("-.1 .05 0", "-1 0 0"),
    ("-.1 -.05 0", "-1 0 0"),
    ("0 .1 .05", "0 1 0"),
    ("0 .1 -.05", "0 1 0"),
    ("0 -.1 .05", "0 -1 0"),
    ("0 -.1 -.05", "0 -1 0"),
    (".05 0 .1", "0 0 1"),
    ("-.05 0 .1", "0 0 1"),
    (".05 0 -.1", "0 0 -1"),
    ("-.05 0 -.1", "0 0 -1"),
)


def craft(folder: Path, force_n: float) -> Path:
    """A cube of 20 kg with pairs of thrusters, a port and five photodiodes."""
    sites = "".join(
        f'<site name="thruster{i}" pos="{at}" zaxis="{out}"/>' for i, (at, out) in enumerate(THRUSTERS)
    ) + "".join(f'<site name="photodiode{i}" pos="{0.01 * i * i} {0.02 * i} .1005"/>' for i in range(5))
    path = folder / "cube.xml"
    path.write_text(
        f'<mujoco><custom><numeric name="thruster_force_n" data="{force_n}"/>'
        '<numeric name="thruster_minimum_impulse_mns" data="1"/></custom><worldbody><body name="cube">'
        '<inertial pos="0 0 0" mass="20" diaginertia="1 1 1"/><geom type="box" size=".1 .1 .1"/>'
        f'<site name="port" pos="0 0 .1"/>{sites}</body></worldbody></mujoco>'
    )
    return path


def test_guidance_that_asks_for_more_than_there_is(tmp_path: Path) -> None:
    """Two thrusters of 0.105 N along each axis move 20 kg by 0.0105 m/s^2; as a couple 0.05 m apart they turn it."""
    settings = load("docking", [f"craft[0].model={craft(tmp_path, 0.105)}", "craft[0].motion.brake_m_s2=0.0105"])
    servicer, berth = facts(settings, Flight(settings))
    assert servicer.acceleration_m_s2 is not None
    np.testing.assert_allclose(servicer.acceleration_m_s2, 0.0105, rtol=1e-9)
    # One thruster of a face and the opposite one of the other: about each axis, four of them can.
    assert servicer.torque_nm is not None
    np.testing.assert_allclose(servicer.torque_nm, 2 * 0.105 * 0.05, rtol=1e-9)
    assert (servicer.mass_kg, servicer.photodiodes, servicer.cameras) == (20.0, 5, 0)
    assert list(servicer.warnings()) == [
        "servicer: 5 photodiodes; with fewer than 6, one lost may end its navigation",
        "servicer: 0.0105 m/s^2 available along x, 0.02 planned (motion.acceleration_m_s2)",
    ]
    assert berth.force_n is None
    assert list(berth.warnings()) == []


def test_authority_is_what_no_mix_of_outputs_exceeds() -> None:
    """Every pure force of random outputs lies within it, and it needs no torque."""
    rng = np.random.default_rng(3)
    effect = rng.standard_normal((6, 14))
    force, torque = authority(effect, 3)
    null = np.linalg.svd(np.delete(effect, 0, axis=0))[2][5:]
    outputs = rng.standard_normal((20000, len(null))) @ null
    # Scaled to the bounds: thrusters 0 to 1, wheels -1 to 1.
    outputs = outputs[(outputs[:, :11] >= 0).all(axis=1)]
    outputs /= np.maximum(outputs[:, :11].max(axis=1), np.abs(outputs[:, 11:]).max(axis=1))[:, None]
    reached = outputs @ effect[0]
    assert len(reached) > 3
    strongest = min(reached.max(), -reached.min())
    assert force[0] >= strongest - 1e-9
    assert force.min() >= 0
    assert torque.min() >= 0


def test_craft_of_one_table_are_told_together_and_their_motion_is_looked_at() -> None:
    """A ring of radius r that turns at w accelerates by w^2 r; without actuators nothing limits it."""
    changes = ["swarm.count=3", "swarm.motion.radius_m=1.2", "swarm.motion.rate_deg_s=6"]
    ideal = load("formation", changes)
    (alike,) = facts(ideal, Flight(ideal))
    assert (alike.names, alike.planned) == (("craft-0", "craft-1", "craft-2"), {})
    settings = load("formation", [*changes, "swarm.model=cubesat12u"])
    (alike,) = facts(settings, Flight(settings))
    assert alike.names == ("craft-0", "craft-1", "craft-2")
    (planned,) = alike.planned.values()
    assert planned == pytest.approx(1.2 * np.radians(6.0) ** 2, rel=1e-6)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ((), None),
        (
            ("swarm.motion.radius_m=1000",),
            r"craft-0 and 7 more: the start, 1000 m .* range \(range_max_m = 20\), as is its whole path: it will",
        ),
        (("swarm.motion.radius_m=1", "lighthouse.field_deg=1"), r"outside its field \(field_deg = 1\)"),
        (("lighthouse.range_min_m=10",), r"outside its range \(range_min_m = 10\)"),
    ],
)
def test_craft_that_begin_out_of_the_light_are_named(changes: tuple[str, ...], told: str | None) -> None:
    settings = load("formation", [*changes, "duration_s=1"])
    found = out_of_light(settings, Flight(settings))
    if told is None:
        assert found == []
    else:
        assert re.search(told, " ".join(found))


def test_photodiodes_in_the_hull_or_looking_into_it_are_told(tmp_path: Path) -> None:
    """One lies 1.5 mm deep, one 0.5 mm, one looks down from above the hull, one down from below it."""
    sites = ("0 0 .0985", "0 0 1"), (".02 0 .0995", "0 0 1"), ("0 .02 .1005", "0 0 -1"), ("0 .02 -.1005", "0 0 -1")
    told = "".join(f'<site name="photodiode{i}" pos="{at}" zaxis="{out}"/>' for i, (at, out) in enumerate(sites))
    path = tmp_path / "box.xml"
    path.write_text(
        '<mujoco><worldbody><body name="box"><geom type="box" size=".1 .1 .1" mass="1"/>'
        f"{told}</body></worldbody></mujoco>"
    )
    settings = load("static", [f"swarm.model={path}", "swarm.count=2", "craft=[]"])
    (known,) = facts(settings, Flight(settings))
    assert (known.covered, known.photodiodes) == (2, 4)
    assert any("2 of 4 photodiodes never see light" in warning for warning in known.warnings())
