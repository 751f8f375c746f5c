"""Pulse modulation: from the mean force of a period to the pulse of an on-off thruster.

A thruster is open or shut: a mean force f over a period T is one pulse of t = T f / F in the middle of the period, with
F its force while open. A pulse below the shortest (minimum impulse I: t < I / F) is not fired; the caller carries its
impulse over. At the epoch in mid-period, a pulse has changed the velocity as the constant force f would have. The
physics applies the mean over each of its steps: impulses are exact, their instants to one step.
"""

import numpy as np

from estimators.arrays import Floats


def on_time(share: Floats, shortest_s: Floats, period_s: float) -> Floats:
    """Return the opening time of each thruster [s].

    Args:
        share: mean force as a share of the thruster's force, 0 to 1.
        shortest_s: shortest pulse I / F [s].
        period_s: length T of the period [s].
    """
    open_s = period_s * np.clip(share, 0.0, 1.0)
    out: Floats = np.where(open_s < shortest_s, 0.0, open_s)
    return out
