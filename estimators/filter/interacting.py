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
from estimators.filter.bank import FilterBank, Given, Independent, UpdateResult
from estimators.filter.error_state import correct, difference_into
from estimators.kernel import kernel
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
        """Add known motion to the models.

        Args:
            mask: (C,), the craft concerned.
            turn: (C, 3) [rad].
            rate: (C, 3) [rad/s].
            shift: (C, 3) [m].
            velocity: (C, 3) [m/s].
        """
        super().add_motion(mask, turn, rate, shift, velocity)
        for bank, own in self._by_model(mask):
            bank.add_motion(own, turn, rate, shift, velocity)

    def stop(self, mask: Bools) -> None:
        """Forget the state of these craft."""
        super().stop(mask)
        for bank in self._models:
            bank.stop(mask)

    def _begin(self, mask: Bools) -> None:
        self.quiet_probability[mask] = self._first[mask]
        self._told[mask] = False
        # Craft without the quiet model have one that stands still: a mixture takes nothing of it, if it is finite.
        for bank in self._models:
            bank.adopt(mask, self._state, self._covariance)

    def _predict(self, mask: Bools, step: Floats) -> None:
        told = mask & self._told
        if told.any():
            _mix_all(told, step, self._leave, self.quiet_probability, *self._arrays())
            for bank in self._models:
                bank._begin(told)
        self._told[mask] = False
        for bank, own in self._by_model(mask):
            bank.predict(step, own)
        self._combine(mask)

    def _update(self, mask: Bools, given: Given | Independent, result: UpdateResult) -> int:
        fates = []
        for bank, own in self._by_model(mask):
            fate, y = self._nothing(), given.y.copy()
            _shift_all(own, self._state, bank._state, given.h, y)
            if (indefinite := bank._update(own, given._replace(y=y), fate)) >= 0:
                return indefinite
            fates.append(fate)
        self._weigh(mask, fates[0], fates[1], given.rows, result)
        return -1

    def _weigh(
        self, mask: Bools, quiet: UpdateResult, manoeuvring: UpdateResult, rows: Ints, result: UpdateResult
    ) -> None:
        """Update the models' probabilities by their likelihoods, and combine them.

        Args:
            mask: (C,), the craft concerned.
            quiet: fates of the rows in the quiet model; nothing of craft without it.
            manoeuvring: likewise in the manoeuvring one.
            rows: (C,), number of rows.
            result: receives the fates.
        """
        either = mask & (quiet.accepted | manoeuvring.accepted)
        both = either & self._both
        with np.errstate(over="ignore", invalid="ignore"):
            ahead = (manoeuvring.nis + manoeuvring.log_determinant - quiet.nis - quiet.log_determinant) / 2
            odds = self.quiet_probability / (1 - self.quiet_probability) * np.exp(np.clip(ahead, -50, 50))
        probability = odds / (1 + odds)
        self.quiet_probability[both] = np.clip(probability, LEAST, 1 - LEAST)[both]
        result.accepted[either] = True
        self._told |= both & (rows >= DECIDING)
        m = self.quiet_probability
        for name in ("nis", "log_determinant"):
            one, other = getattr(quiet, name), getattr(manoeuvring, name)
            getattr(result, name)[mask] = np.where(both, m * one + (1 - m) * other, other)[mask]
        self._combine(either)

    def _by_model(self, mask: Bools) -> tuple[tuple[FilterBank, Bools], tuple[FilterBank, Bools]]:
        """Return both banks, each with the craft of the mask (C,) that have its model."""
        quiet, manoeuvring = self._models
        return (quiet, mask & self._both), (manoeuvring, mask)

    def _arrays(self) -> tuple[State, State, Floats, Floats]:
        """Return the states of both banks, then their covariances."""
        quiet, manoeuvring = self._models
        return quiet._state, manoeuvring._state, quiet._covariance, manoeuvring._covariance

    def _combine(self, mask: Bools) -> None:
        _combine_all(mask, self.quiet_probability, *self._arrays(), self._state, self._covariance)


DECIDING = 6
"""Rows of an update after which models are mixed: those of a pose, or of three photodiodes."""
LEAST = 1e-6
"""Least probability of a model: so much evidence is forgotten."""


@kernel
def _move(state: State, c: int, x: Floats, out: State) -> None:
    """Write craft c of `state`, moved by the error x (12,), into `out`, which may be `state`; x becomes zero."""
    out.rotation[c] = state.rotation[c]
    out.angular_rate[c] = state.angular_rate[c]
    out.position[c], out.velocity[c] = state.position[c], state.velocity[c]
    correct(out.rotation[c], out.angular_rate[c], out.position[c], out.velocity[c], x)


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
        difference_into(quiet, manoeuvring, c, apart)
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
        difference_into(quiet, manoeuvring, c, apart)
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
        difference_into(own, mean, c, apart)
        for a in range(y.shape[1]):
            for i in range(STATES):
                y[c, a] -= h[c, a, i] * apart[i]
