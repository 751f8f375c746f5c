"""The sparse least-squares problem of a calibration: who is unknown, residuals, Jacobian, and what no survey can tell.

Residuals, one per angle and two per period, all of unit variance:

    (predicted + rotor_noise u - theta) / noise,    u

u is the rotor's error in one sweep, in its standard deviations: one draw for all photodiodes of all craft that a fan
hits in that period (19). As an unknown with an observation of zero it gives the weights of the full covariance (19)
exactly, and leaves one residual per angle to be judged by itself.

Unknowns, in blocks, a period each: u of fans X and Y, then, where poses are not known, (d, dt) of every craft:
R = Exp([d]x) R_start, t = t_start + dt. After the blocks the shared ones: both fans' five numbers, and every
photodiode's place, x = start + basis q. The columns of `basis` leave out what is held and what is only gauge:

- Poses known: nothing is gauge. All is in the frame in which the poses are given.
- Poses unknown: turn or shift a craft's body frame, or scale its photodiodes and with them its distances: no angle
  changes. Seven numbers per craft stay as they start: the photodiodes' centroid, and to first order their mean turn and
  size about it, sum (w_0 - mean) x w and sum (w_0 - mean) . w. `to_gauge` brings any other layout there.

A turn of all poses about the lighthouse is no gauge: the fans' axes tell x from y and up from sideways, though only to
second order in the angles off boresight. It is phase (about x and y) and tilt (about z) that are weak then.
"""

from collections.abc import Sequence
from math import hypot
from typing import NamedTuple

import numpy as np
from scipy import sparse

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.calibration.model import place, predict

PARTS = ("phase", "tilt", "curve", "gibbous", "photodiodes")
"""Parts that can be held."""
_COLUMNS = {"phase": (0,), "tilt": (1,), "curve": (2,), "gibbous": (3, 4)}


class Survey(NamedTuple):
    """M sweep angles of N poses of one or more craft with P photodiodes in all.

    theta: (M,) [rad], as measured. fan, photodiode, pose: (M,). offset_s: (M,), the angle's instant after its pose's
    epoch [s]. rotation (N, 3, 3) R_l_b, position (N, 3) [m]: known, or where to start. angular_rate (N, 3) [rad/s],
    velocity (N, 3) [m/s]: the motion around the epoch. All in the lighthouse frame. craft, period (N,): poses of one
    period share its two sweeps. point_m: (P, 3) [m], photodiodes in their craft's body frame, as believed so far.
    owner: (P,), the craft of each. fans: (2, 5), as believed so far.
    """

    theta: Floats
    fan: Ints
    photodiode: Ints
    pose: Ints
    offset_s: Floats
    rotation: Floats
    position: Floats
    angular_rate: Floats
    velocity: Floats
    craft: Ints
    period: Ints
    point_m: Floats
    owner: Ints
    fans: Floats


class Noise(NamedTuple):
    """Standard deviations of one angle [rad]: its own, and the rotor's that it shares with its sweep (19)."""

    own_rad: float
    rotor_rad: float

    @property
    def sigma_rad(self) -> float:
        """The standard deviation of both together."""
        return hypot(self.own_rad, self.rotor_rad)


def check(survey: Survey, noise: Noise, hold: Sequence[str]) -> None:
    """Check that a survey fits together.

    Args:
        survey: the angles and poses.
        noise: of one angle.
        hold: names of `PARTS`.

    Raises:
        ValueError: a shape, an index or a value is wrong; the message names the argument.
    """
    angles, poses, photodiodes = len(survey.theta), len(survey.rotation), len(survey.point_m)
    wanted = {
        "theta": (angles,),
        "fan": (angles,),
        "photodiode": (angles,),
        "pose": (angles,),
        "offset_s": (angles,),
        "rotation": (poses, 3, 3),
        "position": (poses, 3),
        "angular_rate": (poses, 3),
        "velocity": (poses, 3),
        "craft": (poses,),
        "period": (poses,),
        "point_m": (photodiodes, 3),
        "owner": (photodiodes,),
        "fans": (2, 5),
    }
    for name, shape in wanted.items():
        array = getattr(survey, name)
        if array.shape != shape:
            raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
        if not np.isfinite(array).all():
            raise ValueError(f"{name} must be finite")
    for name, limit in (("fan", 2), ("photodiode", photodiodes), ("pose", poses)):
        index = getattr(survey, name)
        if angles and not (index.min() >= 0 and index.max() < limit):
            raise ValueError(f"{name} must lie in 0 .. {limit - 1}")
    if np.any(survey.owner[survey.photodiode] != survey.craft[survey.pose]):
        raise ValueError("an angle's photodiode must belong to the craft of its pose")
    if not (noise.own_rad > 0 and noise.rotor_rad >= 0):
        raise ValueError(f"noise must be positive, not {noise}")
    for part in hold:
        if part not in PARTS:
            raise ValueError(f"hold: {part!r} is none of {', '.join(PARTS)}")


class Problem:
    """Residuals and Jacobian over the raw unknowns x, (size,): `blocks` blocks of `width`, then 10 + 3 P shared ones.

    basis: (10 + 3 P, shared), how the shared ones may move. used: (M,), angles that count; set by who solves.
    """

    def __init__(
        self, survey: Survey, noise: Noise, *, poses_known: bool, hold: Sequence[str] = (), seen: Bools | None = None
    ) -> None:
        """Take a survey. seen: (P,), photodiodes to be placed; the others stay where they are. Raises ValueError as
        `check` does.
        """
        check(survey, noise, hold)
        self.survey, self.noise, self.poses_known = survey, noise, poses_known
        periods, self._block = np.unique(survey.period, return_inverse=True)
        self.blocks = len(periods)
        # The place of a pose among those of its period.
        order = np.lexsort((survey.craft, self._block))
        first = np.searchsorted(self._block[order], np.arange(self.blocks))
        slot = np.empty(len(order), dtype=np.int64)
        slot[order] = np.arange(len(order)) - first[self._block[order]]
        self._slot = slot
        self.width = 2 if poses_known else 2 + 6 * (int(slot.max(initial=0)) + 1)
        self.local = self.blocks * self.width
        self.size = self.local + 10 + survey.point_m.size
        self.used: Bools = np.ones(len(survey.theta), dtype=np.bool_)
        everything = np.ones(len(survey.point_m), dtype=np.bool_)
        self.basis = _basis(survey, poses_known, hold, everything if seen is None else seen)
        self._columns = self._pattern()

    def start(self) -> Floats:
        """Return the x that the survey gives."""
        x = np.zeros(self.size)
        x[self.local :] = np.concatenate([self.survey.fans.ravel(), self.survey.point_m.ravel()])
        return x

    def shared(self, x: Floats) -> tuple[Floats, Floats]:
        """The fans (2, 5) and the photodiodes (P, 3) [m] of x."""
        return x[self.local : self.local + 10].reshape(2, 5), x[self.local + 10 :].reshape(-1, 3)

    def poses(self, x: Floats) -> tuple[Floats, Floats]:
        """Rotations (N, 3, 3) and positions (N, 3) [m] of x."""
        step = self._steps(x)
        return rot.exp(step[:, :3]) @ self.survey.rotation, self.survey.position + step[:, 3:]

    def residuals(self, x: Floats) -> Floats:
        """Return the residuals (M + 2 blocks,): angles, zero where not used, then the rotor's u."""
        return self._evaluate(x, slopes=False)[0]

    def jacobian(self, x: Floats) -> sparse.csr_array:
        """Derivative of `residuals` by x, sparse: 9 entries per angle with known poses, else 15."""
        return self._evaluate(x, slopes=True)[1]

    def _steps(self, x: Floats) -> Floats:
        """Return (d, dt) of every pose, (N, 6)."""
        if self.poses_known:
            return np.zeros((len(self._slot), 6))
        start = self._block * self.width + 2 + 6 * self._slot
        out: Floats = x[start[:, None] + np.arange(6)]
        return out

    def _pattern(self) -> Ints:
        """The columns of every angle's entries: u, fan, photodiode, pose."""
        s = self.survey
        block = self._block[s.pose] * self.width
        columns = [
            (block + s.fan)[:, None],
            (self.local + 5 * s.fan)[:, None] + np.arange(5),
            (self.local + 10 + 3 * s.photodiode)[:, None] + np.arange(3),
        ]
        if not self.poses_known:
            columns.append((block + 2 + 6 * self._slot[s.pose])[:, None] + np.arange(6))
        return np.concatenate(columns, axis=1)

    def _evaluate(self, x: Floats, slopes: bool) -> tuple[Floats, sparse.csr_array]:
        s, weight = self.survey, self.used / self.noise.own_rad
        fans, point_m = self.shared(x)
        rotation, position = self.poses(x)
        at, turn, arm = place(
            point_m[s.photodiode],
            rotation[s.pose],
            position[s.pose],
            s.angular_rate[s.pose],
            s.velocity[s.pose],
            s.offset_s,
        )
        predicted = predict(at, s.fan, fans)
        u = x[: self.local].reshape(self.blocks, self.width)[:, :2]
        rotor = self.noise.rotor_rad * u[self._block[s.pose], s.fan]
        error = predicted.angle + rotor - (s.theta - np.pi / 2)
        residual = np.concatenate([np.where(self.used, weight * error, 0.0), u.ravel()])
        if not slopes:
            return residual, sparse.csr_array((len(residual), self.size))

        # p = turn Exp([d]x) R w_p + t: by w_p turn R; by d -turn [arm]x J_l(d), that is g -> J_l^T (arm x turn^T g).
        back = np.einsum("mji,mj->mi", turn, predicted.point)
        by_point = np.einsum("mji,mj->mi", rotation[s.pose], back)
        entries = [np.full((len(weight), 1), self.noise.rotor_rad), predicted.fan, by_point]
        if not self.poses_known:
            left = rot.left_jacobian(self._steps(x)[:, :3])[s.pose]
            entries += [np.einsum("mji,mj->mi", left, np.cross(arm, back)), predicted.point]
        value = np.where(self.used[:, None], weight[:, None] * np.concatenate(entries, axis=1), 0.0)
        rows, wide = self._columns.shape
        prior = np.arange(self.blocks)[:, None] * self.width + np.arange(2)
        jacobian = sparse.csr_array(
            (
                np.concatenate([value.ravel(), np.ones(2 * self.blocks)]),
                np.concatenate([self._columns.ravel(), prior.ravel()]),
                np.concatenate([wide * np.arange(rows + 1), rows * wide + 1 + np.arange(2 * self.blocks)]),
            ),
            shape=(len(residual), self.size),
        )
        return residual, jacobian


def to_gauge(point_m: Floats, reference_m: Floats) -> Floats:
    """Return the photodiodes (K, 3) of a craft turned, shifted and scaled into the gauge of `reference_m` (K, 3)."""
    centre, c0 = point_m - point_m.mean(axis=0), reference_m - reference_m.mean(axis=0)
    u, _, vt = np.linalg.svd(c0.T @ centre)
    turned = centre @ (u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt).T
    out: Floats = reference_m.mean(axis=0) + turned * (np.sum(c0**2) / np.sum(c0 * turned))
    return out


def _basis(survey: Survey, poses_known: bool, hold: Sequence[str], seen: Bools) -> Floats:
    """Return the directions in which the shared unknowns may move, orthonormal columns (10 + 3 P, shared)."""
    fans = [5 * fan + c for fan in (0, 1) for part, columns in _COLUMNS.items() if part not in hold for c in columns]
    columns = [np.eye(10 + survey.point_m.size)[:, sorted(fans)]]
    if "photodiodes" not in hold:
        for craft in np.unique(survey.owner):
            mine = np.flatnonzero(seen & (survey.owner == craft))
            free = np.eye(3 * len(mine)) if poses_known else _shape_only(survey.point_m[mine])
            column = np.zeros((10 + survey.point_m.size, free.shape[1]))
            column[(10 + 3 * mine[:, None] + np.arange(3)).ravel()] = free
            columns.append(column)
    return np.concatenate(columns, axis=1)


def _shape_only(point_m: Floats) -> Floats:
    """Return orthonormal moves (3 K, 3 K - 7) of points (K, 3) without shift, turn or scale about their centroid."""
    if len(point_m) < 3:
        return np.empty((point_m.size, 0))
    centre = point_m - point_m.mean(axis=0)
    shift = np.tile(np.eye(3), (len(point_m), 1))
    turn = np.concatenate([-rot.skew(c) for c in centre])
    gauge = np.concatenate([shift, turn, centre.reshape(-1, 1)], axis=1)
    u, _, _ = np.linalg.svd(gauge, full_matrices=True)
    out: Floats = u[:, 7:]
    return out
