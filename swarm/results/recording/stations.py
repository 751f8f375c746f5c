"""Several stations: bodies, fields and axes where they stand or ride, their planes of light, and whose light craft use.

The planes turn as the real ones do, slowed down: both of a Lighthouse 2.0 on one rotor, a third of a turn apart, those
of two Lighthouse 1.0 in turns. A line goes from a station to every craft whose filter took in rows of it in the period.
"""

from typing import Any, NamedTuple

import numpy as np
import rerun as rr

from estimators.arrays import Bools, Floats
from estimators.lighthouse.rotor import share_of
from estimators.lighthouse.sweep import LIGHTHOUSE_1, Fan, lighthouse_2
from estimators.lighthouse.tilted import TiltedErrors
from estimators.rotation import exp, matrix_from_quaternion, quaternion_from_matrix
from swarm.results.recording import drawing
from swarm.results.recording.batch import Batch
from swarm.results.recording.canvas import Canvas, Send, ink, mesh, turn
from swarm.results.recording.layer import Stage
from swarm.results.recording.lighthouse import FAN_TURN_S, SPOKES
from swarm.results.scene import StationScene

FAN_REACH = 0.3
"""Length of the planes as a share of the scene's reach, where there are more than two stations."""
APART = 0.382
"""Part of a turn by which each station is ahead of the one before: they turn by themselves."""
LIGHT_FIRST_HALF = (0.25, 0.75)
"""Share of a turn at which the fans of Lighthouse 1.0 look along the boresight."""


class Placed(NamedTuple):
    """A station in n periods: rotation (n, 3, 3) R_w_s and position (n, 3) [m]."""

    rotation: Floats
    position: Floats


def sector(fan: Fan, field_rad: float, reach_m: float) -> tuple[Floats, Floats]:
    """Return a plane of light at boresight, vertices (V, 3) [m] in the station's frame, and the axis (3,) it turns by.

    A turn by [the axis] a takes the plane to the angle a from boresight.

    Args:
        fan: the plane.
        field_rad: width of its sector [rad].
        reach_m: its radius [m].
    """
    axis = np.array(fan.axis)
    across = fan.sense * np.cross(axis, [0.0, 0.0, 1.0])
    # In the plane across + up tan(tilt) = 0.
    along = np.cos(fan.tilt_rad) * axis - np.sin(fan.tilt_rad) * across
    vertex, _ = drawing.fan(field_rad, reach_m)
    return vertex[:, 1:2] * along + vertex[:, 2:] * [0.0, 0.0, 1.0], fan.sense * axis


def fans_of(station: StationScene) -> tuple[Fan, Fan]:
    """Return the ideal planes of a station."""
    return lighthouse_2(TiltedErrors(), TiltedErrors()) if station.generation == "2.0" else LIGHTHOUSE_1


class Stations:
    """world/stations/NAME; world/fans/NAME; world/light/NAME."""

    def __init__(self, stage: Stage) -> None:
        self._stage, self._field_rad = stage, float(np.radians(stage.scene.field_deg))
        self._colour = drawing.palette(len(stage.scene.stations))
        self._names = [rr.escape_entity_path_part(station.name) for station in stage.scene.stations]
        many = len(stage.scene.stations) > 2
        self._fan_m = stage.reach_m * (FAN_REACH if many else 0.8)

    def begin(self, canvas: Canvas) -> None:
        """Draw what does not change: those that stand, in the world's coordinates; the others in their own."""
        scene = self._stage.scene
        for number, station in enumerate(scene.stations):
            at = station if station.craft < 0 else station._replace(rotation=np.eye(3), position=np.zeros(3))
            self._draw(canvas, f"world/stations/{self._names[number]}", at)
            colour = int.from_bytes(self._colour[number][:3].tobytes(), "big") << 8
            self._draw_fans(canvas, f"world/fans/{self._names[number]}", station, colour)
            for who, alpha in (("near", 0xB0), ("others", 0x30)):
                lines = rr.LineStrips3D.from_fields(colors=ink(colour | alpha), radii=[-0.6])
                canvas.static(f"world/light/{self._names[number]}/{who}", lines)

    def _draw(self, canvas: Canvas, entity: str, station: StationScene) -> None:
        """Draw a station's body, field, axes and name."""
        scene, reach = self._stage.scene, self._stage.reach_m
        body, rotation, place = drawing.solid(scene.lighthouse), station.rotation, station.position
        if body is not None:
            there = body._replace(
                vertex=(body.vertex @ rotation.T + place).astype(np.float32),
                normal=(body.normal @ rotation.T).astype(np.float32),
            )
            canvas.static(f"{entity}/body", mesh(there))
        strips = [strip @ rotation.T + place for strip in drawing.field(self._field_rad, 0.06 * reach)]
        canvas.static(f"{entity}/field", rr.LineStrips3D(strips, colors=[0xB0BEC560], radii=-0.6))
        inks = ink(0xEF5350FF, 0x66BB6AFF, 0x42A5F5FF)
        axes = rr.Arrows3D(vectors=0.08 * reach * rotation.T, origins=[place] * 3, colors=inks, radii=0.003 * reach)
        canvas.static(f"{entity}/axes", axes)
        canvas.static(f"{entity}/name", rr.Points3D([place], labels=[station.name], radii=-1.0))

    def _draw_fans(self, canvas: Canvas, whole: str, station: StationScene, colour: int) -> None:
        """Draw the planes below the entity `whole`.

        Args:
            canvas: where.
            whole: entity of both.
            station: whose they are.
            colour: rgb, and no opacity.
        """
        for plane, fan in enumerate(fans_of(station)):
            points, _ = sector(fan, self._field_rad, self._fan_m)
            face = drawing.fan(self._field_rad, self._fan_m)[1]
            entity = f"{whole}/plane-{plane + 1}"
            light = rr.Mesh3D(vertex_positions=points, triangle_indices=face, albedo_factor=colour | 0x01)
            canvas.static(f"{entity}/light", light)
            strip = np.roll(points, -1, axis=0).astype(np.float32)
            spokes = [points[[0, k]].astype(np.float32) for k in range(1 + SPOKES, len(points) - 1, SPOKES)]
            inks = ink(colour | 0x60, *[colour | 0x28] * len(spokes))
            canvas.static(f"{entity}/rim", rr.LineStrips3D([strip, *spokes], colors=inks, radii=-0.5))

    def send(self, send: Send, batch: Batch) -> None:
        """Turn the planes, move the stations that ride, and draw whose light is used."""
        near = np.zeros(batch.body_position.shape[1], dtype=np.bool_)
        near[self._stage.near] = True
        for number, station in enumerate(self._stage.scene.stations):
            placed = _placed(station, batch)
            if station.craft >= 0:
                turned = rr.Transform3D.columns(
                    translation=placed.position, quaternion=turn(quaternion_from_matrix(placed.rotation))
                )
                send(f"world/stations/{self._names[number]}", turned)
            self._turn(send, number, placed, batch.time_s)
            used = batch.station_rows[:, :, number] > 0
            used &= np.isfinite(batch.body_position).all(axis=2)
            for who, mine in (("near", used & near), ("others", used & ~near)):
                send(f"world/light/{self._names[number]}/{who}", _lines(placed, batch.body_position, mine))

    def _turn(self, send: Send, number: int, placed: Placed, time_s: Floats) -> None:
        """Turn the planes of a station.

        Args:
            send: the batch's sender.
            number: index of the station.
            placed: where it is.
            time_s: times of the periods, (n,) [s].
        """
        station, count = self._stage.scene.stations[number], len(self._stage.scene.stations)
        second = station.generation == "2.0"
        turns = time_s / FAN_TURN_S + (APART * number if second else 0.0)
        begin = share_of(np.zeros(2), np.arange(2)) if second else np.array(LIGHT_FIRST_HALF)
        for plane, fan in enumerate(fans_of(station)):
            _, axis = sector(fan, self._field_rad, self._fan_m)
            a = 2 * np.pi * ((turns - begin[plane] + 0.5) % 1 - 0.5)
            dark = np.abs(a) > self._field_rad / 2
            if not second:
                dark |= np.floor(turns) % count != number
            rotation = placed.rotation @ exp(a[:, None] * axis)
            place = np.where(dark[:, None], np.nan, placed.position)
            columns = rr.Transform3D.columns(translation=place, quaternion=turn(quaternion_from_matrix(rotation)))
            send(f"world/fans/{self._names[number]}/plane-{plane + 1}", columns)


def _lines(placed: Placed, craft: Floats, used: Bools) -> Any:
    """Return the columns of lines from a station to the craft (n, C, 3) [m] that use (n, C) its light."""
    period, who = np.nonzero(used)
    strips = np.stack([placed.position[period], craft[period, who]], axis=1).astype(np.float32)
    return rr.LineStrips3D.columns(strips=strips).partition(np.count_nonzero(used, axis=1))


def _placed(station: StationScene, batch: Batch) -> Placed:
    """Return where a station is in every period of a batch; NaN where its craft's place is not known."""
    periods = len(batch.time_s)
    if station.craft < 0:
        return Placed(
            np.broadcast_to(station.rotation, (periods, 3, 3)), np.broadcast_to(station.position, (periods, 3))
        )
    rotation = matrix_from_quaternion(batch.body_quaternion[:, station.craft])
    place = batch.body_position[:, station.craft] + rotation @ station.position
    return Placed(rotation @ station.rotation, place)
