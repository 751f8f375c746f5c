"""A real Lighthouse 1.0 recording through the on-board code that simulated craft run."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from synthetic_recording import calibration_text, in_our_frame, lines, write

import swarm
from estimators.rotation import angle_between, matrix_from_quaternion
from swarm.assets import recordings
from swarm.errors import SwarmError
from swarm.flight import replay
from swarm.flight.recordings.libsurvive import read_libsurvive
from swarm.flight.replay import _Asked, _command
from swarm.scenario import for_replay

DATA = Path(__file__).parents[2] / "shared" / "data" / "lighthouse-v1"
RECORDING = DATA / "lh1_test_cal.rec.gz"
real = pytest.mark.skipif(not RECORDING.exists(), reason="the real recording, ../shared/data/lighthouse-v1, is absent")

TABLE_URAD = {("HMD", 0): 44, ("HMD", 1): 121, ("T20", 0): 323, ("T20", 1): 89}
"""Median residual that an independent solver found in this recording."""


@pytest.fixture(scope="module", autouse=True)
def _read_once() -> Iterator[None]:
    """The real recording is a quarter of a million lines: they are read once per object."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(replay, "read_libsurvive", cache(read_libsurvive))
        yield


@real
@pytest.mark.parametrize("source", ["pulses", "angles"])
@pytest.mark.parametrize(("object_name", "station"), TABLE_URAD)
def test_the_real_recording_is_solved_as_well_as_an_independent_check_did(tmp_path, object_name, station, source):
    run = swarm.replay(
        RECORDING,
        object_name=object_name,
        lighthouse=station,
        calibration=f"{RECORDING}.json",
        source=source,
        out=tmp_path / "run",
        record=False,
    )
    figures = run.summary["swarm"]
    assert figures["solved_share_with_5_photodiodes"] >= 0.95
    assert figures["residual_median_rad"] < 1.1e-6 * TABLE_URAD[object_name, station]
    assert figures["tracking_share"] > 0.95
    # libsurvive's own scatter about its answer is 1 mm to 2 mm and 0.1 degrees.
    assert figures["peer_position_scatter_mm"] < 2.3
    assert figures["peer_attitude_scatter_deg"] < 0.2
    table = run.telemetry
    for name in ("true_px_m", "position_error_m", "nees"):
        assert table[name].null_count == table.num_rows, "there is no truth in a recording"
    assert table["peer_px_m"].null_count < table.num_rows / 2


@real
def test_the_factory_calibration_is_taken_off(tmp_path):
    def residual(**calibration):
        run = swarm.replay(
            RECORDING, object_name="HMD", lighthouse=0, out=tmp_path / "run", record=False, force=True, **calibration
        )
        return run.summary["swarm"]["residual_median_rad"]

    assert residual(calibration=f"{RECORDING}.json") < 0.5 * residual()


@pytest.fixture
def synthetic(tmp_path):
    (tmp_path / "calibration.json").write_text(calibration_text())
    return write(tmp_path / "walk.rec.gz", lines()), tmp_path / "calibration.json"


@pytest.mark.parametrize("source", ["pulses", "angles"])
@pytest.mark.parametrize("station", [0, 1])
def test_a_recording_made_with_libsurvives_own_formula_gives_the_pose_it_was_made_of(
    tmp_path, synthetic, station, source
):
    recording, calibration = synthetic
    run = swarm.replay(
        recording, object_name="OBJ", lighthouse=station, calibration=calibration, source=source, out=tmp_path / "run"
    )
    table = run.telemetry.slice(2)
    rotation, position = in_our_frame(station)
    solved = np.stack([table[f"pnp_{key}"].to_numpy() for key in ("px_m", "py_m", "pz_m")], axis=1)
    quaternion = np.stack([table[f"pnp_{key}"].to_numpy() for key in ("qw", "qx", "qy", "qz")], axis=1)
    # Angles are rounded to a tick of 48 MHz, 8 urad: some tens of micrometres across at 3 m, ten times that in range.
    assert np.abs(solved - position).max() < 2e-3
    assert np.degrees(angle_between(matrix_from_quaternion(quaternion), rotation)).max() < 0.1
    assert (run.folder / "recording.rrd").stat().st_size > 10_000
    assert "replay" in (run.scenario or "").lower()


def test_mistakes_name_what_is_there(tmp_path, synthetic):
    recording, calibration = synthetic
    with pytest.raises(SwarmError, match=r"OBJ"):
        swarm.replay(recording, object_name="OBI", out=tmp_path / "run")
    recording.write_bytes(recording.read_bytes()[:100])
    with pytest.raises(SwarmError, match="truncated"):
        swarm.replay(recording, object_name="OBJ", calibration=calibration, out=tmp_path / "run")
    assert not (tmp_path / "run").exists(), "nothing half-written"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (None, "swarm replay handheld"),
        ("the one beside it", "swarm replay handheld"),
        ("mine.toml", "swarm replay handheld --calibration mine.toml"),
    ],
)
def test_the_command_of_a_run_keeps_a_calibration_that_was_given(given, said):
    file = recordings()["handheld"]
    calibration = file.with_name("handheld.json") if given == "the one beside it" else given
    assert _command(file, for_replay(file), _Asked(None, None, calibration, None, "pulses", None, imu=True)) == said
