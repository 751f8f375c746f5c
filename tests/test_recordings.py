"""Recordings, calibrations and the windows cut from them, against a recording written in libsurvive's own terms."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_recording import (
    BEGIN,
    CHANNELS,
    FRAMES,
    NORMALS,
    POINTS,
    TURN,
    calibration_text,
    in_our_frame,
    lines,
    survive_angle,
    write,
)

from estimators.lighthouse.pnp import PoseSolution, refine
from estimators.lighthouse.sweep import FanErrors, correct
from estimators.rotation import matrix_from_quaternion
from swarm.errors import SwarmError
from swarm.flight.recordings.framing import frame_pulses
from swarm.flight.recordings.libsurvive import PulseLog, Recording, read_libsurvive
from swarm.flight.recordings.receiver import Receiver
from swarm.flight.recordings.station_calibration import StationCalibration, read_calibration
from swarm.flight.recordings.windows import Source, Window, Windows
from swarm.onboard.decoder import SweepAngles

REAL = Path(__file__).parents[2] / "shared" / "data" / "lighthouse-v1" / "lh1_test_cal.rec.gz"
HALF_TICK_RAD = 0.5 * np.pi / 400_000


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return read_libsurvive(write(tmp_path_factory.mktemp("made") / "made.rec.gz", lines()), "OBJ")


@pytest.fixture
def calibration_file(tmp_path: Path) -> Path:
    path = tmp_path / "made.json"
    path.write_text(calibration_text())
    return path


def angles_of(windows: Windows) -> list[tuple[Window, SweepAngles]]:
    """Every window with its angles: libsurvive's own, or decoded on board from its pulses."""
    receiver = Receiver(windows, np.zeros(0, dtype=np.int64))
    unknown = np.full((*windows.photodiodes.present.shape, 2), np.nan)
    out = []
    for window in windows:
        assert (window.pulses is None) != (window.sweeps is None)
        out.append((window, receiver.receive(window, unknown).angles))
    return out


def solve(
    angles: SweepAngles, calibration: StationCalibration, recording: Recording, start: PoseSolution
) -> PoseSolution:
    theta = correct(angles.theta, (calibration.fan_x, calibration.fan_y))
    still = np.zeros((1, 3))
    point = recording.photodiodes.point_m
    return refine(theta, angles.lit, point, start.rotation, start.position, angles.offset_s, still, still)


def near(rotation: np.ndarray, position: np.ndarray) -> PoseSolution:
    none = np.zeros(1)
    return PoseSolution(rotation[None], position[None], none > 0, none.astype(int), none, none)


def test_the_object_is_read(recording: Recording) -> None:
    assert_allclose(recording.photodiodes.point_m[0], POINTS)
    assert_allclose(recording.photodiodes.normal[0], NORMALS / 2)
    assert recording.damaged_lines == 0
    assert len(recording.pulses.rise_tick) == FRAMES * 4 * 3 * len(CHANNELS)
    assert np.all(np.diff(recording.pulses.rise_tick) >= 0)
    assert recording.pulses.rise_tick[0] == BEGIN
    assert recording.pulses.rise_tick[-1] > 2**32  # Unwrapped.
    assert set(recording.pulses.photodiode) == set(range(len(CHANNELS)))
    assert set(recording.stations) == {0, 1}


def test_of_two_angles_of_one_sweep_the_expected_one_is_taken_and_without_a_track_none(tmp_path: Path) -> None:
    text = []
    for line in lines():
        text.append(line)
        word = line.split()
        if word[2] == "A":
            word[5] = str((int(word[5]) + round(0.02 / (2 * np.pi) * TURN)) % 2**32)
            word[7] = f"{float(word[7]) + 0.02:.12f}"
            text.append(" ".join(word))
    twice = read_libsurvive(write(tmp_path / "twice.rec", text), "OBJ")
    receiver = Receiver(Windows(twice, 0, "angles"), np.zeros(0, dtype=np.int64))
    wanted = np.pi / 2 + np.array([[[survive_angle(0, fan, k) for fan in (0, 1)] for k in range(len(POINTS))]])
    for window in list(Windows(twice, 0, "angles"))[1:]:
        blind = receiver.receive(window, np.full_like(wanted, np.nan)).angles
        assert not np.isfinite(blind.theta).any()
        assert blind.rejected[0] == 2 * wanted.size
        # The prediction is a milliradian off, less than half of the distance to the other angle.
        known = receiver.receive(window, wanted + 1e-3).angles
        assert_allclose(known.theta, wanted, rtol=0, atol=1e-11)
        assert known.lit.all()
        assert known.rejected[0] == wanted.size


@pytest.mark.parametrize("lighthouse", [0, 1])
@pytest.mark.parametrize("source", ["pulses", "angles"])
def test_windows_bring_back_angles_and_pose(
    recording: Recording, calibration_file: Path, source: Source, lighthouse: int
) -> None:
    calibration = read_calibration(calibration_file, lighthouse)
    windows = Windows(recording, lighthouse, source)
    assert windows.frame_s == pytest.approx(1 / 30)
    assert len(windows) == FRAMES
    wanted = np.array([[survive_angle(lighthouse, fan, k) for fan in (0, 1)] for k in range(len(POINTS))])
    rotation, position = in_our_frame(lighthouse)
    first = BEGIN + (TURN + 20_000 if lighthouse == 0 else 0)
    for n, (window, angles) in enumerate(angles_of(windows)):
        # Pulses have whole ticks; angles were written with twelve digits.
        tolerance = HALF_TICK_RAD * 1.001 if source == "pulses" else 1e-11
        assert_allclose(angles.theta[0], wanted + np.pi / 2, rtol=0, atol=tolerance)
        assert angles.epoch_tick[0] == pytest.approx(first + n * 2 * TURN + TURN / 2, abs=1)
        since_flash = (wanted + np.pi / 2) / (120 * np.pi) + np.array([-1 / 120, 0])
        assert_allclose(angles.offset_s[0], since_flash, rtol=0, atol=2 / 48e6)
        assert window.time_s == pytest.approx(1 + (angles.epoch_tick[0] - BEGIN) / 48e6, abs=1e-5)
        assert angles.rejected[0] == 0
        solved = solve(angles, calibration, recording, near(rotation, position + 0.01))
        # Half a tick, 4 urad, over a rig of 0.1 m at 2.5 m: some 4e-6 x 2.5^2 / 0.1 m and 4e-6 x 2.5 / 0.1 rad.
        assert_allclose(solved.position[0], position, rtol=0, atol=1e-3 if source == "pulses" else 1e-7)
        assert_allclose(solved.rotation[0], rotation, rtol=0, atol=1e-3 if source == "pulses" else 1e-7)
        if 0 < n < FRAMES - 1:  # The recording's own poses do not reach before its first line.
            assert_allclose(window.peer_position[0], position, rtol=0, atol=1e-7)
            assert_allclose(matrix_from_quaternion(window.peer_quaternion)[0], rotation, rtol=0, atol=1e-7)


@pytest.mark.parametrize("source", ["pulses", "angles"])
def test_windows_leave_no_gap_where_the_object_saw_nothing(tmp_path: Path, source: Source) -> None:
    made = read_libsurvive(write(tmp_path / "gap.rec", lines(drop_frames=(4, 5, 6))), "OBJ")
    decoded = angles_of(Windows(made, 1, source))
    assert len(decoded) == FRAMES
    assert [bool(angles.lit.all()) for _, angles in decoded] == [n not in (4, 5, 6) for n in range(FRAMES)]
    assert_allclose(np.diff([angles.epoch_tick[0] for _, angles in decoded]), 2 * TURN, atol=1)
    assert np.isfinite(decoded[5][0].peer_position).all()  # The peer went on.


def test_peer_is_missing_without_a_station_pose(tmp_path: Path) -> None:
    made = read_libsurvive(write(tmp_path / "a.rec", [line for line in lines() if "LH_POSE" not in line]), "OBJ")
    assert all(np.isnan(w.peer_position).all() and np.isnan(w.peer_quaternion).all() for w in Windows(made, 0))


def test_one_station_alone_has_periods_of_one_turn() -> None:
    half = TURN // 2
    flashes = [(900 + n * half, 3000 + 500 * (n % 2)) for n in range(60) if n not in (20, 22, 23)]
    flashes += [(900 + 31 * TURN + 5000 + n * half, 3000 + 500 * (n % 2)) for n in range(8)]  # It was restarted.
    flashes.insert(30, (flashes[29][0] + 3000 + 70_000, 3000))  # A stray flash.
    rise, width = np.array(flashes, dtype=np.int64).T
    log = PulseLog(rise / 48e6, np.zeros_like(rise), rise, width)
    framing = frame_pulses(log, 0)
    assert framing.turns == 1
    assert_allclose(framing.start[:30], 900 + TURN * np.arange(30.0))
    assert_allclose(framing.start[-4:], 900 + TURN * np.arange(31, 35) + 5000)
    assert len(framing.start) == 35
    assert len(frame_pulses(log, 1).start) == 0


def test_damaged_lines_are_counted_and_skipped(tmp_path: Path, recording: Recording) -> None:
    bad = [
        "1.5 OBJ C 15 32876",
        "1.5 OBJ C 3 99999999999 3000",
        "x OBJ C 3 99 3000",
        "1.5 OBJ POSE 1.255069 0 232450.. 2061314",
        "1.5 OBJ POSE 0 0 0 1 1 1 1",
        "1.5 OBJ A 2 4 100 0.000004 nan 1",
        "1.5 OBJ A 2 4 100 0.000004 0.1 7",
        "1.5 OBJ A 60 4 100 0.000004 0.1 1",
        "1.6 OBJ I 3 4",
        "1.6 OBJ i 3 100 1 2 3 4 5 nan 0 0 0 7",
        "1.6 OBJ I 3 100 99 2 3 4 5 6 0 0 0 7",
        "1.5",
        "\x00\xff\x07",
    ]
    good = lines()
    text = good[:60] + bad + good[60:] + ["", "1.6 OBJ VELOCITY 3 4"]
    made = read_libsurvive(write(tmp_path / "bad.rec.gz", text), "OBJ")
    assert made.damaged_lines == len(bad)
    np.testing.assert_array_equal(made.pulses.rise_tick, recording.pulses.rise_tick)
    np.testing.assert_array_equal(made.angles.angle_rad, recording.angles.angle_rad)


def test_a_recording_that_cannot_be_used_says_why(tmp_path: Path) -> None:
    good = lines()
    whole = write(tmp_path / "whole.rec.gz", good)

    def refused(path: Path, device: str = "OBJ") -> str:
        with pytest.raises(SwarmError) as caught:
            read_libsurvive(path, device)
        assert str(path) in str(caught.value)
        return str(caught.value)

    assert "did you mean 'OBJ'" in refused(whole, "OBI")
    assert "No such file" in refused(tmp_path / "none.rec")
    cut = tmp_path / "cut.rec.gz"
    cut.write_bytes(whole.read_bytes()[:100])
    assert "truncated gzip file, it ends within line" in refused(cut)
    assert "not a libsurvive recording" in refused(write(tmp_path / "poem.txt", ["roses are red"] * 9))
    assert "not a libsurvive recording" in refused(write(tmp_path / "empty.rec", []))
    assert "no CONFIG line" in refused(whole, "OTH")
    for old, new, message in (
        ('"modelPoints"', '"modelPoint"', "did you mean 'modelPoint'"),
        ('"lighthouse_config"', '"lighthouse"', "no table lighthouse_config"),
        ("[3, 1, 4, 0, 9, 5]", "[3, 1, 4, 0, 9, 9]", "channelMap must be 6 different whole numbers"),
        ("[[0.09,", '[["a",', "modelPoints must be n x 3 finite numbers"),
        ("[[0.0, 0.0, 2.0]", "[[0.0, 0.0, 0.0]", "modelNormals[0] is no direction"),
        ('{"lighthouse', "{lighthouse", "line 2: CONFIG of 'OBJ' is damaged at column"),
        ('"plus_x": [', '"plus_x": [3, ', "plus_x must be 3 finite numbers"),
    ):
        assert old in good[1]
        assert message in refused(write(tmp_path / "config.rec", [good[0], good[1].replace(old, new), *good[2:]]))


def test_a_station_that_is_not_in_the_recording(tmp_path: Path, recording: Recording) -> None:
    with pytest.raises(SwarmError, match="lighthouse must be 0 or 1, not 2"):
        Windows(recording, 2)
    with pytest.raises(SwarmError, match="did you mean 'pulses'"):
        Windows(recording, 0, "pulse")  # type: ignore[arg-type]
    bare = read_libsurvive(write(tmp_path / "a.rec", [line for line in lines() if " OBJ C " not in line]), "OBJ")
    with pytest.raises(SwarmError, match=r"no period of lighthouse 1 among the raw pulses \(C lines\) of 'OBJ'"):
        Windows(bare, 1)
    one = read_libsurvive(
        write(tmp_path / "b.rec", [line for line in lines() if not (" OBJ A " in line and line.endswith(" 0"))]), "OBJ"
    )
    with pytest.raises(SwarmError, match=r"no period of lighthouse 0 among the sweep angles"):
        Windows(one, 0, "angles")


def test_our_own_calibration_file(tmp_path: Path) -> None:
    path = tmp_path / "calibration.toml"
    path.write_text(
        "[fan_x]\nphase_rad = 0.01\ncurve = -0.002\n[fan_y]\n[photodiodes]\npoint_m = [[0.1, 0, 0], [0, 1, 2]]\n"
    )
    read = read_calibration(path)
    assert read.fan_x == FanErrors(phase_rad=0.01, curve=-0.002)
    assert read.fan_y == FanErrors()
    assert read.pose is None
    assert read.point_m is not None
    assert_allclose(read.point_m, [[0.1, 0.0, 0.0], [0.0, 1.0, 2.0]])


def test_libsurvives_calibration_file_is_read_with_and_without_commas(tmp_path: Path, calibration_file: Path) -> None:
    read = read_calibration(calibration_file, 1)
    assert (read.fan_x.phase_rad, read.fan_y.gibbous_magnitude) == (0.0228, -0.0123)
    strict = calibration_text().replace('"2"\n', '"2",\n').replace('}\n"light', '},\n"light')
    (tmp_path / "strict.json").write_text("{" + strict + "}")
    again = read_calibration(tmp_path / "strict.json", 1)
    assert again[:2] == read[:2]
    (tmp_path / "spare.json").write_text(strict.replace('"PositionSet":"1"', '"PositionSet":"1",'))
    assert read_calibration(tmp_path / "spare.json", 1)[:2] == read[:2]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"lighthouse1"', '"lighthouse7"', "no station 'lighthouse1'; did you mean 'lighthouse"),
        ('"fcaltilt"', '"fcaltlt"', "lighthouse0: fcaltilt is missing; did you mean 'fcaltlt'"),
        ('"-0.007900"', '"tilted"', "lighthouse1: fcaltilt must be 2 numbers"),
        ('"OOTXSet":"1"', '"OOTXSet":"0"', "lighthouse0: OOTXSet is 0"),
        ('"PositionSet":"1"\n}', '"PositionSet":"1\n}', "a string is not closed"),
        ('"index":"0",', '"index":,', "line 4: not a calibration file, or damaged"),
        ('"v":"0"', "v = 0\n[fan_z]", "neither libsurvive's calibration nor TOML"),
    ],
)
def test_a_damaged_libsurvive_calibration_says_where(calibration_file: Path, old: str, new: str, message: str) -> None:
    text = calibration_file.read_text()
    assert old in text
    station = 0 if "lighthouse0" in message else 1
    calibration_file.write_text(text.replace(old, new, 1) if station == 0 else new.join(text.rsplit(old, 1)))
    with pytest.raises(SwarmError) as caught:
        read_calibration(calibration_file, station)
    assert message in str(caught.value)
    assert str(calibration_file) in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[fan_x]\nphase = 1\n[fan_y]\n", "[fan_x]: unknown key 'phase'; did you mean 'phase_rad'"),
        ("[fan_x]\n", "the table [fan_y] is missing"),
        ("[fan_x]\n[fany]\n", "unknown key 'fany'; did you mean 'fan_y'"),
        ("[fan_x]\ntilt_rad = '1'\n[fan_y]\n", "[fan_x]: tilt_rad must be a finite number, not '1'"),
        ("[fan_x]\ntilt_rad = inf\n[fan_y]\n", "tilt_rad must be a finite number"),
        ("[fan_x]\n[fan_y]\n[photodiodes]\npoint_m = [1, 2]\n", "point_m must be rows of three"),
        ("fan_x = 3\n[fan_y]\n", "the table [fan_x] is missing"),
    ],
)
def test_a_wrong_calibration_of_ours_says_where(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "calibration.toml"
    path.write_text(text)
    with pytest.raises(SwarmError) as caught:
        read_calibration(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.long
@pytest.mark.skipif(not REAL.exists(), reason="the real recording (../shared/data/lighthouse-v1) is not here")
@pytest.mark.parametrize(
    ("device", "lighthouse", "windows", "lit", "residual_rad"),
    [("HMD", 0, 428, 12, 44e-6), ("HMD", 1, 397, 13, 121e-6), ("T20", 0, 401, 7, 323e-6), ("T20", 1, 435, 7, 89e-6)],
)
def test_the_real_recording_against_an_independent_check(
    device: str, lighthouse: int, windows: int, lit: int, residual_rad: float
) -> None:
    """The numbers are an independent program's, from libsurvive's angles (shared/data/README.md)."""
    recording = read_libsurvive(REAL, device)
    calibration = read_calibration(REAL.with_name(REAL.name + ".json"), lighthouse)
    for source in ("pulses", "angles"):
        decoded = [
            (window, angles)
            for window, angles in angles_of(Windows(recording, lighthouse, source, calibration.pose))
            if angles.lit.sum() >= 5
        ]
        assert len(decoded) >= windows
        assert np.median([angles.lit.sum() for _, angles in decoded]) == lit
        known = next(w for w, _ in decoded if np.isfinite(w.peer_position).all())
        start = near(matrix_from_quaternion(known.peer_quaternion)[0], known.peer_position[0])
        solved = [(window, solve(angles, calibration, recording, start)) for window, angles in decoded]
        solved = [(window, pose) for window, pose in solved if pose.solved[0]]
        assert len(solved) >= 0.99 * len(decoded)
        # Issue 2's bound: within 10 % of the independent check, or lower.
        assert np.median([pose.residual_rad[0] for _, pose in solved]) < 1.1 * residual_rad
        # The peer is of the same frames: centimetres away, as two stations' answers are from each other.
        away = [np.linalg.norm(window.peer_position[0] - pose.position[0]) for window, pose in solved]
        assert np.nanmedian(away) < 0.05


@pytest.mark.skipif(not REAL.exists(), reason="the real recording (../shared/data/lighthouse-v1) is not here")
@pytest.mark.parametrize("device", ["HMD", "T20"])
@pytest.mark.parametrize("lighthouse", [0, 1])
def test_our_decoder_reads_the_real_pulses_as_libsurvive_does(device: str, lighthouse: int) -> None:
    recording = read_libsurvive(REAL, device)
    theirs = {round(a.epoch_tick[0], -4): a for _, a in angles_of(Windows(recording, lighthouse, "angles"))}
    compared = more = 0
    for _, ours in angles_of(Windows(recording, lighthouse, "pulses")):
        same = theirs.get(round(ours.epoch_tick[0], -4))
        if same is None or ours.missed_sync[0] > 0:
            continue
        seen = np.isfinite(same.theta)
        assert np.isfinite(ours.theta[seen]).all()
        more += int(np.count_nonzero(np.isfinite(ours.theta)) - np.count_nonzero(seen))
        # It halves widths to whole ticks and writes six digits; where its 32-bit counter wraps, it loses a tick.
        wraps = (ours.epoch_tick[0] - TURN) // 2**32 != (ours.epoch_tick[0] + TURN) // 2**32
        tolerance = (3 if wraps else 1) * HALF_TICK_RAD + 0.51e-6
        assert_allclose(ours.theta[seen], same.theta[seen], rtol=0, atol=tolerance)
        compared += int(np.count_nonzero(seen))
    assert more <= len(recording.photodiodes.present[0])  # The sweep in the middle of which it locked on.
    assert compared > 0.95 * np.count_nonzero(recording.angles.lighthouse == lighthouse)


@pytest.mark.skipif(not REAL.exists(), reason="the real recording (../shared/data/lighthouse-v1) is not here")
def test_the_documented_snippet_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    text = (Path(__file__).parents[1] / "docs" / "replay.md").read_text()
    snippet = text.split("```python\n")[1].split("```")[0]
    monkeypatch.chdir(REAL.parent)
    names: dict[str, object] = {}
    exec(snippet, names)
    assert isinstance(names["angles"], SweepAngles)
