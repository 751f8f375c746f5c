"""swarm compare: exactly the settings that differ, figures as in summary.json, honest about unlike runs."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarm.cli import app as cli
from swarm.flight.simulate import simulate
from swarm.report.comparison.comparison import Comparison
from swarm.scenario import load

CHANGES: dict[str, dict[str, Any]] = {
    "usual": {},
    "noisy": {"lighthouse.angle_noise_arcsec": 20.0, "swarm.count": 3},
    "other": {"swarm.motion.radius_m": 0.9},
}
Command = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of a fifth of a second."""
    folder = tmp_path_factory.mktemp("runs")
    for seed, (name, changes) in enumerate(CHANGES.items()):
        values: dict[str, Any] = {"duration_s": 0.2, "swarm.count": 2, **changes}
        scenario = load("formation", values, seed=max(seed, 1))
        simulate(scenario, out=folder / name, record=False)
    return folder


@pytest.fixture
def runs(flown: Path, tmp_path: Path) -> Path:
    """A copy that a test may damage."""
    return Path(shutil.copytree(flown, tmp_path / "runs"))


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], runs: Path) -> Command:
    monkeypatch.chdir(runs.parent)

    def run(*arguments: str, columns: int = 80) -> tuple[int, str, str]:
        monkeypatch.setenv("COLUMNS", str(columns))
        monkeypatch.setattr("sys.argv", ["swarm", "compare", *arguments])
        return cli.main(), *capsys.readouterr()

    return run


def changed(folder: Path, name: str, **changes: Any) -> None:
    """Change the summary of a run."""
    file = folder / name / "summary.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **changes}))


def as_replay(run: Path) -> None:
    """Make a run look like a replay: no truth, and its command in the head of the scenario."""
    summary = json.loads((run / "summary.json").read_text())
    for figures in (summary["swarm"], *summary["craft"].values()):
        figures.update({key: None for key in figures if "rms" in key or "max" in key or key == "nees"})
    (run / "summary.json").write_text(json.dumps(summary))
    (run / "scenario.toml").write_text("# swarm replay handheld\n" + (run / "scenario.toml").read_text())


def test_settings_and_figures_are_those_of_the_runs(runs: Path) -> None:
    made = Comparison([runs / "usual", runs / "noisy"])
    assert {row.key: row.values for row in made.settings} == {
        "lighthouse.angle_noise_arcsec": ("8.8", "20.0"),
        "swarm.count": ("2", "3"),
    }
    summaries = [json.loads((runs / name / "summary.json").read_text())["swarm"] for name in ("usual", "noisy")]
    row = next(row for row in made.measures if row.name == "position error, RMS")
    assert row.values == pytest.approx([1e3 * each["ekf_position_rms_m"] for each in summaries])
    assert row.ratio(1) == pytest.approx(summaries[1]["ekf_position_rms_m"] / summaries[0]["ekf_position_rms_m"])
    assert made.notes == []


def test_physics_steps_that_runs_have_chosen_are_told_where_they_differ(command: Command, runs: Path) -> None:
    chosen, other = (json.loads((runs / name / "summary.json").read_text())["physics"] for name in ("usual", "noisy"))
    assert chosen["chosen"]
    assert chosen["steps_per_period"] == other["steps_per_period"]
    changed(runs, "noisy", physics={**other, "steps_per_period": 64})
    settings = {row.key: row.values for row in Comparison([runs / "usual", runs / "noisy"]).settings}
    assert settings["physics.steps_per_period"] == (f"{chosen['steps_per_period']} (chosen)", "64 (chosen)")
    _, out, _ = command("runs/usual", "runs/noisy")
    assert re.search(r"^physics\.steps_per_period +\d+ \(chosen\) +64 \(chosen\)", out, re.MULTILINE)


@pytest.mark.parametrize("columns", [60, 80])
def test_the_table_fits_and_nothing_is_cut(command: Command, columns: int) -> None:
    code, out, err = command("runs/usual", "runs/noisy", "runs/other", columns=columns)
    assert (code, err) == (0, "")
    assert max(map(len, out.splitlines())) <= columns
    assert "…" not in out
    assert re.search(r"^lighthouse\.angle_noise_a.* 8\.8 +20\.0", out, re.MULTILINE)
    assert "B/A" in out
    assert "C/A" in out
    assert "Seeds differ" in out


def test_unlike_runs_are_told(command: Command, runs: Path) -> None:
    as_replay(runs / "other")
    changed(runs, "noisy", status="interrupted", duration_s=0.1)
    scenario = runs / "noisy" / "scenario.toml"
    scenario.write_text(
        scenario.read_text().replace('name = "formation"', 'name = "mine"').replace("numpy ", "numpy 9")
    )
    _, out, _ = command("runs/usual", "runs/noisy", "runs/other")
    told = " ".join(out.split())
    for sentence in (
        "C replays real light",
        "B is not complete",
        "A flies formation; B flies mine",
        "of different length",
        "Flown by different versions: numpy",
    ):
        assert sentence in told
    assert re.search(r"position error, RMS, mm.*–", out)


def test_models_of_one_name_are_told_apart_by_their_content(runs: Path) -> None:
    file = next((runs / "noisy" / "inputs").glob("mockup.xml"))
    file.write_text(file.read_text() + "<!-- -->\n")
    row = next(row for row in Comparison([runs / "usual", runs / "noisy"]).settings if row.key == "swarm.model")
    assert len(set(row.values)) == 2
    assert all(re.fullmatch(r"mockup\.xml \([0-9a-f]{8}\)", value or "") for value in row.values)


def test_it_is_drawn(command: Command, runs: Path) -> None:
    assert command("runs/usual", "runs/noisy", "--out", "new/made.png")[0] == 0
    assert (runs.parent / "new/made.png").read_bytes().startswith(b"\x89PNG")


def test_the_page_has_settings_and_figures(command: Command, runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Comparison, "picture", None)  # drawn above; embedded as in every report
    assert command("runs/usual", "runs/noisy", "--out", "made.html")[0] == 0
    page = (runs.parent / "made.html").read_text()
    for text in ("lighthouse.angle_noise_arcsec", "<td>20.0</td>", "position error, RMS", "B/A"):
        assert text in page.replace(' class="word"', "")


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("summary.json", "{", "summary.json"),
        ("summary.json", None, "runs/noisy is not a run"),
        ("scenario.toml", "name = ", "scenario.toml, at the end: not TOML"),
        ("telemetry.parquet", "PAR1", "cannot read the telemetry"),
    ],
)
def test_a_damaged_run_is_one_message(
    command: Command, runs: Path, file: str, content: str | None, message: str
) -> None:
    if content is None:
        (runs / "noisy" / file).unlink()
    else:
        (runs / "noisy" / file).write_text(content)
    code, _, err = command("runs/usual", "runs/noisy", "--out", "made.html")
    assert code == 2
    assert message in err
    assert err.count("\n") == 1
    assert not (runs.parent / "made.html").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("runs/usual", "at least two"),
        ("runs/usual runs/usual/summary.json", "is given twice"),
        ("runs/usual runs/nosy", "did you mean 'runs/noisy'?"),
        ("runs/usual runs/noisy --out made.doc", ".png"),
    ],
)
def test_mistakes(command: Command, arguments: str, message: str) -> None:
    code, out, err = command(*arguments.split())
    assert (code, out) == (2, "")
    assert message in err
