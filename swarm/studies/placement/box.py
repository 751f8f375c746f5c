"""Boxes and points that a user gives as text, in metres in the world frame."""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from swarm.errors import SwarmError
from swarm.user_text import short

FARTHEST_M = 1000.0
"""Largest coordinate [m], as of a craft."""


class Box(NamedTuple):
    """low, high: (3,) [m], two opposite corners; they may be equal along an axis."""

    low: Floats
    high: Floats

    @property
    def middle(self) -> Floats:
        """Its middle (3,) [m]."""
        return (self.low + self.high) / 2

    @property
    def radius(self) -> float:
        """Half its diagonal [m]."""
        return float(np.linalg.norm(self.high - self.low)) / 2

    def distance(self, point: Floats) -> Floats:
        """Return the distances (N,) [m] of points (N, 3) from the box, zero inside."""
        outside = np.maximum(np.maximum(self.low - point, point - self.high), 0)
        return np.asarray(np.linalg.norm(outside, axis=1))

    def holds(self, point: Floats) -> Bools:
        """Return which points (N, 3) lie in the box or on its faces, (N,)."""
        return np.asarray(((point >= self.low) & (point <= self.high)).all(axis=1))


def read_box(option: str, text: str) -> Box:
    """Return the box of a text, x0,x1,y0,y1,z0,z1. Raises SwarmError, opened by the option."""
    numbers = _numbers(option, text, 6, "x0,x1,y0,y1,z0,z1")
    box = Box(numbers[::2], numbers[1::2])
    for axis, low, high in zip("xyz", box.low, box.high, strict=True):
        if low > high:
            raise SwarmError(f"{option} {short(text)}: {axis}0 = {low:g} is above {axis}1 = {high:g}")
    return box


def read_point(option: str, text: str) -> Floats:
    """Return the point of a text, x,y,z. Raises SwarmError, opened by the option."""
    return _numbers(option, text, 3, "x,y,z")


def _numbers(option: str, text: str, count: int, form: str) -> Floats:
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise SwarmError(f"{option} {short(text)}: must be {form}, {count} numbers in metres")
    if np.abs(numbers).max() > FARTHEST_M:
        raise SwarmError(f"{option} {short(text)}: coordinates must be within {FARTHEST_M:g} m")
    return numbers
