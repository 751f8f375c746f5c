"""Are the errors of plates at rest those that their filters claim? NEES of plates face-on and slightly turned.

    python benchmarks/plates.py [--seeds 8] [--duration-s 5] [--plates 8] [--core CORE] [--out FILE]

Per seed so many plates of each kind of the scenario `plate` side by side, at rest. Every flight navigates twice on the
same light: by several models of motion, as shipped, and by one. Plates and seeds are independent, periods of one plate
are not: the band is of the plates' NEES at one instant; `mean` is over all periods after the first second, with its
standard error by the scatter from plate to plate.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from harness import finish, options, show
from motion_models import errors
from scipy.stats import chi2

from estimators.arrays import Floats
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.onboard.navigation import Navigator
from swarm.scenario import load

KINDS = "head-on", "slanted"
WAYS = "one model", "several"
SETTLE_S = 1.0


def fly(seed: int, duration_s: float, plates: int) -> Floats:
    """Return the NEES (2, T, 2, P): by one model and by several, by period, kind and plate; NaN without a pose."""
    plate = load("plate", [f"duration_s={duration_s}", 'navigation.filter="compiled"'], seed=seed)
    craft = []
    for one in plate.craft:
        if one.name in KINDS:
            hold: Any = one.motion
            _, y, z = hold.position_m
            for i in range(plates):
                motion = hold.model_copy(update={"position_m": (0.3 * (i - (plates - 1) / 2), y, z)})
                craft.append(one.model_copy(update={"name": f"{one.name}-{i}", "motion": motion}))
    scenario = plate.model_copy(update={"craft": craft})
    flight = Flight(scenario)
    own = flight.computer.navigator
    layout = builders.assembly.own_layout(scenario, flight.world)
    single = Navigator(layout, replace(own.settings, quiet=None), (), own.tracks.inertia)
    out: list[list[Floats]] = [[], []]
    for period in flight.fly():
        out[0].append(errors(period, single.step(period.angles, None, flight.command))[:, 2])
        out[1].append(errors(period, period.estimate)[:, 2])
    return np.array(out).reshape(2, -1, 2, plates)


def main() -> None:
    """Fly, and print."""
    chosen = options(
        __doc__,
        seeds=(8, "seeds"),
        duration_s=(5.0, "of every flight [s]"),
        plates=(8, "plates of each kind and seed"),
    )
    nees = np.concatenate([fly(seed, chosen.duration_s, chosen.plates) for seed in range(chosen.seeds)], axis=-1)
    rate = nees.shape[1] / chosen.duration_s
    count = nees.shape[-1]
    low, high = chi2.ppf([0.025, 0.975], 6 * count) / count
    rows, result = [], {}
    for k, kind in enumerate(KINDS):
        for w, way in enumerate(WAYS):
            one = nees[w, :, k]
            each = np.nanmean(one[round(SETTLE_S * rate) :], axis=0)
            at = {
                f"at {t} s": float(np.nanmean(one[round(t * rate) - 1])) for t in range(1, int(chosen.duration_s) + 1)
            }
            mean, error = float(each.mean()), float(each.std(ddof=1) / np.sqrt(count))
            known = float(np.isfinite(one).mean())
            result[f"{kind}, {way}"] = {
                **at,
                "mean": mean,
                "standard_error": error,
                "largest": float(each.max()),
                "known": known,
            }
            rows.append([f"{kind}, {way}", *at.values(), mean, error, float(each.max()), known])
    show(
        f"NEES of {count} plates of each kind, band {low:.2f} to {high:.2f}",
        ["", *next(iter(result.values()))],
        rows,
    )
    finish("plates", {"plates": count, "band": [float(low), float(high)], "cases": result}, chosen.out)


if __name__ == "__main__":
    main()
