"""Projection of a photodiode by a fan: source 1 (2), (3) and the derivatives (8), (10), as kernels for PnP and DOP.

The photodiode w_p of the body frame is at p(tau) = Exp([w]x tau) R w_p + t + v tau in the lighthouse frame, tau after
the epoch; R = R_l_b and t are the pose at the epoch, w and v the motion assumed around it. Fan X measures u = x/z =
cot theta_x, fan Y v = y/z = cot theta_y. Derivatives are by a left rotation error d, R <- Exp([d]x) R, and by t.
"""

from math import factorial

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import inlined, kernel
from estimators.lanes import WIDE, select, wide_in
from estimators.rotation import Row, exp_rows

COLLINEAR = 1e-6
"""Photodiodes that all lie nearer to one line than this share of its length are on it: micrometres per metre, far below
any mounting error. Geometry is asked, and not the normal matrix: its smallest pivot for 5 cm at 20 m, 1e-6 of the
diagonal, amplifies rounding so much that a singular matrix can pass for a regular one."""


def checked(name: str, array: Floats, shape: tuple[int, ...]) -> Floats:
    """Return `array` as contiguous doubles, which the kernels are compiled for.

    Args:
        name: the argument, for the message.
        array: any.
        shape: the expected one.

    Raises:
        ValueError: the shape is another one.
    """
    out = np.ascontiguousarray(array, dtype=np.float64)
    if out.shape != shape:
        raise ValueError(f"{name} has shape {out.shape}, expected {shape}")
    return out


def checked_lit(lit: Bools, shape: tuple[int, ...] | None = None) -> Bools:
    """Return `lit` as contiguous booleans (C, K), or of `shape`; raises ValueError otherwise."""
    out = np.ascontiguousarray(lit, dtype=np.bool_)
    if out.shape != shape and (shape is not None or out.ndim != 2):
        raise ValueError(f"lit has shape {out.shape}, expected {shape or '(craft, photodiodes)'}")
    return out


_SINE = tuple((-1) ** k / factorial(2 * k + 1) for k in range(8, 0, -1))
_COSINE = tuple((-1) ** k / factorial(2 * k) for k in range(8, 0, -1))
"""Coefficients of both series, the last one first, without the leading 1; within pi/4 they are exact to a rounding."""
_PI_REST = 1.2246467991473532e-16
"""Pi less its double."""


@kernel
def cotangent(theta: float) -> float:
    """Return cot theta of an angle [rad], of numbers or of lanes; NaN outside (0, pi), where no fan can hit the front.

    It is the tangent of what is missing from a quarter turn, or where that is more than an eighth, one over the tangent
    of what is missing from 0 or pi: within four units in the last place.
    """
    missing = (np.pi / 2 - theta) + _PI_REST / 2
    ahead = abs(missing) <= np.pi / 4
    arc = select(ahead, missing, select(missing > 0, theta, (theta - np.pi) - _PI_REST))
    square = arc * arc
    sine, cosine = square * _SINE[0], square * _COSINE[0]
    for k in range(1, 8):
        sine, cosine = square * (sine + _SINE[k]), square * (cosine + _COSINE[k])
    sine, cosine = arc + arc * sine, 1 + cosine
    value = select(ahead, sine, cosine) / select(ahead, cosine, sine)
    out: float = select((theta > 0) & (theta < np.pi), value, np.nan)
    return out


@kernel
def _cotangents_into(theta: Floats, rest: Floats, out: Floats, of_rest: Floats) -> None:
    """Write `cotangent` of angles (N, WIDE), and of those that are left over, (n,)."""
    fours, into = wide_in(theta), wide_in(out)
    for i in range(len(fours)):
        into[i] = cotangent(fours[i])
    for i in range(len(rest)):
        of_rest[i] = cotangent(rest[i])


def projections(theta: Floats) -> Floats:
    """Return (u, v) = cot theta (2) of angles [rad], any shape; NaN outside (0, pi), where no fan can hit the front."""
    angles = np.ascontiguousarray(theta, dtype=np.float64)
    out = np.empty(angles.shape)
    given, into, whole = angles.reshape(-1), out.reshape(-1), angles.size - angles.size % WIDE
    _cotangents_into(given[:whole].reshape(-1, WIDE), given[whole:], into[:whole].reshape(-1, WIDE), into[whole:])
    return out


def angle_weights(uv: Floats) -> Floats:
    """Return sin^2 theta = z^2 / (x^2 + z^2), the size of (13), at the measured projections, any shape."""
    out: Floats = 1 / (1 + uv**2)
    return out


TAU, VALUE, WEIGHT, ROW, COLUMNS = 11, 12, 13, 14, 19
"""Columns of a table of angles, a row for each: 0 the photodiode's place (3); the rows of Exp([w]x tau) that the
projection uses, 3 the fan's own (3) and 6 the third (3); v tau, 9 along the fan's coordinate and 10 along z; tau; and
what PnP adds, the measured value and its weight, one over its noise; last its row of the Jacobian, the derivatives by
the attitude, 17 by the fan's own coordinate and 18 by z, weighted.
"""


@kernel
def gather(lit: Bools, point: Floats, offset: Floats, angular_rate: Floats, velocity: Floats, out: Floats) -> int:
    """Write the lit angles of one craft into a table, n rows of fan X and n of fan Y; return n.

    Args:
        lit: (K,).
        point: (K, 3) [m].
        offset: (K, 2) [s].
        angular_rate: (3,) [rad/s].
        velocity: (3,) [m/s].
        out: (2 K, COLUMNS), receives the rows.
    """
    n = 0
    for i in range(lit.shape[0]):
        n += lit[i]
    for fan in range(2):
        row = fan * n
        for i in range(lit.shape[0]):
            if not lit[i]:
                continue
            tau = offset[i, fan]
            turn = exp_rows(angular_rate[0] * tau, angular_rate[1] * tau, angular_rate[2] * tau)
            out[row, 0], out[row, 1], out[row, 2] = point[i, 0], point[i, 1], point[i, 2]
            write_motion(out, row, turn[0] if fan == 0 else turn[1], turn[2], velocity[fan], velocity[2], tau)
            row += 1
    return n


@inlined
def write_motion(out: Floats, row: int, own: Row, third: Row, across: float, along: float, tau: float) -> None:
    """Write the columns 3 to 11 of an angle, of numbers or of lanes.

    Args:
        out: (., COLUMNS).
        row: the angle's.
        own: the fan's own row of Exp([w]x tau).
        third: its third row.
        across: velocity along the fan's coordinate [m/s].
        along: velocity along z [m/s].
        tau: [s].
    """
    out[row, 3], out[row, 4], out[row, 5] = own
    out[row, 6], out[row, 7], out[row, 8] = third
    out[row, 9], out[row, 10], out[row, 11] = across * tau, along * tau, tau


@kernel
def gather_measured(
    uv: Floats,
    weight: Floats,
    lit: Bools,
    point: Floats,
    offset: Floats,
    angular_rate: Floats,
    velocity: Floats,
    out: Floats,
) -> int:
    """Do as `gather`, with the value and the weight of each angle; return 0 where one of them is not finite.

    Args:
        uv: (K, 2), values.
        weight: (K, 2), inverse noise.
        lit: (K,).
        point: (K, 3) [m].
        offset: (K, 2) [s].
        angular_rate: (3,) [rad/s].
        velocity: (3,) [m/s].
        out: (2 K, COLUMNS), receives the rows.
    """
    n = gather(lit, point, offset, angular_rate, velocity, out)
    i = 0
    for k in range(lit.shape[0]):
        if lit[k]:
            for fan in range(2):
                if not np.isfinite(weight[k, fan] * uv[k, fan]):
                    return 0
                out[fan * n + i, VALUE] = uv[k, fan]
                out[fan * n + i, WEIGHT] = weight[k, fan]
            i += 1
    return n


@inlined
def _arm(table: Floats, row: int, rotation: Floats) -> tuple[float, float, float]:
    """Return r = R w_p, from the craft's origin to the photodiode of an angle at the epoch [m]."""
    a, b, c = table[row, 0], table[row, 1], table[row, 2]
    return (
        rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2] * c,
        rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2] * c,
        rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * c,
    )


@inlined
def _moved(table: Floats, row: int, arm: Row, place: float, depth: float) -> tuple[float, float]:
    """Return the fan's own coordinate of a photodiode at the instant of an angle, and its z [m]."""
    x, y, z = arm
    return (
        place + table[row, 9] + table[row, 3] * x + table[row, 4] * y + table[row, 5] * z,
        depth + table[row, 10] + table[row, 6] * x + table[row, 7] * y + table[row, 8] * z,
    )


@inlined
def turned_by(table: Floats, row: int, x: float, y: float, z: float, value: float) -> tuple[float, float, float]:
    """Return the derivatives (10)(8) of an angle's projection by the attitude, times z.

    With the arm r = R w_p at the epoch, turn = Exp([w]x tau), and the gradient g of the projection (10), g^T dp/dd =
    -g^T turn [r]x = (r x (turn^T g))^T. Of g itself, the derivatives by position, 1/z is that by the fan's coordinate,
    and -(x/z) / z that by z.

    Args:
        table: (., COLUMNS), of `gather`.
        row: the angle's.
        x: of the arm [m].
        y: of the arm [m].
        z: of the arm [m].
        value: the projection.
    """
    g0 = table[row, 3] - value * table[row, 6]
    g1 = table[row, 4] - value * table[row, 7]
    g2 = table[row, 5] - value * table[row, 8]
    return y * g2 - z * g1, z * g0 - x * g2, x * g1 - y * g0


@kernel
def project(
    table: Floats, row: int, rotation: Floats, place: float, depth: float
) -> tuple[float, float, float, float, float, float]:
    """Return x/z or y/z of an angle of a table, its z [m], 1/z, and its derivatives of `turned_by`.

    Args:
        table: (., COLUMNS), of `gather`.
        row: the angle's.
        rotation: (3, 3), R.
        place: the fan's coordinate of t [m].
        depth: the third coordinate of t [m].
    """
    x, y, z = _arm(table, row, rotation)
    across, ahead = _moved(table, row, (x, y, z), place, depth)
    over = 1 / ahead
    r0, r1, r2 = turned_by(table, row, x, y, z, across * over)
    return across * over, ahead, over, r0, r1, r2


@kernel
def project_all(table: Floats, n: int, rotation: Floats, position: Floats) -> bool:
    """Write the arm of every angle, its 1/z and its x/z or y/z to the places of its row of the Jacobian; return whether
    all are in front of the lighthouse. Of numbers or of lanes.

    A loop of its own, with one division for both fans: where sums follow at once, they wait for it.

    Args:
        table: (2 n, COLUMNS), of `gather`; receives them.
        n: rows of each fan.
        rotation: (3, 3), R.
        position: (3,), t [m].
    """
    front = True
    for i in range(n):
        k = n + i
        x, y, z = _arm(table, i, rotation)
        across, ahead = _moved(table, i, (x, y, z), position[0], position[2])
        above, before = _moved(table, k, (x, y, z), position[1], position[2])
        front = front & (ahead > 0) & (before > 0)
        over = 1 / (ahead * before)
        over_x, over_y = before * over, ahead * over
        write_row(table, i, x, y, z, over_x, across * over_x)
        write_row(table, k, x, y, z, over_y, above * over_y)
    return front


@inlined
def write_row(table: Floats, i: int, a: float, b: float, c: float, d: float, e: float) -> None:
    """Write the five numbers that a table keeps of an angle beside its measurement: its row of the Jacobian, or what
    that is made from.

    Args:
        table: (., COLUMNS).
        i: the angle's.
        a: the derivative by the first axis of the attitude, or x of the arm [m].
        b: that by the second axis, or y of the arm [m].
        c: that by the third axis, or z of the arm [m].
        d: that by the fan's own coordinate of the position, or 1/z.
        e: that by the third coordinate, or the projection.
    """
    table[i, ROW], table[i, ROW + 1], table[i, ROW + 2], table[i, ROW + 3], table[i, ROW + 4] = a, b, c, d, e


@inlined
def row_of(table: Floats, i: int) -> tuple[float, float, float, float, float]:
    """Return an angle's row of the Jacobian, the five numbers of `write_row`."""
    return table[i, ROW], table[i, ROW + 1], table[i, ROW + 2], table[i, ROW + 3], table[i, ROW + 4]


@kernel
def add_curvature(
    table: Floats, row: int, fan: int, rotation: Floats, place: float, depth: float, scale: float, normal: Floats
) -> None:
    """Add a multiple of the second derivative of `project`'s value to the lower triangle of a matrix.

    From p = turn (I + [d]x + [d]x^2 / 2) r + t, r the arm and a = turn^T g, with row_z the first derivatives of z:

        d2(x/z) = -(row row_z^T + row_z row^T) / z,  and for the attitude also  (a r^T + r a^T) / 2 - (a . r) I

    Args:
        table: (., COLUMNS), of `gather`.
        row: the angle's.
        fan: 0 for X, 1 for Y.
        rotation: (3, 3), R.
        place: the fan's coordinate of t [m].
        depth: the third coordinate of t [m].
        scale: the factor.
        normal: (6, 6), to which it is added.
    """
    # Tuples, not arrays: nothing is allocated for each angle.
    arm = _arm(table, row, rotation)
    value, _, g, r0, r1, r2 = project(table, row, rotation, place, depth)
    zero = g - g  # of the type of the others
    first = (g * r0, g * r1, g * r2, g if fan == 0 else zero, g if fan == 1 else zero, -value * g)
    x, y, z = table[row, 6], table[row, 7], table[row, 8]
    ahead = (arm[1] * z - arm[2] * y, arm[2] * x - arm[0] * z, arm[0] * y - arm[1] * x, zero, zero, zero + 1)
    pull = ((table[row, 3] - value * x) * g, (table[row, 4] - value * y) * g, (table[row, 5] - value * z) * g)
    along = pull[0] * arm[0] + pull[1] * arm[1] + pull[2] * arm[2]
    for i in range(6):
        for j in range(i + 1):
            normal[i, j] -= scale * g * (first[i] * ahead[j] + ahead[i] * first[j])
    for i in range(3):
        normal[i, i] -= scale * along
        for j in range(i + 1):
            normal[i, j] += scale * (pull[i] * arm[j] + arm[i] * pull[j]) / 2


@kernel
def table_spans_plane(table: Floats, n: int) -> bool:
    """Return `spans_plane` of the photodiodes of a table's first `n` rows, of numbers or of lanes; some may be there
    twice.
    """
    x, y, z, longest, widest = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        a, b, c = table[i, 0] - table[0, 0], table[i, 1] - table[0, 1], table[i, 2] - table[0, 2]
        square = a * a + b * b + c * c
        farther = square > longest
        x, y, z = select(farther, a, x), select(farther, b, y), select(farther, c, z)
        longest = select(farther, square, longest)
    for i in range(n):
        a, b, c = table[i, 0] - table[0, 0], table[i, 1] - table[0, 1], table[i, 2] - table[0, 2]
        p, q, r = y * c - z * b, z * a - x * c, x * b - y * a
        widest = max(widest, p * p + q * q + r * r)
    out: bool = np.sqrt(widest) > COLLINEAR * longest
    return out


@kernel
def spans_plane(lit: Bools, point: Floats) -> bool:
    """Return whether the lit photodiodes (K, 3) are not all on one line, which would leave a rotation free."""
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
