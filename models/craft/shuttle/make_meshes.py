"""Write the shuttle's meshes, fuselage.obj, wing.obj, fin.obj and nozzle.obj, into assets/.

    python models/craft/shuttle/make_meshes.py

The fuselage is a loft of cross-sections along x, wing and fin are plates whose rims are thinner than their roots.
"""

from pathlib import Path

import numpy as np

AROUND = 28
STATIONS = (
    # x [m], half width, top and bottom above the axis [m], squareness of the cross-section (2: an ellipse)
    (4.50, 0.06, 0.02, -0.22, 2.0),
    (4.35, 0.24, 0.18, -0.36, 2.0),
    (3.95, 0.44, 0.42, -0.50, 2.2),
    (3.40, 0.60, 0.78, -0.60, 2.4),
    (2.90, 0.66, 0.92, -0.64, 2.6),
    (2.30, 0.68, 0.80, -0.66, 3.0),
    (0.00, 0.68, 0.72, -0.68, 3.2),
    (-3.00, 0.68, 0.72, -0.68, 3.2),
    (-4.10, 0.70, 0.78, -0.66, 3.0),
    (-4.50, 0.60, 0.66, -0.56, 2.6),
)
FLATTER = 4.0
"""Squareness of the lower half: a belly is nearly flat."""
WING = ((-0.9, 1.25), (-3.1, 2.35), (-3.9, 2.35), (-4.2, 0.5), (2.2, 0.5))
"""The left wing, (x, y) [m], counterclockwise from where its leading edge bends: a double delta."""
WING_ROOT_M, WING_TIP_M = 0.26, 0.06
FIN = ((-4.5, 0.5), (-5.0, 2.35), (-4.3, 2.35), (-2.7, 0.5))
"""The fin, (x, z) [m]."""
FIN_ROOT_M, FIN_TIP_M = 0.24, 0.07
NOZZLE = ((0.0, 0.12), (-0.15, 0.2), (-0.55, 0.27))
"""(x, radius) [m] of the outside of an engine's nozzle."""
NOZZLE_THICKNESS_M = 0.02


def lofted(rings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and outward faces of closed rings (S, A, 3), counterclockwise seen from the first towards which
    the ends are closed.
    """
    count, around, _ = rings.shape
    vertex = [*rings.reshape(-1, 3), rings[0].mean(axis=0), rings[-1].mean(axis=0)]
    first, last = count * around, count * around + 1
    face = []
    for i in range(around):
        j = (i + 1) % around
        face += [(first, i, j), (last, (count - 1) * around + j, (count - 1) * around + i)]
        for s in range(count - 1):
            a, b, c, d = s * around + i, s * around + j, (s + 1) * around + j, (s + 1) * around + i
            face += [(a, d, c), (a, c, b)]
    return np.array(vertex), np.array(face)


def fuselage() -> tuple[np.ndarray, np.ndarray]:
    """Return the loft of `STATIONS`, from nose to tail."""
    turn = np.arange(AROUND) * 2 * np.pi / AROUND
    rings = []
    for x, half, top, bottom, square in STATIONS:
        power = np.where(np.sin(turn) < 0, FLATTER, square)
        y, z = np.cos(turn), np.sin(turn)
        size = (np.abs(y) ** power + np.abs(z) ** power) ** (-1 / power)
        middle = (top + bottom) / 2
        rings.append(np.stack([np.full(AROUND, x), half * size * y, middle + (top - bottom) / 2 * size * z], axis=1))
    return lofted(np.array(rings))


def plate(outline: np.ndarray, half: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a plate with an outline (n, 3) [m], counterclockwise about `across` (3,), along which it is twice `half`
    (n,) [m] thick at each corner. All of the outline is seen from its first corner.
    """
    above, below = outline + half[:, None] * across, outline - half[:, None] * across
    count = len(outline)
    fan = [(0, k, k + 1) for k in range(1, count - 1)]
    face = fan + [(count + a, count + c, count + b) for a, b, c in fan]
    for i in range(count):
        j = (i + 1) % count
        face += [(i, count + i, count + j), (i, count + j, j)]
    return np.concatenate([above, below]), np.array(face)


def wing() -> tuple[np.ndarray, np.ndarray]:
    """Return both halves of the wing, in the plane z = 0."""
    x, y = np.array(WING).T
    share = (y - y.min()) / np.ptp(y)
    half = (WING_ROOT_M + (WING_TIP_M - WING_ROOT_M) * share) / 2
    parts = []
    for side in (1, -1):
        outline = np.stack([x, side * y, np.zeros_like(x)], axis=1)
        vertex, face = plate(outline, half, np.array([0.0, 0.0, 1.0]))
        parts.append((vertex, face[:, ::side]))
    (one, faces), (two, more) = parts
    return np.concatenate([one, two]), np.concatenate([faces, more + len(one)])


def fin() -> tuple[np.ndarray, np.ndarray]:
    """Return the fin, in the plane y = 0."""
    x, z = np.array(FIN).T
    share = (z - z.min()) / np.ptp(z)
    half = (FIN_ROOT_M + (FIN_TIP_M - FIN_ROOT_M) * share) / 2
    return plate(np.stack([x, np.zeros_like(x), z], axis=1), half, np.array([0.0, 1.0, 0.0]))


def nozzle() -> tuple[np.ndarray, np.ndarray]:
    """Return a bell that opens towards -x, its throat at the origin, closed there."""
    outer = np.array(NOZZLE)
    inner = outer[::-1] - [[0.0, NOZZLE_THICKNESS_M]] * len(outer)
    inner[-1, 0] -= NOZZLE_THICKNESS_M
    turn = np.arange(AROUND) * 2 * np.pi / AROUND
    rings = [
        np.stack([np.full(AROUND, x), radius * np.cos(turn), radius * np.sin(turn)], axis=1)
        for x, radius in np.concatenate([outer, inner])
    ]
    return lofted(np.array(rings))


def write(path: Path, vertex: np.ndarray, face: np.ndarray) -> None:
    """Write a mesh as Wavefront OBJ."""
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertex] + [f"f {a} {b} {c}" for a, b, c in face + 1]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    assets = Path(__file__).with_name("assets")
    assets.mkdir(exist_ok=True)
    for name, mesh in (("fuselage", fuselage()), ("wing", wing()), ("fin", fin()), ("nozzle", nozzle())):
        write(assets / f"{name}.obj", *mesh)
