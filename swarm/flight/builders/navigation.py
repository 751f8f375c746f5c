"""The settings of every craft's computer, and the photodiode layout that it assumes."""

from dataclasses import replace
from math import inf, sqrt

from swarm import scenario
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.builders.dynamics import orbit
from swarm.flight.builders.station import assumed_angle_noise, common_noise
from swarm.flight.recordings.station_calibration import StationCalibration, read_calibration
from swarm.hardware import Photodiodes
from swarm.onboard.integrity import IntegritySettings
from swarm.onboard.settings import NavigationSettings, QuietModel
from swarm.onboard.shared_errors import Relations
from swarm.scenario import Scenario
from swarm.units import si

SPEED_TOLERANCE = 20e-6
"""Largest relative speed error of a rotor to ignore: 31 urad at boresight, below the rotor's part of the noise."""


def navigation(settings: Scenario, steps: int | None = None) -> NavigationSettings:
    """Return the settings of every craft's computer.

    Args:
        settings: the scenario.
        steps: physics steps in a period; None: nothing is simulated, and orders count from the beginning of theirs.

    Raises:
        SwarmError: the calibration file cannot be read.
    """
    table, noise = si(settings.navigation), assumed_angle_noise(settings)
    calibration = None if table.calibration is None else read_calibration(table.calibration)
    made = NavigationSettings(
        frame_s=settings.period_s,
        angle_noise_rad=noise.sigma_rad,
        rotor_correlation=(noise.rotor_rad / noise.sigma_rad) ** 2,
        motion_compensation=table.motion_compensation,
        acceleration_noise_m_s2=table.acceleration_noise_m_s2,
        angular_acceleration_noise_rad_s2=table.angular_acceleration_noise_rad_s2,
        quiet=_quiet(settings),
        gate_probability=table.gate_probability,
        coast_limit_s=table.coast_limit_s,
        filter=table.filter,
        coupling=table.coupling,
        integrity=_integrity(settings, calibration),
        orbit=orbit(settings),
        relations=_relations(settings),
        # A physics step moves a body at the velocity of its end, half a step ahead of what the wrench makes of it.
        order_lead_s=0.0 if steps is None else settings.period_s / steps / 2,
    )
    if calibration is None:
        return made
    return replace(made, fan_x=calibration.fan_x, fan_y=calibration.fan_y)


def _relations(settings: Scenario) -> Relations:
    """Return what craft share by the light of the one lighthouse, and who navigates relative to whom."""
    names, left = settings.craft_names, si(settings.navigation.fan_sigma)
    terms = (
        ("phase", left.phase_rad),
        ("tilt", left.tilt_rad),
        ("curve", left.curve),
        ("gibbous", left.gibbous_magnitude),
        ("ogee", left.ogee_magnitude),
    )
    limits = [(si(pair).alert_position_m, si(pair).alert_attitude_rad) for pair in settings.pair]
    return Relations(
        tuple((names.index(pair.craft), names.index(pair.to)) for pair in settings.pair),
        tuple((inf if place is None else place, inf if turn is None else turn) for place, turn in limits),
        (common_noise(settings),),
        (1 / settings.lighthouse.rate_hz,),
        terms if any(sigma for _, sigma in terms) else (),
    )


def _quiet(settings: Scenario) -> QuietModel | None:
    table = si(settings.navigation.quiet)
    if table.craft == "none":
        return None
    return QuietModel(
        table.acceleration_noise_m_s2,
        table.angular_acceleration_noise_rad_s2,
        table.mean_duration_s,
        table.mean_manoeuvre_s,
        only_free=table.craft == "free",
        models=table.models,
    )


def _integrity(settings: Scenario, calibration: StationCalibration | None) -> IntegritySettings:
    table, station = si(settings.navigation.integrity), si(settings.lighthouse)
    test = settings.navigation.motion_compensation and _every_error_is_known(settings, calibration)
    # Two flashes, each off by at most a tick's rounding and eight sigma of jitter.
    doubt = (2 * station.tick_s + 8 * sqrt(2) * station.sync_jitter_s) * station.rate_hz
    return IntegritySettings(
        residual_test=test if table.residual_test is None else table.residual_test,
        false_alarm=table.false_alarm_probability,
        missed_detection=table.missed_detection_probability,
        risk=table.integrity_risk,
        alert_position_m=inf if table.alert_position_m is None else table.alert_position_m,
        alert_attitude_rad=inf if table.alert_attitude_rad is None else table.alert_attitude_rad,
        tick_s=station.tick_s,
        speed_tolerance=max(SPEED_TOLERANCE, doubt),
        false_photodiodes=table.false_photodiodes,
        false_stations=table.false_stations,
        unseen_acceleration_m_s2=table.unseen_acceleration_m_s2,
        unseen_angular_acceleration_rad_s2=table.unseen_angular_acceleration_rad_s2,
    )


def _every_error_is_known(settings: Scenario, calibration: StationCalibration | None) -> bool:
    """Tell whether fans, stations and mountings are without errors or known, or all taken off by a calibration."""
    drawn = settings.lighthouse
    if settings.station:
        return drawn.mounting_error_mm == 0 and all(table.known for table in settings.station)
    if calibration is None:
        return drawn.mounting_error_mm == 0 and drawn.fan_x == drawn.fan_y == scenario.Fan()
    placed = calibration.by_name
    return drawn.mounting_error_mm == 0 or all(
        craft.name in placed or craft.model.stem in placed for craft in scenario.craft(settings)
    )


def believed_layout(settings: Scenario, drawn: Photodiodes) -> Photodiodes:
    """Return the photodiodes as every craft assumes them: at their design positions, or at those of its calibration.

    A calibration's [photodiodes.NAME] applies to the craft or the model of that name; a craft's name has precedence.

    Raises:
        SwarmError: the calibration fits no craft, or has another number of photodiodes.
    """
    file = settings.navigation.calibration
    if file is None:
        return drawn
    calibration = read_calibration(file)
    if calibration.point_m is not None:
        raise SwarmError(
            f"{file}: [photodiodes] without a name belongs to one object of a replay; for simulated craft it is "
            "[photodiodes.NAME], with the name of a craft or a model"
        )
    craft = scenario.craft(settings)
    point_m = drawn.point_m.copy()
    placed = {i: name for i, c in enumerate(craft) for name in (c.model.stem, c.name) if name in calibration.by_name}
    if calibration.by_name and not placed:
        known = {name for c in craft for name in (c.model.stem, c.name)}
        name = next(iter(calibration.by_name))
        raise SwarmError(f"{file}: [photodiodes.{name}]: no craft or model has this name{did_you_mean(name, known)}")
    for i, name in placed.items():
        found, count = calibration.by_name[name], int(drawn.present[i].sum())
        if len(found) != count:
            raise SwarmError(
                f"{file}: [photodiodes.{name}] places {len(found)} photodiodes, but craft {craft[i].name!r} has {count}"
            )
        point_m[i, drawn.present[i]] = found
    return drawn._replace(point_m=point_m)
