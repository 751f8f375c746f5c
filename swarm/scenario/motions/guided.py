"""The base of the kinds of motion that a craft decides on board, by its own estimate and by what others broadcast.

`swarm.onboard.guidance` flies them. See docs/guidance.md.
"""

from typing import Annotated

from pydantic import Field

from swarm.scenario.limits import DEVIATION, DISTANCE, EFFORT
from swarm.scenario.motions.base import Motion
from swarm.scenario.table import Acceleration


class Guided(Motion):
    """A motion that guidance decides, and that a regulator holds."""

    deviation_m: Annotated[float, DEVIATION] = Field(
        default=0.002,
        ge=1e-9,
        le=100,
        description="Deviation that costs the regulator as much as the effort effort_m_s2: only their ratio counts.",
    )
    effort_m_s2: Annotated[float, EFFORT] = Field(
        default=0.001,
        ge=1e-9,
        le=100,
        description="Acceleration that costs the regulator as much as the deviation deviation_m.",
    )


class Clear(Guided):
    """A guided motion that keeps clear of other craft."""

    separation_m: Annotated[float, DISTANCE] = Field(
        default=0.0,
        ge=0,
        le=1000,
        description="Least distance between the centre of this craft and that of any craft that broadcasts. 0: the "
        "craft does not keep clear.",
    )
    brake_m_s2: Acceleration = Field(
        default=0.05,
        description="Acceleration that the craft counts on to keep clear, and does not exceed while it does.",
    )
