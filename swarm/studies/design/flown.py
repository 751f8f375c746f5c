"""The scene of a scenario, as one of its craft flies through it: the poses that occur, and all that shades the light.

The scenario is flown once by the truth, without faults. Of the flight, moments are kept that are evenly apart in what
the light sees of the craft: the way relative to the distance, and the turn, added up. A pose of a layout is one of
these moments, the craft's attitude turned and its position moved at random, as those of a craft are that steers by an
estimate; the other craft are where they are then.
"""

import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.flight import Flight
from swarm.scenario import Scenario
from swarm.studies.design.even import even_spreads
from swarm.studies.design.poses import Poses
from swarm.world.hull import Hull
from swarm.world.refit import refit
from swarm.world.world import World

MOMENTS = 300
OFF_M, OFF_SHARE = 0.01, 0.03
"""Largest displacement from the flown path: so much, and so much of the distance from the lighthouse."""
STAND_INS = 4
"""Photodiodes of the craft while it is flown by the truth: the least that a craft may have."""


class Flown(NamedTuple):
    """M moments of a flight of C craft.

    craft: index of the craft that the layout is for. world: the scene. position: (M, C, 3) [m]. quaternion: (M, C, 4).
    turn_rad: largest turn away from the flown attitude.
    """

    craft: int
    world: World
    position: Floats
    quaternion: Floats
    turn_rad: float

    def poses(self, count: int, seed: int) -> Poses:
        """Return poses of the craft around its flown ones, evenly over the moments."""
        rng = np.random.default_rng([seed, 17])
        moment = np.arange(count) * len(self.position) // count
        turn = _in_ball(rng, count) * self.turn_rad
        rotation = rot.exp(turn) @ rot.matrix_from_quaternion(self.quaternion[moment, self.craft])
        position = self.position[moment, self.craft]
        reach = OFF_M + OFF_SHARE * np.linalg.norm(position, axis=1)
        return Poses(rotation, position + reach[:, None] * _in_ball(rng, count), moment)


def flown(settings: Scenario, hull: Hull, name: str | None, turn_rad: float) -> Flown:
    """Fly a scenario by the truth, and return its scene for one craft.

    Args:
        settings: The scenario.
        hull: Hull of that craft; it takes the place of the scenario's model.
        name: Name of the craft; None: the only one that carries photodiodes and navigates.
        turn_rad: Largest turn away from the flown attitude [rad].

    Raises:
        SwarmError: The scenario has no such craft, or cannot fly with this hull.
    """
    index = chosen_craft(settings, name)
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / f"{hull.path.stem}.xml"
        places = hull.mounts(400)
        stand_ins = places.at(even_spreads(places.point_m, STAND_INS, 1)[0])
        model.write_text(refit(hull.path, stand_ins, model, "stand-ins"), encoding="utf-8")
        flight = Flight(_by_truth(settings, index, model))
        truths = [period.truth for period in flight.fly()]
    position = np.array([truth.position for truth in truths if truth is not None])
    quaternion = np.array([truth.quaternion for truth in truths if truth is not None])
    kept = _moments(position[:, index], quaternion[:, index])
    return Flown(index, flight.world, position[kept], quaternion[kept], turn_rad)


def chosen_craft(settings: Scenario, name: str | None) -> int:
    """Return the index of the craft of this name; None: of the only one that sees the light. Raises SwarmError."""
    names = settings.craft_names
    if name is not None:
        if name not in names:
            raise SwarmError(f"--craft {name}: scenario {settings.name} has no such craft{did_you_mean(name, names)}")
        return names.index(name)
    able = [i for i, (_, table) in enumerate(settings.tables) if table.lighthouse and not table.passive]
    if len(able) != 1:
        told = ", ".join(names[i] for i in able) or "none"
        raise SwarmError(f"--scene {settings.name}: for which craft? give --craft; those that see the light: {told}")
    return able[0]


def _by_truth(settings: Scenario, index: int, model: Path) -> Scenario:
    """Return the scenario with all craft steered by the truth, nothing failing, and the hull on its craft."""

    def told(mine: bool) -> dict[str, object]:
        return {"feedback": "truth"} | ({"model": str(model), "lighthouse": True} if mine else {})

    count = settings.swarm.count
    swarm = settings.swarm.model_copy(update=told(index < count))
    craft = tuple(table.model_copy(update=told(index == i)) for i, table in enumerate(settings.craft, start=count))
    return settings.model_copy(update={"swarm": swarm, "craft": craft, "fault": (), "criteria": ()})


def _moments(position: Floats, quaternion: Floats) -> Ints:
    """Return the indices of moments of a path (T, 3), (T, 4), evenly apart in what the light sees."""
    way = np.linalg.norm(np.diff(position, axis=0), axis=1) / np.linalg.norm(position[1:], axis=1)
    rotation = rot.matrix_from_quaternion(quaternion)
    change = np.concatenate([[0.0], np.cumsum(way + rot.angle_between(rotation[1:], rotation[:-1]))])
    at = np.searchsorted(change, np.linspace(0, change[-1], MOMENTS))
    return np.unique(np.minimum(at, len(position) - 1))


def _in_ball(rng: np.random.Generator, count: int) -> Floats:
    """Return points (count, 3) uniform in the unit ball."""
    direction = rng.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction * np.cbrt(rng.random((count, 1)))
