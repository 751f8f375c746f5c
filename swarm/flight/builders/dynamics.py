"""The lighthouse's orbit, and the actuators of the craft."""

from estimators.relative_orbit import RelativeOrbit, circular
from swarm import random, scenario
from swarm.hardware import Fitted, actuator_set
from swarm.scenario import Scenario
from swarm.units import si
from swarm.world.actuators import Actuators
from swarm.world.world import World


def orbit(settings: Scenario) -> RelativeOrbit | None:
    """Return the lighthouse's orbit; None in weightless space."""
    table = settings.orbit
    return None if table is None else circular(si(table).altitude_m, table.boresight)


def fitted(settings: Scenario, world: World) -> list[Fitted]:
    """Return the thrusters and wheels of every craft; an ideal craft has none."""
    out = []
    for i, (craft, key) in enumerate(zip(scenario.craft(settings), random.keys(settings.craft_names), strict=True)):
        table, thrusters, wheels = si(craft.table.actuation), world.thrusters[i], world.wheels[i]
        if table.ideal:
            thrusters, wheels = thrusters.none(), wheels.none()
        errors = table.thrust_error, table.thrust_direction_error_rad
        out.append(Fitted(thrusters, wheels, errors, key))
    return out


def actuators(settings: Scenario, world: World) -> Actuators:
    """Return the thrusters and wheels of every craft with their true properties."""
    own = fitted(settings, world)
    return Actuators(own, actuator_set(own, world.com_m), world.mass, settings.period_s, world.steps, settings.seed)
