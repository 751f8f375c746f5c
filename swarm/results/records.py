"""What telemetry and recording take in, one period of C craft at a time, lighthouse frame; NaN where unknown."""

from typing import TYPE_CHECKING, NamedTuple, Protocol

from estimators.arrays import Bools, Floats, Ints
from swarm.results.columns.ccd import CcdFix

if TYPE_CHECKING:
    from estimators.lighthouse.dop import Dilution
    from estimators.lighthouse.pnp import PoseSolution


class Truth(NamedTuple):
    """The true state of C craft at the epoch, in the lighthouse frame.

    position: (C, 3) [m]. quaternion: (C, 4) wxyz of R_l_b. velocity: (C, 3) [m/s]. angular_rate: (C, 3) [rad/s].
    contact: (C,), touched something during the period.
    """

    position: Floats
    quaternion: Floats
    velocity: Floats
    angular_rate: Floats
    contact: Bools


class Peer(NamedTuple):
    """Somebody else's answer for the same epoch, in a replay; not the truth. NaN where there is none.

    position: (C, 3) [m]. quaternion: (C, 4) wxyz.
    """

    position: Floats
    quaternion: Floats


class Errors(NamedTuple):
    """Errors and the EKF's own opinion of them at one epoch, each (C,); NaN where truth or estimate is missing."""

    pnp_position_error_m: Floats
    pnp_attitude_error_deg: Floats
    position_error_m: Floats
    attitude_error_deg: Floats
    position_sigma_m: Floats
    attitude_sigma_deg: Floats
    nees: Floats


class Estimate(Protocol):
    """What telemetry reads of the navigation's estimate at one epoch, lighthouse frame; NaN where unknown."""

    @property
    def status(self) -> Ints:
        """(C,) index into STATUS."""

    @property
    def visible(self) -> Ints:
        """(C,) photodiodes seen by both fans."""

    @property
    def pnp(self) -> "PoseSolution":
        """The PnP solution of this period."""

    @property
    def dilution(self) -> "Dilution":
        """Its dilution of precision."""

    @property
    def rotation(self) -> Floats:
        """(C, 3, 3) R_l_b."""

    @property
    def position(self) -> Floats:
        """(C, 3) [m]."""

    @property
    def angular_rate(self) -> Floats:
        """(C, 3) [rad/s]."""

    @property
    def velocity(self) -> Floats:
        """(C, 3) [m/s]."""

    @property
    def covariance(self) -> Floats:
        """(C, 12, 12) of attitude, angular rate, position, velocity."""

    @property
    def nis(self) -> Floats:
        """(C,)."""

    @property
    def sensor(self) -> Ints:
        """(C,) index into SENSORS."""

    @property
    def ccd(self) -> CcdFix | None:
        """What the cameras found, where there are any."""

    @property
    def missed_sync(self) -> Ints:
        """(C,)."""

    @property
    def rejected(self) -> Ints:
        """(C,) pulses."""
