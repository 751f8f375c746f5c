"""From a validated scenario to what flies: user's units to SI, tables to the records of motion, world and navigation.

Everything that a scenario alone cannot show is wrong, a craft inside another one or a model without photodiodes, is
found here, before anything is written.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import pi, radians, sqrt
from typing import cast

import numpy as np

from estimators.arrays import Bools
from estimators.calibration_problem import Noise
from estimators.rotation import quaternion_from_matrix
from estimators.sweep import FanErrors
from swarm import scenario
from swarm.assets import find_model
from swarm.build_cameras import cameras, craft_keys
from swarm.build_lidars import lidars
from swarm.errors import SwarmError, did_you_mean
from swarm.layout import Photodiodes
from swarm.motion import fleet as motion
from swarm.motion.disturbance import Pushes
from swarm.motion.fleet import Fleet, Task, Vector
from swarm.onboard.decoder import PulseDecoder
from swarm.onboard.navigation import NavigationSettings
from swarm.recordings.station_calibration import read_calibration
from swarm.scenario import Craft, Scenario
from swarm.scenario.text import toml_value
from swarm.sensors.lighthouse import LighthouseSettings
from swarm.world.world import CraftStart, World

ARCSEC = radians(1 / 3600)
FAN_ERROR_MAX_RAD = 0.1
"""What a fan's systematic errors can add to a sweep angle at most; the decoder believes angles so far outside."""
WIDEST_HALF_FIELD_RAD = 1.57
"""Just below pi/2: no fan can be seen from behind."""
_START_KEYS = {"ring": "radius_m", "waypoints": "points_m", "approach": "from_m", "wander": "centre_m"}


def check(settings: Scenario) -> None:
    """Build everything once. Raises SwarmError as `fleet`, `world`, `believed_layout`, `cameras`, `lidars` do."""
    motions = fleet(settings)
    made = world(settings, motions)
    believed_layout(settings, made.photodiodes)
    cameras(settings, made, motions.at(0.0))
    lidars(settings, made)
    navigation(settings)


def fleet(settings: Scenario) -> Fleet:
    """The motion of every craft, in the order of `scenario.craft`.

    Raises SwarmError, naming scenario, key and value, where a motion makes no sense.
    """
    craft = scenario.craft(settings)
    tasks = [Task(_motion(c.motion, settings), c.index, c.count) for c in craft]
    try:
        return Fleet(tasks, settings.seed)
    except SwarmError:
        with _blame(settings, craft):
            for c, task in zip(craft, tasks, strict=True):
                try:
                    Fleet([task])
                except SwarmError as error:
                    raise SwarmError(f"craft {c.name!r}: {error}") from None
        raise


def steers_by_estimate(settings: Scenario) -> Bools:
    """(C,): the craft whose controller gets their own estimate, not the truth."""
    return np.array([craft.feedback == "estimate" for craft in scenario.craft(settings)], dtype=np.bool_)


def world(settings: Scenario, motions: Fleet) -> World:
    """The world with every craft where its motion starts.

    Raises SwarmError, naming scenario, key and value: a model that cannot fly, or a craft inside another one.
    """
    craft = scenario.craft(settings)
    start = motions.at(0.0)
    quaternion = quaternion_from_matrix(start.rotation)
    starts = [
        CraftStart(
            c.name, c.model, start.position[i], quaternion[i], start.velocity[i], start.angular_rate[i], c.passive
        )
        for i, c in enumerate(craft)
    ]
    with _blame(settings, craft):
        return World(
            starts,
            find_model(settings.lighthouse.model),
            settings.lighthouse.rate_hz,
            settings.physics.steps_per_period,
        )


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


def navigation(settings: Scenario) -> NavigationSettings:
    """What every craft's computer is configured with, in SI units.

    Raises SwarmError where the calibration file cannot be read.
    """
    table, station = settings.navigation, settings.lighthouse
    # A flash and a sweep, each rounded to a tick: variance tick^2 / 12 each. No craft may believe it does better.
    rounding_rad = 2 * pi * station.rate_hz * station.tick_ns * 1e-9 / sqrt(6)
    noise, correlation = table.angle_noise_arcsec, table.rotor_correlation
    made = NavigationSettings(
        frame_s=1 / station.rate_hz,
        angle_noise_rad=max((station.angle_noise_arcsec if noise is None else noise) * ARCSEC, rounding_rad),
        rotor_correlation=station.rotor_correlation if correlation is None else correlation,
        motion_compensation=table.motion_compensation,
        acceleration_noise_m_s2=table.acceleration_noise_m_s2,
        angular_acceleration_noise_rad_s2=radians(table.angular_acceleration_noise_deg_s2),
        gate_probability=table.gate_probability,
        coast_limit_s=table.coast_limit_s,
        filter=table.filter,
    )
    if table.calibration is None:
        return made
    calibration = read_calibration(table.calibration)
    return replace(made, fan_x=calibration.fan_x, fan_y=calibration.fan_y)


def believed_layout(settings: Scenario, drawn: Photodiodes) -> Photodiodes:
    """Where every craft believes its photodiodes to be: as drawn, or as its calibration has found them.

    A calibration's [photodiodes.NAME] is for the craft or the model of that name, the craft's going first. Raises
    SwarmError where it fits no craft, or has another number of photodiodes.
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


def photodiodes(settings: Scenario, world: World) -> Photodiodes:
    """The photodiodes that are on board: none of a craft with `lighthouse = false`."""
    on_board = np.array([c.lighthouse for c in scenario.craft(settings)], dtype=np.bool_)
    return world.photodiodes._replace(present=world.photodiodes.present & on_board[:, None])


def pushes(settings: Scenario) -> Pushes:
    """What pushes the craft beside their control."""
    tables = [c.disturbance for c in scenario.craft(settings)]
    sigma = np.array([(t.acceleration_m_s2, radians(t.angular_acceleration_deg_s2)) for t in tables], dtype=np.float64)
    return Pushes(sigma, craft_keys(settings), settings.seed)


def _fan(table: scenario.Fan) -> FanErrors:
    return FanErrors(table.phase_rad, table.tilt_rad, table.curve, table.gibbous_phase_rad, table.gibbous_magnitude)


def _motion(table: scenario.AnyMotion, settings: Scenario) -> motion.Motion:
    a = table.attitude
    attitude = motion.Attitude(
        a.facing, radians(a.roll_deg), radians(a.pitch_deg), radians(a.yaw_deg), radians(a.spin_deg_s)
    )
    match table:
        case scenario.Hold():
            return motion.Hold(table.position_m, table.spacing_m, attitude, table.box_m)
        case scenario.Ring():
            return motion.Ring(
                table.centre_m, table.radius_m, radians(table.rate_deg_s), radians(table.tilt_deg), attitude
            )
        case scenario.Waypoints():
            return motion.Waypoints(table.points_m, table.times_s, attitude)
        case scenario.Approach():
            return motion.Approach(table.from_m, table.to_m, table.start_s, table.speed_m_s, attitude)
        case scenario.Tumble():
            rate = cast(Vector, tuple(radians(w) for w in table.angular_rate_deg_s))
            return motion.Tumble(table.position_m, table.velocity_m_s, rate, table.spacing_m, attitude, table.box_m)
        case scenario.Drift():
            own, turn = table.acceleration_m_s2, table.angular_acceleration_deg_s2
            believed = settings.navigation
            return motion.Drift(
                table.position_m,
                believed.acceleration_noise_m_s2 if own is None else own,
                radians(believed.angular_acceleration_noise_deg_s2 if turn is None else turn),
                table.velocity_m_s,
                table.spacing_m,
                attitude,
                table.box_m,
            )
        case scenario.Wander():
            return motion.Wander(
                table.centre_m,
                table.size_m,
                table.speed_m_s,
                radians(table.turn_deg),
                radians(table.turn_rate_deg_s),
                table.bandwidth_hz,
                attitude,
            )


@contextmanager
def _blame(settings: Scenario, craft: list[Craft]) -> Iterator[None]:
    """Say which keys of the scenario a mistake comes from, where its message names a craft or a model's file."""
    try:
        yield
    except SwarmError as error:
        text = str(error)
        named = set(re.findall(r"'([^']+)'", text))
        keys: list[str] = []
        for i, c in enumerate(craft):
            single = i - settings.swarm.count
            table = f"craft[{single}]" if single >= 0 else "swarm"
            if str(c.model) in text:
                group = settings.craft[single] if single >= 0 else settings.swarm
                keys.append(f"{table}.model = {toml_value(group.model)}")
            elif c.name in named:
                spread = "spacing_m" if getattr(c.motion, "box_m", None) is None else "box_m"
                place = _START_KEYS.get(c.motion.kind, spread if c.count > 1 else "position_m")
                keys.append(f"{table}.motion.{place} = {toml_value(getattr(c.motion, place))}")
        where = ", ".join(dict.fromkeys(keys))
        raise SwarmError(f"scenario {settings.name}: {where}{': ' if where else ''}{text}") from None
