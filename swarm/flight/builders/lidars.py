"""The LiDARs on board, and the computers that use them."""

from collections.abc import Sequence

from swarm import random, scenario
from swarm.errors import SwarmError
from swarm.onboard.inspection import Inspection, InspectionSettings, Observer
from swarm.scenario import Scenario
from swarm.sensors.lidar import Lidar, Mount
from swarm.units import si
from swarm.world.surface import known_shape
from swarm.world.world import World


def lidars(settings: Scenario, world: World) -> list[Lidar]:
    """Return every LiDAR, in the order of its craft.

    Raises:
        SwarmError: a model has no site for one; the message names scenario, key and value.
    """
    found = []
    for i, (c, key) in enumerate(zip(scenario.craft(settings), random.keys(settings.craft_names), strict=True)):
        if c.lidar is None:
            continue
        where = world.lidars[i]
        if where is None:
            raise SwarmError(
                f"scenario {settings.name}: craft[{i - settings.swarm.count}].lidar: {c.model} has no place for a LiDAR"
                " (a site named 'lidar')"
            )
        mount = Mount(i, *where)
        found.append(Lidar(world.model, world.craft_bodies, [mount], c.lidar, settings.seed, [key]))
    return found


def inspection(settings: Scenario, sensors: Sequence[Lidar]) -> Inspection:
    """Return the computers of the craft with LiDARs; without any, one that does nothing."""
    craft, names = scenario.craft(settings), list(settings.craft_names)
    tables = [c.lidar for c in craft if c.lidar is not None]
    if not tables:
        return Inspection((), InspectionSettings(frame_s=settings.period_s))
    observers = [
        Observer(
            sensor.mounts[0].craft,
            names.index(table.target),
            sensor.pattern(0),
            known_shape(craft[names.index(table.target)].model),
        )
        for sensor, table in zip(sensors, tables, strict=True)
    ]
    return Inspection(
        observers,
        InspectionSettings(
            frame_s=settings.period_s,
            acceleration_noise_m_s2=max(si(t).target_acceleration_m_s2 for t in tables),
            angular_acceleration_noise_rad_s2=max(si(t).target_angular_acceleration_rad_s2 for t in tables),
            gate_probability=settings.navigation.gate_probability,
            coast_limit_s=settings.navigation.coast_limit_s,
            own_acceleration_noise_m_s2=settings.navigation.acceleration_noise_m_s2,
            own_angular_acceleration_noise_rad_s2=si(settings.navigation).angular_acceleration_noise_rad_s2,
        ),
    )
