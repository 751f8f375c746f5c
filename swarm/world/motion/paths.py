"""Paths (`swarm.scenario.motions.paths`) with velocity and acceleration, evaluated for many craft at once."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel
from estimators.scratch import scratch
from estimators.state import Motion
from swarm.scenario.motions.paths import DEGREE, Circle, Path, Pieces, Wandering
from swarm.scenario.motions.tones import Tones


class Paths(Protocol):
    """The paths of C craft."""

    def at(self, time_s: float) -> Motion:
        """Return position, velocity and acceleration of the craft at `time_s` [s]."""


class Circles:
    """Circles of C craft."""

    def __init__(self, singles: Sequence[Circle]) -> None:
        self._centre = np.array([single.centre for single in singles])
        self._first = np.array([1.0, 0.0, 0.0])
        self._second = np.array([[0.0, np.cos(single.tilt), np.sin(single.tilt)] for single in singles])
        self._radius = np.array([[single.radius] for single in singles])
        self._phase = np.array([[single.phase] for single in singles])
        self._rate = np.array([[single.rate] for single in singles])

    def at(self, time_s: float) -> Motion:
        """Return position, velocity and acceleration of the craft at `time_s` [s]."""
        angle = self._phase + self._rate * time_s
        cosine, sine = self._radius * np.cos(angle), self._radius * np.sin(angle)
        arm = cosine * self._first + sine * self._second
        along = cosine * self._second - sine * self._first
        return Motion(self._centre + arm, self._rate * along, -(self._rate**2) * arm)


class Polynomials:
    """Piecewise polynomials of C craft, padded to the largest number of pieces."""

    def __init__(self, singles: Sequence[Pieces]) -> None:
        most = max(len(single.start) for single in singles)
        self._start = np.full((len(singles), most), np.inf)
        self._coefficient = np.zeros((len(singles), most, DEGREE + 1, 3))
        for i, single in enumerate(singles):
            self._start[i, : len(single.start)] = single.start
            for n, piece in enumerate(single.coefficient):
                self._coefficient[i, n, : len(piece)] = piece

    def at(self, time_s: float) -> Motion:
        """Return position, velocity and acceleration of the craft at `time_s` [s]."""
        out = Motion(*np.empty((3, len(self._start), 3)))
        _polynomials_into(time_s, self._start, self._coefficient, out.position, out.velocity, out.acceleration)
        return out


@kernel
def _polynomials_into(
    time_s: float, start: Floats, coefficient: Floats, position: Floats, velocity: Floats, acceleration: Floats
) -> None:
    """Evaluate the pieces with start (C, N) [s] and coefficient (C, N, 6, 3) into (C, 3) each."""
    value, slope, curve = scratch(0.0, 3), scratch(0.0, 3), scratch(0.0, 3)
    for c in range(len(start)):
        piece = 0
        while piece + 1 < start.shape[1] and time_s >= start[c, piece + 1]:
            piece += 1
        since = time_s - start[c, piece]
        for i in range(3):
            value[i] = slope[i] = curve[i] = 0.0
        # Horner's scheme for the polynomial and, along with it, for its derivatives over 1! and 2!.
        for n in range(DEGREE, -1, -1):
            for i in range(3):
                curve[i] = curve[i] * since + slope[i]
                slope[i] = slope[i] * since + value[i]
                value[i] = value[i] * since + coefficient[c, piece, n, i]
        for i in range(3):
            position[c, i], velocity[c, i], acceleration[c, i] = value[i], slope[i], 2 * curve[i]


class Wanderings:
    """The wanderings of C craft."""

    def __init__(self, singles: Sequence[Wandering]) -> None:
        self._centre = np.array([single.centre for single in singles])
        offsets = [single.offset for single in singles]
        self._offset = Tones._make(np.array(part) for part in zip(*offsets, strict=True))

    def at(self, time_s: float) -> Motion:
        """Return position, velocity and acceleration of the craft at `time_s` [s]."""
        offset, velocity, acceleration = self._offset.at(time_s)
        return Motion(self._centre + offset, velocity, acceleration)


def grouped(paths: Sequence[Path]) -> list[tuple[Ints, Paths]]:
    """Return the paths grouped by kind, each group with the indices of its craft."""
    circles = {i: path for i, path in enumerate(paths) if isinstance(path, Circle)}
    pieces = {i: path for i, path in enumerate(paths) if isinstance(path, Pieces)}
    wandering = {i: path for i, path in enumerate(paths) if isinstance(path, Wandering)}
    out: list[tuple[Ints, Paths]] = []
    if circles:
        out.append((np.array(list(circles)), Circles(list(circles.values()))))
    if pieces:
        out.append((np.array(list(pieces)), Polynomials(list(pieces.values()))))
    if wandering:
        out.append((np.array(list(wandering)), Wanderings(list(wandering.values()))))
    return out
