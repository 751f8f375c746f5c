"""The poses that a layout or a placement is designed for and judged at.

`lattice`, for a layout, is in the lighthouse frame. A pose is given by u, the direction to the lighthouse in the body
frame (which side is lit), the roll about the line of sight, the craft's direction from the lighthouse, and its
distance. u is uniform on the sphere, or in a cone about +z, the craft's front; roll is uniform; the direction is
uniform in a cone about the boresight; all distances are equally frequent. With the whole sphere the attitude is uniform
on SO(3).

`in_volume`, for a placement, in the world frame: positions uniform in a box, headings uniform, and the body's +z axis
uniform in a cone about the direction that is up.

Poses are spread evenly, with equal steps in the cone's cap and additive recurrences in the rest: few of them see the
whole range.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints

GOLDEN = (np.sqrt(5) - 1) / 2
"""Step of the azimuth of u, in turns: the Fibonacci lattice of the sphere."""
ROBERTS = 1.1673039782614187 ** -np.arange(1.0, 5.0)
"""Steps of the other four numbers: Roberts' R4 sequence, powers of the root of x^5 = x + 1."""


class PoseRange(NamedTuple):
    """distance_m: the distances. cone_rad: largest angle between +z and the direction to the lighthouse; pi: all
    attitudes. off_axis_rad: largest angle of the craft's direction off the boresight.
    """

    distance_m: tuple[float, ...]
    cone_rad: float = np.pi
    off_axis_rad: float = np.pi / 6


class Poses(NamedTuple):
    """rotation: (P, 3, 3) R_l_b. position: (P, 3) [m], in the lighthouse's or the world's frame. moment: (P,), the
    moment of a flown scene at which each pose occurs; None: the craft is alone.
    """

    rotation: Floats
    position: Floats
    moment: Ints | None = None


def lattice(within: PoseRange, count: int, seed: int | None = None) -> Poses:
    """Spread poses evenly over a range.

    Shifted lattices are independent samples without bias, far more even than random poses (Cranley and Patterson 1976).

    Args:
        within: The range.
        count: Number of poses P.
        seed: Shift the lattice at random in all six numbers; None: leave it.
    """
    height, around = _even(count, seed)
    to_light = _in_cap(height, around[:, 0], within.cone_rad)
    out = _in_cap(around[:, 1], around[:, 2], within.off_axis_rad)
    turn = _about_z(2 * np.pi * around[:, 3])
    # Two frames with their z axes along the line of sight, one seen from the craft and one from the lighthouse.
    rotation = _frame(-out) @ turn @ np.swapaxes(_frame(to_light), -1, -2)
    which = (around[:, 4] * len(within.distance_m)).astype(np.int64)
    distance = np.array(within.distance_m)[which]
    return Poses(rotation, distance[:, None] * out)


def in_volume(low: Floats, high: Floats, up: Floats, tilt_rad: float, count: int, seed: int | None = None) -> Poses:
    """Spread poses evenly over a box.

    Args:
        low: (3,) [m], least coordinates of the positions.
        high: (3,) [m], largest ones.
        up: (3,), unit vector.
        tilt_rad: largest angle between the body's +z axis and `up`; pi: all attitudes.
        count: Number of poses P.
        seed: Shift the lattice at random in all six numbers; None: leave it.
    """
    height, around = _even(count, seed)
    axis = _in_cap(around[:, 0], around[:, 1], tilt_rad) @ _frame(up[None])[0].T
    rotation = _frame(axis) @ _about_z(2 * np.pi * around[:, 2])
    share = np.column_stack([around[:, 3], around[:, 4], height])
    return Poses(rotation, low + share * (high - low))


def _even(count: int, seed: int | None) -> tuple[Floats, Floats]:
    """Return equal steps (P,), and additive recurrences (P, 5), in 0..1."""
    shift = np.full(6, 0.5) if seed is None else np.random.default_rng(seed).random(6)
    step = np.arange(count)
    return (step + shift[0]) / count, (np.outer(step, [GOLDEN, *ROBERTS]) + shift[1:]) % 1


def _about_z(angle: Floats) -> Floats:
    """Return rotations (P, 3, 3) about z by angles (P,) [rad]."""
    cos, sin, zero, one = np.cos(angle), np.sin(angle), np.zeros(len(angle)), np.ones(len(angle))
    return np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], axis=1).reshape(-1, 3, 3)


def _in_cap(along: Floats, around: Floats, half_angle: float) -> Floats:
    """Directions (P, 3) uniform in the cap about +z."""
    z = 1 - along * (1 - np.cos(half_angle))
    across, azimuth = np.sqrt(np.maximum(1 - z * z, 0)), 2 * np.pi * around
    return np.column_stack([across * np.cos(azimuth), across * np.sin(azimuth), z])


def _frame(axis: Floats) -> Floats:
    """Rotations (P, 3, 3) whose third column is `axis` (P, 3)."""
    other = np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(other, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(axis, first), axis], axis=-1)
