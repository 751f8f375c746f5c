"""What are several models of motion worth? Error and NEES by scenario, with one process noise and with a series.

    python benchmarks/motion_models.py [--scenarios free-flight formation crossing docking tumble] [--seeds 1]
                                       [--duration-s 15] [--settle-s 1] [--models 6] [--ways one several]
                                       [--set KEY=VALUE ...]

Every scenario flies once per seed and navigates several ways on the same light and orders: `one`, by the one model of
`navigation.quiet.craft = "none"`; `several`, as shipped; `loose`, by one model and by poses only, as it was before
single sweeps and models of motion; `late`, as shipped, but with orders taken to act when their period begins, half a
physics step after they do. The motion itself is that of the shipped way, which steers. Results are written
after every scenario. `few` are the periods with fewer than four photodiodes lit; `without` is the share of the
craft-periods without an estimate; craft without photodiodes are left out. A second table has NEES of every craft, in
eight parts of the flight, of up to 16 craft.

Periods of one craft are not independent. The band is of one period per craft and seed, the last one with a pose:
`nees_last` may be compared with it. `nees`, the mean over all periods, is what the summary of a run tells. The standard
error of `few_nees` is that over flights of single craft.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from harness import finish, options, show
from scipy.stats import chi2

from estimators import rotation as rot
from estimators.arrays import Floats
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.onboard.navigation import Estimate, Navigator
from swarm.results.period import Period
from swarm.scenario import load

POSE = np.array([0, 1, 2, 6, 7, 8])
SHIPPED = "several"
FEW = 4
"""Photodiodes below which a craft has no pose of its own."""
MOST_ROWS, PARTS = 16, 8
"""Craft up to which each has a line of its own, and equal parts of the flight that the line has."""


def errors(period: Period, estimate: Estimate) -> Floats:
    """Return the errors of position [m] and attitude [rad] and the NEES, (C, 3); NaN without an estimate."""
    truth = period.truth
    assert truth is not None
    turned = rot.log(rot.matrix_from_quaternion(truth.quaternion) @ np.swapaxes(estimate.rotation, 1, 2))
    error = np.concatenate([turned, truth.position - estimate.position], axis=1)
    out = np.full((len(error), 3), np.nan)
    known = np.isfinite(error).all(axis=1)
    out[:, 0], out[:, 1] = np.linalg.norm(error[:, 3:], axis=1), np.linalg.norm(turned, axis=1)
    p, e = estimate.covariance[known][:, POSE[:, None], POSE], error[known]
    out[known, 2] = np.einsum("ci,ci->c", e, np.linalg.solve(p, e[..., None])[..., 0])
    return out


def fly(
    name: str, seed: int, duration_s: float, models: int, ways: Sequence[str], steps: int, more: Sequence[str]
) -> Floats:
    """Return errors and numbers of lit photodiodes (W, T, C, 4) of one flight, of craft with photodiodes, by every way.

    Args:
        name: the scenario.
        seed: of the flight.
        duration_s: of the flight [s].
        models: number of models of motion of the craft that fly.
        ways: W of WAYS.
        steps: physics steps in a period; 0: as the scenario does.
        more: other values of the scenario, as KEY=VALUE.
    """
    values = [f"duration_s={duration_s}", f"navigation.quiet.models={models}", 'navigation.filter="compiled"']
    values += [f"physics.steps_per_period={steps}"] if steps else []
    values += filter(None, more)
    scenario = load(name, values, seed=seed)
    flight = Flight(scenario)
    own = flight.computer.navigator
    layout = builders.assembly.own_layout(scenario, flight.world)
    settings = {
        "one": replace(own.settings, quiet=None),
        "loose": replace(own.settings, quiet=None, coupling="loose"),
        "late": replace(own.settings, order_lead_s=0.0),
    }
    others = {way: Navigator(layout, settings[way], (), own.tracks.inertia) for way in ways if way != SHIPPED}
    out: dict[str, list[Floats]] = {way: [] for way in ways}
    for period in flight.fly():
        for way in ways:
            by = others[way].step(period.angles, None, flight.command) if way != SHIPPED else period.estimate
            out[way].append(np.column_stack([errors(period, by), period.estimate.visible]))
    return np.array(list(out.values()))[:, :, layout.present.any(axis=1)]


def _rms(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def _mean_of_flights(values: Sequence[Floats]) -> tuple[float, float]:
    """Return the mean of the samples of all craft and flights, and its standard error.

    Samples of one flight of a craft are not independent, flights are: the error is that of a ratio of sums over flights
    (Cochran, Sampling Techniques, 1977, eq. 6.13).
    """
    known = [own[np.isfinite(own)] for own in values if np.isfinite(own).any()]
    if not known:
        return float("nan"), float("nan")
    sums, counts = np.array([own.sum() for own in known]), np.array([len(own) for own in known])
    mean = sums.sum() / counts.sum()
    spread = np.sum((sums - mean * counts) ** 2) * len(known) / max(len(known) - 1, 1)
    return float(mean), float(np.sqrt(spread) / counts.sum()) if len(known) > 1 else float("nan")


def figures(flown: Sequence[Floats]) -> dict[str, Any]:
    """Return RMS and NEES of flights (T, C, 4) of one scenario."""
    owns = [own for one in flown for own in np.swapaxes(one, 0, 1)]
    every = np.concatenate(owns)
    few = every[every[:, 3] < FEW]
    few = few if np.isfinite(few[:, 0]).any() else np.full((1, 4), np.nan)
    last = np.array([known[-1] for own in owns if len(known := own[np.isfinite(own[:, 2]), 2])])
    few_nees, few_nees_error = _mean_of_flights([own[own[:, 3] < FEW, 2] for own in owns])
    low, high = chi2.ppf([0.025, 0.975], 6 * len(last)) / len(last)
    return {
        "position_rms_mm": 1e3 * _rms(every[:, 0]),
        "attitude_rms_deg": float(np.degrees(_rms(every[:, 1]))),
        "nees": float(np.nanmean(every[:, 2])),
        "nees_last": float(last.mean()),
        "nees_low": float(low),
        "nees_high": float(high),
        "samples": len(last),
        "without": float(np.mean(np.isnan(every[:, 0]))),
        "worst_mm": 1e3 * float(np.nanmax(every[:, 0])),
        "worst_deg": float(np.degrees(np.nanmax(every[:, 1]))),
        "few_rms_mm": 1e3 * _rms(few[:, 0]),
        "few_rms_deg": float(np.degrees(_rms(few[:, 1]))),
        "few_nees": few_nees,
        "few_nees_error": few_nees_error,
    }


def by_craft(flown: Sequence[Floats], parts: int) -> list[list[float]]:
    """Return mean NEES of flights (T, C, 4) of one scenario per craft (C), of the whole and of so many parts of it."""
    nees = np.concatenate([one[:, :, 2] for one in flown])
    pieces = [nees, *np.array_split(nees, parts)]
    return [
        [float(np.mean(own[np.isfinite(own)])) if np.isfinite(own).any() else float("nan") for own in of_craft]
        for of_craft in zip(*(piece.T for piece in pieces), strict=True)
    ]


def main() -> None:
    """Fly, and print."""
    chosen = options(
        __doc__,
        scenarios=(["free-flight", "formation", "crossing", "docking", "tumble"], "scenarios"),
        seeds=(1, "seeds of each"),
        duration_s=(15.0, "of every flight [s]"),
        settle_s=(1.0, "time at the start that is left out [s]"),
        models=(6, "models of motion"),
        ways=(["one", "several"], "ways to navigate: late, loose, one, several"),
        steps=(0, "physics steps in a period; 0: as the scenario does"),
        set=([""], "other values of the scenarios, as KEY=VALUE"),
    )
    result: dict[str, Any] = {}
    for name in chosen.scenarios:
        seeds = range(1, chosen.seeds + 1)
        how = chosen.duration_s, chosen.models, chosen.ways, chosen.steps, chosen.set
        flown = [fly(name, seed, *how) for seed in seeds]
        begin = round(chosen.settle_s / chosen.duration_s * flown[0].shape[1])
        result[name] = {way: figures([one[k, begin:] for one in flown]) for k, way in enumerate(chosen.ways)}
        columns = ["", *next(iter(result[name].values()))]
        show("models of motion", columns, [[f"{name}, {way}", *of.values()] for way, of in result[name].items()])
        if flown[0].shape[2] <= MOST_ROWS:
            for k, way in enumerate(chosen.ways):
                parts = by_craft([one[k, begin:] for one in flown], PARTS)
                result[name][way]["nees_by_craft"] = parts
                columns = ["craft", "whole", *(f"part {part + 1}" for part in range(PARTS))]
                show(f"NEES, {name}, {way}", columns, [[str(c), *row] for c, row in enumerate(parts)])
        finish("motion_models", {"scenarios": result}, chosen.out)


if __name__ == "__main__":
    main()
