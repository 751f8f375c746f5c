"""Slope of receiver autonomy: the pose error by one false photodiode over what the residuals show of it.

One photodiode k errs by b = (b_x, b_y) in its two angles, beside the noise. With the rows J of the angles (`dop`),
N = J^T J, M = I - J N^-1 J^T, and E_k, which picks the two angles of k,

    pose error         N^-1 J^T E_k b
    noncentrality      b^T A_k b / ((1 - rho) s^2),   A = M - U ((1 - rho) / rho I + U^T U)^-1 U^T,   U = M (1_x, 1_y)

of the residual test (`integrity`), which takes what looks like the rotor's part, common to a fan, out of the residuals.
The worst ratio over b of the squared position error to b^T A_k b is the greater eigenvalue of A_k^-1 B_k, B_k = E_k^T J
N^-1 P^T P N^-1 J^T E_k with P the position's rows; its root, the largest over k, is the slope: with the smallest
noncentrality L that the test does not miss, no undetected single fault moves the position by more than

    slope sqrt(L) sqrt(1 - rho) s

and likewise the attitude. Walter and Enge (ION GPS 1995) have the same for a GPS receiver and one faulty range.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import kernel
from estimators.lanes import select
from estimators.lighthouse.projection import row_of

SHOWN = 1e-8
"""A fault of which the residuals show less than this share, against rounding, they do not show at all."""


@kernel
def _greater_eigenvalue(
    a: float, b: float, c: float, over: float, x0: float, x1: float, x2: float, y0: float, y1: float, y2: float
) -> float:
    """Return that of [[a, -b], [-b, c]]^-1 [[x.x, x.y], [x.y, y.y]]; over: one over the determinant of the first."""
    xx, xy, yy = x0 * x0 + x1 * x1 + x2 * x2, x0 * y0 + x1 * y1 + x2 * y2, y0 * y0 + y1 * y1 + y2 * y2
    half = (c * xx + (b + b) * xy + a * yy) * (0.5 * over)
    greater: float = half + np.sqrt(max(half * half - (xx * yy - xy * xy) * over, 0.0))
    return greater


@kernel
def worst_slopes(
    table: Floats, n: int, number: float, inverse: Floats, fan_sum: Floats, spread: Floats, rho: float
) -> tuple[float, float]:
    """Return the slopes of attitude [rad/rad] and position [m/rad]; infinite where a photodiode's fault shows nowhere.

    Of numbers or of lanes.

    Args:
        table: (2 n, COLUMNS), angles, with J.
        n: number of rows of each fan.
        number: number of photodiodes: rows after them are zero.
        inverse: (6, 6), N^-1.
        fan_sum: (2, 6), sum of each fan's rows.
        spread: (2, 6), N^-1 times it.
        rho: of (19).
    """
    s, t = fan_sum, spread
    # U^T U, and W = ((1 - rho) / rho I + U^T U)^-1 written so that rho may be zero.
    u00, u01, u11 = number, 0.0, number
    for m in range(6):
        u00 -= s[0, m] * t[0, m]
        u01 -= s[0, m] * t[1, m]
        u11 -= s[1, m] * t[1, m]
    d00, d01, d11 = 1 - rho + rho * u00, rho * u01, 1 - rho + rho * u11
    scale = rho / (d00 * d11 - d01 * d01)
    w00, w01, w11 = scale * d11, -scale * d01, scale * d00

    i00, i01, i02, i03 = inverse[0, 0], inverse[0, 1], inverse[0, 2], inverse[0, 3]
    i04, i05, i11, i12 = inverse[0, 4], inverse[0, 5], inverse[1, 1], inverse[1, 2]
    i13, i14, i15, i22 = inverse[1, 3], inverse[1, 4], inverse[1, 5], inverse[2, 2]
    i23, i24, i25, i33 = inverse[2, 3], inverse[2, 4], inverse[2, 5], inverse[3, 3]
    i34, i35, i44, i45, i55 = inverse[3, 4], inverse[3, 5], inverse[4, 4], inverse[4, 5], inverse[5, 5]
    t00, t01, t02, t03, t04, t05 = -t[0, 0], -t[0, 1], -t[0, 2], -t[0, 3], -t[0, 4], -t[0, 5]
    t10, t11, t12, t13, t14, t15 = -t[1, 0], -t[1, 1], -t[1, 2], -t[1, 3], -t[1, 4], -t[1, 5]
    attitude, position = 0.0, 0.0
    for k in range(n):
        x0, x1, x2, x3, x5 = row_of(table, k)
        y0, y1, y2, y4, y5 = row_of(table, n + k)
        # N^-1 times the rows.
        p0 = i00 * x0 + i01 * x1 + i02 * x2 + i03 * x3 + i05 * x5
        p1 = i01 * x0 + i11 * x1 + i12 * x2 + i13 * x3 + i15 * x5
        p2 = i02 * x0 + i12 * x1 + i22 * x2 + i23 * x3 + i25 * x5
        p3 = i03 * x0 + i13 * x1 + i23 * x2 + i33 * x3 + i35 * x5
        p4 = i04 * x0 + i14 * x1 + i24 * x2 + i34 * x3 + i45 * x5
        p5 = i05 * x0 + i15 * x1 + i25 * x2 + i35 * x3 + i55 * x5
        q0 = i00 * y0 + i01 * y1 + i02 * y2 + i04 * y4 + i05 * y5
        q1 = i01 * y0 + i11 * y1 + i12 * y2 + i14 * y4 + i15 * y5
        q2 = i02 * y0 + i12 * y1 + i22 * y2 + i24 * y4 + i25 * y5
        q3 = i03 * y0 + i13 * y1 + i23 * y2 + i34 * y4 + i35 * y5
        q4 = i04 * y0 + i14 * y1 + i24 * y2 + i44 * y4 + i45 * y5
        q5 = i05 * y0 + i15 * y1 + i25 * y2 + i45 * y4 + i55 * y5
        # The photodiode's rows of U: less x^T N^-1 s.
        ux0 = 1 + x0 * t00 + x1 * t01 + x2 * t02 + x3 * t03 + x5 * t05
        ux1 = x0 * t10 + x1 * t11 + x2 * t12 + x3 * t13 + x5 * t15
        uy0 = y0 * t00 + y1 * t01 + y2 * t02 + y4 * t04 + y5 * t05
        uy1 = 1 + y0 * t10 + y1 * t11 + y2 * t12 + y4 * t14 + y5 * t15
        wx0, wx1, wy0, wy1 = w00 * ux0 + w01 * ux1, w01 * ux0 + w11 * ux1, w00 * uy0 + w01 * uy1, w01 * uy0 + w11 * uy1
        # A_k, the elements beside its diagonal with the opposite sign.
        a = 1 - x0 * p0 - x1 * p1 - x2 * p2 - x3 * p3 - x5 * p5 - ux0 * wx0 - ux1 * wx1
        b = x0 * q0 + x1 * q1 + x2 * q2 + x3 * q3 + x5 * q5 + ux0 * wy0 + ux1 * wy1
        c = 1 - y0 * q0 - y1 * q1 - y2 * q2 - y4 * q4 - y5 * q5 - uy0 * wy0 - uy1 * wy1
        determinant = a * c - b * b
        over, shown, own = 1 / determinant, determinant > SHOWN, number > k
        turned = _greater_eigenvalue(a, b, c, over, p0, p1, p2, q0, q1, q2)
        moved = _greater_eigenvalue(a, b, c, over, p3, p4, p5, q3, q4, q5)
        attitude = max(attitude, select(own, select(shown, turned, np.inf), 0.0))
        position = max(position, select(own, select(shown, moved, np.inf), 0.0))
    return np.sqrt(attitude), np.sqrt(position)
