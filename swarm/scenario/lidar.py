"""The `[craft.lidar]` table of a scenario: a LiDAR on one craft, and the passive craft that it inspects.

`swarm.sensors.lidar` reads the table.
"""

from collections.abc import Iterator

from pydantic import Field

from swarm.scenario.table import Mistake, Table


class Lidar(Table):
    """A spinning LiDAR on the craft (the site `lidar` of its model) inspects a passive craft of known shape. See
    docs/lidar.md.
    """

    target: str = Field(description="Name of the craft that is inspected; it must be passive.")
    lines: int = Field(default=16, ge=1, le=256, description="Number of lines in one scan.")
    vertical_field_deg: float = Field(
        default=30.0, ge=0.01, le=170, description="Angle from the lowest to the highest line."
    )
    horizontal_field_deg: float = Field(
        default=360.0, ge=0.01, le=360, description="Angle along a line, centred on the x axis of the site."
    )
    resolution_deg: float = Field(default=0.2, ge=0.02, le=10, description="Angle between the rays of a line.")
    rate_hz: float = Field(
        default=10.0, ge=1e-3, le=1000, description="Scans per second; at most one per lighthouse period."
    )
    range_noise_mm: float = Field(default=10.0, ge=0, le=1000, description="Standard deviation of a range.")
    jitter_deg: float = Field(
        default=0.02, ge=0, le=5, description="Standard deviation of the direction of a ray per axis."
    )
    range_min_m: float = Field(default=0.3, ge=0, le=1000, description="Least range of a return.")
    range_max_m: float = Field(
        default=60.0, ge=0.01, le=10000, description="Largest range of a return; returns fade before it."
    )
    incidence_max_deg: float = Field(
        default=87.0, ge=1, le=90, description="Largest angle of incidence of a return; returns fade before it."
    )
    dropout_probability: float = Field(
        default=0.01, ge=0, le=1, description="Probability that a ray is lost for no reason."
    )
    target_acceleration_m_s2: float = Field(
        default=0.02,
        ge=1e-9,
        le=100,
        description="Process noise of the filter of the target's motion: white acceleration, standard deviation per "
        "axis and period.",
    )
    target_angular_acceleration_deg_s2: float = Field(
        default=3.0,
        ge=1e-9,
        le=36000,
        description="Process noise of the filter of the target's motion: white angular acceleration, standard "
        "deviation per axis and period.",
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Require a range that is not empty."""
        if self.range_min_m >= self.range_max_m:
            yield f"must be below range_max_m = {self.range_max_m} m", "range_min_m", "range_max_m"
