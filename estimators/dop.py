"""Dilution of precision: how angle noise, and wrong assumed motion, become pose error; source 1 (13) to (22).

With the rows of J = J(theta, f) J(f, psi), each angle's derivative by the pose error, R_true = Exp([d]x) R_est,
p_true = p_est + dp, in the lighthouse frame and ordered (attitude d [rad], position dp [m]),

    H = (J^T J)^-1 J^T R_theta J (J^T J)^-1,   Cov = H s^2                                (18)

    J^T R_theta J = (1 - rho) J^T J + rho sum_fan s_fan s_fan^T,   s_fan = sum of the fan's rows

because R_theta (19) is 1 on its diagonal and rho between angles of one fan. The sign of (13) cancels in H. Source 1
states the attitude in its passive vector phi and maps it by J_r(phi) (21) before it takes the trace (22); the rows
here are derivatives by the rotation error d = -J_r dphi itself, so J_r is absorbed and ADOP is a plain trace (tested
against the paper's form).

A camera measures x/z and y/z themselves: J(theta, f), minus sin^2 theta, is then replaced by the image noise's own
Jacobian, the weight 1 of an image coordinate whose noise is the unit (`image_dilution`); rho is zero.

An error of the motion assumed within the period moves the angle of instant tau by tau times its row, so that the solved
pose errs, to first order, by B times the error of the rates:

    B = (J^T J)^-1 sum tau_i J_i^T J_i
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from estimators.linear import invert_spd_into
from estimators.projection import arm_into, checked, checked_lit, project_into, spans_plane, turns_into


class Dilution(NamedTuple):
    """For C craft; NaN where not computed.

    covariance: (C, 6, 6) H of (18) for unit angle noise, (attitude, position), lighthouse frame, left-active error.
    adop_deg_per_rad, pdop_m_per_rad: (C,), (22). rate_coupling: (C, 6, 6) [s], B of
    pose_solved - pose_true = B (rates_true - rates_assumed) + noise, rates (angular rate, velocity).
    """

    covariance: Floats
    adop_deg_per_rad: Floats
    pdop_m_per_rad: Floats
    rate_coupling: Floats


@kernel
def _dilution_all(
    rotation: Floats,
    position: Floats,
    lit: Bools,
    point: Floats,
    offset: Floats,
    angular_rate: Floats,
    velocity: Floats,
    weight: Floats,
    rho: float,
    mask: Bools,
    covariance: Floats,
    coupling: Floats,
) -> None:
    """(13) to (18) for every craft; leaves the outputs alone where the pose is not determined.

    weight: (C, K, 2), inverse noise of each projection, or empty where the angles have equal noise.
    """
    angles = weight.size == 0
    turn = np.empty((lit.shape[1], 2, 3, 3))
    arm, row = np.empty(3), np.empty(6)
    normal, moved, inverse = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    fan_sum, spread = np.empty((2, 6)), np.empty((2, 6))
    for c in range(lit.shape[0]):
        if not (mask[c] and spans_plane(lit[c], point[c])):
            continue
        turns_into(offset[c], angular_rate[c], turn)
        normal[:], moved[:], fan_sum[:] = 0.0, 0.0, 0.0
        front = True
        for i in range(lit.shape[1]):
            if not lit[c, i]:
                continue
            arm_into(rotation[c], point[c, i], arm)
            for fan in range(2):
                tau = offset[c, i, fan]
                value, z = project_into(fan, arm, turn[i, fan], position[c], velocity[c], tau, row)
                front = front and z > 0
                slope = -1 / (1 + value * value) if angles else weight[c, i, fan]
                for a in range(6):
                    row[a] *= slope
                for a in range(6):
                    fan_sum[fan, a] += row[a]
                    for b in range(6):
                        normal[a, b] += row[a] * row[b]
                        moved[a, b] += tau * row[a] * row[b]
        if not (front and invert_spd_into(normal, inverse)):
            continue
        for fan in range(2):
            for a in range(6):
                spread[fan, a] = 0.0
                for b in range(6):
                    spread[fan, a] += inverse[a, b] * fan_sum[fan, b]
        for a in range(6):
            for b in range(6):
                shared = spread[0, a] * spread[0, b] + spread[1, a] * spread[1, b]
                covariance[c, a, b] = (1 - rho) * inverse[a, b] + rho * shared
                coupling[c, a, b] = 0.0
                for k in range(6):
                    coupling[c, a, b] += inverse[a, k] * moved[k, b]


def factors(covariance: Floats) -> tuple[Floats, Floats]:
    """(22): ADOP [deg/rad] and PDOP [m/rad], both (...), of pose covariances (..., 6, 6) for unit noise."""
    variance = np.diagonal(covariance, axis1=-2, axis2=-1)
    adop: Floats = np.rad2deg(np.sqrt(variance[..., :3].sum(axis=-1)))
    pdop: Floats = np.sqrt(variance[..., 3:].sum(axis=-1))
    return adop, pdop


def dilution(
    rotation: Floats,
    position: Floats,
    lit: Bools,
    point_m: Floats,
    offset_s: Floats,
    angular_rate: Floats,
    velocity: Floats,
    rotor_correlation: float,
    mask: Bools,
) -> Dilution:
    """H, ADOP, PDOP and the rate coupling B of C craft at their measured poses.

    Args:
        rotation: (C, 3, 3) R_l_b at the epoch.
        position: (C, 3) [m], lighthouse frame.
        lit: (C, K), both fans seen.
        point_m: (C, K, 3) [m], photodiodes in the body frame.
        offset_s: (C, K, 2) [s], each angle's instant minus the epoch.
        angular_rate: (C, 3) [rad/s], assumed within the period, lighthouse frame.
        velocity: (C, 3) [m/s], likewise.
        rotor_correlation: rho of (19), in [0, 1].
        mask: (C,), the craft to compute; the others, and those whose lit photodiodes do not determine a pose, are NaN.

    Raises:
        ValueError: an array's shape does not fit `lit`, or rho is outside [0, 1]; the message names the argument.
    """
    if not 0 <= rotor_correlation <= 1:
        raise ValueError(f"rotor_correlation is {rotor_correlation}, outside [0, 1]")
    motion = offset_s, angular_rate, velocity
    return _checked_dilution(rotation, position, lit, point_m, motion, None, float(rotor_correlation), mask)


def image_dilution(
    rotation: Floats,
    position: Floats,
    seen: Bools,
    point_m: Floats,
    weight: Floats,
    offset_s: Floats,
    velocity: Floats,
    mask: Bools,
) -> Dilution:
    """H, ADOP and PDOP of C poses from image coordinates u = x/f, v = y/f, for unit noise of u and v.

    weight: (C, K, 2), inverse noise of each coordinate, as in `refine_projections`; the rest as in `dilution`.
    """
    still = np.zeros((len(seen), 3))
    return _checked_dilution(rotation, position, seen, point_m, (offset_s, still, velocity), weight, 0.0, mask)


def _checked_dilution(
    rotation: Floats,
    position: Floats,
    lit: Bools,
    point_m: Floats,
    motion: tuple[Floats, Floats, Floats],
    weight: Floats | None,
    rho: float,
    mask: Bools,
) -> Dilution:
    """Check the shapes and run the kernel; motion: offset_s, angular_rate, velocity; weight None: angles."""
    lit = checked_lit(lit)
    craft, photodiodes = lit.shape
    mask = np.ascontiguousarray(mask, dtype=np.bool_)
    if mask.shape != (craft,):
        raise ValueError(f"mask has shape {mask.shape}, expected {(craft,)}")
    offset_s, angular_rate, velocity = motion
    covariance, coupling = np.full((2, craft, 6, 6), np.nan)
    _dilution_all(
        checked("rotation", rotation, (craft, 3, 3)),
        checked("position", position, (craft, 3)),
        lit,
        checked("point_m", point_m, (craft, photodiodes, 3)),
        checked("offset_s", offset_s, (craft, photodiodes, 2)),
        checked("angular_rate", angular_rate, (craft, 3)),
        checked("velocity", velocity, (craft, 3)),
        np.empty((0, 0, 2)) if weight is None else checked("weight", weight, (craft, photodiodes, 2)),
        rho,
        mask,
        covariance,
        coupling,
    )
    return Dilution(covariance, *factors(covariance), coupling)
