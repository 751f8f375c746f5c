"""Layouts that spare any one photodiode: the errors without it, the search, the bound, zones, scenes, refusals."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from test_layout_design import scene

from estimators.layout.design import design, objective
from estimators.layout.error import lost_errors, mixed_errors
from swarm.errors import SwarmError
from swarm.studies.design.bound import fewest
from swarm.studies.design.sight import lit
from swarm.studies.layout import judgement, prediction, search
from swarm.studies.layout.judgement import judge
from swarm.studies.layout.refusal import refuse_too_few, refuse_unsolved
from swarm.studies.layout.request import Request, task
from swarm.studies.layout.study import study
from swarm.world.hull import Mount
from swarm.world.keep_out import KeepOut

CROSS = """<mujoco><worldbody><body name="bus" pos="1 2 3" euler="0 0 90"><geom name="box" type="box" size=".1 .1 .1"/>
<site name="keepout_window" type="box" size=".02 .02 .01" pos=".05 .05 .1"/>
<body name="wing" pos="0 .3 0"><geom type="box" size=".05 .19 .002"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("rho", [0.0, 0.4, 1.0])
def test_the_error_with_one_lost_is_the_worst_of_all_sets_without_one(rho: float) -> None:
    """Against the errors of every smaller set; to the rounding of normal matrices of condition 1e6."""
    candidates, chosen = scene(300, rho=rho), np.array([0, 1, 3, 4, 6, 7, 8, 10])
    every = np.array([mixed_errors(candidates, np.delete(chosen, i)) for i in range(len(chosen))])
    expected = np.where(candidates.lit[:, chosen].T, every, 0.0).max(axis=0)
    expected[candidates.lit[:, chosen].sum(axis=1) == 0] = np.inf
    found = lost_errors(candidates, chosen)
    solvable = np.isfinite(expected)
    assert 50 < solvable.sum() < 250
    np.testing.assert_array_equal(np.isfinite(found), solvable)
    np.testing.assert_allclose(found[solvable], expected[solvable], rtol=1e-9)


def test_the_search_with_a_loss_finds_the_best_set() -> None:
    """All 220 sets of 9 among 12."""
    candidates = scene(100, 1)
    best = min(objective(candidates, np.array(chosen), 0.9, 1) for chosen in combinations(range(12), 9))
    found = design(candidates, 9, 0.9, starts=20, finalists=6, rounds=2, losses=1)[0]
    assert found.objective == pytest.approx(best, abs=1e-9)


def test_no_smaller_set_than_the_bound_says() -> None:
    """Every set of 12 places, by brute force; half photodiodes may make the bound smaller than the truth by one."""
    reached = np.random.default_rng(2).random((40, 12)) < 0.8
    reached = reached[reached.sum(axis=1) >= 5]
    enough = (
        count
        for count in range(5, 13)
        if any((reached[:, chosen].sum(axis=1) >= 5).all() for chosen in combinations(range(12), count))
    )
    least, bound = next(enough), fewest(reached, 5)
    assert bound is not None
    assert least - 1 <= bound <= least
    # A face of five places that sees alone, six times: nothing but all of them.
    assert fewest(np.kron(np.eye(6), np.ones(5)).astype(np.bool_), 5) == 30
    assert fewest(np.ones((3, 4), dtype=np.bool_), 5) is None


def test_zones_by_hand(tmp_path: Path) -> None:
    """The body frame is the root body's, wherever the file puts it."""
    (tmp_path / "cross.xml").write_text(CROSS)
    up = [[0.0, 0.0, 1.0]]
    places = {"window": (0.05, 0.05, 0.1005), "roof": (-0.05, -0.05, 0.1005), "wing": (0.0, 0.4, 0.0025)}
    mount = Mount(np.array(list(places.values())), np.repeat(up, 3, axis=0))

    def kept(*wanted: str) -> list[str]:
        free = KeepOut(tmp_path / "cross.xml", wanted).free(mount)
        return [name for name, is_free in zip(places, free, strict=True) if is_free]

    assert kept() == ["roof", "wing"]
    assert kept("wing") == ["roof"]
    assert kept("box") == ["wing"]
    assert kept("bus") == []
    assert kept("-0.06,-0.04,-0.06,0,0,0.2") == ["wing"]
    with pytest.raises(SwarmError, match=r"no body, geom or site of this name; did you mean 'wing'"):
        kept("wign")


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"SAMPLES": 600, "CANDIDATES": 40, "POSES": 400, "EXPOSING_POSES": 60}.items():
        monkeypatch.setattr(search, name, value)
    monkeypatch.setattr(judgement, "POSES", 400)
    monkeypatch.setattr(judgement, "TRIALS", 4)
    monkeypatch.setattr(prediction, "SECOND_POSES", 400)
    effort = {"starts": 20, "finalists": 3, "rounds": 1, "seed": 0, "losses": 0}
    monkeypatch.setattr("estimators.layout.design.design.__kwdefaults__", effort)


@pytest.mark.usefixtures("small")
def test_a_wish_that_cannot_be_met_is_refused_with_the_reason(tmp_path: Path) -> None:
    """A box's faces see alone face on: five on each of six. A thin plate shows no five places edge on."""
    asked = task(Request("mockup", 12))
    at = search.places(asked)
    with pytest.raises(SwarmError, match=r"--photodiodes 12: too few .* each must see 5, and .* takes \d\d or more"):
        refuse_too_few(asked, at, 12)
    least = refuse_too_few(asked, at, 60)
    assert 12 < least <= 60
    judged = judge(asked, [("designed", at.coarse.at(np.arange(12)))], [])[0]
    with pytest.raises(SwarmError, match=r"leaves \d+ % of the poses unsolvable with one .* where \d are lit and 5"):
        refuse_unsolved(asked, judged, least)
    (tmp_path / "plate.xml").write_text(
        '<mujoco><worldbody><body><geom type="box" size=".2 .2 .001"/></body></worldbody></mujoco>'
    )
    plate = task(Request(str(tmp_path / "plate.xml"), 12))
    with pytest.raises(SwarmError, match=r"no layout keeps every pose .* fewer than 5 of the hull's \d+ places"):
        refuse_too_few(plate, search.places(plate), 12)


@pytest.mark.usefixtures("small")
def test_what_is_found_spares_any_one_photodiode() -> None:
    """By dropping each one: still four lit everywhere in the cone, at poses of another sample."""
    asked = task(Request("mockup", 12, cone_deg=40.0))
    found = search.find(asked, search.places(asked), 12)
    seen = lit(asked.hull, found.mount, asked.station, asked.poses(400, 9))
    for lost in range(12):
        assert (np.delete(seen, lost, axis=1).sum(axis=1) >= 4).all()
    assert found.prediction.unsolvable_with_one_lost == 0


def test_a_scene_shades_what_stands_behind_its_neighbour() -> None:
    """The craft behind another one on the boresight is dark; alone it is lit."""
    overrides = [
        "duration_s=0.1",
        "swarm.count=0",
        'craft=[{name="far", model="mockup", motion={kind="hold", position_m=[0, 0, 3]}}, '
        '{name="near", model="mockup", motion={kind="hold", position_m=[0, 0, 1.5]}}]',
    ]
    asked = task(Request("mockup", 12, scene="static", craft="far", overrides=overrides))
    assert asked.scene is not None
    poses = asked.poses(20, 0)
    mount = asked.hull.shipped
    assert lit(asked.hull, mount, asked.station, poses).any(axis=1).all()
    assert not lit(asked.hull, mount, asked.station, poses, asked.scene).any(axis=1).all()
    assert np.linalg.norm(poses.position - [0, 0, 3], axis=1).max() <= 0.1 + 1e-9
    with pytest.raises(SwarmError, match=r"for which craft\? give --craft; those that see the light: far, near"):
        task(Request("mockup", 12, scene="static", overrides=overrides))


def test_files_that_exist_are_refused_before_the_scene_is_flown(tmp_path: Path) -> None:
    (tmp_path / "new.xml").write_text("mine")
    said: list[str] = []
    with pytest.raises(SwarmError, match=r"new\.xml.* --force"):
        study(Request("mockup", 12, scene="static"), tmp_path / "new.xml", False, said.append)
    assert said == []
    assert (tmp_path / "new.xml").read_text() == "mine"
