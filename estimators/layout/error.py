"""Predicted error of poses measured by a set of photodiodes: source 1 (14) to (22) for many poses and choices.

At pose p photodiode k adds its two rows of J (14), derivatives of its angles by the pose error (attitude, position,
lighthouse frame, at rest), and they add up over the chosen ones that are lit:

    N = sum rows^T rows,   s_fan = sum of the fan's rows
    H = (1 - rho) N^-1 + rho sum_fan N^-1 s_fan s_fan^T N^-1                                                    (18)

The predicted error of the pose mixes attitude and position, each against what counts as an error of one, a and d:

    e^2 = (ADOP s / a)^2 + (PDOP s / d)^2,   s the angle noise                                                  (22)

With the rows' columns scaled by a / s and d / s, e^2 is the trace of H. A pose is solvable by a set if at least
`FEWEST_LIT` of it are lit and they determine the pose; otherwise its error counts as infinite.

Where the photodiode with rows J (2, 6) is lost, N and s lose its part. With A = N^-1, Z = A J^T and S = 1 - J Z,

    (N - J^T J)^-1 = A + Z S^-1 Z^T                                                     (Sherman-Morrison-Woodbury)

so the error without each photodiode takes two products of A with a vector; S is singular where it cannot be spared.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.pnp import FEWEST_LIT
from estimators.lighthouse.projection import checked, checked_lit
from estimators.linear import cholesky_into

WANTED_LIT = 6
"""Photodiodes that a pose should be seen by: two may be lost."""
LACKING = 0.02
"""In the search, a pose's error counts so much more for each photodiode that it lacks of the wanted ones."""
WORST = 1e3
"""Errors beyond so many times the wanted ones count as unsolvable."""
SPARED = 1e-10
"""Determinant of S below which the others determine no pose; rounding makes it about 1e-13."""


class Mix(NamedTuple):
    """The errors that count as one, attitude_rad and position_m, and the angle noise."""

    attitude_rad: float
    position_m: float
    angle_noise_rad: float
    rotor_correlation: float


class Sightings(NamedTuple):
    """Measurements of N candidates. row: (P, N, 2, 6), scaled rows of J, and lit: (P, N), at the poses where errors are
    predicted. reached: (Q, N), lit at more poses, by which the unsolvable ones are counted.
    """

    row: Floats
    lit: Bools
    reached: Bools
    rotor_correlation: float


def sightings(rotation: Floats, position: Floats, lit: Bools, point_m: Floats, mix: Mix, every: int = 1) -> Sightings:
    """Return what candidates measure at Q poses at rest.

    Args:
        rotation: (Q, 3, 3) R_l_b.
        position: (Q, 3) [m], lighthouse frame.
        lit: (Q, N), in the light of both fans.
        point_m: (N, 3) [m], candidates in the body frame.
        mix: the errors that count as one.
        every: errors are predicted at every n-th pose.

    Raises:
        ValueError: shapes do not fit `lit`.
    """
    reached = checked_lit(lit)
    poses, count = reached.shape
    rotation = checked("rotation", rotation, (poses, 3, 3))[::every]
    position = checked("position", position, (poses, 3))[::every]
    lit = np.ascontiguousarray(reached[::every])
    arm = np.einsum("pij,nj->pni", rotation, checked("point_m", point_m, (count, 3)))
    p = arm + position[:, None]
    row = np.zeros((len(lit), count, 2, 6))
    for fan in range(2):
        # theta = arccot(x / z): (13) times (10), and its moment about the craft's origin for the attitude (8).
        gradient = np.zeros_like(p)
        square = p[..., fan] ** 2 + p[..., 2] ** 2
        gradient[..., fan], gradient[..., 2] = -p[..., 2] / square, p[..., fan] / square
        row[:, :, fan, :3] = np.cross(arm, gradient) * (mix.attitude_rad / mix.angle_noise_rad)
        row[:, :, fan, 3:] = gradient * (mix.position_m / mix.angle_noise_rad)
    row[~lit] = 0.0
    return Sightings(row, lit, reached, mix.rotor_correlation)


@kernel
def mixed_error(normal: Floats, fan_sum: Floats, rho: float, lower: Floats, inverse: Floats) -> float:
    """Return e, inf where N is singular.

    tr N^-1 = |L^-1|^2 and |N^-1 s|^2 = |L^-T L^-1 s|^2 with N = L L^T.

    Args:
        normal: (6, 6), N.
        fan_sum: (2, 6), s.
        rho: of (19).
        lower: (6, 6), workspace.
        inverse: (6, 6), workspace.
    """
    if not cholesky_into(normal, lower):
        return np.inf
    own = 0.0
    for j in range(6):
        inverse[j, j] = 1 / lower[j, j]
        own += inverse[j, j] ** 2
        for i in range(j + 1, 6):
            value = 0.0
            for k in range(j, i):
                value -= lower[i, k] * inverse[k, j]
            inverse[i, j] = value / lower[i, i]
            own += inverse[i, j] ** 2
    shared = 0.0
    for fan in range(2):
        for i in range(6):
            value = 0.0
            for k in range(i, 6):
                part = 0.0
                for j in range(k + 1):
                    part += inverse[k, j] * fan_sum[fan, j]
                value += inverse[k, i] * part
            shared += value * value
    return float(np.sqrt((1 - rho) * own + rho * shared))


@kernel
def fan_means(inverse: Floats, fan_sum: Floats, fan_mean: Floats) -> float:
    """Write N^-1 s of both fans, and return tr N^-1.

    Args:
        inverse: (6, 6), L^-1 with N = L L^T.
        fan_sum: (2, 6), s.
        fan_mean: (2, 6), receives N^-1 s.
    """
    own = 0.0
    for i in range(6):
        for j in range(i + 1):
            own += inverse[i, j] ** 2
    for fan in range(2):
        _solve_into(inverse, fan_sum[fan], fan_mean[fan])
    return own


@kernel
def _solve_into(inverse: Floats, right: Floats, out: Floats) -> None:
    """Write N^-1 r = L^-T L^-1 r into `out` (6,)."""
    for i in range(6):
        out[i] = 0.0
    for k in range(6):
        part = 0.0
        for j in range(k + 1):
            part += inverse[k, j] * right[j]
        for i in range(k + 1):
            out[i] += inverse[k, i] * part


@kernel
def lost_error(inverse: Floats, fan_mean: Floats, own: float, row: Floats, rho: float, z: Floats) -> float:
    """Return the error e without one photodiode, inf where the others determine no pose.

    Args:
        inverse: (6, 6), L^-1 with N = L L^T, as `mixed_error` leaves it.
        fan_mean: (2, 6), N^-1 s.
        own: trace of N^-1.
        row: (2, 6), the photodiode's rows.
        rho: of (19).
        z: (2, 6), workspace, receives Z^T.
    """
    xx, xy, yy, zxx, zxy, zyy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for fan in range(2):
        _solve_into(inverse, row[fan], z[fan])
    for i in range(6):
        xx += row[0, i] * z[0, i]
        xy += row[0, i] * z[1, i]
        yy += row[1, i] * z[1, i]
        zxx += z[0, i] * z[0, i]
        zxy += z[0, i] * z[1, i]
        zyy += z[1, i] * z[1, i]
    determinant = (1 - xx) * (1 - yy) - xy * xy
    if determinant < SPARED:
        return np.inf
    # S^-1 of the symmetric S, (2, 2).
    a, b, c = (1 - yy) / determinant, xy / determinant, (1 - xx) / determinant
    trace = own + a * zxx + 2 * b * zxy + c * zyy
    shared = 0.0
    for fan in range(2):
        # J N^-1 (s - its own row), then N'^-1 (s - its own row).
        x, y = (-xx, -xy) if fan == 0 else (-xy, -yy)
        for i in range(6):
            x += row[0, i] * fan_mean[fan, i]
            y += row[1, i] * fan_mean[fan, i]
        p, q = a * x + b * y, b * x + c * y
        for i in range(6):
            shared += (fan_mean[fan, i] - z[fan, i] + p * z[0, i] + q * z[1, i]) ** 2
    return float(np.sqrt((1 - rho) * trace + rho * shared))


@kernel
def worst_loss(
    row: Floats, lit: Bools, chosen: Ints, without: int, fan_sum: Floats, inverse: Floats, rho: float, space: Floats
) -> tuple[float, float]:
    """Return the error e of one pose without the chosen photodiode that is missed most, and `fan_means` of all.

    Args:
        row: (N, 2, 6), the pose's rows.
        lit: (N,).
        chosen: (n,), indices of candidates.
        without: slot of `chosen` that is left out; -1: none.
        fan_sum: (2, 6), s of all that count.
        inverse: (6, 6), L^-1, as `mixed_error` leaves it.
        rho: of (19).
        space: (2, 2, 6), workspace; space[0] receives what `fan_means` writes.
    """
    own, worst = fan_means(inverse, fan_sum, space[0]), 0.0
    for slot in range(len(chosen)):
        k = chosen[slot]
        if slot != without and lit[k]:
            worst = max(worst, lost_error(inverse, space[0], own, row[k], rho, space[1]))
    return worst, own


@kernel
def _lost_errors_into(row: Floats, lit: Bools, chosen: Ints, rho: float, out: Floats) -> None:
    poses = len(lit)
    normal, fan_sum, seen = np.empty((poses, 6, 6)), np.empty((poses, 2, 6)), np.empty(poses, dtype=np.int64)
    add_up(row, lit, chosen, -1, normal, fan_sum, seen)
    lower, inverse = np.zeros((6, 6)), np.zeros((6, 6))
    space = np.empty((2, 2, 6))
    for p in range(poses):
        out[p] = np.inf
        if seen[p] <= FEWEST_LIT or not mixed_error(normal[p], fan_sum[p], rho, lower, inverse) < np.inf:
            continue
        worst, _ = worst_loss(row[p], lit[p], chosen, -1, fan_sum[p], inverse, rho, space)
        if worst < WORST:
            out[p] = worst


def lost_errors(candidates: Sightings, chosen: Ints) -> Floats:
    """Return the predicted error e (P,) of the chosen candidates (n,) without the lit one that is missed most.

    It is inf at the poses that are not solvable without each of them.
    """
    out = np.empty(len(candidates.lit))
    chosen = np.ascontiguousarray(chosen, dtype=np.int64)
    _lost_errors_into(candidates.row, candidates.lit, chosen, candidates.rotor_correlation, out)
    return out


@kernel
def add_up(row: Floats, lit: Bools, chosen: Ints, without: int, normal: Floats, fan_sum: Floats, seen: Ints) -> None:
    """Write the sums over the chosen candidates that are lit.

    Args:
        row: (P, N, 2, 6), of `Sightings`.
        lit: (P, N).
        chosen: (n,), indices of candidates.
        without: slot of `chosen` that is left out; -1: none.
        normal: (P, 6, 6), receives N.
        fan_sum: (P, 2, 6), receives s.
        seen: (P,), receives the number lit.
    """
    normal[:], fan_sum[:], seen[:] = 0.0, 0.0, 0
    for p in range(lit.shape[0]):
        for slot in range(len(chosen)):
            k = chosen[slot]
            if slot == without or not lit[p, k]:
                continue
            seen[p] += 1
            for fan in range(2):
                for a in range(6):
                    fan_sum[p, fan, a] += row[p, k, fan, a]
                    for b in range(6):
                        normal[p, a, b] += row[p, k, fan, a] * row[p, k, fan, b]


@kernel
def _errors_into(normal: Floats, fan_sum: Floats, seen: Ints, rho: float, out: Floats) -> None:
    lower, inverse = np.zeros((6, 6)), np.zeros((6, 6))
    for p in range(len(seen)):
        out[p] = np.inf
        if seen[p] >= FEWEST_LIT:
            e = mixed_error(normal[p], fan_sum[p], rho, lower, inverse)
            if e < WORST:
                out[p] = e


def mixed_errors(candidates: Sightings, chosen: Ints) -> Floats:
    """Return the predicted error e (P,) at every pose with the chosen candidates (n,); inf where not solvable."""
    poses = len(candidates.lit)
    normal, fan_sum, seen = np.empty((poses, 6, 6)), np.empty((poses, 2, 6)), np.empty(poses, dtype=np.int64)
    chosen = np.ascontiguousarray(chosen, dtype=np.int64)
    add_up(candidates.row, candidates.lit, chosen, -1, normal, fan_sum, seen)
    out = np.empty(poses)
    _errors_into(normal, fan_sum, seen, candidates.rotor_correlation, out)
    return out


def percentile(error: Floats, share: float) -> float:
    """Return the smallest error that at least this share of the poses (P,) does not exceed; inf counts."""
    rank = int(np.ceil(share * len(error) - 1e-9)) - 1
    return float(np.sort(error)[max(rank, 0)])
