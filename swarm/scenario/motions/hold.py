"""The motion `hold`."""

from typing import Literal

from pydantic import Field

from swarm.scenario.motions.base import Place, Spread
from swarm.scenario.motions.paths import Path, line


class Hold(Spread):
    """The craft stays at one position; a swarm spreads over a square grid that faces the lighthouse, or fills a box."""

    kind: Literal["hold"] = Field(description="The craft stays at one position.")

    def path(self, place: Place) -> Path:
        """Return a point at rest."""
        return line(self.where(place))
