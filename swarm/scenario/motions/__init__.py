"""The `motion` table of a scenario: one file per kind, which holds the kind's table and the path that it stands for.

A new kind is a file here and an entry in `AnyMotion`. Positions are metres in the lighthouse frame (x right, y down, z
forward, away from the lighthouse). `swarm.world.motion.fleet` evaluates the courses of all craft at once.
"""

from typing import Annotated

from pydantic import Field

from swarm.scenario.motions.approach import Approach
from swarm.scenario.motions.base import Attitude, Course, Motion, Place
from swarm.scenario.motions.dock import Dock
from swarm.scenario.motions.drift import Drift
from swarm.scenario.motions.figure import Figure
from swarm.scenario.motions.formation import Formation
from swarm.scenario.motions.hold import Hold
from swarm.scenario.motions.keep import Keep
from swarm.scenario.motions.ring import Ring
from swarm.scenario.motions.tumble import Tumble
from swarm.scenario.motions.wander import Wander
from swarm.scenario.motions.waypoints import Waypoints

AnyMotion = Annotated[
    Hold | Ring | Waypoints | Approach | Tumble | Drift | Wander | Keep | Formation | Dock,
    Field(discriminator="kind"),
]
"""Every kind of motion, told apart by `kind`."""

__all__ = [
    "AnyMotion",
    "Approach",
    "Attitude",
    "Course",
    "Dock",
    "Drift",
    "Figure",
    "Formation",
    "Hold",
    "Keep",
    "Motion",
    "Place",
    "Ring",
    "Tumble",
    "Wander",
    "Waypoints",
]
