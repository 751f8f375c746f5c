"""The `[craft.lidar]` table of a scenario: a LiDAR on one craft, and the passive craft that it inspects.

`swarm.flight.builders.lidars` turns the table into the SI settings of `swarm.sensors.lidar` and of
`swarm.onboard.inspection`.
"""

from collections.abc import Iterator

from pydantic import Field

from swarm.scenario.table import Mistake, Table


class Lidar(Table):
    """A spinning LiDAR on the craft (its model's site `lidar`), and the craft of known shape that it inspects. See
    docs/lidar.md.
    """

    target: str = Field(description="Name of the craft that is inspected; it must be passive.")
    lines: int = Field(default=16, ge=1, le=256, description="Lines of one scan.")
    vertical_field_deg: float = Field(default=30.0, gt=0, le=170, description="From the lowest to the highest line.")
    horizontal_field_deg: float = Field(
        default=360.0, gt=0, le=360, description="Along a line, centred on the x axis of the site."
    )
    resolution_deg: float = Field(default=0.2, ge=0.02, le=10, description="Between the rays of a line.")
    rate_hz: float = Field(
        default=10.0, gt=0, le=1000, description="Scans per second; at most one per lighthouse period."
    )
    range_noise_mm: float = Field(default=10.0, ge=0, le=1000, description="Random error of a range, 1 sigma.")
    jitter_deg: float = Field(
        default=0.02, ge=0, le=5, description="Random error of a ray's direction, 1 sigma per axis."
    )
    range_min_m: float = Field(default=0.3, ge=0, le=1000, description="Nothing returns from nearer than this.")
    range_max_m: float = Field(
        default=60.0, gt=0, le=10000, description="Nothing returns from further; returns fade before."
    )
    incidence_max_deg: float = Field(
        default=87.0, gt=0, le=90, description="Nothing returns at a steeper incidence; returns fade before."
    )
    dropout_probability: float = Field(default=0.01, ge=0, le=1, description="A ray is lost for no reason.")
    target_acceleration_m_s2: float = Field(
        default=0.02, gt=0, le=100, description="Process noise of the target's filter, as in [navigation]."
    )
    target_angular_acceleration_deg_s2: float = Field(
        default=3.0, gt=0, le=36000, description="Process noise of the target's filter, as in [navigation]."
    )

    def between_keys(self) -> Iterator[Mistake]:
        """The range is not empty."""
        if self.range_min_m >= self.range_max_m:
            yield f"must be below range_max_m = {self.range_max_m} m", "range_min_m", "range_max_m"
