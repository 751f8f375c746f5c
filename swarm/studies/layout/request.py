"""The user's request for a layout, checked: every mistake names the option, its value and the limit."""

from collections.abc import Sequence
from math import radians
from pathlib import Path
from typing import NamedTuple

from estimators.layout.error import Mix
from estimators.lighthouse.pnp import FEWEST_LIT
from swarm import scenario
from swarm.assets import find_model
from swarm.errors import SwarmError
from swarm.studies.design.flown import flown
from swarm.studies.design.poses import PoseRange
from swarm.studies.layout.prediction import Task
from swarm.studies.layout.smallest import PHOTODIODES_MAX
from swarm.units import si
from swarm.world.hull import Hull
from swarm.world.keep_out import KeepOut

ATTITUDE_DEG, POSITION_MM = 0.1, 2.0
"""The errors of one if the user names no precision: the orders of source 1's static experiment."""
SHARE_MIN, SHARE_MAX = 0.5, 0.99
DISTANCE_M = (2.0,)
CONE_DEG, FLOWN_CONE_DEG = 180.0, 5.0
"""Without a scene: any attitude. In a scene: away from the flown attitude."""
OFF_AXIS_DEG = 30.0


class Request(NamedTuple):
    """photodiodes: their number; None: the smallest that does. attitude_deg, position_mm: the wanted precision.

    share: the share of the poses that must keep to it. losses: photodiodes that may be lost at any pose, 0 or 1.
    keep_out: boxes and names of the zones without photodiodes. scene: the scenario whose craft, `craft`, the layout is
    for; the poses are then those of its flight. overrides: "lighthouse.key=value" each; with a scene, any key's.
    distance_m, cone_deg, off_axis_deg: range of the poses; None and empty: as the constants above say.
    """

    model: str
    photodiodes: int | None = None
    attitude_deg: float | None = None
    position_mm: float | None = None
    distance_m: tuple[float, ...] = ()
    cone_deg: float | None = None
    off_axis_deg: float | None = None
    share: float = 0.95
    losses: int = 1
    keep_out: Sequence[str] = ()
    scene: str | None = None
    craft: str | None = None
    overrides: Sequence[str] = ()

    def filled(self) -> "Request":
        """Return the request with the range of its poses."""
        cone = (CONE_DEG if self.scene is None else FLOWN_CONE_DEG) if self.cone_deg is None else self.cone_deg
        if self.scene is not None:
            return self._replace(cone_deg=cone)
        off_axis = OFF_AXIS_DEG if self.off_axis_deg is None else self.off_axis_deg
        return self._replace(distance_m=self.distance_m or DISTANCE_M, cone_deg=cone, off_axis_deg=off_axis)


def task(request: Request) -> Task:
    """Return the checked request, in SI units, with the craft's hull and its scene. Raises SwarmError."""
    asked, settings = checked(request)
    return asked if request.scene is None else in_scene(asked, settings, request.craft)


def in_scene(asked: Task, settings: scenario.Scenario, craft: str | None) -> Task:
    """Return the task with its scene, which is flown for it. Raises SwarmError.

    Args:
        asked: The task.
        settings: The scene's scenario.
        craft: Name of the craft that the layout is for; None: the only one.
    """
    return asked._replace(scene=flown(settings, asked.hull, craft, asked.within.cone_rad))


def checked(request: Request) -> tuple[Task, scenario.Scenario]:
    """Return the checked request, but for its scene's flight, and the scenario. Raises SwarmError."""
    request = request.filled()
    _check_numbers(request)
    settings = _scenario(request)
    station = settings.lighthouse
    if station.angle_noise_arcsec == 0:
        raise SwarmError("--set: lighthouse.angle_noise_arcsec = 0: without noise, every layout is perfect")
    if request.scene is None:
        _check_range(request, station)
    hull = Hull(find_model(request.model))
    noise = si(station)
    asked = Task(
        hull,
        station,
        PoseRange(request.distance_m, radians(request.cone_deg or 0.0), radians(request.off_axis_deg or 0.0)),
        Mix(
            radians(ATTITUDE_DEG if request.attitude_deg is None else request.attitude_deg),
            1e-3 * (POSITION_MM if request.position_mm is None else request.position_mm),
            noise.angle_noise_rad,
            noise.rotor_correlation,
        ),
        request.share,
        request.losses,
        KeepOut(hull.path, request.keep_out),
    )
    return asked, settings


def _check_numbers(request: Request) -> None:
    wanted = request.attitude_deg, request.position_mm
    _within("--losses", request.losses, 0, 1)
    if request.photodiodes is None and wanted == (None, None):
        raise SwarmError("how many photodiodes? give --photodiodes, or a precision: --attitude-deg, --position-mm")
    if request.photodiodes is not None:
        _within("--photodiodes", request.photodiodes, FEWEST_LIT, PHOTODIODES_MAX)
        if request.photodiodes < FEWEST_LIT + request.losses:
            raise SwarmError(
                f"--photodiodes {request.photodiodes}: a pose needs {FEWEST_LIT}, so with one lost none is left to "
                "spare; give more, or --losses 0"
            )
    for option, value in zip(("--attitude-deg", "--position-mm"), wanted, strict=True):
        if value is not None and not 0 < value < 1e3:
            raise SwarmError(f"{option} {value:g}: must be above 0 and below 1000")
    _within("--share", request.share, SHARE_MIN, SHARE_MAX)
    cone_deg = request.cone_deg or 0.0
    if not 0 < cone_deg <= 180:
        raise SwarmError(f"--cone-deg {cone_deg:g}: must be above 0 and at most 180")
    if request.craft is not None and request.scene is None:
        raise SwarmError(f"--craft {request.craft}: of which scenario? give --scene")
    if request.scene is not None and (request.distance_m or request.off_axis_deg is not None):
        given = "--distance-m" if request.distance_m else "--off-axis-deg"
        raise SwarmError(f"{given}: with --scene, the flight of the craft says where it is")


def _check_range(request: Request, station: scenario.Lighthouse) -> None:
    for distance in request.distance_m:
        _within("--distance-m", distance, station.range_min_m, station.range_max_m)
    largest, off_axis = station.field_deg / 2, request.off_axis_deg or 0.0
    if not 0 <= off_axis < largest:
        raise SwarmError(f"--off-axis-deg {off_axis:g}: must be at least 0 and below {largest:g}, the field")


def _scenario(request: Request) -> scenario.Scenario:
    if request.scene is not None:
        return scenario.load(request.scene, request.overrides)
    for override in request.overrides:
        if not override.strip().startswith("lighthouse."):
            raise SwarmError(f"--set: {override}: a layout without --scene takes only lighthouse.*")
    empty = {"name": "layout", "swarm": {"count": 1}}
    return scenario.validate(empty, request.overrides, file="layout", folder=Path())


def _within(option: str, value: float, least: float, most: float) -> None:
    if not least <= value <= most:
        raise SwarmError(f"{option} {value:g}: must be at least {least:g} and at most {most:g}")
