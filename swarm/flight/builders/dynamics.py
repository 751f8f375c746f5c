"""The lighthouse's orbit, and the actuators of the craft."""

from estimators.relative_orbit import RelativeOrbit, circular
from swarm import random, scenario
from swarm.flight.actuators import Actuators
from swarm.onboard.actuation.hardware import Fitted
from swarm.scenario import Scenario
from swarm.units import si
from swarm.world.world import World


def orbit(settings: Scenario) -> RelativeOrbit | None:
    """Return the lighthouse's orbit, None in weightless space."""
    table = settings.orbit
    return None if table is None else circular(si(table).altitude_m, table.boresight)


def actuators(settings: Scenario, world: World) -> Actuators:
    """Return the thrusters and wheels of every craft."""
    fitted = []
    for i, (craft, key) in enumerate(zip(scenario.craft(settings), random.keys(settings.craft_names), strict=True)):
        table, thrusters, wheels = si(craft.table.actuation), world.thrusters[i], world.wheels[i]
        if table.ideal:
            thrusters, wheels = thrusters.none(), wheels.none()
        errors = table.thrust_error, table.thrust_direction_error_rad
        fitted.append(Fitted(thrusters, wheels, errors, key))
    return Actuators(
        fitted,
        world.mass,
        world.com_m,
        world.inertia,
        1 / settings.lighthouse.rate_hz,
        settings.physics.steps_per_period,
        settings.seed,
    )
