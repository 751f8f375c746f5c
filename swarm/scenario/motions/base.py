"""The base of every kind of motion: from a table to the course of one craft."""

from dataclasses import dataclass
from math import ceil, sqrt
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

from pydantic import Field

from swarm.scenario.limits import ANGLE, SPACING, SPIN
from swarm.scenario.motions.paths import Path
from swarm.scenario.table import Box, Table, Vector
from swarm.units import si

if TYPE_CHECKING:
    from estimators.relative_orbit import RelativeOrbit

Angle = Annotated[float, Field(ge=-360, le=360), ANGLE]

FILL = 1.2207440846057596
"""The real root of g^4 = g + 1."""


@dataclass(frozen=True)
class Place:
    """One craft, and all that its course may depend on beside its motion's table.

    index, count: the craft's place among the craft that share the motion. seed, key: name its random draws.
    acceleration_noise_m_s2, angular_acceleration_noise_rad_s2: the navigation filter's process noise. orbit: the
    lighthouse's, None in weightless space.
    """

    index: int = 0
    count: int = 1
    seed: int = 0
    key: int = 0
    acceleration_noise_m_s2: float = 0.0
    angular_acceleration_noise_rad_s2: float = 0.0
    orbit: "RelativeOrbit | None" = None


class Course(NamedTuple):
    """The motion that one craft should follow: its path, its attitude, and what is left free; SI units.

    facing: the front follows the direction to the lighthouse. turn_rad: turns about the body's axes x, y and z after
    that. spin_rad_s: a steady spin about the body's z axis. free: nothing is held after the start. rate_rad_s: the
    angular rate at the start of a free craft, beside its spin, lighthouse frame. push: 1 sigma per axis of the random
    acceleration [m/s^2] and angular acceleration [rad/s^2], constant over each period. key: names its random draws.
    """

    path: Path
    facing: bool = True
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin_rad_s: float = 0.0
    free: bool = False
    rate_rad_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    push: tuple[float, float] = (0.0, 0.0)
    key: int = 0


class Motion(Table):
    """A kind of motion. starts_at: the key that says where the craft start."""

    starts_at: ClassVar[str]

    def path(self, place: Place) -> Path:
        """Return the path of one craft. Raises SwarmError where there is no such path."""
        raise NotImplementedError

    def course(self, place: Place) -> Course:
        """Return the course of one craft. Raises SwarmError as `path` does."""
        return Course(self.path(place), key=place.key)

    def start_key(self, count: int) -> str:
        """Return the key that says where `count` craft start."""
        return self.starts_at


class Attitude(Table):
    """The craft's attitude while it follows its motion."""

    facing: bool = Field(
        default=True,
        description="Whether the front (body +z) follows the direction to the lighthouse. If false, the angles below "
        "are absolute, against the lighthouse frame.",
    )
    roll_deg: Angle = Field(default=0.0, description="Third turn, about the body's z axis.")
    pitch_deg: Angle = Field(default=0.0, description="Second turn, about the body's y axis.")
    yaw_deg: Angle = Field(default=0.0, description="First turn, about the body's x axis.")
    spin_deg_s: Annotated[float, SPIN] = Field(
        default=0.0, ge=-3600, le=3600, description="Steady spin about the body's z axis."
    )


class Turned(Motion):
    """A motion whose table says how the craft is turned meanwhile."""

    attitude: Attitude = Field(default=Attitude(), description="Attitude of the craft during the motion.")

    def course(self, place: Place) -> Course:
        """Return the course of one craft, with its attitude."""
        a = si(self.attitude)
        turn_rad = a.yaw_rad, a.pitch_rad, a.roll_rad
        return super().course(place)._replace(facing=a.facing, turn_rad=turn_rad, spin_rad_s=a.spin_rad_s)


def on_grid(middle: tuple[float, float, float], spacing_m: float, place: Place) -> tuple[float, float, float]:
    """Return the position [m] of one craft on a square grid perpendicular to z, row by row.

    Args:
        middle: middle of the grid [m].
        spacing_m: distance between neighbours [m].
        place: the craft.
    """
    side = ceil(sqrt(place.count))
    rows = -(-place.count // side)
    row, column = divmod(place.index, side)
    x, y, z = middle
    return x + (column - (side - 1) / 2) * spacing_m, y + (row - (rows - 1) / 2) * spacing_m, z


class Grid(Turned):
    """A motion that starts at one position; a swarm spreads over a square grid about it, perpendicular to z."""

    position_m: Vector = Field(
        default=(0.0, 0.0, 3.0), description="Position of the craft, or centre of the swarm's grid or box."
    )
    spacing_m: Annotated[float, SPACING] = Field(
        default=0.5, ge=1e-3, le=1000, description="Distance between neighbours in the grid of a swarm."
    )

    def where(self, place: Place) -> tuple[float, float, float]:
        """Return the position of one craft at the start [m], row by row on the grid."""
        return on_grid(self.position_m, self.spacing_m, place)

    def start_key(self, count: int) -> str:
        """Return the key that says where `count` craft start."""
        return "spacing_m" if count > 1 else "position_m"


class Spread(Grid):
    """A motion that starts at one position; a swarm spreads over a grid about it, or fills a box."""

    box_m: Box | None = Field(
        default=None,
        description="Size of a box that a swarm fills, centred at position_m; the place of a craft does not depend on "
        "the number of craft. Unset: the grid.",
    )

    def where(self, place: Place) -> tuple[float, float, float]:
        """Return the position of one craft at the start [m].

        A box is filled evenly by the additive recurrence x_n = (1/2 + n a) mod 1, a = (1/g, 1/g^2, 1/g^3), g^4 = g + 1:
        the R sequence (M. Roberts, 2018), whose craft 0 is in the middle.
        """
        if self.box_m is None:
            return super().where(place)
        x, y, z = (
            c + s * ((0.5 + place.index * FILL**-k) % 1 - 0.5)
            for k, (c, s) in enumerate(zip(self.position_m, self.box_m, strict=True), 1)
        )
        return x, y, z

    def start_key(self, count: int) -> str:
        """Return the key that says where `count` craft start."""
        return "box_m" if count > 1 and self.box_m is not None else super().start_key(count)
