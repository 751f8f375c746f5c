"""The `[craft.ccd]` table of a scenario: a pair of cameras on one craft, looking at another craft's lights.

Defaults are those of source 2, section 3. `swarm.flight.builders` turns the table into the SI settings of
`swarm.sensors.ccd` and of `swarm.onboard.ccd`.
"""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, Strict

from swarm.scenario.table import Mistake, Table


class Outage(Table):
    """When a camera is dark: within its times and, at once, within its distances; what is not given does not limit."""

    camera: Literal["main", "backup"] = Field(default="backup", description="Which camera fails.")
    from_s: float = Field(default=0.0, ge=0, le=86400, description="From this time on.")
    to_s: float = Field(default=86400.0, ge=0, le=86400, description="Until this time.")
    from_m: float = Field(
        default=10000.0, ge=0, le=10000, description="Not while the lights are farther from the main camera than this."
    )
    to_m: float = Field(default=0.0, ge=0, le=10000, description="Not while they are this near, or nearer.")

    def between_keys(self) -> Iterator[Mistake]:
        """Neither stretch is empty."""
        if self.to_s <= self.from_s:
            yield f"must be after from_s = {self.from_s} s", "to_s", "from_s"
        if self.to_m >= self.from_m:
            yield f"must be nearer than from_m = {self.from_m} m", "to_m", "from_m"


class Ccd(Table):
    """Two CCD cameras on the craft (its model's cameras `ccd...`), and the craft whose lights (sites `light...`) they
    look at, whose station in the lighthouse frame is known on board. See docs/stereo.md.
    """

    target: str = Field(description="Name of the craft with the lights; it must hold its place.")
    solution: Literal["refined", "closed-form"] = Field(
        default="refined",
        description="What both cameras' images give: the closed form refined by a fit to all images, or as it is.",
    )
    focal_length_mm: float = Field(default=28.0, gt=0, le=10000, description="Of both cameras.")
    field_deg: float = Field(default=24.0, gt=0, le=170, description="Full width of the field in each axis.")
    range_min_m: float = Field(default=0.3, ge=0, le=10000, description="Lights nearer than this are not seen.")
    range_max_m: float = Field(default=35.0, gt=0, le=10000, description="Lights farther than this are not seen.")
    light_cone_deg: float = Field(
        default=60.0, gt=0, le=90, description="A light is seen at most this far from the direction it shines in."
    )
    image_noise_um: float = Field(
        default=0.3333, ge=0, le=1000, description="Random error of an image coordinate on the detector, 1 sigma."
    )
    resolution_um: float = Field(
        default=0.0, ge=0, le=1000, description="Image coordinates are rounded to multiples of this; 0: not at all."
    )
    believed_noise_um: float | None = Field(
        default=None, gt=0, le=1000, description="What the craft believes. Unset: image noise and rounding together."
    )
    mounting_error_mm: float = Field(
        default=0.0, ge=0, le=100, description="Cameras off their place, 1 sigma per axis, drawn once."
    )
    mounting_error_arcsec: float = Field(
        default=0.0, ge=0, le=36000, description="Cameras turned off their axes, 1 sigma per axis, drawn once."
    )
    lost_image_probability: float = Field(default=0.0, ge=0, le=1, description="A camera loses an image, per image.")
    failure_every_s: float | None = Field(
        default=None,
        gt=0,
        le=86400,
        description="Mean time to a camera's next random failure. Unset: never.",
    )
    failure_length_s: float = Field(default=5.0, gt=0, le=86400, description="Mean length of a random failure.")
    outages: Annotated[tuple[Outage, ...], Strict(False)] = Field(
        default=(), description="When a camera is dark by order: a list of tables."
    )

    def between_keys(self) -> Iterator[Mistake]:
        """The range is not empty, and the craft does not believe in perfect images."""
        if self.range_min_m >= self.range_max_m:
            yield f"must be below range_max_m = {self.range_max_m} m", "range_min_m", "range_max_m"
        if self.image_noise_um == 0 and self.resolution_um == 0 and self.believed_noise_um is None:
            yield "must be given where the images have no error: no filter takes exact poses", "believed_noise_um"
