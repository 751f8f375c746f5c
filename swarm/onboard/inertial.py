"""Gyroscope and accelerometer of an object in the light of stations, with their biases and gravity as further states.

With the rate g and the specific force f that they show in the body frame, at an epoch or in the mean of a period T:

    prediction   a = R (f - b_f) - u,    p <- p + v T + a T^2 / 2,    v <- v + a T,    w <- w + R (g - g_before)
    row          g = R^T w + b_g + noise

u is what an accelerometer at rest shows, gravity upwards in the world. The filter of pose and rates has twelve states
and knows nothing of b = (b_g, b_f, u): they are estimated beside it, which is exact (B. Friedland's separate biases).
With the rows y = H x + D b + noise of covariance R, P the filter's covariance before them, and V what an error of b
makes of the filter's state,

    prediction   V <- F V + dx/db                                      rows   V <- V - K (H V + D),  K = P H^T S^-1
    P_b^-1 <- P_b^-1 + (H V + D)^T S^-1 (H V + D),    S = R + H P H^T
    b <- b + db,  x <- x + V db,    db = P_b (H V + D)^T S^-1 y

and the covariance that is told is P + V P_b V^T. Every row of light tells of b by H V.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank
from estimators.filter.error_state import process_noise_into
from estimators.state import STATES, State
from swarm.onboard.place_errors import PlaceErrors

ACCELERATION_M_S2, ANGULAR_ACCELERATION_RAD_S2 = 2.0, 3.0
"""Process noise beside what was measured: samples are some milliseconds off, and the sensor is not in the origin."""
RATE_RAD_S = 0.05
"""Noise of a rate [rad/s]: a hand changes it by as much between two samples."""
FORCE_M_S2 = 1.0
"""Noise of a specific force [m/s^2]."""
BIAS_RATE_RAD_S, BIAS_FORCE_M_S2 = 0.03, 0.5
"""Standard deviations of the biases before anything is known of them, per axis."""
REFUSED = 3
"""Periods after one another in which a rate contradicts a filter before that is stopped: the rate is no mistake."""
BIASES = 9


class InertialLight(NamedTuple):
    """Readings of the sensors of C objects, NaN of those that had none or have a gap.

    rate: at the epoch, (C, 3) [rad/s]. before: at the one before. force: specific force, mean of the period that ends
    at the epoch, (C, 3) [m/s^2]. Body frame.
    """

    rate: Floats
    before: Floats
    force: Floats

    @property
    def known(self) -> Bools:
        """The objects (C,) whose sensors showed something."""
        out: Bools = np.isfinite(np.concatenate([self.rate, self.before, self.force], axis=1)).all(axis=1)
        return out


@dataclass(frozen=True)
class InertialSensors:
    """Gravity, which an accelerometer at rest shows, upwards.

    gravity_m_s2: (3,), in the world. sigma_m_s2: its standard deviation per axis.
    """

    gravity_m_s2: tuple[float, float, float]
    sigma_m_s2: float


class Inertial:
    """Inertial sensors of C objects beside the bank of their filters.

    bias: (C, 9), of the gyroscope [rad/s], of the accelerometer, and gravity upwards in the world [m/s^2].
    """

    def __init__(self, craft: int, known: InertialSensors) -> None:
        """Begin with what is known of the sensors of C objects, and no bias."""
        self.bias = np.zeros((craft, BIASES))
        self.bias[:, 6:] = known.gravity_m_s2
        sigma = np.repeat([BIAS_RATE_RAD_S, BIAS_FORCE_M_S2, known.sigma_m_s2], 3)
        self._variance = np.tile(np.diag(sigma**2), (craft, 1, 1))
        self._sensitivity = np.zeros((craft, STATES, BIASES))
        self._refused = np.zeros(craft, dtype=np.int64)

    def begin(self, bank: FilterBank, frame_s: float) -> None:
        """Take along what the next prediction makes of the biases, before it is made."""
        moved = bank.transition(frame_s) @ self._sensitivity
        self._sensitivity = np.where(bank.active[:, None, None], moved, 0.0)

    def carry(self, bank: FilterBank, shown: InertialLight, frame_s: float, hand: tuple[float, float]) -> Floats:
        """Move predictions on by what was shown; return what that makes of an error of the state, (C, 12, 12).

        Args:
            bank: the filters, predicted at constant rates without process noise.
            shown: by the sensors.
            frame_s: period [s].
            hand: process noise of an object of which nothing was shown [m/s^2, rad/s^2].
        """
        known, dt = shown.known & bank.active, frame_s
        state, covariance = bank.state, bank.covariance
        noise = np.empty((2, STATES, STATES))
        process_noise_into(dt, *hand, noise[0])
        process_noise_into(dt, ACCELERATION_M_S2, ANGULAR_ACCELERATION_RAD_S2, noise[1])
        coupling = np.tile(np.eye(STATES), (len(known), 1, 1))
        for c in np.flatnonzero(known).tolist():
            coupling[c] = self._moved(c, state, shown, dt)
        carried = coupling @ covariance @ np.swapaxes(coupling, 1, 2) + noise[known.astype(np.int64)]
        bank.adopt(bank.active, state, carried)
        return coupling

    def rates(self, bank: FilterBank, shown: InertialLight, places: PlaceErrors) -> Bools:
        """Give the filters the angular rates that were shown, and stop those that contradict them `REFUSED` times in a
        row; return who contradicts them, (C,).

        Args:
            bank: the filters, carried on.
            shown: by the sensors.
            places: the errors that the filters consider.
        """
        known, state = shown.known & bank.active, bank.state
        y, h = np.zeros((len(known), 3)), np.zeros((len(known), 3, STATES))
        for c in np.flatnonzero(known).tolist():
            body = state.rotation[c].T
            y[c] = shown.rate[c] - self.bias[c, :3] - body @ state.angular_rate[c]
            h[c, :, :3], h[c, :, 3:6] = body @ rot.skew(state.angular_rate[c]), body
        before = bank.covariance
        result = bank.update(known, y, h, np.full_like(y, RATE_RAD_S**2))
        d = np.zeros((3, BIASES))
        d[:, :3] = np.eye(3) / RATE_RAD_S
        for c in np.flatnonzero(known & result.accepted).tolist():
            gain = self.rows(c, y[c] / RATE_RAD_S, h[c] / RATE_RAD_S, bank, before[c], d)
            places.updated(c, gain / RATE_RAD_S, h[c])
        contradicted: Bools = known & ~result.accepted
        self._refused = np.where(contradicted, self._refused + 1, 0)
        bank.stop(self._refused >= REFUSED)
        return contradicted

    def _moved(self, c: int, state: State, shown: InertialLight, dt: float) -> Floats:
        """Move one predicted state on by what was shown, in place; return what that makes of its error, (12, 12)."""
        rotation = state.rotation[c]
        half = rot.exp(-0.5 * dt * state.angular_rate[c][None])[0] @ rotation
        force = half @ (shown.force[c] - self.bias[c, 3:6])
        push, faster = force - self.bias[c, 6:], rotation @ (shown.rate[c] - shown.before[c])
        state.rotation[c] = rot.exp(0.5 * dt * faster[None])[0] @ rotation
        state.angular_rate[c] += faster
        state.position[c] += push * dt**2 / 2
        state.velocity[c] += push * dt
        coupling = np.eye(STATES)
        coupling[6:9, :3], coupling[9:12, :3] = -rot.skew(force) * dt**2 / 2, -rot.skew(force) * dt
        coupling[3:6, :3], coupling[:3, :3] = -rot.skew(faster), np.eye(3) - rot.skew(faster) * dt / 2
        v = coupling @ self._sensitivity[c]
        for first, by in ((3, half), (6, np.eye(3))):
            v[6:9, first : first + 3] -= by * dt**2 / 2
            v[9:12, first : first + 3] -= by * dt
        self._sensitivity[c] = v
        return coupling

    def rows(
        self, craft: int, y: Floats, h: Floats, bank: FilterBank, before: Floats, d: Floats | None = None
    ) -> Floats:
        """Learn from rows that a filter has taken in, and correct it by what they tell of the biases.

        The gain is made of the covariance before: that afterwards has been moved along with a wide correction about a
        photodiode, and no longer belongs to these derivatives.

        Args:
            craft: its index.
            y: (n,), innovations, of noise with variance one.
            h: (n, 12), their derivatives by the state.
            bank: the filters afterwards.
            before: (12, 12), covariance of this one before.
            d: (n, 9), their derivatives by the biases themselves; None: zero.

        Returns:
            The filter's gain (12, n).
        """
        v, variance = self._sensitivity[craft], self._variance[craft]
        hb = h @ v if d is None else h @ v + d
        certain = np.linalg.inv(np.eye(len(y)) + h @ before @ h.T)
        gain: Floats = before @ h.T @ certain
        root = np.linalg.cholesky(variance)
        information = np.eye(BIASES) + root.T @ hb.T @ certain @ hb @ root
        self._variance[craft] = root @ np.linalg.solve(information, root.T)
        self._variance[craft] = 0.5 * (self._variance[craft] + self._variance[craft].T)
        found = self._variance[craft] @ hb.T @ certain @ y
        v = self._sensitivity[craft] = v - gain @ hb
        self.bias[craft] += found
        x = np.zeros((len(bank.active), STATES))
        x[craft] = v @ found
        only = np.arange(len(bank.active)) == craft
        bank.add_motion(only, x[:, :3], x[:, 3:6], x[:, 6:9], x[:, 9:12])
        return gain

    def started(self, craft: int) -> None:
        """Begin anew with a filter that starts with a state solved from rows of light: biases are not in it."""
        self._sensitivity[craft] = 0.0

    def of_biases(self) -> Floats:
        """Return what the biases add to the covariances, (C, 12, 12)."""
        out: Floats = self._sensitivity @ self._variance @ np.swapaxes(self._sensitivity, 1, 2)
        return out

    def cost(self, craft: int, state: State, covariance: Floats, shown: InertialLight, push_m_s2: float) -> Floats:
        """Return by how much states (N,) of one object contradict its sensors, chi-square of six each.

        Args:
            craft: the object.
            state: of N solutions.
            covariance: (N, 12, 12), of each.
            shown: by the sensors.
            push_m_s2: acceleration that is likely, per axis, 1 sigma.
        """
        out = np.zeros(len(state.position))
        if not shown.known[craft]:
            return out
        variance = np.diag(self._variance[craft])
        around = variance[3:6].max() + variance[6:].max() + push_m_s2**2 + FORCE_M_S2**2
        for i in range(len(out)):
            r = state.rotation[i]
            rate = r @ (shown.rate[craft] - self.bias[craft, :3]) - state.angular_rate[i]
            force = r @ (shown.force[craft] - self.bias[craft, 3:6]) - self.bias[craft, 6:]
            of_rate = covariance[i, 3:6, 3:6] + (variance[:3].max() + RATE_RAD_S**2) * np.eye(3)
            out[i] = rate @ np.linalg.solve(of_rate, rate) + force @ force / around
        return out
