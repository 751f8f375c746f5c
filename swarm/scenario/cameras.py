"""The `[craft.ccd]` table of a scenario: a pair of cameras on one craft, looking at another craft's lights.

Defaults are those of source 2, section 3. `swarm.sensors.ccd` reads the table, and so does what the craft knows of its
cameras (`swarm.onboard.ccd`).
"""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, Strict

from swarm.scenario.limits import (
    APART_MAX,
    APART_MIN,
    BELIEVED_IMAGE,
    CAMERA_FIELD,
    CAMERA_PLACE,
    CAMERA_TURN,
    CONE,
    FAILURE,
    FOCAL,
    IMAGE_NOISE,
    PIXEL,
    SPAN,
)
from swarm.scenario.table import Mistake, Probability, Table, Time

Apart = Annotated[float, Field(ge=0, le=10000), APART_MIN]


class Outage(Table):
    """A camera is dark within these times and, at once, within these distances; a key left out sets no limit."""

    camera: Literal["main", "backup"] = Field(default="backup", description="Camera that fails.")
    from_s: Time = Field(default=0.0, description="Time from which the camera is dark.")
    to_s: Time = Field(default=86400.0, description="Time until which the camera is dark.")
    from_m: Apart = Field(
        default=10000.0,
        description="Largest distance from the main camera to the lights at which the camera is dark.",
    )
    to_m: Apart = Field(default=0.0, description="The camera works again at this distance and nearer.")

    def between_keys(self) -> Iterator[Mistake]:
        """Require that neither stretch is empty."""
        if self.to_s <= self.from_s:
            yield f"must be after from_s = {self.from_s} s", "to_s", "from_s"
        if self.to_m >= self.from_m:
            yield f"must be nearer than from_m = {self.from_m} m", "to_m", "from_m"


class Ccd(Table):
    """Two CCD cameras on the craft (the cameras `ccd...` of its model) look at the lights (sites `light...`) of another
    craft, whose pose in the lighthouse frame is known on board. See docs/stereo.md.
    """

    target: str = Field(description="Name of the craft with the lights; it must hold its position.")
    solution: Literal["refined", "closed-form"] = Field(
        default="refined",
        description="Solution from the images of both cameras: the closed form refined by a fit to all images, or the "
        "closed form alone.",
    )
    focal_length_mm: Annotated[float, FOCAL] = Field(
        default=28.0, ge=1, le=1000, description="Focal length of both cameras."
    )
    field_deg: Annotated[float, CAMERA_FIELD] = Field(
        default=24.0, ge=0.1, le=170, description="Full width of the field of view in each axis."
    )
    range_min_m: Apart = Field(default=0.3, description="Least range at which a light is seen.")
    range_max_m: Annotated[float, APART_MAX] = Field(
        default=35.0, ge=0.01, le=10000, description="Largest range at which a light is seen."
    )
    light_cone_deg: Annotated[float, CONE] = Field(
        default=60.0,
        ge=0.1,
        le=90,
        description="Largest angle from the direction in which a light shines at which it is seen.",
    )
    image_noise_um: Annotated[float, IMAGE_NOISE] = Field(
        default=0.3333, ge=0, le=100, description="Standard deviation of an image coordinate on the detector."
    )
    resolution_um: Annotated[float, PIXEL] = Field(
        default=0.0, ge=0, le=100, description="Step to which image coordinates are rounded. 0: no rounding."
    )
    believed_noise_um: Annotated[float | None, BELIEVED_IMAGE] = Field(
        default=None,
        ge=1e-3,
        le=100,
        description="Standard deviation of an image coordinate that the craft assumes. Unset: image noise and "
        "rounding together.",
    )
    mounting_error_mm: Annotated[float, CAMERA_PLACE] = Field(
        default=0.0,
        ge=0,
        le=100,
        description="Standard deviation of the cameras' mounting position per axis, drawn once.",
    )
    mounting_error_arcsec: Annotated[float, CAMERA_TURN] = Field(
        default=0.0,
        ge=0,
        le=7200,
        description="Standard deviation of the cameras' mounting attitude per axis, drawn once.",
    )
    lost_image_probability: Probability = Field(default=0.0, description="Probability that a camera loses an image.")
    failure_every_s: Annotated[float | None, FAILURE] = Field(
        default=None,
        ge=0.1,
        le=86400,
        description="Mean time to the next random failure of a camera. Unset: never.",
    )
    failure_length_s: Annotated[float, SPAN] = Field(
        default=5.0, ge=1e-3, le=86400, description="Mean duration of a random failure."
    )
    outages: Annotated[tuple[Outage, ...], Strict(False)] = Field(
        default=(), description="Planned outages of the cameras: a list of tables."
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Require a range that is not empty, and a craft that does not assume perfect images."""
        if self.range_min_m >= self.range_max_m:
            yield f"must be below range_max_m = {self.range_max_m} m", "range_min_m", "range_max_m"
        if self.image_noise_um == 0 and self.resolution_um == 0 and self.believed_noise_um is None:
            yield "must be given where the images have no error: no filter takes exact poses", "believed_noise_um"
