"""Replay by several stations: made recordings of both generations, geometry from files, stations that are left out."""

import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import made_recording
import numpy as np
import pytest
import rerun as rr
from rows_made import BODY, room, seen, still

import swarm
from estimators.lighthouse.innovation import gathered
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.sweep import measured_angles
from estimators.lighthouse.tilted import TiltedErrors
from estimators.rotation import exp
from estimators.state import State
from swarm.assets import recordings
from swarm.flight.recordings.crazyflie import Inertial
from swarm.flight.recordings.hits import Hits, Light, Lost
from swarm.flight.recordings.libsurvive import WorldPose
from swarm.flight.recordings.object_light import ObjectLight, Pair
from swarm.flight.recordings.row_consistency import RowSample, assess_rows
from swarm.flight.recordings.row_windows import RowWindows
from swarm.flight.recordings.stations_file import PlacedStation, PlacedStations
from swarm.flight.station_replay import StationPlayback, choose_stations
from swarm.hardware import pad
from swarm.onboard.settings import Status
from swarm.results.recording.stations import Stations, fans_of, sector
from swarm.results.scene import StationScene
from swarm.scenario import for_replay

FRAME_S, PERIODS = 1 / 50, 60
NOISE = [AngleNoise(2e-5, 1e-5)] * 2


def made(generations=(2, 2), falsified: float = 0.0) -> ObjectLight:
    """Return the light of an object at rest before stations of channels 3 and 11, one sweep of each fan per period."""
    rng, stations = np.random.default_rng(1), room(generations)
    state = still(exp(np.array([[0.2, 0.1, -0.3]])), np.array([[0.1, -0.1, 0.2]]))
    parts: list[Hits] = []
    for period in range(PERIODS):
        rows = seen(stations, BODY, state, NOISE, rng)
        angle = rows.angle + falsified * ((rows.station == 0) & (rows.photodiode == 2) & (rows.fan == 1))
        tick = (period + 0.2 + 0.1 * rows.station + 0.25 * rows.fan) * FRAME_S * 48e6 + rows.photodiode
        parts.append(Hits(np.array([3, 11])[rows.station], rows.fan, rows.photodiode, tick, angle))
    hits = Hits._make(np.concatenate(column) for column in zip(*parts, strict=True))
    placed: dict[int, PlacedStation] = {}
    errors: dict[int, Pair] = {}
    for number, station in zip((3, 11), stations, strict=True):
        first, second = (fan.errors for fan in station.fans)
        assert isinstance(first, TiltedErrors)
        assert isinstance(second, TiltedErrors)
        placed[number] = PlacedStation(
            f"channel {number}", number, "2.0", str(number), station.rotation, station.position, (first, second)
        )
        errors[number] = first, second
    none = np.zeros(0)
    return ObjectLight(
        path=Path("made.rec"),
        name="OBJ",
        photodiodes=pad([BODY], [np.tile([0.0, 0.0, 1.0], (len(BODY), 1))]),
        light=Light("2.0", 1 / 48e6, hits.of(np.argsort(hits.tick, kind="stable")), Lost(), {}),
        time_0_s=0.0,
        time_1=1 / 48e6,
        placed=placed,
        errors=errors,
        identities={},
        peer_time_s=none,
        peer=WorldPose(np.zeros((0, 3)), np.zeros((0, 4))),
        inertial=Inertial(none, np.zeros((0, 3)), np.zeros((0, 3))),
        marks_s=none,
        notes=[],
    )


def playback(source: ObjectLight, lighthouse: int | None = None) -> StationPlayback:
    chosen = choose_stations(source, None, lighthouse)
    return StationPlayback(source, for_replay(Path("made.rec")), chosen, given=False)


def test_an_object_is_found_where_it_is_and_its_noise_is_told() -> None:
    replayed = playback(made())
    last = list(replayed.fly())[-1].estimate
    assert last.status[0] == Status.TRACKING
    assert last.stations is not None
    assert last.stations[0] == 2
    # Five sigma of its own covariance, which the process noise of a hand keeps above that of one period.
    assert np.linalg.norm(last.position[0] - [0.1, -0.1, 0.2]) < 5 * np.sqrt(np.trace(last.covariance[0][6:9, 6:9]))
    for noise in replayed.noise:
        # Sixty periods of some 26 spare numbers each tell a to 3 %, b of two sweeps more to 30 %.
        assert noise.own_rad == pytest.approx(2e-5, rel=0.15)
        assert noise.shared_rad < 2.5e-5
    assert not replayed.found.false.any()


def test_a_constant_reflection_is_found_before_its_station_only() -> None:
    replayed = playback(made(falsified=3e-3))
    assert np.argwhere(replayed.found.false).tolist() == [[0, 2]]
    assert any("photodiode 2 contradicts the others" in note and "channel 3" in note for note in replayed.notes)
    last = list(replayed.fly())[-1].estimate
    assert np.linalg.norm(last.position[0] - [0.1, -0.1, 0.2]) < 5 * np.sqrt(np.trace(last.covariance[0][6:9, 6:9]))


def test_stations_without_a_place_are_left_out_in_a_sentence() -> None:
    source = made()
    only = source._replace(placed={3: source.placed[3]})
    assert [placed.number for placed in choose_stations(only, None, None).placed] == [3]
    assert "station 11 is left out" in choose_stations(only, None, None).notes[0]
    nobody = choose_stations(source._replace(placed={}), None, None)
    assert not nobody.world
    assert len(nobody.placed) == 1
    assert "its frame is the world, station" in nobody.notes[0]
    # Alone at the origin, an object of eight photodiodes in space is found as well.
    one = playback(source._replace(placed={}), 3)
    assert list(one.fly())[-1].estimate.status[0] == Status.TRACKING
    assert one.scene.up == "-y"


def test_a_file_of_stations_takes_the_place_of_what_the_recording_tells() -> None:
    source = made()
    moved = source.placed[3]._replace(position=np.array([9.0, 0.0, 0.0]))
    chosen = choose_stations(source, PlacedStations("world", (moved,)), None)
    assert [placed.position[0] for placed in chosen.placed] == [9.0]
    assert chosen.notes[0] == "the file of stations takes the place of those poses and calibrations"
    assert chosen.notes[1] == "station 11 is left out: the file of stations does not tell where it stands"


def test_sweeps_are_not_divided_by_the_ends_of_periods() -> None:
    source = made()
    windows = RowWindows(source, [3, 11], 0.013, source.peer, np.zeros((2, len(BODY)), dtype=np.bool_))
    counts = []
    for window in windows:
        rows = window.light.rows
        for key in {*zip(rows.station.tolist(), rows.fan.tolist(), rows.sweep.tolist(), strict=True)}:
            counts.append(np.count_nonzero([key == k for k in zip(rows.station, rows.fan, rows.sweep, strict=True)]))
    assert set(counts) == {len(BODY)}
    assert len(counts) == 4 * PERIODS


def test_too_few_periods_tell_nothing() -> None:
    stations = room((1, 2))
    state = still(np.eye(3)[None], np.zeros((1, 3)))
    rows = seen(stations, BODY, state, NOISE, np.random.default_rng(3)).of(0)
    samples = [RowSample(rows, State._make(part[0] for part in state))] * 5
    assert assess_rows(samples, stations, BODY, NOISE).noise is None
    assert len(gathered(np.zeros(0, dtype=np.int64), type(rows)._make(part[:0] for part in rows), 1).angle) == 0


def test_a_made_recording_is_replayed_by_both_stations(tmp_path: Path) -> None:
    file = made_recording.write(tmp_path / "made.rec.gz", made_recording.lines(made_recording.Made(duration_s=3.0)))
    # libsurvive's configuration of this name is taken without being asked for.
    shutil.copy(recordings()["handheld"].with_name("handheld.json"), tmp_path / "made.rec.gz.json")
    run = swarm.replay(file, out=tmp_path / "r")
    figures = run.summary["swarm"]
    assert figures["tracking_share"] > 0.95
    # One station alone: 3 mm (tests/test_replay_consistency.py).
    assert figures["peer_position_scatter_mm"] < 1.5
    stations = np.array(run.telemetry["stations"])
    assert np.mean(stations == 2) > 0.9
    assert (run.folder / "recording.rrd").stat().st_size > 10_000


def test_stations_are_drawn_where_they_stand() -> None:
    """Coordinates of the world: the viewer leaves what has a static transform at the origin."""
    placed = made().placed
    stations = [StationScene(p.name, p.rotation, p.position, p.generation) for p in placed.values()]
    scene = SimpleNamespace(lighthouse=(), field_deg=120.0, stations=stations)
    drawn: dict[str, Any] = {}
    Stations(cast(Any, SimpleNamespace(scene=scene, reach_m=1.0))).begin(
        cast(Any, SimpleNamespace(static=drawn.__setitem__))
    )
    for station in stations:
        entity = f"world/stations/{rr.escape_entity_path_part(station.name)}"
        name = np.array(drawn[f"{entity}/name"].positions.as_arrow_array().to_pylist())
        np.testing.assert_allclose(name, [station.position], atol=1e-6)
        axes = drawn[f"{entity}/axes"]
        np.testing.assert_allclose(axes.origins.as_arrow_array().to_pylist(), [station.position] * 3, atol=1e-6)
        np.testing.assert_allclose(axes.vectors.as_arrow_array().to_pylist(), 0.08 * station.rotation.T, atol=1e-6)


@pytest.mark.parametrize("generation", ["1.0", "2.0"])
def test_drawn_planes_lie_where_the_light_is(generation: str) -> None:
    station = StationScene("a", np.eye(3), np.zeros(3), generation)
    for plane, fan in enumerate(fans_of(station)):
        points, axis = sector(fan, np.radians(100), 2.0)
        for angle in (-0.6, 0.0, 0.4):
            there = points[points[:, 2] > 0.5] @ exp(angle * axis).T
            there = there[there[:, 2] > 0.2]
            assert len(there) > 10
            np.testing.assert_allclose(measured_angles(there, fans_of(station))[:, plane], angle, atol=1e-9)
