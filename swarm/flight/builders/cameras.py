"""The pairs of cameras on board, and the craft's knowledge of them."""

import math
from math import sqrt

from estimators.state import Reference
from estimators.stereo.closed_form import FEWEST_COMMON
from swarm import random, scenario
from swarm.errors import SwarmError
from swarm.onboard.ccd import CcdCalibration
from swarm.scenario import Scenario
from swarm.sensors.ccd import Pair
from swarm.world.world import World


def cameras(settings: Scenario, world: World, station: Reference) -> list[tuple[Pair, CcdCalibration]]:
    """Return every pair of cameras, with its true properties and with those that its craft assumes.

    Args:
        settings: the scenario.
        world: the world, for the cameras and lights of the models.
        station: reference of every craft at time 0.

    Raises:
        SwarmError: a model lacks the cameras or the lights; the message names scenario, key and value.
    """
    craft, names = scenario.craft(settings), list(settings.craft_names)
    found = []
    for i, (c, key) in enumerate(zip(craft, random.keys(names), strict=True)):
        if c.ccd is None:
            continue
        target = names.index(c.ccd.target)
        where = f"scenario {settings.name}: craft[{i - settings.swarm.count}].ccd"
        if len(world.cameras[i].position_m) == 0:
            raise SwarmError(f"{where}: {c.model} has no cameras (two whose name starts with 'ccd')")
        if len(world.lights[target].point_m) < FEWEST_COMMON:
            raise SwarmError(
                f"{where}.target = {c.ccd.target!r}: {craft[target].model} has {len(world.lights[target].point_m)} "
                f"lights (sites whose name starts with 'light'), at least {FEWEST_COMMON} are needed"
            )
        true = Pair(i, key, target, world.cameras[i], world.lights[target], c.ccd)
        rounding_um = c.ccd.resolution_um / sqrt(12)
        believed_um = c.ccd.believed_noise_um or math.hypot(c.ccd.image_noise_um, rounding_um)
        known = CcdCalibration(
            i,
            true.cameras,
            true.lights.point_m,
            station.rotation[target],
            station.position[target],
            true.settings.focal_length_m,
            believed_um * 1e-6,
            c.ccd.solution == "closed-form",
        )
        found.append((true, known))
    return found
