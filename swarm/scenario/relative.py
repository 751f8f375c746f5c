"""The tables of relative navigation: pairs of craft, and the errors of the fans that craft take to be left over."""

from typing import Annotated

from pydantic import Field

from swarm.scenario.limits import ALERT, ALERT_ATTITUDE, FAN_LEFT
from swarm.scenario.table import Table

FanLeft = Annotated[float, Field(ge=0, le=0.5), FAN_LEFT]


class Pair(Table):
    """One craft navigates relative to another, by what both broadcast. See docs/relative.md."""

    craft: str = Field(description="Craft in whose axes the other's pose is.")
    to: str = Field(description="The other craft.")
    alert_position_mm: Annotated[float | None, ALERT] = Field(
        default=None,
        ge=1e-6,
        le=1e6,
        description="Protection level of the relative position above which there is an alert. Unset: never.",
    )
    alert_attitude_deg: Annotated[float | None, ALERT_ATTITUDE] = Field(
        default=None,
        ge=1e-6,
        le=180,
        description="Protection level of the relative attitude above which there is an alert. Unset: never.",
    )


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
