"""swarm new: what it writes can be checked and flown as it is, and nothing is overwritten."""

from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from swarm.assets import scenarios
from swarm.cli import app as cli
from swarm.cli.starter import start
from swarm.errors import SwarmError
from swarm.flight.simulate import simulate
from swarm.scenario import load
from swarm.tables import say
from swarm.world.craft import load_craft

Command = Callable[..., tuple[int, str, str]]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["swarm", *arguments])
        return cli.main(), *capsys.readouterr()

    return run


def values(table: Any, path: str = "") -> dict[str, Any]:
    """Return all values of a scenario's tables by their keys."""
    if isinstance(table, dict):
        return {k: v for key, inner in table.items() for k, v in values(inner, f"{path}.{key}").items()}
    if isinstance(table, list | tuple):
        return {k: v for i, inner in enumerate(table) for k, v in values(inner, f"{path}[{i}]").items()}
    return {path: table}


def test_a_new_folder_is_ready(command: Command, tmp_path: Path) -> None:
    code, out, _ = command("new", "probe")
    assert code == 0
    assert {file.name for file in (tmp_path / "probe").iterdir()} == {"README.md", "craft.xml", "probe.toml"}
    assert "swarm check probe/probe.toml" in out
    assert command("check", "probe/probe.toml")[0] == 0
    readme = (tmp_path / "probe" / "README.md").read_text()
    assert "runs/probe-1" in readme
    assert not {"NAME", "SEED", "FILES", "CRAFT", "MODEL"} & set(readme.replace("`", " ").replace("-", " ").split())
    run = simulate(load("probe/probe.toml", {"duration_s": 1.2}), out="flown", record=False)
    assert run.summary["criteria_held"] is True


@pytest.mark.parametrize("name", scenarios())
def test_it_starts_from_every_shipped_scenario(name: str, tmp_path: Path) -> None:
    made = load(start(tmp_path / "mine", name))
    before, after = (values(one.model_dump()) for one in (load(name), made))
    assert {key for key in before if before[key] != after.get(key)} <= {".name"} | {k for k in before if ".model" in k}
    for key, value in after.items():
        counted = key != ".swarm.model" or made.swarm.count
        if key.endswith(".model") and "lighthouse" not in key and counted:
            assert Path(value).is_relative_to(tmp_path / "mine" / "models")
            load_craft(Path(value), passive=True)


def test_it_starts_from_an_own_scenario_with_models_elsewhere(tmp_path: Path) -> None:
    first = start(tmp_path / "first")
    text = first.read_text().replace('model = "craft.xml" ', "").replace("\nduration", '\nname = "old"\nduration')
    first.write_text(text + '\n[[craft]]\nname = "x"\nmodel = "craft.xml"\nmotion = { kind = "hold" }\n')
    made = load(start(tmp_path / "second", first))
    assert made.name == "second"
    assert Path(made.swarm.model).name == "mockup.xml"
    assert Path(made.craft[0].model).read_text() == (tmp_path / "first" / "craft.xml").read_text()


def test_nothing_is_overwritten(command: Command, tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "mine.txt").write_text("mine")
    (tmp_path / "file").write_text("mine")
    for name in ("taken", "file"):
        code, out, err = command("new", name)
        assert (code, out) == (2, "")
        assert f"{name} is there already" in err
    assert sorted(file.name for file in tmp_path.rglob("*")) == ["file", "mine.txt", "taken"]


@pytest.mark.parametrize(
    ("name", "source", "message"),
    [
        ("a b", None, "such as 'a-b'"),
        ("..", None, "cannot be the name"),
        ("x", "frmation", "did you mean 'formation'"),
        ("x", "scaling", "a study"),
    ],
)
def test_mistakes_leave_nothing(name: str, source: str | None, message: str, tmp_path: Path) -> None:
    with pytest.raises(SwarmError, match=message):
        start(f"{tmp_path}/{name}", source)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["", "."])
def test_a_name_that_is_missing_is_told_so(name: str, command: Command) -> None:
    told = "the new folder has no name: its last part names the scenario, as in `swarm new probe`"
    assert command("new", name) == (2, "", f"error: {told}\n")


@pytest.mark.parametrize("terminal", [True, False])
def test_a_long_message_is_broken_at_a_terminal_alone(terminal: bool) -> None:
    console = Console(file=StringIO(), width=60, force_terminal=terminal, color_system=None)
    words = ["formation", "rendezvous", "crossing"] * 10
    say(console, " ".join(words))
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert [word for line in lines for word in line.split()] == words
    assert (max(map(len, lines)) <= 60) == terminal
    assert (len(lines) == 1) != terminal
