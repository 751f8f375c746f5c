"""Bounds on the error of physics steps, from how a craft is pushed and turned at most.

A step h takes velocity and place from those before by v' = v + h a(v), p' = p + h v': to first order in h the error of
a step is h^2/2 times the second derivative. With a constant acceleration a, after a time t,

    position             a t h / 2                                                                         (1)

With w the largest angular rate, alpha what torques add to it per second, k = max |I_i - I_j| / I_m of the moments of
inertia and H / I the wheels' momentum over the least of them, Euler's equations give

    D = k w^2 + w H / I + alpha           bound of the angular acceleration
    J = 2 k w + H / I                     bound of its derivative by the angular rate
    E = J D + w alpha                     bound of its own derivative; torques may stand still while the body turns

The error of the rate grows by h E / 2 and by J times itself, and that of the attitude by the rate's and by h D / 2
(Gronwall's lemma):

    attitude             h/2 (D t + E (exp(J t) - 1 - J t) / J^2)                                          (2)

Terms of h^2 are left out. docs/physics.md compares with steps eight times as short and shorter.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats

PERIOD_M, PERIOD_RAD = 20e-6, np.radians(20 / 3600)
"""Largest error within a period: 20 um, a sixth of the noise of a sweep at 3 m, and 20 arcsec, which at 0.2 m from the
centre are as much."""
SECOND_M, SECOND_RAD = 60 * PERIOD_M, np.radians(0.1)
"""Largest error after a second in which nothing corrects it, about the time in which control does: 1.2 mm, 0.1 deg."""
PASSED_M = 5e-3
"""Longest way of a craft in a step, within which a contact begins."""
DOCKING_S = 5e-3
"""Longest step where craft are to touch: a quarter of the 20 ms in which MuJoCo resolves a contact."""
LIMITS = {
    "20 um in a period": PERIOD_M,
    "20 arcsec in a period": PERIOD_RAD,
    "1.2 mm in a second": SECOND_M,
    "0.1 deg in a second": SECOND_RAD,
    "5 mm of way in a step": PASSED_M,
}
"""The limits in the order of `StepErrors`, by the names that a user reads."""
CHOICES = (2, 4, 8, 16, 32, 64)
"""Numbers of steps in a period to choose from."""


class Vigour(NamedTuple):
    """The largest speeds, rates and accelerations of C craft, (C,) each.

    speed: [m/s]. acceleration: [m/s^2]. rate: angular rate [rad/s]. turning: angular acceleration that torques make
    [rad/s^2]. shape: k of the moments of inertia. wheels: momentum of the wheels over the least moment [rad/s].
    shaking, shaking_turn: accelerations that are random in every period [m/s^2] and [rad/s^2].
    """

    speed: Floats
    acceleration: Floats
    rate: Floats
    turning: Floats
    shape: Floats
    wheels: Floats
    shaking: Floats
    shaking_turn: Floats


class StepErrors(NamedTuple):
    """Bounds on the errors of C craft, (C,) each.

    period_m, period_rad: of position and attitude within a period. second_m, second_rad: after a second in which
    nothing corrects them. passed_m: way in a step [m].
    """

    period_m: Floats
    period_rad: Floats
    second_m: Floats
    second_rad: Floats
    passed_m: Floats

    @property
    def shares(self) -> Floats:
        """Each craft's bounds over their limits, (LIMITS, C)."""
        return np.array([bound / limit for bound, limit in zip(self, LIMITS.values(), strict=True)])

    @property
    def over(self) -> Floats:
        """The largest of each craft's bounds over its limit, (C,): at most 1 where the steps are short enough."""
        out: Floats = self.shares.max(axis=0)
        return out


def step_errors(vigour: Vigour, period_s: float, steps: int) -> StepErrors:
    """Return the bounds on the errors of so many steps in a period.

    Args:
        vigour: how the craft move at most.
        period_s: length of a period [s].
        steps: steps in a period.
    """
    h, walk = period_s / steps, sqrt(period_s)
    # Of random accelerations, which add up as their squares do, the root of the periods in a second remains.
    return StepErrors(
        (vigour.acceleration + vigour.shaking) * period_s * h / 2,
        _attitude(vigour, vigour.turning + vigour.shaking_turn, period_s, h),
        (vigour.acceleration + walk * vigour.shaking) * h / 2,
        _attitude(vigour, vigour.turning + walk * vigour.shaking_turn, 1.0, h),
        vigour.speed * h,
    )


def _attitude(vigour: Vigour, turning: Floats, t: float, h: float) -> Floats:
    """Return (2), (C,) [rad]."""
    change = vigour.shape * vigour.rate**2 + vigour.wheels * vigour.rate + turning
    stiff = 2 * vigour.shape * vigour.rate + vigour.wheels
    bend = stiff * change + vigour.rate * turning
    # (exp(x) - 1 - x) / x^2, one half at zero; bounded, so that a craft that turns far too fast is a number as well.
    x = np.minimum(stiff * t, 50.0)
    growth = np.where(x > 1e-3, (np.expm1(x) - x) / np.maximum(x, 1e-3) ** 2, 0.5 + x / 6)
    out: Floats = h / 2 * (change * t + bend * t**2 * growth)
    return out


def least_steps(vigour: Vigour, period_s: float, docking: bool) -> int:
    """Return the least number of steps in a period, of `CHOICES`, whose errors stay below their limits.

    Args:
        vigour: how the craft move at most.
        period_s: length of a period [s].
        docking: whether craft are to touch.
    """
    for steps in CHOICES:
        short = not docking or period_s / steps <= DOCKING_S
        if short and step_errors(vigour, period_s, steps).over.max(initial=0.0) <= 1:
            return steps
    return CHOICES[-1]
