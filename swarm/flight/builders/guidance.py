"""From the guided motions of a scenario to what guides: docking, formations, station keeping, in SI units.

beginning   the record of `swarm.motion` by which a guided craft starts
matings     who docks to whom
start       how every craft starts: its motion's beginning, and its scatter
guidance    everything that guides, or None where nothing does
"""

from collections.abc import Sequence
from math import radians

import numpy as np
from scipy.spatial.transform import Rotation

from estimators.relative_orbit import RelativeOrbit
from estimators.state import Reference
from swarm import scenario
from swarm.errors import SwarmError
from swarm.flight.builders.dynamics import orbit
from swarm.hardware import Port, docked_pose, placed
from swarm.onboard.guidance.corridor import Corridor
from swarm.onboard.guidance.docking import Docking, DockingPlan
from swarm.onboard.guidance.formation import Figure, Formation
from swarm.onboard.guidance.gains import Gains, regulator
from swarm.onboard.guidance.glideslope import Glideslope
from swarm.onboard.guidance.guidance import Clearance, Guidance
from swarm.onboard.guidance.shapes import ProjectedCircle, Rigid, Shape
from swarm.scenario import Craft, Dock, Keep, Scenario
from swarm.world.craft import load_craft
from swarm.world.docking import Mating
from swarm.world.motion.fleet import Attitude, Guided, on_grid

GuidedTable = Keep | scenario.Formation | Dock


def beginning(craft: Craft, attitude: Attitude, around: RelativeOrbit | None) -> Guided:
    """Where a guided craft's motion begins; how one that docks is turned is for `facing_port` to say."""
    table = craft.motion
    assert isinstance(table, GuidedTable)
    match table:
        case Dock():
            return Guided(table.from_m, attitude=Attitude(facing=False))
        case Keep():
            return Guided(on_grid(table.position_m, table.spacing_m, craft.index, craft.count), attitude=attitude)
        case scenario.Formation():
            first = _shape(table.figures[0], table, around).at(0.0, craft.count)
            position, velocity = first.position[craft.index].tolist(), first.velocity[craft.index].tolist()
            return Guided(tuple(position), tuple(velocity), attitude)


def matings(settings: Scenario) -> list[Mating]:
    """Every pair of ports that a craft of the scenario wants to bring together.

    Raises SwarmError, naming scenario, key and value, where a model has no port.
    """
    craft, names = scenario.craft(settings), settings.craft_names
    found = []
    for i, c in enumerate(craft):
        if not isinstance(c.motion, Dock):
            continue
        target = names.index(c.motion.target)
        where = f"scenario {settings.name}: craft {c.name!r}: motion.target = {c.motion.target!r}"
        own, at = (_port(craft[k], where) for k in (i, target))
        found.append(Mating(i, target, own, at, c.motion.latch_radius_m, radians(c.motion.latch_deg)))
    return found


def _port(craft: Craft, where: str) -> Port:
    port = load_craft(craft.model).port
    if port is None:
        raise SwarmError(f"{where}: {craft.model} has no docking port (a site whose name starts with 'port')")
    return port


def facing_port(mating: Mating, station: Reference) -> Attitude:
    """How a craft is turned whose port faces the target's. station: where the target alone is."""
    port = placed(mating.at, station.rotation[0], station.position[0])
    rotation, _ = docked_pose(mating.own, port)
    yaw, pitch, roll = Rotation.from_matrix(rotation).as_euler("XYZ").tolist()
    return Attitude(facing=False, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)


def guidance(settings: Scenario, pairs: Sequence[Mating], station: Reference) -> Guidance | None:
    """Everything that guides. pairs: of `matings`. station: where every craft is at time 0."""
    craft, around = scenario.craft(settings), orbit(settings)
    period_s = 1 / settings.lighthouse.rate_hz
    gains: list[Gains | None] = [
        regulator(c.motion.deviation_m, c.motion.effort_m_s2, period_s) if isinstance(c.motion, GuidedTable) else None
        for c in craft
    ]
    if not any(gains):
        return None
    dockings = [Docking(_plan(craft[pair.craft].motion, pair, station), period_s) for pair in pairs]
    formations = []
    for i, c in enumerate(craft):
        if isinstance(c.motion, scenario.Formation) and c.index == 0:
            table = c.motion
            figures = [Figure(figure.at_s, _shape(figure, table, around)) for figure in table.figures]
            formations.append(Formation(np.arange(i, i + c.count), figures, table.speed_m_s))
    looking = [
        (i, c.motion.separation_m, c.motion.brake_m_s2)
        for i, c in enumerate(craft)
        if isinstance(c.motion, Keep | scenario.Formation) and c.motion.separation_m > 0
    ]
    who, distance, brake = (np.array(column) for column in zip(*looking, strict=True)) if looking else np.zeros((3, 0))
    clearance = Clearance(who.astype(np.int64), distance.astype(np.float64), brake.astype(np.float64))
    speaks = np.array([c.lighthouse and not c.passive for c in craft], dtype=np.bool_)
    return Guidance(period_s, gains, dockings, formations, clearance, speaks)


def _plan(table: object, mating: Mating, station: Reference) -> DockingPlan:
    assert isinstance(table, Dock)
    port = placed(mating.at, station.rotation[mating.target], station.position[mating.target])
    slope = Glideslope(1 / table.glideslope_s, table.speed_m_s, table.acceleration_m_s2)
    corridor = Corridor(table.corridor_radius_m, radians(table.corridor_deg), radians(table.corridor_attitude_deg))
    return DockingPlan(
        craft=mating.craft,
        own=mating.own,
        target=port,
        start_m=np.array(table.from_m),
        hold_ranges_m=table.hold_ranges_m,
        hold_s=table.hold_s,
        slope=slope,
        closing_speed_m_s=table.closing_speed_m_s,
        corridor=corridor,
        start_s=table.start_s,
        lost_s=table.lost_s,
        sigma_limit_m=table.sigma_limit_m,
        brake_m_s2=table.brake_m_s2,
        settle_s=table.settle_s,
        retreats=table.retreats,
    )


def _shape(figure: scenario.Figure, table: scenario.Formation, around: RelativeOrbit | None) -> Shape:
    centre = table.centre_m if figure.centre_m is None else figure.centre_m
    if figure.shape == "projected-circle":
        if around is None:
            raise SwarmError(f"{figure.shape}: needs [orbit]")
        along, across, down = around.axes
        outwards = np.stack([-down, along, -across], axis=1)
        return ProjectedCircle(centre, figure.radius_m or 0.0, around.mean_motion_rad_s, outwards)
    return Rigid(
        figure.shape,
        centre,
        figure.radius_m or figure.length_m or 0.0,
        radians(figure.tilt_deg),
        radians(figure.turn_deg),
        radians(figure.rate_deg_s),
    )
