"""Error-state extended Kalman filter of every craft's pose and rates: `filterpy.kalman.ExtendedKalmanFilter`.

Kept per craft in the lighthouse frame: R = R_l_b, angular rate w, position p, velocity v. The filter's state is their
error x = (d, dw, dp, dv), 12 numbers, with R_true = Exp([d]x) R and truth minus estimate for the rest. Over dt

    R <- Exp([w]x dt) R,  p <- p + v dt,  x <- F x + Gamma (angular acceleration, acceleration)
    F = [[E, dt J_l], [0, I]] for (d, dw), [[I, dt I], [0, I]] for (dp, dv),  E = Exp([w]x dt), J_l = J_l(w dt)
    Q = Gamma diag(sigma^2) Gamma^T,  Gamma = (dt^2 / 2, dt): accelerations white, constant over each dt

The measurement is the PnP pose (R_z, p_z) with covariance s^2 H of (18). PnP refers its angles to one epoch with the
predicted rates, so their error enters through the coupling B (`estimators.dop`), and the innovation is

    y = (log(R_z R^T), p_z - p) = (d, dp) + B (dw, dv) + noise

After an update R <- Exp([d]x) R, the rest is added, and x is zero again. The reset turns P by d/2, far below the
filter's other linearisations, and is left out. No other file imports filterpy; the kernels serve any other bank.
"""

import math
from typing import NamedTuple

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from scipy.special import gammaincinv

from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from estimators.rotation import exp, exp_into, multiply_into

DEFAULT_ACCELERATION_NOISE_M_S2 = 0.2
"""White acceleration [m/s^2] per axis, constant over a period. docs/filter.md has the table behind the choice."""
DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2 = math.radians(12.0)
"""White angular acceleration [rad/s^2] per axis, constant over a period (docs/filter.md)."""

STATES, POSE = 12, 6
POSE_COLUMNS = np.array([0, 1, 2, 6, 7, 8])
"""Where (attitude, position) sit in the state."""
RATE_COLUMNS = np.array([3, 4, 5, 9, 10, 11])
"""Where (angular rate, velocity) sit in the state."""


class UpdateResult(NamedTuple):
    """`accepted` (C,), and `nis` (C,), the normalised innovation squared of both fates, NaN where masked out."""

    accepted: Bools
    nis: Floats


@kernel
def log_into(rotation: Floats, out: Floats) -> None:
    """Write the rotation vector [rad], at most pi long, of `rotation` (3, 3) into `out` (3,)."""
    m = rotation
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    q = np.empty(4)  # the unit quaternion times an unknown factor
    if trace > 0:
        q[0], q[1], q[2], q[3] = 1 + trace, m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    else:
        i = 0
        if m[1, 1] > m[i, i]:
            i = 1
        if m[2, 2] > m[i, i]:
            i = 2
        j, k = (i + 1) % 3, (i + 2) % 3
        q[0], q[1 + i] = m[k, j] - m[j, k], 1 + m[i, i] - m[j, j] - m[k, k]
        q[1 + j], q[1 + k] = m[i, j] + m[j, i], m[i, k] + m[k, i]
    if q[0] < 0:
        for i in range(4):
            q[i] = -q[i]
    sine = np.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    # atan(s)/s = 1 - s^2/3 + ..., whose next term is below rounding at s = 1e-4.
    scale = 2 * np.arctan2(sine, q[0]) / sine if sine > 1e-4 * q[0] else (2 - 2 * (sine / q[0]) ** 2 / 3) / q[0]
    for i in range(3):
        out[i] = scale * q[1 + i]


@kernel
def transition_into(angular_rate: Floats, dt: float, out: Floats) -> None:
    """Write F (12, 12) for one step `dt` [s] at `angular_rate` (3,) [rad/s] into `out`."""
    v = angular_rate * dt
    square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    angle = np.sqrt(square)
    if angle < 1e-2:
        c, t = 0.5 - square / 24 + square * square / 720, 1 / 6 - square / 120 + square * square / 5040
    else:
        half = np.sin(angle / 2)
        c, t = 2 * half * half / square, (angle - np.sin(angle)) / (angle * square)
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    out[:] = 0.0
    for i in range(STATES):
        out[i, i] = 1.0
    exp_into(v, out[:3, :3])
    for i in range(3):
        for j in range(3):
            # [v]x^2 = v v^T - |v|^2 I
            out[i, 3 + j] = dt * (c * k[i, j] + t * v[i] * v[j])
        out[i, 3 + i] += dt * (1 - t * square)
        out[6 + i, 9 + i] = dt


@kernel
def process_noise_into(dt: float, acceleration: float, angular_acceleration: float, out: Floats) -> None:
    """Write Q (12, 12) into `out`: sigmas [m/s^2], [rad/s^2] per axis, white, constant over `dt` [s]."""
    out[:] = 0.0
    for i in range(STATES):
        sigma = angular_acceleration if i < 6 else acceleration
        if i % 6 < 3:
            out[i, i] = (sigma * dt * dt / 2) ** 2
            out[i, i + 3] = out[i + 3, i] = sigma * sigma * dt * dt * dt / 2
        else:
            out[i, i] = (sigma * dt) ** 2


@kernel
def propagate(rotation: Floats, angular_rate: Floats, position: Floats, velocity: Floats, dt: float) -> None:
    """Move one craft's pose on by `dt` [s] at constant rates, in place."""
    turn, turned = np.empty((3, 3)), np.empty((3, 3))
    exp_into(angular_rate * dt, turn)
    multiply_into(turn, rotation, turned)
    rotation[:] = turned
    for i in range(3):
        position[i] += velocity[i] * dt


@kernel
def innovation_into(
    rotation_z: Floats,
    position_z: Floats,
    rotation: Floats,
    position: Floats,
    rate_coupling: Floats,
    y: Floats,
    h: Floats,
) -> None:
    """Write the innovation into `y` (6, 1) and its matrix H, y = H x + noise, into `h` (6, 12)."""
    difference = np.empty((3, 3))
    multiply_into(rotation_z, rotation.T, difference)
    log_into(difference, y[:3, 0])
    h[:] = 0.0
    for i in range(3):
        y[3 + i, 0] = position_z[i] - position[i]
        h[i, i] = h[3 + i, 6 + i] = 1.0
    for i in range(6):
        for j in range(3):
            h[i, 3 + j], h[i, 9 + j] = rate_coupling[i, j], rate_coupling[i, 3 + j]


@kernel
def correct(rotation: Floats, angular_rate: Floats, position: Floats, velocity: Floats, x: Floats) -> None:
    """Move the estimated error `x` (12, 1) into one craft's pose and rates, and leave it zero."""
    turn, turned = np.empty((3, 3)), np.empty((3, 3))
    exp_into(x[:3, 0], turn)
    multiply_into(turn, rotation, turned)
    rotation[:] = turned
    for i in range(3):
        angular_rate[i] += x[3 + i, 0]
        position[i] += x[6 + i, 0]
        velocity[i] += x[9 + i, 0]
    x[:] = 0.0


class PoseFilterBank:
    """C independent pose filters behind one batch interface; one craft's numbers never depend on another craft.

    Every array carries the craft axis first and every method a mask (C,) of the craft that it concerns; what stands
    elsewhere in the arguments is not read. Attributes are copies, NaN where a craft is not active. Methods raise
    ValueError, naming the argument, on a wrong shape, on values that are not finite and on craft that are not active.

    The public methods check and hold the arrays; `_begin`, `_predict` and `_update` are the filter itself, which a bank
    of another make overrides.
    """

    def __init__(
        self,
        craft_count: int,
        *,
        acceleration_noise_m_s2: float = DEFAULT_ACCELERATION_NOISE_M_S2,
        angular_acceleration_noise_rad_s2: float = DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2,
        gate_probability: float = 0.99999,
    ) -> None:
        """`gate_probability`: share of consistent measurements (chi-square, 6 degrees of freedom) let in; 1: all."""
        for name, sigma in (
            ("acceleration_noise_m_s2", acceleration_noise_m_s2),
            ("angular_acceleration_noise_rad_s2", angular_acceleration_noise_rad_s2),
        ):
            if not 0 <= sigma < np.inf:
                raise ValueError(f"{name}: {sigma} is not a finite number, zero or more")
        if not 0 < gate_probability <= 1:
            raise ValueError(f"gate_probability: {gate_probability} is not in (0, 1]")
        self.acceleration_noise_m_s2 = float(acceleration_noise_m_s2)
        self.angular_acceleration_noise_rad_s2 = float(angular_acceleration_noise_rad_s2)
        self.gate = float(2 * gammaincinv(POSE / 2, gate_probability))
        self._active = np.zeros(craft_count, dtype=np.bool_)
        self._rotation = np.full((craft_count, 3, 3), np.nan)
        self._angular_rate, self._position, self._velocity = np.full((3, craft_count, 3), np.nan)
        self._covariance = np.full((craft_count, STATES, STATES), np.nan)
        self._filter: dict[int, ExtendedKalmanFilter] = {}

    @property
    def active(self) -> Bools:
        """Which craft (C,) have a state."""
        return self._active.copy()

    @property
    def rotation(self) -> Floats:
        """R_l_b (C, 3, 3)."""
        return self._rotation.copy()

    @property
    def angular_rate(self) -> Floats:
        """Angular rates (C, 3) [rad/s] in the lighthouse frame."""
        return self._angular_rate.copy()

    @property
    def position(self) -> Floats:
        """Positions (C, 3) [m]."""
        return self._position.copy()

    @property
    def velocity(self) -> Floats:
        """Velocities (C, 3) [m/s]."""
        return self._velocity.copy()

    @property
    def covariance(self) -> Floats:
        """filterpy's P (C, 12, 12): attitude error, angular rate, position, velocity [rad, rad/s, m, m/s]."""
        return self._covariance.copy()

    def start(
        self,
        mask: Bools,
        rotation: Floats,
        position: Floats,
        covariance: Floats,
        rate_sigma: tuple[float, float],
        rate_coupling: Floats | None = None,
    ) -> None:
        """Start, or start again, from a solved pose, at rest give or take `rate_sigma`.

        rotation (C, 3, 3), position (C, 3) [m], covariance (C, 6, 6) of the pose [rad, m]; `rate_sigma`: one sigma per
        axis of the unknown (angular rate [rad/s], velocity [m/s]); `rate_coupling` (C, 6, 6) [s]: B of this pose where
        it was solved as if at rest, so that the filter knows that the pose is off by B times the rates.
        """
        craft = self._craft(mask, active=False)
        rotation = self._argument("rotation", rotation, (3, 3), craft)
        position = self._argument("position", position, (3,), craft)
        covariance = self._variances(self._argument("covariance", covariance, (POSE, POSE), craft), craft)
        b = np.zeros((len(self._active), POSE, POSE)) if rate_coupling is None else rate_coupling
        b = self._argument("rate_coupling", b, (POSE, POSE), craft)
        if np.shape(rate_sigma) != (2,) or not np.all(np.greater_equal(rate_sigma, 0) & np.isfinite(rate_sigma)):
            raise ValueError(f"rate_sigma: expected two finite sigmas (angular rate, velocity), got {rate_sigma!r}")
        rate_variance = np.diag(np.repeat(np.square(rate_sigma), 3))
        for i in craft:
            # Solved as if at rest: true pose + B rates + noise, so truth minus estimate is -B rates - noise.
            cross = -b[i] @ rate_variance
            p = self._covariance[i]
            p[np.ix_(POSE_COLUMNS, POSE_COLUMNS)] = covariance[i] - cross @ b[i].T
            p[np.ix_(POSE_COLUMNS, RATE_COLUMNS)] = cross
            p[np.ix_(RATE_COLUMNS, POSE_COLUMNS)] = cross.T
            p[np.ix_(RATE_COLUMNS, RATE_COLUMNS)] = rate_variance
            self._rotation[i], self._position[i] = rotation[i], position[i]
            self._angular_rate[i] = self._velocity[i] = 0.0
            self._active[i] = True
            self._begin(i)

    def predict(self, dt: float | Floats, mask: Bools) -> None:
        """Move on by `dt`, a number or (C,) [s], over which the accelerations are taken as constant.

        A longer gap is several calls of one period each: the process noise of one long step is another model.
        """
        craft = self._craft(mask)
        every = np.asarray(dt, dtype=np.float64)
        step = self._argument("dt", np.full(len(self._active), every) if every.ndim == 0 else every, (), craft)
        if np.any(step[craft] < 0):
            raise ValueError(f"dt: {step[craft].min()} s is negative")
        self._predict(craft, step)

    def add_motion(self, mask: Bools, turn: Floats, rate: Floats, shift: Floats, velocity: Floats) -> None:
        """Add known motion to the prediction: what the craft's own actuators did meanwhile.

        turn (C, 3) [rad], R <- Exp([turn]x) R; rate (C, 3) [rad/s]; shift (C, 3) [m]; velocity (C, 3) [m/s]. Known
        exactly, it leaves the covariance as it is.
        """
        craft = self._craft(mask)
        turn, rate = self._argument("turn", turn, (3,), craft), self._argument("rate", rate, (3,), craft)
        shift = self._argument("shift", shift, (3,), craft)
        velocity = self._argument("velocity", velocity, (3,), craft)
        self._rotation[craft] = exp(turn[craft]) @ self._rotation[craft]
        self._angular_rate[craft] += rate[craft]
        self._position[craft] += shift[craft]
        self._velocity[craft] += velocity[craft]

    def update(
        self, mask: Bools, rotation: Floats, position: Floats, covariance: Floats, rate_coupling: Floats
    ) -> UpdateResult:
        """Take in solved poses, each gated by itself: one that is gated out leaves its craft's state as it was.

        rotation (C, 3, 3), position (C, 3) [m], covariance (C, 6, 6) of the pose [rad, m], rate_coupling (C, 6, 6) [s]:
        B of a pose that was solved with this filter's predicted rates; zero where it was solved without.
        """
        craft = self._craft(mask)
        rotation = self._argument("rotation", rotation, (3, 3), craft)
        position = self._argument("position", position, (3,), craft)
        covariance = self._variances(self._argument("covariance", covariance, (POSE, POSE), craft), craft)
        rate_coupling = self._argument("rate_coupling", rate_coupling, (POSE, POSE), craft)
        accepted, nis = np.zeros(len(self._active), dtype=np.bool_), np.full(len(self._active), np.nan)
        self._update(craft, rotation, position, covariance, rate_coupling, accepted, nis)
        return UpdateResult(accepted, nis)

    def stop(self, mask: Bools) -> None:
        """Forget the state of these craft."""
        for i in self._craft(mask, active=False):
            self._active[i] = False
            for array in (self._rotation, self._angular_rate, self._position, self._velocity, self._covariance):
                array[i] = np.nan

    def _begin(self, i: int) -> None:
        """Set up the filter of craft `i`, whose arrays have just been filled."""
        f = self._filter[i] = ExtendedKalmanFilter(STATES, POSE)
        f.P = self._covariance[i].copy()

    def _predict(self, craft: list[int], step: Floats) -> None:
        """Move these craft on by `step` (C,) [s]."""
        for i in craft:
            f = self._filter[i]
            transition_into(self._angular_rate[i], step[i], f.F)
            process_noise_into(step[i], self.acceleration_noise_m_s2, self.angular_acceleration_noise_rad_s2, f.Q)
            f.predict()
            propagate(self._rotation[i], self._angular_rate[i], self._position[i], self._velocity[i], step[i])
            self._covariance[i] = f.P

    def _update(
        self,
        craft: list[int],
        rotation: Floats,
        position: Floats,
        covariance: Floats,
        rate_coupling: Floats,
        accepted: Bools,
        nis: Floats,
    ) -> None:
        """Take in the poses of these craft; write what became of them into `accepted` and `nis`."""
        y, h = np.empty((POSE, 1)), np.empty((POSE, STATES))
        for i in craft:
            f = self._filter[i]
            innovation_into(rotation[i], position[i], self._rotation[i], self._position[i], rate_coupling[i], y, h)
            x_prior, p_prior = f.x, f.P
            try:
                # y is a column, as Hx is: filterpy would broadcast a 1-D measurement into a matrix.
                f.update(y, _matrix, _predicted, R=covariance[i], args=(h,), hx_args=(h,))
                nis[i] = f.mahalanobis**2
            except ValueError as error:  # a singular S, or the root of a negative number
                f.x, f.P = x_prior, p_prior
                raise ValueError(f"covariance: not positive definite for craft {i}") from error
            accepted[i] = nis[i] <= self.gate
            if accepted[i]:
                correct(self._rotation[i], self._angular_rate[i], self._position[i], self._velocity[i], f.x)
                self._covariance[i] = f.P
            else:
                f.x, f.P = x_prior, p_prior

    def _craft(self, mask: Bools, active: bool = True) -> list[int]:
        """The craft that `mask` names; all of them must be active if `active`."""
        mask = np.asarray(mask)
        if mask.shape != self._active.shape or mask.dtype != np.bool_:
            raise ValueError(f"mask: expected {self._active.shape} bool, got {mask.shape} {mask.dtype}")
        idle = mask & ~self._active
        if active and idle.any():
            raise ValueError(f"mask: craft {np.flatnonzero(idle).tolist()} have not been started")
        return np.flatnonzero(mask).tolist()

    def _argument(self, name: str, value: Floats, shape: tuple[int, ...], craft: list[int]) -> Floats:
        """`value` as contiguous floats (C, *shape), finite for these craft."""
        array = np.ascontiguousarray(value, dtype=np.float64)
        expected = (len(self._active), *shape)
        if array.shape != expected:
            raise ValueError(f"{name}: expected shape {expected}, got {array.shape}")
        if not np.isfinite(array[craft]).all():
            raise ValueError(f"{name}: not finite for a craft of the mask")
        return array

    def _variances(self, covariance: Floats, craft: list[int]) -> Floats:
        """`covariance`, with positive variances for these craft."""
        if np.any(np.diagonal(covariance[craft], axis1=-2, axis2=-1) <= 0):
            raise ValueError("covariance: a variance is not positive for a craft of the mask")
        return covariance


def _matrix(x: Floats, h: Floats) -> Floats:
    """H, as filterpy asks for it."""
    return h


def _predicted(x: Floats, h: Floats) -> Floats:
    """H x, as filterpy asks for it: zero, for the state is reset after every update."""
    return h @ x
