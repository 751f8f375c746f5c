"""The turns of wandering craft: three random angles relative to the frame F that an attitude prescribes.

R_l_b = F O,  O = Rx(a) Ry(b) Rz(c),   w_O = a' x + b' Rx y + c' Rx Ry z
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from swarm.scenario.motions.tones import Tones


class Turn(NamedTuple):
    """The turns O of W craft relative to their frames F, in F.

    rotation: O, (W, 3, 3).
    rate: angular rates, (W, 3) [rad/s].
    change: derivatives of the rates, (W, 3) [rad/s^2].
    """

    rotation: Floats
    rate: Floats
    change: Floats


def turn(fixed: Floats, tones: Tones, time_s: float) -> Turn:
    """Return O, its rate and its acceleration at one time.

    Args:
        fixed: The constant parts of the angles a, b, c, (W, 3) [rad].
        tones: The three signals of each craft that are added to them, (W, 3) [rad].
        time_s: The time [s].
    """
    value, first, second = tones.at(time_s)
    axis = np.eye(3)
    about_x, about_y, about_z = (rot.exp((fixed[:, i] + value[:, i])[:, None] * axis[i]) for i in range(3))
    x, y, z = np.broadcast_to(axis[0], fixed.shape), about_x @ axis[1], about_x @ about_y @ axis[2]
    rate_x, rate_y, rate_z = first[:, :1] * x, first[:, 1:2] * y, first[:, 2:] * z
    # Each axis is carried round by the turns before it.
    change = (
        second[:, :1] * x
        + second[:, 1:2] * y
        + second[:, 2:] * z
        + np.cross(rate_x, rate_y)
        + np.cross(rate_x + rate_y, rate_z)
    )
    return Turn(about_x @ about_y @ about_z, rate_x + rate_y + rate_z, change)
