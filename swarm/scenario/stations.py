"""The `[[station]]` tables of a scenario: lighthouse stations of either generation, in the world or on a craft."""

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from pydantic import Field

from swarm.errors import did_you_mean
from swarm.scenario.limits import (
    ANGLE,
    ANGLE_NOISE,
    BEAM,
    CHANNEL,
    FAN,
    FIELD,
    PHASE,
    SHARE_OF_NOISE,
    SURVEY,
    SURVEY_TURN,
)
from swarm.scenario.table import Mistake, Table, Vector

NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"
CHANNELS = 16
"""Number of channels of Lighthouse 2.0, and so of its stations that can be told apart."""
TAKING_TURNS = 2
"""Largest number of Lighthouse 1.0 stations: they take turns, and their flashes tell two of them apart."""

FanError = Annotated[float, Field(ge=-0.5, le=0.5), FAN]


class Fan(Table):
    """Systematic errors of one fan, all zero for a perfect fan; equation (E) of `estimators.lighthouse.sweep` defines
    their signs.
    """

    phase_rad: FanError = Field(default=0.0, description="Constant error; a positive one lowers the angle.")
    tilt_rad: FanError = Field(
        default=0.0,
        description="Skew of the fan; a positive one lowers the angle where the other coordinate is > 0.",
    )
    curve: FanError = Field(
        default=0.0,
        description="Bend of the fan; a positive one raises the angle at both ends of the fan.",
    )
    gibbous_phase_rad: Annotated[float, PHASE] = Field(
        default=0.0, ge=-6.3, le=6.3, description="Phase of the once-per-turn error."
    )
    gibbous_magnitude: FanError = Field(default=0.0, description="Amplitude of the once-per-turn error.")


class Plane(Table):
    """Systematic errors of one tilted plane of a Lighthouse 2.0 station, all zero for a perfect plane; equation (T) of
    `estimators.lighthouse.tilted` defines their signs.
    """

    phase_rad: FanError = Field(default=0.0, description="Constant error; a positive one lowers the angle.")
    tilt_rad: FanError = Field(default=0.0, description="Deviation from the nominal tilt of 30 deg to either side.")
    curve: FanError = Field(default=0.0, description="Bend of the plane, in units of the manufacturer's series.")
    gibbous_phase_rad: Annotated[float, PHASE] = Field(
        default=0.0, ge=-6.3, le=6.3, description="Phase of the once-per-turn error."
    )
    gibbous_magnitude: FanError = Field(default=0.0, description="Amplitude of the once-per-turn error.")
    ogee_phase_rad: Annotated[float, PHASE] = Field(
        default=0.0, ge=-6.3, le=6.3, description="Phase of the bend that changes along the turn."
    )
    ogee_magnitude: FanError = Field(default=0.0, description="Amplitude of the bend that changes along the turn.")


class Pointing(Table):
    """The direction in which a station looks: its z axis; x is to its right, y is down."""

    towards_m: Vector | None = Field(
        default=None,
        description="Point that the station looks at, its y axis as near to the world's y axis (down) as possible; the "
        "angles below turn it from there. Unset: the angles are absolute.",
    )
    roll_deg: Annotated[float, ANGLE] = Field(
        default=0.0, ge=-360, le=360, description="Third turn, about the station's z axis."
    )
    pitch_deg: Annotated[float, ANGLE] = Field(
        default=0.0, ge=-360, le=360, description="Second turn, about the station's y axis."
    )
    yaw_deg: Annotated[float, ANGLE] = Field(
        default=0.0, ge=-360, le=360, description="First turn, about the station's x axis."
    )


class Station(Table):
    """One lighthouse station. With any, they take the place of the one lighthouse at the origin; what they do not say
    themselves, and the photodiodes and timing circuits that receive their light, is in [lighthouse]. See
    docs/stations.md.
    """

    name: str = Field(pattern=NAME_PATTERN, max_length=64, description="Name of the station.")
    kind: Literal["lighthouse-1", "lighthouse-2"] = Field(
        default="lighthouse-2",
        description="Generation: two straight fans and flashes, at most two stations, which take turns (lighthouse-1), "
        "or two tilted planes whose light carries the station's channel, at most 16 stations (lighthouse-2).",
    )
    craft: str | None = Field(
        default=None,
        description="Craft on which the station rides; pose and point are then in that craft's frame. Unset: none, the "
        "station stays where it is.",
    )
    bearer: Literal["truth", "estimate"] = Field(
        default="truth",
        description="What the others know of the craft on which the station rides: its true pose, or the pose that its "
        "own filter predicts, with the covariance.",
    )
    position_m: Vector = Field(default=(0.0, 0.0, 0.0), description="Position: where the planes of light start.")
    attitude: Pointing = Field(default=Pointing(), description="Direction in which the station looks.")
    channel: Annotated[int | None, CHANNEL] = Field(
        default=None,
        ge=1,
        le=CHANNELS,
        description="Channel of a Lighthouse 2.0 station, which sets the duration of its turn. Unset: the lowest one "
        "that no other station has.",
    )
    angle_noise_arcsec: Annotated[float | None, ANGLE_NOISE] = Field(
        default=None,
        ge=0,
        le=600,
        description="Standard deviation of one sweep angle. Unset: that of [lighthouse], or 2.6 of lighthouse-2.",
    )
    rotor_correlation: Annotated[float | None, SHARE_OF_NOISE] = Field(
        default=None,
        ge=0,
        le=1,
        description="Share of the noise's variance that all photodiodes of a sweep have in common. Unset: that of "
        "[lighthouse], or 0.35 of lighthouse-2.",
    )
    field_deg: Annotated[float | None, FIELD] = Field(
        default=None, ge=1, le=170, description="Full width of the field in each axis. Unset: that of [lighthouse]."
    )
    beam_mm: Annotated[float, BEAM] = Field(
        default=4.0,
        ge=0,
        le=50,
        description="Thickness of a Lighthouse 2.0 station's plane of light; the longer it stays on a photodiode, the "
        "more bits are caught.",
    )
    fan_x: Fan = Field(default=Fan(), description="Systematic errors of fan X of a Lighthouse 1.0 station.")
    fan_y: Fan = Field(default=Fan(), description="Systematic errors of its fan Y.")
    plane_1: Plane = Field(default=Plane(), description="Systematic errors of the first plane of a Lighthouse 2.0.")
    plane_2: Plane = Field(default=Plane(), description="Systematic errors of its second plane.")
    calibrated: bool = Field(
        default=True,
        description="Whether the craft know these errors, as from the calibration that a station sends. If false, they "
        "take the station for perfect.",
    )
    position_error_mm: Annotated[float, SURVEY] = Field(
        default=0.0,
        ge=0,
        le=1000,
        description="Standard deviation of the position that the craft assume, per axis, drawn once; they do not know "
        "of it.",
    )
    attitude_error_deg: Annotated[float, SURVEY_TURN] = Field(
        default=0.0, ge=0, le=30, description="Standard deviation of the attitude that they assume, likewise."
    )

    @property
    def second(self) -> bool:
        """True for Lighthouse 2.0."""
        return self.kind == "lighthouse-2"

    @property
    def known(self) -> bool:
        """True if the craft know the station as it is."""
        perfect = self.fan_x == self.fan_y == Fan() and self.plane_1 == self.plane_2 == Plane()
        return (self.calibrated or perfect) and not self.position_error_mm and not self.attitude_error_deg

    def between_keys(self) -> Iterator[Mistake]:
        """Refuse what the other generation has, and a direction to the station's own place."""
        for key in ("fan_x", "fan_y") if self.second else ("plane_1", "plane_2", "channel"):
            if getattr(self, key) != type(self).model_fields[key].default:
                yield f"a station of kind {self.kind!r} has no {key}", key, "kind"
        if self.bearer != "truth" and self.craft is None:
            yield "the station rides on no craft: set craft, or leave bearer out", "bearer"
        if self.attitude.towards_m == self.position_m:
            yield "the station cannot look at its own place", "attitude.towards_m", "position_m"


def mistakes(stations: Sequence[Station], craft: Sequence[str]) -> Iterator[Mistake]:
    """Yield the mistakes between several stations, and between stations and craft.

    Args:
        stations: all stations.
        craft: names of all craft.
    """
    names = [station.name for station in stations]
    for i, station in enumerate(stations):
        if station.name in names[:i]:
            yield "another station has this name", f"station[{i}].name"
        if station.name in craft or station.name == "lighthouse":
            what = "the lighthouse itself" if station.name == "lighthouse" else "a craft"
            yield f"is the name of {what}", f"station[{i}].name"
        if station.craft is not None and station.craft not in craft:
            yield f"no craft has this name{did_you_mean(station.craft, craft)}", f"station[{i}].craft"
        if station.kind != stations[0].kind:
            said = "all stations must be of one kind: a craft's timing circuits follow one generation"
            yield said, f"station[{i}].kind", "station[0].kind"
        if station.channel is not None and station.channel in [other.channel for other in stations[:i]]:
            yield "another station has this channel", f"station[{i}].channel"
    most = CHANNELS if stations and stations[0].second else TAKING_TURNS
    if len(stations) > most:
        why = "there are 16 channels" if most == CHANNELS else "they take turns, and only two can be told apart"
        yield f"at most {most} stations of kind {stations[0].kind!r}: {why}", f"station[{most}].kind"


def channels(stations: Sequence[Station]) -> list[int]:
    """Return the channel of every Lighthouse 2.0 station, from 1: its own, or the lowest one that is free."""
    free = (n for n in range(1, CHANNELS + 1) if n not in [station.channel for station in stations])
    return [next(free) if station.channel is None else station.channel for station in stations]
