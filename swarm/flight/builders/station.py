"""The timing circuits of the craft, and the noise of a sweep angle."""

from math import pi, sqrt

from estimators.arrays import Bools
from estimators.calibration.problem import Noise
from swarm.onboard.decoder import PulseDecoder
from swarm.scenario import Scenario
from swarm.units import SI, si

FAN_ERROR_MAX_RAD = 0.1
"""Largest systematic error of a sweep angle [rad]; the decoder accepts angles up to this far outside the field."""
WIDEST_HALF_FIELD_RAD = 1.57
"""Largest half field [rad], just below pi/2: no fan is visible from behind."""


def decoder(settings: Scenario, present: Bools) -> PulseDecoder:
    """Return the timing circuits of craft with the photodiodes `present` (C, K)."""
    station = si(settings.lighthouse)
    half = min(station.field_rad / 2 + FAN_ERROR_MAX_RAD, WIDEST_HALF_FIELD_RAD)
    return PulseDecoder(present, station.tick_s, rate_hz=station.rate_hz, field_half_angle_rad=half)


def angle_noise(settings: Scenario) -> Noise:
    """Return the random error of one sweep angle (19) from lighthouse and circuits, its own part and the sweep's."""
    station = si(settings.lighthouse)
    return _with_timing(station, station.angle_noise_rad, station.rotor_correlation)


def timing_noise(settings: Scenario) -> Noise:
    """Return the part of `angle_noise` that comes from ticks and jitter alone."""
    return _with_timing(si(settings.lighthouse), 0.0, 0.0)


def assumed_angle_noise(settings: Scenario) -> Noise:
    """Return the random error of one sweep angle that every craft assumes: its own part and the sweep's."""
    table, station = si(settings.navigation), si(settings.lighthouse)
    noise, correlation = table.angle_noise_rad, table.rotor_correlation
    return _with_timing(
        station,
        station.angle_noise_rad if noise is None else noise,
        station.rotor_correlation if correlation is None else correlation,
    )


def common_noise(settings: Scenario) -> float:
    """Return the standard deviation [rad] of the error of a sweep that craft assume to be one for all of them.

    It is the rotor's and the jitter's; the flash is rounded to a tick of every craft's own clock.
    """
    station, shared = si(settings.lighthouse), assumed_angle_noise(settings).rotor_rad
    own = (2 * pi * station.rate_hz * station.tick_s) ** 2 / 12
    return sqrt(max(shared**2 - own, 0.0))


def _with_timing(station: SI, sigma_rad: float, rho: float) -> Noise:
    """Add the variances of rounding and jitter to an angle noise (19) of standard deviation sigma and correlation rho.

    Sweep and flash are each rounded to a tick, of variance tick^2 / 12. A craft's photodiodes share their flash, its
    rounding and its jitter.
    """
    w = 2 * pi * station.rate_hz
    rounding = (w * station.tick_s) ** 2 / 12
    shared = rho * sigma_rad**2 + rounding + (w * station.sync_jitter_s) ** 2
    return Noise(sqrt((1 - rho) * sigma_rad**2 + rounding), sqrt(shared))
