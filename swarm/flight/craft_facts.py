"""Facts about each craft of a scenario: mass, sensors, and the authority of its actuators beside what is planned.

The authority along an axis is the largest force f along it that the actuators deliver without torque, and likewise for
torque without force. With B the wrench of full output (`swarm.hardware.ActuatorSet.effect`), a linear program:

    maximise  f   subject to   B u = f e,   0 <= u <= 1 for thrusters, -1 <= u <= 1 for wheels

Of the two directions of an axis the weaker one counts. A craft without actuators is moved by an ideal force.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from estimators.arrays import Bools, Floats
from estimators.layout.error import WANTED_LIT
from swarm import scenario
from swarm.flight.builders.craft import start
from swarm.flight.builders.dynamics import fitted
from swarm.flight.flight import Flight
from swarm.hardware import actuator_set
from swarm.scenario import Craft, Scenario
from swarm.scenario.motions.dock import Dock
from swarm.scenario.motions.guided import Clear, Guided
from swarm.sensors.visibility import THICKNESS_M
from swarm.units import si
from swarm.world.rays import Rays

SAMPLES = 400
"""Times at which the acceleration of a motion without guidance is looked at."""
PATH_SAMPLES = 100
"""Times at which a path is looked at for light."""
APART_M = 1000.0
"""Distance at which craft are alone [m]."""
SLANTS_RAD = np.radians([25.0, 50.0])
"""Angles of incidence at which light may come to a photodiode, beside zero."""
NEGLIGIBLE = 1e-6
"""Relative to what is available, and an acceleration [m/s^2]: nothing to speak of."""


class CraftFacts(NamedTuple):
    """One craft. names: those of the craft that are like it.

    covered: photodiodes that its own hull covers from every side. force_n, torque_nm: (3,) along the body axes; None
    where it is moved by an ideal force. planned: accelerations that its guidance or motion may ask of its actuators
    [m/s^2], by the key that sets them.
    """

    names: tuple[str, ...]
    mass_kg: float
    photodiodes: int
    covered: int
    cameras: int
    force_n: Floats | None
    torque_nm: Floats | None
    planned: dict[str, float]

    @property
    def acceleration_m_s2(self) -> Floats | None:
        """Largest accelerations along the body axes, (3,)."""
        return None if self.force_n is None else self.force_n / self.mass_kg

    def warnings(self) -> Iterator[str]:
        """Yield what will not work as planned."""
        who = _together(self.names)
        if self.covered:
            yield (
                f"{who}: {self.covered} of {self.photodiodes} photodiodes never see light: more than 1 mm deep in the "
                "hull, or looking into it (docs/models.md)"
            )
        if 0 < self.photodiodes < WANTED_LIT:
            told = f"with fewer than {WANTED_LIT}, one lost may end its navigation"
            yield f"{who}: {self.photodiodes} photodiodes; {told}"
        available = self.acceleration_m_s2
        if available is None:
            return
        # The first of the weakest ones, whatever the rounding.
        axis = int(np.argmax(available <= available.min() * (1 + NEGLIGIBLE)))
        for key, planned in self.planned.items():
            if planned > available[axis] * (1 + NEGLIGIBLE):
                told = f"{available[axis]:.3g} m/s^2 available along {'xyz'[axis]}, {planned:.3g} planned"
                yield f"{who}: {told} ({key})"


def facts(settings: Scenario, flight: Flight) -> list[CraftFacts]:
    """Return what each craft of a flight is, those that share a table and a model together."""
    world, craft = flight.world, scenario.craft(settings)
    actuators = actuator_set(fitted(settings, world), world.com_m)
    where = {int(who): a for a, who in enumerate(actuators.who)}
    cameras = set() if flight.sensors.ccd is None else {pair.craft for pair in flight.sensors.ccd.pairs}
    present = flight.sensors.lighthouse.photodiodes.present.sum(axis=1)
    motions = _motion_accelerations(settings, flight) if where else None
    limits: dict[int, tuple[Floats, Floats]] = {}
    rays = Rays(world.model, world.craft_bodies)
    alike: dict[object, CraftFacts] = {}
    for i, c in enumerate(craft):
        planned = {} if motions is None or i not in where else _planned(c, motions[i])
        key = c.name if c.count == 1 else c.model
        if key in alike:
            known = alike[key]
            most = {name: max(value, known.planned.get(name, 0.0)) for name, value in planned.items()}
            alike[key] = known._replace(names=(*known.names, c.name), planned=known.planned | most)
            continue
        if i in where:
            limits[i] = authority(actuators.effect[where[i]], actuators.axis.shape[1])
        force, torque = limits.get(i, (None, None))
        alike[key] = CraftFacts(
            (c.name,),
            float(world.mass[i]),
            int(present[i]),
            _covered(rays, flight, i) if present[i] else 0,
            2 * (i in cameras),
            force,
            torque,
            planned,
        )
    return list(alike.values())


def _covered(rays: Rays, flight: Flight, i: int) -> int:
    """Return the number of photodiodes of craft i that no light reaches from any side, with nothing else around."""
    count = len(flight.world.craft_bodies)
    apart = APART_M * np.stack([np.arange(1.0, count + 1), np.ones(count), np.zeros(count)], axis=1)
    rays.place(apart, np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)))
    layout = flight.world.photodiodes
    point, normal = layout.point_m[i][layout.present[i]], layout.normal[i][layout.present[i]]
    away = APART_M / 4
    lit = np.zeros(len(point), dtype=np.bool_)
    for k in range(len(point)):
        beside = np.linalg.svd(normal[k][None])[2][1:]
        turn = np.arange(0, 2 * np.pi, np.pi / 4)
        ring = np.stack([np.cos(turn), np.sin(turn)], axis=1) @ beside
        sides = np.concatenate([normal[k][None], *(np.cos(a) * normal[k] + np.sin(a) * ring for a in SLANTS_RAD)])
        start = apart[i] + point[k] + away * sides
        met = rays.cast(start, -sides).distance
        lit[k] = np.any((met < 0) | (met >= away - THICKNESS_M))
    return int(np.count_nonzero(~lit))


def out_of_light(settings: Scenario, flight: Flight) -> list[str]:
    """Return a sentence about the craft that begin where the lighthouse cannot be seen, or whose whole path is there.

    A craft is out of range, or of the field, where all of the sphere about its photodiodes is. Turned away or shaded it
    may be besides. Of a motion that guidance decides only the start is known. With stations nothing is said.
    """
    if settings.station:
        return []
    layout, craft = flight.sensors.lighthouse.photodiodes, scenario.craft(settings)
    radius = np.max(np.linalg.norm(layout.point_m, axis=2) * layout.present, axis=1, initial=0.0)
    times = np.linspace(0.0, settings.duration_s, PATH_SAMPLES)
    place = [
        start(settings, flight.motions).position,
        *(flight.motions.at(float(time_s)).position for time_s in times[1:]),
    ]
    seen = np.array([_near_light(settings, position, radius) for position in place])
    dark: dict[tuple[str, str], list[int]] = {}
    for i in np.flatnonzero(layout.present.any(axis=1) & ~seen[0]):
        known = not isinstance(craft[i].table.motion, Guided)
        end = "it will not see light before it is inside"
        if known and not seen[:, i].any():
            end = "as is its whole path: it will not see light"
        elif known:
            end += f", at {times[np.argmax(seen[:, i])]:.3g} s"
        dark.setdefault((_limit(settings, place[0][i], radius[i]), end), []).append(int(i))
    return [
        f"{_together([craft[i].name for i in who])}: the start, {np.linalg.norm(place[0][who[0]]):.4g} m from the "
        f"lighthouse, is outside its {limit}, {end}"
        for (limit, end), who in dark.items()
    ]


def _limit(settings: Scenario, position: Floats, radius: float) -> str:
    """Return which limit of the lighthouse leaves a craft at `position` (3,) [m] without light."""
    station, distance = settings.lighthouse, float(np.linalg.norm(position))
    if distance - radius > station.range_max_m:
        return f"range (range_max_m = {station.range_max_m:g})"
    if distance + radius < station.range_min_m:
        return f"range (range_min_m = {station.range_min_m:g})"
    return f"field (field_deg = {station.field_deg:g})"


def _near_light(settings: Scenario, position: Floats, radius: Floats) -> Bools:
    """Return which craft at `position` (C, 3) [m], spheres of `radius` (C,) [m], reach into the lighthouse's light."""
    station = si(settings.lighthouse)
    distance = np.linalg.norm(position, axis=1)
    near = (distance - radius <= station.range_max_m) & (distance + radius >= station.range_min_m)
    # By the signed distances from the four planes that bound the field.
    half = station.field_rad / 2
    outside = np.cos(half) * np.abs(position[:, :2]) - np.sin(half) * position[:, 2:]
    inside: Bools = near & (outside <= radius[:, None]).all(axis=1)
    return inside


def _together(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


def authority(effect: Floats, wheels: int) -> tuple[Floats, Floats]:
    """Return the largest force [N] and torque [N m] along the body axes in either direction, (3,) each.

    Args:
        effect: wrench of full output, (6, n), the wheels last.
        wheels: number of wheels.
    """
    count = effect.shape[1]
    bounds = [(0.0, 1.0)] * (count - wheels) + [(-1.0, 1.0)] * wheels + [(0.0, None)]
    out = np.zeros(6)
    # Forces and torques of one size each, for the solver's tolerances.
    scale = np.repeat([np.abs(effect[:3]).max(initial=NEGLIGIBLE), np.abs(effect[3:]).max(initial=NEGLIGIBLE)], 3)
    scaled = effect / scale[:, None]
    for axis in range(6):
        reach = [_most(scaled, sign * np.eye(6)[axis], bounds) for sign in (1.0, -1.0)]
        out[axis] = min(reach) * scale[axis]
    return out[:3], out[3:]


def _most(effect: Floats, along: Floats, bounds: Sequence[tuple[float, float | None]]) -> float:
    cost = np.zeros(len(bounds))
    cost[-1] = -1.0
    found = linprog(cost, A_eq=np.column_stack([effect, -along]), b_eq=np.zeros(6), bounds=bounds)
    return 0.0 if found.fun is None else max(0.0, -float(found.fun))


def _planned(craft: Craft, motion_m_s2: float) -> dict[str, float]:
    """Return the accelerations that a craft's table plans, by key."""
    motion = craft.table.motion
    if isinstance(motion, Dock):
        return {"motion.acceleration_m_s2": motion.acceleration_m_s2, "motion.brake_m_s2": motion.brake_m_s2}
    if isinstance(motion, Clear) and motion.separation_m > 0:
        return {"motion.brake_m_s2": motion.brake_m_s2}
    if isinstance(motion, Guided):
        return {}
    return {f"motion, a {motion.kind}": motion_m_s2} if motion_m_s2 > NEGLIGIBLE else {}


def _motion_accelerations(settings: Scenario, flight: Flight) -> Floats:
    """Return the largest acceleration of every craft's motion without guidance, (C,) [m/s^2]."""
    times = np.linspace(0.0, settings.duration_s, SAMPLES)
    most = np.zeros(len(settings.craft_names))
    for time_s in times:
        most = np.maximum(most, np.linalg.norm(flight.motions.at(float(time_s)).acceleration, axis=1))
    return most
