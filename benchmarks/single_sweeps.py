"""What is navigation by single sweeps worth? RMS over the posterior Cramer-Rao bound by the number of lit photodiodes.

    python benchmarks/single_sweeps.py [--craft 200] [--seeds 8] [--photodiodes 1 2 3 4 12] [--at-s 1 5]
                                       [--coupling auto] [--independent] [--keep FILE.npz] [--core CORE] [--out FILE]

Mockups 3 m from the lighthouse move exactly as the filter assumes, white accelerations, and hold their places by their
own estimates: their orders are known motion. They see all photodiodes for `CONVERGE_S`, then only some, drawn anew for
every craft. The on-board code is the real one, decoder apart; every craft has a rotor of its own here, so that craft
and seeds are independent samples. The table is written after every seed.

The bound is the information recursion of Tichavsky, Muravchik and Nehorai (IEEE Trans. Signal Process. 46, 1998), with
Jacobians at the truth by finite differences, of a model that is written here once more:

    J' = (Q + F J^-1 F^T)^-1 + sum of H^T R^-1 H,   R = (1 - rho) s^2 I + rho s^2 1 1^T per fan

--keep: samples are kept in a file, and a run with the same numbers goes on where an earlier one was stopped, or adds
seeds to it. A ratio's error is its standard error; a ratio of sigma is that of the filter's own covariance to the
bound.

--independent: the filter takes the rows as independent, as the common open implementation does, to compare.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from harness import finish, options, show
from numpy.typing import NDArray
from scipy.stats import chi2

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from swarm.flight import builders
from swarm.hardware import Photodiodes, pad
from swarm.messages import Command
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.navigation import Navigator
from swarm.onboard.settings import NavigationSettings
from swarm.scenario import load

CONVERGE_S = 0.75
"""Time with all photodiodes lit, from the start [s]: the rates' priors are forgotten."""
PLACE = np.array([0.0, 0.0, 3.0])
STIFFNESS, DAMPING = 1.0, 1.8
"""Of the feedback by which the craft hold their places [1/s^2, 1/s]."""
STEP = 1e-5
"""Of the finite differences [rad, m, rad/s, m/s]."""
OFFSETS = np.array([-0.25, 0.25])
"""Instants of boresight of fans X and Y after the epoch, in turns."""


class Truth(NamedTuple):
    """Rotation (C, 3, 3), angular rate, position, velocity (C, 3), as in the error state's order."""

    rotation: Floats
    rate: Floats
    position: Floats
    velocity: Floats

    def moved(self, x: Floats) -> "Truth":
        """Return the state that is off by the error x (C, 12)."""
        return Truth(
            rot.exp(x[:, :3]) @ self.rotation,
            self.rate + x[:, 3:6],
            self.position + x[:, 6:9],
            self.velocity + x[:, 9:],
        )

    def less(self, other: "Truth") -> Floats:
        """Return the error (C, 12) of the other state: this one is the other one moved by it."""
        turned = rot.log(self.rotation @ np.swapaxes(other.rotation, 1, 2))
        parts = turned, self.rate - other.rate, self.position - other.position, self.velocity - other.velocity
        return np.concatenate(parts, axis=1)

    def ahead(self, step_s: float) -> "Truth":
        """Return the state after a step at constant rates."""
        turned = rot.exp(self.rate * step_s) @ self.rotation
        return Truth(turned, self.rate, self.position + self.velocity * step_s, self.velocity)


def sweep(truth: Truth, points: Floats, frame_s: float) -> tuple[Floats, Floats]:
    """Return the angles from boresight and their instants after the epoch, (C, K, 2) each, by fixed-point iteration."""
    angle = np.zeros((len(points), points.shape[1], 2))
    for _ in range(4):
        instant = (OFFSETS + angle / (2 * np.pi)) * frame_s
        angle = angles_at(truth, points, instant)
    return angle, (OFFSETS + angle / (2 * np.pi)) * frame_s


def angles_at(truth: Truth, points: Floats, instant: Floats) -> Floats:
    """Return the angles (C, K, 2) at which the fans stand when they hit the photodiodes at these instants (C, K, 2)."""
    turn = rot.exp(truth.rate[:, None, None] * instant[..., None])
    arm = np.einsum("ckfij,cjl,ckl->ckfi", turn, truth.rotation, points)
    q = truth.position[:, None, None] + truth.velocity[:, None, None] * instant[..., None] + arm
    out: Floats = -np.arctan2(np.stack([q[..., 0, 0], q[..., 1, 1]], axis=-1), q[..., 2])
    return out


def differences(function: Any, truth: Truth, of: slice = slice(0, 12)) -> Floats:
    """Return the derivative (C, m, 12) of a function of the state with values (C, m), by central differences; `of`:
    only that by these coordinates.
    """
    columns = []
    for i in range(12)[of]:
        x = np.zeros((len(truth.rate), 12))
        x[:, i] = STEP
        columns.append((function(truth.moved(x)) - function(truth.moved(-x))) / (2 * STEP))
    return np.stack(columns, axis=-1)


class Model(NamedTuple):
    """Noise of the angles and of the motion, as the navigation has them."""

    frame_s: float
    sigma: float
    rho: float
    acceleration: float
    angular_acceleration: float

    def process_noise(self) -> Floats:
        """Return Q (12, 12)."""
        gamma = np.array([self.frame_s**2 / 2, self.frame_s])
        block = np.kron(np.outer(gamma, gamma), np.eye(3))
        out = np.zeros((12, 12))
        out[:6, :6], out[6:, 6:] = self.angular_acceleration**2 * block, self.acceleration**2 * block
        return out

    def advanced(self, information: Floats, truth: Truth) -> Floats:
        """Return J before the light of the next period."""
        then = truth.ahead(self.frame_s)
        f = differences(lambda state: state.ahead(self.frame_s).less(then), truth)
        p = f @ np.linalg.inv(information) @ np.swapaxes(f, 1, 2) + self.process_noise()
        out: Floats = np.linalg.inv(p).astype(np.float64)
        return out

    def light(self, truth: Truth, points: Floats, instant: Floats) -> Floats:
        """Return the information (C, 12, 12) of the angles of photodiodes (C, n, 3) at these instants (C, n, 2)."""
        craft, count, _ = points.shape
        h = differences(lambda state: angles_at(state, points, instant).reshape(craft, -1), truth, slice(0, 9))
        h = h.reshape(craft, count, 2, 9)
        # A velocity is a displacement that grows with the time since the epoch.
        h = np.concatenate([h, h[..., 6:] * instant[..., None]], axis=-1)
        total = np.zeros((craft, 12, 12))
        own, shared = (1 - self.rho) * self.sigma**2, self.rho * self.sigma**2
        k = shared / (own + count * shared)
        for fan in range(2):
            rows = h[:, :, fan]
            both = rows.sum(axis=1)
            total += np.swapaxes(rows, 1, 2) @ rows - k * both[:, :, None] * both[:, None, :]
        out: Floats = np.asarray(total / own, dtype=np.float64)
        return out


class Period(NamedTuple):
    """One period of a flight of C craft: the truth, the navigation's estimate with its covariance (C, 12, 12), the
    orders (2, C, 3) since the last epoch, linear and angular; of the n lit photodiodes the points (C, n, 3) [m], their
    measured angles and the instants of these after the epoch, (C, n, 2) each.
    """

    truth: Truth
    known: Truth
    covariance: Floats
    order: Floats
    points: Floats
    angle: Floats
    instant: Floats


class Samples(NamedTuple):
    """Squared errors and traces of the bound of the C craft at one instant, (3, C) each, of attitude, position and the
    centre of the lit photodiodes in straight coordinates; the traces of the filter's own covariance, likewise; and
    their NEES (C,); tilt (C,), of two, the squared error of their line's tilt over its variance, else NaN.
    """

    square: Floats
    bound: Floats
    own: Floats
    nees: Floats
    tilt: Floats


def _order(estimate: Truth) -> tuple[Floats, Floats]:
    """Return the linear and the angular acceleration (C, 3) by which the craft hold their places."""
    away = rot.log(estimate.rotation @ HOLD.T)
    return (
        -STIFFNESS * (estimate.position - PLACE) - DAMPING * estimate.velocity,
        -STIFFNESS * away - DAMPING * estimate.rate,
    )


HOLD = rot.exp(np.array([0.0, np.pi - 0.3, 0.0])) @ rot.exp(np.array([0.2, 0.0, 0.0]))
"""Attitude that the craft hold: the front towards the lighthouse, turned by some 20 degrees."""


def fly(
    settings: NavigationSettings,
    model: Model,
    points: Floats,
    lit: Ints,
    at_s: list[float],
    seed: int,
    log: list[Period] | None = None,
) -> dict[float, Samples]:
    """Fly C craft that see their first `lit` (C, n) photodiodes after a while; return samples at times after that.

    Args:
        settings: of the navigation.
        model: noise of the angles and of the motion.
        points: (K, 3) [m], photodiodes.
        lit: (C, n), photodiodes that stay lit.
        at_s: times after the others go dark [s].
        seed: of all draws.
        log: receives every period, if given.
    """
    rng, craft = np.random.default_rng(seed), len(lit)
    layout: Photodiodes = pad([points] * craft, [np.tile([0.0, 0.0, 1.0], (len(points), 1))] * craft)
    navigator, step = Navigator(layout, settings), model.frame_s
    truth = Truth(
        np.broadcast_to(HOLD, (craft, 3, 3)) @ rot.exp(0.02 * rng.standard_normal((craft, 3))),
        np.zeros((craft, 3)),
        PLACE + 0.02 * rng.standard_normal((craft, 3)),
        np.zeros((craft, 3)),
    )
    information = np.broadcast_to(np.diag(np.repeat([1.0, 1.0, 100.0, 4.0], 3)), (craft, 12, 12))
    order = np.zeros((2, craft, 3))
    out, known = {}, truth
    begin = round(CONVERGE_S / step)
    last = begin + round(max(at_s) / step)
    instants = {begin + round(time / step): time for time in at_s}
    for frame in range(last + 1):
        if frame:
            before = order
            order = np.stack(_order(known))
            noise = (
                rng.standard_normal((2, craft, 3))
                * np.array([model.acceleration, model.angular_acceleration])[:, None, None]
            )
            information = model.advanced(information, truth)
            shift, change = (3 * before + order) * step**2 / 8, (before + order) * step / 2
            shift, change = shift + noise * step**2 / 2, change + noise * step
            truth = truth.ahead(step).moved(np.concatenate([shift[1], change[1], shift[0], change[0]], axis=1))
        shown = lit if frame > begin else np.broadcast_to(np.arange(len(points)), (craft, len(points)))
        bright = points[shown]
        angle, instant = sweep(truth, bright, step)
        information = information + model.light(truth, bright, instant)
        rotor, own = rng.standard_normal((craft, 1, 2)), rng.standard_normal(angle.shape)
        noisy = angle + model.sigma * (np.sqrt(model.rho) * rotor + np.sqrt(1 - model.rho) * own)
        measured_at = instant + (noisy - angle) * step / (2 * np.pi)
        light = _light(np.pi / 2 + noisy, measured_at, shown, len(points))
        estimate = navigator.step(light, None, Command(order[0], order[1]) if frame else None)
        known = Truth(estimate.rotation, estimate.angular_rate, estimate.position, estimate.velocity)
        if log is not None:
            log.append(Period(truth, known, estimate.covariance, order, bright, noisy, measured_at))
        if frame in instants:
            out[instants[frame]] = _samples(truth, known, estimate.covariance, information, points[lit])
        lost = ~np.isfinite(known.position[:, 0])
        if lost.any():  # a craft without an estimate orders nothing
            known = Truth(
                *(
                    np.where(lost.reshape(-1, *[1] * (a.ndim - 1)), b, a)
                    for a, b in zip(known, _held(craft), strict=True)
                )
            )
    return out


def _light(theta: Floats, offset_s: Floats, shown: Ints, photodiodes: int) -> SweepAngles:
    """Return the angles (C, n, 2) of those photodiodes (C, n) of K that are lit as the decoder has them."""
    craft = len(theta)
    at = np.arange(craft)[:, None], shown
    every, instant = np.full((craft, photodiodes, 2), np.nan), np.zeros((craft, photodiodes, 2))
    every[at], instant[at] = theta, offset_s
    none = np.zeros(craft, dtype=np.int64)
    return SweepAngles(every, instant, np.isfinite(every[..., 0]), none, none, none)


def _held(craft: int) -> Truth:
    zero = np.zeros((craft, 3))
    return Truth(np.broadcast_to(HOLD, (craft, 3, 3)), zero, np.broadcast_to(PLACE, (craft, 3)), zero)


def _samples(truth: Truth, known: Truth, covariance: Floats, information: Floats, lit: Floats) -> Samples:
    """Return the errors, the bound, and the NEES of the attitude and of the centre of the lit photodiodes (C, n, 3)
    [m]: there the error of a turn about them is straight (`estimators.pivot`), and the covariance holds for wide errors
    too. Of two, the attitude is three angles, and the distance that which they appear to have.
    """
    error, centre = truth.less(known), lit.mean(axis=1)
    bound = np.linalg.inv(information).astype(np.float64)
    pose = np.array([0, 1, 2, 6, 7, 8])

    def at_centre(state: Truth, p: NDArray[np.floating[Any]]) -> tuple[Floats, NDArray[np.floating[Any]]]:
        arm = np.einsum("cij,cj->ci", state.rotation, centre)
        turn = np.tile(np.eye(6), (len(error), 1, 1))
        turn[:, 3:, :3] = -rot.skew(arm)
        return arm, turn @ p[:, pose[:, None], pose] @ np.swapaxes(turn, 1, 2)

    arm, p = at_centre(known, covariance)
    there_arm, best = at_centre(truth, bound)
    e = error[:, pose]
    e[:, 3:] += there_arm - arm
    tilt = np.full(len(error), np.nan)
    if lit.shape[1] == 2:
        line = lit[:, 1] - lit[:, 0]
        e[:, :3] = _three_angles(truth, known, known.position + arm, line)
        e[:, 3:] += _unbent(e, truth, known, there_arm, arm, line)
        axis = np.cross(np.einsum("cij,cj->ci", known.rotation, line), known.position + arm)
        tilt = np.einsum("ci,ci->c", axis, e[:, :3]) ** 2 / np.einsum("ci,cij,cj->c", axis, p[:, :3, :3], axis)
    parts = error[:, :3], error[:, 6:9], e[:, 3:]
    square = np.stack([np.sum(part**2, axis=1) for part in parts])
    traces, own = (
        np.stack(
            [np.trace(block, axis1=1, axis2=2) for block in (whole[:, :3, :3], whole[:, 6:9, 6:9], part[:, 3:, 3:])]
        )
        for whole, part in ((bound, best), (covariance, p))
    )
    there = np.isfinite(error).all(axis=1)
    nees = np.full(len(error), np.nan)
    nees[there] = np.einsum("ci,ci->c", e[there], np.linalg.solve(p[there], e[there, :, None])[..., 0])
    return Samples(square, traces, own, nees, tilt)


def _three_angles(truth: Truth, known: Truth, centre: Floats, line: Floats) -> Floats:
    """Return the attitude's error (C, 3) as angles about the line of sight, of tilt, and about the line of the two.

    Args:
        truth: states.
        known: estimates.
        centre: (C, 3) [m], of the two photodiodes, estimated.
        line: (C, 3) [m], between the two, body frame.
    """
    sight = centre / np.linalg.norm(centre, axis=1, keepdims=True)
    aside = np.cross(line, [0.3, 0.5, 0.8])

    def frame(rotation: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        along = np.einsum("cij,cj->ci", rotation, line)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        tilt = np.cross(along, sight)
        cosine = np.linalg.norm(tilt, axis=1)
        side = np.einsum("cij,cj->ci", rotation, aside)
        tilt /= cosine[:, None]
        spin = np.arctan2(np.einsum("ci,ci->c", side, np.cross(along, tilt)), np.einsum("ci,ci->c", side, tilt))
        return along, tilt, np.arctan2(np.einsum("ci,ci->c", sight, along), cosine), spin

    (_, there, tilted, spun), (along, here, tilt, spin) = frame(truth.rotation), frame(known.rotation)
    lies = np.arctan2(np.einsum("ci,ci->c", sight, np.cross(here, there)), np.einsum("ci,ci->c", here, there))
    turned = np.angle(np.exp(1j * (spun - spin)))
    out: Floats = lies[:, None] * sight + (tilted - tilt)[:, None] * here + turned[:, None] * along
    return out


def _unbent(error: Floats, truth: Truth, known: Truth, own: Floats, arm: Floats, line: Floats) -> Floats:
    """Return what the distance of two photodiodes' centre must change by, (C, 3) [m], to be straight.

    It is known by how long the line between them appears, so that its error follows that of the line's tilt.

    Args:
        error: (C, 6), of attitude and centre.
        truth: states.
        known: estimates.
        own: (C, 3) [m], the centre from the craft's origin.
        arm: likewise, estimated.
        line: (C, 3) [m], between the two, body frame.
    """

    def length(rotation: Floats, centre: Floats) -> Floats:
        far = np.linalg.norm(centre, axis=1)
        sight, turned = centre / far[:, None], np.einsum("cij,cj->ci", rotation, line)
        out: Floats = np.log(far) - np.log(np.linalg.norm(np.cross(turned, sight), axis=1))
        return out

    centre, d = known.position + arm, error[:, :3]
    far = np.linalg.norm(centre, axis=1)
    apart = length(truth.rotation, truth.position + own) - length(known.rotation, centre)
    step = 1e-3
    tilt = [length(rot.exp(sign * step * d) @ known.rotation, centre) for sign in (1, -1)]
    along = far * (apart - (tilt[0] - tilt[1]) / (2 * step))
    sight = centre / far[:, None]
    out: Floats = sight * (along - np.einsum("ci,ci->c", sight, error[:, 3:]))[:, None]
    return out


def figures(samples: list[Samples]) -> dict[str, Any]:
    """Return RMS, bound, their ratio, and the NEES with its 95 % band, of independent samples."""
    square, bound, own, nees, tilt = (np.concatenate(part, axis=-1) for part in zip(*samples, strict=True))
    known = np.isfinite(nees)
    rms, best, sigma = (np.sqrt(part[:, known].mean(axis=1)) for part in (square, bound, own))
    # Standard error of the ratios, of independent craft: half of that of the squares.
    error = (square[:, known] / best[:, None] ** 2 - bound[:, known] * (rms / best**2)[:, None] ** 2).std(axis=1)
    error *= best / rms / 2 / np.sqrt(known.sum())
    median, best_median = (np.sqrt(np.median(part[:, known], axis=1)) for part in (square, bound))
    n = int(known.sum())
    low, high = chi2.ppf([0.025, 0.975], 6 * n) / n
    mean = float(nees[known].mean())
    return {
        "known": float(known.mean()),
        "position_rms_mm": 1e3 * float(rms[1]),
        "position_median_mm": 1e3 * float(median[1]),
        "position_bound_mm": 1e3 * float(best[1]),
        "position_bound_median_mm": 1e3 * float(best_median[1]),
        "position_ratio": float(rms[1] / best[1]),
        "position_ratio_error": float(error[1]),
        "position_sigma_ratio": float(sigma[1] / best[1]),
        "straight_ratio": float(rms[2] / best[2]),
        "attitude_rms_deg": float(np.degrees(rms[0])),
        "attitude_median_deg": float(np.degrees(median[0])),
        "attitude_bound_deg": float(np.degrees(best[0])),
        "attitude_bound_median_deg": float(np.degrees(best_median[0])),
        "attitude_ratio": float(rms[0] / best[0]),
        "attitude_ratio_error": float(error[0]),
        "attitude_sigma_ratio": float(sigma[0] / best[0]),
        "tilt_square": float(tilt[known].mean()),
        "nees": mean,
        "nees_low": float(low),
        "nees_high": float(high),
        "inside": bool(low <= mean <= high),
        "samples": n,
    }


class Kept:
    """Samples by case and seed, in a file if there is one."""

    def __init__(self, file: str, what: str) -> None:
        """Begin with the samples of the file that were made as `what` says; an empty name: with none, and keep none."""
        self._file, self._what = file, what
        self._arrays: dict[str, Floats] = {}
        if file and Path(file).is_file():
            with np.load(file) as stored:
                self._arrays.update(stored)

    def has(self, case: str, seed: int) -> bool:
        """Return whether the samples of a case and seed are there."""
        return self._name(case, seed) in self._arrays

    def get(self, case: str, seed: int) -> Samples:
        """Return the samples of a case and seed."""
        rows = self._arrays[self._name(case, seed)]
        return Samples(rows[:3], rows[3:6], rows[6:9], rows[9], rows[10])

    def add(self, made: dict[str, Samples], seed: int) -> None:
        """Add the samples of cases, and write the file."""
        for case, one in made.items():
            self._arrays[self._name(case, seed)] = np.concatenate(
                [one.square, one.bound, one.own, one.nees[None], one.tilt[None]]
            )
        if self._file:
            np.savez(self._file, **self._arrays)  # type: ignore[arg-type]

    def _name(self, case: str, seed: int) -> str:
        return f"{self._what}: {case}, seed {seed}"


def mockup() -> Floats:
    """Return the mockup's photodiodes (12, 3) [m]."""
    from swarm.flight.flight import Flight

    photodiodes = Flight(load("drift", ["swarm.count=1"])).world.photodiodes
    points: Floats = photodiodes.point_m[0][photodiodes.present[0]]
    return points


def main() -> None:
    """Fly, and print."""
    chosen = options(
        __doc__,
        craft=(200, "craft per seed"),
        seeds=(8, "seeds"),
        photodiodes=([1, 2, 3, 4, 12], "numbers of lit photodiodes"),
        at_s=([1.0, 5.0], "instants after the others go dark [s]"),
        coupling=("auto", "navigation.coupling"),
        independent=(False, "take the rows as independent in the filter"),
        keep=("", "file of the samples, to go on from"),
    )
    overrides = ['navigation.filter="compiled"', 'navigation.quiet.craft="none"']
    scenario = load("drift", [f'navigation.coupling="{chosen.coupling}"', *overrides])
    settings = builders.navigation(scenario)
    model = Model(
        settings.frame_s,
        settings.angle_noise_rad,
        settings.rotor_correlation,
        settings.acceleration_noise_m_s2,
        settings.angular_acceleration_noise_rad_s2,
    )
    if chosen.independent:
        from dataclasses import replace

        settings = replace(settings, rotor_correlation=0.0)
    points, result = mockup(), {}
    samples: dict[str, list[Samples]] = {f"{n} lit, {time:g} s": [] for n in chosen.photodiodes for time in chosen.at_s}
    kept = Kept(chosen.keep, f"{chosen.craft} craft, {chosen.coupling}, {chosen.independent}")
    for seed in range(chosen.seeds):
        for count in chosen.photodiodes:
            names = {time: f"{count} lit, {time:g} s" for time in chosen.at_s}
            if not all(kept.has(name, seed) for name in names.values()):
                rng = np.random.default_rng([seed, count])
                lit = np.argsort(rng.random((chosen.craft, len(points))), axis=1)[:, :count]
                flown = fly(settings, model, points, lit, chosen.at_s, 1000 * count + seed)
                kept.add({names[time]: one for time, one in flown.items()}, seed)
            for name in names.values():
                samples[name].append(kept.get(name, seed))
        # After every seed, so that a run that is stopped says something.
        result = {key: figures(some) for key, some in samples.items()}
        rows = [[key, *value.values()] for key, value in result.items()]
        show(f"by single sweeps, {seed + 1} of {chosen.seeds} seeds", ["", *next(iter(result.values()))], rows)
        finish("single_sweeps", {"coupling": chosen.coupling, "seeds": seed + 1, "cases": result}, chosen.out)


if __name__ == "__main__":
    main()
