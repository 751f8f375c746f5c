"""The motion `formation`: a swarm in one figure after the other (`motions.shapes`)."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

from pydantic import Field, Strict

from swarm.scenario.motions.base import Place, Turned
from swarm.scenario.motions.figure import Figure
from swarm.scenario.motions.guided import Clear
from swarm.scenario.motions.paths import Path, line
from swarm.scenario.table import Mistake, Pace, Vector


class Formation(Turned, Clear):
    """A swarm flies from figure to figure; every craft goes by its own estimate and by what the others broadcast."""

    starts_at: ClassVar[str] = "figures"

    kind: Literal["formation"] = Field(description="A swarm flies from one figure to the next.")
    centre_m: Vector = Field(default=(0.0, 0.0, 4.0), description="Centre of the figures.")
    about: str | None = Field(
        default=None,
        description="Craft with which the figures move: centre_m is their centre where that craft starts. Every craft "
        "of the formation navigates relative to it: a [[pair]] each. Unset: the figures stay.",
    )
    figures: Annotated[tuple[Figure, ...], Strict(False)] = Field(
        min_length=1, description="Figures in the order of time: a list of tables."
    )
    speed_m_s: Pace = Field(default=0.1, description="Peak speed of the fastest craft from figure to figure.")

    def between_keys(self) -> Iterator[Mistake]:
        """Require that the figures follow each other."""
        if self.figures[0].at_s != 0:
            yield "the first figure is that in which the craft start: at 0", "figures[0].at_s"
        for i, (before, after) in enumerate(pairwise(self.figures), start=1):
            if after.at_s <= before.at_s:
                yield f"must be later than the figure before it, at {before.at_s} s", f"figures[{i}].at_s"

    def path(self, place: Place) -> Path:
        """Return the line on which the craft starts in the first figure."""
        from swarm.scenario.motions.shapes import shape_of

        first = shape_of(self.figures[0], self.centre_m, place.orbit).at(0.0, place.count)
        return line(tuple(first.position[place.index].tolist()), tuple(first.velocity[place.index].tolist()))
