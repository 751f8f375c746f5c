"""The table of the lighthouse, and of the reception of its light."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from swarm.scenario.limits import (
    ANGLE_NOISE,
    FIELD,
    INCIDENCE,
    JITTER,
    LISTENING,
    MOUNTING,
    PHOTODIODE,
    RANGE_MAX,
    RANGE_MIN,
    ROTOR_RATE,
    SEED,
    SHARE_OF_NOISE,
    STRAY,
    TICK,
)
from swarm.scenario.stations import Fan
from swarm.scenario.table import Mistake, Probability, Table


class Lighthouse(Table):
    """The lighthouse, and the photodiodes and timing circuits that receive its light."""

    model: str = Field(
        default="lighthouse", description="Model of the lighthouse that is drawn: a name, or the path of an MJCF file."
    )
    rate_hz: Annotated[float, ROTOR_RATE] = Field(
        default=60.0,
        ge=1,
        le=300,
        description="Turns per second; one period is one sweep of each fan.",
    )
    angle_noise_arcsec: Annotated[float, ANGLE_NOISE] = Field(
        default=8.8, ge=0, le=600, description="Standard deviation of one sweep angle."
    )
    rotor_correlation: Annotated[float, SHARE_OF_NOISE] = Field(
        default=0.8717,
        ge=0,
        le=1,
        description="Share of the noise's variance that comes from the rotor and is common to all photodiodes of a "
        "sweep.",
    )
    sync_jitter_ns: Annotated[float, JITTER] = Field(
        default=0.0,
        ge=0,
        le=1e4,
        description="Standard deviation of the instant of the flash that announces a sweep.",
    )
    tick_ns: Annotated[float, TICK] = Field(
        default=20.0,
        ge=0.01,
        le=5000,
        description="Resolution of the timing circuit of a craft.",
    )
    field_deg: Annotated[float, FIELD] = Field(
        default=120.0, ge=1, le=170, description="Full width of the field of view in each axis."
    )
    range_min_m: Annotated[float, RANGE_MIN] = Field(
        default=0.3, ge=0, le=1000, description="Least range at which a photodiode receives light."
    )
    range_max_m: Annotated[float, RANGE_MAX] = Field(
        default=20.0, ge=0.01, le=1000, description="Largest range at which a photodiode receives light."
    )
    incidence_max_deg: Annotated[float, INCIDENCE] = Field(
        default=80.0, ge=1, le=90, description="Largest angle between the normal of a photodiode and the light."
    )
    photodiode_diameter_mm: Annotated[float, PHOTODIODE] = Field(
        default=3.0, ge=0.01, le=20, description="Diameter of a photodiode, which sets the width of the sweep pulses."
    )
    listening_ms: Annotated[float | None, LISTENING] = Field(
        default=None,
        ge=1,
        le=1000,
        description="Time in the middle of a period for which the circuits listen to [[station]] tables of Lighthouse "
        "2.0; a turn takes 18.5 ms to 20 ms. Unset: always.",
    )
    mounting_error_mm: Annotated[float, MOUNTING] = Field(
        default=0.0,
        ge=0,
        le=10,
        description="Standard deviation of a photodiode's mounting position per axis, drawn once.",
    )
    mounting_seed: Annotated[int | None, SEED] = Field(
        default=None,
        ge=0,
        lt=10**18,
        description="Seed of the mounting errors, for the same hardware in runs of different seeds. Unset: the run's "
        "seed.",
    )
    missed_sync_probability: Probability = Field(default=0.0, description="Probability that a craft misses a flash.")
    lost_pulse_probability: Probability = Field(
        default=0.0, description="Probability that a photodiode misses a sweep."
    )
    stray_pulse_rate_hz: Annotated[float, STRAY] = Field(
        default=0.0, ge=0, le=5000, description="Rate of random pulses from elsewhere, per craft."
    )
    fan_x: Fan = Field(
        default=Fan(), description="Systematic errors of the fan that turns about the y axis (measures x/z)."
    )
    fan_y: Fan = Field(
        default=Fan(), description="Systematic errors of the fan that turns about the x axis (measures y/z)."
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Require a range that is not empty."""
        if self.range_min_m >= self.range_max_m:
            yield (
                f"range_min_m ({self.range_min_m} m) must be below range_max_m ({self.range_max_m} m)",
                "range_min_m",
                "range_max_m",
            )
