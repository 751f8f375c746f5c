"""The table of one figure of a formation; `swarm.scenario.motions.shapes` computes the places in it."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from swarm.scenario.limits import FIGURE, TURN, TURNING
from swarm.scenario.table import Mistake, Table, Time, Vector


class Figure(Table):
    """One figure of a formation."""

    at_s: Time = Field(default=0.0, description="Time from which the figure is wanted; 0 for the first one.")
    shape: Literal["ring", "line", "tetrahedron", "projected-circle"] = Field(
        description="Shape of the figure; a projected circle is a free motion in the orbit, and needs [orbit]."
    )
    radius_m: Annotated[float | None, FIGURE] = Field(
        default=None,
        ge=1e-3,
        le=1000,
        description="Radius of a ring, a projected circle, or the sphere about a tetrahedron.",
    )
    length_m: Annotated[float | None, FIGURE] = Field(
        default=None, ge=1e-3, le=1000, description="Length of a line from end to end."
    )
    centre_m: Vector | None = Field(default=None, description="Centre of the figure. Unset: the formation's centre.")
    tilt_deg: Annotated[float, TURN] = Field(
        default=0.0, ge=-180, le=180, description="First turn of the figure, about the x axis."
    )
    turn_deg: Annotated[float, TURN] = Field(
        default=0.0, ge=-180, le=180, description="Second turn of the figure, about the z axis."
    )
    rate_deg_s: Annotated[float, TURNING] = Field(
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
