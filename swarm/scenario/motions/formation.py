"""The motion `formation`: a swarm in one figure after the other (`motions.shapes`)."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

from pydantic import Field, Strict

from swarm.scenario.motions.base import Place, Turned
from swarm.scenario.motions.guided import Clear
from swarm.scenario.motions.paths import Path, line
from swarm.scenario.table import Mistake, Table, Vector


class Figure(Table):
    """One figure of a formation."""

    at_s: float = Field(
        default=0.0, ge=0, le=86400, description="Time from which the figure is wanted; 0 for the first one."
    )
    shape: Literal["ring", "line", "tetrahedron", "projected-circle"] = Field(
        description="Shape of the figure; a projected circle is a free motion in the orbit, and needs [orbit]."
    )
    radius_m: float | None = Field(
        default=None,
        gt=0,
        le=1000,
        description="Radius of a ring, a projected circle, or the sphere about a tetrahedron.",
    )
    length_m: float | None = Field(default=None, gt=0, le=1000, description="Length of a line from end to end.")
    centre_m: Vector | None = Field(default=None, description="Centre of the figure. Unset: the formation's centre.")
    tilt_deg: float = Field(default=0.0, ge=-180, le=180, description="First turn of the figure, about the x axis.")
    turn_deg: float = Field(default=0.0, ge=-180, le=180, description="Second turn of the figure, about the z axis.")
    rate_deg_s: float = Field(
        default=0.0, ge=-360, le=360, description="Angular rate of the figure about its own z axis."
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Require the size that the shape has, and no other."""
        size, other = ("length_m", "radius_m") if self.shape == "line" else ("radius_m", "length_m")
        if getattr(self, size) is None:
            yield f"missing: a {self.shape} needs it", size
        if getattr(self, other) is not None:
            yield f"means nothing to a {self.shape}, which has {size}", other
        if self.shape == "projected-circle" and (self.tilt_deg or self.turn_deg or self.rate_deg_s):
            yield "a projected circle lies and turns as the orbit has it: no tilt_deg, turn_deg, rate_deg_s", "shape"


class Formation(Turned, Clear):
    """A swarm flies from figure to figure; every craft goes by its own estimate and by what the others broadcast."""

    starts_at: ClassVar[str] = "figures"

    kind: Literal["formation"] = Field(description="A swarm flies from one figure to the next.")
    centre_m: Vector = Field(default=(0.0, 0.0, 4.0), description="Centre of the figures.")
    figures: Annotated[tuple[Figure, ...], Strict(False)] = Field(
        min_length=1, description="Figures in the order of time: a list of tables."
    )
    speed_m_s: float = Field(
        default=0.1, gt=0, le=100, description="Peak speed of the fastest craft from figure to figure."
    )

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
