"""A LiDAR that spins: lines of rays, cast at everything that is there while everything moves.

The scanner's frame s sits on the craft (site `lidar`), z along the spin axis. Ray (i, j) of line i and step j has

    elevation e_i, evenly over the vertical field      azimuth a_j = a_0 + j da, over the horizontal field about x_s
    direction (cos e cos a, cos e sin a, sin e)        instant t_0 + j / steps * period

and all lines of a step fire at once. The world is looked at in the middle of each physics step, so that a scan takes as
long as it takes, of the target as of the scanner. A ray is bent by the angular jitter, meets the first surface of any
craft or of the lighthouse (`swarm.world.rays`: meshes by their triangles, the own craft too), and returns with
probability

    (1 - dropout) (1 - (incidence / incidence_max)^8) (1 - (range / range_max)^8)

with a range that carries the noise. Draws go by craft and scan: no other craft changes them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from estimators.arrays import Floats, Ints
from estimators.rotation import exp, log, matrix_from_quaternion, quaternion_from_matrix
from swarm import random, scenario
from swarm.messages import LidarPattern, LidarScan
from swarm.random import Purpose
from swarm.units import si
from swarm.world.rays import Rays
from swarm.world.world import PeriodTruth

STEEPNESS = 8
"""Half of the returns are lost at 0.92 of a limit."""


class Mount(NamedTuple):
    """A scanner on craft `craft`: rotation (3, 3) R_b_s, position (3,) [m] in its body."""

    craft: int
    rotation: Floats
    position: Floats


class Lidar:
    """The LiDARs of some craft, all of one kind: casts rays in its own `MjData`; the world's state is not touched."""

    def __init__(
        self,
        model: mujoco.MjModel,
        craft_bodies: Sequence[int] | Ints,
        mounts: Sequence[Mount],
        table: scenario.Lidar,
        seed: int,
        keys: Sequence[int],
    ) -> None:
        """Take the craft's root bodies (C,), each with a free joint, and who carries a scanner where.

        keys: a number for each mount that its random draws go by.
        """
        self._rays = Rays(model, craft_bodies)
        settings = si(table)
        self.mounts, self.settings = tuple(mounts), settings
        self._seed, self._keys = seed, list(keys)
        self._steps = max(1, round(settings.horizontal_field_rad / settings.resolution_rad))
        self._line_spacing_rad = settings.vertical_field_rad / max(1, settings.lines - 1)
        step, line = np.meshgrid(np.arange(self._steps), np.arange(settings.lines), indexing="ij")
        azimuth = -settings.horizontal_field_rad / 2 + step.ravel() * settings.resolution_rad
        elevation = -settings.vertical_field_rad / 2 + line.ravel() * self._line_spacing_rad
        if settings.lines == 1:
            elevation = np.zeros_like(azimuth)
        self._direction = np.stack(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
        )
        self._line, self._step = line.ravel(), step.ravel()
        self._offset_s = self._step / (self._steps * settings.rate_hz)
        self._range = np.full((len(self.mounts), len(self._direction)), np.nan)
        self._scan, self._fired = 0, 0

    def pattern(self, mount: int) -> LidarPattern:
        """Return what the craft of this mount knows of its LiDAR."""
        s, where = self.settings, self.mounts[mount]
        spacing = max(self._line_spacing_rad, s.resolution_rad)
        # Of a perfect LiDAR, the computer believes a millimetre.
        noise = max(s.range_noise_m, 1e-3)
        return LidarPattern(where.rotation, where.position, spacing, noise, 1 / s.rate_hz, s.jitter_rad)

    def sweep(self, truth: PeriodTruth) -> list[LidarScan | None]:
        """Fire the rays of one lighthouse period; return, for each mount, the scan that has become complete, if any.

        At most one: of several in one period, the last.
        """
        out: list[LidarScan | None] = [None] * len(self.mounts)
        for knot in range(len(truth.time_s) - 1):
            end_s = float(truth.time_s[knot + 1])
            position, quaternion = _halfway(truth.position[knot : knot + 2], truth.quaternion[knot : knot + 2])
            placed = False
            # Half a nanosecond of slack, so that rounding never moves a ray into the next step.
            while (due := self._due(end_s - 5e-10)) > self._fired:
                if not placed:
                    self._rays.place(position, quaternion)
                    placed = True
                for i in range(len(self.mounts)):
                    self._fire(i, slice(self._fired, due), position, quaternion)
                self._fired = due
                if due == len(self._direction):
                    out = self._complete()
                else:
                    break
        return out

    def still(self, position: Floats, quaternion: Floats) -> list[LidarScan]:
        """Return a whole scan of every mount with all craft at rest at `position` (C, 3) [m], `quaternion` (C, 4)
        wxyz.
        """
        self._rays.place(position, quaternion)
        for i in range(len(self.mounts)):
            self._fire(i, slice(0, len(self._direction)), position, quaternion)
        return [scan for scan in self._complete() if scan is not None]

    def _due(self, time_s: float) -> int:
        """Return how many rays of the running scan are to be fired before `time_s`."""
        start_s = self._scan / self.settings.rate_hz
        return int(np.searchsorted(self._offset_s, time_s - start_s))

    def _complete(self) -> list[LidarScan | None]:
        time_s = self._scan / self.settings.rate_hz + self._offset_s
        scans: list[LidarScan | None] = [
            LidarScan(self._direction, depth.copy(), time_s, self._line, self._step) for depth in self._range
        ]
        self._range[:] = np.nan
        self._scan, self._fired = self._scan + 1, 0
        return scans

    def _fire(self, mount: int, rays: slice, position: Floats, quaternion: Floats) -> None:
        s, where = self.settings, self.mounts[mount]
        body = matrix_from_quaternion(quaternion[where.craft])
        origin = position[where.craft] + body @ where.position
        meant = self._direction[rays]
        rng = random.stream(self._seed, Purpose.LIDAR, self._keys[mount], self._scan, rays.start)
        bent = meant + s.jitter_rad * rng.standard_normal(meant.shape)
        bent /= np.linalg.norm(bent, axis=1, keepdims=True)
        noise, luck = rng.standard_normal(len(meant)), rng.random(len(meant))
        direction = np.ascontiguousarray(bent @ (body @ where.rotation).T)
        hit, _, normal = self._rays.cast(origin, direction, reach_m=s.range_max_m)
        found = (hit >= 0) & (hit <= s.range_max_m)
        cosine = np.abs(np.sum(normal * direction, axis=1))
        incidence = np.arccos(np.clip(np.where(found, cosine, 1.0), 0.0, 1.0))
        chance = (
            (1 - s.dropout_probability)
            * (1 - np.minimum(incidence / s.incidence_max_rad, 1) ** STEEPNESS)
            * (1 - np.minimum(np.where(found, hit, 0.0) / s.range_max_m, 1) ** STEEPNESS)
        )
        depth = hit + s.range_noise_m * noise
        back = found & (luck < chance) & (depth >= s.range_min_m)
        self._range[mount, rays] = np.where(back, depth, np.nan)


def _halfway(position: Floats, quaternion: Floats) -> tuple[Floats, Floats]:
    """Return the poses in the middle of two, (2, C, 3) and (2, C, 4): on the straight line, at constant rate."""
    first, second = matrix_from_quaternion(quaternion)
    turn = exp(log(second @ np.swapaxes(first, -1, -2)) / 2)
    return position.mean(axis=0), quaternion_from_matrix(turn @ first)
