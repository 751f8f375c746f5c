"""The motion `wander`: smooth random motion, band-limited, that never leaves its bounds (`motions.tones`)."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, Strict

from swarm.scenario.limits import BANDWIDTH, SPACING, SPEED_SIGMA, SPIN_SIGMA, SWAY
from swarm.scenario.motions.base import Place, Turned, on_grid
from swarm.scenario.motions.paths import Path, Wandering
from swarm.scenario.table import Extent, Vector
from swarm.units import si


class Wander(Turned):
    """The craft moves at random as if by hand: smoothly, within a box, without any frequency above its bandwidth."""

    starts_at: ClassVar[str] = "centre_m"

    kind: Literal["wander"] = Field(description="The craft moves at random as if by hand.")
    centre_m: Vector = Field(default=(0.0, 0.0, 3.0), description="Centre of the box that the craft never leaves.")
    size_m: Annotated[tuple[Extent, Extent, Extent], Strict(False)] = Field(
        default=(1.0, 1.0, 1.0), description="Edges of the box; the craft does not move along an edge of 0."
    )
    spacing_m: Annotated[float | None, SPACING] = Field(
        default=None,
        ge=1e-3,
        le=1000,
        description="Distance between the boxes of neighbours in a swarm, whose centres are a square grid about "
        "centre_m, perpendicular to z. Unset: all craft are in one box.",
    )
    speed_m_s: Annotated[float, SPEED_SIGMA] = Field(
        default=0.3, ge=0, le=100, description="RMS speed, shared among the axes in proportion to the box's edges."
    )
    turn_deg: Annotated[float, SWAY] = Field(
        default=30.0, ge=0, le=180, description="Largest random turn about each body axis, beside the attitude."
    )
    turn_rate_deg_s: Annotated[float, SPIN_SIGMA] = Field(
        default=30.0, ge=0, le=3600, description="RMS angular rate of the random turn."
    )
    bandwidth_hz: Annotated[float, BANDWIDTH] = Field(
        default=1.0, ge=1e-4, le=30, description="Highest frequency of the motion."
    )

    def path(self, place: Place) -> Path:
        """Return random tones for the position, and for the turn, of which each axis has the same share of the rate."""
        import numpy as np

        from swarm.random import Purpose, stream
        from swarm.scenario.motions.tones import tones

        own, rng = si(self), stream(place.seed, Purpose.WANDER, place.key)
        size = np.array(self.size_m)
        speed = self.speed_m_s * size / max(float(np.linalg.norm(size)), 1e-12)
        offset = tones(size / 2, speed, self.bandwidth_hz, rng)
        rate = np.full(3, own.turn_rate_rad_s / np.sqrt(3))
        turn = tones(np.full(3, own.turn_rad), rate, self.bandwidth_hz, rng)
        centre = self.centre_m if self.spacing_m is None else on_grid(self.centre_m, self.spacing_m, place)
        return Wandering(centre, offset, turn)
