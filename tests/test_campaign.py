"""Campaigns: every way to fly a study gives the serial loop's numbers, and nothing finished is lost or flown again."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow.parquet as pq
import pytest

from estimators.filter.error_state import STATES, process_noise_into, transition_into
from estimators.lighthouse.innovation import noise_of, rows_of_sweeps
from estimators.lighthouse.rows import AT_ORIGIN, linearise, packed
from estimators.rotation import matrix_from_quaternion
from swarm.cli import app as cli
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.scenario import load
from swarm.studies.campaign import cluster, conduct, study_folder
from swarm.studies.campaign.conduct import StudyProgress
from swarm.studies.campaign.plan import plan
from swarm.studies.campaign.posterior_bound import PosteriorBound
from swarm.studies.campaign.study import load_study, study_toml
from swarm.studies.campaign.study_folder import JOURNAL, ROWS, STATE, FinishedStudy, open_study, rows_table
from swarm.studies.campaign.task import LOST, Order, fly, is_wall_clock

ROOT = Path(__file__).parents[1]
SMALL = """
base = "formation"
seeds = 3
overrides = ["duration_s=0.2", "swarm.count=2"]
[grid]
lighthouse.angle_noise_arcsec = [5, 10.0]
"""
"""Six runs of two craft, 12 lighthouse periods each."""


@pytest.fixture(autouse=True)
def somewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def write(text: str, name: str = "small.toml") -> str:
    Path(name).write_text(text)
    return name


def numbers(study: FinishedStudy) -> list[dict[str, Any]]:
    """Every row without what a clock on the wall says."""
    return [{k: v for k, v in row.items() if not is_wall_clock(k)} for row in study.rows.to_pylist()]


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """What the plain loop gives for SMALL."""
    folder = tmp_path_factory.mktemp("serial")
    file = folder / "small.toml"
    file.write_text(SMALL)
    return numbers(conduct.conduct(load_study(file), out=folder / "out", serial=True))


class Farm(NamedTuple):
    """A scheduler and two workers, processes of their own."""

    address: str
    workers: list[subprocess.Popen[bytes]]


@pytest.fixture
def farm(tmp_path: Path) -> Iterator[Farm]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    file = tmp_path / "scheduler.json"
    common: dict[str, Any] = {"env": environment, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    started = [subprocess.Popen([*scheduler, "--no-dashboard", "--scheduler-file", str(file)], **common)]
    try:
        deadline = time.monotonic() + 60
        while not file.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        address = json.loads(file.read_text())["address"]
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
        workers = [
            subprocess.Popen([*worker, "--no-dashboard", "--local-directory", str(tmp_path / f"worker-{i}")], **common)
            for i in range(2)
        ]
        started += workers
        yield Farm(address, workers)
    finally:
        for process in started:
            process.kill()
            process.wait()


@pytest.mark.long
def test_a_worker_killed_in_mid_campaign_loses_no_run(farm: Farm, serial: list[dict[str, Any]]) -> None:
    """And neither the death, nor the order, nor the number of workers changes a bit of any number."""
    from distributed import Client

    with Client(farm.address) as client:
        client.wait_for_workers(2, timeout=60)
    seen = []

    def kill_one(progress: StudyProgress) -> None:
        seen.append(progress.done)
        if progress.done == 1:
            farm.workers[0].kill()

    done = conduct.conduct(load_study(write(SMALL)), scheduler=farm.address, progress=kill_one)
    assert done.status == "complete"
    assert farm.workers[0].wait(timeout=10) == -signal.SIGKILL
    assert seen == list(range(7))
    assert numbers(done) == serial
    assert done.state["where"] == farm.address


@pytest.mark.long
def test_this_machines_cores_give_the_serial_numbers(serial: list[dict[str, Any]]) -> None:
    done = conduct.conduct(load_study(write(SMALL), workers=2))
    assert numbers(done) == serial
    assert [row["seed"] for row in serial] == [7, 8, 9, 7, 8, 9]
    assert [row["lighthouse.angle_noise_arcsec"] for row in serial] == 3 * [5.0] + 3 * [10.0]
    for row in serial:
        assert row["status"] == "complete"
        assert row["craft_count"] == 2
        assert row["periods"] == 12
    errors = [row["ekf_position_rms_m"] for row in serial]
    assert len(set(errors)) == len(errors)
    assert json.loads((done.folder / STATE).read_text())["finished"] == 6


def test_a_row_says_what_the_same_run_says(serial: list[dict[str, Any]]) -> None:
    import swarm

    scenario = swarm.load("formation", ["duration_s=0.2", "swarm.count=2", "lighthouse.angle_noise_arcsec=10"], seed=8)
    summary = swarm.simulate(scenario, out="one", record=False).summary["swarm"]
    row = serial[4]
    for name in ("ekf_position_rms_m", "pnp_attitude_rms_deg", "tracking_share", "mean_pdop_m_per_rad"):
        assert row[name] == summary[name]
    assert row["nees_mean"] == summary["nees"]["mean"]
    assert row["pnp_motion_bias_position_slope_y_s"] == summary["pnp_motion_bias"]["position_slope_s"][1]


def test_ctrl_c_stops_and_resume_flies_only_the_rest(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The real program, stopped by the real signal; 16 runs, so that a busy machine does not finish them first."""
    command = ["swarm", "study", write(SMALL), "--serial", "--seeds", "8"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    begun = subprocess.Popen([sys.executable, "-m", *command], env=environment, stderr=subprocess.PIPE, text=True)
    journal = Path("runs/small") / JOURNAL
    while begun.poll() is None and not (journal.exists() and journal.read_text().count("\n") >= 2):
        time.sleep(0.01)
    begun.send_signal(signal.SIGINT)
    _, told = begun.communicate(timeout=60)
    assert begun.returncode == 130
    assert "Go on: swarm study small.toml --serial --seeds 8 --resume" in told
    before = {row["key"]: row for row in open_study("runs/small").rows.to_pylist()}
    assert 2 <= len(before) < 16
    assert open_study("small").status == "interrupted"

    monkeypatch.setattr(sys, "argv", [*command, "--resume"])
    assert cli.main() == 0
    assert "16 runs in" in capsys.readouterr().out
    done = open_study("small")
    assert numbers(done) == numbers(conduct.conduct(load_study("small.toml", seeds=8), out=Path("plain"), serial=True))
    # Seconds differ from one flight to the next: the same ones mean that nothing was flown again.
    after = {row["key"]: row for row in done.rows.to_pylist()}
    assert all(after[key]["seconds"] == row["seconds"] for key, row in before.items())
    assert not journal.exists()


def test_a_kill_at_any_moment_leaves_what_was_finished(monkeypatch: pytest.MonkeyPatch) -> None:
    """No signal handler helps against SIGKILL: the journal has the rows, and a half-written line is no row."""
    done = conduct.conduct(load_study(write(SMALL)), serial=True)
    rows = done.rows.to_pylist()
    torn = json.dumps(rows[3])
    (done.folder / ROWS).unlink()
    (done.folder / JOURNAL).write_text("".join(json.dumps(row) + "\n" for row in rows[:3]) + torn[: len(torn) // 2])
    assert open_study(done.folder).rows.to_pylist() == rows_table(rows[:3], done.parameters).to_pylist()

    flown: list[int] = []

    def noting(order):
        flown.append(order.number)
        return fly(order)

    monkeypatch.setattr(cluster, "fly", noting)
    again = conduct.conduct(load_study("small.toml"), serial=True, resume=True)
    assert sorted(flown) == [3, 4, 5]
    assert numbers(again) == numbers(done)
    flown.clear()
    conduct.conduct(load_study("small.toml"), serial=True, resume=True)
    assert flown == []
    # More seeds are more runs; those that are there stay.
    more = conduct.conduct(load_study("small.toml", seeds=4), serial=True, resume=True)
    assert sorted(flown) == [3, 7]
    assert [row["run"] for row in more.rows.to_pylist()] == list(range(8))


def test_a_run_that_fails_is_a_row_with_its_reason() -> None:
    text = SMALL.replace("[5, 10.0]", "[5, -1]") + "swarm.motion.radius_m = [1.0, 0.01]"
    done = conduct.conduct(load_study(write(text), seeds=1), serial=True)
    rows = done.rows.to_pylist()
    assert [row["status"] for row in rows] == ["complete", "failed", "failed", "failed"]
    assert rows[1]["reason"].startswith("scenario formation: swarm.motion.radius_m = 0.01: ")
    assert "study small, grid: lighthouse.angle_noise_arcsec = -1: must be at least 0 arcsec" in rows[2]["reason"]
    assert rows[2]["ekf_position_rms_m"] is None
    assert rows[0]["ekf_position_rms_m"] > 0
    assert done.state["finished"] == 1


def test_a_study_in_which_a_run_failed_is_exit_code_1(monkeypatch: pytest.MonkeyPatch) -> None:
    for values, code in (("[5, 10.0]", 0), ("[5, -1]", 1)):
        monkeypatch.setattr("swarm.studies.campaign.task._fly", lambda order: ({}, None))
        write(SMALL.replace("[5, 10.0]", values))
        monkeypatch.setattr(sys, "argv", ["swarm", "study", "small.toml", "--seeds", "1", "--serial", "--force"])
        assert cli.main() == code, values


def test_a_defect_of_one_run_does_not_end_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarm.studies.campaign.task._fly", lambda order: 1 // (order.number - 1) and ({}, None))
    done = conduct.conduct(load_study(write(SMALL), seeds=1), serial=True)
    assert [row["status"] for row in done.rows.to_pylist()] == ["complete", "failed"]
    assert done.rows.to_pylist()[1]["reason"].startswith("ZeroDivisionError: ")


def test_what_another_version_would_fly_is_lost_and_tried_again() -> None:
    run = plan(load_study(write(SMALL)))[0]
    assert run.scenario is not None
    flown = fly(Order(0, run.key, run.scenario.model_dump(mode="json"), version="0.0.1"))
    assert flown.status == LOST
    assert "the study 0.0.1" in flown.reason
    done = conduct.conduct(load_study("small.toml"), serial=True)
    rows = done.rows.to_pylist()
    lost = {**rows[2], "status": LOST, "reason": "its worker died"}
    (done.folder / JOURNAL).write_text(json.dumps(lost) + "\n")
    assert conduct.conduct(load_study("small.toml"), serial=True, resume=True).rows.column(
        "status"
    ).to_pylist() == 6 * ["complete"]


def test_telemetry_is_kept_when_asked() -> None:
    done = conduct.conduct(load_study(write("telemetry = true\n" + SMALL), seeds=1), serial=True)
    for row in done.rows.to_pylist():
        table = pq.read_table(done.folder / "telemetry" / f"{row['key']}.parquet")
        assert len(table) == 24
        error = table.column("position_error_m").to_numpy()
        assert np.sqrt(np.nanmean(error**2)) == pytest.approx(row["ekf_position_rms_m"], rel=1e-12)


def test_folders_are_never_overwritten_by_accident(monkeypatch: pytest.MonkeyPatch) -> None:
    study = load_study(write(SMALL), seeds=1)
    conduct.conduct(study, serial=True)
    with pytest.raises(SwarmError, match="holds a study already; --resume continues it, --force starts again"):
        conduct.conduct(study, serial=True)
    with pytest.raises(SwarmError, match="finished runs that this study does not plan"):
        conduct.conduct(load_study("small.toml", ["duration_s=0.1"], seeds=1), serial=True, resume=True)
    conduct.conduct(load_study("small.toml", ["duration_s=0.1"], seeds=1), serial=True, force=True)
    busy = study_folder.StudyFolder.open(Path("busy"), plan(study), [], force=False, resume=False)
    with pytest.raises(SwarmError, match="busy: a run is being written there now"):
        conduct.conduct(study, out=Path("busy"), serial=True)
    busy.release()
    Path("mine").mkdir()
    Path("mine/runs.parquet").touch()
    with pytest.raises(SwarmError, match=r"mine/runs\.parquet was not written by lighthouse-swarm, and a study"):
        conduct.conduct(study, out=Path("mine"), serial=True, force=True)
    monkeypatch.setattr(conduct, "versions", lambda: ["lighthouse-swarm 9.9"])
    with pytest.raises(
        SwarmError, match=r"begun with other versions \(lighthouse-swarm .* then, lighthouse-swarm 9.9 now"
    ):
        conduct.conduct(load_study("small.toml", ["duration_s=0.1"], seeds=1), serial=True, resume=True)


def test_the_study_of_a_folder_flies_the_same_again() -> None:
    text = SMALL + '[random]\n"swarm.motion.radius_m" = { low = 0.5, high = 1.5 }\n'
    study = load_study(write("samples = 2\n" + text), ["navigation.coast_limit_s=1"], seeds=2)
    Path("again.toml").write_text(study_toml(study, ["a comment"]))
    assert load_study("again.toml") == study
    assert [run.key for run in plan(load_study("again.toml"))] == [run.key for run in plan(study)]


def test_random_values_are_where_they_should_be_and_stay_there() -> None:
    head = 'base = "formation"\nsamples = 400\n[random]\n'
    keys = {
        "swarm.motion.radius_m": "{ low = 1.0, high = 2.0 }",
        "lighthouse.angle_noise_arcsec": "{ low = 1.0, high = 100.0, log = true }",
        "swarm.count": "{ low = 2, high = 5, integer = true }",
    }
    runs = plan(load_study(write(head + "\n".join(f"{k} = {v}" for k, v in keys.items()))))
    radius, noise, count = (np.array([run.parameters[key] for run in runs]) for key in keys)
    # The mean of n uniform values is within 3.5 / sqrt(12 n) of the middle but for one draw in 2000.
    within = 3.5 / np.sqrt(12 * len(runs))
    assert abs(radius.mean() - 1.5) < within
    assert abs(np.log10(noise).mean() - 1) < 2 * within
    assert sorted(set(count.tolist())) == [2, 3, 4, 5]
    # Each of four values 100 times, 1 sigma 8.7.
    assert np.bincount(count)[2:] == pytest.approx(100, abs=35)
    assert len(set(radius)) == 400
    fewer = plan(
        load_study(write(head.replace("400", "3") + f"swarm.motion.radius_m = {keys['swarm.motion.radius_m']}"))
    )
    assert [run.parameters["swarm.motion.radius_m"] for run in fewer] == radius[:3].tolist()


@pytest.mark.long
def test_measures_are_of_the_flight_and_change_nothing() -> None:
    text = 'base = "cloud"\noverrides = ["duration_s=0.7", "swarm.count=4"]\n'
    plain = conduct.conduct(load_study(write(text)), serial=True).rows.to_pylist()[0]
    measured = 'measure = ["onboard", "central", "first_craft"]\n' + text
    row = conduct.conduct(load_study(write(measured, "measured.toml")), serial=True).rows.to_pylist()[0]
    for name, value in plain.items():
        if name != "key" and not is_wall_clock(name):
            assert row[name] == value, name
    # A craft's own computer has nothing of the swarm, and finds the same to the last bit.
    assert row["onboard_alone_apart_m"] == 0
    steered = 'base = "formation"\noverrides = ["duration_s=0.5", "swarm.count=2", "swarm.feedback=estimate"]\n'
    study = load_study(write('measure = ["onboard"]\n' + steered, "steered.toml"))
    assert conduct.conduct(study, serial=True).rows.to_pylist()[0]["onboard_alone_apart_m"] == 0
    assert min(row["onboard_alone_us"], row["onboard_swarm_per_craft_us"], row["own_solve_us"]) > 0
    assert row["central_craft"] == 4
    # Without shadow all 12 photodiodes are lit: 24 angles of 4 bytes and a pose of 28, four craft, 60 times a second.
    assert row["lit_share"] == pytest.approx(1.0, abs=0.05)
    assert row["central_air_bytes_per_s"] == pytest.approx(4 * (24 * 4 + 28) * 60, rel=0.05)
    assert row["own_air_bytes_per_s"] == 0
    assert row["central_position_rms_m"] == pytest.approx(row["own_position_rms_m"], rel=0.05)
    assert -1e-6 < row["central_position_gain_share"] < row["rotor_known_position_gain_share"] < 0.1


def test_the_bound_of_a_study_is_that_of_the_information_of_all_light() -> None:
    """Against the recursion of the information itself, with the rows and their covariance as they are."""
    scenario = load("drift", ["swarm.count=2", "duration_s=0.2"], seed=3)
    flight = Flight(scenario)
    bound = PosteriorBound(scenario, flight)
    s, point = builders.navigation(scenario), flight.world.photodiodes.point_m
    information, f, q = np.linalg.inv(bound._covariance), np.zeros((STATES, STATES)), np.zeros((STATES, STATES))
    process_noise_into(s.frame_s, s.acceleration_noise_m_s2, s.angular_acceleration_noise_rad_s2, q)
    rate = None
    for period in flight.fly():
        bound.period(period)
        truth = period.truth
        assert truth is not None
        batch = rows_of_sweeps(period.angles.theta, period.angles.offset_s)
        turned = matrix_from_quaternion(truth.quaternion)
        for c in range(2):
            if rate is not None:
                transition_into(rate[c], s.frame_s, f)
                information[c] = np.linalg.inv(f @ np.linalg.inv(information[c]) @ f.T + q)
            rows, state = batch.of(c), (turned[c], truth.position[c], truth.velocity[c], truth.angular_rate[c])
            h = linearise(rows, packed([AT_ORIGIN]), point[c], *state).matrix
            information[c] += h.T @ np.linalg.solve(noise_of(rows, [s.noise]), h)
        rate = truth.angular_rate
    wanted = np.linalg.inv(information)
    scale = np.sqrt(np.einsum("ci,cj->cij", *[np.diagonal(wanted, axis1=1, axis2=2)] * 2))
    np.testing.assert_allclose(bound._covariance / scale, wanted / scale, rtol=0, atol=1e-6)
    found = bound.metrics()
    # Twelve periods of two craft are hardly more than one sample.
    assert 0.2 < found["position_over_bound"] < 3.0
    assert 0.2 < found["attitude_over_bound"] < 3.0


MISTAKES = [
    ('base = "static"\nseeds = "3"', 'seeds = "3": expected a whole number, or a list of whole numbers, not a string'),
    ('base = "static"\nseeds = [1, "a"]', 'seeds[1] = "a": expected a whole number, not a string'),
    ('base = "static"\nseeds = 0', "seeds = 0: must be at least 1"),
    ('grid = 3\nbase = "static"', "grid = 3: expected a table of keys: begin it with [grid]"),
    ('base = "static"\n[grid]\nswarm.count = 3', "grid.swarm.count = 3: expected a list, not a number"),
    ('base = "static"\nmeasure = 3', "measure = 3: expected a list of strings, not a number"),
    ("bse = 'formation'", "small.toml: bse = \"formation\": unknown key; did you mean 'base'?"),
    ("base = 'formtion'", "small.toml: base = \"formtion\": no scenario 'formtion'; did you mean 'formation'?"),
    ("base = 'formation'\nseeds = 0", "small.toml: seeds"),
    ("base = 'formation'\nsamples = -1", "small.toml: samples = -1: must be at least 0"),
    ("base = 'formation'\nmeasure = ['onbord']", "did you mean 'onboard'?"),
    (
        "base = 'formation'\n[grid]\nswarm.cuont = [1]",
        "study small, grid: swarm.cuont = 1: unknown key; did you mean 'count'?",
    ),
    ("base = 'formation'\n[grid]\nswarm.count = []", "small.toml: grid.swarm.count = []: must not be empty"),
    ("base = 'formation'\n[grid]\nswarm.count = 3", "small.toml: grid.swarm.count = 3: expected a list"),
    ("base = 'formation'\n[grid]\nseed = [3]", "small.toml: grid.seed = [3]: the seeds are listed in `seeds`"),
    (
        "base = 'formation'\nsamples = 1\n[random]\nswarm.motion.radius_m = { low = 2, high = 1 }",
        "low (2) must be below high (1)",
    ),
    (
        "base = 'formation'\nsamples = 1\n[random]\nswarm.motion.radius_m = { low = 2, hgh = 1 }",
        "unknown key; did you mean 'high'?",
    ),
    (
        "base = 'formation'\n[random]\nswarm.motion.radius_m = { low = 1, high = 2 }",
        "must be at least 1: [random] has keys",
    ),
    (
        "base = 'formation'\noverrides = ['duration_s=0']",
        "study small, overrides: duration_s = 0: must be at least 0.001 s",
    ),
    ("base = ", "small.toml, at the end: not TOML"),
]


@pytest.mark.parametrize(("text", "message"), MISTAKES)
def test_mistakes_in_a_study_are_one_message(
    text: str, message: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["swarm", "study", write(text)])
    assert cli.main() == 2
    told = capsys.readouterr().err
    assert message in told
    assert "Traceback" not in told
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["scalin"], "no study 'scalin'; did you mean 'scaling'?"),
        (["my/none.toml"], "study file my/none.toml does not exist"),
        (["scaling", "--craft", "1,x"], "--craft: '1,x' is not a list of whole numbers, such as 1,10,100"),
        (["scaling", "--craft", "0"], "study scaling, grid: swarm.count"),
        (["scaling", "--set", "duration_s"], "--set: 'duration_s' is not key=value"),
        (["scaling", "--set", "durtion_s=1"], "unknown key; did you mean 'duration_s'"),
        (["scaling", "--seeds", "-1"], "--seeds: seeds"),
        (["scaling", "--resume", "--force"], "choose one"),
        (["scaling", "--scheduler", "tcp://127.0.0.1:9", "--serial"], "--scheduler flies on a cluster"),
        (["scaling", "--scheduler", "nonsense"], "--scheduler nonsense: no dask scheduler answers there"),
    ],
)
def test_mistakes_on_the_command_line_are_one_message(
    arguments: list[str], message: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    monkeypatch.setattr(sys, "argv", ["swarm", "study", *arguments])
    assert cli.main() == 2
    assert message in re.sub(r"\s+", " ", capsys.readouterr().err)


def test_numbers_pass_through_the_journal_unchanged(tmp_path: Path) -> None:
    draw = np.random.default_rng(0)
    values = [float(v) for v in draw.standard_normal(200) * 10.0 ** draw.integers(-300, 300, 200)]
    folder = study_folder.StudyFolder(tmp_path, [], {})
    for i, value in enumerate(values):
        folder.add({"run": i, "key": f"{i:016x}", "status": "complete", "reason": None, "seed": 1, "x": value})
    shutil.copytree(tmp_path, tmp_path.with_name("killed"))
    folder.mark("running")
    (tmp_path / ROWS).unlink(missing_ok=True)
    assert open_study(tmp_path).rows.column("x").to_pylist() == values
    folder.finish({})
    assert open_study(tmp_path).rows.column("x").to_pylist() == values
