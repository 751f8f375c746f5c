"""Several models of motion side by side, from manoeuvring to quiet: the interacting multiple model filter.

The models differ in their process noise, in a geometric series, the first one's the largest. All of a craft's models
share one state, about which everything is linear, and the transition F: model j is a Gaussian of the error state, with
the mean x_j, the covariance P_j and the probability m_j. A craft changes from model i to model j with the probability
p_ij = dt r_ij, to the next ones only. Per prediction

    c_j = sum_i p_ij m_i,   w_ij = p_ij m_i / c_j                                    mixing: model j starts from
    x_j <- sum_i w_ij x_i,  P_j <- sum_i w_ij (P_i + x_i x_i^T) - x_j x_j^T
    x_j <- F x_j,           P_j <- F P_j F^T + Q_j

and after an update with the innovations' likelihoods N(y - H x_j; 0, S_j)

    m_j <- c_j N_j / sum_i c_i N_i,   N_j = exp(-NIS_j / 2) / sqrt(det S_j)
    x = sum_j m_j x_j,   P = sum_j m_j (P_j + x_j x_j^T) - x x^T                     the estimate

after which x goes into the state and off the x_j, whose mean is therefore always zero (H. Blom, Y. Bar-Shalom, IEEE
Trans. Automatic Control 33, 1988). A measurement is let in if the gate of any model does.

The models are a grid, and their probabilities the likelihood of the noise that a craft's motion has: a filter that
allows for more noise than there is lags behind its own precision, and its errors are smaller than it says, down to 3/4
of their squares. Of this grid a craft runs a window of `LANES` models only. Where the likeliest is at an end of it, the
window moves by one model, which begins as a copy of the likeliest; the one at the other end is given up.

Models are mixed after updates with `DECIDING` rows or more only. In the dark, or by one or two photodiodes, nothing
tells the models apart: there mixing would make a quiet craft a manoeuvring one in time, and its prediction useless.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints, lined
from estimators.exponential import exponential, logarithm
from estimators.filter.bank import FilterBank, Given, Independent, Poses, UpdateResult, couple
from estimators.kernel import inlined, kernel
from estimators.lanes import LANES, lane, lanes_in, pack, select, transposed, with_lane
from estimators.linear import from_triangle, to_triangle
from estimators.pivot import is_wide, shear, shear_into
from estimators.scratch import scratch
from estimators.state import STATES

DECIDING = 6
"""Rows of an update after which models are mixed: those of a pose, or of three photodiodes."""
MIXED_S = 0.095
"""Time after which models are mixed again [s]: short against that in which craft change from one to another."""
LEAST = 1e-6
"""Least probability of a model: so much evidence is forgotten."""
TRIANGLE = STATES * (STATES + 1) // 2
"""Numbers of the lower triangle of a covariance."""
COLUMNS = STATES // LANES
"""Fours of columns of a covariance."""


class Grid(NamedTuple):
    """The models of motion, the liveliest first.

    acceleration, angular_acceleration: process noise, (N,) [m/s^2], [rad/s^2]. quieter, livelier: rates at which a
    craft changes to the next model [1/s].
    """

    acceleration: Floats
    angular_acceleration: Floats
    quieter: float
    livelier: float


class Mixtures(NamedTuple):
    """The models that C craft run, in L = LANES lanes: model m is in lane m mod L.

    window: (C,), the liveliest model that is run. models: (C,), number of models that the craft has; a lane of none has
    the probability zero. probability: (C, L). mean: (C, 12, L), x_j. covariance: (C, 78, L), lower triangles of P_j,
    row by row: half of what a processor has to fetch. told: (C,), whether the last update told the models apart.
    since_s: (C,), time since the models were mixed, as far as updates told them apart [s]. mixed, moved: (C, L, L), for
    a smoother: what each model (row) was made of since the update before, by mixing and by the last move of the window;
    `moved` is zero where the models have begun anew. mingled: (C,), whether either says more than that
    each model was made of itself.
    """

    window: Ints
    models: Ints
    probability: Floats
    mean: Floats
    covariance: Floats
    told: Bools
    since_s: Floats
    mixed: Floats
    moved: Floats
    mingled: Bools


class InteractingBank(FilterBank):
    """C craft, each with several models of motion; what predicts and updates each model is left to its children."""

    def __init__(
        self,
        noises: list[tuple[float, float]],
        quiet_s: float,
        manoeuvre_s: float,
        models: Ints,
        gate_probability: float = 0.99999,
    ) -> None:
        """Begin without a state.

        Args:
            noises: process noise [m/s^2], [rad/s^2] of the N models, the largest first.
            quiet_s: mean time after which a craft begins to move more [s].
            manoeuvre_s: mean time after which it begins to move less [s].
            models: (C,), number of models of each craft, the first of the N.
            gate_probability: of any `FilterBank`.
        """
        linear, angular = (np.array(part) for part in zip(*noises, strict=True))
        super().__init__(
            len(models),
            acceleration_noise_m_s2=linear[0],
            angular_acceleration_noise_rad_s2=angular[0],
            gate_probability=gate_probability,
        )
        craft = len(models)
        self._moved_on = np.zeros(craft, dtype=np.bool_)
        self._shared = False
        self._hold(lined(craft, STATES, STATES))
        self._p.fill(np.nan)
        self.grid = Grid(linear, angular, 1 / manoeuvre_s, 1 / quiet_s)
        self._mixtures = Mixtures(
            window=np.zeros(craft, dtype=np.int64),
            models=np.ascontiguousarray(models, dtype=np.int64),
            probability=np.zeros((craft, LANES)),
            mean=lined(craft, STATES, LANES),
            covariance=lined(craft, TRIANGLE, LANES),
            told=np.zeros(craft, dtype=np.bool_),
            since_s=np.zeros(craft),
            mixed=np.zeros((craft, LANES, LANES)),
            moved=np.zeros((craft, LANES, LANES)),
            mingled=np.ones(craft, dtype=np.bool_),
        )

    def _hold(self, covariance: Floats) -> None:
        """Keep P in this array (C, 12, 12), which begins with a line of the cache."""
        self._p, self._columns = covariance, covariance.reshape(len(covariance), STATES, COLUMNS, LANES)

    def _part(self) -> None:
        """Go on in an array that nobody else reads; a prediction has left P of most craft to be made anew."""
        if self._shared:
            before, self._shared = self._p, False
            self._hold(lined(*before.shape, filled=False))
            stays = np.flatnonzero(~self._moved_on)
            self._p[stays] = before[stays]

    def _covariance(self, mask: Bools) -> Floats:
        """Return P (C, 12, 12) of the mixtures, which a prediction leaves to whoever asks for it before an update."""
        late = mask & self._moved_on
        if late.any():
            self._catch_up(late)
            self._part()
            _combine_all(late, self._mixtures, self._columns)
            self._moved_on &= ~late
        return self._p

    def _covariance_to_write(self, mask: Bools) -> Floats:
        self._part()
        return self._covariance(mask)

    def covariance_to_read(self) -> Floats:
        """Return P, which the bank leaves as it is: what changes it from now on does so in another array."""
        out = self._covariance(np.ones_like(self._active))
        self._shared = True
        return out

    def predict(self, dt: float | Floats, mask: Bools) -> None:
        """Move on by `dt`, as any bank."""
        super().predict(dt, mask)
        self._moved_on |= mask

    def _taken(self, name: str, mask: Bools, given: Given | Independent | Poses) -> UpdateResult:
        self._part()
        result = super()._taken(name, mask, given)
        self._moved_on &= ~result.accepted
        return result

    @property
    def probability(self) -> Floats:
        """The probabilities of the models, (C, N); zero of those that are not run."""
        self._catch_up(self._active)
        mixtures = self._mixtures
        craft = np.arange(len(mixtures.window))
        out = np.zeros((len(craft), max(len(self.grid.acceleration), LANES)))
        for at in range(LANES):
            out[craft, mixtures.window + (at - mixtures.window) % LANES] = mixtures.probability[:, at]
        return out[:, : len(self.grid.acceleration)]

    def add_motion(
        self,
        mask: Bools,
        turn: Floats,
        rate: Floats,
        shift: Floats,
        velocity: Floats,
        coupling: Floats | None = None,
    ) -> None:
        """Add known motion to the state of all models.

        Args:
            mask: (C,), the craft concerned.
            turn: (C, 3) [rad].
            rate: (C, 3) [rad/s].
            shift: (C, 3) [m].
            velocity: (C, 3) [m/s].
            coupling: (C, 6, 6), what the motion makes of an error of attitude and angular rate; None: nothing else.
        """
        super().add_motion(mask, turn, rate, shift, velocity, coupling)
        if coupling is not None:
            _couple_models(mask, np.ascontiguousarray(coupling), self._mixtures)

    @property
    def mixtures(self) -> Mixtures:
        """The models of all craft, copied."""
        self._catch_up(self._active)
        own = self._mixtures
        return own._replace(**{name: part.copy() for name, part in own._asdict().items()})

    def sigmas(self) -> Floats:
        """Return the process noises (C, L, 2) [m/s^2], [rad/s^2] of the models in the lanes."""
        window = self._mixtures.window[:, None]
        # Lanes of no model have the quietest's, which counts nowhere.
        model = np.minimum(window + (np.arange(LANES) - window) % LANES, len(self.grid.acceleration) - 1)
        return np.stack([self.grid.acceleration[model], self.grid.angular_acceleration[model]], axis=-1)

    def _catch_up(self, mask: Bools) -> None:
        """Do what a prediction has left undone of the models of the craft of the mask."""
        return

    def _begin(self, mask: Bools) -> None:
        _begin_all(mask, self._covariance(mask), self._mixtures)

    def _changed(self, mask: Bools) -> None:
        # The covariance is that of the mixture: nothing rests on it.
        return


@inlined
def model_in(at: int, window: int) -> int:
    """Return the model in a lane of a craft whose liveliest model is `window`."""
    model: int = window + (at - window) % LANES
    return model


@inlined
def runs(at: int, c: int, mixtures: Mixtures) -> bool:
    """Return whether craft c has the model of a lane: a window is beyond the first only where it is full.

    Args:
        at: the lane.
        c: the craft.
        mixtures: models of all craft.
    """
    found: bool = at < mixtures.models[c]
    return found


@inlined
def running(c: int, mixtures: Mixtures) -> bool:
    """Return `runs` of the lanes of craft c, as a mask."""
    every: bool = pack(0.0, 1.0, 2.0, 3.0) < float(mixtures.models[c])
    return every


@kernel
def _begin_all(mask: Bools, covariance: Floats, mixtures: Mixtures) -> None:
    """Let the craft of the mask begin with their liveliest models, all alike."""
    for c in range(len(mask)):
        if not mask[c]:
            continue
        mixtures.window[c], mixtures.told[c], mixtures.since_s[c] = 0, False, 0.0
        mixtures.mingled[c] = True
        several = min(LANES, mixtures.models[c])
        for at in range(LANES):
            for k in range(LANES):
                mixtures.moved[c, at, k] = 0.0
            mixtures.probability[c, at] = 1 / several if at < several else 0.0
            for a in range(STATES):
                mixtures.mean[c, a, at] = 0.0
            to_triangle(covariance[c], mixtures.covariance[c, :, at])


@kernel
def _couple_models(mask: Bools, coupling: Floats, mixtures: Mixtures) -> None:
    """Multiply the errors of attitude and angular rate in every model by matrices (C, 6, 6)."""
    means, covariances = lanes_in(mixtures.mean), lanes_in(mixtures.covariance)
    moved, half = lanes_in(np.empty((6, LANES))), lanes_in(np.empty((6, STATES, LANES)))
    p = lanes_in(np.empty((STATES, STATES, LANES)))
    for c in range(len(mask)):
        if not mask[c]:
            continue
        for i in range(6):
            value = coupling[c, i, 0] * means[c, 0]
            for k in range(1, 6):
                value += coupling[c, i, k] * means[c, k]
            moved[i] = value
        for i in range(6):
            means[c, i] = moved[i]
        from_triangle(covariances[c], p)
        couple(coupling[c], p, half)
        to_triangle(p, covariances[c])


@kernel
def mix_if_due(c: int, dt: float, grid: Grid, mixtures: Mixtures) -> None:
    """Mix the models of craft c before a step of `dt` [s], if the last update told them apart and it is time.

    Args:
        c: the craft.
        dt: the step [s].
        grid: the models.
        mixtures: models of all craft, changed in place.
    """
    if mixtures.mingled[c]:
        mixed, moved, zero = lanes_in(mixtures.mixed)[c], lanes_in(mixtures.moved)[c], pack(0.0, 0.0, 0.0, 0.0)
        for j in range(LANES):
            mixed[j] = moved[j] = with_lane(zero, j, 1.0)
        mixtures.mingled[c] = False
    if mixtures.told[c]:
        mixtures.told[c] = False
        mixtures.since_s[c] += dt
        if mixtures.since_s[c] >= MIXED_S:
            _mix(c, mixtures.since_s[c], grid, mixtures)
            mixtures.since_s[c] = 0.0


@kernel
def _mix(c: int, dt: float, grid: Grid, mixtures: Mixtures) -> None:
    """Mix the models of craft c, and move their probabilities on by `dt` [s]."""
    weight = scratch(dt, LANES, LANES)
    up, down = min(dt * grid.livelier, 0.25), min(dt * grid.quieter, 0.25)
    window, end = mixtures.window[c], min(mixtures.window[c] + LANES, mixtures.models[c])
    own, x, p = mixtures.probability[c], lanes_in(mixtures.mean)[c], lanes_in(mixtures.covariance)[c]
    for j in range(LANES):
        for i in range(LANES):
            weight[j, i] = 0.0
    for model in range(window, end):
        i, stays = model % LANES, 1.0
        if model > window:
            weight[(model - 1) % LANES, i] = up * own[i]
            stays -= up
        if model + 1 < end:
            weight[(model + 1) % LANES, i] = down * own[i]
            stays -= down
        weight[i, i] = stays * own[i]
    for j in range(LANES):
        total = 0.0
        for i in range(LANES):
            total += weight[j, i]
        own[j] = total
        if total > 0.0:
            for i in range(LANES):
                weight[j, i] /= total
        else:  # a lane of no model stays as it is
            weight[j, j] = 1.0
    for j in range(LANES):
        for i in range(LANES):
            mixtures.mixed[c, j, i] = weight[j, i]
    mixtures.mingled[c] = True
    share = (
        pack(weight[0, 0], weight[1, 0], weight[2, 0], weight[3, 0]),
        pack(weight[0, 1], weight[1, 1], weight[2, 1], weight[3, 1]),
        pack(weight[0, 2], weight[1, 2], weight[2, 2], weight[3, 2]),
        pack(weight[0, 3], weight[1, 3], weight[2, 3], weight[3, 3]),
    )
    mean = scratch(x, STATES)
    for a in range(STATES):
        mean[a] = _mixed(share, x[a])
    k = 0
    for a in range(STATES):
        for b in range(a + 1):
            p[k] = _mixed(share, p[k] + x[a] * x[b]) - mean[a] * mean[b]
            k += 1
    for a in range(STATES):
        x[a] = mean[a]


@kernel
def _mixed(share: tuple[float, float, float, float], value: float) -> float:
    """Return a number of all models, as lanes, after mixing; share: lanes of w_ij of every j, of the i one by one."""
    total: float = 0.0 + share[0] * lane(value, 0)
    total += share[1] * lane(value, 1)
    total += share[2] * lane(value, 2)
    return total + share[3] * lane(value, 3)


@inlined
def shares(c: int, mixtures: Mixtures) -> float:
    """Return the probabilities of the models of craft c as lanes."""
    lanes: float = lanes_in(mixtures.probability)[c]
    return lanes


@kernel
def combined_into(share: float, x: Floats, p: Floats, out: Floats) -> None:
    """Write the covariances of mixtures whose means are zero, four columns in the lanes of a four.

    Args:
        share: probabilities of the models: lanes, or wide lanes for craft side by side.
        x: (12,), means of the models, as many lanes.
        p: (12, 12), covariances of the models.
        out: (12, 3), receives the columns.
    """
    for a in range(STATES):
        for b in range(0, a + 1, LANES):
            one, two, three, four = transposed(
                share * (p[a, b] + x[a] * x[b]),
                share * (p[max(a, b + 1), min(a, b + 1)] + x[a] * x[b + 1]),
                share * (p[max(a, b + 2), min(a, b + 2)] + x[a] * x[b + 2]),
                share * (p[max(a, b + 3), min(a, b + 3)] + x[a] * x[b + 3]),
            )
            out[a, b // LANES] = (one + two) + (three + four)
    for a in range(LANES, STATES, LANES):
        for b in range(0, a, LANES):
            at = b // LANES
            one, two, three, four = transposed(out[a, at], out[a + 1, at], out[a + 2, at], out[a + 3, at])
            at = a // LANES
            out[b, at], out[b + 1, at], out[b + 2, at], out[b + 3, at] = one, two, three, four


@inlined
def combine(c: int, mixtures: Mixtures, covariance: Floats) -> None:
    """Write the covariance of the mixture of craft c, whose mean is zero.

    Args:
        c: the craft.
        mixtures: models of all craft.
        covariance: (C, 12, 3, L), four columns beside each other, receives it.
    """
    share = shares(c, mixtures)
    p = scratch(share, STATES, STATES)
    from_triangle(lanes_in(mixtures.covariance)[c], p)
    combined_into(share, lanes_in(mixtures.mean)[c], p, lanes_in(covariance)[c])


@kernel
def _combine_all(mask: Bools, mixtures: Mixtures, covariance: Floats) -> None:
    """`combine` for the craft of the mask."""
    for c in range(len(mask)):
        if mask[c]:
            combine(c, mixtures, covariance)


@inlined
def _sum_in_four(value: float) -> float:
    """Return the sums of fours of lanes, in each of their lanes."""
    one, two, three, four = transposed(value, value, value, value)
    return 0.0 + one + two + three + four


@inlined
def _least_in_four(value: float) -> float:
    """Return the least of fours of lanes, in each of their lanes."""
    one, two, three, four = transposed(value, value, value, value)
    return min(min(one, two), min(three, four))


@inlined
def weighed(own: float, among: bool, nis: float, volume: float, gate: float) -> tuple[bool, float, float, float]:
    """Decide by the gate whether a craft's models let a measurement in; return whether one does, the probabilities of
    the models after it, and the means of NIS and log det S. Of lanes, or of wide lanes for craft side by side.

    Args:
        own: probabilities of the models.
        among: the lanes of models that are run.
        nis: by the models.
        volume: roots of det S by the models.
        gate: largest NIS that is let in.
    """
    least = _least_in_four(select(among, nis, np.inf))
    accepted = least <= gate
    likely = select(among, own * exponential((least - nis) / 2) / volume, 0.0)
    likely = select(among, max(likely / _sum_in_four(likely), LEAST), 0.0)
    own = select(accepted, likely / _sum_in_four(likely), own)
    spread = _sum_in_four(select(among, own * (2 * logarithm(volume)), 0.0))
    return accepted, own, _sum_in_four(select(among, own * nis, 0.0)), spread


@inlined
def let_in(c: int, nis: float, volume: float, gate: float, mixtures: Mixtures, result: UpdateResult) -> bool:
    """Give a measurement of craft c its fate, and its models their probabilities; return whether one lets it in.

    Args:
        c: the craft.
        nis: lanes, by the models.
        volume: lanes, roots of det S by the models.
        gate: largest NIS that is let in.
        mixtures: models of all craft, changed in place.
        result: receives the fate.
    """
    accepted, own, nis, spread = weighed(shares(c, mixtures), running(c, mixtures), nis, volume, gate)
    lanes_in(mixtures.probability)[c] = own
    result.accepted[c], result.nis[c], result.log_determinant[c] = lane(accepted, 0), lane(nis, 0), lane(spread, 0)
    return lane(accepted, 0)


@kernel
def _floor(c: int, total: float, mixtures: Mixtures) -> None:
    """Let the probabilities of craft c, whose sum is `total`, be LEAST at least, and their sum one."""
    own, over = mixtures.probability[c], 0.0
    for at in range(LANES):
        if runs(at, c, mixtures):
            own[at] = max(own[at] / total, LEAST)
            over += own[at]
    for at in range(LANES):
        own[at] /= over


@kernel
def centred(share: float, x: Floats, mean: Floats) -> None:
    """Take the means of mixtures off their models.

    Args:
        share: probabilities of the models: lanes, or wide lanes for craft side by side.
        x: (12,), means of the models, as many lanes, changed in place.
        mean: (3,), receives the means of the mixtures, four states in the lanes of a four.
    """
    for a in range(0, STATES, LANES):
        one, two, three, four = transposed(share * x[a], share * x[a + 1], share * x[a + 2], share * x[a + 3])
        total = 0.0 + one + two + three + four
        mean[a // LANES] = total
        one, two, three, four = transposed(total, total, total, total)
        x[a], x[a + 1], x[a + 2], x[a + 3] = x[a] - one, x[a + 1] - two, x[a + 2] - three, x[a + 3] - four


@inlined
def centre(c: int, mixtures: Mixtures, x: Floats) -> None:
    """Take the mean (12,) of the mixture of craft c off its models, and write it to x.

    Args:
        c: the craft.
        mixtures: models of all craft, changed in place.
        x: (12,), receives the mean.
    """
    mean = scratch(0.0, COLUMNS, LANES)
    centred(shares(c, mixtures), lanes_in(mixtures.mean)[c], lanes_in(mean))
    for i in range(STATES):
        x[i] = mean[i // LANES, i % LANES]


@kernel
def _move_window(c: int, mixtures: Mixtures) -> None:
    """Move the window of craft c by one model if the likeliest is at its end."""
    own, window, best = mixtures.probability[c], mixtures.window[c], 0
    for at in range(1, LANES):
        if own[at] > own[best]:
            best = at
    model = model_in(best, window)
    if model == window and window > 0:
        newcomer, window = window - 1, window - 1
    elif model == window + LANES - 1 and model + 1 < mixtures.models[c]:
        newcomer, window = model + 1, window + 1
    else:
        return
    mixtures.window[c], mixtures.mingled[c] = window, True
    at, total = newcomer % LANES, 0.0
    own[at] = 0.0
    for k in range(LANES):
        mixtures.moved[c, at, k] = mixtures.moved[c, best, k]
        total += own[k]
    for a in range(STATES):
        mixtures.mean[c, a, at] = mixtures.mean[c, a, best]
    for k in range(TRIANGLE):
        mixtures.covariance[c, k, at] = mixtures.covariance[c, k, best]
    _floor(c, total, mixtures)


@kernel
def shear_models(c: int, arms: Floats, mixtures: Mixtures) -> None:
    """Refer the models of craft c to the state that has been moved by `turn_about`, if the attitude of one is wide.

    Args:
        c: the craft.
        arms: (ARMS,), of `turn_about`.
        mixtures: models of all craft, changed in place.
    """
    wide, s = False, np.empty((STATES, STATES))
    x, p = np.empty(STATES), np.empty((STATES, STATES))
    for at in range(LANES):
        if runs(at, c, mixtures):
            from_triangle(mixtures.covariance[c, :, at], p)
            wide = wide or is_wide(p)
    if not wide:
        return
    shear_into(arms, s)
    for at in range(LANES):
        if runs(at, c, mixtures):
            from_triangle(mixtures.covariance[c, :, at], p)
            x[:] = mixtures.mean[c, :, at]
            shear(p, arms)
            to_triangle(p, mixtures.covariance[c, :, at])
            for i in range(STATES):
                total = 0.0
                for k in range(STATES):
                    total += s[i, k] * x[k]
                mixtures.mean[c, i, at] = total


@inlined
def settle(c: int, rows: int, mixtures: Mixtures) -> None:
    """Finish an update of craft c by so many rows, of which the covariance of the mixture is known: move its window.

    Args:
        c: the craft.
        rows: number of rows, or of measurements that they stand for.
        mixtures: models of all craft, changed in place.
    """
    if rows >= DECIDING:
        mixtures.told[c] = True
        _move_window(c, mixtures)
