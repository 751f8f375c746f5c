"""Write the satellite's meshes, dish.obj and nozzle.obj, into assets/.

    python models/craft/satellite/make_meshes.py

Both are shells of revolution about z: a profile of (radius, height) [m], outside and inside, turned in 32 steps.
"""

from pathlib import Path

import numpy as np

AROUND = 32
RINGS = 8
DISH_RADIUS_M, DISH_FOCUS_M, DISH_THICKNESS_M = 0.42, 0.35, 0.012
NOZZLE_THROAT_M, NOZZLE_EXIT_M, NOZZLE_LENGTH_M, NOZZLE_THICKNESS_M = 0.06, 0.16, 0.22, 0.012


def revolve(profile: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces, outward, of a closed profile (P, 2) that runs counterclockwise in the (radius, z) plane."""
    turn = np.arange(AROUND) * 2 * np.pi / AROUND
    vertex, rings = [], []
    for radius, height in profile:
        if radius == 0:
            rings.append(np.full(AROUND, len(vertex)))
            vertex.append([0.0, 0.0, height])
        else:
            rings.append(len(vertex) + np.arange(AROUND))
            vertex += [[radius * np.cos(a), radius * np.sin(a), height] for a in turn]
    face = []
    for lower, upper in zip(rings, rings[1:] + rings[:1], strict=True):
        for a, b, c, d in zip(lower, np.roll(lower, -1), np.roll(upper, -1), upper, strict=True):
            face += [t for t in ((a, b, c), (a, c, d)) if len(set(t)) == 3]
    return np.array(vertex), np.array(face)


def dish() -> tuple[np.ndarray, np.ndarray]:
    """A paraboloid z = r^2 / (4 f) that opens towards +z, its vertex at the origin."""
    radius = np.linspace(0, DISH_RADIUS_M, RINGS + 1)
    inner = np.stack([radius, radius**2 / (4 * DISH_FOCUS_M)], axis=1)
    return revolve(np.concatenate([inner - [0, DISH_THICKNESS_M], inner[::-1]]))


def nozzle() -> tuple[np.ndarray, np.ndarray]:
    """A cone that opens towards -z, its throat at the origin, closed there."""
    t = NOZZLE_THICKNESS_M
    outer = [[0, 0], [NOZZLE_THROAT_M, 0], [NOZZLE_EXIT_M, -NOZZLE_LENGTH_M]]
    inner = [[NOZZLE_EXIT_M - t, -NOZZLE_LENGTH_M], [NOZZLE_THROAT_M - t, -t], [0, -t]]
    return revolve(np.array((outer + inner)[::-1], dtype=np.float64))


def write(path: Path, vertex: np.ndarray, face: np.ndarray) -> None:
    """Write a mesh as Wavefront OBJ."""
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertex] + [f"f {a} {b} {c}" for a, b, c in face + 1]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    assets = Path(__file__).with_name("assets")
    assets.mkdir(exist_ok=True)
    write(assets / "dish.obj", *dish())
    write(assets / "nozzle.obj", *nozzle())
