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
from swarm.studies.layout.poses import PoseRange
from swarm.studies.layout.prediction import Task
from swarm.studies.layout.smallest import PHOTODIODES_MAX
from swarm.units import si
from swarm.world.hull import Hull

ATTITUDE_DEG, POSITION_MM = 0.1, 2.0
"""The errors of one if the user names no precision: the orders of source 1's static experiment."""
SHARE_MIN, SHARE_MAX = 0.5, 0.99


class Request(NamedTuple):
    """photodiodes: their number; None: the smallest that does. attitude_deg, position_mm: the wanted precision.

    share: the share of the poses that must keep to it. overrides: "lighthouse.key=value" each.
    """

    model: str
    photodiodes: int | None = None
    attitude_deg: float | None = None
    position_mm: float | None = None
    distance_m: tuple[float, ...] = (2.0,)
    cone_deg: float = 180.0
    off_axis_deg: float = 30.0
    share: float = 0.95
    overrides: Sequence[str] = ()


def task(request: Request) -> Task:
    """Return the checked request, in SI units, with the craft's hull. Raises SwarmError."""
    wanted = request.attitude_deg, request.position_mm
    if request.photodiodes is None and wanted == (None, None):
        raise SwarmError("how many photodiodes? give --photodiodes, or a precision: --attitude-deg, --position-mm")
    if request.photodiodes is not None:
        _within("--photodiodes", request.photodiodes, FEWEST_LIT, PHOTODIODES_MAX)
    for option, value in zip(("--attitude-deg", "--position-mm"), wanted, strict=True):
        if value is not None and not 0 < value < 1e3:
            raise SwarmError(f"{option} {value:g}: must be above 0 and below 1000")
    _within("--share", request.share, SHARE_MIN, SHARE_MAX)
    if not 0 < request.cone_deg <= 180:
        raise SwarmError(f"--cone-deg {request.cone_deg:g}: must be above 0 and at most 180")
    station = _station(request.overrides)
    for distance in request.distance_m:
        _within("--distance-m", distance, station.range_min_m, station.range_max_m)
    largest = station.field_deg / 2
    if not 0 <= request.off_axis_deg < largest:
        raise SwarmError(
            f"--off-axis-deg {request.off_axis_deg:g}: must be at least 0 and below {largest:g}, the field"
        )
    noise = si(station)
    return Task(
        Hull(find_model(request.model)),
        station,
        PoseRange(request.distance_m, radians(request.cone_deg), radians(request.off_axis_deg)),
        Mix(
            radians(ATTITUDE_DEG if request.attitude_deg is None else request.attitude_deg),
            1e-3 * (POSITION_MM if request.position_mm is None else request.position_mm),
            noise.angle_noise_rad,
            noise.rotor_correlation,
        ),
        request.share,
    )


def _scenario(overrides: Sequence[str]) -> scenario.Scenario:
    for override in overrides:
        if not override.strip().startswith("lighthouse."):
            raise SwarmError(f"--set: {override}: a layout takes only lighthouse.*")
    return scenario.validate({"name": "layout", "swarm": {"count": 1}}, overrides, file="layout", folder=Path())


def _station(overrides: Sequence[str]) -> scenario.Lighthouse:
    station = _scenario(overrides).lighthouse
    if station.angle_noise_arcsec == 0:
        raise SwarmError("--set: lighthouse.angle_noise_arcsec = 0: without noise, every layout is perfect")
    return station


def _within(option: str, value: float, least: float, most: float) -> None:
    if not least <= value <= most:
        raise SwarmError(f"{option} {value:g}: must be at least {least:g} and at most {most:g}")
