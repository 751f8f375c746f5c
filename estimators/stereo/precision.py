"""Noise of a point from two toed-in cameras, in the plane of the baseline: source 2 (16) to (24).

Both cameras are turned towards each other by beta about the normal of the plane, a baseline b apart; X, Y, Z are in the
main camera's frame, camera 2 on its right (`estimators.stereo.triangulation.toed_in`). The figure that fixed the angles
is lost. With theta_1 counted from the main camera's axis **towards camera 2** and theta_2 from camera 2's axis
**towards camera 1**,

    tan theta_1 = x1 / f,    tan theta_2 = -x2 / f

(17) is the exact intersection in the plane, and (16) to (19) equal (7) for exact images (tested; with any other choice
of signs they do not):

    Z = A1 / B1,  A1 = b sin(beta) T + b cos(beta),  B1 = T + tan theta_1,  T = tan(theta_2 + 2 beta)      (16, 17)
    X = Z tan theta_1,   Y = Z y1 / f                                                                  (18, 19)

Its partial derivatives by x1, x2, y1 (20) to (22) and independent errors of one standard deviation sigma of each (23):

    dZ/dx1 = -Z / (f B1)        dZ/dx2 = -(b sin(beta) - Z) (1 + T^2) cos^2 theta_2 / (f B1)
    sigma_W^2 = sigma^2 sum (dW/dx)^2,   W = X, Y, Z                                             (24)

Near the axis sigma_Z is about sqrt(2) Z^2 sigma / (f b): it falls with focal length and baseline, and grows with the
distance squared. Camera 2's y2 is not used here, so that Y is up to sqrt(2) worse than (7) makes it.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats


class PlanePoint(NamedTuple):
    """A point and its derivatives. point_m: (..., 3), X, Y, Z [m]. slope: (..., 3, 3), by x1, y1, x2, each over f (20)
    to (22).
    """

    point_m: Floats
    slope: Floats

    def sigma_m(self, image_noise: float) -> Floats:
        """Return sigma_X, sigma_Y, sigma_Z (..., 3) [m] for independent errors of x/f and y/f (23, 24)."""
        out: Floats = image_noise * np.sqrt(np.sum(self.slope**2, axis=-1))
        return out


def plane_point(uv1: Floats, u2: Floats, baseline_m: float, toe_in_rad: float) -> PlanePoint:
    """Return the point (16) to (22); NaN where the rays do not meet in front.

    Args:
        uv1: (..., 2), (x1, y1) / f.
        u2: (...), x2 / f.
        baseline_m: b.
        toe_in_rad: beta.
    """
    u1, v1 = uv1[..., 0], uv1[..., 1]
    s, c, turn = baseline_m * np.sin(toe_in_rad), baseline_m * np.cos(toe_in_rad), np.tan(2 * toe_in_rad)
    # tan(theta_2 + 2 beta) with tan theta_2 = -u2.
    below = 1 + u2 * turn
    t = (turn - u2) / below
    a1, b1 = s * t + c, t + u1
    z = np.where((b1 > 0) & (below > 0), a1 / np.where(b1 > 0, b1, 1.0), np.nan)
    z = np.where(z > 0, z, np.nan)
    zero = np.zeros_like(z)
    # dT/du2 = -(1 + T^2) / (1 + u2^2), for theta_2 = -atan u2.
    dz = np.stack([-z / b1, zero, -(s - z) / b1 * (1 + t**2) / (1 + u2**2)], axis=-1)
    dx = u1[..., None] * dz + np.stack([z, zero, zero], axis=-1)
    dy = v1[..., None] * dz + np.stack([zero, z, zero], axis=-1)
    return PlanePoint(np.stack([z * u1, z * v1, z], axis=-1), np.stack([dx, dy, dz], axis=-2))
