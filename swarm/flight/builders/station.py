"""The lighthouse of a scenario and the craft's timing circuits, in SI units."""

from math import pi, radians, sqrt

from estimators.arrays import Bools
from estimators.calibration.problem import Noise
from estimators.lighthouse.sweep import FanErrors
from swarm import scenario
from swarm.onboard.decoder import PulseDecoder
from swarm.scenario import Scenario
from swarm.sensors.lighthouse import LighthouseSettings

ARCSEC = radians(1 / 3600)
FAN_ERROR_MAX_RAD = 0.1
"""What a fan's systematic errors can add to a sweep angle at most; the decoder believes angles so far outside."""
WIDEST_HALF_FIELD_RAD = 1.57
"""Just below pi/2: no fan can be seen from behind."""


def lighthouse(settings: Scenario) -> LighthouseSettings:
    """The station's settings in SI units."""
    table = settings.lighthouse
    return LighthouseSettings(
        rate_hz=table.rate_hz,
        angle_noise_rad=table.angle_noise_arcsec * ARCSEC,
        rotor_correlation=table.rotor_correlation,
        sync_jitter_s=table.sync_jitter_ns * 1e-9,
        tick_s=table.tick_ns * 1e-9,
        field_rad=radians(table.field_deg),
        range_min_m=table.range_min_m,
        range_max_m=table.range_max_m,
        incidence_max_rad=radians(table.incidence_max_deg),
        photodiode_diameter_m=table.photodiode_diameter_mm * 1e-3,
        mounting_error_m=table.mounting_error_mm * 1e-3,
        mounting_seed=table.mounting_seed,
        missed_sync_probability=table.missed_sync_probability,
        lost_pulse_probability=table.lost_pulse_probability,
        stray_pulse_rate_hz=table.stray_pulse_rate_hz,
        fan_x=_fan(table.fan_x),
        fan_y=_fan(table.fan_y),
    )


def decoder(settings: Scenario, present: Bools) -> PulseDecoder:
    """The timing circuits of craft with the photodiodes `present` (C, K)."""
    station = lighthouse(settings)
    half = min(station.field_rad / 2 + FAN_ERROR_MAX_RAD, WIDEST_HALF_FIELD_RAD)
    return PulseDecoder(present, station.tick_s, rate_hz=station.rate_hz, field_half_angle_rad=half)


def angle_noise(settings: Scenario) -> Noise:
    """The random error of one sweep angle, its own and the sweep's, as the lighthouse and the circuits make it (19)."""
    station = lighthouse(settings)
    w = 2 * pi * station.rate_hz
    rho, variance = station.rotor_correlation, station.angle_noise_rad**2
    # Sweep and flash are each rounded to a tick; a craft's photodiodes share their flash, its rounding and its jitter.
    rounding = (w * station.tick_s) ** 2 / 12
    shared = rho * variance + rounding + (w * station.sync_jitter_s) ** 2
    return Noise(sqrt((1 - rho) * variance + rounding), sqrt(shared))


def _fan(table: scenario.Fan) -> FanErrors:
    return FanErrors(table.phase_rad, table.tilt_rad, table.curve, table.gibbous_phase_rad, table.gibbous_magnitude)
