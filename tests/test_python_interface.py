"""The package from Python: what is printed of results, and scenarios that code has changed."""

import json
from pathlib import Path
from typing import Any

import pytest

import swarm
from swarm.flight.simulate import simulate
from swarm.results.parquet import column, table_of
from swarm.results.run_folder import Run, RunFolder
from swarm.scenario import checked, for_replay, load
from swarm.scenario.fleet import Swarm
from swarm.studies.campaign.study_folder import FinishedStudy

FIGURES: dict[str, Any] = {
    "craft_count": 8,
    "duration_s": 30.0,
    "swarm": {"tracking_share": 0.997, "ekf_position_rms_m": 0.000564, "ekf_attitude_rms_deg": 0.0441},
    "criteria_held": False,
}


def test_a_run_is_one_short_line_and_a_table_in_a_notebook() -> None:
    run = Run(Path("runs/<b>-7"), "complete", FIGURES)
    assert repr(run) == (
        "<Run runs/<b>-7: complete, 8 craft, 30.0 s, 100 % tracking, 0.564 mm, 0.0441 deg, criteria missed>"
    )
    page = run._repr_html_()
    assert "<caption>Run runs/&lt;b&gt;-7</caption>" in page
    assert "<tr><th>position error, RMS</th><td>0.564 mm</td></tr>" in page


@pytest.mark.parametrize("summary", [{}, {"swarm": None}, {"swarm": 3, "craft_count": "x"}])
def test_a_run_without_figures_is_one_line_too(summary: dict[str, Any]) -> None:
    assert repr(Run(Path("runs/x"), "running", summary)) == "<Run runs/x: running>"


def test_a_study_is_one_short_line() -> None:
    study = FinishedStudy(
        Path("runs/scaling"), {"status": "interrupted", "planned": 28}, table_of([column("run", [0, 1], "")])
    )
    assert repr(study) == "<Study runs/scaling: interrupted, 2 of 28 runs>"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"duration_s": -3}, "the scenario: duration_s = -3: must be at least 0.001 s"),
        ({"durations": 3}, "the scenario: durations = 3: unknown key; did you mean 'duration_s'"),
        ({"swarm": {"cuont": 3}}, "the scenario: swarm.cuont = 3: unknown key; did you mean 'count'?"),
        ({"craft": 3}, "the scenario: craft = 3: expected a list of tables"),
    ],
)
def test_a_scenario_that_code_has_changed_is_checked_before_it_flies(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(swarm.SwarmError) as caught:
        simulate(load("formation").model_copy(update=changes), out=tmp_path / "run")
    assert str(caught.value).startswith(message)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("name", ["docking", "fault-parade", "ccd-docking", "orbit"])
def test_what_was_not_changed_stays_as_it_is(name: str) -> None:
    assert checked(name) == checked(load(name)) == load(name)


def test_no_message_of_the_validator_reaches_a_user() -> None:
    scenario = load("formation")
    with pytest.raises(swarm.SwarmError, match=r"Scenario.duration_s: a scenario does not change; load it with"):
        scenario.duration_s = 3.0
    with pytest.raises(swarm.SwarmError, match=r"Scenario.duraton_s: unknown key; did you mean 'duration_s'"):
        scenario.duraton_s = 3.0
    with pytest.raises(swarm.SwarmError, match=r"Swarm: count = \"x\": expected a whole number, not a string"):
        Swarm(count="x")  # type: ignore[arg-type]
    with pytest.raises(swarm.SwarmError, match="no scenario 'formatoin'; did you mean 'formation'"):
        simulate("formatoin")


def test_report_can_be_called_and_returns_the_page(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "run") as folder:
        folder.finish({"craft_count": 0, "duration_s": 0.0, "periods": 0, "swarm": None, "craft": {}})
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["status"] == "complete"
    assert swarm.report(tmp_path / "run", tmp_path / "page.html") == tmp_path / "page.html"
    assert "Run: run" in (tmp_path / "page.html").read_text()


def test_checking_a_scenario_leaves_what_nobody_has_set_to_be_found() -> None:
    """A replay finds noise and motion in the recording, but for what its user gave: checked settings still tell it."""
    given = for_replay(Path("log00"), ["navigation.coast_limit_s=3.0"])
    again = checked(given)
    assert again == given
    assert "coast_limit_s" in again.navigation.model_fields_set
    assert again.navigation.model_fields_set == given.navigation.model_fields_set
    changed = given.model_copy(
        update={"navigation": given.navigation.model_copy(update={"acceleration_noise_m_s2": 0.7})}
    )
    assert checked(changed).navigation.acceleration_noise_m_s2 == 0.7
    assert "acceleration_noise_m_s2" in checked(changed).navigation.model_fields_set
