"""What a run's end looks like: a table that fits the terminal, and sentences that say what it means."""

import io
import os
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rich.cells import cell_len
from rich.console import Console

from estimators.kernel import Compilation
from swarm import load, simulate
from swarm.cli.progress import COMPILING, ProgressDisplay
from swarm.report.findings import findings, meaning, warnings
from swarm.report.run_table import ATTITUDE_ERROR, _cells, print_report
from swarm.report.sections import smoothed
from swarm.report.study_table import print_study
from swarm.results.parquet import column, table_of
from swarm.results.progress import Progress
from swarm.studies.campaign.conduct import StudyProgress
from swarm.studies.campaign.study_folder import FinishedStudy
from swarm.studies.campaign.task import COMPLETE
from swarm.tables import wide_console

ROOT = Path(__file__).resolve().parents[1]


def consistency(mean: float) -> dict[str, Any]:
    return {
        "mean": mean,
        "band_low": 5.1,
        "band_high": 6.9,
        "inside_band": 5.1 < mean < 6.9,
        "samples": 1800,
        "effective_samples": 130.2,
        "effective_craft": 1.0,
        "correlation_time_s": 0.2,
    }


def figures(draw: random.Random, replay: bool = False) -> dict[str, Any]:
    """As `swarm.results.summary` writes them, with errors of a usual size."""
    out: dict[str, Any] = {
        "samples": 1800,
        "tracking_share": draw.uniform(0.9, 1),
        "mean_visible": 5.3,
        "solved_share": 0.99,
        "solved_share_with_5_photodiodes": 0.98,
        "residual_median_rad": 4e-5,
        "mean_iterations": 3.2,
        "mean_adop_deg_per_rad": draw.uniform(600, 2200),
        "mean_pdop_m_per_rad": draw.uniform(10, 70),
        "ekf_to_pnp_position_ratio": None if replay else 0.45,
        "ekf_to_pnp_attitude_ratio": None if replay else 0.51,
        "nees": None if replay else consistency(draw.uniform(5, 7.4)),
        "nis": None if replay else consistency(6.0),
        "pnp_motion_bias": None if replay else bias(0.0),
    }
    for source, share in (("pnp", 1.0), ("ekf", 0.5)):
        for what, most in (("rms", 1), ("max", 3)):
            out[f"{source}_position_{what}_m"] = None if replay else share * most * draw.uniform(0.0017, 0.0025)
            out[f"{source}_attitude_{what}_deg"] = None if replay else share * most * draw.uniform(0.07, 0.1)
    if replay:
        out |= {"peer_samples": 300, "peer_position_scatter_mm": 3.1, "peer_attitude_scatter_deg": 0.32}
    return out


def bias(slope_s: float) -> dict[str, Any]:
    return {
        "position_slope_s": [-slope_s, slope_s, None],
        "position_slope_sigma_s": [1e-4, 1e-4, None],
        "position_rms_m": 0.0012,
        "along_velocity_m": 0.0,
        "attitude_slope_s": [1e-5, 0.0, None],
        "attitude_slope_sigma_s": [1e-4, 1e-4, None],
        "attitude_rms_deg": 0.02,
    }


def summary(craft: int, replay: bool = False, **more: Any) -> dict[str, Any]:
    draw = random.Random(1)
    names = ["HMD"] if replay else [f"craft-{i}" for i in range(craft)]
    swarm = figures(draw, replay)
    return {
        "status": "complete",
        "periods": 1800,
        "duration_s": 30.0,
        "craft_count": craft,
        "swarm": swarm,
        "craft": {name: figures(draw, replay) for name in names},
        **more,
    }


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    run = Path("runs/formation-7")
    run.mkdir(parents=True)
    for name in ("telemetry.parquet", "summary.json", "scenario.toml", "recording.rrd"):
        (run / name).touch()
    return run


def printed(content: dict[str, Any], folder: Path, width: int, **options: Any) -> list[str]:
    out = io.StringIO()
    print_report(Console(file=out, width=width, **options), content, folder)
    return out.getvalue().splitlines()


@pytest.mark.parametrize("width", [40, 60, 80, 120, 200])
@pytest.mark.parametrize("replay", [False, True])
def test_it_fits_the_terminal_and_no_figure_is_cut(folder: Path, width: int, replay: bool) -> None:
    lines = printed(summary(1 if replay else 8, replay), folder, width)
    assert max(map(cell_len, lines)) <= width
    assert not any("…" in line for line in lines)
    rows = [line for line in lines if line.startswith(("craft-", "HMD", "swarm  "))]
    assert len(rows) == (1 if replay else 9)
    assert len({len(row.split()) for row in rows}) == 1


def test_what_a_narrow_terminal_leaves_out_is_named(folder: Path) -> None:
    wide, narrow = (" ".join(" ".join(printed(summary(8), folder, width)).split()) for width in (200, 60))
    assert "No room" not in wide
    told = narrow[narrow.index("No room in 60 columns for: ") :].partition(" (summary.json has them).")[0]
    assert "95 % band" in told
    assert "tracking" not in told


def test_the_table_has_what_the_issue_asks_for_at_80_columns(folder: Path) -> None:
    text = "\n".join(printed(summary(8), folder, 80))
    for head in ("tracking", "position, mm", "attitude, °", "RMS / max", "ADOP", "PDOP", "NEES", "band"):
        assert head in text, head
    assert "5.10–6.90" in text


def test_figures_are_the_summarys_in_the_units_of_the_head(folder: Path) -> None:
    content = summary(2)
    row = next(line for line in printed(content, folder, 200) if line.startswith("craft-1")).split()
    told = content["craft"]["craft-1"]
    expected = [
        100 * told["tracking_share"],
        1000 * told["ekf_position_rms_m"],
        1000 * told["ekf_position_max_m"],
        told["ekf_attitude_rms_deg"],
        told["ekf_attitude_max_deg"],
        1000 * told["pnp_position_rms_m"],
        1000 * told["pnp_position_max_m"],
        told["pnp_attitude_rms_deg"],
        told["pnp_attitude_max_deg"],
        told["mean_adop_deg_per_rad"],
        told["mean_pdop_m_per_rad"],
        told["nees"]["mean"],
    ]
    shown = [float(cell) for cell in row[1:-1] if cell != "/"]
    # At least two significant digits are shown, three of a column's largest figure.
    assert shown == pytest.approx(expected, rel=0.05)


def test_of_many_craft_the_worst_are_shown(folder: Path) -> None:
    content = summary(40)
    content["craft"]["craft-23"]["tracking_share"] = 0.1
    lines = printed(content, folder, 80)
    rows = [line for line in lines if line.startswith("craft-")]
    assert len(rows) == 8
    assert rows[0].startswith("craft-23")
    assert any(line.startswith("swarm ") for line in lines)
    assert "The 8 worst of 40 craft; summary.json has them all." in lines


def test_a_craft_that_never_found_itself_has_no_figures_and_is_the_worst(folder: Path) -> None:
    content = summary(17)
    lost = content["craft"]["craft-3"]
    content["craft"]["craft-3"] = {key: 0.0 if key == "tracking_share" else None for key in lost}
    rows = [line.split() for line in printed(content, folder, 80) if line.startswith("craft-")]
    assert rows[0] == ["craft-3", "0.0", *6 * ["–"]]


def test_consistency_is_said_with_its_band() -> None:
    inside, outside = dict(figures(random.Random(0)), nees=consistency(6.2)), dict(figures(random.Random(0)))
    outside["nees"] = consistency(7.3)
    assert findings(inside)[0] == (
        "NEES 6.20: as the filter promises (6 is exact, chance 5.10 to 6.90)",
        "green",
    )
    # Beyond chance, but errors within a tenth of the promise: nothing to act on.
    for small, said in ((7.2, "10 % larger"), (5.05, "8 % smaller")):
        outside["nees"] = consistency(small)
        told = f"errors {said} than the filter promises: nothing to act on"
        assert findings(outside)[0] == (
            f"NEES {small:.2f}: {told} (6 is exact, chance 5.10 to 6.90)",
            "green",
        )
    outside["nees"] = consistency(13.5)
    larger = "NEES 13.50: errors 50 % larger than the filter promises: it expects less"
    assert findings(outside)[0][0].startswith(larger)
    assert "acceleration_noise_m_s2" in findings(outside)[0][0]
    assert findings(outside)[0][1] == "yellow"
    outside["nees"] = consistency(3.84)
    assert findings(outside)[0][0].startswith("NEES 3.84: errors 20 % smaller than the filter promises: it is cautious")
    assert findings(outside)[0][1] == ""


def test_it_is_said_how_many_periods_the_figures_of_poses_leave_out(folder: Path) -> None:
    told = (
        "Navigated by single sweeps, with fewer than four photodiodes, in 75 % of the periods: "
        "PnP, ADOP and PDOP are those of the periods with a pose"
    )
    content = summary(1)
    content["swarm"]["single_sweeps_share"] = 0.75
    lines = printed(content, folder, 160)
    assert lines.index(told) + 1 == next(i for i, line in enumerate(lines) if line.startswith("Filter error over raw"))
    for share, said in ((0.0, 0), (0.0099, 0), (0.01, 1), (None, 0)):
        found = findings(dict(figures(random.Random(0)), single_sweeps_share=share))
        assert sum(text.startswith("Navigated by single sweeps") for text, _ in found) == said


def test_what_single_craft_suffer_is_not_hidden_by_the_swarm() -> None:
    good = figures(random.Random(0))
    craft = {
        "calm": dict(good, nees=consistency(5.0), refused_share=0.0),
        "sharp": dict(good, nees=consistency(12.0), refused_share=0.07),
        "dark": dict(good, mean_visible=0.0, nees=None, refused_share=None),
    }
    said = [sentence for sentence, _ in warnings(craft)]
    assert len(said) == 3
    assert said[0].startswith("dark never saw light")
    assert said[1].startswith("The filter refused 7 % of sharp's poses")
    assert said[2] == "Errors larger than the filter promises: sharp"
    assert warnings({"calm": craft["calm"]}) == []
    one = dict(good, tracking_share=0.0, mean_visible=2.31, nees=None)
    craft = {"calm": good, "one": one, "other": one | {"mean_visible": 1.0}}
    assert [sentence for sentence, _ in warnings(craft)] == [
        "one, other never had an estimate: a first pose takes 4 photodiodes lit in one period, and each of them saw "
        "2.3 on average at most"
    ]


def test_no_maximum_reads_as_less_than_its_rms_beside_one_that_is_far_larger() -> None:
    rows: list[tuple[str, dict[str, Any]]] = [
        ("calm", {"ekf_attitude_rms_deg": 0.034, "ekf_attitude_max_deg": 0.146}),
        ("stray", {"ekf_attitude_rms_deg": 61.3, "ekf_attitude_max_deg": 169.2}),
        ("none", {}),
    ]
    assert _cells(ATTITUDE_ERROR, [*rows]) == [" 0.034 /   0.15", "61.300 / 169.20", "–"]


def test_few_samples_conclude_nothing() -> None:
    one = dict(figures(random.Random(0)), nees=dict(consistency(0.5), effective_samples=1.0), nis=None, samples=8)
    said = [sentence for sentence, _ in findings(dict(one, pnp_motion_bias=bias(4e-3)))]
    assert said[0].startswith("NEES 0.50: too few independent values to judge (6 is exact")
    assert not any("biases" in sentence for sentence in said)
    # Errors 2.5 times too large are too large, however few, and the craft is named.
    blind = dict(consistency(38.0), effective_samples=3.0)
    assert meaning(blind).startswith(
        "errors 2.5 times as large as the filter promises, by few independent values: it expects less noise"
    )
    assert findings(dict(one, nees=blind))[0].style == "yellow"


def test_a_motion_bias_is_told_only_where_it_is_beyond_chance() -> None:
    told = dict(figures(random.Random(0)), pnp_motion_bias=bias(4.17e-3))
    assert any(s == "Motion biases PnP's position: 1.2 mm RMS (x -4.17 ms, y +4.17 ms)" for s, _ in findings(told))
    assert not any("attitude: " in s for s, _ in findings(told))
    assert not any("biases" in s for s, _ in findings(figures(random.Random(0))))


def test_it_says_where_the_run_is_and_how_to_look_at_it(folder: Path) -> None:
    lines = printed(summary(1), folder, 60)
    at = lines.index("runs/formation-7/")
    assert [line.split()[0] for line in lines[at + 1 : at + 5]] == [
        "telemetry.parquet",
        "summary.json",
        "scenario.toml",
        "recording.rrd",
    ]
    assert lines[at + 5] == "Look at it: swarm view runs/formation-7"
    (folder / "recording.rrd").unlink()
    assert not any("swarm view" in line for line in printed(summary(1), folder, 60))


def test_an_interrupted_run_says_so_and_an_empty_one_too(folder: Path) -> None:
    content = summary(1, status="interrupted", reason="stopped by the user")
    empty = {**summary(1), "swarm": None, "craft": {}}
    assert any("not complete (stopped by the user)" in line for line in printed(content, folder, 80))
    assert "Not one lighthouse period was recorded." in printed(empty, folder, 80)
    assert "Not one lighthouse period was recorded." in printed({"status": "interrupted"}, folder, 80)


def test_no_control_codes_without_a_terminal_and_no_colour_with_no_color(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "\x1b" not in "\n".join(printed(summary(8), folder, 80))
    assert "\x1b[3" in "\n".join(printed(summary(8), folder, 80, force_terminal=True, color_system="standard"))
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b[3" not in "\n".join(printed(summary(8), folder, 80, force_terminal=True))


HALF = Progress(15.0, 30.0, 7, 8)
DONE = Progress(30.0, 30.0, 8, 8)


def test_without_a_terminal_progress_is_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr("swarm.cli.progress.time.monotonic", lambda: clock[0])
    out = io.StringIO()
    with ProgressDisplay(Console(file=out, width=40), "formation") as show:
        show.run(Progress(0.0, 30.0, 0, 8))
        clock[0] += 10.0
        show.run(HALF)
        show.run(HALF)
        clock[0] += 5.0
        show.run(DONE)
    assert out.getvalue().splitlines() == [
        "formation: starting",
        "formation: 15.0 of 30.0 s, 1.5 times real time, 7 of 8 craft tracking, 10 s left",
        "formation: 30.0 of 30.0 s, 2.0 times real time, 8 of 8 craft tracking",
    ]


def test_a_study_and_an_experiment_tell_the_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr("swarm.cli.progress.time.monotonic", lambda: clock[0])
    out = io.StringIO()
    with ProgressDisplay(Console(file=out, width=40), "noise") as show:
        show.study(StudyProgress(2, 0, 10, 1.0))
        clock[0] += 30.0
        show.study(StudyProgress(4, 1, 10, 0.75))
    with ProgressDisplay(Console(file=out, width=40), "static") as show:
        show.experiment(0.1, "pose 1 of 10")
        clock[0] += 3600.0
        show.experiment(0.5, "pose 5 of 10")
    assert out.getvalue().splitlines() == [
        "noise: starting",
        "noise: 4/10 runs, 1 failed, 1 min 30 s left",
        "static: starting",
        "static: pose 5 of 10, 1 h 15 min left",
    ]


@pytest.mark.parametrize("width", [50, 60, 80, 120])
def test_on_a_terminal_a_study_is_one_line_with_the_time_left(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr("swarm.cli.progress.time.monotonic", lambda: clock[0])
    out = io.StringIO()
    console = Console(file=out, width=width, force_terminal=True, legacy_windows=False, color_system=None)
    with ProgressDisplay(console, "noise") as show:
        show.study(StudyProgress(0, 0, 10, 1.0))
        clock[0] += 60.0
        show.study(StudyProgress(4, 1, 10, 0.5))
    frames = [frame for frame in out.getvalue().replace("\x1b", "\n\x1b").splitlines() if "4/10 runs" in frame]
    assert frames
    assert "4/10 runs, 1 failed, 1 min 00 s left" in frames[-1]
    assert "…" not in frames[-1]


@pytest.mark.parametrize(
    ("width", "missing"),
    [
        (80, ""),
        (60, "No room in 60 columns for: NEES, mean (runs.parquet has them)."),
        (45, "No room in 45 columns for: NEES, mean; time tracking; attitude error, RMS (runs.parquet has them)."),
    ],
)
def test_a_studys_table_fits_and_names_what_it_leaves_out(width: int, missing: str, tmp_path: Path) -> None:
    count, noise = [2, 2, 3, 3], [5.0, 10.0, 5.0, 10.0]
    study = FinishedStudy(
        tmp_path,
        {"parameters": ["swarm.count", "lighthouse.angle_noise_arcsec"], "status": "complete", "wall_s": 3.0},
        table_of(
            [
                column("run", [0, 1, 2, 3], ""),
                column("status", [COMPLETE] * 4, "", kind="text"),
                column("seed", [7] * 4, ""),
                column("swarm.count", count, ""),
                column("lighthouse.angle_noise_arcsec", noise, "arcsec"),
                column("ekf_position_rms_m", [1e-4 * n for n in noise], "m"),
                column("ekf_attitude_rms_deg", [3e-3 * n for n in noise], "°"),
                column("nees_mean", [5.0, 5.5, 6.0, 6.5], ""),
                column("tracking_share", [1.0] * 4, ""),
            ]
        ),
    )
    out = io.StringIO()
    print_study(Console(file=out, width=width), study)
    lines = out.getvalue().splitlines()
    table = lines[: lines.index("")]
    assert max(map(cell_len, table)) <= width
    assert "…" not in out.getvalue()
    assert {"count", "noise", "arcsec", "position"} <= set(" ".join(lines[:5]).split())
    assert " ".join(" ".join(lines).split()).count(missing)
    assert ("NEES," in " ".join(lines[:5])) == (width == 80)


def test_the_speed_of_a_run_leaves_compiling_out(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr("swarm.cli.progress.time.monotonic", lambda: clock[0])
    out = io.StringIO()
    with ProgressDisplay(Console(file=out, width=80), "formation") as show:
        show.compiling(Compilation(True, 0))
        clock[0] += 40.0
        show.compiling(Compilation(False, 1))
        clock[0] += 1.0
        show.run(Progress(0.0, 30.0, 0, 8))
        clock[0] += 2.0
        show.compiling(Compilation(True, 1))
        clock[0] += 60.0
        show.compiling(Compilation(False, 2))
        clock[0] += 8.0
        show.run(DONE)
    assert "formation: 30.0 of 30.0 s, 3.0 times real time, 8 of 8 craft tracking" in out.getvalue().splitlines()


def test_compiling_is_counted_a_line_every_ten_seconds_and_told_once_at_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = [100.0]
    monkeypatch.setattr("swarm.cli.progress.time.monotonic", lambda: clock[0])
    out = io.StringIO()
    with ProgressDisplay(Console(file=out, width=40), "formation") as show:
        for done in range(20):
            show.compiling(Compilation(True, done))
            clock[0] += 1.5
            show.compiling(Compilation(False, done + 1))
        show.run(HALF)
        clock[0] += 0.1
        # More kernels later on are not announced again.
        show.compiling(Compilation(True, 20))
        clock[0] += 0.5
        show.compiling(Compilation(False, 21))
        show.run(DONE)
    assert out.getvalue().splitlines() == [
        "formation: starting",
        f"formation: {COMPILING}",
        "formation: compiling: 7 kernels done, 10 s",
        "formation: compiling: 14 kernels done, 21 s",
        "formation: 30.0 of 30.0 s, 150.0 times real time, 8 of 8 craft tracking",
        "formation: 21 kernels compiled in 30 s; the next run finds them in the cache",
    ]


def test_the_time_left_leaves_out_what_was_compiled_on_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr("swarm.cli.progress.time.monotonic", lambda: clock[0])
    out = io.StringIO()
    with ProgressDisplay(Console(file=out, width=40), "noise") as show:
        show.experiment(0.1, "pose 1 of 10")
        show.compiling(Compilation(True, 0))
        clock[0] += 100.0
        show.compiling(Compilation(False, 1))
        clock[0] += 20.0
        show.experiment(0.5, "pose 5 of 10")
    assert "noise: pose 5 of 10, 25 s left" in out.getvalue().splitlines()


def test_kernels_that_nothing_keeps_are_not_said_to_be_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("estimators.kernel_cache.folder", lambda: tmp_path / "missing")
    out = io.StringIO()
    with ProgressDisplay(Console(file=out, width=40), "formation") as show:
        show.compiling(Compilation(True, 0))
        show.compiling(Compilation(False, 1))
    last = out.getvalue().splitlines()[-1]
    assert "the next run compiles them again" in last
    assert f"{tmp_path}/missing" in last
    assert "NUMBA_CACHE_DIR" in last


@pytest.mark.parametrize("width", [60, 80])
def test_on_a_terminal_compiling_is_one_line_that_changes(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr("swarm.cli.progress.time.monotonic", lambda: clock[0])
    out = io.StringIO()
    console = Console(file=out, width=width, force_terminal=True, legacy_windows=False, color_system=None)
    with ProgressDisplay(console, "formation-reconfigure") as show:
        show.compiling(Compilation(True, 31))
        clock[0] += 125.0
        assert show.text() == "compiling: 31 kernels done, 125 s"
        show.compiling(Compilation(False, 32))
    frames = [frame for frame in out.getvalue().replace("\x1b", "\n\x1b").splitlines() if "32 kernels done" in frame]
    assert frames
    assert "…" not in frames[-1]
    assert out.getvalue().endswith(
        "formation-reconfigure: 32 kernels compiled in 125 s; the next run finds them in the cache\n"
    )


def test_only_what_is_not_in_the_cache_is_told_as_compiled(tmp_path: Path) -> None:
    (tmp_path / "small.py").write_text(
        "from estimators.kernel import kernel\n\n\n@kernel\ndef twice(x: float) -> float:\n    return 2 * x\n"
    )
    code = (
        "from estimators.kernel import told_of_compilation\nfrom small import twice\ntold = []\n"
        "with told_of_compilation(lambda state: told.append(tuple(state))):\n    twice(1.0)\n    twice(2.0)\ntwice(1)\n"
        "print(told)"
    )
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)]),
        "NUMBA_CACHE_DIR": str(tmp_path),
    }
    answers = [
        subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    ]
    assert answers == ["[(True, 0), (False, 1)]\n", "[]\n"]


def test_a_run_whose_kernels_are_in_the_cache_says_nothing_of_compiling(tmp_path: Path) -> None:
    # Compiles here what no other test has compiled before.
    simulate(load("formation", ["duration_s=0.1"]), out=tmp_path / "run", record=False)
    run = [sys.executable, "-m", "swarm", "run", "formation", "--set", "duration_s=0.1", "--force", "--no-recording"]
    command = [*run, "--out", str(tmp_path / "run")]
    said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stderr
    assert "compil" not in said
    assert "starting" in said


@pytest.mark.parametrize("width", [50, 60, 80, 120])
def test_on_a_terminal_progress_is_one_line_with_time_speed_and_tracking(
    width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [100.0]
    monkeypatch.setattr("swarm.cli.progress.time.monotonic", lambda: clock[0])
    out = io.StringIO()
    console = Console(file=out, width=width, force_terminal=True, legacy_windows=False, color_system=None)
    with ProgressDisplay(console, "formation") as show:
        show.run(HALF)
        clock[0] += 15 / 3.4
        show.run(DONE)
    frames = [frame for frame in out.getvalue().replace("\x1b", "\n\x1b").splitlines() if "30.0/30.0 s" in frame]
    assert frames
    for part in ("30.0/30.0 s", "3.4x", "8/8 tracking"):
        assert part in frames[-1]
    assert "…" not in frames[-1]


def test_a_file_has_room_and_columns_rule(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with (tmp_path / "out.txt").open("w") as file:
        monkeypatch.setattr("sys.stdout", file)
        monkeypatch.delenv("COLUMNS", raising=False)
        assert wide_console().width == 160
        monkeypatch.setenv("COLUMNS", "100")
        assert wide_console().width == 100


def test_a_smoothers_gain_in_scatter_is_told_only_at_rest() -> None:
    for after, at_rest in ((5.44, False), (2.1, True)):
        moved = dict(figures(random.Random(0)), ekf_position_scatter_mm=5.57, smooth_position_scatter_mm=after)
        (said,) = (text for text, _ in findings(moved) if text.startswith("Scatter"))
        assert f"5.57 mm, smoothed {after:.3g} mm" in said
        assert ("own motion" in said) is not at_rest
        assert bool(smoothed.facts(moved)) is at_rest
