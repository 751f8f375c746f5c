"""The `[craft.lidar]` table of a scenario: a LiDAR on one craft, and the passive craft that it inspects.

`swarm.sensors.lidar` reads the table.
"""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from swarm.scenario.limits import (
    APART_MAX,
    INCIDENCE,
    LIDAR_FIELD,
    LINES,
    RANGE_MIN,
    RANGE_NOISE,
    RAY_JITTER,
    RESOLUTION,
    SCAN_RATE,
    SCAN_WIDTH,
)
from swarm.scenario.table import Mistake, Probability, ProcessNoise, Table, TurningNoise


class Lidar(Table):
    """A spinning LiDAR on the craft (the site `lidar` of its model) inspects a passive craft of known shape. See
    docs/lidar.md.
    """

    target: str = Field(description="Name of the craft that is inspected; it must be passive.")
    lines: Annotated[int, LINES] = Field(default=16, ge=1, le=256, description="Number of lines in one scan.")
    vertical_field_deg: Annotated[float, LIDAR_FIELD] = Field(
        default=30.0, ge=0.01, le=170, description="Angle from the lowest to the highest line."
    )
    horizontal_field_deg: Annotated[float, SCAN_WIDTH] = Field(
        default=360.0, ge=0.01, le=360, description="Angle along a line, centred on the x axis of the site."
    )
    resolution_deg: Annotated[float, RESOLUTION] = Field(
        default=0.2, ge=0.02, le=10, description="Angle between the rays of a line."
    )
    rate_hz: Annotated[float, SCAN_RATE] = Field(
        default=10.0, ge=1e-3, le=300, description="Scans per second; at most one per lighthouse period."
    )
    range_noise_mm: Annotated[float, RANGE_NOISE] = Field(
        default=10.0, ge=0, le=100, description="Standard deviation of a range."
    )
    jitter_deg: Annotated[float, RAY_JITTER] = Field(
        default=0.02, ge=0, le=1, description="Standard deviation of the direction of a ray per axis."
    )
    range_min_m: Annotated[float, RANGE_MIN] = Field(default=0.3, ge=0, le=1000, description="Least range of a return.")
    range_max_m: Annotated[float, APART_MAX] = Field(
        default=60.0, ge=0.01, le=10000, description="Largest range of a return; returns fade before it."
    )
    incidence_max_deg: Annotated[float, INCIDENCE] = Field(
        default=87.0, ge=1, le=90, description="Largest angle of incidence of a return; returns fade before it."
    )
    dropout_probability: Probability = Field(default=0.01, description="Probability that a ray is lost for no reason.")
    target_acceleration_m_s2: ProcessNoise = Field(
        default=0.005,
        description="Process noise of the filter of the target's motion: white acceleration, standard deviation per "
        "axis and period.",
    )
    target_angular_acceleration_deg_s2: TurningNoise = Field(
        default=1.0,
        description="Process noise of the filter of the target's motion: white angular acceleration, standard "
        "deviation per axis and period.",
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Require a range that is not empty."""
        if self.range_min_m >= self.range_max_m:
            yield f"must be below range_max_m = {self.range_max_m} m", "range_min_m", "range_max_m"
