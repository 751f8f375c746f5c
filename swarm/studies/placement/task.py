"""The task of a placement in SI units, and what stations see and measure of its poses."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.frame import Frame
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import Station
from estimators.lighthouse.sweep import LIGHTHOUSE_1, LIGHTHOUSE_2, Fan
from estimators.placement.information import information
from estimators.placement.search import Views
from swarm.flight.recordings.stations_file import PlacedStation
from swarm.scenario import Lighthouse
from swarm.studies.design.flown import Flown
from swarm.studies.design.poses import Poses, in_volume
from swarm.studies.design.sight import LineOfSight
from swarm.studies.placement.candidates import Site, Stand
from swarm.world.hull import Hull


class Kind(NamedTuple):
    """A generation of stations.

    generation: as a file of stations has it. fans: those of a perfect station. most: number of stations that can be
    told apart. angle_noise_arcsec, rotor_correlation: of a sweep angle; None: as the scenario says.
    """

    generation: str
    fans: tuple[Fan, Fan]
    most: int
    angle_noise_arcsec: float | None = None
    rotor_correlation: float | None = None


KINDS = {
    "lighthouse-1": Kind("1.0", LIGHTHOUSE_1, 2),
    "lighthouse-2": Kind("2.0", LIGHTHOUSE_2, 16, 2.6, 0.35),
}


class Task(NamedTuple):
    """A craft, stations of one kind, where they may stand, the poses, and what counts as an error of one.

    hull: the craft, with its photodiodes. table: field, range and incidence. unit: wanted attitude [rad] and position
    [m]. share: q of the percentile. losses: stations that may fail at a time, 0 or 1. tilt_rad: largest tilt of the
    craft's +z from up. fixed: stations that stand already. scene: a flight that the poses are of.
    """

    hull: Hull
    kind: Kind
    table: Lighthouse
    noise: AngleNoise
    unit: tuple[float, float]
    share: float
    losses: int
    site: Site
    tilt_rad: float
    fixed: tuple[PlacedStation, ...] = ()
    scene: Flown | None = None

    def poses(self, count: int, seed: int | None = None) -> Poses:
        """Return `count` poses of the volume, or of the flight; seed: shifts them."""
        if self.scene is not None:
            return self.scene.poses(count, 0 if seed is None else seed + 1)
        volume = self.site.volume
        return in_volume(volume.low, volume.high, self.site.up, self.tilt_rad, count, seed)

    def stations(self, stands: Sequence[Stand]) -> list[Station]:
        """Return stations as the estimators take them."""
        return [stand.station(self.kind.fans) for stand in stands]


def views(task: Task, stations: Sequence[Station], poses: Poses) -> Views:
    """Return what stations measure at P poses.

    Args:
        task: the task.
        stations: N stations.
        poses: the poses.
    """
    point = task.hull.shipped.point_m
    made = np.empty((len(stations), len(poses.position), 6, 6))
    count = np.empty((len(stations), len(poses.position)), dtype=np.int64)
    sight = line_of_sight(task)
    for n, station in enumerate(stations):
        seen = sight.lit(poses, Frame(station.rotation, station.position))
        made[n] = information(station, poses.rotation, poses.position, seen, point, task.noise, task.unit)
        count[n] = np.count_nonzero(seen, axis=1)
    return Views(made, count)


def line_of_sight(task: Task) -> LineOfSight:
    """Return the simulator's line of sight to the craft's photodiodes."""
    return LineOfSight(task.hull, task.hull.shipped, task.table, task.scene)


def fixed_views(task: Task, poses: Poses) -> Views:
    """Return what the stations that stand already measure at poses."""
    return views(task, [placed.station for placed in task.fixed], poses)
