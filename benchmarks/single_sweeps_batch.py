"""How close to the posterior Cramer-Rao bound does any estimate come by few photodiodes? The batch, not the filter.

    python benchmarks/single_sweeps_batch.py [--craft 200] [--seeds 1] [--photodiodes 2] [--at-s 5] [--draws 0]
                                             [--core CORE] [--out FILE]

The flights of `single_sweeps.py`, navigated by the filter. Of the same light the most probable motion of each craft is
computed, of all rows from the start on at once, by Gauss and Newton's method over the state at the start and the
accelerations of every period, with the prior and the process noise that the bound has. A step is a Kalman filter and
a smoother of Rauch, Tung and Striebel, linear about the motion as it is (Bell, SIAM J. Optim. 4, 1994), shortened until
it gains; the first motion is the true one, so that no other minimum is found.

--draws: motions drawn of the posterior per craft, each the most probable one with the prior, the accelerations and the
angles moved by their noise (Bardsley, Solonen, Haario and Laine, SIAM J. Sci. Comput. 36, 2014). Their mean is the
estimate of the least RMS, which is no more than that of the filter or of any other; what a finite number of draws adds
is taken off its squares.
"""

from typing import Any, NamedTuple

import numpy as np
from harness import finish, options, show
from single_sweeps import (
    HOLD,
    PLACE,
    Model,
    Period,
    Samples,
    Truth,
    _samples,
    angles_at,
    differences,
    figures,
    fly,
    mockup,
)

from estimators.arrays import Bools, Floats
from swarm.flight import builders
from swarm.scenario import load

PRIOR = np.repeat([1.0, 1.0, 100.0, 4.0], 3)
"""Information of the start, as the bound has it."""
STEPS_MAX = 40
SETTLED = 1e-4
"""Fall of F below which a craft's motion has settled."""


class Motion(NamedTuple):
    """Motions of C craft over T periods: state at the first epoch, and accelerations (T - 1, C, 6), angular ones first, of
    which nothing is known before.
    """

    start: Truth
    push: Floats


class Problem:
    """F, twice the negative logarithm of the posterior density of motions of C craft."""

    def __init__(self, log: list[Period], model: Model) -> None:
        """Begin with the light of all periods."""
        self.log, self.model, craft = log, model, len(log[0].points)
        self.before = Truth(
            np.broadcast_to(HOLD, (craft, 3, 3)),
            np.zeros((craft, 3)),
            np.broadcast_to(PLACE, (craft, 3)),
            np.zeros((craft, 3)),
        )
        self.expected = np.zeros((len(log) - 1, craft, 6))
        self.angle = [period.angle for period in log]
        dt = model.frame_s
        gamma = np.kron(np.array([[dt**2 / 2], [dt]]), np.eye(3))
        self.enter = np.zeros((12, 6))
        self.enter[:6, :3], self.enter[6:, 3:] = gamma, gamma
        self.sigma = np.repeat([model.angular_acceleration, model.acceleration], 3)

    def perturbed(self, rng: np.random.Generator) -> "Problem":
        """Return the problem with all that is known moved by its noise."""
        out = Problem(self.log, self.model)
        shape = self.expected.shape
        out.before = self.before.moved(rng.standard_normal((shape[1], 12)) / np.sqrt(PRIOR))
        out.expected = self.sigma * rng.standard_normal(shape)
        out.angle = [angle + self._noise(angle, rng) for angle in self.angle]
        return out

    def _noise(self, angle: Floats, rng: np.random.Generator) -> Floats:
        rho = self.model.rho
        rotor, own = rng.standard_normal((len(angle), 1, 2)), rng.standard_normal(angle.shape)
        out: Floats = self.model.sigma * (np.sqrt(rho) * rotor + np.sqrt(1 - rho) * own)
        return out

    def true_motion(self) -> Motion:
        """Return the motion that was flown."""
        rates = np.stack([np.concatenate([p.truth.rate, p.truth.velocity], axis=1) for p in self.log])
        known = np.stack([self._ordered(k)[:, [3, 4, 5, 9, 10, 11]] for k in range(1, len(self.log))])
        return Motion(self.log[0].truth, (np.diff(rates, axis=0) - known) / self.model.frame_s)

    def _ordered(self, k: int) -> Floats:
        """Return what the orders add to the states (C, 12) until epoch k."""
        before, order, dt = self.log[k - 1].order, self.log[k].order, self.model.frame_s
        shift, change = (3 * before + order) * dt**2 / 8, (before + order) * dt / 2
        return np.concatenate([shift[1], change[1], shift[0], change[0]], axis=1)

    def states(self, motion: Motion) -> list[Truth]:
        """Return the states at all epochs."""
        out = [motion.start]
        for k, push in enumerate(motion.push, 1):
            out.append(out[-1].ahead(self.model.frame_s).moved(self._ordered(k) + push @ self.enter.T))
        return out

    def white(self, rows: Floats) -> Floats:
        """Return rows (C, n, 2, ...) of both fans with independent noise of variance one."""
        a, n = np.sqrt(1 - self.model.rho) * self.model.sigma, rows.shape[1]
        c = (1 - a / np.sqrt(a**2 + n * self.model.rho * self.model.sigma**2)) / n
        out: Floats = (rows - c * rows.sum(axis=1, keepdims=True)) / a
        return out

    def residual(self, k: int, state: Truth) -> Floats:
        """Return the whitened rows (C, 2 n) of a period."""
        period = self.log[k]
        away = self.angle[k] - angles_at(state, period.points, period.instant)
        return self.white(away).reshape(len(away), -1)

    def cost(self, motion: Motion, states: list[Truth]) -> Floats:
        """Return F (C,)."""
        total = np.sum(self.before.less(states[0]) ** 2 * PRIOR, axis=1)
        total += np.sum(((motion.push - self.expected) / self.sigma) ** 2, axis=(0, 2))
        for k, state in enumerate(states):
            total += np.sum(self.residual(k, state) ** 2, axis=1)
        return total

    def slopes(self, k: int, state: Truth) -> Floats:
        """Return the derivatives (C, 2 n, 12) of the whitened rows of a period."""
        period = self.log[k]
        shape = period.angle.shape

        def seen(there: Truth) -> Floats:
            return angles_at(there, period.points, period.instant).reshape(shape[0], -1)

        h = differences(seen, state, slice(0, 9)).reshape(*shape, 9)
        h = np.concatenate([h, h[..., 6:] * period.instant[..., None]], axis=-1)
        return self.white(h).reshape(shape[0], -1, 12)

    def step(self, motion: Motion, states: list[Truth]) -> tuple[Motion, Floats]:
        """Return the change of the motion that is best to first order, its start as a motion from zero, and the covariance
        (C, 12, 12) of the last state.
        """
        dt, craft, last = self.model.frame_s, len(states[0].rate), len(states) - 1
        noise = self.enter * self.sigma**2 @ self.enter.T
        mean = self.before.less(states[0])
        p = np.broadcast_to(np.diag(1 / PRIOR), (craft, 12, 12))
        kept = []
        for k, state in enumerate(states):
            h, y = self.slopes(k, state), self.residual(k, state)
            ph = p @ np.swapaxes(h, 1, 2)
            gain = np.linalg.solve(h @ ph + np.eye(h.shape[1]), np.swapaxes(ph, 1, 2))
            gain = np.swapaxes(gain, 1, 2)
            mean = mean + np.einsum("cij,cj->ci", gain, y - np.einsum("cij,cj->ci", h, mean))
            less = np.eye(12) - gain @ h
            p = less @ p @ np.swapaxes(less, 1, 2) + gain @ np.swapaxes(gain, 1, 2)
            if k == last:
                break
            then = state.ahead(dt)
            f = differences(lambda there, then=then: there.ahead(dt).less(then), state)
            kept.append((mean, p, f))
            pull = (self.expected[k] - motion.push[k]) @ self.enter.T
            mean = np.einsum("cij,cj->ci", f, mean) + pull
            p = f @ p @ np.swapaxes(f, 1, 2) + noise
            kept[-1] += (mean, p)
        later, change = mean, np.empty_like(motion.push)
        for k in range(last - 1, -1, -1):
            own, before, f, ahead, there = kept[k]
            told = np.linalg.solve(there, (later - ahead)[..., None])[..., 0]
            change[k] = self.expected[k] - motion.push[k] + self.sigma**2 * (told @ self.enter)
            later = own + np.einsum("cij,cj->ci", before, np.einsum("cji,cj->ci", f, told))
        return Motion(later, change), p

    def most_probable(self, motion: Motion) -> tuple[Motion, Truth, Floats, Bools]:
        """Return the motion of least F, its last state with the covariance to first order, and whether it has settled."""
        states = self.states(motion)
        cost = self.cost(motion, states)
        settled = np.zeros(len(cost), dtype=np.bool_)
        for _ in range(STEPS_MAX):
            change, p = self.step(motion, states)
            length, open_ = np.ones(len(cost)), ~settled
            for _ in range(12):
                share = np.where(open_, length, 0.0)[:, None]
                tried = Motion(motion.start.moved(share * change.start), motion.push + share * change.push)
                there = self.states(tried)
                new = self.cost(tried, there)
                better = ~open_ | (new <= cost + 1e-9 * cost)
                if better.all():
                    break
                length = np.where(better, length, length / 3)
            share = np.where(open_ & better, length, 0.0)[:, None]
            motion = Motion(motion.start.moved(share * change.start), motion.push + share * change.push)
            states = self.states(motion)
            new = self.cost(motion, states)
            settled |= ~better | (cost - new < SETTLED)
            cost = new
            if settled.all():
                break
        return motion, states[-1], p, settled


def batch(log: list[Period], model: Model, lit: Floats, draws: int, seed: int) -> dict[str, Samples]:
    """Return the samples at the last epoch of the filter, of the most probable motion and of the mean of draws.

    Args:
        log: all periods.
        model: noise.
        lit: (C, n, 3) [m], photodiodes that stay lit.
        draws: number of draws; 0: none.
        seed: of the draws.
    """
    truth = log[-1].truth
    problem = Problem(log, model)
    information = np.broadcast_to(np.diag(PRIOR), (len(lit), 12, 12))
    for k, period in enumerate(log):
        if k:
            information = model.advanced(information, log[k - 1].truth)
        information = information + model.light(period.truth, period.points, period.instant)
    out = {"filter": _samples(truth, log[-1].known, log[-1].covariance, information, lit)}
    motion, state, p, settled = problem.most_probable(problem.true_motion())
    print(f"most probable motion: {settled.mean():.3f} settled")
    out["most probable"] = _samples(truth, state, p, information, lit)
    if not draws:
        return out
    rng, away = np.random.default_rng(seed), []
    for _ in range(draws):
        away.append(problem.perturbed(rng).most_probable(motion)[1].less(state))
    every = np.stack(away)
    mean, spread = every.mean(axis=0), every.var(axis=0, ddof=1) / draws
    one = _samples(truth, state.moved(mean), p, information, lit)
    one.square[0] -= spread[:, :3].sum(axis=1)
    one.square[1] -= spread[:, 6:9].sum(axis=1)
    out["mean of draws"] = one
    return out


def main() -> None:
    """Fly, solve, and print."""
    chosen = options(
        __doc__,
        craft=(200, "craft per seed"),
        seeds=(1, "seeds"),
        first=(0, "first seed"),
        photodiodes=(2, "lit photodiodes"),
        at_s=(5.0, "instant after the others go dark [s]"),
        draws=(0, "draws of the posterior per craft"),
    )
    settings = builders.navigation(load("drift", ['navigation.filter="compiled"', 'navigation.quiet.craft="none"']))
    model = Model(
        settings.frame_s,
        settings.angle_noise_rad,
        settings.rotor_correlation,
        settings.acceleration_noise_m_s2,
        settings.angular_acceleration_noise_rad_s2,
    )
    points, count, result = mockup(), chosen.photodiodes, {}
    samples: dict[str, list[Samples]] = {}
    for seed in range(chosen.first, chosen.first + chosen.seeds):
        rng = np.random.default_rng([seed, count])
        lit = np.argsort(rng.random((chosen.craft, len(points))), axis=1)[:, :count]
        log: list[Period] = []
        fly(settings, model, points, lit, [chosen.at_s], 1000 * count + seed, log)
        for name, one in batch(log, model, points[lit], chosen.draws, seed).items():
            samples.setdefault(name, []).append(one)
        result: dict[str, Any] = {key: figures(some) for key, some in samples.items()}
        rows = [[key, *value.values()] for key, value in result.items()]
        show(f"{count} lit, {chosen.at_s:g} s, seeds from {chosen.first} to {seed}", ["", *next(iter(result.values()))], rows)
    finish("single_sweeps_batch", {"cases": result}, chosen.out)


if __name__ == "__main__":
    main()
