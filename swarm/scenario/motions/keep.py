"""The motion `keep`."""

from typing import Literal

from pydantic import Field

from swarm.scenario.motions.base import Grid, Place
from swarm.scenario.motions.guided import Clear
from swarm.scenario.motions.paths import Path, line


class Keep(Grid, Clear):
    """The craft keeps its station; a swarm spreads over a square grid that faces the lighthouse, centred there."""

    kind: Literal["keep"] = Field(description="The craft keeps its station by its regulator, clear of other craft.")

    def path(self, place: Place) -> Path:
        """Return a point at rest."""
        return line(self.where(place))
