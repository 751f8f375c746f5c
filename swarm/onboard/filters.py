"""The filters of C craft, as the settings of their navigation want them."""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank
from estimators.filter.compiled import CompiledFilterBank
from estimators.filter.compiled_interacting import CompiledInteractingBank
from estimators.filter.filterpy_bank import PoseFilterBank
from estimators.filter.filterpy_interacting import FilterpyInteractingBank
from estimators.lanes import LANES
from swarm.onboard.settings import NavigationSettings
from swarm.onboard.tracks import TrackLimits, Tracks

MOST_BY_FILTERPY = 64
"""Largest number of filters, craft times models of motion that are run, by FilterPy; more are run by the compiled bank,
unless configured otherwise."""


def filters(craft: int, s: NavigationSettings, inertia: Floats | None) -> FilterBank:
    """Return the filters of C craft: one model of motion, or several from manoeuvring to quiet.

    Args:
        craft: number of craft.
        s: settings of the navigation.
        inertia: (C, 3, 3) [kg m^2] of craft that turn without torque; NaN for the others; None: of none.
    """
    adapts: Bools = np.zeros(craft, dtype=np.bool_)
    if s.quiet is not None and not s.quiet.only_free:
        adapts[:] = True
    elif s.quiet is not None and inertia is not None:
        adapts[:] = np.isfinite(inertia).all(axis=(1, 2))
    # Beside inertial sensors one model is enough: they show what the object does.
    several = s.quiet is not None and adapts.any() and s.inertial is None
    number = craft * (min(LANES, s.quiet.models) if s.quiet is not None and several else 1)
    compiled = number > MOST_BY_FILTERPY if s.filter == "auto" else s.filter == "compiled"
    if s.quiet is not None and several:
        noises, models = process_noises(s), np.where(adapts, s.quiet.models, 1)
        mixed = CompiledInteractingBank if compiled else FilterpyInteractingBank
        return mixed(noises, s.quiet.quiet_s, s.quiet.manoeuvre_s, models, s.gate_probability)
    kind: type[FilterBank] = CompiledFilterBank if compiled else PoseFilterBank
    # What they show is no process noise, and what they do not show is added in `swarm.onboard.inertial`.
    share = float(s.inertial is None)
    return kind(
        craft,
        acceleration_noise_m_s2=share * s.acceleration_noise_m_s2,
        angular_acceleration_noise_rad_s2=share * s.angular_acceleration_noise_rad_s2,
        gate_probability=s.gate_probability,
    )


def tracks_of(craft: int, s: NavigationSettings, inertia: Floats | None) -> Tracks:
    """Return the tracks of C craft, with all that the settings tell of how they move.

    Args:
        craft: number of craft.
        s: settings of the navigation.
        inertia: (C, 3, 3) [kg m^2] of craft that turn without torque; NaN for the others; None: of none.
    """
    limits = TrackLimits(s.coast_limit_s, s.rejections_limit)
    return Tracks(filters(craft, s, inertia), s.frame_s, limits, s.orbit, inertia, s.order_lead_s)


def process_noises(s: NavigationSettings) -> list[tuple[float, float]]:
    """Return the process noises [m/s^2], [rad/s^2] of the models of motion, the largest first, in geometric series."""
    most = s.acceleration_noise_m_s2, s.angular_acceleration_noise_rad_s2
    if s.quiet is None:
        return [most]
    least = s.quiet.acceleration_noise_m_s2, s.quiet.angular_acceleration_noise_rad_s2
    shares = np.linspace(0, 1, s.quiet.models)
    linear, angular = (
        (high * (min(low, high) / high) ** shares).tolist() for high, low in zip(most, least, strict=True)
    )
    return list(zip(linear, angular, strict=True))
