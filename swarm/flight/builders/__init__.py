"""Builders of all parts of a flight, from a validated scenario and the models of its craft.

Mistakes that the scenario alone cannot show, such as a craft inside another one or a model without photodiodes, are
found here, before any file is written.
"""

from swarm.flight.builders.assembly import (
    computer,
    latches,
    measured_by,
    no_command,
    own_layout,
    pilot,
    sensors,
    start_state,
    surroundings,
)
from swarm.flight.builders.cameras import cameras
from swarm.flight.builders.craft import flat_craft, fleet, photodiodes, pushes, start, steers_by_estimate, world
from swarm.flight.builders.dynamics import actuators, orbit
from swarm.flight.builders.faults import faults
from swarm.flight.builders.guidance import guidance, matings
from swarm.flight.builders.lidars import inspection, lidars
from swarm.flight.builders.navigation import believed_layout, navigation
from swarm.flight.builders.plug_ins import of_one_lighthouse, of_stations, own_navigators, plug_ins
from swarm.flight.builders.station import FAN_ERROR_MAX_RAD, angle_noise, assumed_angle_noise, decoder, timing_noise
from swarm.flight.builders.stations import frame as station_frame
from swarm.flight.builders.steps import steps

__all__ = [
    "FAN_ERROR_MAX_RAD",
    "actuators",
    "angle_noise",
    "assumed_angle_noise",
    "believed_layout",
    "cameras",
    "computer",
    "decoder",
    "faults",
    "flat_craft",
    "fleet",
    "guidance",
    "inspection",
    "latches",
    "lidars",
    "matings",
    "measured_by",
    "navigation",
    "no_command",
    "of_one_lighthouse",
    "of_stations",
    "orbit",
    "own_layout",
    "own_navigators",
    "photodiodes",
    "pilot",
    "plug_ins",
    "pushes",
    "sensors",
    "start",
    "start_state",
    "station_frame",
    "steers_by_estimate",
    "steps",
    "surroundings",
    "timing_noise",
    "world",
]
