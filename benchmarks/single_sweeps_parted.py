"""How close to its bound does any estimate come by two photodiodes? Many narrow filters beside the one of a craft.

    python benchmarks/single_sweeps_parted.py [--craft 200] [--seeds 6] [--first 0] [--at-s 5] [--parted-s 2.5]
                                              [--filters 7] [--core CORE] [--out FILE]

The flights of `single_sweeps.py` with two photodiodes lit, navigated by one filter per craft that is never parted. A
while after the others have gone dark, the filter is replaced by several whose tilt and its rate are the narrower,
placed along what is then least known of the tilt to come; all take in the same light and orders, and count by its
likelihood. With more and narrower filters, their mean tends to the estimate of the least RMS, and what they say of
themselves to what is attainable. The bound is that of `single_sweeps.py`.
"""

from typing import NamedTuple

import numpy as np
from harness import finish, options, show
from single_sweeps import Model, Period, Samples, _light, fly, mockup

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from estimators.pivot import ARMS, PIVOT, shear, turn_about
from estimators.state import State
from swarm.flight import builders
from swarm.hardware import pad
from swarm.messages import Command
from swarm.onboard import mirror_images
from swarm.onboard.navigation import Navigator
from swarm.onboard.settings import NavigationSettings
from swarm.onboard.single_sweeps import SweepsTaken
from swarm.scenario import load

NARROW = 0.5
"""Sigma of each filter along what is least known of the tilt, over that of the one filter."""
REACH = 2.25
"""Sigmas of the one filter over which the others are spread to either side."""
REFUSED = 80.0
"""What a refused period counts, as NIS and log det S do."""


class Parted(NamedTuple):
    """M filters of each of C craft: their states and covariances, (C M, ...), and weights (M,)."""

    state: State
    covariance: Floats
    weight: Floats


def part(period: Period, lit: Floats, later_s: float, count: int) -> Parted:
    """Return what replaces the filters of C craft.

    Args:
        period: that in which they are parted.
        lit: (C, 2, 3) [m], the photodiodes.
        later_s: time of which the tilt is to be known, from then on [s].
        count: number of filters M; one: the filter itself.
    """
    known = period.known
    place = np.linspace(-REACH, REACH, count) if count > 1 else np.zeros(1)
    narrow = NARROW if count > 1 else 1.0
    weight = np.exp(-(place**2) / (2 * (1 - NARROW**2)))
    parts = (known.rotation, known.position, known.velocity, known.rate)
    state = State._make(np.repeat(np.asarray(own, dtype=np.float64), count, axis=0) for own in parts)
    covariance = np.repeat(period.covariance, count, axis=0)
    for c, points in enumerate(lit):
        pivot, arms = np.zeros(PIVOT), np.empty(ARMS)
        pivot[:3], pivot[3:6] = points.mean(axis=0), points[1] - points[0]
        axis = np.cross(known.rotation[c] @ pivot[3:6], known.position[c] + known.rotation[c] @ pivot[:3])
        axis /= np.linalg.norm(axis)
        tilt, own = np.concatenate([axis, later_s * axis, np.zeros(6)]), period.covariance[c]
        side = own @ tilt / np.sqrt(tilt @ own @ tilt)
        for m, sigmas in enumerate(place):
            i = c * count + m
            covariance[i] -= (1 - narrow**2) * np.outer(side, side)
            turn_about(*_in_order(state.of(i)), sigmas * side, pivot, arms)
            shear(covariance[i], arms)
    return Parted(state, covariance, weight / weight.sum())


def _in_order(state: State) -> tuple[Floats, Floats, Floats, Floats]:
    return state.rotation, state.angular_rate, state.position, state.velocity


class Recorded(Navigator):
    """A navigator that keeps what its filters made of the rows."""

    taken: SweepsTaken

    def keep(self) -> None:
        """Keep it from now on."""
        take_in = self._sweeps.take_in

        def kept(*given: object) -> SweepsTaken:
            self.taken = take_in(*given)  # type: ignore[arg-type]
            return self.taken

        self._sweeps.take_in = kept  # type: ignore[method-assign, assignment]


def replayed(
    settings: NavigationSettings, log: list[Period], first: int, points: Floats, lit: Ints, parted: Parted
) -> tuple[Floats, Floats]:
    """Return the squared errors (2, C) of attitude and position at the end, and the traces of their covariance.

    Args:
        settings: of the navigation.
        log: all periods.
        first: index of the period in which the filters were parted.
        points: (K, 3) [m], photodiodes.
        lit: (C, 2), those that are lit.
        parted: the filters.
    """
    count, craft = len(parted.weight), len(lit)
    every, normals = craft * count, np.tile([0.0, 0.0, 1.0], (len(points), 1))
    navigator = Recorded(pad([points] * every, [normals] * every), settings)
    navigator.keep()
    tracks = navigator.tracks
    tracks.bank.adopt(np.ones(every, dtype=np.bool_), parted.state, parted.covariance)
    tracks._command = Command(*(np.repeat(order, count, axis=0) for order in log[first].order))
    shown, loss = np.repeat(lit, count, axis=0), np.zeros(every)
    for period in log[first + 1 :]:
        angle, instant = (np.repeat(part, count, axis=0) for part in (period.angle, period.instant))
        light = _light(np.pi / 2 + angle, instant, shown, len(points))
        estimate = navigator.step(light, None, Command(*(np.repeat(order, count, axis=0) for order in period.order)))
        taken = navigator.taken
        loss += np.where(taken.fresh, taken.nis + taken.log_determinant, REFUSED)
    alive = np.isfinite(estimate.position[:, 0]).reshape(craft, count)
    weight = np.where(alive, np.log(parted.weight) - loss.reshape(craft, count) / 2, -np.inf)
    weight = np.exp(weight - weight.max(axis=1, keepdims=True))
    weight /= weight.sum(axis=1, keepdims=True)
    truth, likeliest = log[-1].truth, weight.argmax(axis=1)
    rotation = estimate.rotation.reshape(craft, count, 3, 3)
    near = rotation[np.arange(craft), likeliest]
    turned = rot.log(np.where(alive[..., None, None], rotation, np.eye(3)) @ np.swapaxes(near, 1, 2)[:, None])
    away = np.concatenate([turned, np.nan_to_num(estimate.position.reshape(craft, count, 3))], axis=2)
    mean = np.einsum("cm,cmi->ci", weight, away)
    own = np.nan_to_num(np.diagonal(estimate.covariance, axis1=1, axis2=2).reshape(craft, count, 12))
    spread = np.einsum("cm,cmi->ci", weight, (away - mean[:, None]) ** 2)
    spread += np.einsum("cm,cmi->ci", weight, own[..., [0, 1, 2, 6, 7, 8]])
    error = np.concatenate(
        [rot.log(truth.rotation @ np.swapaxes(rot.exp(mean[:, :3]) @ near, 1, 2)), truth.position - mean[:, 3:]], axis=1
    )
    halves = [np.stack([both[:, :3].sum(axis=1), both[:, 3:].sum(axis=1)]) for both in (error**2, spread)]
    return halves[0], halves[1]


def main() -> None:
    """Fly, part, and print."""
    chosen = options(
        __doc__,
        craft=(200, "craft per seed"),
        seeds=(6, "seeds"),
        first=(0, "first seed"),
        at_s=(5.0, "instant after the others go dark [s]"),
        parted_s=(2.5, "instant at which the filters are parted, likewise"),
        filters=(7, "filters per craft"),
    )
    settings = builders.navigation(load("drift", ['navigation.filter="compiled"', 'navigation.quiet.craft="none"']))
    model = Model(
        settings.frame_s,
        settings.angle_noise_rad,
        settings.rotor_correlation,
        settings.acceleration_noise_m_s2,
        settings.angular_acceleration_noise_rad_s2,
    )
    mirror_images.TILT_RAD = np.inf
    points, every = mockup(), []
    for seed in range(chosen.first, chosen.first + chosen.seeds):
        lit = np.argsort(np.random.default_rng([seed, 2]).random((chosen.craft, len(points))), axis=1)[:, :2]
        log: list[Period] = []
        flown: Samples = fly(settings, model, points, lit, [chosen.at_s], 2000 + seed, log)[chosen.at_s]
        at = len(log) - 1 - round((chosen.at_s - chosen.parted_s) / model.frame_s)
        parted = part(log[at], points[lit], chosen.at_s - chosen.parted_s, chosen.filters)
        square, own = replayed(settings, log, at, points, lit, parted)
        every.append(np.stack([flown.square[:2], flown.own[:2], square, own, flown.bound[:2]]))
        result = _figures(np.concatenate(every, axis=2))
        rows = [[name, *values.values()] for name, values in result.items()]
        show(f"over the bound, {seed + 1 - chosen.first} seeds", ["", *next(iter(result.values()))], rows)
    finish("single_sweeps_parted", {"cases": result}, chosen.out)


def _figures(every: Floats) -> dict[str, dict[str, float]]:
    """Return RMS and own sigma over the bound, with the standard errors, of samples (5, 2, C)."""
    out: dict[str, dict[str, float]] = {}
    for i, name in ((0, "one filter"), (2, "parted")):
        out[name] = {}
        for k, what in ((1, "position"), (0, "attitude")):
            square, own, bound = every[i, k], every[i + 1, k], every[4, k]
            ratio = np.sqrt(square.mean() / bound.mean())
            error = (square - bound * ratio**2).std() / bound.mean() / ratio / 2 / np.sqrt(len(square))
            out[name] |= {
                f"{what}_rms": ratio,
                f"{what}_error": error,
                f"{what}_own": np.sqrt(own.mean() / bound.mean()),
            }
    return out


if __name__ == "__main__":
    main()
