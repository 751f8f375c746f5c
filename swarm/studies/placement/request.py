"""The user's request for a placement, checked: every mistake names the option, its value and the limit."""

from collections.abc import Sequence
from math import hypot, radians, sqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.pnp import FEWEST_LIT
from estimators.lighthouse.rows import Station
from swarm import scenario
from swarm.assets import find_model, models, scenarios
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.builders import station_frame
from swarm.flight.recordings.stations_file import PlacedStation, read_stations
from swarm.scenario.load import craft as crafts
from swarm.studies.design.flown import chosen_craft, flown
from swarm.studies.placement.box import Box, read_box, read_point
from swarm.studies.placement.candidates import Site, Surface, room, shell, spot
from swarm.studies.placement.task import KINDS, Kind, Task
from swarm.units import si
from swarm.world.hull import Hull

ATTITUDE_DEG, POSITION_MM = 0.1, 2.0
"""The errors of one if the user names no precision, as for a layout."""
SHARE_MIN, SHARE_MAX = 0.5, 1.0
BEYOND_M = 2.0
"""Without any place for stations, they stand on a sphere so far outside of the volume's corners [m]."""
FLOWN_TURN_RAD = radians(5.0)
"""Largest turn away from the attitudes of a flight."""
SECOND = "lighthouse-2"
ON = ("walls", "ceiling")
FACES = (*ON, "floor")
AXES = {f"{sign}{axis}": (1 if sign != "-" else -1, i) for i, axis in enumerate("xyz") for sign in ("", "+", "-")}


class Request(NamedTuple):
    """The user's wishes.

    subject: model or scenario. stations: their number; None: the fewest that reach the precision, or as many as stand
    in the scenario. kind: of `KINDS`; None: that of the scenario's stations, or else the second generation.
    volume: box of the positions, x0,x1,y0,y1,z0,z1 [m]; None: those of the scenario's flight. tilt_deg: largest tilt
    of the craft's +z from `up`. room, on, shell_m, at: where a station may stand; without any, on a sphere. keep_out:
    boxes without stations. near_m, far_m: distance of a station from the volume; None: the light's range. fixed: file
    of stations that stand already. attitude_deg, position_mm: the wanted precision. share: of the poses. losses:
    stations that may fail at a time, 0 or 1. angle_noise_arcsec, rotor_correlation: None: as usual for the kind.
    craft: of the scenario. overrides: "lighthouse.key=value" each; with a scenario, any key's.
    """

    subject: str
    stations: int | None = None
    kind: str | None = None
    volume: str | None = None
    tilt_deg: float = 180.0
    room: str | None = None
    on: Sequence[str] = ()
    shell_m: Sequence[float] = ()
    at: Sequence[str] = ()
    up: str = "z"
    keep_out: Sequence[str] = ()
    near_m: float | None = None
    far_m: float | None = None
    fixed: str | None = None
    attitude_deg: float | None = None
    position_mm: float | None = None
    share: float = 0.95
    losses: int = 0
    angle_noise_arcsec: float | None = None
    rotor_correlation: float | None = None
    craft: str | None = None
    overrides: Sequence[str] = ()

    @property
    def precision_wanted(self) -> bool:
        """True if the user names a precision."""
        return (self.attitude_deg, self.position_mm) != (None, None)


class Checked(NamedTuple):
    """The task without its scene; settings: the scenario whose flight the poses are of, None: those of a volume.

    request: with the kind and the number of stations that it leaves open, where the scenario tells. standing: stations
    of the scenario that stand in the world.
    """

    task: Task
    settings: scenario.Scenario | None
    craft: str | None
    request: Request
    standing: tuple[Station, ...] = ()


def checked(request: Request) -> Checked:
    """Return the checked request, but for the flight of its scenario. Raises SwarmError."""
    named = _names_scenario(request)
    settings = scenario.load(request.subject, request.overrides) if named else _alone(request)
    tables = [table for table in settings.station if table.craft is None]
    request = _filled(request, tables)
    kind = _checked_numbers(request)
    hull = Hull(_model(request, settings) if named else find_model(request.subject))
    if (count := len(hull.shipped.point_m)) < FEWEST_LIT:
        raise SwarmError(f"{hull.path}: {count} photodiodes, and a pose needs {FEWEST_LIT}; swarm layout places some")
    if not named and request.volume is None:
        raise SwarmError("which poses? give --volume x0,x1,y0,y1,z0,z1, or a scenario instead of a model")
    table = settings.lighthouse
    up = _up(request.up)
    volume = Box(np.zeros(3), np.zeros(3)) if request.volume is None else read_box("--volume", request.volume)
    task = Task(
        hull,
        kind,
        table,
        _noise(request, kind, table),
        (
            radians(ATTITUDE_DEG if request.attitude_deg is None else request.attitude_deg),
            1e-3 * (POSITION_MM if request.position_mm is None else request.position_mm),
        ),
        request.share,
        request.losses,
        _site(request, table, volume, up),
        radians(request.tilt_deg),
        _fixed(request, kind),
    )
    frames = [station_frame(table) for table in tables]
    standing = tuple(Station(frame.rotation, frame.position, kind.fans) for frame in frames)
    return Checked(task, settings if request.volume is None else None, request.craft, request, standing)


def _filled(request: Request, tables: Sequence[scenario.Station]) -> Request:
    """Return the request with what the stations of its scenario tell: their kind and number. Raises SwarmError."""
    if not tables:
        return request._replace(kind=request.kind or SECOND)
    kind = tables[0].kind
    if request.kind not in (None, kind):
        raise SwarmError(f"--kind {request.kind}: the stations of {request.subject} are of kind {kind}")
    if request.fixed is not None:
        raise SwarmError(f"--fixed {request.fixed}: {request.subject} has stations of its own; leave one of both out")
    given = request.stations is not None or request.precision_wanted
    return request._replace(kind=kind, stations=request.stations if given else len(tables))


def in_scene(request: Request, made: Checked) -> Task:
    """Return the task of a scenario with its flight, whose path is the volume. Raises SwarmError.

    Args:
        request: the request.
        made: the checked request.
    """
    assert made.settings is not None
    task = made.task
    # Without the housings of its stations, which would stand in the way of others at the same place.
    bare = made.settings.model_copy(update={"station": ()})
    scene = flown(bare, task.hull, made.craft, FLOWN_TURN_RAD)
    path = scene.position[:, scene.craft]
    volume = Box(path.min(axis=0), path.max(axis=0))
    return task._replace(scene=scene, site=_site(request, task.table, volume, task.site.up))


def _checked_numbers(request: Request) -> Kind:
    assert request.kind is not None
    if request.kind not in KINDS:
        hint = did_you_mean(request.kind, KINDS)
        raise SwarmError(f"--kind {request.kind}: must be {' or '.join(KINDS)}{hint}")
    kind = KINDS[request.kind]
    _within("--losses", request.losses, 0, 1)
    if request.stations is None and not request.precision_wanted:
        raise SwarmError("how many stations? give --stations, or a precision: --attitude-deg, --position-mm")
    if request.stations is not None:
        _within("--stations", request.stations, 1, kind.most, f"so many of {request.kind} can be told apart")
    for option, value in (("--attitude-deg", request.attitude_deg), ("--position-mm", request.position_mm)):
        if value is not None and not 0 < value < 1e3:
            raise SwarmError(f"{option} {value:g}: must be above 0 and below 1000")
    _within("--share", request.share, SHARE_MIN, SHARE_MAX)
    _within("--tilt-deg", request.tilt_deg, 0, 180)
    for option, distance in (("--near-m", request.near_m), ("--far-m", request.far_m)):
        if distance is not None:
            _within(option, distance, 0, 1000)
    for radius in request.shell_m:
        _within("--shell-m", radius, 0.01, 1000)
    for face in request.on:
        if face not in FACES:
            raise SwarmError(f"--on {face}: must be {', '.join(FACES)}{did_you_mean(face, FACES)}")
    if request.on and request.room is None:
        raise SwarmError("--on: of which room? give --room x0,x1,y0,y1,z0,z1")
    return kind


def _names_scenario(request: Request) -> bool:
    """Return whether the subject is a scenario. A name of both a model and a scenario is the model with a volume."""
    subject = request.subject
    if subject.endswith(".toml"):
        return True
    known = subject in scenarios()
    return known and (subject not in models() or request.volume is None)


def _alone(request: Request) -> scenario.Scenario:
    if request.craft is not None:
        raise SwarmError(f"--craft {request.craft}: of which scenario? give one instead of a model")
    for override in request.overrides:
        if not override.strip().startswith("lighthouse."):
            raise SwarmError(f"--set: {override}: a model without scenario takes only lighthouse.*")
    empty = {"name": "place", "swarm": {"count": 1}}
    return scenario.validate(empty, request.overrides, file="place", folder=Path())


def _model(request: Request, settings: scenario.Scenario) -> Path:
    return crafts(settings)[chosen_craft(settings, request.craft)].model


def _noise(request: Request, kind: Kind, table: scenario.Lighthouse) -> AngleNoise:
    """Return the noise of a sweep angle: the user's, the kind's, or the scenario's; ticks add their rounding."""
    station = si(table)

    def first(*values: float | None) -> float:
        return next(value for value in values if value is not None)

    arcsec = first(request.angle_noise_arcsec, kind.angle_noise_arcsec, table.angle_noise_arcsec)
    rho = first(request.rotor_correlation, kind.rotor_correlation, table.rotor_correlation)
    if not 0 < arcsec <= 600:
        raise SwarmError(f"--angle-noise-arcsec {arcsec:g}: must be above 0 and at most 600")
    if not 0 <= rho < 1:
        raise SwarmError(
            f"--rotor-correlation {rho:g}: must be at least 0 and below 1: photodiodes that share all of their noise "
            "measure perfectly"
        )
    sigma = radians(arcsec / 3600)
    # As in a flight: hit and reference are each rounded to a tick, of variance tick^2 / 12.
    rounding = 2 * np.pi * station.rate_hz * station.tick_s / sqrt(12)
    return AngleNoise(hypot(sqrt(1 - rho) * sigma, rounding), hypot(sqrt(rho) * sigma, rounding))


def _site(request: Request, table: scenario.Lighthouse, volume: Box, up: Floats) -> Site:
    surfaces: list[Surface] = []
    if request.room is not None:
        surfaces += room(read_box("--room", request.room), up, request.on or ON)
    surfaces += [shell(volume, radius) for radius in request.shell_m]
    surfaces += [spot(read_point("--at", text), up) for text in request.at]
    if not surfaces:
        surfaces = [shell(volume, round(volume.radius + BEYOND_M, 2))]
    near = table.range_min_m if request.near_m is None else request.near_m
    far = table.range_max_m if request.far_m is None else request.far_m
    if near > far:
        raise SwarmError(f"--near-m {near:g}: must be below the largest distance, {far:g} m (--far-m)")
    return Site(
        tuple(surfaces), volume, up, near, far, tuple(read_box("--keep-out", text) for text in request.keep_out)
    )


def _fixed(request: Request, kind: Kind) -> tuple[PlacedStation, ...]:
    if request.fixed is None:
        return ()
    found = read_stations(request.fixed).stations
    for station in found:
        if station.generation != kind.generation:
            raise SwarmError(
                f"--fixed {request.fixed}: {station.name!r} is of generation {station.generation}, but --kind is "
                f"{request.kind}"
            )
    total = len(found) + (request.stations or 1)
    if total > kind.most:
        raise SwarmError(
            f"--stations {request.stations or 1}: with the {len(found)} of {request.fixed} there are {total}, and at "
            f"most {kind.most} can be told apart"
        )
    return found


def _up(text: str) -> Floats:
    if text not in AXES:
        raise SwarmError(f"--up {text}: must be an axis, x, y, z, -x, -y or -z")
    sense, axis = AXES[text]
    up = np.zeros(3)
    up[axis] = sense
    return up


def _within(option: str, value: float, least: float, most: float, why: str = "") -> None:
    if not least <= value <= most:
        reason = f": {why}" if why else ""
        raise SwarmError(f"{option} {value:g}: must be at least {least:g} and at most {most:g}{reason}")
