"""A small target that looks different from everywhere, and scans of it without MuJoCo: for the LiDAR's tests."""

from functools import lru_cache

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.lidar.ray_cast import cast
from estimators.lidar.scan import Scan
from estimators.lidar.shape import Shape
from estimators.rotation import matrix_from_quaternion

DISTANCE = np.array([5.0, 0.0, 0.0])
NOISE_M = 0.01


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> tuple[Floats, Ints]:
    """Vertices (8, 3) and outward faces (12, 3)."""
    x, y, z = np.stack([low, high], axis=1)
    vertex = np.array([[a, b, c] for a in x for b in y for c in z])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return vertex, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def joined(*parts: tuple[Floats, Ints]) -> tuple[Floats, Ints]:
    """Several meshes as one."""
    first = np.cumsum([0] + [len(vertex) for vertex, _ in parts])
    faces = [face + start for (_, face), start in zip(parts, first, strict=False)]
    return np.concatenate([vertex for vertex, _ in parts]), np.concatenate(faces)


CROOKED = (
    box((-0.4, -0.35, -0.5), (0.4, 0.35, 0.5)),
    box((-0.35, 0.35, 0.05), (0.35, 1.5, 0.1)),
    box((0.2, -0.3, 0.5), (0.35, -0.15, 1.1)),
    box((-0.75, -0.3, -0.4), (-0.4, 0.1, 0.0)),
)


@lru_cache
def crooked() -> Shape:
    """A bus with one panel, a mast on one corner and a chest on one side: no symmetry."""
    return Shape(*joined(*CROOKED), points=1500)


@lru_cache
def brick() -> Shape:
    """Three different sides, but half a turn about each axis changes nothing."""
    return Shape(*box((-0.6, -0.4, -0.3), (0.6, 0.4, 0.3)), points=1000)


def directions(lines: int = 16, spacing_deg: float = 2.0, step_deg: float = 0.3) -> tuple[Floats, Ints, Ints]:
    """Rays of a scan, x ahead: directions (N, 3), the line and the step of each (N,)."""
    steps = int(44 / step_deg)
    step, line = np.meshgrid(np.arange(steps), np.arange(lines), indexing="ij")
    azimuth = np.radians((step.ravel() - steps / 2) * step_deg)
    elevation = np.radians((line.ravel() - (lines - 1) / 2) * spacing_deg)
    return (
        np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1),
        line.ravel(),
        step.ravel(),
    )


def scan_of(
    shape: Shape, rotation: Floats, position: Floats, rng: np.random.Generator, noise_m: float = NOISE_M
) -> Scan:
    """What a LiDAR of 16 lines sees of the shape at R_s_t (3, 3), position (3,) [m], with noise."""
    direction, line, step = directions()
    depth = cast(shape.mesh, -rotation.T @ position, direction @ rotation).distance
    noisy = np.where(np.isfinite(depth), depth + noise_m * rng.standard_normal(len(depth)), np.nan)
    return Scan(direction, noisy, np.radians(2.0), noise_m, line, step)


def attitudes(count: int, seed: int = 0) -> Floats:
    """Uniform over SO(3), (count, 3, 3)."""
    q = np.random.default_rng(seed).standard_normal((count, 4))
    return matrix_from_quaternion(q / np.linalg.norm(q, axis=1, keepdims=True))
