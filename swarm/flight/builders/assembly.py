"""Assembly of the parts of a flight from a validated scenario: sensors, computers, actuators, pushes."""

from dataclasses import replace

import numpy as np

from estimators.rotation import matrix_from_quaternion
from estimators.state import Reference, State
from swarm import random
from swarm.flight.builders.cameras import cameras
from swarm.flight.builders.craft import photodiodes, pushes, start, steers_by_estimate
from swarm.flight.builders.dynamics import fitted, orbit
from swarm.flight.builders.guidance import guidance, matings
from swarm.flight.builders.lidars import inspection, lidars
from swarm.flight.builders.navigation import believed_layout, navigation
from swarm.flight.builders.plug_ins import (
    Bodies,
    Light,
    of_one_lighthouse,
    of_stations,
    own_controllers,
    own_navigators,
)
from swarm.flight.builders.station import angle_noise, decoder
from swarm.flight.builders.stations import known_stations, station_computer, station_noise, stations
from swarm.hardware import Photodiodes, actuator_set
from swarm.messages import Command
from swarm.onboard.actuation.actuation import Actuation
from swarm.onboard.computer import Computer, StationComputer
from swarm.onboard.navigation import Navigator
from swarm.onboard.pilot import Body, Pilot
from swarm.onboard.reference_craft import ReferencePlace
from swarm.onboard.settings import NavigationSettings
from swarm.results.angles import Believed, believed
from swarm.scenario import Scenario
from swarm.sensors.ccd import Ccd
from swarm.sensors.lighthouse import Lighthouse
from swarm.sensors.suite import Sensors
from swarm.sensors.visibility import Visibility
from swarm.world.latches import Latches
from swarm.world.motion.fleet import Fleet
from swarm.world.pushes import Surroundings
from swarm.world.world import World


def sensors(scenario: Scenario, world: World, motions: Fleet) -> Sensors:
    """Return all sensors.

    Args:
        scenario: the scenario.
        world: the world, for its models.
        motions: motions of the craft, for the cameras' targets.

    Raises:
        SwarmError: a model lacks the cameras, lights or LiDAR that a table requires.
    """
    station, layout = scenario.lighthouse, photodiodes(scenario, world)
    pairs = [true for true, _ in cameras(scenario, world, motions.at(0.0))]
    light = Lighthouse(layout, station, scenario.seed, random.keys(scenario.craft_names))
    several = stations(scenario, world, layout, light) if scenario.station else None
    if several is None:
        visibility = Visibility(world.model, layout, world.craft_bodies, world.lighthouse_body, station)
    else:
        visibility = several.emitters[0].visibility
    return Sensors(
        light,
        visibility,
        Ccd(pairs, visibility, scenario.seed, scenario.duration_s) if pairs else None,
        lidars(scenario, world),
        several,
    )


def own_layout(scenario: Scenario, world: World) -> Photodiodes:
    """Return the photodiodes on board, at the positions that every craft assumes."""
    return believed_layout(scenario, world.photodiodes)._replace(present=photodiodes(scenario, world).present)


def computer(
    scenario: Scenario,
    world: World,
    motions: Fleet,
    suite: Sensors,
    layout: Photodiodes,
    *,
    history: bool = False,
) -> Computer | StationComputer:
    """Return the computers of all craft.

    Args:
        scenario: the scenario.
        world: the world, for its models.
        motions: motions of the craft, for the cameras' targets.
        suite: all sensors, for the LiDARs.
        layout: the photodiodes at the positions that every craft assumes.
        history: whether estimates carry the filter's prediction, for a smoother.

    Raises:
        SwarmError: a calibration does not fit the craft.
    """
    begin = motions.at(0.0)
    known = [known for _, known in cameras(scenario, world, begin)]
    # Who holds no attitude turns without torque.
    inertia = np.where(begin.holds_attitude[:, None, None], np.nan, world.inertia)
    settings = replace(navigation(scenario, world.steps), history=history, reference=_references(scenario, begin))
    own = own_navigators(scenario, settings, _light(scenario, layout, settings), _bodies(world))
    if scenario.station:
        return station_computer(scenario, settings, layout, known, inertia, inspection(scenario, suite.lidars), own)
    return Computer(
        decoder(scenario, layout.present),
        Navigator(layout, settings, known, inertia),
        inspection(scenario, suite.lidars),
        own,
    )


def _references(scenario: Scenario, begin: Reference) -> tuple[ReferencePlace, ...]:
    """Return the craft that are references for the others, with their poses."""
    craft = [scenario.craft_names.index(name) for name in scenario.navigation.reference]
    return tuple(ReferencePlace(c, begin.rotation[c], begin.position[c]) for c in craft)


def _light(scenario: Scenario, layout: Photodiodes, settings: NavigationSettings) -> Light:
    """Return what the craft know of light, for plug-ins."""
    if scenario.station:
        return of_stations(layout, known_stations(scenario), station_noise(scenario))
    return of_one_lighthouse(layout, settings)


def _bodies(world: World) -> Bodies:
    return Bodies(world.mass, world.inertia, world.com_m)


def measured_by(scenario: Scenario, world: World, layout: Photodiodes, settings: NavigationSettings) -> Believed:
    """Return the layout, fan errors and noise that the craft assume when they measure angles, for a calibration.

    Args:
        scenario: the scenario, for the noise.
        world: the world, for the names of the craft.
        layout: the photodiodes at the positions that every craft assumes.
        settings: settings of every craft's computer, for the fan errors.
    """
    return believed(world.names, layout, (settings.fan_x, settings.fan_y), angle_noise(scenario))


def pilot(
    scenario: Scenario,
    world: World,
    motions: Fleet,
    latches: Latches,
    layout: Photodiodes,
    kind: type[Pilot] = Pilot,
) -> Pilot:
    """Return the guidance, control and actuator computers of all craft.

    Args:
        scenario: the scenario.
        world: the world, for mass, inertia and actuators of the craft.
        motions: reference motions of the craft.
        latches: latches of all docking pairs.
        layout: the photodiodes at the positions that every craft assumes, for controllers of the user.
        kind: the pilot's class.
    """
    period_s, guides = scenario.period_s, guidance(scenario, latches.matings, motions.at(0.0))
    actuators = actuator_set(fitted(scenario, world), world.com_m)
    actuation = Actuation(actuators, world.mass, world.inertia, period_s)
    body, by_estimate = Body(world.mass, world.inertia), steers_by_estimate(scenario)
    settings = navigation(scenario, world.steps)
    own = own_controllers(scenario, settings, _light(scenario, layout, settings), _bodies(world))
    return kind(motions, guides, actuation, body, by_estimate, period_s, orbit(scenario), own)


def latches(scenario: Scenario, world: World) -> Latches:
    """Return the latches of all docking pairs."""
    return Latches(world, matings(scenario))


def surroundings(scenario: Scenario, world: World, motions: Fleet) -> Surroundings:
    """Return the forces on the craft beside their actuators.

    Args:
        scenario: the scenario.
        world: the world.
        motions: motions of the craft.
    """
    return Surroundings(world, pushes(scenario), motions, scenario.period_s)


def start_state(scenario: Scenario, motions: Fleet) -> State:
    """Return the true state of every craft at the start."""
    first = start(scenario, motions)
    return State(
        rotation=matrix_from_quaternion(first.quaternion),
        position=first.position,
        velocity=first.velocity,
        angular_rate=first.angular_rate,
    )


def no_command(craft: int) -> Command:
    """Return a command that orders nothing, for `craft` craft."""
    return Command(*np.zeros((2, craft, 3)))
