"""Consistency of redundant sweep angles: the chi-square test of the residuals, and the search for the false photodiode.

n lit photodiodes give 2 n angles for the 6 unknowns of a pose. With the rows J of the angles at the least squares
solution and M = I - J (J^T J)^-1 J^T, the residuals are r = M e of the angle errors e, which are

    e = own + V c,   own ~ N(0, a^2 I),   c ~ N(0, C)

V has a column of ones per fan, the rotor's part common to a sweep (19), C = b^2, and six columns tau_i J_i, the error
of the rates that were assumed within the period, C their covariance. With U = M V and Cov(r) = a^2 M + U C U^T, by
Woodbury's identity,

    T = r^T Cov(r)^+ r = (r^T r - g^T (a^2 C^-1 + U^T U)^-1 g) / a^2,   g = V^T r

is chi-square with 2 n - 6 degrees of freedom as long as no photodiode lies. T <= r^T r / a^2, the cost of PnP, which
alone lets nearly every honest pose pass: T itself is computed only for the rest.

A pose that fails is searched for a few photodiodes without which the others agree (Parkinson and Axelrad, Navigation
35, 1988, for satellites): every n - 1, and of those that pass the ones of least T; then the n - 2, n - 3 ... that lie
nearest to where the start pose, a prediction, has them, but for a shift of all; then every n - 2, n - 3 ... Each is
solved anew. At least five must remain, so that what remains can still be tested: six or more lit find and drop the
false one, five or four only detect it.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtri, chndtr

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.pnp import PoseSolution, refine_projections
from estimators.lighthouse.projection import COLUMNS, TAU, angle_weights, checked, gather, project, projections

FEWEST_KEPT = 5
"""Photodiodes that must remain after others are dropped."""
MOST_SUBSETS = 1000
"""Subsets of one size that are all tried: 4 of 12, 3 of 18."""
HOPELESS = 100.0
"""A cost that exceeds the limit by this factor is not explained by the error of any predicted rates."""
ITERATIONS = 10
"""Iterations of PnP on a subset, which starts at the prediction: one that needs more has a false photodiode in it."""


class AngleNoise(NamedTuple):
    """One standard deviation of an angle's own error and of the part that all angles of a sweep share [rad]."""

    own_rad: float
    shared_rad: float

    def covariance(self, together: Floats | Bools) -> Floats:
        """Return R (n, n) [rad^2] of n angles; together: (n, n), 1 for two of one sweep, 0 else."""
        out: Floats = self.own_rad**2 * np.eye(len(together)) + self.shared_rad**2 * together
        return out


class Sweeps(NamedTuple):
    """Angles of C craft and the motion that they assume within the period, as `estimators.lighthouse.pnp.refine` takes
    them.

    theta: (C, K, 2) [rad]. lit: (C, K). point_m: (C, K, 3). offset_s: (C, K, 2). angular_rate: (C, 3) [rad/s].
    velocity: (C, 3) [m/s].
    """

    theta: Floats
    lit: Bools
    point_m: Floats
    offset_s: Floats
    angular_rate: Floats
    velocity: Floats

    def of(self, chosen: Ints) -> "Sweeps":
        """Return the same for some of the craft."""
        return Sweeps._make(part[chosen] for part in self)


class Subset(NamedTuple):
    """Photodiodes of one craft that agree: lit (K,), and the pose that they give, a batch of one."""

    lit: Bools
    solution: PoseSolution


def thresholds(most: int, false_alarm: float) -> Floats:
    """Return the largest T of n = 0 ... `most` photodiodes that is believed, (most + 1,); infinite without redundancy.

    false_alarm: the chance that honest angles exceed it.
    """
    redundancy = 2.0 * np.arange(most + 1) - 6
    out: Floats = np.where(redundancy > 0, chdtri(np.maximum(redundancy, 1), false_alarm), np.inf)
    return out


def noncentralities(threshold: Floats, missed_detection: float) -> Floats:
    """Return the least b^T A b / a^2 of a fault that the test misses with no more than this probability; as
    `thresholds`.
    """
    return np.array([_least(threshold[n], 2.0 * n - 6, missed_detection) for n in range(len(threshold))])


def shown_to_gate(gate: Floats, missed_detection: float) -> Floats:
    """Return the least noncentrality that a gate on n = 0, 1, ... rows misses with no more than this probability.

    gate: (rows + 1,), the largest normalised innovation squared that is let in.
    """
    return np.array([_least(gate[n], float(n), missed_detection) for n in range(len(gate))])


def _least(threshold: float, freedom: float, missed_detection: float) -> float:
    """Return the least noncentrality that a threshold misses with this probability; infinite without freedom."""
    if freedom <= 0:
        return float(np.inf)

    def too_often(noncentrality: float) -> float:
        return float(chndtr(threshold, freedom, noncentrality)) - missed_detection

    return float(brentq(too_often, 0.0, 10 * (threshold + 100), xtol=1e-6))


@kernel
def _rows_all(
    uv: Floats,
    weight: Floats,
    lit: Bools,
    point: Floats,
    rotation: Floats,
    position: Floats,
    offset: Floats,
    angular_rate: Floats,
    velocity: Floats,
    jacobian: Floats,
    residual: Floats,
    instant: Floats,
) -> None:
    """Write J (C, 2, K, 6), r (C, 2, K) and tau (C, 2, K) of the lit photodiodes, as PnP has them; zero elsewhere."""
    table = np.empty((2 * lit.shape[1], COLUMNS))
    for c in range(len(lit)):
        n = gather(lit[c], point[c], offset[c], angular_rate[c], velocity[c], table)
        for fan in range(2):
            i = fan * n
            for k in range(lit.shape[1]):
                if not lit[c, k]:
                    continue
                value, _, over, r0, r1, r2 = project(table, i, rotation[c], position[c, fan], position[c, 2])
                row, w = jacobian[c, fan, k], weight[c, k, fan]
                g = w * over
                row[0], row[1], row[2], row[3 + fan], row[5] = g * r0, g * r1, g * r2, g, -g * value
                residual[c, fan, k] = w * (value - uv[c, k, fan])
                instant[c, fan, k] = table[i, TAU]
                i += 1


def linearised(sweeps: Sweeps, rotation: Floats, position: Floats) -> tuple[Floats, Floats, Floats]:
    """Return J (C, 2, K, 6), r and tau (C, 2, K) at these poses; zero where not lit, or where the pose is NaN.

    Args:
        sweeps: the angles of C craft.
        rotation: (C, 3, 3).
        position: (C, 3) [m].
    """
    craft, photodiodes = sweeps.lit.shape
    known: Bools = np.all(np.isfinite(position), axis=1)
    jacobian = np.zeros((craft, 2, photodiodes, 6))
    residual, instant = np.zeros((2, craft, 2, photodiodes))
    uv = projections(checked("theta", sweeps.theta, (craft, photodiodes, 2)))
    _rows_all(
        uv,
        angle_weights(uv),
        np.ascontiguousarray(sweeps.lit & known[:, None]),
        checked("point_m", sweeps.point_m, (craft, photodiodes, 3)),
        checked("rotation", rotation, (craft, 3, 3)),
        checked("position", position, (craft, 3)),
        checked("offset_s", sweeps.offset_s, (craft, photodiodes, 2)),
        checked("angular_rate", sweeps.angular_rate, (craft, 3)),
        checked("velocity", sweeps.velocity, (craft, 3)),
        jacobian,
        residual,
        instant,
    )
    return jacobian, residual, instant


def statistic(sweeps: Sweeps, rotation: Floats, position: Floats, noise: AngleNoise, rate_covariance: Floats) -> Floats:
    """Return T (C,) of solved poses; NaN where a pose is.

    Args:
        sweeps: the angles.
        rotation: (C, 3, 3), solved.
        position: (C, 3) [m], solved.
        noise: of the angles.
        rate_covariance: (C, 6, 6) of the assumed (angular rate, velocity) [rad/s, m/s].

    Raises:
        ValueError: an array's shape does not fit `lit`; the message names the argument.
    """
    craft, photodiodes = sweeps.lit.shape
    solved: Bools = np.all(np.isfinite(position), axis=1)
    jacobian, residual, instant = linearised(sweeps, rotation, position)
    ones = np.zeros((craft, 2, photodiodes, 2))
    for fan in range(2):
        ones[:, fan, :, fan] = sweeps.lit
    j, r = jacobian.reshape(craft, -1, 6), residual.reshape(craft, -1, 1)
    v = np.concatenate([ones, instant[..., None] * jacobian], axis=-1).reshape(craft, -1, 8)
    v = v @ _root(noise.shared_rad, checked("rate_covariance", rate_covariance, (craft, 6, 6)))
    jt, vt = np.swapaxes(j, 1, 2), np.swapaxes(v, 1, 2)
    normal = np.where(solved[:, None, None], jt @ j, np.eye(6))
    seen = jt @ v
    inside = vt @ v - np.swapaxes(seen, 1, 2) @ np.linalg.solve(normal, seen)
    g = vt @ r
    own = noise.own_rad**2
    explained = np.swapaxes(g, 1, 2) @ np.linalg.solve(own * np.eye(8) + inside, g)
    out: Floats = ((np.swapaxes(r, 1, 2) @ r - explained) / own)[:, 0, 0]
    out[~solved] = np.nan
    return out


def _root(shared_rad: float, rate_covariance: Floats) -> Floats:
    """Return a root (C, 8, 8) of C, so that C need not be regular: C = root root^T."""
    value, vector = np.linalg.eigh(rate_covariance)
    out = np.zeros((len(rate_covariance), 8, 8))
    out[:, 0, 0] = out[:, 1, 1] = shared_rad
    out[:, 2:, 2:] = vector * np.sqrt(np.maximum(value, 0.0))[:, None, :]
    return out


def consistent_subset(
    sweeps: Sweeps,
    rotation: Floats,
    position: Floats,
    noise: AngleNoise,
    rate_covariance: Floats,
    threshold: Floats,
) -> Subset | None:
    """Return the lit photodiodes of one craft without some that must be false; None if the others never agree.

    Args:
        sweeps: the angles of one craft, a batch of one.
        rotation: (3, 3), the start of PnP for every subset, near the pose.
        position: (3,) [m], likewise.
        noise: of the angles.
        rate_covariance: (6, 6) of the assumed (angular rate, velocity) [rad/s, m/s].
        threshold: of `thresholds`.
    """
    lit = np.flatnonzero(sweeps.lit[0])
    most = len(lit) - FEWEST_KEPT
    far = lit[np.argsort(_deviation(sweeps, rotation, position)[lit], kind="stable")[::-1]]
    for dropped in dropped_sets(lit, far, most):
        if found := _best(sweeps, dropped, rotation, position, noise, rate_covariance, threshold):
            return found
    return None


def dropped_sets(lit: Ints, far: Ints, most: int) -> Iterator[list[tuple[int, ...]]]:
    """Yield the sets of photodiodes that may be false, in lists of equally large ones, in the order of the search.

    Every photodiode by itself; then the two, three, ... that lie farthest off; then every two, three, ...

    Args:
        lit: (n,), the photodiodes.
        far: (n,), the same, those farthest off first.
        most: largest number that may be false.
    """
    if most < 1:
        return
    yield list(combinations(lit.tolist(), 1))
    for count in range(2, most + 1):
        yield [tuple(far[:count].tolist())]
    for count in range(2, most + 1):
        if comb(len(lit), count) > MOST_SUBSETS:
            return
        yield list(combinations(lit.tolist(), count))


def _deviation(sweeps: Sweeps, rotation: Floats, position: Floats) -> Floats:
    """Return how far the angles of one craft (K,) lie from a pose [rad], their median shift taken off."""
    residual = linearised(sweeps, rotation[None], position[None])[1][0]
    out: Floats = np.hypot(*(residual - np.median(residual[:, sweeps.lit[0]], axis=1)[:, None]))
    return out


def _best(
    sweeps: Sweeps,
    dropped: Sequence[Sequence[int]],
    rotation: Floats,
    position: Floats,
    noise: AngleNoise,
    rate_covariance: Floats,
    threshold: Floats,
) -> Subset | None:
    """Return the subset of least T, of those without each of these equally long lists of photodiodes, if it passes."""
    without = np.array(dropped, dtype=np.int64)
    count = len(without)
    kept = np.tile(sweeps.lit[0], (count, 1))
    kept[np.arange(count)[:, None], without] = False
    tried = sweeps.of(np.zeros(count, dtype=np.int64))._replace(lit=kept)
    uv = projections(tried.theta)
    start = np.broadcast_to(rotation, (count, 3, 3)), np.broadcast_to(position, (count, 3))
    weight, motion = angle_weights(uv), (tried.offset_s, tried.angular_rate, tried.velocity)
    solution = refine_projections(uv, weight, kept, tried.point_m, *start, *motion, iterations_max=ITERATIONS)
    limit = threshold[np.count_nonzero(kept[0])]
    near = np.flatnonzero(solution.solved & (solution.cost < HOPELESS * limit * noise.own_rad**2))
    if not len(near):
        return None
    covariance = np.broadcast_to(rate_covariance, (len(near), 6, 6))
    value = statistic(tried.of(near), solution.rotation[near], solution.position[near], noise, covariance)
    least = int(np.argmin(value))
    if not value[least] <= limit:
        return None
    one = slice(int(near[least]), int(near[least]) + 1)
    return Subset(kept[one][0], PoseSolution._make(part[one] for part in solution))
