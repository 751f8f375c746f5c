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
made P- of P is in P- already, and known motion (own orders, an orbit) is in X-. A filter that was started, or started
again, in k + 1 is not continued from k, and its smoother ends there: Xs = X.

Of a filter with several models of motion (`estimators.filter.interacting`) every model has a smoother of its own, with
the errors x_j of its prediction and of its smoothed state counted from the states that all models share. What model j
started from is F^-1 (P-_j - Q_j) F^-T. Where models have been mixed, or one has begun as a copy of another, with model
j afterwards made of the models i before in the shares w_ji (C.-J. Kim, J. Econometrics 60, 1994),

    m_i = sum_j w_ji ms_j,   (x_i, P_i) those of the mixture of (xs_j, Ps_j) with the weights w_ji ms_j / m_i,

and the smoothed estimate is the mean, with the covariance, of the mixture of all models, with the probabilities that
they have given all. What came later thus tells also how the craft has moved: a filter that takes one in seven of the
periods of a manoeuvring craft for quiet ones is smoothed as a manoeuvring one. That model i knows of what came later
only as much as j tells it, and nothing of how well it fits itself, is what makes this an approximation; with weights
and states of the products of normal distributions in its place the results were the same.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank
from estimators.filter.error_state import STATES, correct, difference_into, process_noise_into
from estimators.filter.interacting import InteractingBank, Mixtures
from estimators.kernel import kernel
from estimators.lanes import LANES
from estimators.linear import cholesky_into
from estimators.rotation import left_jacobian_into
from estimators.state import State, unknown

NEGLIGIBLE = 1e-9
"""Probability, given all, of a model that is not smoothed."""
ALIKE = 1e-3
"""Share of a variance by which that of the models' mixture may be off the estimate's."""


class Models(NamedTuple):
    """Predictions of the L models of motion that C filters run, and what became of the models in the period.

    probability: after the measurements, (C, L); NaN of a filter that has one model. mean, covariance: of the predicted
    errors, (C, L, 12) and (C, L, 12, 12). sigma: process noises, (C, L, 2) [m/s^2], [rad/s^2]. noise: that of a unit
    of both, (C, 12, 12). mixed: shares in which the models, in rows, were made of those before the prediction,
    (C, L, L). moved: likewise since the prediction; zero where the models have begun anew. last_mean, last_covariance:
    after the measurements, counted from the estimate, (C, L, 12) and (C, L, 12, 12), which a smoother needs where a
    filter ends; NaN where they are not known.
    """

    probability: Floats
    mean: Floats
    covariance: Floats
    sigma: Floats
    noise: Floats
    mixed: Floats
    moved: Floats
    last_mean: Floats
    last_covariance: Floats

    def of(self, bank: FilterBank) -> "Models":
        """Return the same, with what has become of the models of a bank in the period."""
        assert isinstance(bank, InteractingBank)
        mixtures = bank.mixtures
        mean, covariance = _by_lanes(mixtures)
        return self._replace(
            probability=mixtures.probability, moved=mixtures.moved, last_mean=mean, last_covariance=covariance
        )


def _by_lanes(mixtures: Mixtures) -> tuple[Floats, Floats]:
    """Return means (C, L, 12) and covariances (C, L, 12, 12) of all models."""
    mean, triangle = (np.moveaxis(a, -1, 1) for a in (mixtures.mean, mixtures.covariance))
    covariance = np.empty((*mean.shape, STATES))
    rows, columns = np.tril_indices(STATES)
    covariance[..., rows, columns] = covariance[..., columns, rows] = triangle
    return np.ascontiguousarray(mean), covariance


def no_models(craft_count: int) -> Models:
    """Return what there is of filters with one model of motion."""
    lanes = (craft_count, LANES)
    shapes = (), (STATES,), (STATES, STATES), (2,), None, (LANES,), (LANES,), (STATES,), (STATES, STATES)
    parts = (np.full((craft_count, STATES, STATES) if s is None else (*lanes, *s), np.nan) for s in shapes)
    return Models(*parts)


class Prediction(NamedTuple):
    """Predictions of C filters to one epoch, before its measurements; NaN where a filter was not active.

    continued: whether the estimate at this epoch goes on from the one a period ago, (C,): False where the filter was
    started in between. state: of the C craft. covariance: (C, 12, 12). transition: F over the period, (C, 12, 12).
    models: the models of motion of filters with several; None: all have one.
    """

    continued: Bools
    state: State
    covariance: Floats
    transition: Floats
    models: Models | None = None

    def ended(self, bank: FilterBank, mask: Bools) -> "Prediction":
        """Return the same at the end of the period.

        Args:
            bank: the filters, with all measurements.
            mask: (C,), the craft that are continued, if they were before.
        """
        models = None if self.models is None else self.models.of(bank)
        return self._replace(continued=self.continued & mask, models=models)


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
    models = _models(bank, dt, coupling) if isinstance(bank, InteractingBank) else None
    return Prediction(active, bank.state, bank.covariance, transition, models)


def _models(bank: InteractingBank, dt: float, coupling: Floats | None) -> Models:
    """Return the models of a bank that has just been predicted; the arguments are as in `predicted`."""
    mixtures, one = bank.mixtures, np.empty((STATES, STATES))
    process_noise_into(dt, 1.0, 1.0, one)
    noise = np.tile(one, (len(mixtures.window), 1, 1))
    if coupling is not None:
        noise[:, :6, :6] = coupling @ one[:6, :6] @ np.swapaxes(coupling, 1, 2)
    mean, covariance = _by_lanes(mixtures)
    unknown_yet = np.full_like(mean, np.nan), np.full_like(covariance, np.nan)
    return Models(
        mixtures.probability, mean, covariance, bank.sigmas(), noise, mixtures.mixed, mixtures.moved, *unknown_yet
    )


class Estimates(NamedTuple):
    """Estimates of C filters at one epoch, after its measurements; NaN where a filter was not active.

    state: of the C craft. covariance: (C, 12, 12).
    """

    state: State
    covariance: Floats


class _Mixture(NamedTuple):
    """Models of C craft, given all: probability (C, L), and mean (C, L, 12) and covariance (C, L, 12, 12) of the errors
    of a state that they share.
    """

    probability: Floats
    mean: Floats
    covariance: Floats


class Smoother:
    """The backward pass over C filters: `step` takes one period after the other, the last one first."""

    def __init__(self, craft_count: int) -> None:
        """Begin behind the last period, about which nothing more is known."""
        nothing, one = np.full((craft_count, STATES, STATES), np.nan), no_models(craft_count)
        self._one = one
        self._later = Estimates(unknown(craft_count), nothing)
        self._ahead = Prediction(np.zeros(craft_count, dtype=np.bool_), self._later.state, nothing, nothing, one)
        self._mixture = _Mixture(one.probability.copy(), one.mean.copy(), one.covariance.copy())

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
        models = self._one if prediction.models is None else prediction.models
        assert ahead.models is not None
        several = np.isfinite(ahead.models.probability[:, 0])
        continued = ahead.continued & (~several | ahead.models.moved.any(axis=(1, 2)))
        _begin_all(~continued, models, out.covariance, self._mixture)
        origin = _origins(ahead, continued & several)
        failed = _smooth_all(continued, several, ahead, ahead.models, origin, later.state, self._mixture, *out)
        if failed >= 0:
            raise ValueError(f"prediction: the covariance of craft {failed} is not positive definite")
        self._later, self._ahead = out, prediction._replace(models=models)
        return out


def _origins(ahead: Prediction, several: Bools) -> _Mixture:
    """Return what the models of the craft of the mask were before the prediction, mixed; NaN of the others."""
    m = ahead.models
    assert m is not None
    mean, covariance = np.full_like(m.mean, np.nan), np.full_like(m.covariance, np.nan)
    back = np.linalg.inv(ahead.transition[several])[:, None]
    sigma = np.repeat(m.sigma[several][..., ::-1], STATES // 2, axis=-1)
    noise = sigma[..., :, None] * m.noise[several][:, None] * sigma[..., None, :]
    mean[several] = (back @ m.mean[several][..., None])[..., 0]
    covariance[several] = back @ (m.covariance[several] - noise) @ np.swapaxes(back, -1, -2)
    return _Mixture(m.probability, mean, covariance)


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
def _begin_all(mask: Bools, models: Models, covariance: Floats, mixture: _Mixture) -> None:
    """Let the smoothers of the craft of the mask begin at their filters' estimates.

    Args:
        mask: (C,).
        models: the models of the filters.
        covariance: (C, 12, 12), of the estimates.
        mixture: receives the models after the measurements; models that are all like the estimate where they are not
            known, or are not of the estimate.
    """
    x, p = np.empty(STATES), np.empty((STATES, STATES))
    for c in range(len(mask)):
        if not mask[c]:
            continue
        for j in range(LANES):
            only = 1.0 if j == 0 else 0.0
            mixture.probability[c, j] = only if np.isnan(models.probability[c, 0]) else models.probability[c, j]
            mixture.mean[c, j], mixture.covariance[c, j] = models.last_mean[c, j], models.last_covariance[c, j]
        _join(c, LANES, mixture, x, p)
        for i in range(STATES):
            if not abs(p[i, i] - covariance[c, i, i]) < ALIKE * covariance[c, i, i]:
                mixture.mean[c], mixture.covariance[c] = 0.0, covariance[c]


@kernel
def _changes(share: Floats) -> bool:
    """Return whether shares (L, L) are not the identity."""
    for j in range(LANES):
        for i in range(LANES):
            if share[j, i] != (1.0 if i == j else 0.0):
                return True
    return False


class _Work(NamedTuple):
    """Workspace for the models of one craft: weight (L, L), mean (L, 12), covariance (L, 12, 12)."""

    weight: Floats
    mean: Floats
    covariance: Floats


@kernel
def _part(c: int, share: Floats, mixture: _Mixture, work: _Work) -> None:
    """Give the models of craft c the place of those that they were made of.

    Args:
        c: the craft.
        share: (L, L), shares of models before (columns) in the models after (rows).
        mixture: models after, changed to those before.
        work: workspace.
    """
    if not _changes(share):
        return
    for j in range(LANES):
        for i in range(LANES):
            work.weight[j, i] = share[j, i] * mixture.probability[c, j]
        work.mean[j], work.covariance[j] = mixture.mean[c, j], mixture.covariance[c, j]
    for i in range(LANES):
        total, mean, covariance = 0.0, mixture.mean[c, i], mixture.covariance[c, i]
        for j in range(LANES):
            total += work.weight[j, i]
        mixture.probability[c, i] = total if total > NEGLIGIBLE else 0.0
        if total <= NEGLIGIBLE:
            continue
        mean[:], covariance[:] = 0.0, 0.0
        for j in range(LANES):
            for a in range(STATES):
                mean[a] += work.weight[j, i] / total * work.mean[j, a]
        for j in range(LANES):
            part = work.weight[j, i] / total
            if part > 0.0:
                for a in range(STATES):
                    off = part * (work.mean[j, a] - mean[a])
                    for b in range(STATES):
                        covariance[a, b] += part * work.covariance[j, a, b] + off * (work.mean[j, b] - mean[b])


@kernel
def _join(c: int, lanes: int, mixture: _Mixture, x: Floats, covariance: Floats) -> None:
    """Write mean (12,) and covariance (12, 12) of the models of craft c, of which the first `lanes` count."""
    if lanes == 1:
        x[:], covariance[:] = mixture.mean[c, 0], mixture.covariance[c, 0]
        return
    total, x[:], covariance[:] = 0.0, 0.0, 0.0
    for j in range(lanes):
        total += mixture.probability[c, j]
    for j in range(lanes):
        mixture.probability[c, j] /= total
        if mixture.probability[c, j] > 0.0:
            for a in range(STATES):
                x[a] += mixture.probability[c, j] * mixture.mean[c, j, a]
    for j in range(lanes):
        part = mixture.probability[c, j]
        if part > 0.0:
            for a in range(STATES):
                off = mixture.mean[c, j, a] - x[a]
                for b in range(STATES):
                    covariance[a, b] += part * mixture.covariance[c, j, a, b]
                    covariance[a, b] += part * (off * (mixture.mean[c, j, b] - x[b]))


@kernel
def _smooth_all(
    continued: Bools,
    several: Bools,
    ahead: Prediction,
    models: Models,
    origin: _Mixture,
    later: State,
    mixture: _Mixture,
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
    far, e, x = np.empty(STATES), np.empty(STATES), np.empty(STATES)
    jacobian, inverse = np.empty((3, 3)), np.empty((3, 3))
    parts = _Work(np.empty((LANES, LANES)), np.empty((LANES, STATES)), np.empty((LANES, STATES, STATES)))
    for c in range(len(continued)):
        if not continued[c]:
            continue
        lanes = LANES if several[c] else 1
        if several[c]:
            _part(c, models.moved[c], mixture, parts)
        difference_into(later, ahead.state, c, far)
        left_jacobian_into(far[:3], jacobian)
        _inverted(jacobian, inverse)
        for j in range(lanes):
            if mixture.probability[c, j] <= NEGLIGIBLE:
                mixture.probability[c, j] = 0.0
                continue
            before = origin.covariance[c, j] if several[c] else covariance[c]
            ahead_covariance = models.covariance[c, j] if several[c] else ahead.covariance[c]
            if not cholesky_into(ahead_covariance, lower):
                return c
            # G^T = (P-)^-1 F P, its rows those of k + 1.
            _product_into(ahead.transition[c], before, gain)
            _solve_columns(lower, gain)

            mean = mixture.mean[c, j]
            for i in range(STATES):
                e[i] = far[i] + mean[i]
            for i in range(3):
                e[i] = far[i] + (inverse[i, 0] * mean[0] + inverse[i, 1] * mean[1] + inverse[i, 2] * mean[2])
            if several[c]:
                for i in range(STATES):
                    e[i] -= models.mean[c, j, i]
            for i in range(STATES):
                mean[i] = origin.mean[c, j, i] if several[c] else 0.0
                for k in range(STATES):
                    mean[i] += gain[k, i] * e[k]

            for i in range(STATES):
                for k in range(STATES):
                    spread[i, k] = mixture.covariance[c, j, i, k]
            _turn_attitude(spread, inverse, work)
            for i in range(STATES):
                for k in range(STATES):
                    spread[i, k] -= ahead_covariance[i, k]
            _product_into(spread, gain, work)
            for i in range(STATES):
                for m in range(i + 1):
                    value = 0.0
                    for k in range(STATES):
                        value += gain[k, i] * work[k, m] + gain[k, m] * work[k, i]
                    # Half of each: the sum of a product and its mirror image is symmetric to the last bit.
                    mixture.covariance[c, j, i, m] = before[i, m] + value / 2
                    mixture.covariance[c, j, m, i] = mixture.covariance[c, j, i, m]
        if several[c]:
            _part(c, models.mixed[c], mixture, parts)
        _join(c, lanes, mixture, x, covariance[c])
        left_jacobian_into(x[:3], jacobian)
        _turn_attitude(covariance[c], jacobian, work)
        for j in range(lanes):
            for i in range(STATES):
                e[i] = mixture.mean[c, j, i] - x[i]
                mixture.mean[c, j, i] = e[i]
            for i in range(3):
                mixture.mean[c, j, i] = jacobian[i, 0] * e[0] + jacobian[i, 1] * e[1] + jacobian[i, 2] * e[2]
            _turn_attitude(mixture.covariance[c, j], jacobian, work)
        correct(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], x)
    return -1
