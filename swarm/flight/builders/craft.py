"""The craft of a scenario: their motions, their world at the start, their photodiodes, and the pushes on them."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools
from estimators.lighthouse.planar import is_flat
from estimators.rotation import matrix_from_quaternion
from swarm import random, scenario
from swarm.assets import find_model
from swarm.errors import SwarmError
from swarm.flight.builders.dynamics import orbit
from swarm.flight.builders.guidance import facing_port, matings
from swarm.flight.builders.stations import standing
from swarm.hardware import Photodiodes
from swarm.random import Purpose
from swarm.scenario import Craft, Scenario
from swarm.scenario.motions import Course, Place
from swarm.scenario.text import toml_value
from swarm.units import si
from swarm.world.motion.disturbance import Pushes
from swarm.world.motion.fleet import Fleet, Start
from swarm.world.world import CraftStart, World


def fleet(settings: Scenario) -> Fleet:
    """Return the motion of every craft, in the order of `scenario.craft`.

    Raises:
        SwarmError: a motion makes no sense; the message names scenario, key and value.
    """
    craft, courses = scenario.craft(settings), list[Course]()
    with blame(settings, craft):
        for c, place in zip(craft, places(settings, craft), strict=True):
            with _named(c):
                courses.append(c.table.motion.course(place))
    for pair in matings(settings):
        turn = facing_port(pair, Fleet([courses[pair.target]]).at(0.0))
        courses[pair.craft] = courses[pair.craft]._replace(turn_rad=turn)
    with blame(settings, craft):
        try:
            return Fleet(courses, settings.seed)
        except SwarmError:
            for c, course in zip(craft, courses, strict=True):
                with _named(c):
                    Fleet([course])
            raise


def places(settings: Scenario, craft: list[Craft]) -> list[Place]:
    """Return the data that the courses of the craft may depend on."""
    noise = si(settings.navigation)
    common = Place(
        seed=settings.seed,
        acceleration_noise_m_s2=noise.acceleration_noise_m_s2,
        angular_acceleration_noise_rad_s2=noise.angular_acceleration_noise_rad_s2,
        orbit=orbit(settings),
    )
    return [replace(common, index=c.index, count=c.count, key=random.key(c.name)) for c in craft]


def steers_by_estimate(settings: Scenario) -> Bools:
    """Return the craft whose controller uses their own estimate, not the truth, (C,)."""
    return np.array([craft.table.feedback == "estimate" for craft in scenario.craft(settings)], dtype=np.bool_)


def start(settings: Scenario, motions: Fleet) -> Start:
    """Return the start state of every craft; its scatter is drawn from the seed and its name alone."""
    first = motions.start()
    craft = scenario.craft(settings)
    scatter = [si(c.table.scatter) for c in craft]
    sigma = np.array([(s.position_m, s.velocity_m_s, s.attitude_rad, s.angular_rate_rad_s) for s in scatter])
    sigma = sigma.reshape(-1, 4, 1)
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


def world(settings: Scenario, motions: Fleet, steps: int | None = None) -> World:
    """Return the world with every craft at the start of its motion.

    Args:
        settings: the scenario.
        motions: the motion of every craft.
        steps: physics steps in a period; None: as the scenario says, or 8.

    Raises:
        SwarmError: a model cannot fly, or a craft is inside another one; the message names scenario, key and value.
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
            c.table.passive,
        )
        for i, c in enumerate(craft)
    ]
    latches = [(pair.craft, pair.target) for pair in matings(settings)]
    with blame(settings, craft):
        return World(
            starts,
            find_model(settings.lighthouse.model),
            settings.period_hz,
            steps or settings.physics.steps_per_period or 8,
            orbit(settings),
            latches,
            standing(settings),
        )


def photodiodes(settings: Scenario, world: World) -> Photodiodes:
    """Return the photodiodes on board; a craft with `lighthouse = false` has none."""
    on_board = np.array([c.table.lighthouse for c in scenario.craft(settings)], dtype=np.bool_)
    return world.photodiodes._replace(present=world.photodiodes.present & on_board[:, None])


def flat_craft(settings: Scenario, on_board: Photodiodes) -> list[str]:
    """Return the names of the craft whose photodiodes all lie in one plane."""
    flat = [
        present.any() and is_flat(p[present]) for p, present in zip(on_board.point_m, on_board.present, strict=True)
    ]
    return [name for name, is_so in zip(settings.craft_names, flat, strict=True) if is_so]


def pushes(settings: Scenario) -> Pushes:
    """Return the random pushes on the craft beside their control."""
    tables = [si(c.table.disturbance) for c in scenario.craft(settings)]
    sigma = np.array([(t.acceleration_m_s2, t.angular_acceleration_rad_s2) for t in tables], dtype=np.float64)
    return Pushes(sigma, random.keys(settings.craft_names), settings.seed)


@contextmanager
def _named(craft: Craft) -> Iterator[None]:
    """Name the craft that a mistake concerns."""
    try:
        yield
    except SwarmError as error:
        raise SwarmError(f"craft {craft.name!r}: {error}") from None


@contextmanager
def blame(settings: Scenario, craft: list[Craft]) -> Iterator[None]:
    """Name the keys of the scenario that cause a mistake, if its message names a craft or a model's file."""
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
                if c.table.model == str(c.model):
                    text = text.removeprefix(f"{c.model}: ")
                keys.append(f"{table}.model = {toml_value(c.table.model)}")
            elif c.name in named:
                place = c.table.motion.start_key(c.count)
                keys.append(f"{table}.motion.{place} = {toml_value(getattr(c.table.motion, place))}")
        where = ", ".join(dict.fromkeys(keys))
        raise SwarmError(f"scenario {settings.name}: {where}{': ' if where else ''}{text}") from None
