"""The motion `approach`."""

from collections.abc import Iterator
from typing import ClassVar, Literal

from pydantic import Field

from swarm.scenario.motions.base import Place, Turned
from swarm.scenario.motions.paths import Path, corridor
from swarm.scenario.table import Mistake, Pace, Time, Vector


class Approach(Turned):
    """The craft flies a straight corridor with a smooth start and stop, as in a docking."""

    starts_at: ClassVar[str] = "from_m"

    kind: Literal["approach"] = Field(description="The craft flies a straight corridor from one point to another.")
    from_m: Vector = Field(description="Point where the craft waits and starts.")
    to_m: Vector = Field(description="Point where the craft stops and stays.")
    start_s: Time = Field(default=0.0, description="Time of the start.")
    speed_m_s: Pace = Field(description="Cruising speed.")

    def between_keys(self) -> Iterator[Mistake]:
        """Require a corridor with a length."""
        if self.from_m == self.to_m:
            yield "must differ from from_m, where the approach starts", "to_m", "from_m"

    def path(self, place: Place) -> Path:
        """Return the corridor."""
        return corridor(self.from_m, self.to_m, self.start_s, self.speed_m_s)
