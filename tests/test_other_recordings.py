"""Recordings other than libsurvive's of Lighthouse 1.0: its lines of 2.0, Crazyflie logs, and what goes with them."""

import gzip
import math
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from mutants import FOREIGN, event_log_mutant, mutant, recording_mutant
from synthetic_rotor import (
    ANGLES,
    CHANNELS,
    DEVICE,
    FORMS,
    SLOW,
    TICKS,
    TURNS,
    TYPES,
    crazyflie_log,
    lines,
    system_config,
)
from typer.testing import CliRunner

from swarm.cli.app import app
from swarm.errors import SwarmError
from swarm.flight.recordings.contents import contents
from swarm.flight.recordings.crazyflie import read_crazyflie
from swarm.flight.recordings.formats import Format, format_of
from swarm.flight.recordings.hits import Light, Lost
from swarm.flight.recordings.libsurvive import read_libsurvive
from swarm.flight.recordings.libsurvive_config import read_factory_stations
from swarm.flight.recordings.rotor_light import decode_rotor_log
from swarm.flight.recordings.station_terms import SweepTerms
from swarm.flight.recordings.system_config import read_system_config
from swarm.flight.recordings.trajectory import read_trajectory
from swarm.flight.recordings.windows import Windows

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
REAL = SHARED / "lighthouse-v2" / "lh2_test_cal.rec.gz"
FLIGHT = SHARED / "crazyflie" / "lh2_jitter" / "log00"
ONE_TICK = 2 * math.pi / min(TICKS.values())
"""Angle of one tick of 48 MHz [rad]."""


def write(path: Path, data: bytes | str | list[str]) -> Path:
    text = "\n".join(data) + "\n" if isinstance(data, list) else data
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def same_angles(light: Light, least: float, within: float) -> None:
    """Check that at least this share of all sweeps is there, each with the angle that was chosen."""
    hits = light.hits
    truth = np.array([ANGLES[c][k, f] for c, k, f in zip(hits.station, hits.photodiode, hits.fan, strict=True)])
    np.testing.assert_allclose(hits.angle, truth, atol=within, rtol=0)
    assert len(truth) >= least * TURNS * 8 * len(CHANNELS)
    assert light.stations() == list(CHANNELS)


def test_raw_lines_give_the_angles_to_a_tick(tmp_path: Path) -> None:
    recording = read_libsurvive(write(tmp_path / "two.rec", lines()), DEVICE)
    light = decode_rotor_log(recording.rotors)
    # Half a tick of rounding of the hit, and of the zeros before and after it.
    same_angles(light, 1, 1.5 * ONE_TICK)
    assert light.lost == Lost()
    for channel in CHANNELS:
        # The counter is 9 millionths slow; the zeros wobble by 4 ticks a turn.
        assert light.turn_s[channel] * 48e6 / TICKS[channel] - 1 == pytest.approx(-9e-6, abs=4e-6)
    assert recording.losses.sentences() == []


def test_libsurvives_own_angles_are_reproduced_from_raw_lines(tmp_path: Path) -> None:
    log = read_libsurvive(write(tmp_path / "two.rec", lines()), DEVICE).rotors
    again = decode_rotor_log(log, previous=True).hits
    columns = (log.own_channel, log.own_photodiode, log.own_tick, log.own_angle)
    own = {(c, k, t): angle for c, k, t, angle in zip(*(column.tolist() for column in columns), strict=True)}
    assert len(again.angle) == len(own)
    away = [
        abs(angle - own[int(c), int(k), float(t)])
        for c, k, t, angle in zip(again.station, again.photodiode, again.tick, again.angle, strict=True)
    ]
    # libsurvive has no turn before the first one, and this generator takes the nominal duration for it.
    assert np.mean(np.array(away) < ONE_TICK) > 1 - 1.5 / TURNS


def test_damaged_and_repeated_lines_are_counted(tmp_path: Path) -> None:
    good = lines()
    bad = [
        "1.1 OBJ W 16 0 5 0",
        "1.1 OBJ W 3 x 5 0",
        "1.1 OBJ B 3 0 5 2 0.1",
        "1.1 OBJ B 3 0 5 0 9",
        "1.1 OBJ Y 3 4294967296 0 1",
        "1.1 OBJ W 3",
        f"1.1 OBJ W 3 9 {good[40].split()[5] if ' W ' in good[40] else 5} 0",
    ]
    recording = read_libsurvive(write(tmp_path / "bad.rec", good + good[30:50] + bad), DEVICE)
    assert recording.losses.damaged == len(bad)
    assert recording.losses.repeated == 20
    same_angles(decode_rotor_log(recording.rotors), 1, 1.5 * ONE_TICK)
    assert contents(tmp_path / "bad.rec").losses == [
        f"OBJ: damaged lines, left out: {len(bad)}",
        "OBJ: lines that repeat an earlier one, left out: 20",
    ]


def test_what_is_lost_without_zeros_is_said(tmp_path: Path) -> None:
    blind = [line for line in lines() if " Y 11 " not in line]
    found = contents(write(tmp_path / "blind.rec", blind))
    assert [(row.station, row.pulses, row.angles) for row in found.rows] == [(3, TURNS, TURNS), (11, 0, TURNS)]
    assert found.losses == [f"OBJ: hits while their rotor's zero is not known, left out: {TURNS * 8}"]


def test_libsurvives_angles_alone_are_listed(tmp_path: Path) -> None:
    own = [line for line in lines() if line.split()[2] in ("CONFIG", "B")]
    first, second = contents(write(tmp_path / "own.rec", own)).rows
    assert [(row.generation, row.station, row.pulses, row.angles) for row in (first, second)] == [
        ("2.0", 3, 0, TURNS),
        ("2.0", 11, 0, TURNS),
    ]
    assert first.remark == ""
    times = [float(line.split()[0]) for line in own[1:]]
    assert (first.begin_s, first.end_s) == (min(times), max(times))


def test_zeros_alone_are_light_of_lighthouse_2(tmp_path: Path) -> None:
    zeros = [line for line in lines() if line.split()[2] in ("CONFIG", "Y")]
    (row,) = contents(write(tmp_path / "zeros.rec", zeros)).rows
    assert (row.generation, row.station, row.begin_s) == ("2.0", None, None)
    assert row.remark == "no hit with its rotor's zero"


@pytest.mark.parametrize("kept", ["W", "B", "Y"])
def test_light_of_lighthouse_2_of_any_kind_is_named(tmp_path: Path, kept: str) -> None:
    some = [line for line in lines() if line.split()[2] in ("CONFIG", kept)]
    with pytest.raises(SwarmError, match=r"'OBJ' saw Lighthouse 2\.0 stations"):
        Windows(read_libsurvive(write(tmp_path / "some.rec", some), DEVICE), 0)


def test_an_echo_is_kept_and_counted_and_adds_no_turn(tmp_path: Path) -> None:
    echoes = []
    for line in lines():
        word = line.split()
        if word[2:5] == ["W", "3", "2"]:
            word[5] = str((int(word[5]) + 900) % 2**32)
            echoes.append(" ".join(word))
    found = contents(write(tmp_path / "echo.rec", lines() + echoes))
    assert [(row.station, row.pulses) for row in found.rows] == [(3, TURNS), (11, TURNS)]
    assert found.losses == [f"OBJ: second hits of a photodiode in one sweep, kept: {2 * TURNS}"]


def test_a_truncated_file_is_read_as_far_as_it_is_good(tmp_path: Path) -> None:
    packed = gzip.compress("\n".join(lines()).encode())
    found = contents(write(tmp_path / "cut.rec.gz", packed[: len(packed) // 2]))
    assert found.format == Format.LIBSURVIVE
    assert all(0 < row.pulses < TURNS for row in found.rows)
    assert "truncated gzip file" in found.losses[0]


@pytest.mark.parametrize("version", [1, 2])
def test_a_crazyflies_pulses_give_the_angles(tmp_path: Path, version: int) -> None:
    log = read_crazyflie(write(tmp_path / "log00", crazyflie_log(version)))
    assert (log.version, log.lost, log.damaged) == (version, "", 0)
    light = log.light()
    # Each zero is known to 5 ticks of 48 MHz; the last turn's duration, which no zero ends, differs from the mean.
    last = {c: light.hits.tick[light.hits.station == c].max() - TICKS[c] / 4 for c in CHANNELS}
    ended = light.hits.tick < np.array([last[c] for c in light.hits.station.tolist()])
    same_angles(light._replace(hits=light.hits.of(ended)), 0.9, 6 * ONE_TICK)
    assert light.generation == "2.0"
    assert light.lost.channel == 0
    np.testing.assert_allclose(log.inertial.rate[0], [math.pi / 2, 0, -math.pi / 4])
    np.testing.assert_allclose(log.inertial.acceleration[0], [0, 0, 9.80665])
    np.testing.assert_allclose(np.diff(log.mark_s), 0.39 * 0.989, atol=2e-3)


def test_a_crazyflies_own_angles_serve_where_pulses_tell_no_zero(tmp_path: Path) -> None:
    log = read_crazyflie(write(tmp_path / "log01", crazyflie_log(frames=False)))
    light = log.light("2.0")
    same_angles(light, 1, 1e-7)
    assert light.generation == "2.0"


def test_a_damaged_log_keeps_what_is_good(tmp_path: Path) -> None:
    data = crazyflie_log()
    whole = read_crazyflie(write(tmp_path / "whole", data))
    cut = read_crazyflie(write(tmp_path / "cut", data[: len(data) // 2]))
    assert "truncated" in cut.lost or "checksum" in cut.lost
    count = len(cut.frames.tick)
    assert 0.4 < count / len(whole.frames.tick) < 0.6
    np.testing.assert_array_equal(cut.frames.tick, whole.frames.tick[:count])
    flipped = bytearray(data)
    flipped[-40] ^= 1
    assert "checksum" in read_crazyflie(write(tmp_path / "flip", bytes(flipped))).lost
    event = data.index(struct.pack("<H", 2), len(data) // 2)
    flipped = bytearray(data)
    flipped[event : event + 2] = b"\x77\x77"
    other = read_crazyflie(write(tmp_path / "other", bytes(flipped)))
    assert other.lost


def test_negative_values_of_signed_variables_are_damage(tmp_path: Path) -> None:
    types = tuple(
        (number, name, tuple(text.replace("(B)", "(b)").replace("(I)", "(i)") for text in variables))
        for number, name, variables in TYPES
    )
    negative: list[tuple[float, int, tuple[float, ...]]] = [
        *((0.2, 2, values) for values in ((-1, 3, 0, 5), (0, -1, 0, 5), (0, 3, -4, 5), (0, 3, 0, -5))),
        *((0.2, 1, values) for values in ((-1, 3, 0, 0.1, 0.1), (0, -3, 0, 0.1, 0.1), (0, 3, -1, 0.1, 0.1))),
    ]
    forms = {number: form.lower() for number, form in FORMS.items()}
    log = read_crazyflie(write(tmp_path / "log00", crazyflie_log(types=types, forms=forms, more=negative)))
    good = read_crazyflie(write(tmp_path / "good", crazyflie_log()))
    assert (log.damaged, log.lost) == (len(negative), "")
    for ours, theirs in zip((*log.frames, *log.angles), (*good.frames, *good.angles), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_two_types_of_event_of_one_name_are_read_each_by_its_own_variables(tmp_path: Path) -> None:
    types = (*TYPES, (7, "lhAngle", ("angle(f)", "sweep(B)", "sensor(B)", "basestation(B)")))
    data = crazyflie_log(types=types, forms={**FORMS, 7: "fBBB"}, more=[(0.2, 7, (0.25, 1, 2, 11))])
    log = read_crazyflie(write(tmp_path / "log00", data))
    assert log.damaged == 0
    (other,) = np.flatnonzero(log.angles.angle == 0.25)
    assert [int(column[other]) for column in log.angles[:3]] == [11, 1, 2]


@pytest.mark.parametrize("at_s", [0.0, 0.05])
def test_a_damaged_time_far_ahead_costs_one_event(tmp_path: Path, at_s: float) -> None:
    data = crazyflie_log()
    event = struct.pack("<HQ", 65535, round((11 + at_s * SLOW) * 1e6))
    assert data.count(event) == 1
    good = read_crazyflie(write(tmp_path / "good", data))
    far = struct.pack("<HQ", 65535, 10**15)
    log = read_crazyflie(write(tmp_path / "far", data.replace(event, far)))
    assert log.damaged == 1
    assert len(log.inertial.time_s) == len(good.inertial.time_s) - 1
    np.testing.assert_array_equal(log.frames.tick, good.frames.tick)
    assert log.end_s == good.end_s


@pytest.mark.parametrize("later", [(30.0,), (30.0, 30.1), (30.0, 60.0, 90.0)])
def test_a_pause_in_a_log_is_no_damage(tmp_path: Path, later: tuple[float, ...]) -> None:
    log = read_crazyflie(write(tmp_path / "log00", crazyflie_log(more=[(time_s, 0, (1,)) for time_s in later])))
    assert log.damaged == 0
    np.testing.assert_allclose(log.mark_s[2:], 11 + np.array(later) * SLOW, atol=2e-6)
    assert log.end_s == log.mark_s[-1]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\xbc", "its table of events is not whole"),
        (struct.pack("<BHH", 0xBC, 3, 0), "its version is 3, and 1 and 2 are known"),
        (struct.pack("<BHH", 0xBC, 2, 9), "its table of events is not whole"),
        (struct.pack("<BHHH", 0xBC, 2, 1, 0) + b"\xff\0\0\0", "names that are no text"),
        (struct.pack("<BHHH", 0xBC, 2, 1, 0) + b"a\0\x01\0b(s)\0", "event 'a' has a variable without a known type"),
        (crazyflie_log(types=((*TYPES[0][:2], ("mod(B)",)), *TYPES[1:])), "no variable 'mode'; did you mean 'mod'"),
    ],
)
def test_a_log_that_is_none_says_why(tmp_path: Path, data: bytes, message: str) -> None:
    with pytest.raises(SwarmError, match=message.replace("(", r"\(")):
        read_crazyflie(write(tmp_path / "log", data))


def test_an_empty_log_is_a_log(tmp_path: Path) -> None:
    empty = struct.pack("<BHH", 0xBC, 2, 0)
    log = read_crazyflie(write(tmp_path / "log", empty + struct.pack("<I", zlib.crc32(empty))))
    assert (log.lost, log.counts) == ("", {})
    assert contents(tmp_path / "log").facts[0] == "event log, version 2: no event"


def test_a_system_configuration_beside_a_log_is_taken(tmp_path: Path) -> None:
    write(tmp_path / "system-config.yaml", system_config(1))
    found = contents(write(tmp_path / "log00", crazyflie_log(frames=False)))
    assert {row.generation for row in found.rows} == {"1.0"}
    assert any("system-config.yaml is taken" in fact for fact in found.facts)
    config = read_system_config(tmp_path / "system-config.yaml")
    terms = config.stations[11].terms
    assert terms is not None
    assert terms[0].ogee_magnitude == -0.3
    assert config.stations[11].identity == "4000000011"
    assert contents(tmp_path / "system-config.yaml").format == Format.SYSTEM_CONFIG


FACTORY = """"v":"0"
"lighthouse0":{
"index":"0"
"id":"-623023837"
"mode":"11"
"pose":["0.8","1.0","0.2","1","0","0","0"]
"fcalphase":["0","-0.007"]
"fcaltilt":["-0.047","0.046"]
"fcalcurve":["0.15","0.33"]
"fcalgibpha":["2.4","2.7"]
"fcalgibmag":["-0.0044","-0.0036"]
"fcalogeephase":["0.48","0.97"]
"fcalogeemag":["-0.18","-0.22"]
"OOTXSet":"1"
}
"lighthouse1":{
"id":"5"
"OOTXSet":"0"
"PositionSet":"0"
}
"""


def test_libsurvives_configuration_has_the_terms_of_both_planes(tmp_path: Path) -> None:
    first, second = read_factory_stations(write(tmp_path / "two.rec.json", FACTORY))
    assert (first.number, first.channel, first.identity) == (0, 11, "3671943459")
    assert first.terms == (
        SweepTerms(0.0, -0.047, 0.15, 2.4, -0.0044, 0.48, -0.18),
        SweepTerms(-0.007, 0.046, 0.33, 2.7, -0.0036, 0.97, -0.22),
    )
    assert first.pose is not None
    assert (second.channel, second.terms, second.pose) == (None, None, None)
    facts = contents(write(tmp_path / "two.rec", lines())).facts
    assert "two.rec.json: station 0, mode 11: a pose and a calibration" in facts
    assert "two.rec.json: station 1: nothing" in facts


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"mode":"11"', '"mode":"16"', "lighthouse0: mode must be a channel, 0 to 15, not '16'"),
        ('["0.15","0.33"]', '["0.15"]', "lighthouse0: fcalcurve must be 2 numbers"),
        ('"lighthouse', '"house', "no station, such as 'lighthouse0', is in the file"),
    ],
)
def test_a_damaged_configuration_is_a_note_beside_a_good_recording(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    file = write(tmp_path / "two.rec.json", FACTORY.replace(old, new))
    with pytest.raises(SwarmError, match=message):
        read_factory_stations(file)
    found = contents(write(tmp_path / "two.rec", lines()))
    assert len(found.rows) == len(CHANNELS)
    assert message in found.losses[-1]


def test_a_damaged_system_configuration_is_a_note_beside_a_good_log(tmp_path: Path) -> None:
    write(tmp_path / "system-config.yaml", "calibs: [")
    found = contents(write(tmp_path / "log00", crazyflie_log()))
    assert len(found.rows) == len(CHANNELS)
    assert "system-config.yaml, line 1: not a system configuration, or damaged" in found.losses[0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("tilt: -0.05}", "tilt: x}", "calibs, 3, sweep 0: tilt must be a finite number, not 'x'"),
        ("curve:", "curv:", "curve is missing; did you mean 'curv'"),
        ("systemType: 2", "systemType: 3", "systemType must be 1 or 2, not 3"),
        ("[0, 0, 1]]", "[0, 0, 2]]", "geos, 3: rotation is no rotation matrix"),
        ("  3:", "  99:", "calibs: a station's number is 0 to 15, not 99"),
        ("calibs:", "calibs: [", r"line \d+: not a system configuration, or damaged"),
        ("version: '1'", "version: &a [1]\nb: *a", "line 22: not a system configuration, or damaged: an alias"),
    ],
)
def test_a_damaged_system_configuration_says_where(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = write(tmp_path / "system-config.yaml", system_config().replace(old, new, 1))
    with pytest.raises(SwarmError, match=message) as caught:
        read_system_config(file)
    assert str(file) in str(caught.value)


TIME = np.arange(40) / 100
WAY = np.stack([TIME, 2 * TIME, 1 - TIME], axis=1)


@pytest.mark.parametrize("size", [1.0, 1e3, 1e6, 1e9])
def test_motion_capture_arrays_of_any_unit_are_read(tmp_path: Path, size: float) -> None:
    table = np.column_stack([(5 + TIME) * size, WAY])
    table[:7, 1:] = np.nan
    np.save(tmp_path / "mocap.npy", table)
    found = read_trajectory(tmp_path / "mocap.npy")
    np.testing.assert_allclose(found.time_s, 5 + TIME[7:], rtol=1e-12)
    np.testing.assert_allclose(found.position, WAY[7:])
    assert (found.unseen, found.damaged) == (7, 0)
    assert found.rate_hz == pytest.approx(100)


TURNED = "0.5 -0.5 0.5 0.5"


@pytest.mark.parametrize(
    "text",
    [
        [f"{t} {2 * t} 3 4 {TURNED}" for t in TIME.tolist()],
        ["# time x y z qx qy qz qw", *(f"{t} {2 * t} 3 4 {TURNED}" for t in TIME.tolist())],
        ["time_ms,x,y,z,qx,qy,qz,qw", *(f"{t * 1e3},{2 * t},3,4,{TURNED.replace(' ', ',')}" for t in TIME.tolist())],
        ["# by hand", "", "t;x;y;z;qx;qy;qz;qw", *(f"{t};{2 * t};3;4;0.5;-0.5;0.5;0.5" for t in TIME.tolist())],
        ["t;name;z;y;x;qw;qz;qy;qx", *(f"{t};1;4;3;{2 * t};0.5;0.5;-0.5;0.5" for t in TIME.tolist())],
        [
            "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []",
            *(f"{t * 1e9:.0f},{2 * t},3,4,0.5,0.5,-0.5,0.5" for t in TIME.tolist()),
        ],
    ],
    ids=["tum", "tum with a comment", "csv", "head after a comment", "other order", "euroc"],
)
def test_text_trajectories_are_read(tmp_path: Path, text: list[str]) -> None:
    file = write(tmp_path / "truth", text)
    assert format_of(file) == Format.TRAJECTORY
    found = read_trajectory(file)
    np.testing.assert_allclose(found.time_s, TIME, atol=1e-9)
    np.testing.assert_allclose(found.position, np.column_stack([2 * TIME, 0 * TIME + 3, 0 * TIME + 4]))
    np.testing.assert_allclose(found.quaternion, np.tile([0.5, 0.5, -0.5, 0.5], (40, 1)))
    assert found.damaged == 0


def test_damaged_rows_of_a_trajectory_are_counted(tmp_path: Path) -> None:
    good = [f"{t} 1 2 3" for t in TIME.tolist()]
    text = [*good[:10], "x", "1e300 1 2 3", *good[10:20], good[3], "0.1951 1e9 0 0", *good[20:], "0.5 1 2"]
    found = read_trajectory(write(tmp_path / "t.txt", text))
    np.testing.assert_allclose(found.time_s, TIME)
    assert found.damaged == 5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no line has a time and a position"),
        ("t,x,y\n1,2,3\n", "no line has"),
        ("time,x,y,w\n1,2,3,4\n", "no column 'z'"),
        ("time_min,x,y,z\n1,2,3,4\n", "the first column is 'time_min'; it must be the time"),
        ("time [h],x,y,z\n1,2,3,4\n", "the unit of time 'h' is not known"),
        ("1 nan nan nan\n2 nan nan nan\n", "none of 2 rows has a time that grows and a position"),
    ],
)
def test_a_trajectory_that_is_none_says_why(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SwarmError, match=message):
        read_trajectory(write(tmp_path / "t.csv", text))


@pytest.mark.parametrize("array", [np.zeros((3, 5)), np.zeros(4), np.array([["a"] * 4]), np.zeros((0, 4))])
def test_an_array_that_is_no_trajectory_says_why(tmp_path: Path, array: np.ndarray) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(SwarmError, match="a trajectory"):
        read_trajectory(tmp_path / "a.npy")


def test_what_cannot_be_replayed_is_one_message(tmp_path: Path) -> None:
    np.save(tmp_path / "mocap.npy", np.column_stack([TIME, WAY]))
    mocap, log = tmp_path / "mocap.npy", write(tmp_path / "log00", crazyflie_log())
    recording = write(tmp_path / "two.rec", lines())
    for file, extra, message in (
        (mocap, [], "a trajectory, which goes with a recording but is none"),
        (log, ["--object", "HMD"], "no object 'HMD' in this log: its only one is 'Crazyflie'"),
        (log, ["--lighthouse", "9"], "saw no light of station 9; it saw stations 3, 11"),
        (recording, ["--lighthouse", "4"], "saw no light of station 4; it saw stations 3, 11"),
        (recording, ["--stations", str(tmp_path / "none.toml")], "none.toml"),
    ):
        result = CliRunner().invoke(app, ["replay", str(file), "--out", str(tmp_path / "run"), *extra])
        assert result.exit_code == 2
        assert message in " ".join(result.output.split())
        assert not (tmp_path / "run").exists()
        assert CliRunner().invoke(app, ["replay", str(file), "--list"]).exit_code == 0


# Anything at all.


def said(file: Path) -> str:
    """Return what is wrong with the answer to a file, empty if nothing is."""
    try:
        found = contents(file)
    except SwarmError as error:
        return "" if str(file) in str(error) and not FOREIGN.search(str(error)) else str(error)
    return "" if all(row.pulses >= 0 for row in found.rows) else "negative"


def test_no_damage_of_lighthouse_2_lines_ends_in_a_traceback(tmp_path: Path) -> None:
    text = "\n".join(lines())
    for number in range(20):
        file = write(tmp_path / "m.rec", recording_mutant(text, number))
        assert said(file) == "", number


def test_no_damage_of_an_event_log_ends_in_a_traceback(tmp_path: Path) -> None:
    data, read = crazyflie_log(), 0
    for number in range(80):
        file = write(tmp_path / "log", event_log_mutant(data, number))
        assert said(file) == "", number
        read += format_of(file) == Format.CRAZYFLIE
    assert read > 40


def test_no_damage_of_an_array_ends_in_a_traceback(tmp_path: Path) -> None:
    np.save(tmp_path / "good.npy", np.column_stack([TIME, WAY]))
    data = (tmp_path / "good.npy").read_bytes()
    for number in range(120):
        assert said(write(tmp_path / "m.npy", event_log_mutant(data, number))) == "", number


def test_no_damage_of_a_text_ends_in_a_traceback(tmp_path: Path) -> None:
    texts = [
        system_config(),
        "\n".join(f"{t} 1 2 3 {TURNED}" for t in TIME.tolist()),
        "time_us,x,y,z\n" + "\n".join(f"{t * 1e6},1,2,3" for t in TIME.tolist()),
    ]
    for number in range(120):
        file = write(tmp_path / "m", mutant(texts, number).encode("utf-8", "surrogatepass"))
        assert said(file) == "", number


# Real light, where it is there.


@pytest.mark.skipif(not REAL.is_file(), reason=f"{REAL} is not here")
def test_the_real_recording_is_decoded_as_libsurvive_does() -> None:
    log = read_libsurvive(REAL, "T20").rotors
    again = decode_rotor_log(log, previous=True)
    assert again.lost == Lost()
    columns = (again.hits.station, again.hits.photodiode, again.hits.tick, again.hits.fan, again.hits.angle)
    found = {(c, k, tick): (fan, angle) for c, k, tick, fan, angle in zip(*(x.tolist() for x in columns), strict=True)}
    own = zip(*(x.tolist() for x in (log.own_channel, log.own_photodiode, log.own_tick)), strict=True)
    fan, angle = np.array([found[hit] for hit in own]).T
    assert np.abs(angle - log.own_angle).max() < 2 * math.pi / 959_000
    np.testing.assert_array_equal(fan, log.own_plane)


@pytest.mark.skipif(not FLIGHT.is_file(), reason=f"{FLIGHT} is not here")
def test_the_real_log_is_read_whole_and_agrees_with_the_firmware() -> None:
    log = read_crazyflie(FLIGHT)
    assert (log.lost, log.damaged, log.counts["lhUartFrame"]) == ("", 0, 11409)
    light = log.light()
    assert len(light.hits.tick) > 0.95 * len(log.frames.tick)
    for station in (0, 1):
        for fan in (0, 1):
            ours, theirs = (
                np.median(hits.angle[(hits.station == station) & (hits.fan == fan) & (hits.photodiode == 0)])
                for hits in (light.hits, log.angles)
            )
            # The firmware takes the nominal period, and the zero of one pulse to four ticks of 24 MHz.
            assert ours == pytest.approx(theirs, abs=60e-6)
