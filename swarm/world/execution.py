"""The thrusters' true behaviour: their own errors of force and direction, and the faults that a schedule gives them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.rotation import exp
from swarm import random
from swarm.hardware import Thrusters
from swarm.random import Purpose


class StuckThruster(NamedTuple):
    """A stuck thruster.

    craft: index of the craft.
    thruster: index of the thruster on the craft.
    on: True where it fires all the time, False where it never fires.
    """

    craft: int
    thruster: int
    on: bool


def executed(thrusters: Thrusters, errors: tuple[float, float], key: int, seed: int) -> Floats:
    """Return the true force vectors (N, 3) [N], body frame, of a craft's thrusters while open.

    The errors are drawn once per thruster from `seed` and `key` alone.

    Args:
        thrusters: the N thrusters.
        errors: 1 sigma of a thruster's relative error of force, and of its tilt about each transverse axis [rad].
        key: key of the craft's random numbers.
        seed: seed of the run.
    """
    magnitude, direction_rad = errors
    draws = random.stream(seed, Purpose.THRUST, key).standard_normal((len(thrusters.force_n), 4))
    tilt = direction_rad * draws[:, 1:]
    tilt -= np.sum(tilt * thrusters.exhaust, axis=1, keepdims=True) * thrusters.exhaust
    turned = (exp(tilt) @ thrusters.exhaust[..., None])[..., 0]
    # A thruster may be weak, but its force never reverses.
    size = thrusters.force_n * np.maximum(1 + magnitude * draws[:, 0], 0.0)
    out: Floats = -size[:, None] * turned
    return out


def open_share(open_s: Floats, period_s: float, steps: int) -> Floats:
    """Return the fraction (S, ...) of each physics step in which a pulse in mid-period is open.

    Args:
        open_s: length of each pulse, whose middle is that of the period, (...) [s].
        period_s: length of the period [s].
        steps: number of physics steps in the period, S.
    """
    edge = (np.linspace(0.0, period_s, steps + 1) - period_s / 2).reshape(-1, *[1] * open_s.ndim)
    # Length of the part of the pulse that has passed by each step's edge.
    passed = np.clip(edge + open_s / 2, 0.0, open_s)
    out: Floats = np.diff(passed, axis=0) * (steps / period_s)
    return out


def obeyed(share: Floats, who: Ints, stuck: Sequence[StuckThruster]) -> Floats:
    """Return the open fractions with the faults applied; a thruster that is stuck both open and shut is open.

    Args:
        share: fraction of each step in which each thruster is ordered to be open, (S, A, N).
        who: indices of the craft with actuators, (A,).
        stuck: thrusters that do not obey.
    """
    if not stuck:
        return share
    out = share.copy()
    place = {craft: a for a, craft in enumerate(who.tolist())}
    for fault in sorted(stuck, key=lambda fault: fault.on):
        if fault.craft in place:
            out[:, place[fault.craft], fault.thruster] = float(fault.on)
    return out
