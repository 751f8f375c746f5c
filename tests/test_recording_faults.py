"""Recordings with the faults of real ones: what is good in them is read, and what is lost is counted and said."""

import gzip
import resource
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from synthetic_recording import BEGIN, FRAMES, STATIONS, TURN, calibration_text, in_our_frame, lines, write

from swarm.errors import SwarmError
from swarm.flight.recordings.contents import contents
from swarm.flight.recordings.libsurvive import Recording, read_libsurvive, station_id
from swarm.flight.recordings.object_clock import WRAP, ObjectClock
from swarm.flight.recordings.station_calibration import read_calibration
from swarm.flight.recordings.windows import Windows

SECOND = 48_000_000


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return read_libsurvive(write(tmp_path_factory.mktemp("made") / "good.rec", lines()), "OBJ")


def same_light(one: Recording, other: Recording) -> None:
    for mine, theirs in ((one.pulses, other.pulses), (one.angles, other.angles)):
        for a, b in zip(mine, theirs, strict=True):
            assert_array_equal(a, b)
    assert_array_equal(one.peer_time_s, other.peer_time_s)


def later(line: str, seconds: float, ticks: int) -> str:
    """The same event, logged so many seconds and counted so many ticks later."""
    word = line.split()
    word[0] = f"{float(word[0]) + seconds:.6f}"
    if word[2] in ("C", "A"):
        place = {"C": 4, "A": 5}[word[2]]
        word[place] = str((int(word[place]) + ticks) % WRAP)
    return " ".join(word)


def light() -> list[str]:
    """The lines of the object's light."""
    return [line for line in lines() if line.split()[2] in ("C", "A")]


# The lines of stations.


def with_ids(first_channel: int) -> list[str]:
    """The recording with LH_POSE lines as newer versions write them: by channel, with the station's id."""
    out = [line for line in lines() if "LH_POSE" not in line]
    poses = [line.split() for line in lines() if "LH_POSE" in line]
    for word in poses:
        number = int(word[1])
        # The channels are in the other order than the numbers.
        out.append(" ".join([word[0], str(first_channel + 1 - number), *word[2:], str(-1000 - number)]))
    return out


def test_stations_with_an_id_are_matched_by_it_and_never_by_their_place(tmp_path: Path) -> None:
    text = calibration_text().replace('"PositionSet":"1"', '"PositionSet":"0"')
    for number in STATIONS:
        text = text.replace(f'"index":"{number}",', f'"index":"{number}",\n"id":"{2**32 - 1000 - number}",')
    (tmp_path / "c.json").write_text(text)
    for first_channel in (0, 1):
        made = read_libsurvive(write(tmp_path / "ids.rec", with_ids(first_channel)), "OBJ")
        assert made.losses.damaged == 0
        for number in STATIONS:
            calibration = read_calibration(tmp_path / "c.json", number)
            assert calibration.pose is None
            pose = made.station(number, calibration.identity)
            assert pose is not None
            windows = list(Windows(made, number, station=pose))
            np.testing.assert_allclose(windows[3].peer_position[0], in_our_frame(number)[1], atol=1e-6)
            assert made.station(number) is None, "an id that nobody gives matches nothing"


def test_an_id_has_one_form() -> None:
    assert station_id("-142728717") == station_id("4152238579") == station_id("LHB-F77E21F3") == "4152238579"


# The object's clock.


@pytest.mark.parametrize("dark_s", [44.0, 60.0, 89.0, 200.0, 1000.0])
def test_the_host_decides_how_often_the_counter_wrapped_in_the_dark(
    tmp_path: Path, good: Recording, dark_s: float
) -> None:
    after = [later(line, dark_s, round(dark_s * SECOND)) for line in light()]
    made = read_libsurvive(write(tmp_path / "gap.rec", lines() + after), "OBJ")
    n = len(good.pulses.rise_tick)
    assert_array_equal(made.pulses.rise_tick[:n], good.pulses.rise_tick)
    assert_array_equal(made.pulses.rise_tick[n:], good.pulses.rise_tick + round(dark_s * SECOND))
    assert made.losses.damaged == made.losses.restarts == 0


def test_a_counter_that_starts_again_is_followed(tmp_path: Path, good: Recording) -> None:
    after = [later(line, 7.0, 1000 - BEGIN) for line in light()]
    made = read_libsurvive(write(tmp_path / "again.rec", lines() + after), "OBJ")
    n = len(good.pulses.rise_tick)
    assert made.losses.restarts == 1
    assert made.losses.damaged == 0
    assert "restarts of the object's clock" in " ".join(made.losses.sentences())
    np.testing.assert_allclose(made.pulses.rise_tick[n:], good.pulses.rise_tick + 7 * SECOND, atol=0.1 * SECOND)
    assert_array_equal(np.diff(made.pulses.rise_tick[n:]), np.diff(good.pulses.rise_tick))
    windows = Windows(made, 1)
    assert len(windows) == pytest.approx(7 * 30 + FRAMES, abs=2)


@pytest.mark.parametrize("part", ["tick", "time"])
def test_damaged_ticks_and_times_are_damaged_lines_and_make_no_periods(
    tmp_path: Path, good: Recording, part: str
) -> None:
    rng = np.random.default_rng(4)
    text = []
    for i, line in enumerate(lines()):
        text.append(line)
        if i % 5 == 0 and " OBJ C " in line:
            # Three seconds away at least: nearer, a tick contradicts nothing.
            ticks = int(rng.integers(3 * SECOND, WRAP - 3 * SECOND)) if part == "tick" else 0
            seconds = 0.0 if part == "tick" else float(rng.uniform(10, 60) + 89.478 * rng.integers(0, 1_000_000))
            text.append(later(line, seconds, ticks))
    extra = len(text) - len(lines())
    made = read_libsurvive(write(tmp_path / "bad.rec", text), "OBJ")
    assert extra > 100
    assert made.losses.damaged == extra
    same_light(made, good)
    assert len(Windows(made, 1)) == FRAMES


def test_a_day_without_light_is_not_filled_with_empty_periods(tmp_path: Path) -> None:
    after = [later(line, 90_000.0, 0) for line in light()]
    with pytest.raises(
        SwarmError, match=r"no light from 1\.\d s to 90001\.\d s, longer than 3600 s: cut the recording"
    ):
        read_libsurvive(write(tmp_path / "day.rec", lines() + after), "OBJ")


def test_two_recordings_in_one_file_are_not_mixed(tmp_path: Path) -> None:
    # The host's time begins anew, the object's counter is elsewhere.
    first = [later(line, 50.0, 50 * SECOND) for line in light()]
    with pytest.raises(SwarmError, match="two recordings in one file"):
        read_libsurvive(
            write(tmp_path / "two.rec", lines()[:2] + first + [later(x, 0, 9 * SECOND) for x in light()]), "OBJ"
        )


def test_a_clock_of_three_events_is_read() -> None:
    ticks: list[int] = []
    clock = ObjectClock("x")
    for time_s, counter in ((1.0, 5), (1.001, 48_005), (1.002, WRAP // 2), (1.003, 144_005)):
        clock.add(time_s, counter, ticks.append)
    clock.close()
    assert ticks == [5, 48_005, 144_005]
    assert clock.damaged == 1


# Lines and files.


@pytest.mark.parametrize(
    "again", [lambda text: [line for line in text for _ in range(2)], lambda text: text + text], ids=["line", "file"]
)
def test_repeated_lines_are_counted_and_dropped(
    tmp_path: Path, good: Recording, again: Callable[[list[str]], list[str]]
) -> None:
    made = read_libsurvive(write(tmp_path / "dup.rec", again(lines())), "OBJ")
    same_light(made, good)
    assert made.losses.repeated == len(good.pulses.time_s) + len(good.angles.time_s) + len(good.peer_time_s)
    assert made.losses.damaged == made.losses.restarts == 0


@pytest.mark.parametrize(
    ("encoding", "mark"),
    [
        ("utf-8", b"\xef\xbb\xbf"),
        ("utf-16-le", b"\xff\xfe"),
        ("utf-16-be", b"\xfe\xff"),
        ("utf-16-le", b""),
        ("utf-32-le", b"\xff\xfe\0\0"),
    ],
)
@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_text_in_any_encoding_is_read(
    tmp_path: Path, good: Recording, encoding: str, mark: bytes, packed: bool, end: str
) -> None:
    data = mark + end.join(lines()).encode(encoding)
    path = tmp_path / "text.rec"
    path.write_bytes(gzip.compress(data, 1) if packed else data)
    made = read_libsurvive(path, "OBJ")
    same_light(made, good)
    assert made.losses.damaged == 0


@pytest.mark.parametrize("how", ["truncated", "damaged"])
def test_a_gzip_stream_that_breaks_off_keeps_what_is_good_and_says_what_is_lost(
    tmp_path: Path, good: Recording, how: str
) -> None:
    whole = bytearray(write(tmp_path / "whole.rec.gz", lines()).read_bytes())
    at = len(whole) * 2 // 3
    if how == "truncated":
        del whole[at:]
    else:
        whole[at : at + 200] = bytes(200)
    (tmp_path / "cut.rec.gz").write_bytes(whole)
    made = read_libsurvive(tmp_path / "cut.rec.gz", "OBJ")
    n = len(made.pulses.rise_tick)
    assert 0.4 * len(good.pulses.rise_tick) < n < len(good.pulses.rise_tick)
    assert how in made.losses.end
    assert "it ends within line" in made.losses.sentences()[0]
    if how == "truncated":
        assert set(made.pulses.rise_tick.tolist()) <= set(good.pulses.rise_tick.tolist())
        assert len(Windows(made, 1)) > FRAMES // 2


def test_two_gzip_files_in_one_are_read(tmp_path: Path, good: Recording) -> None:
    half = len(lines()) // 2
    parts = ["\n".join(lines()[:half]) + "\n", "\n".join(lines()[half:]) + "\n"]
    (tmp_path / "two.rec.gz").write_bytes(b"".join(gzip.compress(part.encode()) for part in parts) + bytes(600))
    made = read_libsurvive(tmp_path / "two.rec.gz", "OBJ")
    same_light(made, good)
    assert made.losses.end == ""


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("magic", [b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\x3c\x4d", b"\x0a\x0d\x0d\x0a"])
def test_a_usb_capture_is_told_from_a_recording(tmp_path: Path, magic: bytes, packed: bool) -> None:
    data = magic + bytes(range(256)) * 40
    (tmp_path / "usb.pcap").write_bytes(gzip.compress(data) if packed else data)
    with pytest.raises(SwarmError, match=r"USB capture \(pcap\).* --usbmon-playback .*usb\.pcap .*--record OUT\.rec"):
        read_libsurvive(tmp_path / "usb.pcap", "OBJ")


@pytest.mark.parametrize(("magic", "what"), [(b"PK\x03\x04", "zip"), (b"BZh9", "bzip2"), (b"\xfd7zXZ\0", "xz")])
def test_another_packing_is_named(tmp_path: Path, magic: bytes, what: str) -> None:
    (tmp_path / "a.rec").write_bytes(magic + bytes(100))
    with pytest.raises(SwarmError, match=f"{what}.*unpack it first"):
        read_libsurvive(tmp_path / "a.rec", "OBJ")


@pytest.mark.parametrize("digits", [400, 5000])
def test_a_config_beyond_all_bounds_is_damaged(tmp_path: Path, digits: int) -> None:
    for value in ("9" * digits, "[" * 100_000):
        text = [line.replace("[[0.09,", f"[[{value},") for line in lines()]
        with pytest.raises(SwarmError, match=r"line 2: CONFIG of 'OBJ'"):
            read_libsurvive(write(tmp_path / "a.rec", text), "OBJ")


@pytest.mark.parametrize("path", ["a\0b", "x" * 5000, "."])
def test_a_path_that_is_no_file_is_said(path: str) -> None:
    with pytest.raises(SwarmError):
        read_libsurvive(path, "OBJ")
    with pytest.raises(SwarmError):
        read_calibration(path)


def test_lighthouse_2_is_named(tmp_path: Path) -> None:
    head = [line for line in lines() if "CONFIG" in line]
    text = [f"{1 + i / 1000:.6f} OBJ W 10 {i % 6} {2593609211 + i * 48000} 0" for i in range(500)]
    made = read_libsurvive(write(tmp_path / "two.rec", head + text), "OBJ")
    assert len(made.rotors.hit_tick) == 500
    with pytest.raises(
        SwarmError, match=r"'OBJ' saw Lighthouse 2\.0 stations, and here only the periods of Lighthouse 1\.0 are read"
    ):
        Windows(made, 0)


def test_angles_of_lighthouse_1_beside_lighthouse_2_are_periods(tmp_path: Path) -> None:
    text = [line for line in lines() if line.split()[2] != "C" and not (" A " in line and line.split()[-1] == "1")]
    text += [f"{1 + i / 1000:.6f} OBJ W 10 {i % 6} {2593609211 + i * 48000} 0" for i in range(50)]
    made = read_libsurvive(write(tmp_path / "both.rec", text), "OBJ")
    assert len(made.rotors.hit_tick) > 0
    there = len(Windows(made, 0, "angles"))
    assert there > 0
    with pytest.raises(SwarmError, match=rf"no period of lighthouse 1 among the sweep angles .* {there}$"):
        Windows(made, 1, "angles")
    with pytest.raises(SwarmError, match="no period of lighthouse 0 among the raw pulses"):
        Windows(made, 0)


def endless(path: Path, block: bytes, times: int) -> Path:
    with gzip.open(path, "wb", 1) as file:
        for _ in range(times):
            file.write(block)
    return path


@pytest.mark.parametrize("block", [bytes(1 << 20), b"\n" * (1 << 20), b"x\n" * (1 << 19)], ids=["zeros", "blank", "x"])
@pytest.mark.parametrize("after", [False, True])
def test_endless_nonsense_is_read_in_little_memory_and_time(tmp_path: Path, block: bytes, after: bool) -> None:
    path = endless(tmp_path / "bomb.rec.gz", block, 300)
    if after:
        path.write_bytes(gzip.compress(("\n".join(lines()) + "\n").encode()) + path.read_bytes())
    before, begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    try:
        contents(path)
        read_libsurvive(path, "OBJ")
    except SwarmError as error:
        assert "not a libsurvive recording" in str(error)  # noqa: PT017
    else:
        assert after
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000, "kilobytes, of 300 megabytes"
    assert time.process_time() - begin < 20


def test_the_counter_wraps_within_the_recording(good: Recording) -> None:
    assert good.pulses.rise_tick[0] == BEGIN
    assert good.pulses.rise_tick[-1] > WRAP > BEGIN + TURN


# Anything at all.

WORDS = [
    "nan",
    "inf",
    "-1",
    "0",
    "4294967295",
    "4294967296",
    "1e308",
    "-1e308",
    "C",
    "A",
    "CONFIG",
    "{",
    "LH_POSE",
    "POSE",
    "W",
    "1_0",
    "9999999999999999999999",
]
WORDS += ["", "\0", "\ufffd", "9" * 5000, "[" * 2000]


def mutant(rng: np.random.Generator, text: bytes, packed: bytes) -> bytes:
    """A damaged recording: bytes or words replaced, a part lost, lines mixed, plain or packed."""
    kind = int(rng.integers(6))
    if kind in (0, 1):
        data = bytearray((text, packed)[kind])
        for at in rng.integers(len(data), size=int(rng.integers(1, (200, 20)[kind]))):
            data[at] = rng.integers(256)
        return bytes(data)
    if kind in (2, 3):
        data = bytearray((text, packed)[kind - 2])
        first, last = sorted(rng.integers(len(data), size=2).tolist())
        return bytes(data[:first] + data[last:])
    some = text.decode().split("\n")
    if kind == 4:
        rest = some[3:]
        rng.shuffle(rest)
        return "\n".join(some[:3] + rest[: int(rng.integers(len(rest)))]).encode()
    for at in rng.integers(len(some), size=int(rng.integers(1, 300))):
        word = some[at].split(" ")
        word[int(rng.integers(len(word)))] = WORDS[int(rng.integers(len(WORDS)))]
        some[at] = " ".join(word)
    return "\n".join(some).encode()


def test_no_damage_ends_in_a_traceback_or_in_endless_periods(tmp_path: Path) -> None:
    rng = np.random.default_rng(20)
    text = "\n".join(lines()).encode()
    packed = gzip.compress(text)
    read = 0
    for i in range(250):
        file = tmp_path / "m.rec"
        file.write_bytes(mutant(rng, text, packed))
        try:
            contents(file)
            made = read_libsurvive(file, "OBJ")
            for windows in (Windows(made, 1, "pulses"), Windows(made, 0, "angles")):
                assert len(windows) < 5000, f"mutant {i}"
                assert sum(1 for _ in windows) == len(windows)
            read += 1
        except SwarmError as error:
            assert str(file) in str(error), f"mutant {i}"  # noqa: PT017
    assert read > 80
