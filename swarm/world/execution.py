"""What thrusters really do: their own errors of size and direction, and the faults that a schedule gives them."""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.rotation import exp
from swarm import random
from swarm.hardware import Thrusters
from swarm.random import Purpose


class ActuatorFaults(NamedTuple):
    """Thrusters that do not obey in one period, (C, N) each, N as of the craft that has most; open goes before shut.

    stuck_open: give their full force all the time. stuck_shut: none.
    """

    stuck_open: Bools
    stuck_shut: Bools


def executed(thrusters: Thrusters, errors: tuple[float, float], key: int, seed: int) -> Floats:
    """The force vectors (N, 3) [N], body frame, that a craft's thrusters really give while open.

    errors: 1 sigma of a thruster's relative error of force, and of its tilt about each axis across [rad]; drawn once
    per thruster from the seed and the craft's `key` alone.
    """
    magnitude, direction_rad = errors
    draws = random.stream(seed, Purpose.THRUST, key).standard_normal((len(thrusters.force_n), 4))
    tilt = direction_rad * draws[:, 1:]
    tilt -= np.sum(tilt * thrusters.exhaust, axis=1, keepdims=True) * thrusters.exhaust
    turned = (exp(tilt) @ thrusters.exhaust[..., None])[..., 0]
    # A thruster may be weak, but it does not pull.
    size = thrusters.force_n * np.maximum(1 + magnitude * draws[:, 0], 0.0)
    out: Floats = -size[:, None] * turned
    return out


def obeyed(share: Floats, who: Ints, faults: ActuatorFaults | None) -> Floats:
    """Shares of steps (S, A, N) in which the thrusters of the craft `who` (A,) are open, with the faults in force."""
    if faults is None:
        return share
    out = np.where(faults.stuck_shut[who], 0.0, share)
    return np.where(faults.stuck_open[who], 1.0, out)
