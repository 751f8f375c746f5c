"""Dilution of precision of a pinhole camera: source 1's (18) and (22) with the image noise in place of the angle noise.

A camera at the origin that looks along +z measures u = x/z and v = y/z, each pixel coordinate over the focal length, of
markers p_i = R w_p_i + t (3). Its noise is equal and independent in the image: (13) falls away, R_theta = I, and

    H = (J^T J)^-1,   J = (10)(8),   ADOP = (180/pi) sqrt tr H_attitude,   PDOP = sqrt tr H_position       (18, 22)

are per unit of image noise, pixels over the focal length. Errors are as in `estimators.dop`: R_true = Exp([d]x) R.
"""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.projection import checked, checked_lit
from estimators.rotation import skew


def image_jacobian(rotation: Floats, position: Floats, point_m: Floats) -> Floats:
    """Derivatives (C, K, 2, 6) of (u, v) by the pose error (attitude [rad], position [m]) (8, 10).

    rotation: (C, 3, 3) R_l_b. position: (C, 3) [m]. point_m: (C, K, 3) [m], markers in the body frame.
    """
    arm = np.einsum("cij,ckj->cki", rotation, point_m)
    p = arm + position[:, None]
    z = p[..., 2]
    projection = np.zeros((*z.shape, 2, 3))
    projection[..., 0, 0] = projection[..., 1, 1] = 1 / z
    projection[..., :, 2] = -p[..., :2] / z[..., None] ** 2
    return np.concatenate([projection @ -skew(arm), projection], axis=-1)


def image_dilution(rotation: Floats, position: Floats, lit: Bools, point_m: Floats) -> tuple[Floats, Floats]:
    """ADOP [deg] and PDOP [m], (C,) each, per unit of image noise; NaN where the markers do not determine a pose.

    Args:
        rotation: (C, 3, 3) R_l_b.
        position: (C, 3) [m], camera frame.
        lit: (C, K), the markers that are seen.
        point_m: (C, K, 3) [m], markers in the body frame.

    Raises:
        ValueError: an array's shape does not fit `lit`; the message names the argument.
    """
    lit = checked_lit(lit)
    craft, markers = lit.shape
    rotation = checked("rotation", rotation, (craft, 3, 3))
    position = checked("position", position, (craft, 3))
    rows = image_jacobian(rotation, position, checked("point_m", point_m, (craft, markers, 3)))
    rows = (rows * lit[:, :, None, None]).reshape(craft, -1, 6)
    normal = np.swapaxes(rows, -1, -2) @ rows
    finite: Bools = np.all(np.isfinite(normal), axis=(1, 2))
    rank = np.linalg.matrix_rank(np.where(finite[:, None, None], normal, 0.0), hermitian=True)
    determined = finite & (rank == 6)
    adop, pdop = np.full(craft, np.nan), np.full(craft, np.nan)
    variance = np.diagonal(np.linalg.inv(normal[determined]), axis1=-2, axis2=-1)
    adop[determined] = np.rad2deg(np.sqrt(variance[:, :3].sum(axis=-1)))
    pdop[determined] = np.sqrt(variance[:, 3:].sum(axis=-1))
    return adop, pdop
