"""The motion `keep`."""

from typing import TYPE_CHECKING, Literal

from pydantic import Field

from swarm.scenario.motions.base import Grid, Place
from swarm.scenario.motions.guided import Clear

if TYPE_CHECKING:
    from swarm.scenario.motions.paths import Path


class Keep(Grid, Clear):
    """The craft keeps its station; a swarm spreads over a square grid that faces the lighthouse, centred there."""

    kind: Literal["keep"] = Field(description="The craft keeps its station by its regulator, clear of other craft.")

    def path(self, place: Place) -> "Path":
        """Return a point at rest."""
        from swarm.scenario.motions.paths import line

        return line(self.where(place), (0.0, 0.0, 0.0))
