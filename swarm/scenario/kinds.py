"""Every kind of motion that a craft's `motion` table can be, told apart by `kind`."""

from typing import Annotated

from pydantic import Field

from swarm.scenario.guided import Dock, Formation, Keep
from swarm.scenario.motions import Approach, Drift, Hold, Ring, Tumble, Wander, Waypoints

AnyMotion = Annotated[
    Hold | Ring | Waypoints | Approach | Tumble | Drift | Wander | Keep | Formation | Dock,
    Field(discriminator="kind"),
]
