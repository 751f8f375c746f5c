"""`swarm survey` from end to end, and careless users; recordings in which the right answer is known."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from synthetic_room import SECOND, Room, configuration, recording_lines, relative, resting_places, room

from estimators import rotation as rot
from swarm.cli import app as cli
from swarm.flight.recordings.stations_file import PlacedStations, read_stations

WHERE = room((SECOND, SECOND))
PLACES = resting_places(np.random.default_rng(2), 4)
SHIFT = np.array([0.01, -0.02, 0.015])
"""Way by which station 11 is moved."""


class Result(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Callable:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments: str) -> Result:
        monkeypatch.setattr(sys, "argv", ["swarm", *arguments])
        return Result(cli.main(), *capsys.readouterr())

    return run


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("room") / "walk.rec"
    file.write_text("\n".join(recording_lines([WHERE] * 4, PLACES)) + "\n")
    file.with_name("walk.rec.json").write_text(configuration(WHERE))
    return file


def errors(found: PlacedStations, where: Room) -> np.ndarray:
    """Error of the second station's pose in the first one's frame, (6,)."""
    rotation = np.array([s.rotation for s in found.stations])
    turn, place = relative(rotation, np.array([s.position for s in found.stations]))
    true_turn, true_place = relative(where.rotation, where.position)
    return np.concatenate([rot.log((turn[1] @ true_turn[1].T)[None])[0], place[1] - true_place[1]])


def test_stations_are_found_and_written(command: Callable, recorded: Path, tmp_path: Path) -> None:
    done = command("survey", str(recorded))
    assert done.code == 0
    found = read_stations(tmp_path / "stations.toml")
    assert [(s.number, s.generation, s.identity) for s in found.stations] == [(3, "2.0", "1000"), (11, "2.0", "1001")]
    assert found.stations[0].position_sigma is None
    second = found.stations[1]
    assert second.position_sigma is not None
    assert second.rotation_sigma is not None
    np.testing.assert_allclose(np.array(second.errors), np.array(WHERE.errors[1]), atol=1e-9)
    sigma = np.concatenate([second.rotation_sigma, second.position_sigma])
    assert np.all(np.abs(errors(found, WHERE)) < 4 * sigma)
    assert np.linalg.norm(second.position_sigma) < 0.01
    for words in ("4 windows of light, 4 at rest and 0 of motion", "channel 3", "channel 11", "frame", "stations.toml"):
        assert words in done.out
    assert "Moved" not in done.out
    refused = command("survey", str(recorded))
    assert refused.code == 2
    assert "stations.toml" in refused.err
    assert command("survey", str(recorded), "--stations", "stations.toml", "--force").code == 0
    again = read_stations(tmp_path / "stations.toml")
    # The frame is that of the file that it began with.
    np.testing.assert_allclose(again.stations[0].position, found.stations[0].position, atol=1e-3)


def test_truth_gives_frame_and_scale(command: Callable, recorded: Path, tmp_path: Path) -> None:
    # The cameras see a marker on the object's origin, 0.9 s at each place, and nothing while it is carried.
    t = np.concatenate([np.arange(0.02, 0.86, 0.01) + 0.9 * n for n in range(4)])
    turn = rot.exp(np.array([[0.2, -0.4, 1.0]]))[0]
    place = np.array([PLACES[int(x / 0.9)][1] for x in t]) @ turn.T + [5.0, 6.0, 7.0]
    np.save(tmp_path / "mocap.npy", np.column_stack([1000 * (t + 40), place]))
    done = command("survey", str(recorded), "--truth", "mocap.npy")
    assert done.code == 0, done.err
    assert "Frame: mocap.npy" in done.out
    found = read_stations(tmp_path / "stations.toml")
    # Steps of a metre at known instants align the clocks; the marker's place is free within its prior of 30 mm, so
    # that four places give the frame to some millimetres.
    for station, true_place in zip(found.stations, WHERE.position, strict=True):
        np.testing.assert_allclose(station.position, turn @ true_place + [5.0, 6.0, 7.0], atol=0.02)
    far = np.linalg.norm(found.stations[1].position - found.stations[0].position)
    assert far == pytest.approx(np.linalg.norm(WHERE.position[1] - WHERE.position[0]), abs=0.006)


def test_a_station_that_was_moved_is_named(command: Callable, tmp_path: Path) -> None:
    after = WHERE._replace(position=WHERE.position + np.array([[0, 0, 0], [1, 1, 1]]) * SHIFT)
    # The object stays at the second place while the station is moved.
    places = [PLACES[0], PLACES[1], PLACES[1], PLACES[2]]
    file = tmp_path / "walk.rec"
    file.write_text("\n".join(recording_lines([WHERE, WHERE, after, after], places)) + "\n")
    file.with_name("walk.rec.json").write_text(configuration(WHERE))
    done = command("survey", "walk.rec")
    assert done.code == 0
    assert "Moved: channel 11 was moved before 1.8 s of walk.rec: by" in done.out
    found = read_stations(tmp_path / "stations.toml")
    sigma = np.concatenate([found.stations[1].rotation_sigma, found.stations[1].position_sigma])
    assert np.all(np.abs(errors(found, after)) < 4.5 * sigma)
    assert "was moved" in (tmp_path / "stations.toml").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("none.rec",), ["none.rec"]),
        (("walk.rec", "--adjust", "tillt"), ["--adjust: 'tillt'", "did you mean 'tilt'"]),
        (("walk.rec", "--object", "OBK"), ["'OBK'", "did you mean 'OBJ'"]),
        (("walk.rec", "--truth", "a.csv", "b.csv"), ["--truth: 2 given for 1 recordings"]),
        (("a.csv",), ["a.csv", "trajectory", "no recording is given"]),
        (("walk.rec", "--truth", "walk.rec"), ["walk.rec"]),
        (("walk.rec", "--out", "nowhere/stations.toml"), ["nowhere"]),
        (("walk.rec", "--stations", "a.csv"), ["a.csv"]),
        (("one.rec",), ["one.rec", "only channel 3 was seen", "--truth"]),
        (("empty.rec",), ["empty.rec"]),
    ],
)
def test_mistakes_are_one_message(
    command: Callable, recorded: Path, tmp_path: Path, arguments: tuple[str, ...], words: list[str]
) -> None:
    lines = recorded.read_text().splitlines()
    short = lines[: len(lines) // 16]
    (tmp_path / "walk.rec").write_text("\n".join(short))
    (tmp_path / "one.rec").write_text("\n".join(line for line in short if " 11 " not in line[:30]))
    (tmp_path / "empty.rec").write_text("")
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("t,x,y,z\n0.0,1,2,3\n0.1,1,2,3\n0.2,1,2,3\n")
    done = command("survey", *arguments)
    assert done.code == 2
    assert done.err.count("error:") == 1
    for word in words:
        assert word in done.err
    assert not (tmp_path / "stations.toml").exists()
