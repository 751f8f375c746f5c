"""Truth of another system in a replay: errors, columns and summary of a replay whose truth is known by construction."""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from swarm.assets import find_recording
from swarm.errors import SwarmError
from swarm.flight.recordings.contents import only_object
from swarm.flight.recordings.libsurvive import read_libsurvive
from swarm.flight.recordings.trajectory import read_trajectory
from swarm.flight.replay import Playback, replay
from swarm.flight.truth import GivenTruth
from swarm.results.period import Period
from swarm.scenario import for_replay

TURN, SHIFT = Rotation.from_euler("zyx", [40, 20, -70], degrees=True), np.array([3.0, -2.0, 1.0])
MARKER = np.array([0.01, 0.02, -0.03])
OFFSET_S = 512.25
END_S = 5.0
QUICK = ("navigation.angle_noise_arcsec=20", "navigation.integrity.residual_test=false")
ERROR_M = 0.001
"""Error that is put into the truth, on a circle twice a second: smooth between its rows, unlike any alignment."""


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first seconds of the recording that comes along."""
    whole = find_recording("handheld")
    file = tmp_path_factory.mktemp("light") / "short.rec"
    with gzip.open(whole, "rt") as lines:
        kept = [line for line in lines if float(line.split(None, 1)[0]) < END_S]
    file.write_text("".join(kept))
    file.with_name("short.json").write_text(whole.with_name("handheld.json").read_text())
    return file


@pytest.fixture(scope="module")
def flown(short: Path) -> tuple[list[Period], float]:
    """Its periods, navigated."""
    playback = Playback(
        read_libsurvive(short, only_object(short)), for_replay(short, QUICK), 0, short.with_name("short.json")
    )
    return list(playback.fly()), playback.begin_s


def truth_of(periods: list[Period], begin_s: float, folder: Path, *, attitude: bool) -> Path:
    known = [p for p in periods if np.isfinite(p.estimate.position[0]).all()]
    time_s = np.array([p.time_s for p in known]) + begin_s + OFFSET_S
    position = np.array([p.estimate.position[0] for p in known])
    turned = Rotation.from_matrix(np.array([p.estimate.rotation[0] for p in known]))
    turn = 2 * np.pi * time_s / 0.5
    position = position + ERROR_M * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    place = TURN.apply(position + turned.apply(MARKER)) + SHIFT
    columns = [time_s, place]
    if attitude:
        columns.append((TURN * turned * Rotation.from_euler("x", 30, degrees=True)).as_quat())
    file = folder / "truth.tum"
    np.savetxt(file, np.column_stack(columns), fmt="%.9f")
    return file


@pytest.mark.parametrize("attitude", [True, False])
def test_errors_are_those_that_were_put_in(flown: tuple[list[Period], float], tmp_path: Path, attitude: bool) -> None:
    periods, begin_s = flown
    truth = read_trajectory(truth_of(periods, begin_s, tmp_path, attitude=attitude))
    given = GivenTruth(truth, periods, begin_s, np.zeros(0))
    told = list(given.give(periods))
    error = []
    for before, after in zip(periods, told, strict=True):
        assert after.truth is not None
        if np.isfinite(after.truth.position).all():
            error.append(np.linalg.norm(after.truth.position[0] - before.estimate.position[0]))
        assert attitude or np.isnan(after.truth.quaternion).all()
    # Eleven numbers are fitted to some 300; and rows are interpolated, 15 to a turn: 2 %.
    assert np.median(error) == pytest.approx(ERROR_M, rel=0.1)
    assert given.alignment.lever is not None
    np.testing.assert_allclose(given.alignment.lever, MARKER, atol=6e-3)
    assert given.summary()["truth_alignment"]["file"] == "truth.tum"
    assert any("clock" in note for note in given.notes)
    if attitude:
        known = [p for p in told if p.truth is not None and np.isfinite(p.truth.quaternion).all()]
        assert len(known) > 50
        away = [
            (
                Rotation.from_quat(np.roll(p.truth.quaternion[0], -1))
                * Rotation.from_matrix(p.estimate.rotation[0]).inv()
            ).magnitude()
            for p in known
            if p.truth is not None
        ]
        assert np.degrees(np.median(away)) < 0.3  # 1 mm over the 0.3 m of its way


@pytest.mark.long
def test_a_replay_has_true_columns(flown: tuple[list[Period], float], short: Path, tmp_path: Path) -> None:
    periods, begin_s = flown
    file = truth_of(periods, begin_s, tmp_path, attitude=True)
    run = replay(
        short,
        lighthouse=0,
        calibration=short.with_name("short.json"),
        scenario=for_replay(short, QUICK),
        truth=file,
        out=tmp_path / "run",
        record=False,
    )
    summary = json.loads((run.folder / "summary.json").read_text())
    assert 1e3 * summary["swarm"]["ekf_position_rms_m"] == pytest.approx(1e3 * ERROR_M, rel=0.1)
    assert summary["swarm"]["ekf_attitude_rms_deg"] < 0.3
    assert summary["truth_alignment"]["samples"] > 50
    assert "--truth" in (run.folder / "scenario.toml").read_text()


@pytest.mark.long
def test_a_truth_that_does_not_fit_leaves_no_run(short: Path, tmp_path: Path) -> None:
    file = tmp_path / "other.csv"
    t = np.arange(0, 40, 0.02)
    np.savetxt(file, np.column_stack([t, np.sin(t), np.cos(3 * t), t]), delimiter=",", header="t,x,y,z", comments="")
    with pytest.raises(SwarmError, match=r"other\.csv"):
        replay(short, scenario=for_replay(short, QUICK), truth=file, out=tmp_path / "run", record=False)
    assert not (tmp_path / "run").exists()
