"""The guidance of the craft of a scenario: docking, formations, station keeping."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from estimators.arrays import Floats
from estimators.state import Reference
from swarm import scenario
from swarm.errors import SwarmError
from swarm.flight.builders.dynamics import orbit
from swarm.hardware import Port, docked_pose, placed
from swarm.onboard.guidance.docking import Docking
from swarm.onboard.guidance.formation import Formation
from swarm.onboard.guidance.gains import regulator
from swarm.onboard.guidance.guidance import Clearance, Guidance
from swarm.scenario import Craft, Dock, Scenario
from swarm.scenario.motions.guided import Clear, Guided
from swarm.units import si
from swarm.world.craft import load_craft
from swarm.world.docking import Mating


def matings(settings: Scenario) -> list[Mating]:
    """Return every pair of ports that a craft of the scenario is to bring together.

    Raises:
        SwarmError: a model has no port; the message names scenario, key and value.
    """
    craft, names = scenario.craft(settings), settings.craft_names
    found = []
    for i, c in enumerate(craft):
        dock = c.table.motion
        if not isinstance(dock, Dock):
            continue
        target = names.index(dock.target)
        where = f"scenario {settings.name}: craft {c.name!r}: motion.target = {dock.target!r}"
        own, at = (_port(craft[k], where) for k in (i, target))
        found.append(Mating(i, target, own, at, dock.latch_radius_m, si(dock).latch_rad))
    return found


def _port(craft: Craft, where: str) -> Port:
    port = load_craft(craft.model).port
    if port is None:
        raise SwarmError(f"{where}: {craft.model} has no docking port (a site whose name starts with 'port')")
    return port


def _about(settings: Scenario, table: scenario.Formation, station: Reference) -> tuple[int, Floats] | None:
    """Return the craft with which the figures of a formation move, and where it starts."""
    if table.about is None:
        return None
    leader = settings.craft_names.index(table.about)
    return leader, station.position[leader]


def facing_port(mating: Mating, station: Reference) -> tuple[float, float, float]:
    """Return the turns about x, y, z [rad] of a craft whose port faces the target's.

    station: reference of the target alone.
    """
    port = placed(mating.at, station.rotation[0], station.position[0])
    rotation, _ = docked_pose(mating.own, port)
    about_x, about_y, about_z = Rotation.from_matrix(rotation).as_euler("XYZ").tolist()
    return about_x, about_y, about_z


def guidance(settings: Scenario, pairs: Sequence[Mating], station: Reference) -> Guidance | None:
    """Return the guidance of all guided craft; None without any.

    Args:
        settings: the scenario.
        pairs: pairs of ports (`matings`).
        station: reference of every craft at time 0.
    """
    craft, period_s = scenario.craft(settings), settings.period_s
    tables = [c.table.motion if isinstance(c.table.motion, Guided) else None for c in craft]
    if not any(tables):
        return None
    gains = [None if t is None else regulator(t.deviation_m, t.effort_m_s2, period_s) for t in tables]
    dockings = []
    for pair in pairs:
        table, names = tables[pair.craft], settings.craft_names
        assert isinstance(table, Dock)
        if settings.navigates_relative(names[pair.craft], names[pair.target]):
            dockings.append(Docking(pair.craft, pair.own, pair.at, table, period_s, rides=pair.target))
            continue
        port = placed(pair.at, station.rotation[pair.target], station.position[pair.target])
        dockings.append(Docking(pair.craft, pair.own, port, table, period_s))
    formations = [
        Formation(np.arange(i, i + c.count), table, orbit(settings), _about(settings, table, station))
        for i, (c, table) in enumerate(zip(craft, tables, strict=True))
        if isinstance(table, scenario.Formation) and c.index == 0
    ]
    watching = {i: t for i, t in enumerate(tables) if isinstance(t, Clear) and t.separation_m > 0}
    clearance = Clearance(
        np.array(list(watching), dtype=np.int64),
        np.array([t.separation_m for t in watching.values()], dtype=np.float64),
        np.array([t.brake_m_s2 for t in watching.values()], dtype=np.float64),
    )
    speaks = np.array([c.table.lighthouse and not c.table.passive for c in craft], dtype=np.bool_)
    return Guidance(period_s, gains, dockings, formations, clearance, speaks)
