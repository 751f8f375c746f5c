"""The places of N craft in a formation: ring, line, tetrahedron, and the projected circular orbit.

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

from dataclasses import dataclass
from itertools import combinations
from typing import Literal, Protocol

import numpy as np

from estimators.arrays import Floats
from estimators.rotation import exp
from estimators.state import Motion, Vector


class Shape(Protocol):
    """A formation's places as functions of time."""

    def at(self, time_s: float, count: int) -> Motion:
        """The places of `count` craft at `time_s` [s]: position, velocity, acceleration, (count, 3) each."""


@dataclass(frozen=True)
class Rigid:
    """A figure that turns about its normal. extent_m: r of a ring or a tetrahedron, L of a line. rate_rad_s: w."""

    kind: Literal["ring", "line", "tetrahedron"]
    centre_m: Vector
    extent_m: float
    tilt_rad: float = 0.0
    turn_rad: float = 0.0
    rate_rad_s: float = 0.0

    def at(self, time_s: float, count: int) -> Motion:
        """The places; see the module."""
        w = np.array([0.0, 0.0, self.rate_rad_s])
        own = _FIGURES[self.kind](count) * self.extent_m @ exp(w * time_s).T
        velocity = np.cross(w, own)
        frame = exp(np.array([0.0, 0.0, self.turn_rad])) @ exp(np.array([self.tilt_rad, 0.0, 0.0]))
        return Motion(np.array(self.centre_m) + own @ frame.T, velocity @ frame.T, np.cross(w, velocity) @ frame.T)


@dataclass(frozen=True)
class ProjectedCircle:
    """The projected circular orbit (P1) about a centre. mean_motion_rad_s: n. axes: (3, 3), its columns the radial, the
    along-track and the cross-track axis in the lighthouse frame.
    """

    centre_m: Vector
    radius_m: float
    mean_motion_rad_s: float
    axes: Floats

    def at(self, time_s: float, count: int) -> Motion:
        """The places; see the module."""
        n = self.mean_motion_rad_s
        phase = n * time_s + 2 * np.pi * np.arange(count) / count
        sine, cosine = self.radius_m * np.sin(phase), self.radius_m * np.cos(phase)
        position = np.stack([sine / 2, cosine, sine], axis=1) @ self.axes.T
        velocity = n * np.stack([cosine / 2, -sine, cosine], axis=1) @ self.axes.T
        return Motion(np.array(self.centre_m) + position, velocity, -(n**2) * position)


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
