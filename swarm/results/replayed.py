"""The object of a replay and the stations whose light it saw, in the run's folder: `inputs/replayed.json`."""

import json
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from swarm.errors import SwarmError
from swarm.results.inputs import FOLDER
from swarm.results.scene import Scene, StationScene
from swarm.user_text import parse_json, read_text

FILE = PurePosixPath(FOLDER, "replayed.json")


class Replayed(NamedTuple):
    """An object and what it stood before.

    point_m, normal: its photodiodes, (K, 3) each, in its body frame. stations: several of them; none: one, whose frame
    the poses are in. up: axis of that frame that points up, "-y" or "z".
    """

    point_m: Floats
    normal: Floats
    stations: list[StationScene]
    up: str


def replayed_bytes(scene: Scene) -> bytes:
    """Return the file of a replay's scene."""
    layout = scene.photodiodes.of(0)
    stations = [
        {
            "name": one.name,
            "generation": one.generation,
            "position_m": one.position.tolist(),
            "rotation": one.rotation.tolist(),
        }
        for one in scene.stations
    ]
    photodiodes = {"point_m": layout.point_m[0].tolist(), "normal": layout.normal[0].tolist()}
    return json.dumps({"up": scene.up, "photodiodes": photodiodes, "stations": stations}, indent=1).encode()


def read_replayed(folder: Path) -> Replayed | None:
    """Return what the folder of a replay keeps; None of any other run. Raises SwarmError where the file is damaged."""
    file = folder / FILE
    if not file.is_file():
        return None
    said = parse_json(read_text(file, str(file), "the JSON of a replay"), str(file), "the JSON of a replay")
    try:
        stations = [
            StationScene(str(one["name"]), _rows(one["rotation"]), _rows(one["position_m"]), str(one["generation"]))
            for one in said["stations"]
        ]
        point, normal = (_rows(said["photodiodes"][key]) for key in ("point_m", "normal"))
        if not point.shape == normal.shape == (len(point), 3) or not len(point):
            raise ValueError("its photodiodes are not rows of three numbers")
        if any(one.rotation.shape != (3, 3) or one.position.shape != (3,) for one in stations):
            raise ValueError("a station's pose is not three rows and three numbers")
        return Replayed(point, normal, stations, str(said["up"]))
    except (KeyError, TypeError, ValueError) as error:
        raise SwarmError(f"{file} is damaged: {error}") from None


def _rows(said: object) -> Floats:
    out: Floats = np.array(said, dtype=np.float64)
    if not np.isfinite(out).all():
        raise ValueError("a number is not finite")
    return out
