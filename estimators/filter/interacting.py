"""Two models of motion side by side, quiet and manoeuvring: the interacting multiple model filter.

Both models are the same filter with process noise of its own. A craft stays in model i for a mean time of t_i, so that
over dt it changes with the probability p_ij = dt / t_i. With the models' probabilities m_i, per prediction

    c_j = sum_i p_ij m_i,   m_i|j = p_ij m_i / c_j                                   mixing: model j starts from
    x_j <- mean of the x_i weighted by m_i|j,   P_j likewise, with the spread of the means

and after an update with the innovations' likelihoods N(y_j; 0, S_j)

    m_j <- c_j N_j / sum_i c_i N_i,   N_j = exp(-NIS_j / 2) / sqrt(det S_j)

The estimate is the mean and the covariance of the mixture (H. Blom, Y. Bar-Shalom, IEEE Trans. Automatic Control 33,
1988). Means are taken in the error state at the manoeuvring model's state. Innovations come in for the mixture's mean
x; a model's own is y_j = y - H (x_j - x). A measurement is let in if either model's gate does; a model that refuses it
keeps its state, and starts from the other one's at the next mixing.

Models are mixed after updates with `DECIDING` rows or more only. In the dark, or by one or two photodiodes, nothing
tells the models apart: there mixing would make a quiet craft a manoeuvring one within t_i, and its prediction useless.
"""

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import FilterBank, Given, Independent, Result
from estimators.kernel import kernel
from estimators.rotation import exp_into, log_into, multiply_into
from estimators.state import STATES, State


class InteractingBank(FilterBank):
    """C craft, each with a quiet and a manoeuvring filter.

    quiet_probability: probability of the quiet model, (C,).
    """

    def __init__(
        self,
        quiet: FilterBank,
        manoeuvring: FilterBank,
        quiet_s: float,
        manoeuvre_s: float,
        may_be_quiet: Bools | None = None,
    ) -> None:
        """Interact two banks of the same craft.

        Args:
            quiet: bank with the process noise of a craft that flies freely.
            manoeuvring: bank with that of a craft that is pushed.
            quiet_s: mean time that a craft stays quiet [s].
            manoeuvre_s: mean time that it manoeuvres [s].
            may_be_quiet: (C,), craft that have the quiet model; the others' numbers are those of the manoeuvring bank
                alone; None: all.
        """
        super().__init__(
            len(quiet.active),
            acceleration_noise_m_s2=manoeuvring.acceleration_noise_m_s2,
            angular_acceleration_noise_rad_s2=manoeuvring.angular_acceleration_noise_rad_s2,
            gate_probability=manoeuvring.gate_probability,
        )
        self._models = quiet, manoeuvring
        self._leave = 1 / quiet_s, 1 / manoeuvre_s
        self._both = np.ones(len(self._active), dtype=np.bool_) if may_be_quiet is None else may_be_quiet.copy()
        self._first = np.where(self._both, quiet_s / (quiet_s + manoeuvre_s), 0.0)
        self.quiet_probability = self._first.copy()
        self._told = np.zeros(len(self._active), dtype=np.bool_)

    def add_motion(self, mask: Bools, turn: Floats, rate: Floats, shift: Floats, velocity: Floats) -> None:
        """Add known motion to both models.

        Args:
            mask: (C,), the craft concerned.
            turn: (C, 3) [rad].
            rate: (C, 3) [rad/s].
            shift: (C, 3) [m].
            velocity: (C, 3) [m/s].
        """
        super().add_motion(mask, turn, rate, shift, velocity)
        for bank in self._models:
            bank.add_motion(mask, turn, rate, shift, velocity)

    def stop(self, mask: Bools) -> None:
        """Forget the state of these craft."""
        super().stop(mask)
        self.quiet_probability[mask] = self._first[mask]
        for bank in self._models:
            bank.stop(mask)

    def _begin(self, mask: Bools) -> None:
        self.quiet_probability[mask] = self._first[mask]
        self._told[mask] = False
        for bank in self._models:
            bank.adopt(mask, self._state, self._covariance)

    def _predict(self, mask: Bools, step: Floats) -> None:
        quiet, manoeuvring = self._models
        states, covariances = (quiet.state, manoeuvring.state), (quiet.covariance, manoeuvring.covariance)
        told = mask & self._told
        _mix_all(told, step, self._leave, self.quiet_probability, *states, *covariances)
        self._told[mask] = False
        for bank, state, covariance in zip(self._models, states, covariances, strict=True):
            bank.adopt(told, state, covariance)
            bank.predict(step, mask)
        self._combine(mask)

    def _update(self, mask: Bools, given: Given, result: Result) -> int:
        fates = []
        for bank in self._models:
            fate = np.zeros_like(result[0]), np.full_like(result[1], np.nan), np.full_like(result[2], np.nan)
            own = given._replace(y=self._own(mask, bank, given.y, given.h))
            if (indefinite := bank._update(mask, own, fate)) >= 0:
                return indefinite
            fates.append(fate)
        self._weigh(mask, fates[0], fates[1], given.rows, result)
        return -1

    def _update_independent(self, mask: Bools, given: Independent, result: Result) -> None:
        fates = []
        for bank in self._models:
            fate = np.zeros_like(result[0]), np.full_like(result[1], np.nan), np.full_like(result[2], np.nan)
            bank._update_independent(mask, given._replace(y=self._own(mask, bank, given.y, given.h)), fate)
            fates.append(fate)
        self._weigh(mask, fates[0], fates[1], given.rows, result)

    def _own(self, mask: Bools, bank: FilterBank, y: Floats, h: Floats) -> Floats:
        """Return the innovations (C, m) of one model from the mixture's."""
        out = y.copy()
        _shift_all(mask, self._state, bank.state, h, out)
        return out

    def _weigh(
        self,
        mask: Bools,
        quiet: Result,
        manoeuvring: Result,
        rows: Ints,
        result: Result,
    ) -> None:
        """Update the models' probabilities by their likelihoods, and combine them."""
        accepted, nis, log_determinant = result
        either = mask & ((quiet[0] & self._both) | manoeuvring[0])
        with np.errstate(over="ignore", invalid="ignore"):
            ahead = (manoeuvring[1] + manoeuvring[2] - quiet[1] - quiet[2]) / 2
            odds = self.quiet_probability / (1 - self.quiet_probability) * np.exp(np.clip(ahead, -50, 50))
        probability = odds / (1 + odds)
        self.quiet_probability[either] = np.where(self._both, np.clip(probability, LEAST, 1 - LEAST), 0.0)[either]
        accepted[either] = True
        self._told |= either & self._both & (rows >= DECIDING)
        m = self.quiet_probability
        for out, one, other in ((nis, quiet[1], manoeuvring[1]), (log_determinant, quiet[2], manoeuvring[2])):
            out[mask] = np.where(either, m * one + (1 - m) * other, other)[mask]
        self._combine(either)

    def _combine(self, mask: Bools) -> None:
        quiet, manoeuvring = self._models
        banks = quiet.state, manoeuvring.state, quiet.covariance, manoeuvring.covariance
        _combine_all(mask, self.quiet_probability, *banks, self._state, self._covariance)


DECIDING = 6
"""Rows of an update after which models are mixed: those of a pose, or of three photodiodes."""
LEAST = 1e-6
"""Least probability of a model: so much evidence is forgotten."""


@kernel
def _difference(one: State, other: State, c: int, out: Floats) -> None:
    """Write the error (12,) by which craft c of `one` is off from `other`."""
    turn = np.empty((3, 3))
    multiply_into(one.rotation[c], other.rotation[c].T, turn)
    log_into(turn, out[:3])
    for i in range(3):
        out[3 + i] = one.angular_rate[c, i] - other.angular_rate[c, i]
        out[6 + i] = one.position[c, i] - other.position[c, i]
        out[9 + i] = one.velocity[c, i] - other.velocity[c, i]


@kernel
def _move(state: State, c: int, x: Floats, out: State) -> None:
    """Write craft c of `state`, moved by the error x (12,), into `out`, which may be `state`."""
    turn, turned = np.empty((3, 3)), np.empty((3, 3))
    exp_into(x[:3], turn)
    multiply_into(turn, state.rotation[c], turned)
    out.rotation[c] = turned
    for i in range(3):
        out.angular_rate[c, i] = state.angular_rate[c, i] + x[3 + i]
        out.position[c, i] = state.position[c, i] + x[6 + i]
        out.velocity[c, i] = state.velocity[c, i] + x[9 + i]


@kernel
def _blend(weight: float, apart: Floats, p: Floats, other: Floats, out: Floats) -> None:
    """Write the covariance of two models, weights `weight` and the rest, whose means are `apart` (12,), into `out`."""
    spread = weight * (1 - weight)
    for i in range(STATES):
        for j in range(STATES):
            out[i, j] = weight * p[i, j] + (1 - weight) * other[i, j] + spread * apart[i] * apart[j]


@kernel
def _mix_all(
    mask: Bools,
    step: Floats,
    leave: tuple[float, float],
    probability: Floats,
    quiet: State,
    manoeuvring: State,
    quiet_p: Floats,
    manoeuvring_p: Floats,
) -> None:
    """Mix the models of the craft of the mask in place, and move their probabilities on by step (C,) [s]."""
    apart, moved = np.empty(STATES), np.empty(STATES)
    first, second = np.empty((STATES, STATES)), np.empty((STATES, STATES))
    for c in range(len(mask)):
        if not mask[c]:
            continue
        goes, comes = min(step[c] * leave[0], 0.5), min(step[c] * leave[1], 0.5)
        m = probability[c]
        stays = (1 - goes) * m
        next_m = stays + comes * (1 - m)
        in_quiet, in_manoeuvring = stays / next_m, goes * m / (1 - next_m)
        probability[c] = next_m
        _difference(quiet, manoeuvring, c, apart)
        _blend(in_quiet, apart, quiet_p[c], manoeuvring_p[c], first)
        _blend(in_manoeuvring, apart, quiet_p[c], manoeuvring_p[c], second)
        quiet_p[c], manoeuvring_p[c] = first, second
        for i in range(STATES):
            moved[i] = in_quiet * apart[i]
        _move(manoeuvring, c, moved, quiet)
        for i in range(STATES):
            moved[i] = in_manoeuvring * apart[i]
        _move(manoeuvring, c, moved, manoeuvring)


@kernel
def _combine_all(
    mask: Bools,
    probability: Floats,
    quiet: State,
    manoeuvring: State,
    quiet_p: Floats,
    manoeuvring_p: Floats,
    out: State,
    covariance: Floats,
) -> None:
    """Write the mean and the covariance of the mixtures of the craft of the mask."""
    apart, moved = np.empty(STATES), np.empty(STATES)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        _difference(quiet, manoeuvring, c, apart)
        _blend(probability[c], apart, quiet_p[c], manoeuvring_p[c], covariance[c])
        for i in range(STATES):
            moved[i] = probability[c] * apart[i]
        _move(manoeuvring, c, moved, out)


@kernel
def _shift_all(mask: Bools, mean: State, own: State, h: Floats, y: Floats) -> None:
    """Take H times the difference of a model's state from the mixture's mean off the innovations y (C, m)."""
    apart = np.empty(STATES)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        _difference(own, mean, c, apart)
        for a in range(y.shape[1]):
            for i in range(STATES):
                y[c, a] -= h[c, a, i] * apart[i]
