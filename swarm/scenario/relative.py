"""The tables of relative navigation: pairs of craft, and the errors of the fans that craft take to be left over."""

from typing import Annotated

from pydantic import Field

from swarm.scenario.limits import FAN_LEFT
from swarm.scenario.table import Table

FanLeft = Annotated[float, Field(ge=0, le=0.5), FAN_LEFT]


class Pair(Table):
    """One craft navigates relative to another, by what both broadcast. See docs/relative.md."""

    craft: str = Field(description="Craft in whose axes the other's pose is.")
    to: str = Field(description="The other craft.")


class FanSigma(Table):
    """Errors of the fans that craft consider in their covariances, beyond what they know: standard deviation of what is
    left of each term, the same for every fan. All zero: none are considered.
    """

    phase_rad: FanLeft = Field(default=0.0, description="Of the constant error.")
    tilt_rad: FanLeft = Field(default=0.0, description="Of the skew.")
    curve: FanLeft = Field(default=0.0, description="Of the bend.")
    gibbous_magnitude: FanLeft = Field(
        default=0.0, description="Of the once-per-turn error, of its sine and its cosine each [rad]."
    )
    ogee_magnitude: FanLeft = Field(
        default=0.0, description="Of the bend that changes along the turn, likewise; Lighthouse 2.0 only."
    )
