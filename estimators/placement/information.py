"""Information about a craft's pose in one period's sweeps of a station: the rows of `rows`, rotor error marginalised.

At a pose at rest the row of fan f and photodiode k is J = (attitude, position) of H (`estimators.lighthouse.rows`),
world frame. The n rows of one sweep share the rotor's error, one draw per station, fan and sweep, so that

    I = sum_f [J^T J - k (J^T 1)(J^T 1)^T] / a^2,   k = b^2 / (a^2 + n b^2)             (Sherman and Morrison, as (19))

and stations add up: their rotors have nothing in common. With attitude counted in units of A and position in units of
D, the error of a pose that S measures together is e, e^2 = tr (sum_s I_s)^-1.
"""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.projection import checked, checked_lit
from estimators.lighthouse.rows import Station, row_into
from estimators.lighthouse.sweep import kernel_fans
from estimators.state import STATES

POSE = 6
"""Numbers of a pose: attitude, position."""


def information(
    station: Station,
    rotation: Floats,
    position: Floats,
    lit: Bools,
    point_m: Floats,
    noise: AngleNoise,
    unit: tuple[float, float] = (1.0, 1.0),
) -> Floats:
    """Return the information (P, 6, 6) that one period's sweeps of a station hold about each of P poses at rest.

    Args:
        station: the station.
        rotation: (P, 3, 3) R_w_b.
        position: (P, 3) [m], world frame.
        lit: (P, K), photodiodes that the station's light reaches; those behind the station add nothing.
        point_m: (K, 3) [m], photodiodes in the body frame.
        noise: noise of the rows; own_rad above zero.
        unit: errors that count as one, attitude [rad] and position [m].

    Raises:
        ValueError: a shape does not fit `lit`, or the photodiodes have no noise of their own.
    """
    lit = checked_lit(lit)
    poses, photodiodes = lit.shape
    if not noise.own_rad > 0:
        raise ValueError("without noise of their own, the photodiodes of a sweep measure their differences perfectly")
    out = np.zeros((poses, POSE, POSE))
    _information_into(
        np.ascontiguousarray(station.rotation, dtype=np.float64),
        np.ascontiguousarray(station.position, dtype=np.float64),
        kernel_fans(station.fans),
        checked("rotation", rotation, (poses, 3, 3)),
        checked("position", position, (poses, 3)),
        lit,
        checked("point_m", point_m, (photodiodes, 3)),
        float(noise.own_rad),
        float(noise.shared_rad),
        out,
    )
    scale = np.repeat(np.array(unit, dtype=np.float64), 3)
    return out * np.outer(scale, scale)


@kernel
def _information_into(
    station_rotation: Floats,
    station_position: Floats,
    fans: Floats,
    rotation: Floats,
    position: Floats,
    lit: Bools,
    point: Floats,
    own: float,
    shared: float,
    out: Floats,
) -> None:
    """Add the information to `out` (P, 6, 6)."""
    row, total, rest = np.empty(STATES), np.empty(POSE), np.zeros(3)
    variance = own * own
    for p in range(lit.shape[0]):
        for fan in range(len(fans)):
            n = 0
            total[:] = 0.0
            for k in range(lit.shape[1]):
                if not lit[p, k]:
                    continue
                residual = row_into(
                    0.0,
                    0.0,
                    station_rotation,
                    station_position,
                    fans[fan],
                    point[k],
                    rotation[p],
                    position[p],
                    rest,
                    rest,
                    row,
                )
                if np.isnan(residual):
                    continue
                n += 1
                for i in range(3):
                    row[3 + i] = row[6 + i]
                for i in range(POSE):
                    total[i] += row[i]
                    for j in range(POSE):
                        out[p, i, j] += row[i] * row[j] / variance
            common = shared * shared / (variance + n * shared * shared) / variance
            for i in range(POSE):
                for j in range(POSE):
                    out[p, i, j] -= common * total[i] * total[j]
