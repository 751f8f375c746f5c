"""The fixed-interval smoother of Rauch, Tung and Striebel on the error state: what every period's pose was, given all.

A filter leaves for each period k its prediction (X-, P-), made over the transition F from k - 1, and its estimate
(X, P) after the measurements. From the last period back, with the smoothed (Xs, Ps) of k + 1 and its prediction,

    e = Xs(k+1) - X-(k+1) = (log(Rs R-^T), ws - w-, ps - p-, vs - v-)
    G = P F^T (P-)^-1,   x = G e
    Xs = X + x = (Exp(d) R, w + dw, p + dp, v + dv),   Ps = P + G (Ps(k+1) - P-(k+1)) G^T

A covariance belongs to the state from which its error is counted. Ps(k+1) is of errors counted from Xs(k+1), and the
gain takes errors counted from X-(k+1); the sum is of errors counted from X, and the result is to be of errors counted
from Xs. Both steps turn the attitude's part by the Jacobian J_l of the difference between the two states,

    Exp(e') = Exp(e) Exp(d),   e' = d + J_l(d)^-1 e,

which matters where a pose moves the filter far, as after coasting in the dark. Process noise does not occur: whatever
made P- of P, one noise or several, is in P- already, and known motion (own orders, an orbit) is in X-. A filter that
was started, or started again, in k + 1 is not continued from k, and its smoother ends there: Xs = X.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank
from estimators.filter.error_state import STATES, correct, difference_into
from estimators.kernel import kernel
from estimators.linear import cholesky_into
from estimators.rotation import left_jacobian_into
from estimators.state import State, unknown


class Prediction(NamedTuple):
    """Predictions of C filters to one epoch, before its measurements; NaN where a filter was not active.

    continued: whether the estimate at this epoch goes on from the one a period ago, (C,): False where the filter was
    started in between. state: of the C craft. covariance: (C, 12, 12). transition: F over the period, (C, 12, 12).
    """

    continued: Bools
    state: State
    covariance: Floats
    transition: Floats

    def continuing(self, mask: Bools) -> "Prediction":
        """Return the same, with the craft out of the mask (C,) not continued."""
        return self._replace(continued=self.continued & mask)


def predicted(bank: FilterBank, dt: float, predict: Callable[[], Floats | None]) -> Prediction:
    """Predict the active filters of a bank, and return the prediction that a smoother needs.

    Args:
        bank: the filters.
        dt: length of the step [s].
        predict: moves the bank on by `dt`, with all known motion; returns what that makes of an error of attitude and
            angular rate, (C, 6, 6), or None if it leaves it as it is.

    Returns:
        The prediction, as if no filter were started at this epoch: `continued` are those that were active before.
    """
    active, transition = bank.active, bank.transition(dt)
    coupling = predict()
    if coupling is not None:
        transition[:, :6] = coupling @ transition[:, :6]
    return Prediction(active, bank.state, bank.covariance, transition)


class Estimates(NamedTuple):
    """Estimates of C filters at one epoch, after its measurements; NaN where a filter was not active.

    state: of the C craft. covariance: (C, 12, 12).
    """

    state: State
    covariance: Floats


class Smoother:
    """The backward pass over C filters: `step` takes one period after the other, the last one first."""

    def __init__(self, craft_count: int) -> None:
        """Begin behind the last period, about which nothing more is known."""
        nothing = np.full((craft_count, STATES, STATES), np.nan)
        self._later = Estimates(unknown(craft_count), nothing)
        self._ahead = Prediction(np.zeros(craft_count, dtype=np.bool_), self._later.state, nothing, nothing)

    def step(self, filtered: Estimates, prediction: Prediction) -> Estimates:
        """Smooth the period before the one of the last call.

        Args:
            filtered: estimates of the filters.
            prediction: predictions from which the filters made these estimates; read by the next call.

        Raises:
            ValueError: a prediction's covariance is not positive definite, or not finite where it is needed.
        """
        out = Estimates(
            State(*(np.array(part, dtype=np.float64) for part in filtered.state)),
            np.array(filtered.covariance, dtype=np.float64),
        )
        ahead, later = self._ahead, self._later
        failed = _smooth_all(
            ahead.continued, ahead.state, ahead.covariance, ahead.transition, later.state, later.covariance, *out
        )
        if failed >= 0:
            raise ValueError(f"prediction: the covariance of craft {failed} is not positive definite")
        self._later, self._ahead = out, prediction
        return out


@kernel
def _inverted(m: Floats, out: Floats) -> None:
    """Write the inverse of `m` (3, 3), by its cofactors, into `out`."""
    for i in range(3):
        for j in range(3):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            out[j, i] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    determinant = m[0, 0] * out[0, 0] + m[0, 1] * out[1, 0] + m[0, 2] * out[2, 0]
    for i in range(3):
        for j in range(3):
            out[i, j] /= determinant


@kernel
def _turn_attitude(covariance: Floats, by: Floats, work: Floats) -> None:
    """Turn the attitude's part of `covariance` (12, 12) by the matrix `by` (3, 3), in place; work: (12, 12)."""
    for i in range(STATES):
        for j in range(STATES):
            if i < 3:
                work[i, j] = by[i, 0] * covariance[0, j] + by[i, 1] * covariance[1, j] + by[i, 2] * covariance[2, j]
            else:
                work[i, j] = covariance[i, j]
    for i in range(STATES):
        for j in range(STATES):
            if j < 3:
                covariance[i, j] = work[i, 0] * by[j, 0] + work[i, 1] * by[j, 1] + work[i, 2] * by[j, 2]
            else:
                covariance[i, j] = work[i, j]


@kernel
def _product_into(a: Floats, b: Floats, out: Floats) -> None:
    """Write a b, all (12, 12), into `out`."""
    for i in range(STATES):
        for j in range(STATES):
            out[i, j] = 0.0
        for k in range(STATES):
            factor = a[i, k]
            if factor != 0.0:
                for j in range(STATES):
                    out[i, j] += factor * b[k, j]


@kernel
def _solve_columns(lower: Floats, b: Floats) -> None:
    """Solve L L^T X = B in place, all (12, 12): `b` becomes X."""
    for i in range(STATES):
        for k in range(i):
            for j in range(STATES):
                b[i, j] -= lower[i, k] * b[k, j]
        for j in range(STATES):
            b[i, j] /= lower[i, i]
    for i in range(STATES - 1, -1, -1):
        for k in range(i + 1, STATES):
            for j in range(STATES):
                b[i, j] -= lower[k, i] * b[k, j]
        for j in range(STATES):
            b[i, j] /= lower[i, i]


@kernel
def _smooth_all(
    continued: Bools,
    predicted: State,
    predicted_covariance: Floats,
    transition: Floats,
    later: State,
    later_covariance: Floats,
    state: State,
    covariance: Floats,
) -> int:
    """Smooth the filtered `state` and `covariance` of all craft in place, where the next period continues them.

    Returns -1, or the first craft whose predicted covariance is not positive definite.
    """
    lower, gain, spread, work = (
        np.empty((STATES, STATES)),
        np.empty((STATES, STATES)),
        np.empty((STATES, STATES)),
        np.empty((STATES, STATES)),
    )
    e, x = np.empty(STATES), np.empty(STATES)
    jacobian, inverse = np.empty((3, 3)), np.empty((3, 3))
    for c in range(len(continued)):
        if not continued[c]:
            continue
        if not cholesky_into(predicted_covariance[c], lower):
            return c
        # G^T = (P-)^-1 F P, its rows those of k + 1.
        _product_into(transition[c], covariance[c], gain)
        _solve_columns(lower, gain)

        difference_into(later, predicted, c, e)
        for i in range(STATES):
            x[i] = 0.0
            for k in range(STATES):
                x[i] += gain[k, i] * e[k]

        for i in range(STATES):
            for j in range(STATES):
                spread[i, j] = later_covariance[c, i, j]
        left_jacobian_into(e[:3], jacobian)
        _inverted(jacobian, inverse)
        _turn_attitude(spread, inverse, work)
        for i in range(STATES):
            for j in range(STATES):
                spread[i, j] -= predicted_covariance[c, i, j]
        _product_into(spread, gain, work)
        for i in range(STATES):
            for j in range(i + 1):
                value = 0.0
                for k in range(STATES):
                    value += gain[k, i] * work[k, j] + gain[k, j] * work[k, i]
                # Half of each: the sum of a product and its mirror image is symmetric to the last bit.
                covariance[c, i, j] += value / 2
                covariance[c, j, i] = covariance[c, i, j]
        left_jacobian_into(x[:3], jacobian)
        _turn_attitude(covariance[c], jacobian, work)
        correct(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], x)
    return -1
