"""The scenario: the tables of a run's file, loading them with a message for every mistake, and writing them."""

from swarm.scenario.cameras import Ccd, Outage
from swarm.scenario.criteria import Criterion
from swarm.scenario.dynamics import Actuation, Orbit
from swarm.scenario.fleet import Scatter, Swarm
from swarm.scenario.lidar import Lidar
from swarm.scenario.lighthouse import Lighthouse
from swarm.scenario.load import Craft, checked, craft, for_replay, load, validate
from swarm.scenario.motions import (
    AnyMotion,
    Approach,
    Attitude,
    Dock,
    Drift,
    Figure,
    Formation,
    Hold,
    Keep,
    Ring,
    Tumble,
    Wander,
    Waypoints,
)
from swarm.scenario.navigation import Navigation
from swarm.scenario.reference import json_schema, markdown_reference
from swarm.scenario.relative import FanSigma, Pair
from swarm.scenario.schema import Scenario
from swarm.scenario.stations import Fan, Plane, Pointing, Station
from swarm.scenario.text import to_toml

__all__ = [
    "Actuation",
    "AnyMotion",
    "Approach",
    "Attitude",
    "Ccd",
    "Craft",
    "Criterion",
    "Dock",
    "Drift",
    "Fan",
    "FanSigma",
    "Figure",
    "Formation",
    "Hold",
    "Keep",
    "Lidar",
    "Lighthouse",
    "Navigation",
    "Orbit",
    "Outage",
    "Pair",
    "Plane",
    "Pointing",
    "Ring",
    "Scatter",
    "Scenario",
    "Station",
    "Swarm",
    "Tumble",
    "Wander",
    "Waypoints",
    "checked",
    "craft",
    "for_replay",
    "json_schema",
    "load",
    "markdown_reference",
    "to_toml",
    "validate",
]
