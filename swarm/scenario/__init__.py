"""The scenario: what a run's file may say, loading it with every mistake named, and writing it out again."""

from swarm.scenario.cameras import Ccd, Outage
from swarm.scenario.lidar import Lidar
from swarm.scenario.load import Craft, craft, for_replay, load, validate
from swarm.scenario.motions import AnyMotion, Approach, Attitude, Drift, Hold, Ring, Tumble, Wander, Waypoints
from swarm.scenario.reference import json_schema, markdown_reference
from swarm.scenario.schema import Fan, Lighthouse, Navigation, Scenario, Swarm
from swarm.scenario.text import to_toml

__all__ = [
    "AnyMotion",
    "Approach",
    "Attitude",
    "Ccd",
    "Craft",
    "Drift",
    "Fan",
    "Hold",
    "Lidar",
    "Lighthouse",
    "Navigation",
    "Outage",
    "Ring",
    "Scenario",
    "Swarm",
    "Tumble",
    "Wander",
    "Waypoints",
    "craft",
    "for_replay",
    "json_schema",
    "load",
    "markdown_reference",
    "to_toml",
    "validate",
]
