"""The faults of a run, from the scenario's `[[fault]]` tables."""

from itertools import product

from swarm import random
from swarm.errors import SwarmError
from swarm.flight.faults.injection import Faults, NoFaults
from swarm.scenario import Scenario
from swarm.scenario.faults import OfCraft
from swarm.sensors.suite import Sensors
from swarm.world.world import World


def faults(settings: Scenario, world: World, sensors: Sensors) -> NoFaults:
    """Return all faults of the run, or a null object.

    Args:
        settings: the scenario.
        world: the world, for the craft's photodiodes and thrusters.
        sensors: the sensors, whose light and pulses the faults change.

    Raises:
        SwarmError: a craft lacks a photodiode or a thruster that a fault names.
    """
    if not settings.fault:
        return NoFaults(len(settings.craft_names))
    _check(settings, world)
    keys, flown = random.keys(settings.craft_names), (settings.seed, settings.duration_s)
    return Faults(
        settings.fault, settings.craft_names, keys, *flown, sensors.lighthouse, sensors.visibility, settings.period_hz
    )


def _check(settings: Scenario, world: World) -> None:
    """Check that every craft has the photodiodes and thrusters that its faults name.

    Raises:
        SwarmError: a craft lacks one; the message names scenario, key and value.
    """
    names = settings.craft_names
    fitted = {
        "photodiodes": world.photodiodes.present.sum(axis=1).tolist(),
        "thruster": [len(thrusters.force_n) for thrusters in world.thrusters],
    }
    for (i, fault), (key, counts) in product(enumerate(settings.fault), fitted.items()):
        numbers = getattr(fault, key, ())
        number = numbers if isinstance(numbers, int) else max(numbers, default=-1)
        for craft in fault.craft or names if isinstance(fault, OfCraft) else ():
            count = counts[names.index(craft)]
            if number >= count:
                raise SwarmError(
                    f"scenario {settings.name}: fault[{i}].{key}: there is no number {number}: craft {craft!r} has "
                    f"{count} {key.removesuffix('s')}s, counted from 0"
                )
