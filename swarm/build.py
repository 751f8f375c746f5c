"""From a validated scenario to what flies: user's units to SI, tables to the records of motion, world and navigation.

Everything that a scenario alone cannot show is wrong, a craft inside another one or a model without photodiodes, is
found here, before anything is written.
"""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import pi, radians, sqrt
from typing import cast
from zlib import crc32

import numpy as np

from estimators.arrays import Bools
from estimators.rotation import quaternion_from_matrix
from estimators.stereo import FEWEST_COMMON
from estimators.sweep import FanErrors
from swarm import scenario
from swarm.assets import find_model
from swarm.errors import SwarmError
from swarm.layout import Photodiodes
from swarm.motion import fleet as motion
from swarm.motion.disturbance import Pushes
from swarm.motion.fleet import Fleet, Task, Vector
from swarm.onboard.ccd import CcdCalibration
from swarm.onboard.decoder import PulseDecoder
from swarm.onboard.navigation import NavigationSettings
from swarm.recordings.station_calibration import read_calibration
from swarm.scenario import Ccd, Craft, Scenario
from swarm.scenario.text import toml_value
from swarm.sensors.ccd import CcdSettings, Outage
from swarm.sensors.lighthouse import LighthouseSettings
from swarm.world.world import CraftStart, World

ARCSEC = radians(1 / 3600)
FAN_ERROR_MAX_RAD = 0.1
"""What a fan's systematic errors can add to a sweep angle at most; the decoder believes angles so far outside."""
WIDEST_HALF_FIELD_RAD = 1.57
"""Just below pi/2: no fan can be seen from behind."""
_START_KEYS = {"ring": "radius_m", "waypoints": "points_m", "approach": "from_m", "wander": "centre_m"}


def check(settings: Scenario) -> None:
    """Build everything once. Raises SwarmError as `fleet`, `world`, `navigation` and `cameras` do."""
    cameras(settings, world(settings, fleet(settings)))
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
        CraftStart(c.name, c.model, start.position[i], quaternion[i], start.velocity[i], start.angular_rate[i])
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
    )
    if table.calibration is None:
        return made
    calibration = read_calibration(table.calibration)
    if calibration.point_m is not None:
        raise SwarmError(
            f"{table.calibration}: [photodiodes] belongs to one object of a replay, not to simulated craft"
        )
    return replace(made, fan_x=calibration.fan_x, fan_y=calibration.fan_y)


def craft_keys(settings: Scenario) -> list[int]:
    """A number per craft that follows from its name: it keeps its random draws when other craft come or go."""
    return [crc32(name.encode()) for name in settings.craft_names]


def photodiodes(settings: Scenario, world: World) -> Photodiodes:
    """The photodiodes that are on board: none of a craft with `lighthouse = false`."""
    on_board = np.array([c.lighthouse for c in scenario.craft(settings)], dtype=np.bool_)
    return world.photodiodes._replace(present=world.photodiodes.present & on_board[:, None])


def pushes(settings: Scenario) -> Pushes:
    """What pushes the craft beside their control."""
    tables = [c.disturbance for c in scenario.craft(settings)]
    sigma = np.array([(t.acceleration_m_s2, radians(t.angular_acceleration_deg_s2)) for t in tables], dtype=np.float64)
    return Pushes(sigma, craft_keys(settings), settings.seed)


def cameras(settings: Scenario, world: World) -> list[tuple[CcdSettings, CcdCalibration]]:
    """Every pair of cameras, as it is and as its craft knows it.

    Raises SwarmError, naming scenario, key and value, where a model lacks the cameras or the lights.
    """
    craft, names = scenario.craft(settings), list(settings.craft_names)
    station = fleet(settings).at(0.0)
    found = []
    for i, (c, key) in enumerate(zip(craft, craft_keys(settings), strict=True)):
        if c.ccd is None:
            continue
        target = names.index(c.ccd.target)
        where = f"scenario {settings.name}: craft[{i - settings.swarm.count}].ccd"
        if len(world.cameras[i].position_m) == 0:
            raise SwarmError(f"{where}: {c.model} has no cameras (two whose name starts with 'ccd')")
        if len(world.lights[target].point_m) < FEWEST_COMMON:
            raise SwarmError(
                f"{where}.target = {c.ccd.target!r}: {craft[target].model} has {len(world.lights[target].point_m)} "
                f"lights (sites whose name starts with 'light'), at least {FEWEST_COMMON} are needed"
            )
        true = _ccd(c.ccd, i, key, target, world)
        rounding_um = c.ccd.resolution_um / sqrt(12)
        believed_um = c.ccd.believed_noise_um or math.hypot(c.ccd.image_noise_um, rounding_um)
        known = CcdCalibration(
            i,
            true.cameras,
            true.lights.point_m,
            station.rotation[target],
            station.position[target],
            true.focal_length_m,
            believed_um * 1e-6,
            c.ccd.solution == "closed-form",
        )
        found.append((true, known))
    return found


def _ccd(table: Ccd, craft: int, key: int, target: int, world: World) -> CcdSettings:
    """The sensor's settings in SI units."""
    random = None if table.failure_every_s is None else (table.failure_every_s, table.failure_length_s)
    return CcdSettings(
        craft,
        key,
        target,
        world.cameras[craft],
        world.lights[target],
        focal_length_m=table.focal_length_mm * 1e-3,
        field_rad=radians(table.field_deg),
        range_min_m=table.range_min_m,
        range_max_m=table.range_max_m,
        cone_rad=radians(table.light_cone_deg),
        image_noise_m=table.image_noise_um * 1e-6,
        resolution_m=table.resolution_um * 1e-6,
        mounting_error_m=table.mounting_error_mm * 1e-3,
        mounting_error_rad=table.mounting_error_arcsec * ARCSEC,
        lost_image_probability=table.lost_image_probability,
        outages=tuple(Outage(int(o.camera == "backup"), o.from_s, o.to_s, o.from_m, o.to_m) for o in table.outages),
        random_outage=random,
    )


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
