"""What a fan sees of a photodiode: source 1 (2), (3) and the derivatives (8), (10), as kernels for PnP and DOP.

The photodiode w_p of the body frame is at p(tau) = Exp([w]x tau) R w_p + t + v tau in the lighthouse frame, tau after
the epoch; R = R_l_b and t are the pose at the epoch, w and v the motion assumed around it. Fan X measures u = x/z =
cot theta_x, fan Y v = y/z = cot theta_y. Derivatives are by a left rotation error d, R <- Exp([d]x) R, and by t.
"""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from estimators.rotation import sine_cosine

COLLINEAR = 1e-6
"""Photodiodes that all lie nearer to one line than this share of its length are on it: micrometres per metre, far below
any mounting error. Geometry is asked, and not the normal matrix: its smallest pivot for 5 cm at 20 m, 1e-6 of the
diagonal, amplifies rounding so much that a singular matrix can pass for a regular one."""


def checked(name: str, array: Floats, shape: tuple[int, ...]) -> Floats:
    """`array` as contiguous doubles, which the kernels are compiled for.

    Raises ValueError, naming the argument, where the shape is not `shape`.
    """
    out = np.ascontiguousarray(array, dtype=np.float64)
    if out.shape != shape:
        raise ValueError(f"{name} has shape {out.shape}, expected {shape}")
    return out


def checked_lit(lit: Bools, shape: tuple[int, ...] | None = None) -> Bools:
    """`lit` as contiguous booleans (C, K), or of `shape`; raises ValueError otherwise."""
    out = np.ascontiguousarray(lit, dtype=np.bool_)
    if out.shape != shape and (shape is not None or out.ndim != 2):
        raise ValueError(f"lit has shape {out.shape}, expected {shape or '(craft, photodiodes)'}")
    return out


def projections(theta: Floats) -> Floats:
    """(u, v) = cot theta (2) of angles [rad], any shape; NaN outside (0, pi), where no fan can hit the front."""
    inside = (theta > 0) & (theta < np.pi)
    out: Floats = np.where(inside, 1 / np.tan(np.where(inside, theta, 1.0)), np.nan)
    return out


def angle_weights(uv: Floats) -> Floats:
    """sin^2 theta = z^2 / (x^2 + z^2), the size of (13), at the measured projections, any shape."""
    out: Floats = 1 / (1 + uv**2)
    return out


@kernel
def turn_into(fan: int, angular_rate: Floats, tau: float, out: Floats) -> None:
    """Write the rows of Exp([w]x tau) that the fan's projection uses, its own and the third, into `out` (3, 3)."""
    x, y, z = angular_rate[0] * tau, angular_rate[1] * tau, angular_rate[2] * tau
    s, c = sine_cosine(x * x + y * y + z * z)
    if fan == 0:
        out[0, 0], out[0, 1], out[0, 2] = 1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y
    else:
        out[1, 0], out[1, 1], out[1, 2] = c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x
    out[2, 0], out[2, 1], out[2, 2] = c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y)


@kernel
def project(
    fan: int, x: float, y: float, z: float, turn: Floats, place: float, depth: float
) -> tuple[float, float, float, float, float, float, float]:
    """x/z (fan 0) or y/z (fan 1) of one photodiode, its z [m], and its derivatives (10)(8) that are not zero.

    (x, y, z) is the arm R w_p at the epoch, `turn` (3, 3) is Exp([w]x tau), `place` and `depth` the fan's coordinate
    and the third one of t + v tau. With the gradient g of the projection (10), g^T dp/dd = -g^T turn [arm]x =
    (arm x (turn^T g))^T. Returns value, z, the three derivatives by attitude, those by the fan's coordinate and by z.
    """
    across = turn[fan, 0] * x + turn[fan, 1] * y + turn[fan, 2] * z + place
    ahead = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + depth
    g = 1 / ahead
    value = across * g
    a0 = g * (turn[fan, 0] - value * turn[2, 0])
    a1 = g * (turn[fan, 1] - value * turn[2, 1])
    a2 = g * (turn[fan, 2] - value * turn[2, 2])
    return value, ahead, y * a2 - z * a1, z * a0 - x * a2, x * a1 - y * a0, g, -value * g


@kernel
def project_into(
    fan: int, arm: Floats, turn: Floats, position: Floats, velocity: Floats, tau: float, row: Floats
) -> tuple[float, float]:
    """`project` of the arm (3,) as value and z, its derivatives by (attitude, position) in `row` (6,)."""
    place, depth = position[fan] + velocity[fan] * tau, position[2] + velocity[2] * tau
    value, z, row[0], row[1], row[2], g, gz = project(fan, arm[0], arm[1], arm[2], turn, place, depth)
    row[3], row[4], row[5] = 0.0, 0.0, gz
    row[3 + fan] = g
    return value, z


@kernel
def add_curvature(
    fan: int, arm: Floats, turn: Floats, row: Floats, value: float, z: float, scale: float, normal: Floats
) -> None:
    """Add `scale` times the second derivative of x/z (fan 0) or y/z (fan 1) to the lower triangle of `normal` (6, 6).

    From p = turn (I + [d]x + [d]x^2 / 2) r + t, r the arm and a = turn^T g, with row_z the first derivatives of z:

        d2(x/z) = -(row row_z^T + row_z row^T) / z,  and for the attitude also  (a r^T + r a^T) / 2 - (a . r) I
    """
    x, y, ahead = turn[2, 0], turn[2, 1], turn[2, 2]
    # Tuples, not arrays: nothing is allocated for each angle.
    depth = (arm[1] * ahead - arm[2] * y, arm[2] * x - arm[0] * ahead, arm[0] * y - arm[1] * x, 0.0, 0.0, 1.0)
    over = 1 / z
    pull = ((turn[fan, 0] - value * x) * over, (turn[fan, 1] - value * y) * over, (turn[fan, 2] - value * ahead) * over)
    along = pull[0] * arm[0] + pull[1] * arm[1] + pull[2] * arm[2]
    for i in range(6):
        for j in range(i + 1):
            normal[i, j] -= scale * over * (row[i] * depth[j] + depth[i] * row[j])
    for i in range(3):
        normal[i, i] -= scale * along
        for j in range(i + 1):
            normal[i, j] += scale * (pull[i] * arm[j] + arm[i] * pull[j]) / 2


@kernel
def arm_into(rotation: Floats, point: Floats, out: Floats) -> None:
    """Write R w_p (3,) of one photodiode into `out`."""
    for k in range(3):
        out[k] = rotation[k, 0] * point[0] + rotation[k, 1] * point[1] + rotation[k, 2] * point[2]


@kernel
def spans_plane(lit: Bools, point: Floats) -> bool:
    """Whether the lit photodiodes (K, 3) are not all on one line: then they leave no rotation free."""
    first, far, longest, widest = -1, -1, 0.0, 0.0
    for i in range(lit.shape[0]):
        if lit[i]:
            first = i if first < 0 else first
            square = 0.0
            for k in range(3):
                square += (point[i, k] - point[first, k]) ** 2
            if square > longest:
                far, longest = i, square
    if far < 0:
        return False
    for i in range(lit.shape[0]):
        if lit[i]:
            square = 0.0
            for k in range(3):
                a, b = (k + 1) % 3, (k + 2) % 3
                area = (point[far, a] - point[first, a]) * (point[i, b] - point[first, b])
                area -= (point[far, b] - point[first, b]) * (point[i, a] - point[first, a])
                square += area * area
            widest = max(widest, square)
    return bool(np.sqrt(widest) > COLLINEAR * longest)
