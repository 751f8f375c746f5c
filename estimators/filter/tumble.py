"""Free tumbling of a body of unknown inertia: attitude, angular rate and ratios of inertia from measured attitudes.

A dead body turns by Euler's equation, L w' = -w x L w, L = R J R^T (`estimators.free_rotation`), in which only the
ratios of its inertia J count. With S symmetric and without trace,

    J = exp(S),   S = sum_k q_k B_k        five numbers q, zero of a sphere

every q is a body that can be, up to the triangle inequality of its moments. An extended Kalman filter estimates the
errors of (R, w, q), 11 numbers, in the convention of `estimators.filter.error_state`: over dt

    (d, dw) <- M F (d, dw) + G dq,   G = d(turn, rate) / dq        M of `free_turns`, F at constant rates

The first minutes are filtered again, linear about what is known then, a few times: at first nothing is.

Attitudes alone do not tell every part of q: a body that turns about a principal axis says only that it is one.
`Inertia` says by how much each part has become better known than it was, and what has not.
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.filter.bank import gates
from estimators.filter.error_state import transition_into
from estimators.free_rotation import free_turns
from estimators.state import STATES

PARTS = 5
"""Ratios of inertia: of the six numbers of a symmetric matrix, all but its size."""
UNKNOWN_RATIO = 0.5
"""Standard deviation of a part of S before it is known: the logarithm of a ratio of moments, of a craft."""
OBSERVED = 0.5
"""Standard deviation, against that before, below which a part is observed."""
SMALL = 1e-4
"""Change of a part of S by which its effect is found."""
RATE_WALK_RAD_S = np.radians(0.002)
"""Random walk of the angular rate in a second: torques of gas, light and fuel."""
STEP_S, STEP_RAD = 0.1, 0.05
"""Longest step, in time and in turn."""
AGAIN_AT = (15, 30, 60, 120, 240)
"""Numbers of instants with an attitude at which all are filtered again; at the last, for the last time.

Several attitudes of one instant tell no more of the motion than one that is as much better."""
AGAIN = 2
"""Times that they are, then."""
GATE = 0.99999
"""Share of attitudes that agree which is let in."""

_ROOT = np.sqrt([0.5, 1 / 6])
BASIS = np.array(
    [
        np.diag([1.0, -1.0, 0.0]) * _ROOT[0],
        np.diag([1.0, 1.0, -2.0]) * _ROOT[1],
        *(_ROOT[0] * (np.outer(a, b) + np.outer(b, a)) for a, b in np.eye(3)[[[1, 2], [2, 0], [0, 1]]]),
    ]
)
"""B_k, (5, 3, 3): symmetric, without trace, orthonormal."""
_CHANGES = SMALL * np.concatenate([np.zeros((1, PARTS)), np.eye(PARTS), -np.eye(PARTS)])


class Inertia(NamedTuple):
    """Ratios of inertia.

    tensor: (3, 3), body frame, mean moment one. moments: (3,), its principal moments, ascending. axes: (3, 3), the
    principal axes in columns. sigma: (3,), relative, of the moments. share: (5,), ascending: standard deviations of the
    parts of S now, against those before any measurement. observed: number of parts that have become known.
    """

    tensor: Floats
    moments: Floats
    axes: Floats
    sigma: Floats
    share: Floats
    observed: int


class _Seen(NamedTuple):
    """A measured attitude, `dt` [s] after the one before."""

    dt: float
    rotation: Floats
    covariance: Floats
    age_s: float


class _Taken(NamedTuple):
    """An update: error (11,), covariance (11, 11) afterwards, and NIS."""

    x: Floats
    covariance: Floats
    nis: float


class Tumble:
    """A freely tumbling body: `predict` and `update` in turn."""

    def __init__(
        self,
        rotation: Floats,
        covariance: Floats,
        rate_sigma_rad_s: float,
        ratio_sigma: float = UNKNOWN_RATIO,
        rate_walk_rad_s: float = RATE_WALK_RAD_S,
    ) -> None:
        """Begin at a measured attitude, at rest within `rate_sigma_rad_s`.

        Args:
            rotation: (3, 3), body to the frame in which it turns.
            covariance: (3, 3) [rad^2] of it.
            rate_sigma_rad_s: 1 sigma per axis of the unknown angular rate [rad/s].
            ratio_sigma: 1 sigma of a part of S.
            rate_walk_rad_s: random walk of the rate in a second, per axis [rad/s].
        """
        self.rotation, self.angular_rate = np.array(rotation, dtype=np.float64), np.zeros(3)
        self.ratio = np.zeros(PARTS)
        self.covariance: Floats = np.zeros((6 + PARTS, 6 + PARTS))
        self.covariance[:3, :3] = covariance
        self.covariance[range(3, 6), range(3, 6)] = rate_sigma_rad_s**2
        self.covariance[range(6, 6 + PARTS), range(6, 6 + PARTS)] = ratio_sigma**2
        self._ratio_sigma, self._walk = ratio_sigma, rate_walk_rad_s
        self._gate = float(gates(GATE, 3)[3])
        self._first: tuple[Floats, Floats] | None = self.rotation, self.covariance.copy()
        self._seen: list[_Seen] = []
        self._instants = 0
        self._since_s = 0.0

    def predict(self, dt: float) -> None:
        """Move on by `dt` [s]."""
        self._since_s += dt
        self.rotation, self.angular_rate, self.covariance, _ = self._moved(
            self.rotation, self.angular_rate, self.ratio, dt, self.covariance
        )

    def update(self, rotation: Floats, covariance: Floats, age_s: float = 0.0) -> bool:
        """Take in a measured attitude; return whether it agrees. One that does not changes nothing.

        Args:
            rotation: (3, 3), measured.
            covariance: (3, 3) [rad^2] of it.
            age_s: it was measured as if the rates were known, this much after the present [s]; negative: before.
        """
        seen = _Seen(self._since_s, np.array(rotation), np.array(covariance), age_s)
        y = rot.log(rotation @ self.rotation.T)
        taken = _taken(seen, y, self.covariance)
        if taken.nis > self._gate:
            return False
        self._correct(taken.x)
        self.covariance = taken.covariance
        self._since_s = 0.0
        self._seen.append(seen)
        if seen.dt > 0:
            self._instants += 1
            if self._instants in AGAIN_AT:
                for _ in range(AGAIN):
                    self._again()
            if self._instants == AGAIN_AT[-1]:
                self._seen = self._seen[:0]
                self._first = None
        return True

    def _correct(self, x: Floats) -> None:
        """Take the error `x` (11,) off the state."""
        self.rotation = rot.exp(x[:3]) @ self.rotation
        self.angular_rate = self.angular_rate + x[3:6]
        self.ratio = self.ratio + x[6:]

    def _again(self) -> None:
        """Filter all attitudes once more, everything linear about the motion that is known now.

        While the ratios were unknown, the filter was linear about others, and believed what followed from these.
        """
        if self._first is None:
            return
        first, covariance = self._first
        rotation, rate = self.rotation, self.angular_rate
        for seen in reversed(self._seen):
            rotation, rate, _, _ = self._moved(rotation, rate, self.ratio, -seen.dt)
        x = np.concatenate([rot.log(first @ rotation.T), -rate, -self.ratio])
        for seen in self._seen:
            rotation, rate, covariance, transition = self._moved(rotation, rate, self.ratio, seen.dt, covariance)
            x = transition @ x
            y = rot.log(seen.rotation @ rotation.T) - x[:3] - seen.age_s * x[3:6]
            taken = _taken(seen, y, covariance)
            x, covariance = x + taken.x, taken.covariance
        self.rotation, self.angular_rate, self.covariance = rotation, rate, covariance
        self._correct(x)

    def _moved(
        self, rotation: Floats, rate: Floats, ratio: Floats, dt: float, covariance: Floats | None = None
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return attitude, rate, covariance (11, 11) and transition (11, 11) after `dt` [s], which may be negative."""
        many = 1 if covariance is None else 1 + 2 * PARTS
        tensor, inverse = tensors((ratio + _CHANGES)[:many])
        whole = np.eye(6 + PARTS)
        covariance = whole if covariance is None else covariance
        if dt == 0:
            return rotation, rate, covariance, whole
        number = max(1, int(np.ceil(abs(dt) * max(1 / STEP_S, float(np.linalg.norm(rate)) / STEP_RAD))))
        dt /= number
        walk = self._walk**2 * np.kron(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(3))
        for _ in range(number):
            moved = free_turns(
                np.ones(many, dtype=np.bool_),
                np.tile(rotation, (many, 1, 1)),
                np.tile(rate, (many, 1)),
                tensor,
                inverse,
                dt,
            )
            if many > 1:
                steady, transition = np.empty((STATES, STATES)), np.eye(6 + PARTS)
                transition_into(rate, dt, steady)
                both = np.concatenate([moved.turn, moved.rate], axis=1)
                transition[:6, :6] = moved.coupling[0] @ steady[:6, :6]
                transition[:6, 6:] = ((both[1 : 1 + PARTS] - both[1 + PARTS :]) / (2 * SMALL)).T
                covariance = transition @ covariance @ transition.T
                covariance[:6, :6] += walk
                whole = transition @ whole
            rotation = rot.exp(moved.turn[0]) @ rot.exp(rate * dt) @ rotation
            rate = rate + moved.rate[0]
        return rotation, rate, covariance, whole

    @property
    def sigma_rad(self) -> float:
        """The largest standard deviation of the attitude about any axis [rad]."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))

    def inertia(self) -> Inertia:
        """Return the ratios of inertia, and how well they are known."""
        known = self.covariance[6:, 6:]
        value, axes = np.linalg.eigh(np.tensordot(self.ratio, BASIS, 1))
        moments = np.exp(value)
        # A moment's logarithm, against the logarithm of their mean.
        of_value = np.einsum("ia,kij,ja->ak", axes, BASIS, axes)
        slope = of_value - (moments / moments.sum()) @ of_value
        moments = 3 * moments / moments.sum()
        share = np.sqrt(np.linalg.eigvalsh(known)) / self._ratio_sigma
        return Inertia(
            axes @ np.diag(moments) @ axes.T,
            moments,
            axes,
            np.sqrt(np.einsum("ak,kl,al->a", slope, known, slope)),
            share,
            int(np.count_nonzero(share < OBSERVED)),
        )


def _taken(seen: _Seen, y: Floats, covariance: Floats) -> _Taken:
    """Return the update by an innovation (3,)."""
    h = np.zeros((3, 6 + PARTS))
    h[:, :3], h[:, 3:6] = np.eye(3), seen.age_s * np.eye(3)
    s = h @ covariance @ h.T + seen.covariance
    gain = np.linalg.solve(s, h @ covariance).T
    left = np.eye(6 + PARTS) - gain @ h
    after = left @ covariance @ left.T + gain @ seen.covariance @ gain.T
    return _Taken(gain @ y, after, float(y @ np.linalg.solve(s, y)))


def tensors(ratio: Floats) -> tuple[Floats, Floats]:
    """Return J and its inverse, (n, 3, 3), of parts q (n, 5)."""
    value, axes = np.linalg.eigh(np.tensordot(ratio, BASIS, 1))
    across = np.swapaxes(axes, -1, -2)
    return (axes * np.exp(value)[..., None, :]) @ across, (axes * np.exp(-value)[..., None, :]) @ across
