"""What are several models of motion worth? Error and NEES by scenario, with one process noise and with a series.

    python benchmarks/motion_models.py [--scenarios free-flight formation crossing docking tumble] [--seeds 1]
                                       [--duration-s 15] [--settle-s 1] [--models 6]

Every scenario flies once per seed and navigates twice on the same light and orders: by the one model of
`navigation.quiet.craft = "none"` and by several. The motion itself is that of the latter, which steers.

Periods of one craft are not independent. The band is of one period per craft and seed, the last one with a pose:
`nees_last` may be compared with it. `nees`, the mean over all periods, is what the summary of a run tells.
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


def fly(name: str, seed: int, duration_s: float, models: int) -> Floats:
    """Return the errors (2, T, C, 3) of one flight, by one model and by several."""
    values = [f"duration_s={duration_s}", f"navigation.quiet.models={models}", 'navigation.filter="compiled"']
    scenario = load(name, values, seed=seed)
    flight = Flight(scenario)
    own = flight.computer.navigator
    layout = builders.assembly.own_layout(scenario, flight.world)
    other = Navigator(layout, replace(own.settings, quiet=None), (), own.tracks.inertia)
    out: list[list[Floats]] = [[], []]
    for period in flight.fly():
        one = other.step(period.angles, None, flight.command)
        out[0].append(errors(period, one))
        out[1].append(errors(period, period.estimate))
    return np.array(out)


def figures(flown: Sequence[Floats]) -> dict[str, Any]:
    """Return RMS and NEES of flights (T, C, 3) of one scenario."""
    every = np.concatenate([one.reshape(-1, 3) for one in flown])
    last = np.array([own[np.isfinite(own)][-1] for one in flown for own in one[:, :, 2].T if np.isfinite(own).any()])
    low, high = chi2.ppf([0.025, 0.975], 6 * len(last)) / len(last)
    return {
        "position_rms_mm": 1e3 * float(np.sqrt(np.nanmean(every[:, 0] ** 2))),
        "attitude_rms_deg": float(np.degrees(np.sqrt(np.nanmean(every[:, 1] ** 2)))),
        "nees": float(np.nanmean(every[:, 2])),
        "nees_last": float(last.mean()),
        "nees_low": float(low),
        "nees_high": float(high),
        "samples": len(last),
    }


def main() -> None:
    """Fly, and print."""
    chosen = options(
        __doc__,
        scenarios=(["free-flight", "formation", "crossing", "docking", "tumble"], "scenarios"),
        seeds=(1, "seeds of each"),
        duration_s=(15.0, "of every flight [s]"),
        settle_s=(1.0, "time at the start that is left out [s]"),
        models=(6, "models of motion"),
    )
    result: dict[str, Any] = {}
    for name in chosen.scenarios:
        flown = [fly(name, seed, chosen.duration_s, chosen.models) for seed in range(1, chosen.seeds + 1)]
        begin = round(chosen.settle_s / chosen.duration_s * flown[0].shape[1])
        result[name] = {
            label: figures([one[k, begin:] for one in flown]) for k, label in enumerate(("one model", "several"))
        }
    rows = [[f"{name}, {label}", *of.values()] for name, both in result.items() for label, of in both.items()]
    show("models of motion", ["", *next(iter(next(iter(result.values())).values()))], rows)
    finish("motion_models", {"scenarios": result}, chosen.out)


if __name__ == "__main__":
    main()
