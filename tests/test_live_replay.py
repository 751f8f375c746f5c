"""Replay of lines as they come through a pipe: the rows of the file, and every way in which lines begin and end."""

import gzip
import json
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import takewhile

import made_recording
import numpy as np
import pytest

import swarm
from swarm.assets import recordings
from swarm.cli.terminal import ending_once
from swarm.errors import SwarmError
from swarm.flight.recordings.latency import Latency
from swarm.flight.recordings.libsurvive import WorldPose
from swarm.flight.recordings.live_light import LiveWindows
from swarm.flight.recordings.live_lines import LiveLines
from swarm.flight.recordings.live_start import LEARN_S, LIT, learn
from swarm.flight.recordings.object_light import ObjectLight, read_object
from swarm.flight.recordings.row_windows import RowWindows
from swarm.results.progress import Progress

FRAME_S = 1 / 30
STATIONS = (0, 1)


def lines_of(seconds: float) -> list[str]:
    """Return the first lines of the recording that comes along."""
    with gzip.open(recordings()["handheld"], "rt") as file:
        return list(takewhile(lambda line: float(line.split(None, 1)[0]) < seconds, file))


@contextmanager
def piped(text: list[str], end: threading.Event | None = None, rest: Sequence[str] = ()) -> Iterator[LiveLines]:
    """Yield lines that come through a pipe; with `end` the rest comes, or the pipe is closed, when that is set."""
    read, write = os.pipe()

    def feed() -> None:
        with suppress(BrokenPipeError), os.fdopen(write, "w") as file:
            file.writelines(text)
            file.flush()
            if end is not None:
                end.wait(60)
            for line in rest:
                file.write(line)
                file.flush()

    thread = threading.Thread(target=feed)
    thread.start()
    try:
        yield LiveLines(read)
    finally:
        if end is not None:
            end.set()
        os.close(read)
        thread.join()


def no_peer(light: ObjectLight) -> WorldPose:
    return WorldPose(np.full_like(light.peer.position, np.nan), np.full_like(light.peer.quaternion, np.nan))


def with_sensors(text: list[str]) -> list[str]:
    """Return the lines of that recording with those of a gyroscope and accelerometer among them."""
    config = json.dumps({"imu": made_recording.imu_config()})[:-1]
    text = [line.replace("CONFIG {", f"CONFIG {config}, ") for line in text]
    duration_s = float(text[-1].split(None, 1)[0]) - 1
    sensors = made_recording.inertial_lines(made_recording.Made(duration_s=duration_s, imu="i"))
    return sorted([*text, *(f"{line}\n" for line in sensors)], key=lambda line: float(line.split(None, 1)[0]))


def test_rows_of_a_pipe_are_those_of_the_file_bit_for_bit(tmp_path):
    text, end = with_sensors(lines_of(4.6)), threading.Event()
    lit_s = [(i, float(line.split(None, 1)[0])) for i, line in enumerate(text) if line.split()[2] in LIT]
    first = next(i + 1 for i, time_s in lit_s if time_s - lit_s[0][1] >= LEARN_S)
    file = tmp_path / "short.rec"
    file.write_text("".join(text))
    whole = read_object(file, "WAND")
    nobody = np.zeros((2, whole.photodiodes.point_m.shape[1]), dtype=np.bool_)
    expected = list(RowWindows(whole, STATIONS, FRAME_S, no_peer(whole), nobody))
    with piped(text[:first], end, text[first:]) as lines:
        learnt = learn(lines, None, "pulses", None, print)
        begun = RowWindows(learnt.light, STATIONS, FRAME_S, no_peer(learnt.light), nobody)
        assert len(begun) < len(expected) - 5
        end.set()
        live = LiveWindows(lines, learnt, "pulses", begun)
        found = list(live.periods(STATIONS, nobody, no_peer))
    assert live.late == 0
    assert len(found) == len(expected) > 3.2 / FRAME_S
    for one, other in zip(found, expected, strict=True):
        assert one.time_s == other.time_s
        for mine, theirs in zip(one.light.rows, other.light.rows, strict=True):
            np.testing.assert_array_equal(mine, theirs)
    shown = [[w.light.inertial for w in windows if w.light.inertial is not None] for windows in (found, expected)]
    # The clocks of the two, a line through all lines and one that follows them, differ by microseconds.
    both = [np.array([np.concatenate(light, axis=None) for light in one]) for one in shown]
    assert np.count_nonzero(np.isfinite(both[1]).all(axis=1)) > len(expected) - 5
    np.testing.assert_allclose(both[0], both[1], atol=2e-3)


def test_a_run_of_a_pipe_that_is_stopped_is_complete_and_tells_the_garbage(tmp_path):
    text, end = lines_of(5.0), threading.Event()
    told: list[str] = []
    text[2000:2000] = ["garbage\n", "1.0 WAND C 3\n", "\x00\xff\n"]
    calibration = recordings()["handheld"].with_name("handheld.json")
    with piped(text, end) as lines:

        def stop(progress: Progress) -> None:
            # As Ctrl-C does, while the program on the other side still runs.
            if progress.time_s > 3.5:
                lines.stop()

        run = swarm.replay(
            lines, calibration=calibration, out=tmp_path / "run", record=False, progress=stop, tell=told.append
        )
        assert not end.is_set()
    assert run.status == "complete"
    assert run.telemetry["status"].to_pylist()[-1] == "tracking"
    assert "damaged lines, left out: 3" in told
    assert run.summary["live"]["damaged_lines"] == 3
    assert (tmp_path / "run" / "scenario.toml").read_text().count("swarm replay - --calibration") == 1
    columns = (np.array([run.telemetry[f"{who}_p{axis}_m"] for axis in "xyz"]) for who in ("ekf", "peer"))
    far_mm = 1e3 * np.linalg.norm(np.subtract(*columns), axis=0)
    assert np.nanmedian(far_mm) < 2.0
    assert len(far_mm) > 3.0 / FRAME_S


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ([], "standard input: no line came"),
        (["nothing of that kind\n"] * 1500, "standard input: not a libsurvive recording"),
        (["\n".join(["a b"] * 5)], "standard input: not a libsurvive recording: no object"),
        (["1.0 WAND C 1 2 3\n"], "standard input: object 'WAND': has no CONFIG line"),
        (["\xbc\x01\x00"], "a Crazyflie's event log"),
    ],
    ids=["nothing", "garbage", "short garbage", "no CONFIG", "another format"],
)
def test_lines_by_which_nothing_can_be_flown_are_one_message(text, message):
    read, write = os.pipe()
    with os.fdopen(write, "w", encoding="latin-1") as file:
        file.writelines(text)
    lines = LiveLines(read)
    with pytest.raises(SwarmError, match=message):
        learn(lines, None, "pulses", None, print)
    # Else the thread that reads may go on with the next pipe, which gets the same number.
    assert lines._thread is not None
    lines._thread.join(10)
    os.close(read)


def test_lines_that_are_stopped_before_the_first_light_are_no_error_of_theirs():
    with piped([], threading.Event()) as lines:
        threading.Timer(0.1, lines.stop).start()
        with pytest.raises(KeyboardInterrupt):
            learn(lines, None, "pulses", None, print)


def test_the_first_interrupt_ends_the_lines_and_the_second_one_stops_the_work():
    ended: list[bool] = []
    with ending_once(lambda: ended.append(True)):
        os.kill(os.getpid(), signal.SIGINT)
        assert ended == [True]
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert ended == [True]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_latencies_are_counted_from_each_line_to_the_estimate_that_it_is_in():
    latency = Latency()
    for tick in range(100):
        latency.came(tick, 10.0 + 1e-3 * tick)
    latency.told(50, 10.06, since_s=10.0)  # of the lines at 10.000 to 10.049: 60 to 11 ms
    latency.told(100, 10.11, since_s=10.08)  # of those from 10.080 on: 30 to 11 ms
    found = latency.summary()
    assert found["lines_of_light"] == 50 + 20
    taken = np.concatenate([np.arange(11, 61), np.arange(11, 31)])
    assert found["latency_median_ms"] == pytest.approx(np.median(taken), rel=0.03)
    assert found["latency_p99_ms"] == pytest.approx(np.quantile(taken, 0.99), rel=0.03)
    assert found["latency_max_ms"] == pytest.approx(60.0, rel=0.012)
    assert Latency().summary()["latency_median_ms"] is None
