"""How soon are two mirror poses told apart? Time to the first pose by static poses and by sweep angles, and faults.

    python benchmarks/mirror_images.py [--craft 200] [--seeds 2] [--periods 240] [--rates-deg-s 0 3 10]
                                       [--core CORE] [--out FILE]

Craft with four photodiodes in a plane, the mockup's top, 3 to 8 m away and tilted by 12 to 35 degrees, so that two
poses fit their light; they turn at a constant rate about a random axis and drift at 2 cm/s. `loose` sums up how much
better one of two poses fits, period by period, as if the craft were at rest within each; `auto` gives the sweep angles
to a filter at either. Both see the same light. A first pose is *wrong* beyond 5.33 sigmas of its own covariance, in
attitude or position, or by more than 8 degrees: the other image.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from harness import finish, options, show
from single_sweeps import Truth, sweep

from estimators import rotation as rot
from estimators.arrays import Floats
from swarm.flight import builders
from swarm.hardware import pad
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.navigation import Navigator
from swarm.scenario import load

POINTS = 0.018 * np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) + [0, 0, 0.038]
QUANTILE, OTHER_RAD = 5.33, np.radians(8.0)


def start(rng: np.random.Generator, craft: int, rate_deg_s: float) -> Truth:
    """Return craft that face the lighthouse, tilted."""
    away = rng.uniform(3.0, 8.0, craft)
    place = np.stack([*rng.uniform(-0.3, 0.3, (2, craft)), np.ones(craft)], axis=1)
    place *= (away / np.linalg.norm(place, axis=1))[:, None]
    around, tilt = rng.uniform(0, 2 * np.pi, craft), np.radians(rng.uniform(12, 35, craft))
    turn = tilt[:, None] * np.stack([np.cos(around), np.sin(around), np.zeros(craft)], axis=1)
    spin, drift = rng.standard_normal((2, craft, 3))
    spin *= np.radians(rate_deg_s) / np.linalg.norm(spin, axis=1, keepdims=True)
    facing = rot.exp(np.array([0.0, np.pi, 0.0]))
    return Truth(rot.exp(turn) @ facing, spin, place, 0.02 * drift / np.sqrt(3))


def fly(settings: Any, craft: int, periods: int, rate_deg_s: float, seed: int) -> dict[str, Floats]:
    """Return per way the period of every craft's first pose, NaN without one, and whether it was wrong, (2, C)."""
    rng = np.random.default_rng(seed)
    layout = pad([POINTS] * craft, [np.tile([0.0, 0.0, 1.0], (len(POINTS), 1))] * craft)
    ways = {way: Navigator(layout, replace(settings, coupling=way)) for way in ("loose", "auto")}
    out = {way: np.full((2, craft), np.nan) for way in ways}
    truth, rho = start(rng, craft, rate_deg_s), settings.rotor_correlation
    none, seen = np.zeros(craft, dtype=np.int64), np.ones((craft, len(POINTS)), dtype=np.bool_)
    for period in range(periods):
        truth = truth.ahead(settings.frame_s) if period else truth
        angle, instant = sweep(truth, np.broadcast_to(POINTS, (craft, *POINTS.shape)), settings.frame_s)
        rotor, own = rng.standard_normal((craft, 1, 2)), rng.standard_normal(angle.shape)
        noisy = angle + settings.angle_noise_rad * (np.sqrt(rho) * rotor + np.sqrt(1 - rho) * own)
        light = SweepAngles(np.pi / 2 + noisy, instant, seen, none, none, none)
        for way, navigator in ways.items():
            known = navigator.step(light)
            first = np.isnan(out[way][0]) & np.isfinite(known.position[:, 0])
            error = truth.less(Truth(known.rotation, known.angular_rate, known.position, known.velocity))
            p = known.covariance
            wrong = np.linalg.norm(error[:, :3], axis=1) > OTHER_RAD
            for part in (slice(0, 3), slice(6, 9)):
                sigma = np.sqrt(np.trace(p[:, part, part], axis1=1, axis2=2))
                wrong |= np.linalg.norm(error[:, part], axis=1) > QUANTILE * sigma
            out[way][0, first], out[way][1, first] = period, wrong[first]
    return out


def figures(first: Floats, periods: int, frame_s: float) -> dict[str, float]:
    """Return the figures of first poses (2, C)."""
    at = np.where(np.isnan(first[0]), periods, first[0]) * frame_s
    known = np.isfinite(first[0])
    return {
        "at once": float((first[0] == 0).mean()),
        "median_s": float(np.median(at)),
        "mean_s": float(at.mean()),
        "90_percent_s": float(np.quantile(at, 0.9)),
        "never": float((~known).mean()),
        "wrong": int(first[1][known].sum()),
        "craft": len(at),
    }


def main() -> None:
    """Fly, and print."""
    chosen = options(
        __doc__,
        craft=(200, "craft per seed"),
        seeds=(2, "seeds"),
        periods=(240, "periods"),
        rates_deg_s=([0.0, 3.0, 10.0], "rates of turn [deg/s]"),
    )
    settings = builders.navigation(load("drift", ['navigation.filter="compiled"']))
    result: dict[str, Any] = {}
    for rate in chosen.rates_deg_s:
        flown = [fly(settings, chosen.craft, chosen.periods, rate, seed) for seed in range(chosen.seeds)]
        for way in flown[0]:
            first = np.concatenate([one[way] for one in flown], axis=1)
            result[f"{rate:g} deg/s, {way}"] = figures(first, chosen.periods, settings.frame_s)
            print(f"{rate:g} deg/s, {way}", result[f"{rate:g} deg/s, {way}"], flush=True)
    show(
        "first pose of craft whose light fits two",
        ["", *next(iter(result.values()))],
        [[name, *one.values()] for name, one in result.items()],
    )
    finish("mirror_images", {"cases": result}, chosen.out)


if __name__ == "__main__":
    main()
