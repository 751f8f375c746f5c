"""The timing circuits of the craft, and the noise of a sweep angle."""

from math import pi, sqrt

from estimators.arrays import Bools
from estimators.calibration.problem import Noise
from swarm.onboard.decoder import PulseDecoder
from swarm.scenario import Scenario
from swarm.units import si

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
    w = 2 * pi * station.rate_hz
    rho, variance = station.rotor_correlation, station.angle_noise_rad**2
    # Sweep and flash are each rounded to a tick; a craft's photodiodes share their flash, its rounding and its jitter.
    rounding = (w * station.tick_s) ** 2 / 12
    shared = rho * variance + rounding + (w * station.sync_jitter_s) ** 2
    return Noise(sqrt((1 - rho) * variance + rounding), sqrt(shared))
