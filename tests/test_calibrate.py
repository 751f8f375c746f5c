"""`swarm calibrate` from end to end: fly a survey, calibrate both ways, fly calibrated; files, and careless users."""

import gzip
import re
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import synthetic_recording

import swarm
from estimators.calibration.model import fan_errors, linear_fans
from estimators.calibration.problem import Noise, to_gauge
from estimators.lighthouse.sweep import FanErrors
from swarm.cli import app as cli
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.flight.recordings.calibration_file import calibration_text, held_parts
from swarm.flight.recordings.station_calibration import StationCalibration, read_calibration
from swarm.onboard.decoder import SweepAngles
from swarm.results.angles import AngleWriter, believed, read_angles
from swarm.results.run_folder import Run
from swarm.scenario import load
from swarm.studies.calibration.calibrate import Calibrated, calibrate_survey
from swarm.studies.calibration.report import fan_sigmas, file_text
from swarm.studies.calibration.survey import observe_run

DATA = Path(__file__).parents[2] / "shared" / "data" / "lighthouse-v1" / "lh1_test_cal.rec.gz"
QUICK = (
    "duration_s=14",
    "swarm.motion.points_m=[[0,0,1.3],[1.2,0.9,1.5],[-1.1,1.0,1.3],[-1.3,-1.1,1.7],[1.2,-1.1,1.2],[0.1,0,2.2]]",
    "swarm.motion.times_s=[0.0,2.8,5.6,8.4,11.2,14.0]",
    "swarm.motion.attitude.spin_deg_s=50",
)
REST = (
    "duration_s=6",
    "swarm.motion={kind='hold', position_m=[0.3, 0.2, 1.5], attitude={yaw_deg=15, pitch_deg=10}}",
)


@pytest.fixture(scope="module")
def fly(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Run]:
    """Flies the survey, changed, once per change."""
    folder = tmp_path_factory.mktemp("surveys")

    @cache
    def flown(*overrides: str) -> Run:
        return swarm.simulate(load("survey", overrides), out=folder / f"run-{abs(hash(overrides))}", record=False)

    return flown


@pytest.fixture(scope="module")
def calibrated(fly: Callable[..., Run]) -> Callable[[str], Calibrated]:
    return cache(lambda how: calibrate_survey(observe_run(fly(*QUICK).folder), how))


class Result(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments: str) -> Result:
        monkeypatch.setattr(sys, "argv", ["swarm", *arguments])
        return Result(cli.main(), *capsys.readouterr())

    return run


@pytest.mark.parametrize("how", ["truth", "own"])
def test_what_is_left_in_held_out_poses_is_noise(calibrated, how):
    found = calibrated(how)
    assert found.before.ratio > 5
    assert found.after.ratio < 1.1
    assert found.after.pose.solved.mean() > 0.99
    assert found.result.residual == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("how", ["truth", "own"])
def test_errors_are_of_the_size_of_their_standard_deviations(calibrated, how):
    found, scenario = calibrated(how), load("survey", QUICK)
    truth = Flight(scenario).sensors.lighthouse
    point = truth.photodiodes.point_m[0]
    if how == "own":
        point = to_gauge(point, found.seen.believed.point_m[0])
    fans = linear_fans(truth.fans)
    off = np.concatenate(
        [
            ((found.result.fans - fans) / found.result.fan_sigma).ravel(),
            ((found.result.point_m - point) / found.result.point_sigma_m).ravel(),
        ]
    )
    # 46 numbers: beyond 4.5 standard deviations is one in 3000 such surveys. `benchmarks/calibration.py` says more.
    assert np.abs(off).max() < 4.5
    assert np.sqrt(np.mean(off**2)) < 1.6


def test_a_calibrated_craft_flies_better(calibrated, fly, tmp_path):
    file = tmp_path / "calibration.toml"
    file.write_text(file_text(calibrated("truth")))
    # Another seed and another noise, but the same craft, by its mounting seed.
    other = ("seed=5", "duration_s=4", "navigation.angle_noise_arcsec=8.8", "navigation.rotor_correlation=0.8717")
    before = fly(*other).summary["swarm"]
    after = fly(*other, f"navigation.calibration='{file}'").summary["swarm"]
    assert before["ekf_position_rms_m"] > 50e-3
    assert after["ekf_position_rms_m"] < 3e-3
    assert after["ekf_attitude_rms_deg"] < 0.1
    assert after["nees"]["mean"] < 10


def test_a_run_may_be_calibrated_again_from_what_it_already_believes(calibrated, fly, tmp_path):
    file = tmp_path / "calibration.toml"
    file.write_text(file_text(calibrated("truth")))
    run = fly(*QUICK, "seed=6", f"navigation.calibration='{file}'")
    found = calibrate_survey(observe_run(run.folder), "truth")
    # Before: the calibration of other noise, good already.
    assert found.before.ratio < 1.1
    assert found.after.ratio < 1.1
    np.testing.assert_allclose(found.seen.believed.point_m[0], calibrated("truth").result.point_m, atol=1e-15)


def test_angles_are_written_as_decoded_and_read_back(tmp_path):
    scenario = load("formation", ["swarm.count=2", "duration_s=0.5", "recording.angles=true"])
    run = swarm.simulate(scenario, out=tmp_path / "run", record=False)
    table, flight = read_angles(run.folder), Flight(scenario)
    for frame in range(30):
        angles = flight.period(frame).angles
        rows = table.frame == frame
        theta = np.full_like(angles.theta, np.nan)
        theta[table.craft[rows], table.photodiode[rows]] = table.theta[rows]
        np.testing.assert_array_equal(theta, angles.theta)
        offset = np.zeros_like(theta)
        offset[table.craft[rows], table.photodiode[rows]] = np.nan_to_num(table.offset_s[rows])
        np.testing.assert_array_equal(offset, angles.offset_s)
    assert table.believed.craft == ("craft-0", "craft-1")
    assert table.believed.noise == builders.angle_noise(scenario)
    np.testing.assert_array_equal(table.believed.point_m[1], flight.world.photodiodes.point_m[1])


def test_a_run_writes_no_angles_unless_asked_to(tmp_path):
    run = swarm.simulate(load("formation", ["duration_s=0.1"]), out=tmp_path / "run", record=False)
    assert not (run.folder / "angles.parquet").exists()
    with pytest.raises(SwarmError, match=r"no angles\.parquet: fly it again with --set recording\.angles=true"):
        observe_run(run.folder)


def test_a_stopped_run_leaves_the_angles_of_its_periods(tmp_path):
    def stop(progress):
        if progress.time_s > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        swarm.simulate(load("survey"), out=tmp_path / "run", record=False, progress=stop)
    seen = observe_run(tmp_path / "run")
    assert len(seen.time_s) == 19
    assert np.isfinite(seen.theta).any(axis=(1, 2)).all()
    # --force replaces what there is.
    swarm.simulate(
        load("survey", ["duration_s=0.1", "recording.angles=false"]), out=tmp_path / "run", force=True, record=False
    )
    assert not (tmp_path / "run" / "angles.parquet").exists()


def test_a_killed_run_leaves_its_angles_but_those_of_the_last_periods(tmp_path):
    layout = Flight(load("survey")).world.photodiodes
    count = layout.present.sum()
    about = believed(("craft-0",), layout, (FanErrors(), FanErrors()), Noise(1e-5, 1e-5))
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    for folder in (whole, killed):
        folder.mkdir()
        writer = AngleWriter(folder, about)
        rng = np.random.default_rng(5)
        for frame in range(300):
            theta = rng.uniform(1, 2, (1, count, 2))
            writer.append(frame, SweepAngles(theta, 1e-3 * theta, *np.empty((4, 0))))
        if folder is whole:
            writer.close()
    assert [path.name for path in whole.iterdir()] == ["angles.parquet"]
    assert not (killed / "angles.parquet").exists()
    good, left = read_angles(whole), read_angles(killed)
    rows = 240 * count
    assert len(left.frame) == rows
    for name in ("frame", "craft", "photodiode", "theta", "offset_s"):
        np.testing.assert_array_equal(getattr(left, name), getattr(good, name)[:rows])
    assert left.believed.craft == ("craft-0",)
    with pytest.raises(SwarmError, match=r"has no angles\.parquet: fly it again"):
        read_angles(tmp_path)


def test_damaged_angles_are_a_clear_mistake(tmp_path):
    (tmp_path / "angles.parquet").write_text("no parquet")
    with pytest.raises(SwarmError, match=r"cannot read .*angles\.parquet"):
        read_angles(tmp_path)
    pq.write_table(pa.table({"frame": [1]}), tmp_path / "angles.parquet")
    with pytest.raises(SwarmError, match=r"cannot read .*angles\.parquet"):
        read_angles(tmp_path)


def test_mounting_errors_go_by_their_own_seed():
    def point(*overrides: str) -> np.ndarray:
        return Flight(load("survey", overrides)).sensors.lighthouse.photodiodes.point_m

    np.testing.assert_array_equal(point(), point("seed=9"))
    assert not np.array_equal(point(), point("lighthouse.mounting_seed=2"))
    own = ["lighthouse.mounting_error_mm=0.5"]
    flights = [Flight(load("formation", own, seed)).sensors.lighthouse.photodiodes.point_m for seed in (1, 2)]
    assert not np.array_equal(flights[0], flights[1])


def test_files_go_round_to_the_bit(tmp_path):
    random = np.random.default_rng(1)
    fans = (FanErrors(*random.normal(0, 0.01, 5)), FanErrors(*random.normal(0, 0.01, 5)))
    points = {"craft-0": random.normal(0, 0.1, (5, 3)), "T20 left.hand": random.normal(0, 0.1, (4, 3))}
    sigma = {name: np.full_like(p, 2e-6) for name, p in points.items()}
    text = calibration_text(StationCalibration(*fans, by_name=points), fans, sigma, ["From here", "and now"])
    (tmp_path / "c.toml").write_text(text)
    back = read_calibration(tmp_path / "c.toml")
    assert (back.fan_x, back.fan_y) == fans
    assert set(back.by_name) == set(points)
    for name, point in points.items():
        np.testing.assert_array_equal(back.by_name[name], point)
        np.testing.assert_array_equal(back.places(name), point)
    assert back.point_m is None
    assert back.places("other") is None
    assert text.startswith("# From here\n# and now\n")


def test_the_file_says_how_well_it_is_known(calibrated):
    text = file_text(calibrated("own"))
    head = text[: text.index("[fan_x]")]
    for word in ("Residual", "Held-out", "Condition", "poses of 1 craft in 14 s", "UTC", "Without known poses"):
        assert word in head
    sigmas = fan_sigmas(calibrated("own"))
    assert f"# {sigmas[0].phase_rad:.2g}\n" in text
    assert text.count(" um\n") == 12


def test_held_parts_stay_and_say_so(fly):
    found = calibrate_survey(observe_run(fly(*QUICK).folder), "truth", ["photodiodes", "curve"])
    assert (found.result.fans[:, 2] == 0).all()
    assert not found.result.placed.any()
    text = file_text(found)
    assert text.count("not estimated") == 2
    assert "[photodiodes" not in text
    # What was left out shows: half a millimetre is some hundred microradians.
    assert found.after.ratio > 5
    assert fan_errors(found.result.fans)[0].curve == 0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[photodiodes.craft-0]\npoint_m = [[0,0,0]]", r"places 1 photodiodes, but craft 'craft-0' has 12"),
        (
            "[photodiodes.mokup]\npoint_m = [[0,0,0]]",
            r"\[photodiodes.mokup\]: no craft or model has this name; did you mean 'mockup'",
        ),
        ("[photodiodes]\npoint_m = [[0,0,0]]", r"without a name belongs to one object of a replay"),
        (
            "[photodiodes.craft-0]\npoints = [[0,0,0]]",
            r"\[photodiodes.craft-0\]: unknown key 'points'; did you mean 'point_m'",
        ),
        ("[photodiodes.craft-0]\npoint_m = [[0,0]]", r"\[photodiodes.craft-0\]: point_m must be rows of three"),
        ("[photodiodes]\npoint = [[0,0]]", r"\[photodiodes\]: unknown key 'point'; did you mean 'point_m'"),
        ("photodiodes = 3", r"\[photodiodes\]: must be a table"),
    ],
)
@pytest.mark.parametrize("verb", ["run", "check"])
def test_calibration_files_that_do_not_fit(command, tmp_path, verb, content, message):
    tables = content if content.startswith("[") else ""
    head = "" if tables else content
    (tmp_path / "c.toml").write_text(f"{head}\n[fan_x]\n[fan_y]\n{tables}\n")
    options = ["--calibration", "c.toml"] if verb == "run" else ["--set", "navigation.calibration=c.toml"]
    result = command(verb, "formation", *options)
    assert result.code == 2
    assert re.search(message, result.err), result.err
    assert not (tmp_path / "runs").exists()


def test_residuals_are_tested_only_where_the_calibration_places_the_photodiodes_of_every_craft(tmp_path):
    """The mounting errors of a craft that has none of its own in the file look like false photodiodes."""
    head, points = "[fan_x]\n[fan_y]\n", "point_m = [[0,0,0]]\n"
    mounted = ["swarm.count=2", "lighthouse.mounting_error_mm=0.5"]
    for tables, values, tested in (
        (("craft-0",), mounted, False),
        (("craft-0", "craft-1"), mounted, True),
        (("mockup",), mounted, True),
        ((), mounted, False),
        ((), ["swarm.count=2", "lighthouse.fan_x={phase_rad=0.01}"], True),
        (None, ["swarm.count=2"], True),
        (None, mounted, False),
    ):
        file = tmp_path / "c.toml"
        file.write_text(head + "".join(f"[photodiodes.{name}]\n{points}" for name in tables or ()))
        settings = load("formation", [*values, *([f"navigation.calibration='{file}'"] if tables is not None else [])])
        assert builders.navigation(settings).integrity.residual_test is tested, (tables, values)


def test_a_models_photodiodes_are_those_of_every_craft_of_it(tmp_path):
    layout = Flight(load("formation", ["swarm.count=2"])).world.photodiodes
    model, single = layout.point_m[0] + 1e-3, layout.point_m[0] + 2e-3
    text = calibration_text(
        StationCalibration(FanErrors(), FanErrors(), by_name={"mockup": model, "craft-1": single}),
        (FanErrors(), FanErrors()),
        {"mockup": 0 * model, "craft-1": 0 * model},
    )
    (tmp_path / "c.toml").write_text(text)
    scenario = load("formation", ["swarm.count=2", f"navigation.calibration='{tmp_path / 'c.toml'}'"])
    placed = builders.believed_layout(scenario, layout).point_m
    np.testing.assert_array_equal(placed[0], model)
    np.testing.assert_array_equal(placed[1], single)


def test_the_command_writes_a_file_and_says_what_it_found(command, fly):
    result = command("calibrate", str(fly(*QUICK).folder), "--hold", "photodiodes")
    assert result.code == 0, result.err
    for word in (
        "Poses: known",
        "Held-out poses",
        "fan X",
        "phase_rad",
        "left where they are believed",
        "calibration.toml",
    ):
        assert word in result.out
    read_calibration("calibration.toml")
    again = command("calibrate", str(fly(*QUICK).folder))
    assert again.code == 2
    assert "calibration.toml is there already; --force replaces it" in again.err


def test_careless_users_get_one_message(command, fly, tmp_path):
    survey, rest = str(fly(*QUICK).folder), str(fly(*REST).folder)
    (tmp_path / "noise.rec").write_text("nothing of the kind\n" * 5)
    with gzip.open("object.rec.gz", "wt") as file:
        file.write("0.1 HMD C 0 1 2\n")
    for arguments, message in (
        (("runs/none-1",), "runs/none-1 is not a run: there is no such folder"),
        ((str(tmp_path),), "is not a run"),
        ((survey, "--hold", "tild"), "--hold: 'tild' cannot be held; did you mean 'tilt'?"),
        ((survey, "--hold", "phase,tilt,curve,gibbous,photodiodes"), "nothing is left to be estimated"),
        ((survey, "--out", "no/where.toml"), "there is no folder no"),
        ((survey, "--out", "."), "it is a folder"),
        ((survey, "--object", "HMD"), "belong to a recording"),
        ((rest,), "not observable in this survey; they involve fan_x.tilt_rad"),
        ((rest, "--poses", "own"), "--poses truth"),
        (("noise.rec",), "not a libsurvive recording"),
        (("object.rec.gz", "--object", "HDM"), "did you mean 'HMD'?"),
    ):
        result = command("calibrate", *arguments)
        assert result.code == 2, arguments
        assert message in result.err, result.err
        assert "Traceback" not in result.err
        assert not Path("calibration.toml").exists()
    assert held_parts(" tilt , curve,") == ("tilt", "curve")


def test_a_recording_of_an_object_at_rest_is_refused(command, tmp_path):
    file = tmp_path / "rest.rec.gz"
    synthetic_recording.write(file, synthetic_recording.lines())
    truth = command("calibrate", str(file), "--object", "OBJ", "--poses", "truth")
    assert truth.code == 2
    assert "no true poses: --poses own" in truth.err
    own = command("calibrate", str(file), "--object", "OBJ")
    assert own.code == 2
    assert "not observable" in own.err
    assert "--poses truth" not in own.err


@pytest.mark.skipif(not DATA.exists(), reason="needs the recording of a real lighthouse in ../shared/data")
def test_the_real_objects_at_rest_are_refused(command):
    arguments = ("--object", "T20", "--lighthouse", "0", "--calibration", f"{DATA}.json")
    result = command("calibrate", str(DATA), *arguments)
    assert result.code == 2
    assert "16 of 24 directions" in result.err
