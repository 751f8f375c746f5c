"""Small records: of C craft at one epoch the truth, another program's poses, errors, NaN where unknown; equipment."""

from typing import NamedTuple

from estimators.arrays import Bools, Floats


class Equipment(NamedTuple):
    """Equipment by which a craft navigates: photodiodes on board, and names of its sensors, if it has any."""

    photodiodes: int
    sensors: tuple[str, ...]


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
