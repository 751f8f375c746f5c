"""Navigators and controllers of the user: their classes, and what each craft knows of itself."""

from collections.abc import Sequence
from math import nan, sqrt
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.frame import WORLD, Frame
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import Station
from swarm import random
from swarm.flight.builders.craft import steers_by_estimate
from swarm.hardware import Photodiodes
from swarm.onboard.own_controllers import NO_CONTROLLERS, Controllers, OwnControllers
from swarm.onboard.own_navigators import NO_NAVIGATORS, Navigators, OwnNavigators, lighthouse_station
from swarm.onboard.settings import NavigationSettings
from swarm.plugin_files import PlugIn, plug_in
from swarm.plugins import OwnCraft
from swarm.random import Purpose
from swarm.scenario import Scenario


class Bodies(NamedTuple):
    """Bodies of C craft: mass (C,) [kg], inertia (C, 3, 3) [kg m^2] and centre of mass (C, 3) [m], body frame."""

    mass: Floats
    inertia: Floats
    com_m: Floats

    def of(self, craft: int) -> tuple[float, Floats, Floats]:
        """Return the body of one craft."""
        return float(self.mass[craft]), self.inertia[craft].copy(), self.com_m[craft].copy()


def plug_ins(settings: Scenario, key: str) -> dict[int, PlugIn]:
    """Return the plug-ins of the craft that have one, by the index of the craft.

    Args:
        settings: the scenario.
        key: "navigator" or "controller".

    Raises:
        SwarmError: a class cannot be had; the message names the file.
    """
    named = {i: getattr(table, key) for i, (_, table) in enumerate(settings.tables)}
    found = {value: plug_in(key, value) for value in dict.fromkeys(named.values()) if value is not None}
    return {i: found[value] for i, value in named.items() if value is not None}


class Light(NamedTuple):
    """Knowledge of the craft about light: point_m (C, K, 3) [m], their photodiodes, and present (C, K), who has which;
    stations, and noise of a sweep angle by station; unit_rad, the noise by which the dilution's covariance is
    multiplied, and the frame of that covariance.
    """

    point_m: Floats
    present: Bools
    stations: Sequence[Station]
    noise: Sequence[AngleNoise]
    unit_rad: float
    frame: Frame


def of_one_lighthouse(layout: Photodiodes, navigation: NavigationSettings) -> Light:
    """Return what craft know of the light of the one lighthouse."""
    s = navigation
    return Light(layout.point_m, layout.present, [lighthouse_station(s)], [s.noise], s.angle_noise_rad, s.station)


def of_stations(layout: Photodiodes, stations: Sequence[Station], noise: Sequence[AngleNoise]) -> Light:
    """Return what craft know of the light of several stations.

    Args:
        layout: photodiodes at the positions that the craft assume.
        stations: as the craft know them.
        noise: of the rows of each.
    """
    unit = sqrt(np.mean([own**2 + shared**2 for own, shared in noise]))
    return Light(layout.point_m, layout.present, list(stations), list(noise), unit, WORLD)


def own_craft(
    settings: Scenario, navigation: NavigationSettings, light: Light, bodies: Bodies | None
) -> list[OwnCraft]:
    """Return what each craft knows of itself.

    Args:
        settings: the scenario, for names and seed.
        navigation: settings of the navigation.
        light: what the craft know of light.
        bodies: their bodies; None in a replay, where nothing is known of them.
    """
    out = []
    for i, name in enumerate(settings.craft_names):
        mass, inertia, com = (nan, np.full((3, 3), nan), np.full(3, nan)) if bodies is None else bodies.of(i)
        out.append(
            OwnCraft(
                name=name,
                period_s=settings.period_s if bodies is not None else navigation.frame_s,
                mass_kg=mass,
                inertia_kg_m2=inertia,
                centre_of_mass_m=com,
                photodiode_m=light.point_m[i, light.present[i]].copy(),
                stations=light.stations,
                noise=light.noise,
                acceleration_noise_m_s2=navigation.acceleration_noise_m_s2,
                angular_acceleration_noise_rad_s2=navigation.angular_acceleration_noise_rad_s2,
                orbit=navigation.orbit,
                random=random.stream(settings.seed, Purpose.PLUG_IN, random.key(name)),
            )
        )
    return out


def own_navigators(
    settings: Scenario, navigation: NavigationSettings, light: Light, bodies: Bodies | None = None
) -> Navigators:
    """Return the navigators of the craft that have one of their own.

    Args:
        settings: the scenario.
        navigation: settings of the navigation.
        light: what the craft know of light.
        bodies: bodies of the craft; None in a replay.

    Raises:
        SwarmError: a class cannot be had, or cannot be made.
    """
    found = plug_ins(settings, "navigator")
    if not found:
        return NO_NAVIGATORS
    return OwnNavigators(found, own_craft(settings, navigation, light, bodies), light.unit_rad, light.frame)


def own_controllers(settings: Scenario, navigation: NavigationSettings, light: Light, bodies: Bodies) -> Controllers:
    """Return the controllers of the craft that have one of their own.

    Args:
        settings: the scenario.
        navigation: settings of the navigation.
        light: what the craft know of light.
        bodies: bodies of the craft.

    Raises:
        SwarmError: a class cannot be had, or cannot be made.
    """
    found = plug_ins(settings, "controller")
    if not found:
        return NO_CONTROLLERS
    speaks = np.array([table.lighthouse and not table.passive for _, table in settings.tables], dtype=np.bool_)
    crafts = own_craft(settings, navigation, light, bodies)
    return OwnControllers(found, crafts, steers_by_estimate(settings), speaks, settings.period_s)
