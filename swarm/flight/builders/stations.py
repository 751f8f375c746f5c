"""The lighthouse stations of a scenario: as they really are, and as the craft know them."""

from collections.abc import Sequence
from dataclasses import replace
from math import pi, sqrt

import numpy as np
from scipy.spatial.transform import Rotation

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.frame import Frame
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rotor import CHANNEL_CLOCK_HZ, CHANNEL_TICKS
from estimators.lighthouse.rows import Station
from estimators.lighthouse.sweep import Fan, FanErrors, lighthouse_1, lighthouse_2
from estimators.lighthouse.tilted import TiltedErrors
from swarm import random, scenario
from swarm.assets import find_model
from swarm.flight.builders.station import FAN_ERROR_MAX_RAD, WIDEST_HALF_FIELD_RAD
from swarm.hardware import Photodiodes
from swarm.onboard.beams import BeamDecoder
from swarm.onboard.ccd import CcdCalibration
from swarm.onboard.computer import StationComputer
from swarm.onboard.inspection import Inspection
from swarm.onboard.mounts import Mount
from swarm.onboard.own_navigators import Navigators
from swarm.onboard.settings import NavigationSettings
from swarm.onboard.stations import StationNavigator
from swarm.onboard.turns import TurnDecoder
from swarm.random import Purpose
from swarm.scenario import Scenario
from swarm.scenario.stations import channels
from swarm.sensors.lighthouse import Lighthouse
from swarm.sensors.stations import Emitter, Stations
from swarm.sensors.visibility import Visibility
from swarm.units import ARCSEC, si
from swarm.world.assembly import Standing
from swarm.world.world import World

LIGHTHOUSE_2_NOISE_RAD, LIGHTHOUSE_2_CORRELATION = 2.6 * ARCSEC, 0.35
"""Noise of Lighthouse 2.0: recordings at rest scatter by 9.8 and 15.0 urad, of which the photodiodes of a sweep do not
share 7.5 and 12.7 urad (docs/lighthouse-2.md)."""


def frame(table: scenario.Station) -> Frame:
    """Return the frame of a station in the world, or in its craft's frame."""
    pointing, position = si(table.attitude), np.array(table.position_m)
    turn = Rotation.from_euler("XYZ", [pointing.yaw_rad, pointing.pitch_rad, pointing.roll_rad]).as_matrix()
    if pointing.towards_m is None:
        return Frame(turn, position)
    ahead = np.array(pointing.towards_m) - position
    ahead /= np.linalg.norm(ahead)
    # Down is y; a station that looks along it has its y axis along z.
    down = np.array([0.0, 1.0, 0.0]) if abs(ahead[1]) < 1 - 1e-9 else np.array([0.0, 0.0, 1.0])
    right = np.cross(down, ahead)
    right /= np.linalg.norm(right)
    return Frame(np.stack([right, np.cross(ahead, right), ahead], axis=1) @ turn, position)


def standing(settings: Scenario) -> list[Standing] | None:
    """Return the stations that stand in the world, with their bodies; None for the one lighthouse at the origin."""
    if not settings.station:
        return None
    model = find_model(settings.lighthouse.model)
    placed = [(table.name, frame(table)) for table in settings.station if table.craft is None]
    return [Standing(name, model, at.position, rot.quaternion_from_matrix(at.rotation)) for name, at in placed]


def stations(settings: Scenario, world: World, layout: Photodiodes, receiver: Lighthouse) -> Stations:
    """Return the light of all stations.

    Args:
        settings: the scenario, with [[station]] tables.
        world: the world.
        layout: photodiodes on board, as drawn.
        receiver: photodiodes as mounted, and timing circuits.
    """
    bodies = dict(zip(world.stations, world.station_bodies.tolist(), strict=True))
    emitters = []
    for table, channel in zip(settings.station, channels(settings.station), strict=True):
        noise, correlation = _noise(settings, table)
        at, body = frame(table), bodies.get(table.name, -1)
        light = settings.lighthouse
        if table.field_deg is not None:
            light = light.model_copy(update={"field_deg": table.field_deg})
        emitters.append(
            Emitter(
                name=table.name,
                key=random.key(table.name),
                channel=channel if table.second else 0,
                fans=_fans(table, true=True),
                noise_rad=noise,
                correlation=correlation,
                beam_m=si(table).beam_m if table.second else 0.0,
                phase=float(_draws(settings, table)[0]),
                craft=-1 if table.craft is None else settings.craft_names.index(table.craft),
                frame=at,
                visibility=Visibility(world.model, layout, world.craft_bodies, body, light, at),
            )
        )
    keys = random.keys(settings.craft_names)
    return Stations(receiver, emitters, settings.seed, keys, settings.period_s)


def known_stations(settings: Scenario) -> list[Station]:
    """Return the stations as the craft know them: surveyed, and with their calibration if they have it."""
    out = []
    for table in settings.station:
        at, errors = frame(table), _draws(settings, table)
        turned = at.rotation @ rot.exp(si(table).attitude_error_rad * errors[4:7])
        place = at.position + si(table).position_error_m * errors[1:4]
        out.append(Station(turned, place, _fans(table, true=table.calibrated)))
    return out


def station_noise(settings: Scenario) -> list[AngleNoise]:
    """Return the noise of the rows of every station, as the craft assume it."""
    assumed, out = si(settings.navigation), []
    for table in settings.station:
        noise, correlation = _noise(settings, table)
        sigma = noise if assumed.angle_noise_rad is None else assumed.angle_noise_rad
        rho = correlation if assumed.rotor_correlation is None else assumed.rotor_correlation
        out.append(_with_ticks(settings, table, sigma, rho))
    return out


def _common_noise(settings: Scenario) -> list[float]:
    """Return the standard deviation [rad] of the error of a sweep of every station that is one for all craft.

    A flash of Lighthouse 1.0 is rounded to a tick of every craft's own clock.
    """
    out = []
    for table, noise, turn in zip(settings.station, station_noise(settings), turn_s(settings), strict=True):
        own = 0.0 if table.second else (2 * pi / turn * si(settings.lighthouse).tick_s) ** 2 / 12
        out.append(sqrt(max(noise.shared_rad**2 - own, 0.0)))
    return out


def station_computer(
    settings: Scenario,
    navigation: NavigationSettings,
    layout: Photodiodes,
    cameras: Sequence[CcdCalibration],
    inertia: Floats,
    inspection: Inspection,
    own: Navigators,
) -> StationComputer:
    """Return the computers of all craft before several stations.

    Args:
        settings: the scenario.
        navigation: settings of their navigation.
        layout: photodiodes at the positions that every craft assumes.
        cameras: calibrations of the pairs of cameras.
        inertia: of craft that turn freely, (C, 3, 3) [kg m^2]; NaN for the others.
        inspection: their LiDARs.
        own: navigators of the user.
    """
    light, known = si(settings.lighthouse), known_stations(settings)
    circuits: BeamDecoder | TurnDecoder
    if settings.station[0].second:
        circuits = BeamDecoder(layout.present, light.tick_s, channels(settings.station), turn_s(settings))
    else:
        widest = max(light.field_rad if t.field_deg is None else si(t).field_rad for t in settings.station)
        half = min(widest / 2 + FAN_ERROR_MAX_RAD, WIDEST_HALF_FIELD_RAD)
        circuits = TurnDecoder(layout.present, light.tick_s, light.rate_hz, len(settings.station), half)
    mounts = [
        Mount(
            i,
            settings.craft_names.index(table.craft),
            Frame(known[i].rotation, known[i].position),
            table.bearer == "estimate",
        )
        for i, table in enumerate(settings.station)
        if table.craft is not None
    ]
    relations = replace(navigation.relations, common_rad=tuple(_common_noise(settings)), turn_s=tuple(turn_s(settings)))
    navigation = replace(navigation, relations=relations)
    navigator = StationNavigator(layout, navigation, known, station_noise(settings), cameras, inertia, mounts)
    return StationComputer(circuits, navigator, inspection, own)


def turn_s(settings: Scenario) -> list[float]:
    """Return the duration of a turn of every station's rotor [s]."""
    if settings.station[0].second:
        return [CHANNEL_TICKS[channel - 1] / CHANNEL_CLOCK_HZ for channel in channels(settings.station)]
    return [1 / settings.lighthouse.rate_hz] * len(settings.station)


def _noise(settings: Scenario, table: scenario.Station) -> tuple[float, float]:
    """Return the standard deviation of a sweep angle [rad] and its rotor's share of the variance."""
    own, common = si(table), si(settings.lighthouse)
    usual = (
        (LIGHTHOUSE_2_NOISE_RAD, LIGHTHOUSE_2_CORRELATION)
        if table.second
        else (common.angle_noise_rad, common.rotor_correlation)
    )
    given = own.angle_noise_rad, own.rotor_correlation
    noise, correlation = (u if g is None else g for g, u in zip(given, usual, strict=True))
    return noise, correlation


def _with_ticks(settings: Scenario, table: scenario.Station, sigma: float, rho: float) -> AngleNoise:
    """Return the noise of rows with that of ticks, and of the flash of Lighthouse 1.0.

    A hit is rounded to a tick, of variance tick^2 / 12; so is the flash, which also jitters, of all hits of a sweep.
    """
    light = si(settings.lighthouse)
    w = 2 * pi / turn_s(settings)[settings.station.index(table)]
    rounding = (w * light.tick_s) ** 2 / 12
    flash = 0.0 if table.second else rounding + (w * light.sync_jitter_s) ** 2
    return AngleNoise(sqrt((1 - rho) * sigma**2 + rounding), sqrt(rho * sigma**2 + flash))


def _fans(table: scenario.Station, *, true: bool) -> tuple[Fan, Fan]:
    """Return the planes of a station: as they are, or without errors."""
    if table.second:
        planes = (TiltedErrors(**plane.model_dump()) for plane in (table.plane_1, table.plane_2))
        return lighthouse_2(*planes) if true else lighthouse_2(TiltedErrors(), TiltedErrors())
    fans = (FanErrors(**fan.model_dump()) for fan in (table.fan_x, table.fan_y))
    return lighthouse_1(*fans) if true else lighthouse_1(FanErrors(), FanErrors())


def _draws(settings: Scenario, table: scenario.Station) -> Floats:
    """Return the phase of a station's rotor [turns], and its errors of position and attitude in sigmas, (7,)."""
    stream = random.stream(settings.seed, Purpose.STATION, random.key(table.name))
    return np.concatenate([[stream.uniform()], stream.standard_normal(6)])
