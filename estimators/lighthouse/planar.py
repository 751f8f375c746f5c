"""Light in one plane: the pose to second order, where the plane is so nearly face-on that its mirror minima merge.

A plane of size a at distance d that is tilted by the angle vector t from face-on shows t in its image twice: to second
order by foreshortening, a/d t t^T, and to first order by perspective, (a/d)^2 t. The first alone cannot tell t from -t.
Tilted far, the pose has two minima, each of which is as sharp as the angle noise s over a/d |t|. Within about
sqrt(s d/a) of face-on, a few degrees, they merge into one valley: its bottom is flat where the first-order covariance
(J^T J)^-1 takes it for sharp, and the minimum of a single period lies anywhere in it.

The measure of it is by how much the residuals depart from their tangent one sigma off the minimum, in sigmas of
the noise. Above BEND the first order does not hold to the five sigmas that integrity asks for, and then

- `pose_rows` gives a filter the angles themselves, linear about its prediction and not about the noisy minimum, with
  the second-order terms of the prediction's error d ~ N(0, P) in their mean and covariance (the second-order filter of
  Athans, Wishner and Bertolini, 1968):

      y = -(r + c / 2) = J d + noise,   noise ~ N(0, R + (sum_kl c_kl c_kl^T) / 2)
      c_kl = l_k^T (d2r) l_l,   c = sum_k c_kk

  with P = sum l_k l_k^T over the two tilts, which are what bends;
- `spread` gives a craft that starts the mean and the covariance of all tilts that the angles allow, each weighted by
  its likelihood exp(-F/2), F the least cost at that tilt over the other four unknowns.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import formula
from estimators.lighthouse.integrity import AngleNoise, Sweeps, linearised
from estimators.rotation import exp, log

BEND = 0.02
"""Departure from the tangent at one sigma, in sigmas, that first-order precision bears: 0.5 at five sigmas."""
FLAT = 0.05
"""Photodiodes count as one plane if their smallest spread is below this share of their largest (`is_flat`)."""
WIDEST_RAD = 0.8
"""Largest tilt from face-on that is looked at."""
GRIDS = (21, 21, 31)
"""Tilts per axis: each grid covers what the one before it has left."""
FAR = 50.0
"""Cost above the least beyond which a tilt does not count, exp(-25)."""
REACH = 28.4
"""Square of the normal quantile 5.33 of a risk of 1e-7, two-sided: how far the covariance is believed."""

MOST = 4.0
"""Largest factor by which the covariance of one side of face-on is raised, to reach all that the angles allow."""


class Rows(NamedTuple):
    """Six rows per craft that hold all that its angles say of its state: y = pose d + rates dw + noise of unit
    covariance, d the error of (attitude, position), dw that of (angular rate, velocity).

    mask: (C,), whether there are any. y: (C, 6). pose, rates: (C, 6, 6).
    """

    mask: Bools
    y: Floats
    pose: Floats
    rates: Floats


class Spread(NamedTuple):
    """Mean and covariance of the poses that one craft's angles allow.

    rotation: (3, 3). position: (3,) [m]. covariance: (6, 6) of (attitude, position) for known rates. coupling: (6, 6)
    [s], B of `estimators.lighthouse.dop`. contained: whether every pose that is not excluded lies where the covariance
    says that it may; if not, no single pose with a covariance tells what is known. side: what is known of the sign.
    """

    rotation: Floats
    position: Floats
    covariance: Floats
    coupling: Floats
    contained: bool
    side: "Side"


class Side(NamedTuple):
    """Evidence on the sign of a tilt, summed over periods.

    turn: (3,) [rad], best turn from face-on on one side. lead: cost of the other side's best pose above its own, in
    variances of the noise.
    """

    turn: Floats
    lead: float


def is_flat(point: Floats) -> bool:
    """Return whether photodiodes (n, 3) lie in one plane, or nearly so.

    Beside one far from all others any layout looks thin: the largest spread counts no more than the median distance
    from the median place says of all n.
    """
    size = np.linalg.svd(point - point.mean(axis=0), compute_uv=False)
    apart = np.linalg.norm(point - np.median(point, axis=0), axis=1)
    return bool(size[2] <= FLAT * min(size[0], np.sqrt(len(point)) * np.median(apart)))


@formula
def bends(attitude_sigma_rad: Floats, size_m: Floats, distance_m: Floats, noise: AngleNoise) -> Bools:
    """Return where a plane of this attitude sigma is near its merged minima, (C,); False where anything is unknown.

    The residual departs from its tangent by a/d sigma^2 / 2 at one sigma.

    Args:
        attitude_sigma_rad: (C,) of the first order.
        size_m: (C,) a, an upper bound.
        distance_m: (C,) d.
        noise: of the angles.
    """
    out: Bools = attitude_sigma_rad**2 * size_m > 2 * BEND * noise.own_rad * distance_m
    return out


def pose_rows(
    sweeps: Sweeps, mask: Bools, rotation: Floats, position: Floats, covariance: Floats, noise: AngleNoise
) -> Rows:
    """Return the angles of C craft as measurements of the errors of their predictions, to second order.

    Args:
        sweeps: the angles, and the predicted rates.
        mask: (C,), craft to compute.
        rotation: (C, 3, 3), predicted.
        position: (C, 3) [m], predicted.
        covariance: (C, 6, 6) of the predictions' (attitude, position).
        noise: of the angles.
    """
    out = Rows(mask, np.zeros((len(mask), 6)), *np.zeros((2, len(mask), 6, 6)))
    for c in np.flatnonzero(mask):
        one = sweeps.of(np.array([c]))
        axes = _tilt_axes(_centre(one, rotation[c], position[c]))
        across = covariance[c][:, :3] @ axes
        side = across @ np.linalg.inv(np.linalg.cholesky(axes.T @ across[:3])).T
        first, second = side.T
        shift = np.array([np.zeros(6), first, -first, second, -second, first + second, -first - second])
        jacobian, residual, instant = _at(one, exp(shift[:, :3]) @ rotation[c], position[c] + shift[:, 3:])
        bend = residual[1::2] + residual[2::2] - 2 * residual[0]
        mixed = (bend[2] - bend[0] - bend[1]) / 2
        curved = np.array([bend[0], bend[1], np.sqrt(2) * mixed])
        matrix = _noise_covariance(one, noise) + curved.T @ curved / 2
        root = np.linalg.inv(np.linalg.cholesky(matrix))
        u, size, vt = np.linalg.svd(root @ jacobian[0], full_matrices=False)
        out.y[c] = -u.T @ root @ (residual[0] + (bend[0] + bend[1]) / 2)
        out.pose[c] = size[:, None] * vt
        out.rates[c] = u.T @ root @ (instant[0][:, None] * jacobian[0])
    return out


def spread(
    one: Sweeps,
    rotation: Floats,
    position: Floats,
    noise: AngleNoise,
    rate_sigma: tuple[float, float],
    excluded: Floats,
    allowed: float,
    before: Side | None = None,
) -> Spread | None:
    """Return the poses that one craft's angles allow; None where the minimum's first-order covariance tells them.

    Args:
        one: the angles of one craft, a batch of one, as if at rest.
        rotation: (3, 3), the best minimum.
        position: (3,) [m], likewise.
        noise: of the angles.
        rate_sigma: one sigma per axis of the unknown angular rate [rad/s] and velocity [m/s]; zero: the spread is that
            of a craft at rest, and what its rates do to it is in `coupling`, to first order.
        excluded: (M, 3, 3), minima that other periods have excluded; what is nearer to them is left out.
        allowed: the cost above the least, in variances of the noise, up to which a pose, or a side, is not excluded.
        before: evidence of the periods just before.
    """
    jacobian, _, instant = (part[0] for part in _at(one, rotation[None], position[None]))
    rates = instant[:, None] * jacobian * np.repeat(rate_sigma, 3)
    weight = np.linalg.inv(_noise_covariance(one, noise) + rates @ rates.T)
    axes = _tilt_axes(_centre(one, rotation, position))
    first_order = np.linalg.inv(jacobian.T @ weight @ jacobian)
    tilts = axes.T @ first_order[:3, :3] @ axes
    value, vector = np.linalg.eigh(tilts)
    along = first_order[:, :3] @ axes @ vector[:, 1] / np.sqrt(value[1])
    residual = _at(one, exp(np.outer([-1.0, 0, 1], along[:3])) @ rotation, position + np.outer([-1, 0, 1], along[3:]))[
        1
    ]
    bend = (residual[0] + residual[2]) / 2 - residual[1]
    sight = _centre(one, rotation, position)
    face, turn = _face_on(rotation, one.point_m[0][one.lit[0]], sight)
    if not (bend @ weight @ bend > BEND**2 and np.linalg.norm(turn) < WIDEST_RAD):
        return None
    asked = _Question(one, weight, rates, face, axes, sight)
    nodes, cost = _covered(asked, turn @ axes, float(np.sqrt(value[1])), excluded)
    side, cost = _sided(cost, nodes.tilt, axes, before or Side(turn, 0.0), allowed)
    return _moments(asked, nodes, cost, rate_sigma, side, allowed)


class _Nodes(NamedTuple):
    """Poses at G tilts: tilt (G, 2) [rad]; rotation, position; cost, the least there; and at the last step the
    residuals (G, 2 K) and the derivatives by the four other unknowns (G, 2 K, 4).
    """

    tilt: Floats
    rotation: Floats
    position: Floats
    cost: Floats
    residual: Floats
    others: Floats


class _Question(NamedTuple):
    """The angles whose poses are summed: one craft's, with their weight (2 K, 2 K), the inverse of the covariance of
    noise and rates; rates: derivatives by rates of unit sigma, (2 K, 6); face: attitude face-on, (3, 3); axes: of tilt,
    (3, 2); sight: to the middle of the photodiodes, (3,) [m].
    """

    one: Sweeps
    weight: Floats
    rates: Floats
    face: Floats
    axes: Floats
    sight: Floats


def _covered(asked: _Question, start: Floats, sigma_rad: float, excluded: Floats) -> tuple[_Nodes, Floats]:
    """Return poses at all tilts that count, and their costs above the least (G,), infinite where excluded.

    Args:
        asked: the question.
        start: (2,), tilt of the minimum [rad].
        sigma_rad: sigma of its widest tilt.
        excluded: (M, 3, 3), minima that other periods have excluded.
    """
    other = np.array([log(turned @ asked.face.T) @ asked.axes for turned in excluded]).reshape(-1, 2)
    half = min(1.5 * float(np.linalg.norm(start)) + 8 * sigma_rad, WIDEST_RAD)
    low, high = np.full(2, -half), np.full(2, half)
    for count in GRIDS:
        grid = np.stack(np.meshgrid(*np.linspace(low, high, count).T, indexing="ij"), axis=-1).reshape(-1, 2)
        nodes = _profiled(asked, grid)
        apart = np.linalg.norm(grid - start, axis=1)
        nearer = np.array([np.linalg.norm(grid - o, axis=1) < apart for o in other]).any(axis=0)
        cost = np.where(nearer | ~np.isfinite(nodes.cost), np.inf, nodes.cost)
        cost -= cost.min()
        close, cell = grid[cost < FAR], (high - low) / (count - 1)
        low = np.maximum(close.min(axis=0) - cell, -WIDEST_RAD)
        high = np.minimum(close.max(axis=0) + cell, WIDEST_RAD)
    return nodes, cost


def _moments(
    asked: _Question,
    nodes: _Nodes,
    cost: Floats,
    rate_sigma: tuple[float, float],
    side: Side,
    allowed: float,
) -> Spread:
    """Return the mean and covariance over all tilts.

    Args:
        asked: the question.
        nodes: poses at the tilts.
        cost: (G,) of `_covered`, less a side that is excluded.
        rate_sigma: as in `spread`.
        side: evidence on the sign of the tilt.
        allowed: as in `spread`.
    """
    weight, rates, axes = asked.weight, asked.rates, asked.axes
    share = np.exp(-cost / 2)
    share /= share.sum()
    mean = exp(share @ log(nodes.rotation @ asked.face.T)) @ asked.face
    place = share @ nodes.position
    error = np.concatenate([log(nodes.rotation @ mean.T), nodes.position - place], axis=1)
    moments = (share[:, None] * error).T @ error
    inside = error[cost < allowed, :3] @ axes
    reach = float(np.max(np.sum(inside @ np.linalg.inv(axes.T @ moments[:3, :3] @ axes) * inside, axis=1)))
    more = max(reach / REACH, 1.0)
    contained = more == 1.0 or (abs(side.lead) >= allowed and more <= MOST)
    others, basis = nodes.others[int(np.argmin(cost))], _others(asked.sight)
    rest = np.linalg.inv(others.T @ weight @ others)
    whole = more * moments + basis @ rest @ basis.T
    if not rates.any():
        jacobian, _, instant = (part[0] for part in _at(asked.one, mean[None], place[None]))
        coupling = whole @ jacobian.T @ weight @ (instant[:, None] * jacobian)
        return Spread(mean, place, whole, coupling, contained, side)
    # The rates of each node, of unit sigma, from its residuals.
    guess = -nodes.residual @ weight @ rates
    cross = (share[:, None] * error).T @ (guess - share @ guess) - basis @ rest @ others.T @ weight @ rates
    covariance = whole - cross @ cross.T
    if np.linalg.eigvalsh(covariance / np.sqrt(np.outer(np.diag(whole), np.diag(whole))))[0] <= 1e-9:
        covariance, cross = whole, np.zeros((6, 6))
    return Spread(mean, place, covariance, -cross / np.repeat(rate_sigma, 3), contained, side)


def _sided(cost: Floats, grid: Floats, axes: Floats, before: Side, allowed: float) -> tuple[Side, Floats]:
    """Return the evidence with this period's, and the costs (G,), infinite on a side that is excluded by now."""
    own = grid @ (before.turn @ axes) >= 0
    near, far = np.where(own, cost, np.inf), np.where(own, np.inf, cost)
    lead = before.lead + float(np.clip(min(far.min(), FAR) - min(near.min(), FAR), -FAR, FAR))
    if abs(lead) >= allowed:
        cost = near if lead > 0 else far
        cost = cost - cost.min()
    turn = axes @ grid[int(np.argmin(near))] if np.isfinite(near.min()) else before.turn
    return Side(turn, lead), cost


def _profiled(asked: _Question, grid: Floats) -> _Nodes:
    """Return the best poses at these tilts (G, 2), by Gauss-Newton over roll and position."""
    one, weight = asked.one, asked.weight
    rotation = exp(grid @ asked.axes.T) @ asked.face
    position = asked.sight - rotation @ one.point_m[0][one.lit[0]].mean(axis=0)
    basis = _others(asked.sight)
    for _ in range(3):
        jacobian, residual, _ = _at(one, rotation, position)
        others = jacobian @ basis
        pull = np.swapaxes(weight @ others, 1, 2)
        gradient = (pull @ residual[..., None])[..., 0]
        step = -np.linalg.solve(pull @ others, gradient[..., None])[..., 0]
        cost = np.sum(residual @ weight * residual, axis=1) + np.sum(gradient * step, axis=1)
        residual = residual + (others @ step[..., None])[..., 0]
        rotation = exp(step @ basis[:3].T) @ rotation
        position = position + step @ basis[3:].T
    return _Nodes(grid, rotation, position, cost, residual, others)


def _face_on(rotation: Floats, point: Floats, sight: Floats) -> tuple[Floats, Floats]:
    """Return the pose's rotation turned until the plane is face-on, (3, 3), and the turn back from there, (3,)."""
    normal = rotation @ np.linalg.svd(point - point.mean(axis=0))[2][2]
    along = sight / np.linalg.norm(sight)
    normal *= 1.0 if normal @ along >= 0 else -1.0
    axis = np.cross(along, normal)
    sine = np.linalg.norm(axis)
    turn = axis * (np.arctan2(sine, normal @ along) / sine if sine > 0 else 0.0)
    return exp(-turn) @ rotation, turn


def _others(sight: Floats) -> Floats:
    """Return the pose changes (6, 4) beside a tilt: roll about the line of sight, and three of position."""
    out = np.zeros((6, 4))
    out[:3, 0], out[3:, 1:] = sight / np.linalg.norm(sight), np.eye(3)
    return out


def _tilt_axes(sight: Floats) -> Floats:
    """Return two axes (3, 2) perpendicular to the line of sight (3,)."""
    x, y, z = sight / np.linalg.norm(sight)
    # Across y and the line, and across the line and that.
    across = np.array([z, 0.0, -x])
    a, _, c = across / np.linalg.norm(across)
    return np.array([[a, y * c], [0.0, z * a - x * c], [c, -y * a]])


def _centre(one: Sweeps, rotation: Floats, position: Floats) -> Floats:
    """Return the middle of the lit photodiodes (3,) [m]."""
    out: Floats = rotation @ one.point_m[0][one.lit[0]].mean(axis=0) + position
    return out


def _at(one: Sweeps, rotation: Floats, position: Floats) -> tuple[Floats, Floats, Floats]:
    """Return J (G, 2 K, 6), r and tau (G, 2 K) of one craft's angles at G poses."""
    many = one.of(np.zeros(len(rotation), dtype=np.int64))
    jacobian, residual, instant = linearised(many, rotation, position)
    count = len(rotation)
    return jacobian.reshape(count, -1, 6), residual.reshape(count, -1), instant.reshape(count, -1)


def _noise_covariance(one: Sweeps, noise: AngleNoise) -> Floats:
    """Return R (2 K, 2 K) of one craft's angles [rad^2]: each one's own noise, and what a fan's lit angles share."""
    lit = one.lit[0]
    together = np.zeros((2, len(lit), 2, len(lit)), dtype=np.bool_)
    together[0, :, 0] = together[1, :, 1] = lit[:, None] & lit
    return noise.covariance(together.reshape(2 * len(lit), -1))
