"""Two CCD cameras on a craft, and the lights of another craft in their images: source 2, sections 1 and 3.

A light at r = (X, Y, Z) in a camera's frame (x right, y down, z along the optical axis) is seen where

    Z > 0,  |atan2(X, Z)| and |atan2(Y, Z)| <= field / 2,   range_min <= |r| <= range_max
    the light shines towards the camera: its normal is within `cone` of the direction to the camera
    nothing stands between the pinhole and the light (`Line`, the ray cast of `swarm.sensors.visibility`)
    the camera works

and its image is x = f X / Z, y = f Y / Z (1), plus noise, rounded to the detector's resolution. Both cameras expose at
the epoch of every lighthouse period. The light that each image belongs to is known, as with a coded or blinking marker.

The cameras are mounted with errors that the on-board computer does not know: a turn and a shift per camera, drawn once.
A camera fails as `Outage` says, for intervals of random length, or for single images. Draws depend only on seed,
purpose, the craft's key and the frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.rotation import exp, matrix_from_quaternion
from swarm import random, scenario
from swarm.draws import keys_of, normal_rows, uniform_rows
from swarm.hardware import Cameras, Lights
from swarm.messages import LightImages
from swarm.random import Purpose
from swarm.scenario import Outage
from swarm.units import SI, si

CAMERAS: tuple[Literal["main", "backup"], ...] = ("main", "backup")
END_S = 86400.0
"""Longest duration of a run [s]."""


@dataclass(frozen=True)
class Pair:
    """One pair of cameras, and the lights that it looks at.

    craft: index of the craft that carries the cameras.
    key: key of this craft's random numbers.
    target: index of the craft that carries the lights.
    cameras: the cameras as drawn.
    lights: the lights of the target.
    table: the scenario's table.
    """

    craft: int
    key: int
    target: int
    cameras: Cameras
    lights: Lights
    table: scenario.Ccd

    @cached_property
    def settings(self) -> SI:
        """Values of the table in SI units."""
        return si(self.table)


class Line(Protocol):
    """Interface of the ray cast, as `swarm.sensors.visibility.Visibility` provides it."""

    def blocked(self, origin: Floats, point: Floats, position: Floats, quaternion: Floats) -> Bools:
        """Return whether anything stands between a point and each of N others, (N,).

        Args:
            origin: start of the lines, (3,) [m].
            point: ends of the lines, (N, 3) [m].
            position: positions of the craft, (C, 3) [m].
            quaternion: attitudes of the craft, (C, 4) wxyz.
        """


class Motion(Protocol):
    """The part of `swarm.world.PeriodTruth` that the cameras read: knots over the period, the epoch in the middle."""

    @property
    def time_s(self) -> Floats: ...  # noqa: D102
    @property
    def position(self) -> Floats: ...  # noqa: D102
    @property
    def quaternion(self) -> Floats: ...  # noqa: D102


class Ccd:
    """All camera pairs of a scenario; `expose` gives their images of one period."""

    def __init__(self, pairs: Sequence[Pair], line: Line, seed: int, duration_s: float) -> None:
        """Draw the mounting errors and the random failures.

        Args:
            pairs: pairs of cameras, each with its lights.
            line: ray cast between two points.
            seed: seed of the run.
            duration_s: length of the run, for the random failures [s].
        """
        self.pairs, self._line, self._seed = tuple(pairs), line, seed
        self._most = max((len(pair.lights.point_m) for pair in self.pairs), default=0)
        self.mounted = tuple(self._mounted(pair) for pair in self.pairs)
        self._outages = tuple((*pair.table.outages, *self._random_outages(pair, duration_s)) for pair in self.pairs)
        keys = [pair.key for pair in self.pairs]
        self._noise, self._lost = keys_of(seed, Purpose.IMAGE, keys), keys_of(seed, Purpose.LOST_IMAGE, keys)

    def expose(self, truth: Motion, frame: int) -> LightImages:
        """Return the images of period `frame`, taken at its epoch."""
        epoch = len(truth.time_s) // 2
        time_s, position, quaternion = float(truth.time_s[epoch]), truth.position[epoch], truth.quaternion[epoch]
        rotation = matrix_from_quaternion(quaternion)
        noises = normal_rows(self._noise, frame, 4 * self._most).reshape(len(self.pairs), self._most, 2, 2)
        chances = uniform_rows(self._lost, frame, 2)
        image = np.full((len(self.pairs), 2, self._most, 2), np.nan)
        seen = np.zeros(image.shape[:-1], dtype=np.bool_)
        for p, pair in enumerate(self.pairs):
            settings = pair.settings
            light = pair.lights.point_m @ rotation[pair.target].T + position[pair.target]
            shine = pair.lights.normal @ rotation[pair.target].T
            lost = chances[p] < pair.table.lost_image_probability
            main = rotation[pair.craft] @ self.mounted[p].position_m[0] + position[pair.craft]
            range_m = float(np.linalg.norm(light.mean(axis=0) - main))
            for camera, name in enumerate(CAMERAS):
                if lost[camera] or self._dark(p, name, time_s, range_m):
                    continue
                pinhole = rotation[pair.craft] @ self.mounted[p].position_m[camera] + position[pair.craft]
                axes = rotation[pair.craft] @ self.mounted[p].rotation[camera]
                r = (light - pinhole) @ axes
                visible = _in_field(r, settings) & _shines(light - pinhole, shine, settings.light_cone_rad)
                if visible.any():
                    visible[visible] = ~self._line.blocked(pinhole, light[visible], position, quaternion)
                x = settings.focal_length_m * r[visible, :2] / r[visible, 2:]
                x += settings.image_noise_m * noises[p, : len(light), camera][visible]
                if settings.resolution_m > 0:
                    x = settings.resolution_m * np.rint(x / settings.resolution_m)
                at = np.flatnonzero(visible)
                image[p, camera, at], seen[p, camera, at] = x, True
        return LightImages(image, seen)

    def _dark(self, p: int, camera: str, time_s: float, range_m: float) -> bool:
        return any(
            outage.camera == camera and outage.from_s <= time_s < outage.to_s and outage.to_m < range_m <= outage.from_m
            for outage in self._outages[p]
        )

    def _mounted(self, pair: Pair) -> Cameras:
        """Return the cameras with their mounting errors."""
        draw = random.stream(self._seed, Purpose.CAMERA_MOUNTING, pair.key).standard_normal((2, 2, 3))
        turned = pair.cameras.rotation @ exp(pair.settings.mounting_error_rad * draw[:, 0])
        return Cameras(turned, pair.cameras.position_m + pair.settings.mounting_error_m * draw[:, 1])

    def _random_outages(self, pair: Pair, duration_s: float) -> list[Outage]:
        """Draw each camera's failures as a Poisson process of its own, each failure of exponential length."""
        found: list[Outage] = []
        between_s, length_s = pair.table.failure_every_s, pair.table.failure_length_s
        if between_s is None:
            return found
        for camera, name in enumerate(CAMERAS):
            stream, at = random.stream(self._seed, Purpose.CAMERA_OUTAGE, pair.key, camera), 0.0
            while (at := at + stream.exponential(between_s)) < duration_s:
                begin, at = at, at + stream.exponential(length_s)
                found.append(Outage(camera=name, from_s=begin, to_s=min(at, END_S)))
        return found


def _in_field(r: Floats, settings: SI) -> Bools:
    """Return which lights (L, 3), in the camera's frame, are within its field and range."""
    angle = np.abs(np.arctan2(r[:, :2], r[:, 2:])).max(axis=1)
    distance = np.linalg.norm(r, axis=1)
    inside: Bools = (
        (angle <= settings.field_rad / 2) & (distance >= settings.range_min_m) & (distance <= settings.range_max_m)
    )
    return inside & (r[:, 2] > 0)


def _shines(ray: Floats, normal: Floats, cone_rad: float) -> Bools:
    """Return whether lights with `normal` (L, 3) shine back along the rays (L, 3) from the camera."""
    shines: Bools = -np.sum(ray * normal, axis=1) >= np.cos(cone_rad) * np.linalg.norm(ray, axis=1)
    return shines
