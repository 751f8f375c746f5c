"""Navigators and controllers of a user: the page's examples fly, and what is wrong with one is told in one message."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from swarm.cli.app import app
from swarm.cli.starter import start
from swarm.errors import SwarmError
from swarm.flight.flight import Flight
from swarm.flight.simulate import simulate
from swarm.onboard.settings import Status
from swarm.plugin_files import digest, plug_in
from swarm.results.run_folder import open_run
from swarm.scenario import Scenario, load

PAGE = (Path(__file__).parents[1] / "docs" / "plug-ins.md").read_text(encoding="utf-8")
EXAMPLES = {
    re.search(r"^class (\w+)", code, re.MULTILINE)[1]: code  # type: ignore[index]
    for code in re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
}
SCENARIO = """
seed = 3
recording = { enabled = false }
navigation = { coupling = "tight", quiet = { craft = "none" } }
[[craft]]
name = "own"
feedback = "estimate"
motion = { kind = "hold", position_m = [0, 0, 3] }
[[craft]]
name = "other"
motion = { kind = "hold", position_m = [0.3, 0, 3] }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, code in EXAMPLES.items():
        (tmp_path / f"{name.lower()}.py").write_text(code)
    (tmp_path / "mine.toml").write_text(SCENARIO)
    return tmp_path


def fly(folder: Path, duration_s: float, changes: Mapping[str, Any] | None = None, **keys: str) -> Scenario:
    every: dict[str, Any] = {"duration_s": duration_s, **(changes or {})}
    every |= {f"craft[0].{key}": str(folder / value) for key, value in keys.items()}
    return load(folder / "mine.toml", every)


def written(folder: Path, body: str) -> Path:
    (folder / "bad.py").write_text(f"import numpy as np\nfrom swarm.plugins import *\n{body}")
    return folder / "bad.py"


def test_the_page_s_filter_agrees_with_the_program_s_own_on_the_same_light(folder: Path) -> None:
    """An unscented filter on the angles, and the extended one on the same angles, differ by far less than their sigma.

    They start differently: one takes the pose and the rates for independent, the other does not.
    """
    body = EXAMPLES["Ukf"][EXAMPLES["Ukf"].index("class Ukf") :]
    assert len([line for line in body.splitlines() if line.strip()]) <= 41  # 40, and the class's own
    truth = {"craft[0].feedback": "truth"}
    usual, own = (
        [period.estimate for period in Flight(scenario).fly()]
        for scenario in (fly(folder, 0.7, truth), fly(folder, 0.7, truth, navigator="ukf.py:Ukf"))
    )
    for a, b in zip(usual[36:], own[36:], strict=True):
        sigma = np.sqrt(np.diagonal(a.covariance[0]))
        assert np.all(abs(a.position - b.position)[0] < 0.01 * sigma[6:9])
        assert np.all(abs(a.velocity - b.velocity)[0] < 0.01 * sigma[9:])
        assert np.sqrt(np.diagonal(b.covariance[0])) == pytest.approx(sigma, rel=1e-3)
        assert b.nis[0] == pytest.approx(a.nis[0], rel=1e-3)
        assert b.rows[0] == a.rows[0]
        # The craft without a navigator of its own does not know of the other's.
        assert np.array_equal(a.covariance[1], b.covariance[1])
        assert np.array_equal(a.position[1], b.position[1])


def test_a_run_keeps_the_plug_in_and_is_repeated_from_its_copy(folder: Path) -> None:
    first = simulate(fly(folder, 0.1, controller="spring.py:Spring"), out=folder / "first")
    assert (folder / "first" / "inputs" / "spring.py").read_text() == EXAMPLES["Spring"]
    head = (folder / "first" / "scenario.toml").read_text()
    assert f"\n# controller spring.py:Spring, SHA-256 {digest(folder / 'spring.py')}\n" in head
    assert '\ncontroller = "inputs/spring.py:Spring"\n' in head
    (folder / "spring.py").unlink()
    second = simulate(load(folder / "first" / "scenario.toml"), out=folder / "second")
    assert second.telemetry.equals(first.telemetry)


def test_the_page_s_controller_brings_a_craft_to_its_place_with_the_wrench_that_it_asks_for(folder: Path) -> None:
    """A spring of 1 / s^2 with a damper of 1.8 / s, from 0.2 m off: x'' = -x - 1.8 x' in closed form."""
    away = {"craft[0].feedback": "truth", "craft[0].scatter.position_m": 0.2, "craft[1].motion.position_m": [2, 0, 3]}
    flight = Flight(fly(folder, 3.0, away, controller="spring.py:Spring"))
    begin = flight.motions.at(0.0).position[0] - flight._told.position[0]
    assert np.linalg.norm(begin) > 0.1
    for period in flight.fly():
        last = period
    assert last.truth is not None
    time, damped = last.time_s, np.sqrt(1 - 0.9**2)
    left = np.exp(-0.9 * time) * (np.cos(damped * time) + 0.9 / damped * np.sin(damped * time))
    # Orders are held over a period of 1/60 s, which is a delay of half of it: 2 % of the distance at most.
    assert flight.motions.at(0.0).position[0] - last.truth.position[0] == pytest.approx(begin * left, abs=0.02 * 0.2)


def test_a_controller_keeps_off_its_neighbour_and_hears_it_one_period_later(folder: Path) -> None:
    written(
        folder,
        """
class Ear:
    def __init__(self, craft): self.heard = []
    def steer(self, now):
        self.heard.append(sorted(now.neighbours))
        if now.time_s > 0.1: raise RuntimeError(f"{self.heard}; {np.isfinite(now.covariance).all()}")
        return Wrench(np.zeros(3), np.zeros(3))
""",
    )
    with pytest.raises(SwarmError, match=r"\[\], \['other'\], \['other'\].*; True"):
        list(Flight(fly(folder, 0.5, controller="bad.py:Ear")).fly())


BELIEF = "return Belief(light.pose.rotation, light.pose.position, np.zeros(3), np.zeros(3), np.eye(12))"
NAVIGATOR = """
class Bad:
    def __init__(self, craft): pass
    def step(self, light):
        {}
"""
CONTROLLER = """
class Bad:
    def __init__(self, craft): pass
    def steer(self, now):
        {}
"""


@pytest.mark.parametrize(
    ("key", "body", "told"),
    [
        ("navigator", NAVIGATOR.format("return 1 / 0"), r"bad.py, line 7: craft 'own' at 0.008 s: ZeroDivisionError"),
        ("navigator", NAVIGATOR.format("return 3"), "must return a Belief or None, not int"),
        (
            "navigator",
            NAVIGATOR.format(f"{BELIEF}._replace(position=[1, 2])"),
            r"position .*, not \(2,\)",
        ),
        ("navigator", NAVIGATOR.format(f"{BELIEF}._replace(velocity='x')"), r"velocity .* \(3,\), not str"),
        ("navigator", NAVIGATOR.format(f"{BELIEF}._replace(rotation=np.zeros((3, 3)))"), "not a rotation"),
        ("navigator", NAVIGATOR.format(f"{BELIEF}._replace(covariance=-np.eye(12))"), "not above zero"),
        ("navigator", NAVIGATOR.format(f"{BELIEF}._replace(covariance=np.tri(12))"), "not symmetric"),
        (
            "navigator",
            NAVIGATOR.format(f"{BELIEF}._replace(covariance=np.ones((12, 12)) * 2 - np.eye(12))"),
            "not positive",
        ),
        ("navigator", NAVIGATOR.format(f"{BELIEF}._replace(freedom=0)"), "at least 1, not 0"),
        ("navigator", CONTROLLER.format("pass"), r"class Bad has no method step\(self, light\); did you mean 'steer'"),
        ("navigator", "class Bad:\n    def step(self, light): pass", r"must have __init__\(self, craft\)"),
        (
            "navigator",
            "class Bad:\n    def __init__(self, craft): craft.nope",
            "bad.py: navigator: class Bad has no method",
        ),
        ("navigator", "class Good: pass", "there is no class 'Bad' in it; known: Good"),
        ("navigator", "import", "bad.py, line 3: navigator: SyntaxError"),
        ("navigator", "import nosuchmodule", "bad.py, line 3: navigator: ModuleNotFoundError"),
        ("controller", CONTROLLER.format("raise SystemExit(3)"), "line 7: craft 'own' at 0.017 s: SystemExit: 3"),
        ("controller", CONTROLLER.format("return Wrench([1, 2], np.zeros(3))"), "force of the wrench must be numbers"),
        ("controller", CONTROLLER.format("return Wrench(np.zeros(3), np.full(3, np.nan))"), "torque .* not finite"),
        ("controller", CONTROLLER.format("pass"), r"must return Wrench\(force, torque\), not NoneType"),
    ],
)
def test_what_is_wrong_with_a_plug_in_is_one_message(folder: Path, key: str, body: str, told: str) -> None:
    written(folder, body)
    with pytest.raises(SwarmError, match=told) as raised:
        list(Flight(fly(folder, 0.1, {}, **{key: "bad.py:Bad"})).fly())
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("spring.py", r"which class of the file\? FILE.py:CLASS, such as .*spring.py:Controller"),
        ("sprin.py:Spring", "there is no file .*sprin.py; did you mean 'spring.py'"),
        ("mine.toml:Spring", "not a Python file"),
        ("my-spring", "no installed package has an entry point of this name in lighthouse_swarm.controllers"),
    ],
)
def test_a_plug_in_that_is_not_there_is_one_message(folder: Path, value: str, told: str) -> None:
    given = str(folder / value) if "." in value else value
    with pytest.raises(SwarmError, match=told):
        Flight(load(folder / "mine.toml", {"craft[0].controller": given}))


def test_a_run_that_a_plug_in_ends_is_kept_and_the_command_says_why_with_exit_code_2(folder: Path) -> None:
    written(folder, CONTROLLER.format("return Wrench(np.zeros(3), np.zeros(3) if now.time_s < 0.1 else None)"))
    (folder / "mine.toml").write_text(SCENARIO.replace('feedback = "estimate"', 'controller = "bad.py:Bad"'))
    out = CliRunner().invoke(app, ["run", str(folder / "mine.toml"), "--out", str(folder / "run")])
    assert out.exit_code == 2
    assert out.stderr.count("error: ") == 1
    assert "bad.py: craft 'own' at 0.100 s: torque of the wrench must be numbers of shape (3,)" in out.stderr
    run = open_run(folder / "run")
    assert run.status == "interrupted"
    assert run.telemetry.num_rows == 2 * 6


def test_a_navigator_that_knows_nothing_searches_and_one_that_is_restarted_is_a_new_one(folder: Path) -> None:
    written(
        folder,
        """
class Once:
    made = 0
    def __init__(self, craft): Once.made += 1
    def step(self, light):
        if light.pose is None or light.time_s < 0.1: return None
        return Belief(light.pose.rotation, light.pose.position, np.zeros(3), np.zeros(3), np.eye(12) * Once.made, False)
""",
    )
    scenario = load(
        folder / "mine.toml",
        {
            "duration_s": 0.5,
            "navigation.coupling": "auto",  # by "tight", no pose is solved while a belief is there
            "craft[0].navigator": str(folder / "bad.py:Once"),
            "fault": [{"kind": "restart", "craft": ["own"], "at_s": 0.2, "for_s": 0.1}],
        },
    )
    found = [(period.time_s, period.estimate) for period in Flight(scenario).fly()]
    status = [Status(estimate.status[0]) for _, estimate in found]
    assert status[:5] == [Status.SEARCHING] * 5
    assert all(np.isnan(estimate.position[0]).all() for time_s, estimate in found if time_s < 0.1)
    assert status[6] == Status.COASTING  # it says itself that it took no light
    assert found[6][1].covariance[0, 0, 0] == 1.0
    assert all(np.isnan(estimate.position[0]).all() for time_s, estimate in found if 0.21 < time_s < 0.3)
    assert found[-1][1].covariance[0, 0, 0] == 2.0


def test_an_entry_point_of_a_package_is_found_by_its_name(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    about = folder / "springs-1.2.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: springs\nVersion: 1.2\n")
    (about / "entry_points.txt").write_text("[lighthouse_swarm.controllers]\nmy-spring = spring:Spring\n")
    monkeypatch.syspath_prepend(folder)
    assert plug_in("controller", "my-spring").kind.__name__ == "Spring"
    with pytest.raises(SwarmError, match="did you mean 'my-spring'"):
        plug_in("controller", "my-sprin")
    scenario = load(folder / "mine.toml", {"duration_s": 0.05, "craft[0].controller": "my-spring"})
    simulate(scenario, out=folder / "run")
    head = (folder / "run" / "scenario.toml").read_text()
    assert f"# controller my-spring of springs 1.2, SHA-256 {digest(folder / 'spring.py')}\n" in head


def test_keys_that_a_navigator_of_one_s_own_cannot_serve_are_refused(folder: Path) -> None:
    for key, value in (("recording.filter", True), ("navigation.integrity.alert_position_mm", 5.0)):
        with pytest.raises(SwarmError, match=key):
            load(folder / "mine.toml", {"craft[0].navigator": str(folder / "ukf.py:Ukf"), key: value})


def test_angles_of_one_sweep_share_the_rotor_s_noise(folder: Path) -> None:
    written(
        folder,
        """
class Look:
    def __init__(self, craft): self.craft = craft
    def step(self, light):
        r = self.craft.angle_covariance(light.rows)
        (own, rotor), fan = self.craft.noise[0], light.rows.fan
        wanted = rotor**2 * (fan[:, None] == fan) + own**2 * np.eye(len(fan))
        y, h = unexplained(self.craft, light, light.pose.rotation, light.pose.position, np.zeros(3), np.zeros(3))
        raise ValueError(f"{len(fan)} {np.allclose(r, wanted, rtol=1e-12, atol=0)} {abs(y).max() < 3e-4} {h.shape}")
""",
    )
    with pytest.raises(SwarmError, match=r"24 True True \(24, 12\)"):
        list(Flight(fly(folder, 0.1, navigator="bad.py:Look")).fly())


def test_a_folder_that_starts_from_a_scenario_with_plug_ins_has_copies_of_them(folder: Path) -> None:
    text = SCENARIO.replace('feedback = "estimate"', 'controller = "spring.py:Spring"\nnavigator = "ukf.py:Ukf"')
    (folder / "mine.toml").write_text(text)
    made = start(folder / "there" / "next", folder / "mine.toml")
    assert (made.parent / "spring.py").read_text() == EXAMPLES["Spring"]
    assert load(made).craft[0].navigator == f"{made.parent / 'ukf.py'}:Ukf"
