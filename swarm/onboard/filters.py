"""The filters of C craft, as the settings of their navigation want them."""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank
from estimators.filter.compiled import CompiledFilterBank
from estimators.filter.filterpy_bank import PoseFilterBank
from estimators.filter.interacting import InteractingBank
from swarm.onboard.settings import NavigationSettings

MOST_BY_FILTERPY = 64
"""Largest number of craft filtered by FilterPy; more are filtered by the compiled bank, unless configured otherwise."""


def filters(craft: int, s: NavigationSettings, inertia: Floats | None) -> FilterBank:
    """Return the filters of C craft: one model of motion, or a quiet one beside it.

    Args:
        craft: number of craft.
        s: settings of the navigation.
        inertia: (C, 3, 3) [kg m^2] of craft that turn without torque; NaN for the others; None: of none.
    """
    compiled = craft > MOST_BY_FILTERPY if s.filter == "auto" else s.filter == "compiled"
    kind: type[FilterBank] = CompiledFilterBank if compiled else PoseFilterBank
    gate = s.gate_probability
    pushed = kind(
        craft,
        acceleration_noise_m_s2=s.acceleration_noise_m_s2,
        angular_acceleration_noise_rad_s2=s.angular_acceleration_noise_rad_s2,
        gate_probability=gate,
    )
    quiet_craft: Bools = np.zeros(craft, dtype=np.bool_)
    if s.quiet is not None and not s.quiet.only_free:
        quiet_craft[:] = True
    elif inertia is not None:
        quiet_craft[:] = np.isfinite(inertia).all(axis=(1, 2))
    if s.quiet is None or not quiet_craft.any():
        return pushed
    quiet = kind(
        craft,
        acceleration_noise_m_s2=min(s.quiet.acceleration_noise_m_s2, s.acceleration_noise_m_s2),
        angular_acceleration_noise_rad_s2=min(
            s.quiet.angular_acceleration_noise_rad_s2, s.angular_acceleration_noise_rad_s2
        ),
        gate_probability=gate,
    )
    return InteractingBank(quiet, pushed, s.quiet.quiet_s, s.quiet.manoeuvre_s, quiet_craft)
