"""Positions of N craft in a formation: ring, line, tetrahedron, and the projected circular orbit.

In the shape's own frame, whose z axis is its normal, with the phases a_i = 2 pi i / N and t the time:

    ring         r (cos(a_i + w t), sin(a_i + w t), 0)
    line         (L (i / (N - 1) - 1/2), 0, 0), turning about z at w
    tetrahedron  the corners of a regular one of circumradius r, then evenly along its edges, turning about z at w

turned into the lighthouse frame by Rz(turn) Rx(tilt). The projected circular orbit is a free motion of the Clohessy-
Wiltshire equations, which needs no thrust to last; with n the mean motion, in the axes x radial, y along-track, z
cross-track of the orbit (Alfriend et al., "Spacecraft Formation Flying", 2010, equation 5.27),

    x = r/2 sin(n t + a_i),   y = r cos(n t + a_i),   z = r sin(n t + a_i)                                          (P1)

so that seen along the radius (y, z) it is a circle of radius r.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Protocol

import numpy as np

from estimators.arrays import Floats
from estimators.relative_orbit import RelativeOrbit
from estimators.rotation import exp
from estimators.state import Motion
from swarm.errors import SwarmError
from swarm.scenario.motions.figure import Figure
from swarm.units import si


class Shape(Protocol):
    """A formation's places as functions of time."""

    def at(self, time_s: float, count: int) -> Motion:
        """Return the places of `count` craft at `time_s` [s]: position, velocity, acceleration, (count, 3) each."""


@dataclass(frozen=True)
class Rigid:
    """A figure that turns about its normal. centre_m: (3,), where the table does not say so itself."""

    figure: Figure
    centre_m: Sequence[float]

    def at(self, time_s: float, count: int) -> Motion:
        """Return the places; see the module."""
        own, extent_m = si(self.figure), self.figure.radius_m or self.figure.length_m or 0.0
        w = np.array([0.0, 0.0, own.rate_rad_s])
        place = _FIGURES[own.shape](count) * extent_m @ exp(w * time_s).T
        velocity = np.cross(w, place)
        frame = exp(np.array([0.0, 0.0, own.turn_rad])) @ exp(np.array([own.tilt_rad, 0.0, 0.0]))
        return Motion(np.array(self.centre_m) + place @ frame.T, velocity @ frame.T, np.cross(w, velocity) @ frame.T)


@dataclass(frozen=True)
class ProjectedCircle:
    """The projected circular orbit (P1) about a centre (3,) [m]."""

    figure: Figure
    centre_m: Sequence[float]
    orbit: RelativeOrbit

    def at(self, time_s: float, count: int) -> Motion:
        """Return the places; see the module."""
        along, across, down = self.orbit.axes
        radial_along_cross = np.stack([-down, along, -across], axis=1)
        n, radius_m = self.orbit.mean_motion_rad_s, self.figure.radius_m or 0.0
        phase = n * time_s + 2 * np.pi * np.arange(count) / count
        sine, cosine = radius_m * np.sin(phase), radius_m * np.cos(phase)
        position = np.stack([sine / 2, cosine, sine], axis=1) @ radial_along_cross.T
        velocity = n * np.stack([cosine / 2, -sine, cosine], axis=1) @ radial_along_cross.T
        return Motion(np.array(self.centre_m) + position, velocity, -(n**2) * position)


def shape_of(figure: Figure, centre_m: Sequence[float], orbit: RelativeOrbit | None) -> Shape:
    """Return the shape of a figure.

    Args:
        figure: The scenario's table.
        centre_m: The formation's centre (3,) [m], for a figure without one of its own.
        orbit: The lighthouse's orbit, None in weightless space.

    Raises:
        SwarmError: A projected circle without an orbit.
    """
    centre_m = centre_m if figure.centre_m is None else figure.centre_m
    if figure.shape != "projected-circle":
        return Rigid(figure, centre_m)
    if orbit is None:
        raise SwarmError(f"{figure.shape}: needs [orbit]")
    return ProjectedCircle(figure, centre_m, orbit)


def _ring(count: int) -> Floats:
    phase = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(phase), np.sin(phase), np.zeros(count)], axis=1)


def _line(count: int) -> Floats:
    out = np.zeros((count, 3))
    out[:, 0] = np.arange(count) / max(count - 1, 1) - (0.5 if count > 1 else 0.0)
    return out


def _tetrahedron(count: int) -> Floats:
    """Four corners, one of them on -z, towards the lighthouse; then each edge in turn gets one craft more."""
    around = np.deg2rad([90.0, 210.0, 330.0])
    base = np.stack([np.cos(around), np.sin(around), np.zeros(3)], axis=1) * np.sqrt(8) / 3 + [0, 0, 1 / 3]
    corners = np.vstack([[0.0, 0.0, -1.0], base])
    places = list(corners[: min(count, 4)])
    edges = list(combinations(range(4), 2))
    more = max(count - 4, 0)
    for e, (a, b) in enumerate(edges):
        on_edge = more // len(edges) + (e < more % len(edges))
        for k in range(on_edge):
            share = (k + 1) / (on_edge + 1)
            places.append((1 - share) * corners[a] + share * corners[b])
    return np.array(places)


_FIGURES = {"ring": _ring, "line": _line, "tetrahedron": _tetrahedron}
