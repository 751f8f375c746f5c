"""The tables of the navigation on board."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from swarm.scenario.faults import Names
from swarm.scenario.limits import (
    ALERT,
    ALERT_ATTITUDE,
    ASSUMED_NOISE,
    COAST,
    FALSE_PHOTODIODES,
    FALSE_STATIONS,
    GATE,
    MODELS,
    PUSH,
    RARE,
    RISK,
    SHARE_OF_NOISE,
    STAY,
    TURNING_PUSH,
)
from swarm.scenario.relative import FanSigma
from swarm.scenario.table import Mistake, ProcessNoise, Table, TurningNoise


class Integrity(Table):
    """Every craft tests its own pose, and computes how far off it may be. See docs/integrity.md."""

    residual_test: bool | None = Field(
        default=None,
        description="Whether the residuals of every pose are tested, and photodiodes that disagree are left out. "
        "Unset: true where the angle noise accounts for every error, that is, with motion compensation, and with a "
        "calibration where fans or mountings have errors: of every craft's photodiodes, where mountings have.",
    )
    false_alarm_probability: Annotated[float, RARE] = Field(
        default=1e-7, ge=1e-15, lt=0.5, description="Probability that the residual test rejects a pose without fault."
    )
    missed_detection_probability: Annotated[float, RARE] = Field(
        default=1e-4,
        ge=1e-15,
        lt=0.5,
        description="Probability that a fault as large as the protection level allows for is not detected.",
    )
    integrity_risk: Annotated[float, RISK] = Field(
        default=1e-7,
        ge=1e-15,
        lt=0.2,
        description="Probability that an error exceeds its protection level, per estimate.",
    )
    alert_position_mm: Annotated[float | None, ALERT] = Field(
        default=None,
        ge=1e-6,
        le=1e6,
        description="Protection level of the position above which the craft raises an alert. Unset: never.",
    )
    alert_attitude_deg: Annotated[float | None, ALERT_ATTITUDE] = Field(
        default=None,
        ge=1e-6,
        le=180,
        description="Protection level of the attitude above which the craft raises an alert. Unset: never.",
    )
    false_photodiodes: Annotated[int, FALSE_PHOTODIODES] = Field(
        default=0,
        ge=0,
        le=2,
        description="Number of photodiodes that may be false all the time without an error beyond the filter's "
        "protection level, by separation of solutions: filters that leave out one or two of them (docs/integrity.md). "
        "0: the level has what one false photodiode may do that a pose's residual test misses.",
    )
    false_stations: Annotated[int, FALSE_STATIONS] = Field(
        default=0,
        ge=0,
        le=1,
        description="Number of [[station]] tables that may be false all the time, as by a station that was moved, "
        "without an error beyond the filter's protection level, by filters that leave out one of them each "
        "(docs/integrity.md).",
    )
    unseen_acceleration_m_s2: Annotated[float, PUSH] = Field(
        default=0.0,
        ge=0,
        le=100,
        description="Largest unknown acceleration for which levels by separation of solutions allow without light.",
    )
    unseen_angular_acceleration_deg_s2: Annotated[float, TURNING_PUSH] = Field(
        default=0.0,
        ge=0,
        le=36000,
        description="Largest unknown angular acceleration for which they allow without light.",
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Refuse unseen accelerations where levels are not by separation of solutions."""
        for key in ("unseen_acceleration_m_s2", "unseen_angular_acceleration_deg_s2"):
            if getattr(self, key) and not (self.false_photodiodes or self.false_stations):
                yield "has no effect without levels by separation of solutions", key, "false_photodiodes"


class Quiet(Table):
    """The filter's other models of motion: those of craft which nothing pushes much but what it knows of."""

    craft: Literal["free", "all", "none"] = Field(
        default="all",
        description="Whose filter has quieter models beside that of a craft that manoeuvres, and weighs them by how "
        "well they predict the light (docs/filter.md): craft that hold neither place nor attitude, all, or none.",
    )
    models: Annotated[int, MODELS] = Field(
        default=6,
        ge=2,
        le=12,
        description="Number of models, with process noises in geometric series from that of navigation to the least. "
        "A craft runs the four about the likeliest.",
    )
    acceleration_noise_m_s2: ProcessNoise = Field(
        default=0.00005,
        description="Least process noise: white acceleration, standard deviation per axis and period.",
    )
    angular_acceleration_noise_deg_s2: TurningNoise = Field(
        default=0.003,
        description="Least process noise: white angular acceleration, standard deviation per axis and period.",
    )
    mean_duration_s: Annotated[float, STAY] = Field(
        default=30.0, ge=0.1, le=1e6, description="Mean time until a craft begins to move more."
    )
    mean_manoeuvre_s: Annotated[float, STAY] = Field(
        default=2.0, ge=0.1, le=1e6, description="Mean time until a craft begins to move less."
    )


class Navigation(Table):
    """Every craft computes its pose on board."""

    filter: Literal["auto", "filterpy", "compiled"] = Field(
        default="auto",
        description="Extended Kalman filter: that of filterpy, or one compiled for large swarms, with the same "
        "numbers. auto: filterpy up to 64 filters, craft times models of motion that run, compiled beyond.",
    )
    coupling: Literal["auto", "loose", "tight"] = Field(
        default="auto",
        description="What goes into the filter: the pose of a period where four or more photodiodes decide one, and "
        "where they do not its single sweep angles (auto); poses only (loose); or always the angles (tight).",
    )
    motion_compensation: bool = Field(
        default=True,
        description="Whether every angle is referred to its own instant; false: one period is one instant, as in the "
        "paper.",
    )
    angle_noise_arcsec: Annotated[float | None, ASSUMED_NOISE] = Field(
        default=None,
        ge=0.1,
        le=600,
        description="Standard deviation of a sweep angle that the craft assume, beside the rounding to ticks and the "
        "sync jitter, whose variances are added. Unset: that of the lighthouse.",
    )
    rotor_correlation: Annotated[float | None, SHARE_OF_NOISE] = Field(
        default=None, ge=0, le=1, description="Rotor correlation that the craft assume. Unset: that of the lighthouse."
    )
    acceleration_noise_m_s2: ProcessNoise = Field(
        default=0.2,
        description="Process noise: white acceleration, standard deviation per axis and period.",
    )
    angular_acceleration_noise_deg_s2: TurningNoise = Field(
        default=12.0,
        description="Process noise: white angular acceleration, standard deviation per axis and period.",
    )
    quiet: Quiet = Field(default=Quiet(), description="Motion of a craft that nothing pushes.")
    gate_probability: Annotated[float, GATE] = Field(
        default=0.99999, gt=0.5, lt=1, description="Share of good measurements that the innovation gate lets pass."
    )
    coast_limit_s: Annotated[float, COAST] = Field(
        default=2.0,
        ge=0,
        le=3600,
        description="Time for which a craft predicts without light before it searches again.",
    )
    calibration: str | None = Field(
        default=None,
        description="File with the systematic errors of the fans and the positions of the photodiodes that the craft "
        "use, as `swarm calibrate` writes it; its path is relative to this file. Unset: none.",
    )
    reference: Names = Field(
        default=(),
        description="Craft that stand still at known places and tell the others by how much each sweep is off there, "
        "which they take off theirs (docs/relative.md); a single name may stand alone. Empty: none.",
    )
    fan_sigma: FanSigma = Field(
        default=FanSigma(), description="Errors of the fans that are left over, in every covariance."
    )
    integrity: Integrity = Field(default=Integrity(), description="Integrity of the pose.")
