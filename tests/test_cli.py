"""The command line: help that teaches, mistakes that are one message and exit code 2, runs that end well if stopped."""

import errno
import gzip
import importlib
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import pytest
from typer.main import get_command

import swarm
from swarm.assets import models, recordings, scenarios, studies
from swarm.cli import app as cli
from swarm.cli.warm import WARMED
from swarm.errors import PlaceError
from swarm.report.run import run_page
from swarm.report.subject import Subject
from swarm.results.progress import Progress
from swarm.results.run_folder import Run, RunFolder, open_run
from swarm.scenario import Scenario, load, to_toml
from swarm.studies.papers import find
from swarm.studies.papers.catalogue import EXPERIMENTS

FIGURES: dict[str, Any] = {"status": "complete", "swarm": None, "craft": {}}
HEAVY = {
    "yaml",
    "mujoco",
    "numba",
    "numpy",
    "scipy",
    "rerun",
    "pyarrow",
    "pydantic",
    "matplotlib",
    "filterpy",
    "rich",
    "dask",
    "distributed",
    "jinja2",
    "mcap",
    "av",
    "PIL",
    "pettingzoo",
    "gymnasium",
}
ROOT = Path(__file__).parent.parent
COMMANDS = tuple(get_command(cli.app).commands)  # type: ignore[attr-defined]
"""Every command of the program."""


class Result(NamedTuple):
    """How a command ended."""

    code: int
    out: str
    err: str


Command = Callable[..., Result]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """Runs `swarm ...` in this process, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")

    def run(*arguments: str) -> Result:
        monkeypatch.setattr(sys, "argv", ["swarm", *arguments])
        code = cli.main()
        return Result(code, *capsys.readouterr())

    return run


def process(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs `swarm ...` as a process of its own, without a terminal."""
    return subprocess.run(
        [sys.executable, "-m", "swarm", *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
    )


def test_nothing_heavy_is_imported_for_help() -> None:
    """`swarm --help` answers at once because of this; a timed assertion would fail on a busy machine."""
    code = "import sys, swarm, swarm.cli.app; print(*{name.partition('.')[0] for name in sys.modules})"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert not HEAVY & set(out.split())


@pytest.mark.parametrize(
    ("words", "proposed"),
    [
        ("swarm comp", {"compare"}),
        ("swarm run rend", {"rendezvous"}),
        ("swarm study scal", {"scaling"}),
        ("swarm docs fra", {"frames-and-units"}),
        ("swarm reproduce lidar", {name for name in EXPERIMENTS if name.startswith("lidar")}),
        ("swarm view run", {"runs/orbit-3"}),
        ("swarm compare runs/a runs/o", {"runs/orbit-3"}),
        ("swarm report many", {"many"}),
        ("swarm view orb", {"orbit-3"}),
        ("swarm view many", set()),
        ("swarm check my/", set()),
        ("swarm export x --to cc", {"ccsds"}),
    ],
)
def test_the_shell_completes_words(
    command: Command, monkeypatch: pytest.MonkeyPatch, words: str, proposed: set[str]
) -> None:
    """As bash asks, which proposes files where nothing is proposed here."""
    for name, marker in (("runs/orbit-3", "summary.json"), ("many", "study.json")):
        Path(name).mkdir(parents=True)
        (Path(name) / marker).write_text("{}")
    monkeypatch.setenv("_SWARM_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    assert set(command().out.split()) == proposed


def test_help_is_the_tutorial(command: Command) -> None:
    result = command("--help")
    assert result.code == 0
    for line in ("swarm list", "swarm run formation", "swarm view runs/formation-7", "swarm check my/my.toml", "--set"):
        assert line in result.out
    for name in COMMANDS:
        assert re.search(rf"^  {name} +\w", result.out, re.MULTILINE)


@pytest.mark.parametrize("name", ["", *COMMANDS])
@pytest.mark.parametrize("columns", ["60", "80"])
def test_help_fits_and_shows_no_default_of_python(command: Command, name: str, columns: str) -> None:
    result = process(*name.split(), "--help", COLUMNS=columns)
    assert result.returncode == 0
    assert max(map(len, result.stdout.splitlines())) <= int(columns)
    assert "\x1b" not in result.stdout
    assert "None" not in result.stdout


def test_commands_that_help_shows_are_understood(command: Command) -> None:
    """Every example line of the help parses: its options exist."""
    pages = [command(*page, "--help").out for page in ([], *([name] for name in COMMANDS))]
    text = "\n".join(pages).replace("\\\n", " ")
    examples = [line.strip() for line in text.splitlines() if re.match(rf"  +swarm ({'|'.join(COMMANDS)}) ", line)]
    assert len(examples) >= 10
    for example in examples:
        words = re.split(r"  +(?=[a-z ]{8})| > ", example)[0].split()[1:]
        options = {word.partition("=")[0] for word in words if word.startswith("-")}
        assert options <= set(re.findall(r"--[a-z-]+", command(words[0], "--help").out)), example


def test_options_mean_the_same_in_every_command_that_writes_a_run(command: Command) -> None:
    def options(name: str) -> dict[str, str]:
        lines = command(name, "--help").out.partition("Options:")[2]
        return dict(re.findall(r"(--(?:out|seed|force|set)\b[^\n]*?)  +([^\n]+(?:\n {10,}[^\n]+)*)", lines))

    run, replay = options("run"), options("replay")
    assert len(run) == 4
    # The columns differ in width, and the words where a replay takes other keys, folders and seeds by default.
    assert run.keys() == replay.keys()
    differing = {name.split()[0] for name in run if run[name].split() != replay[name].split()}
    assert differing == {"--out", "--seed", "--set"}


def test_list_shows_every_scenario_and_model_on_one_line(command: Command) -> None:
    lines = command("list").out.splitlines()
    for name in [*scenarios(), *studies(), *models(), *recordings()]:
        line = next(line for line in lines if line.startswith(f"  {name} "))
        assert len(line.split()) > 3
    assert len(lines) == len(scenarios()) + len(studies()) + len(models()) + len(recordings()) + 7


def on_a_terminal(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)


@pytest.mark.parametrize("columns", [60, 80])
def test_list_is_tables_on_a_terminal_that_fit_and_lose_no_word(
    command: Command, monkeypatch: pytest.MonkeyPatch, columns: int
) -> None:
    on_a_terminal(monkeypatch, columns)
    out = re.sub(r"\x1b\[[0-9;]*m", "", command("list").out)
    assert max(map(len, out.splitlines())) <= columns
    assert "…" not in out
    words = set(out.split())
    for path in (*scenarios().values(), *studies().values()):
        assert set(tomllib.loads(path.read_text())["description"].split()) <= words
    row = next(line.split() for line in out.splitlines() if line.startswith("formation-reconfigure "))
    assert row[1:3] == (["12", "80"] if columns == 80 else ["Twelve", "craft"])


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("formation", ["Eight craft on a turning ring", "What a swarm looks like", "8: mockup", "30 s", "about 10 s"]),
        ("docking", ["sensors   lighthouse photodiodes", "exit code 1 if one does not hold", "2: servicer, berth"]),
        ("inspect-satellite", ["LiDAR", "2: inspector, satellite"]),
        ("docking-dark", ["runs       30", "docking, 95 s each", "fault[0].at_s = [10.0, 27.0, 43.0], seed"]),
        ("servicer", ["24 kg", "20 photodiodes, 12 thrusters, 3 reaction wheels", "docking port"]),
        ("handheld", ["A simulated hand-held object", "swarm replay handheld --list"]),
    ],
)
def test_list_name_tells_what_it_is_and_how_long_it_takes(command: Command, name: str, said: list[str]) -> None:
    result = command("list", name)
    assert result.code == 0
    for words in said:
        assert words in result.out
    assert max(len(line) for line in result.out.splitlines() if "/" not in line) <= 80


def test_every_name_has_its_page_and_no_other(command: Command) -> None:
    for name in (*scenarios(), *studies()):
        assert "takes " in command("list", name).out, name
    assert command("list", "formatoin").err == "error: nothing is called 'formatoin'; did you mean 'formation'?\n"


def test_the_documentation_is_at_hand(command: Command) -> None:
    assert re.search(r"^scenario +The scenario file *$", command("docs").out, re.MULTILINE)
    assert command("docs", "criteria").out == (ROOT / "docs" / "criteria.md").read_text()
    assert "did you mean 'criteria'?" in command("docs", "docs/critera.md").err


def test_the_shipped_recording_is_listed_and_replayed_by_its_name(command: Command, tmp_path: Path) -> None:
    listed = command("replay", "handheld", "--list")
    assert listed.code == 0
    assert len(re.findall(r"^WAND +1\.0 +20 +[01] +\d+ +\d+ +1\.0 to 1\d\.\d +yes", listed.out, re.MULTILINE)) == 2
    assert all(len(line) <= 80 for line in listed.out.splitlines())
    flown = command("replay", "handheld", "--no-recording", "--out", str(tmp_path / "run"))
    assert flown.code == 0
    assert "handheld.json" in flown.err
    page = run_page(Subject(open_run(tmp_path / "run")))
    assert page.commands == ["swarm replay handheld --out again"]
    assert page.subtitle.endswith("s of recorded light replayed.")
    assert len(re.findall(r"station [01]: photodiodes of a sweep agree to \d+ urad", flown.err)) == 2
    assert open_run(tmp_path / "run").summary["swarm"]["tracking_share"] > 0.98
    wrong = command("replay", "handheld2")
    assert wrong.code == 2
    assert "did you mean 'handheld'?" in wrong.err


def test_version(command: Command) -> None:
    assert command("--version").out == f"swarm {swarm.__version__}\n"


def test_check_prints_the_resolved_scenario(command: Command) -> None:
    result = command("check", "formation", "--set", "swarm.count=3", "--seed", "5")
    assert result.code == 0
    told = next(line for line in result.err.splitlines() if line.startswith("craft-0")).split()
    assert told[:6] == ["craft-0", "…", "craft-2", "0.4", "12", "0"]
    assert set(told[6:]) == {"ideal"}
    assert result.out == to_toml(load("formation", ["swarm.count=3"], 5))
    assert tomllib.loads(result.out)["swarm"]["count"] == 3


@pytest.mark.parametrize("verb", ["run", "check"])
def test_a_fault_that_comes_after_the_end_is_told(verb: str, command: Command, tmp_path: Path) -> None:
    scenario = tmp_path / "mine.toml"
    scenario.write_text(
        'duration_s = 0.1\n[swarm]\ncount = 1\n[[fault]]\nkind = "lighthouse-dark"\nat_s = 3\nfor_s = 1\n'
    )
    out = ["--out", str(tmp_path / "run")] if verb == "run" else []
    result = command(verb, str(scenario), *out)
    assert result.code == 0
    assert "note: fault[0] (lighthouse-dark) does not strike: at_s = 3 s is not before the end of the run" in result.err


@pytest.mark.parametrize("verb", [("run", "formation"), ("study", "scaling"), ("report", "runs/formation-7")])
def test_an_empty_path_is_no_folder(verb: tuple[str, str], command: Command) -> None:
    result = command(*verb, "--out", "")
    assert (result.code, result.err) == (2, "error: --out: an empty path names nothing; '.' is this folder\n")


@pytest.mark.parametrize("key", ["swam.count", "swarm.motion.foo.bar"])
def test_a_table_that_only_an_option_has_named_is_the_options_mistake(key: str, command: Command) -> None:
    result = command("run", "formation", "--set", f"{key}=1")
    assert result.code == 2
    assert result.err.startswith(f"error: --set: {key.rpartition('.')[0]}: unknown key; ")


def test_a_file_that_cannot_be_written_is_one_message(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    class Completion:
        @staticmethod
        def main(**_: object) -> None:
            raise PermissionError(errno.EACCES, "Permission denied", "/home/somebody/.bashrc")

    monkeypatch.setattr("swarm.cli.app.get_command", lambda app: Completion)
    result = command("--install-completion")
    assert (result.code, result.out, result.err) == (2, "", "error: /home/somebody/.bashrc: Permission denied\n")


FEW = """<mujoco><worldbody><body name="b"><geom size="0.1"/>
<site name="photodiode0"/><site name="photodiode1"/><site name="photodiode2"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("verb", ["run", "check"])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[swarm]\ncuont = 3", "mine.toml: swarm.cuont = 3: unknown key; did you mean 'count'?"),
        ("[swarm]\ncount = 1\n[lighthouse]\nangle_noise_deg = 1", "did you mean 'angle_noise_arcsec' (in arcsec)?"),
        (
            '[swarm]\ncount = 1\n[lighthouse]\nrange_max_m = "9 m"',
            'range_max_m = "9 m": expected a number in m, not a string',
        ),
        ("[swarm]\ncount = 1\n[lighthouse]\nrange_min_m = -2", "lighthouse.range_min_m = -2: must be at least 0 m"),
        ('[swarm]\ncount = 1\nmodel = "mokup"', "swarm.model = \"mokup\": no model 'mokup'; did you mean 'mockup'?"),
        ('[swarm]\ncount = 1\nmodel = "none.xml"', 'swarm.model = "none.xml": model file '),
        ('[swarm]\ncount = 1\nmodel = "few.xml"', "swarm.model = "),
        (
            '[swarm]\ncount = 2\nmotion = {kind = "hold", spacing_m = 0.01}',
            "swarm.motion.spacing_m = 0.01: craft 'craft-1' starts inside craft 'craft-0'",
        ),
        ("[swarm\ncount = 2", "mine.toml, line 1, column 7: not TOML: expected ']'"),
    ],
)
def test_a_mistake_is_one_message_and_exit_code_2_and_writes_nothing(
    command: Command, tmp_path: Path, verb: str, text: str, message: str
) -> None:
    (tmp_path / "mine.toml").write_text(text)
    (tmp_path / "few.xml").write_text(FEW)
    before = sorted(tmp_path.rglob("*"))
    result = command(verb, "mine.toml")
    assert result.code == 2
    assert result.out == ""
    errors = [line for line in result.err.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert message in errors[0]
    assert "mine" in errors[0]
    assert "Traceback" not in result.err
    assert sorted(tmp_path.rglob("*")) == before


def test_reproduce_lists_every_experiment_with_its_source_and_figure(command: Command) -> None:
    out = command("reproduce").out
    for name in EXPERIMENTS:
        experiment = find(name)
        assert f"swarm reproduce {name}\n  {experiment.source}, {experiment.figure}: {experiment.about}\n" in out
    assert re.search(r"about 25 min: --poses 125 --draws 1000\n  about 80 s with --quick: --poses 10 --draws 40", out)
    assert command("reproduce", "lighthouse-static", "--list").out == out


def test_reproduce_does_an_experiment_and_prints_paper_beside_ours(command: Command) -> None:
    quick = ("reproduce", "lighthouse-static", "--poses", "3", "--frames", "100", "--out", "x")
    result = command(*quick)
    assert result.code == 0
    assert re.search(r"paper +ours +target", result.out)
    assert "x/\n" in result.out
    assert Path("x/figure.svg").exists()
    assert command(*quick).code == 2
    assert command(*quick, "--force").code == 0


def test_several_mistakes_are_a_line_each(command: Command, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("sede = 1\nduration_s = -1\n[swarm]\ncount = 1")
    assert command("check", "mine.toml").err.splitlines() == [
        "error: mine.toml: sede = 1: unknown key; did you mean 'seed'?",
        "error: mine.toml: duration_s = -1: must be at least 0.001 s: a run takes time, and less than a millisecond "
        "is none",
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "formatoin"], "no scenario 'formatoin'; did you mean 'formation'?"),
        (["run", "none.toml"], "scenario file none.toml does not exist"),
        (["run", "formation", "--set", "swarm.cuont=3"], "--set: swarm.cuont = 3: unknown key; did you mean 'count'?"),
        (["run", "formation", "--set", "nonsense"], "--set: 'nonsense' is not key=value"),
        (["run", "formation", "--seed", "-1"], "--seed: seed = -1: must be at least 0"),
        (["view", "runs/none"], "runs/none is not a run"),
        (["view", "none.rrd"], "there is no recording none.rrd"),
        (["replay", "none.rec.gz", "--object", "HMD"], "none.rec.gz"),
        (["replay", "torn.rec.gz", "--object", "HMD"], "torn.rec.gz"),
        (["replay", "noise.rec", "--object", "HMD"], "noise.rec"),
        (["reproduce", "lighthouse-statc"], "no experiment 'lighthouse-statc'; did you mean 'lighthouse-static'?"),
        (["reproduce", "lighthouse-static", "--runs", "3"], "--runs: lighthouse-static has no such size; it takes"),
        (["replay", "none.rec", "--set", "swarm.count=2"], "--set: swarm.count=2: a replay takes only"),
    ],
)
def test_mistakes_on_the_command_line(command: Command, tmp_path: Path, arguments: list[str], message: str) -> None:
    (tmp_path / "torn.rec.gz").write_bytes(gzip.compress(b"0.1 HMD C 3 1000 60\n" * 1000)[:40])
    (tmp_path / "noise.rec").write_bytes(bytes(range(256)) * 10)
    result = command(*arguments)
    assert result.code == 2
    errors = [line for line in result.err.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert message in errors[0]
    assert "Traceback" not in result.err
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    "arguments",
    [["runn", "formation"], ["run"], ["run", "formation", "--sed", "3"], ["run", "formation", "--seed", "x"]],
)
def test_what_is_no_command_or_option_exits_with_2_too(command: Command, arguments: list[str]) -> None:
    result = command(*arguments)
    assert result.code == 2
    assert result.err.startswith("error: ")
    assert len(result.err.splitlines()) == 1


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("runn formation", "no command 'runn'; did you mean 'run'?"),
        ("run", "swarm run: SCENARIO is missing: a name that `swarm list` shows"),
        ("run formation --sed 3", "swarm run: no option --sed; did you mean --seed?"),
        ("run formation --duration 3", "no option --duration; did you mean --set duration_s=3?"),
        ("check formation --count=16", "no option --count; did you mean --set swarm.count=16?"),
        ("run formation --out", "--out: a value is missing"),
        ("run formation --seed x", "--seed: 'x' is not a whole number"),
        ("run formation again", "swarm run: unexpected 'again' after the last argument"),
        ("replay handheld --lighthouse=-1", "--lighthouse: '-1' must be at least 0"),
        ("calibrate x --poses ownn", "--poses: 'ownn' must be one of 'truth', 'own'; did you mean 'own'?"),
        ("layout mockup --cone-deg wide", "--cone-deg: 'wide' is not a number"),
        ("layout mockup --distance-m 2 --distance-m x --distance-m 3", "--distance-m: 'x' is not a number"),
        ("run formation --seed 1 --seed x", "--seed: 'x' is not a whole number"),
        ("run scaling", "no scenario 'scaling', but a study: swarm study scaling"),
        ("study formation", "no study 'formation', but a scenario: swarm run formation"),
        ("check handheld", "no scenario 'handheld', but a recording: swarm replay handheld"),
        ("replay mockup", "no recording 'mockup', but a craft model: a scenario names it"),
        (
            "check craft.xml",
            'craft.xml is no scenario, but a craft model: a scenario names it, as in --set swarm.model="',
        ),
        ("replay mine.toml", "mine.toml is no recording, but a .toml file: swarm run mine.toml"),
        ("run many.toml", "many.toml is no scenario, but a study: swarm study many.toml"),
        (
            "study mine.toml",
            'mine.toml is no study, but a scenario: swarm run mine.toml; a study names it, base = "mine.',
        ),
        ("run min.toml", "scenario file min.toml does not exist; did you mean 'mine.toml'?"),
        ("check run-7", "run-7 is not a scenario file but a folder; did you mean 'run-7/scenario.toml'?"),
        ("run formation --set fault={kind='ghosts'}", "fault: expected a list of tables: begin each with [[fault]]"),
        ("view run-9", "run-9 is not a run: there is no such folder; did you mean 'run-7'?"),
        ("view runs/run-9", "runs/run-9 is not a run: there is no such folder; did you mean 'run-7'?"),
        ("view many", "many is not a run: it is a study: swarm report many"),
        ("report nope", "nope is not a study or a run: there is no such folder; known: many, other-7, run-7"),
        ("report mine.toml", "mine.toml is not a study or a run: it is a file, and not in such a folder"),
    ],
)
def test_a_message_names_what_was_meant(command: Command, tmp_path: Path, line: str, message: str) -> None:
    (tmp_path / "craft.xml").write_text(FEW)
    (tmp_path / "mine.toml").write_text("[swarm]\ncount = 1\n")
    (tmp_path / "many.toml").write_text('base = "mine.toml"\n')
    for name, marker in (("run-7", "summary.json"), ("other-7", "summary.json"), ("many", "study.json")):
        (tmp_path / name).mkdir()
        (tmp_path / name / marker).write_text('{"program": "lighthouse-swarm", "status": "complete"}')
    (tmp_path / "run-7" / "scenario.toml").touch()
    result = command(*line.replace("'", '"').split())
    assert result.code == 2
    assert len(result.err.splitlines()) == 1
    assert message in result.err


def test_a_file_that_is_not_there_is_not_mistaken_for_a_scenario_of_another_name(command: Command) -> None:
    assert command("run", "missing.toml").err == "error: scenario file missing.toml does not exist\n"


def test_a_file_of_a_run_stands_for_its_folder(command: Command, tmp_path: Path) -> None:
    with RunFolder(tmp_path / "run-7") as folder:
        folder.finish(FIGURES)
    (tmp_path / "run-7" / "telemetry.parquet").touch()
    assert "run-7 has no recording" in command("view", "run-7/telemetry.parquet").err


def test_a_mistake_in_a_process_of_its_own_has_no_control_codes() -> None:
    result = process("check", "formation", "--set", "swarm.count=0")
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr.startswith("error: --set: swarm.count = 0: there is no craft at all")
    assert "\x1b" not in result.stderr


def test_a_reader_that_goes_away_is_no_error() -> None:
    """`swarm check formation | head -1`: the pipe closes before everything is written."""
    program = subprocess.Popen(
        [sys.executable, "-m", "swarm", "check", "static"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=ROOT,
    )
    assert program.stdout is not None
    assert program.stderr is not None
    program.stdout.close()
    errors = program.stderr.read()
    program.stderr.close()
    assert program.wait(60) == 128 + signal.SIGPIPE
    assert errors == b""


@pytest.fixture
def simulator(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """A stand-in for `swarm.flight.simulate`, which notes how it was called and then does what `act` says."""
    seen: dict[str, Any] = {"act": lambda: None}

    def simulate(
        scenario: Scenario, *, out: Path, force: bool, progress: Callable[[Progress], None], **more: Any
    ) -> Run:
        seen.update(more, scenario=scenario, out=out, force=force, progress=progress)
        with RunFolder.create(scenario.name, scenario.seed, out, force) as folder:
            progress(Progress(1.0, 30.0, 1, 8))
            seen["act"]()
            folder.finish(FIGURES)
        return open_run(out)

    module = ModuleType("swarm.flight.simulate")
    module.simulate = simulate  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "swarm.flight.simulate", module)
    return seen


def test_run_passes_its_options_on(command: Command, simulator: dict[str, Any]) -> None:
    assert command("run", "formation").code == 0
    assert simulator["out"] == Path("runs/formation-7")
    assert (simulator["force"], simulator["live"], simulator["record"]) == (False, False, True)
    result = command(
        "run", "static", "--seed", "4", "--out", "x", "--force", "--live", "--no-recording", "--set", "duration_s=2"
    )
    assert result.code == 0
    assert (simulator["force"], simulator["live"], simulator["record"]) == (True, True, False)
    assert simulator["out"] == Path("x")
    assert (simulator["scenario"].seed, simulator["scenario"].duration_s) == (4, 2.0)
    assert "1.0 of 30.0 s, 1 of 8 craft tracking" in result.err
    assert "x/\n" in result.out


def test_a_run_is_not_overwritten_without_force(command: Command, simulator: dict[str, Any]) -> None:
    command("run", "formation")
    result = command("run", "formation")
    assert result.code == 2
    assert "error: runs/formation-7 holds a run already; --force replaces it" in result.err
    assert command("run", "formation", "--force").code == 0


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_ctrl_c_while_the_program_is_loading_is_quiet(tmp_path: Path) -> None:
    # The module that the command line imports first sends the signal.
    (tmp_path / "typer.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\nprint('went on')")
    result = process("list", PYTHONPATH=f"{tmp_path}{os.pathsep}{ROOT}")
    assert (result.returncode, result.stdout, result.stderr) == (130, "", "")


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_ctrl_c_while_the_interpreter_ends_changes_nothing() -> None:
    # Handlers that are registered first are called last: after this one nothing of the program is left.
    code = """if True:
        import atexit, os, signal, sys
        atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))
        from swarm.__main__ import main
        sys.argv = ["swarm", "--version"]
        sys.exit(main())"""
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stderr) == (0, "")


def test_a_folder_with_a_run_is_refused_before_anything_is_built(command: Command, monkeypatch: Any) -> None:
    with RunFolder.create("static", 3) as folder:
        folder.finish({})
    monkeypatch.setattr("swarm.flight.simulate.Flight", None)
    result = command("run", "static")
    assert result.code == 2
    told = "--force replaces it, --out writes elsewhere"
    assert result.err == f"error: runs/static-3 holds a run already; {told}\n"
    with pytest.raises(swarm.SwarmError, match=r"holds a run already; .*force=True.*out=\.\.\."):
        swarm.simulate("static")


def test_a_closed_place_is_told_with_the_options_that_the_command_has(command: Command, monkeypatch: Any) -> None:
    with RunFolder.create("static", 3) as folder:
        folder.finish({})

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    closed = "no permission to write there"
    monkeypatch.setattr("swarm.cli.starter.tempfile.mkdtemp", refuse)
    said = command("new", "zz")
    assert (said.code, said.err) == (2, f"error: cannot write zz: {closed}; choose another place as NAME\n")
    monkeypatch.setattr("swarm.results.disk.refuse_closed", refuse)
    monkeypatch.setattr("swarm.results.owned_folder.refuse_closed", refuse)
    said = command("video", "runs/static-3", "x.mp4")
    assert (said.code, said.err) == (2, f"error: cannot write x.mp4: {closed}; choose another place as FILE\n")
    said = command("run", "static", "--out", "x")
    assert (said.code, said.err) == (2, f"error: cannot write x: {closed}; choose another place with --out\n")
    monkeypatch.setattr("swarm.results.smoothing.FolderLock.__init__", raising(closed))
    monkeypatch.setattr("swarm.results.smoothing._check", lambda *_: [])
    said = command("smooth", "runs/static-3")
    assert (said.code, said.err.splitlines()[-1]) == (2, f"error: {closed}")


def raising(fault: str) -> Callable[..., None]:
    """A function that finds a place closed."""

    def refuse(*_: object) -> None:
        raise PlaceError(fault)

    return refuse


def test_smooth_refuses_before_it_says_that_it_starts(command: Command) -> None:
    said = command("smooth", "runs/nothing")
    assert (said.code, said.out) == (2, "")
    assert said.err == "error: runs/nothing is not a run: there is no such folder\n"


def test_a_name_without_a_match_is_told_once_and_a_page_by_its_headings(command: Command) -> None:
    assert (
        command("docs", "docking").err
        == "error: no page 'docking'; 'docking' is a subject of: gallery, guidance, stereo\n"
    )
    listed = command("list", "qqqq").err
    assert len(re.findall(r"\bplate\b", listed)) == 1
    assert "did you mean 'static'? Or give the path of a .toml file" in command("run", "sttic").err
    text = command("replay", "--help").out
    assert "swarm.count" not in text
    assert "runs/<recording>-<seed>" in text


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_stopped_run_is_closed_says_where_it_is_and_by_its_code_what_stopped_it(
    command: Command, simulator: dict[str, Any], number: signal.Signals
) -> None:
    simulator["act"] = lambda: os.kill(os.getpid(), number)
    before = signal.getsignal(number)
    result = command("run", "formation")
    assert result.code == 128 + number
    assert "This run is not complete (stopped by the user)" in result.out
    assert "runs/formation-7/\n" in result.out
    assert open_run("runs/formation-7").status == "interrupted"
    assert "Traceback" not in result.err
    assert signal.getsignal(number) is before


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_further_signals_do_not_disturb_the_closing_of_a_run(
    command: Command, simulator: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def again(folder: RunFolder, *_: Any) -> None:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGINT):
            os.kill(os.getpid(), number)
        closed.append(folder.path)
        interrupt(folder, *_)

    closed: list[Path] = []
    interrupt = RunFolder.interrupt
    monkeypatch.setattr(RunFolder, "interrupt", again)
    simulator["act"] = lambda: os.kill(os.getpid(), signal.SIGINT)
    result = command("run", "formation")
    assert result.code == 130
    assert closed == [Path("runs/formation-7")]
    assert open_run("runs/formation-7").status == "interrupted"
    assert "This run is not complete (stopped by the user)" in result.out
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_signal_that_a_library_swallows_stops_the_run_at_its_next_period(
    command: Command, simulator: dict[str, Any]
) -> None:
    def swallow() -> None:
        with suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
        simulator["progress"](Progress(2.0, 30.0, 1, 8))

    simulator["act"] = swallow
    assert command("run", "formation").code == 130


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_under_nohup_a_run_outlives_its_terminal(command: Command, simulator: dict[str, Any]) -> None:
    simulator["act"] = lambda: os.kill(os.getpid(), signal.SIGHUP)
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert command("run", "formation").code == 0
    finally:
        signal.signal(signal.SIGHUP, before)


def test_stopped_before_anything_was_written_says_so(
    command: Command, simulator: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def early(*_: Any, **__: Any) -> Run:
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["swarm.flight.simulate"], "simulate", early)
    result = command("run", "formation")
    assert result.code == 130
    assert result.err.endswith("error: stopped by SIGINT before anything was written\n")


STOPPED = {
    "compare a b": "swarm.report.comparison.comparison.Comparison",
    "export a --to tum": "swarm.exports.export.export",
    "layout mockup": "swarm.studies.layout.study.study",
    "place mockup": "swarm.studies.placement.study.study",
    "replay handheld --list": "swarm.flight.recordings.contents.contents",
    "report a": "swarm.report.write.write_report",
    "survey a.rec": "swarm.flight.recordings.formats.format_of",
    "video a a.mp4": "swarm.exports.video.video",
}
"""Commands, and the function of each that does its work."""
BOUND = (
    "swarm.flight.recordings.object_light",
    "swarm.report.comparison.table",
    "swarm.report.comparison.write",
    "swarm.studies.survey.collect",
)
"""Modules that import one of these functions, and would keep what stands for it if they were imported meanwhile."""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(("line", "function"), STOPPED.items())
def test_every_command_that_is_stopped_says_so_in_one_line(
    command: Command, monkeypatch: pytest.MonkeyPatch, line: str, function: str, number: signal.Signals
) -> None:
    def stopped(*_: Any, **__: Any) -> None:
        try:
            os.kill(os.getpid(), number)
        finally:
            os.kill(os.getpid(), number)  # the second one comes while the first one is dealt with
        raise AssertionError("the work goes on")

    for module in BOUND:
        importlib.import_module(module)
    monkeypatch.setattr(function, stopped)
    result = command(*line.split())
    told = [said for said in result.err.splitlines() if not said.endswith("starting")]
    assert (result.code, result.out) == (128 + number, "")
    assert told == [f"error: stopped by {number.name}; no file is left half-written"]
    assert list(Path().iterdir()) == []


def test_the_package_offers_its_functions_whatever_was_imported_before() -> None:
    code = """
import swarm, sys
assert callable(swarm.load) and not set(sys.modules) & {"mujoco", "rerun"}
import swarm.flight.simulate, swarm.flight.replay
assert swarm.flight.simulate.simulate.__name__ == "simulate" and callable(swarm.simulate) and callable(swarm.replay)
from swarm.flight.simulate import simulate
assert swarm.simulate is simulate
assert dir(swarm) == sorted(swarm.__all__)
for name in ("study", "report", "replay", "reproduce", "simulate"):
    assert callable(getattr(swarm, name)), name
import swarm.report.write
assert callable(swarm.report)
try:
    swarm.simulat
except AttributeError as error:
    assert "simulat" in str(error)
"""
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_disk_under_the_output_is_one_message() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "swarm", "list"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 2
    assert done.stderr == "error: cannot print: No space left on device\n"


SHELL = pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX")


def shell(line: str, folder: Path) -> Result:
    done = subprocess.run(
        ["bash", "-c", f"{sys.executable} -m swarm {line}"],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    return Result(done.returncode, done.stdout, done.stderr)


@SHELL
@pytest.mark.parametrize(
    ("line", "code", "error"),
    [
        ("list >&-", 2, "error: cannot print: Bad file descriptor\n"),
        ("list 2>&-", 0, ""),
        ("list >&- 2>&-", 2, ""),
        ("list <&- >/dev/null", 0, ""),
        ("check none.toml 2>&-", 2, ""),
        ("check static --set name=$'\\xff'", 2, "error: argument 4: 'name=\\udcff': character 6 is not UTF-8 text\n"),
        ("check $'\\xff.toml'", 2, "error: argument 2: '\\udcff.toml': character 1 is not UTF-8 text\n"),
    ],
)
def test_closed_streams_and_bytes_that_are_no_text_end_cleanly(
    tmp_path: Path, line: str, code: int, error: str
) -> None:
    result = shell(line, tmp_path)
    assert (result.code, result.err) == (code, error)


@pytest.mark.long
@SHELL
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_run_is_complete_even_where_nothing_can_be_printed(tmp_path: Path) -> None:
    fly = "run static --set duration_s=0.1 --no-recording --force --out it"
    for ending, code in (("2>/dev/full", 0), (">/dev/full", 2), ("2>&1 | true; exit ${PIPESTATUS[0]}", 141)):
        result = shell(f"{fly} {ending}", tmp_path)
        assert result.code == code
        assert "Traceback" not in result.err
        assert open_run(tmp_path / "it").status == "complete"


@SHELL
def test_a_viewer_ends_with_everything_that_it_started(tmp_path: Path) -> None:
    """The stand-in for the viewer starts a program of its own, as rerun's does, which writes down who it is."""
    (tmp_path / "rerun_cli").mkdir()
    (tmp_path / "rerun_cli" / "__init__.py").touch()
    (tmp_path / "rerun_cli" / "__main__.py").write_text(
        "import pathlib, subprocess, sys\n"
        "inner = subprocess.Popen(['sleep', '60'])\n"
        "pathlib.Path('inner').write_text(str(inner.pid))\n"
        "sys.exit(inner.wait())\n"
    )
    (tmp_path / "it.rrd").write_bytes(b"RRF2")
    program = subprocess.Popen(
        [sys.executable, "-m", "swarm", "view", "it.rrd", "--web"],
        stdout=subprocess.DEVNULL,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"},
    )
    limit = time.monotonic() + 60
    while not ((inner := tmp_path / "inner").exists() and inner.read_text()) and time.monotonic() < limit:
        time.sleep(0.05)
    program.send_signal(signal.SIGTERM)
    number = int(inner.read_text())
    assert program.wait(30) == 128 + signal.SIGTERM
    while time.monotonic() < limit:
        # Ended, or ended and not yet collected by whoever has inherited it.
        state = Path(f"/proc/{number}/stat")
        if not state.exists() or state.read_text().rpartition(")")[2].split()[0] == "Z":
            break
        time.sleep(0.05)
    else:
        pytest.fail(f"process {number} of the viewer is still there")


def test_warm_flies_scenarios_for_a_moment_and_leaves_nothing(command: Command, tmp_path: Path) -> None:
    result = command("warm", "plate")
    assert (result.code, result.out) == (0, "Everything is compiled: plate\n")
    assert list(tmp_path.iterdir()) == []
    assert command("warm", "nonesuch").code == 2


def test_warm_takes_all_sensors_filters_and_stations() -> None:
    settings = {name: load(name, overrides) for name, overrides in WARMED.items()}
    single = [table for one in settings.values() for table in one.craft]
    assert any(table.ccd for table in single)
    assert any(table.lidar for table in single)
    assert {station.kind for one in settings.values() for station in one.station} == {"lighthouse-1", "lighthouse-2"}
    assert max(len(one.craft_names) for one in settings.values()) >= 64, "the filters of many craft in one kernel"
