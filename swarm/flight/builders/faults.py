"""From a scenario's `[[fault]]` tables to what goes wrong in its run."""

from swarm import random
from swarm.errors import SwarmError
from swarm.flight.faults.injection import Faults, NoFaults
from swarm.scenario import Scenario
from swarm.scenario.faults import OfCraft, PhotodiodeDead, PhotodiodeStuck, ThrusterStuck
from swarm.sensors.suite import Sensors
from swarm.world.world import World


def faults(settings: Scenario, world: World, sensors: Sensors) -> NoFaults:
    """Return everything that goes wrong, or a null object. Raises SwarmError as `check_faults`."""
    if not settings.fault:
        return NoFaults(len(settings.craft_names))
    check_faults(settings, world)
    keys, flown = random.keys(settings.craft_names), (settings.seed, settings.duration_s)
    return Faults(settings.fault, settings.craft_names, keys, *flown, sensors.lighthouse, sensors.visibility)


def check_faults(settings: Scenario, world: World) -> None:
    """Raises SwarmError, naming scenario, key and value, where a craft has no such photodiode or thruster."""
    names = settings.craft_names
    for i, fault in enumerate(settings.fault):
        for craft in fault.craft or names if isinstance(fault, OfCraft) else ():
            c = names.index(craft)
            match fault:
                case PhotodiodeDead() | PhotodiodeStuck():
                    key, what, number = "photodiodes", "photodiodes", max(fault.photodiodes)
                    count = int(world.photodiodes.present[c].sum())
                case ThrusterStuck():
                    key, what, number = "thruster", "thrusters", fault.thruster
                    count = len(world.thrusters[c].force_n)
                case _:
                    continue
            if number >= count:
                raise SwarmError(
                    f"scenario {settings.name}: fault[{i}].{key}: there is no number {number}: craft {craft!r} has "
                    f"{count} {what}, counted from 0"
                )
