"""The file of stations: what is written is read to the bit, and mistakes are named."""

from pathlib import Path

import numpy as np
import pytest

from estimators import rotation as rot
from estimators.lighthouse.sweep import FanErrors, measured_angles
from estimators.lighthouse.tilted import TiltedErrors
from swarm.errors import SwarmError
from swarm.flight.recordings.stations_file import PlacedStation, PlacedStations, read_stations, stations_text

FIRST = FanErrors(0.0586, -0.0013, -0.0019, 2.89, 0.0047)
TILTED = TiltedErrors(0.003, 0.05, 0.3, 2.1, -0.004, 1.2, -0.3)


def placed() -> PlacedStations:
    rotation = rot.exp(np.array([[0.3, -0.7, 1.1], [-2.0, 0.4, 0.1]]))
    one = PlacedStation(
        'the "old" one', 0, "1.0", "3428821765", rotation[0], np.array([1 / 3, -2.0, 1e-9]), (FIRST, FanErrors())
    )
    sigma = np.array([1e-3, 2e-3, 3e-3])
    two = PlacedStation("2", 11, "2.0", None, rotation[1], np.zeros(3), (TILTED, TILTED), sigma / 7, sigma)
    two = two._replace(covariance=np.outer(np.arange(6), np.arange(6)) + np.eye(6) / 3, systematic_rad=1e-4 / 3)
    return PlacedStations("mocap00.npy", (one, two))


def write(folder: Path, text: str) -> Path:
    file = folder / "stations.toml"
    file.write_text(text)
    return file


def test_a_file_reads_as_it_was_written(tmp_path: Path) -> None:
    written = placed()
    found = read_stations(write(tmp_path, stations_text(written, ["from", "a test"], ["", "it moved"])))
    assert found.frame == written.frame
    for a, b in zip(found.stations, written.stations, strict=True):
        assert (a.name, a.number, a.generation, a.identity, a.errors) == (
            *(b.name, b.number, b.generation, b.identity, b.errors),
        )
        np.testing.assert_array_equal(a.position, b.position)
        # Through a unit quaternion and back: rounding of a few units in the last place.
        np.testing.assert_allclose(a.rotation, b.rotation, atol=1e-15)
    assert found.stations[0].position_sigma is None
    np.testing.assert_array_equal(found.stations[1].rotation_sigma, written.stations[1].rotation_sigma)
    np.testing.assert_array_equal(found.stations[1].pose_covariance, written.stations[1].covariance)
    assert found.stations[1].systematic_rad == written.stations[1].systematic_rad
    np.testing.assert_array_equal(found.stations[0].pose_covariance, np.zeros((6, 6)))
    assert found.numbered(11) is found.stations[1]
    assert found.numbered(3) is None
    point = np.array([[0.2, -0.1, 2.0]])
    for a, b in zip(found.stations, written.stations, strict=True):
        np.testing.assert_array_equal(measured_angles(point, a.fans), measured_angles(point, b.station.fans))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("number = 11", "number = 16"), ["[[station]] 2", "number", "0 to 15", "16"]),
        (("number = 11", "number = 0"), ["[[station]] 2", "number 0", 'the "old" one']),
        (("number = 11", "number = true"), ["number", "True"]),
        (("covariance = [", "covariance = [[1.0],"), ["[[station]] 2", "covariance", "6 x 6"]),
        (("systematic_rad = 3", "systematic_rad = -3"), ["systematic_rad", "0 to 1"]),
        (('generation = "2.0"', 'generation = "3.0"'), ["generation", "'1.0' or '2.0'", "'3.0'"]),
        (("position_m = [0.0, 0.0, 0.0]", "position_m = [0.0, 0.0]"), ["position_m", "3 numbers"]),
        (("position_m = [0.0, 0.0, 0.0]", "postion_m = [0.0, 0.0, 0.0]"), ["postion_m", "did you mean 'position_m'"]),
        (("position_m = [0.0, 0.0, 0.0]", 'position_m = "here"'), ["position_m", "here"]),
        (("position_m = [0.0, 0.0, 0.0]", "position_m = [0.0, 0.0, nan]"), ["position_m", "nan"]),
        (("position_sigma_m = [0.001", "position_sigma_m = [-0.001"), ["position_sigma_m", "negative"]),
        (("quaternion_wxyz = [", "quaternion_wxyz = [3.0, 4.0, 0.0, 0.0] # ["), ["quaternion_wxyz", "length 1", "5"]),
        (("ogee_magnitude = -0.3", "ogre_magnitude = -0.3"), ["fan_0", "ogre_magnitude", "'ogee_magnitude'"]),
        (("ogee_magnitude = -0.3", "ogee_magnitude = inf"), ["fan_0", "ogee_magnitude", "finite"]),
        (('frame = "mocap00.npy"', "frame = 3"), ["frame", "3"]),
        (("[[station]]", "[[station]"), ["TOML"]),
    ],
)
def test_a_mistake_is_named(tmp_path: Path, change: tuple[str, str], words: list[str]) -> None:
    text = stations_text(placed())
    assert change[0] in text
    file = write(tmp_path, text.replace(*change))
    with pytest.raises(SwarmError) as caught:
        read_stations(file)
    for word in (str(file), *words):
        assert word in str(caught.value)


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    for text in ("", "[station]\nnumber = 1\n", "\0", "station = 3\n", "station = []\n"):
        with pytest.raises(SwarmError, match=r"stations\.toml"):
            read_stations(write(tmp_path, text))
    with pytest.raises(SwarmError, match="unknown key 'stations'; did you mean 'station'"):
        read_stations(write(tmp_path, "[[stations]]\nnumber = 1\n"))
    with pytest.raises(SwarmError, match=r"none\.toml"):
        read_stations(tmp_path / "none.toml")
