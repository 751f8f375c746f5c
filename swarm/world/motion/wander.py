"""The turn of a wandering craft: three random angles relative to the frame F that its attitude prescribes.

R_l_b = F O,  O = Rx(a) Ry(b) Rz(c),   w_O = a' x + b' Rx y + c' Rx Ry z
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from swarm.scenario.motions.tones import Tones


class Turn(NamedTuple):
    """The turn O relative to the frame F, in F.

    rotation: O, (3, 3).
    rate: angular rate, (3,) [rad/s].
    change: derivative of the rate, (3,) [rad/s^2].
    """

    rotation: Floats
    rate: Floats
    change: Floats


def turn(fixed: Floats, tones: Tones, time_s: float) -> Turn:
    """Return O, its rate and its acceleration at one time.

    Args:
        fixed: The constant parts of the angles a, b, c, (3,) [rad].
        tones: The three signals that are added to them [rad].
        time_s: The time [s].
    """
    value, first, second = tones.at(time_s)
    axis = np.eye(3)
    about_x, about_y, about_z = (rot.exp((fixed[i] + value[i]) * axis[i]) for i in range(3))
    x, y, z = axis[0], about_x @ axis[1], about_x @ about_y @ axis[2]
    rate_x, rate_y, rate_z = first[0] * x, first[1] * y, first[2] * z
    # Each axis is carried round by the turns before it.
    change = (
        second[0] * x + second[1] * y + second[2] * z + np.cross(rate_x, rate_y) + np.cross(rate_x + rate_y, rate_z)
    )
    return Turn(about_x @ about_y @ about_z, rate_x + rate_y + rate_z, change)
