"""The craft of a scenario, in SI units: how they move, the world they start in, what is on board, what pushes them."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import radians
from typing import cast

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools
from estimators.rotation import matrix_from_quaternion
from estimators.state import Vector
from swarm import random, scenario
from swarm.assets import find_model
from swarm.errors import SwarmError
from swarm.flight.builders.dynamics import orbit
from swarm.flight.builders.guidance import beginning, facing_port, matings
from swarm.hardware import Photodiodes
from swarm.random import Purpose
from swarm.scenario import Craft, Scenario
from swarm.scenario.text import toml_value
from swarm.world.motion import fleet as motion
from swarm.world.motion.disturbance import Pushes
from swarm.world.motion.fleet import Fleet, Start, Task
from swarm.world.world import CraftStart, World

_START_KEYS = {
    "ring": "radius_m",
    "waypoints": "points_m",
    "approach": "from_m",
    "wander": "centre_m",
    "formation": "figures",
    "dock": "from_m",
}


def fleet(settings: Scenario) -> Fleet:
    """The motion of every craft, in the order of `scenario.craft`.

    Raises SwarmError, naming scenario, key and value, where a motion makes no sense.
    """
    craft = scenario.craft(settings)
    tasks = [Task(_motion(c, settings), c.index, c.count) for c in craft]
    for pair in matings(settings):
        attitude = facing_port(pair, Fleet([tasks[pair.target]]).at(0.0))
        tasks[pair.craft] = replace(tasks[pair.craft], motion=replace(tasks[pair.craft].motion, attitude=attitude))
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


def start(settings: Scenario, motions: Fleet) -> Start:
    """How every craft starts; its scatter is drawn from the seed and its name alone."""
    first = motions.start()
    craft = scenario.craft(settings)
    sigma = np.array(
        [
            (
                c.scatter.position_m,
                c.scatter.velocity_m_s,
                radians(c.scatter.attitude_deg),
                radians(c.scatter.angular_rate_deg_s),
            )
            for c in craft
        ]
    ).reshape(-1, 4, 1)
    if not sigma.any():
        return first
    streams = [random.stream(settings.seed, Purpose.START, key) for key in random.keys(settings.craft_names)]
    draws = [stream.standard_normal((4, 3)) for stream in streams]
    off = sigma * np.array(draws)
    turned = rot.exp(off[:, 2]) @ matrix_from_quaternion(first.quaternion)
    return Start(
        first.position + off[:, 0],
        rot.quaternion_from_matrix(turned),
        first.velocity + off[:, 1],
        first.angular_rate + off[:, 3],
    )


def world(settings: Scenario, motions: Fleet) -> World:
    """The world with every craft where its motion starts.

    Raises SwarmError, naming scenario, key and value: a model that cannot fly, or a craft inside another one.
    """
    craft = scenario.craft(settings)
    first = start(settings, motions)
    starts = [
        CraftStart(
            c.name,
            c.model,
            first.position[i],
            first.quaternion[i],
            first.velocity[i],
            first.angular_rate[i],
            c.passive,
        )
        for i, c in enumerate(craft)
    ]
    latches = [(pair.craft, pair.target) for pair in matings(settings)]
    with _blame(settings, craft):
        return World(
            starts,
            find_model(settings.lighthouse.model),
            settings.lighthouse.rate_hz,
            settings.physics.steps_per_period,
            orbit(settings),
            latches,
        )


def photodiodes(settings: Scenario, world: World) -> Photodiodes:
    """The photodiodes that are on board: none of a craft with `lighthouse = false`."""
    on_board = np.array([c.lighthouse for c in scenario.craft(settings)], dtype=np.bool_)
    return world.photodiodes._replace(present=world.photodiodes.present & on_board[:, None])


def pushes(settings: Scenario) -> Pushes:
    """What pushes the craft beside their control."""
    tables = [c.disturbance for c in scenario.craft(settings)]
    sigma = np.array([(t.acceleration_m_s2, radians(t.angular_acceleration_deg_s2)) for t in tables], dtype=np.float64)
    return Pushes(sigma, random.keys(settings.craft_names), settings.seed)


def _motion(craft: Craft, settings: Scenario) -> motion.AnyMotion:
    table = craft.motion
    if isinstance(table, scenario.Dock):
        return beginning(craft, motion.Attitude(), orbit(settings))
    a = table.attitude
    attitude = motion.Attitude(
        a.facing, radians(a.roll_deg), radians(a.pitch_deg), radians(a.yaw_deg), radians(a.spin_deg_s)
    )
    match table:
        case scenario.Keep() | scenario.Formation():
            return beginning(craft, attitude, orbit(settings))
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
