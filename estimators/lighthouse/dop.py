"""Dilution of precision, the pose error from angle noise and wrongly assumed motion; source 1 (13) to (22).

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

With a pose that is solved from angles (`pnp.refine_with_dilution`), J is that of its last step: at a pose that this
step, 1e-5 or less after a warm start, leads to the answer, and with (13) at the measured angles, as the solver's
weights have it. `dilution` takes J at the poses that it is given.

What one false photodiode can do to the pose without being noticed is `estimators.lighthouse.slope`'s, from the same
rows.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import inlined, kernel
from estimators.lanes import LANES, WIDE, all_of, select, wide_in
from estimators.lighthouse.projection import (
    TAU,
    WEIGHT,
    checked,
    checked_lit,
    project_all,
    row_of,
    table_spans_plane,
    turned_by,
    write_row,
)
from estimators.lighthouse.side_by_side import (
    Given,
    Room,
    gather_craft,
    gather_weights_lanes,
    given,
    in_order,
    room_for,
    scatter_four,
    scatter_matrices,
    taken,
)
from estimators.lighthouse.slope import worst_slopes
from estimators.linear import invert_symmetric
from estimators.scratch import scratch

DEGREES = 180 / np.pi
"""Of a radian."""


class Dilution(NamedTuple):
    """Precision of C craft; NaN where not computed.

    covariance: (C, 6, 6) H of (18) for unit angle noise, (attitude, position), lighthouse frame, left-active error.
    adop_deg_per_rad, pdop_m_per_rad: (C,), (22). rate_coupling: (C, 6, 6) [s], B of pose_solved - pose_true = B
    (rates_true - rates_assumed) + noise, rates (angular rate, velocity). attitude_slope_deg_per_rad,
    position_slope_m_per_rad: (C,), of `estimators.lighthouse.slope`; infinite where the fault of some photodiode would
    not show at all.
    """

    covariance: Floats
    adop_deg_per_rad: Floats
    pdop_m_per_rad: Floats
    rate_coupling: Floats
    attitude_slope_deg_per_rad: Floats
    position_slope_m_per_rad: Floats


@kernel
def rows_at(table: Floats, n: int, rotation: Floats, position: Floats, angles: bool) -> bool:
    """Write J at a pose into the table, of numbers or of lanes; return False where a photodiode is behind.

    Args:
        table: (2 n, COLUMNS), angles; receives J.
        n: rows of each fan.
        rotation: (3, 3).
        position: (3,) [m].
        angles: of equal noise; else the table's weights stand for (13), which otherwise are 1, or 0 of rows that do not
            count.
    """
    front = project_all(table, n, rotation, position)
    for i in range(2 * n):
        x, y, z, over, value = row_of(table, i)
        r0, r1, r2 = turned_by(table, i, x, y, z, value)
        g = table[i, WEIGHT] * over
        if angles:
            g = g / (1 + value * value)
        write_row(table, i, g * r0, g * r1, g * r2, g, -value * g)
    return front


@kernel
def _sums_into(table: Floats, n: int, normal: Floats, moved: Floats, fan_sum: Floats) -> None:
    """Write the lower triangles of J^T J and sum tau J^T J (6, 6), and the fans' sums of rows (2, 6), of one craft, of
    numbers or of lanes.

    A row has no derivative by the other fan's coordinate: it is not added up. Columns 0 to 2 are the attitude, p the
    fan's own coordinate, z the third one; sums named n belong to J^T J, m to the moved ones, s to the fan's rows.
    """
    # In registers, not in the matrices: a sum in memory waits for the one before.
    n00 = n10 = n11 = n20 = n21 = n22 = nz0 = nz1 = nz2 = nzz = 0.0
    m00 = m10 = m11 = m20 = m21 = m22 = mz0 = mz1 = mz2 = mzz = 0.0
    for fan in range(2):
        s0 = s1 = s2 = sp = sz = 0.0
        np0 = np1 = np2 = npp = nzp = mp0 = mp1 = mp2 = mpp = mzp = 0.0
        for i in range(fan * n, fan * n + n):
            a0, a1, a2, ap, az = row_of(table, i)
            s0, s1, s2, sp, sz = s0 + a0, s1 + a1, s2 + a2, sp + ap, sz + az
            n00 += a0 * a0
            n10 += a1 * a0
            n11 += a1 * a1
            n20 += a2 * a0
            n21 += a2 * a1
            n22 += a2 * a2
            np0 += ap * a0
            np1 += ap * a1
            np2 += ap * a2
            npp += ap * ap
            nz0 += az * a0
            nz1 += az * a1
            nz2 += az * a2
            nzp += az * ap
            nzz += az * az
        for i in range(fan * n, fan * n + n):
            a0, a1, a2, ap, az = row_of(table, i)
            tau = table[i, TAU]
            t0, t1, t2, tp, tz = tau * a0, tau * a1, tau * a2, tau * ap, tau * az
            m00 += t0 * a0
            m10 += t1 * a0
            m11 += t1 * a1
            m20 += t2 * a0
            m21 += t2 * a1
            m22 += t2 * a2
            mp0 += tp * a0
            mp1 += tp * a1
            mp2 += tp * a2
            mpp += tp * ap
            mz0 += tz * a0
            mz1 += tz * a1
            mz2 += tz * a2
            mzp += tz * ap
            mzz += tz * az
        place = 3 + fan
        fan_sum[fan, 0], fan_sum[fan, 1], fan_sum[fan, 2] = s0, s1, s2
        fan_sum[fan, 3], fan_sum[fan, 4], fan_sum[fan, 5] = 0.0, 0.0, sz
        fan_sum[fan, place] = sp
        normal[place, 0], normal[place, 1], normal[place, 2] = np0, np1, np2
        normal[place, place], normal[5, place] = npp, nzp
        moved[place, 0], moved[place, 1], moved[place, 2] = mp0, mp1, mp2
        moved[place, place], moved[5, place] = mpp, mzp
    normal[0, 0], normal[1, 0], normal[1, 1] = n00, n10, n11
    normal[2, 0], normal[2, 1], normal[2, 2] = n20, n21, n22
    normal[4, 3] = 0.0
    normal[5, 0], normal[5, 1], normal[5, 2], normal[5, 5] = nz0, nz1, nz2, nzz
    moved[0, 0], moved[1, 0], moved[1, 1] = m00, m10, m11
    moved[2, 0], moved[2, 1], moved[2, 2] = m20, m21, m22
    moved[4, 3] = 0.0
    moved[5, 0], moved[5, 1], moved[5, 2], moved[5, 5] = mz0, mz1, mz2, mzz


@kernel
def dilution_one(
    table: Floats,
    n: int,
    number: float,
    rho: float,
    covariance: Floats,
    coupling: Floats,
) -> tuple[bool, float, float]:
    """Compute (13) to (18) of one craft, of numbers or of lanes; return whether the pose is determined, and the slopes.

    Args:
        table: (., COLUMNS), angles, with J.
        n: rows of each fan.
        number: number of photodiodes; rows after them are zero.
        rho: of (19).
        covariance: (6, 6), receives H.
        coupling: (6, 6), receives B.
    """
    normal, moved, inverse = scratch(table, 6, 6), scratch(table, 6, 6), scratch(table, 6, 6)
    fan_sum, spread = scratch(table, 2, 6), scratch(table, 2, 6)
    _sums_into(table, n, normal, moved, fan_sum)
    determined = invert_symmetric(normal, scratch(table, 6), inverse)
    for a in range(6):
        for b in range(a):
            moved[b, a] = moved[a, b]
    for fan in range(2):
        for a in range(6):
            value = 0.0
            for b in range(6):
                value += inverse[a, b] * fan_sum[fan, b]
            spread[fan, a] = value
    for a in range(6):
        for b in range(6):
            shared = spread[0, a] * spread[0, b] + spread[1, a] * spread[1, b]
            covariance[a, b] = (1 - rho) * inverse[a, b] + rho * shared
            value = 0.0
            for k in range(6):
                value += inverse[a, k] * moved[k, b]
            coupling[a, b] = value
    attitude_slope, position_slope = worst_slopes(table, n, number, inverse, fan_sum, spread, rho)
    return determined, attitude_slope, position_slope


class Places(NamedTuple):
    """Places for the precision of C craft.

    covariance, coupling: (C, 9, 4), the numbers of H and B. factors: (C, 1, 4), ADOP [deg/rad], PDOP [m/rad] and the
    two slopes [deg/rad], [m/rad].
    """

    covariance: Floats
    coupling: Floats
    factors: Floats

    def found(self) -> Dilution:
        """Return what has been written."""
        craft = len(self.factors)
        adop, pdop, turned, moved = np.ascontiguousarray(self.factors[:, 0].T)
        covariance, coupling = (part.reshape(craft, 6, 6) for part in self[:2])
        return Dilution(covariance, adop, pdop, coupling, turned, moved)


def places_for(craft: int) -> Places:
    """Return places for so many craft."""
    matrices = np.empty((2, craft, 9, LANES))
    return Places(matrices[0], matrices[1], np.empty((craft, 1, LANES)))


@inlined
def precision_into(who: Ints, table: Floats, n: int, number: float, rho: float, among: bool, places: Places) -> None:
    """Write the precision of craft side by side, NaN where the pose is not determined.

    Args:
        who: (WIDE,), the craft; one that is there twice has the same in both lanes.
        table: (., COLUMNS), angles, with J.
        n: rows of each fan.
        number: number of photodiodes.
        rho: of (19).
        among: the lanes of craft that have a pose.
        places: receives it.
    """
    both, factors = scratch(table, 2, 6, 6), scratch(table, 4)
    determined, turned, moved = dilution_one(table, n, number, rho, both[0], both[1])
    determined = determined & among
    h = both[0]
    factors[0] = DEGREES * np.sqrt(h[0, 0] + h[1, 1] + h[2, 2])
    factors[1] = np.sqrt(h[3, 3] + h[4, 4] + h[5, 5])
    factors[2], factors[3] = DEGREES * turned, moved
    if not all_of(determined):
        for k in range(4):
            factors[k] = select(determined, factors[k], np.nan)
        for a in range(6):
            for b in range(6):
                both[0, a, b] = select(determined, both[0, a, b], np.nan)
                both[1, a, b] = select(determined, both[1, a, b], np.nan)
    scatter_four(factors, who, 0, places.factors)
    scatter_matrices(both[0], who, places.covariance)
    scatter_matrices(both[1], who, places.coupling)


@kernel
def no_precision(c: int, places: Places) -> None:
    """Write NaN for craft c."""
    for i in range(LANES):
        places.factors[c, 0, i] = np.nan
        for k in range(9):
            places.covariance[c, k, i] = places.coupling[c, k, i] = np.nan


@kernel
def _dilution_all(of: Given, weight: Floats, rho: float, mask: Bools, room: Room, places: Places) -> None:
    """Compute (13) to (18) and (22) for every craft; NaN where the pose is not determined.

    weight: (C K, 2), inverse noise of each projection, or empty where the angles have equal noise.
    """
    many, count, order, table = in_order(of.lit, mask, 1, room), room.counts, room.order, wide_in(room.table)
    turn, place, angles = scratch(table, 3, 3), scratch(table, 3), weight.size == 0
    for c in range(len(mask)):
        if not mask[c] or count[c, 0] == 0:
            no_precision(c, places)
    for first in range(0, many, WIDE):
        who = order[first : first + WIDE]
        n, number = count[who[WIDE - 1], 0], taken(table[0, 0], count, who, 0)
        gather_craft(who, n, of, room, turn, place)
        gather_weights_lanes(room.seen, n, number, angles, weight, table)
        among = table_spans_plane(table, n) & rows_at(table, n, turn, place, angles)
        precision_into(who, table, n, number, rho, among, places)


def factors(covariance: Floats) -> tuple[Floats, Floats]:
    """Return ADOP [deg/rad] and PDOP [m/rad] (22), both (...), of pose covariances (..., 6, 6) for unit noise."""
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
    """Return H, ADOP, PDOP, the rate coupling B and the slopes of C craft at their measured poses.

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
    motion = offset_s, angular_rate, velocity
    return _checked_dilution(
        rotation, position, lit, point_m, motion, None, checked_correlation(rotor_correlation), mask
    )


def checked_correlation(rotor_correlation: float) -> float:
    """Return rho of (19); raise ValueError where it is outside [0, 1]."""
    if not 0 <= rotor_correlation <= 1:
        raise ValueError(f"rotor_correlation is {rotor_correlation}, outside [0, 1]")
    return float(rotor_correlation)


def unknown(craft: int) -> Dilution:
    """Return no precision of any of C craft."""
    matrices, factors = np.full((2, craft, 6, 6), np.nan), np.full((4, craft), np.nan)
    return Dilution(matrices[0], factors[0], factors[1], matrices[1], factors[2], factors[3])


def overwrite(known: Dilution, mask: Bools, other: Dilution | None) -> None:
    """Put other values in the place of the precision of some craft.

    Args:
        known: of all craft, changed in place.
        mask: (C,), craft whose precision is replaced.
        other: of all craft; None: NaN.
    """
    who = np.flatnonzero(mask)
    if len(who):
        for k, part in enumerate(known):
            part[who] = np.nan if other is None else other[k][who]


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
    """Return H, ADOP and PDOP of C poses from image coordinates u = x/f, v = y/f, for unit noise of u and v.

    Args:
        rotation: (C, 3, 3).
        position: (C, 3) [m].
        seen: (C, K).
        point_m: (C, K, 3) [m].
        weight: (C, K, 2), inverse noise of each coordinate, as in `refine_projections`.
        offset_s: (C, K, 2) [s].
        velocity: (C, 3) [m/s].
        mask: (C,), the poses to compute.

    Raises:
        ValueError: as `dilution`.
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
    places = places_for(craft)
    _dilution_all(
        given(lit, rotation, position, point_m, offset_s, angular_rate, velocity),
        np.empty((0, 2)) if weight is None else checked("weight", weight, (craft, photodiodes, 2)).reshape(-1, 2),
        rho,
        mask,
        room_for(craft, photodiodes),
        places,
    )
    return places.found()
