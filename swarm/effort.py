"""What the craft's actuators have done, as telemetry and recording show it."""

from typing import NamedTuple

from estimators.arrays import Bools, Floats, Ints


class Effort(NamedTuple):
    """The true work of C craft's actuators by the end of a lighthouse period.

    delta_v_m_s: (C,) [m/s] since the start: the impulse of every thruster over the mass, or that of an ideal force. open:
    (C, N), thrusters that were open in this period, padded to the craft that has most. thrusters: (C,), how many it has.
    wheel_momentum_nms: (C,) [N m s], of a craft's wheels together, NaN without any.
    """

    delta_v_m_s: Floats
    open: Bools
    thrusters: Ints
    wheel_momentum_nms: Floats
