"""Is the filter consistent? NEES and NIS of `drift`, whose motion is exactly the filter's own model, over many seeds.

    python benchmarks/consistency.py [--seeds 50]

Samples are independent: one instant per craft and seed, each craft of a seed at an instant of its own, half a second
from the next one's, because the rotor's noise is one draw for all craft of a sweep and the filter's memory is some
tens of periods. The mean NEES of n such samples is chi-square with 6 n degrees of freedom, divided by n.
"""

import argparse
import json
import platform
from importlib.metadata import version

import numpy as np
from scipy.stats import chi2

from estimators import rotation as rot
from swarm.flight.flight import Flight
from swarm.scenario import load

DOF = 6
BETWEEN = 30
"""Periods between the instants of two craft."""


def samples(seed: int) -> tuple[list[float], list[float]]:
    """NEES and NIS of one flight, a sample of each per craft."""
    scenario = load("drift", seed=seed)
    flight = Flight(scenario)
    frames = round(scenario.duration_s / flight.period_s)
    nees, nis = [], []
    at = {frames - 1 - BETWEEN * craft: craft for craft in range(len(flight.world.names))}
    for frame in range(frames):
        period = flight.period(frame)
        truth, estimate = period.truth, period.estimate
        if (craft := at.get(frame)) is None:
            continue
        assert truth is not None
        error = np.concatenate(
            [
                rot.log(rot.matrix_from_quaternion(truth.quaternion[craft]) @ estimate.rotation[craft].T),
                truth.position[craft] - estimate.position[craft],
            ]
        )
        pose = np.ix_((0, 1, 2, 6, 7, 8), (0, 1, 2, 6, 7, 8))
        nees.append(float(error @ np.linalg.solve(estimate.covariance[craft][pose], error)))
        nis.append(float(estimate.nis[craft]))
    return nees, nis


def verdict(values: list[float]) -> dict[str, float | bool | int]:
    """The samples' mean against the 95 % band of the mean of as many chi-square values, 6 degrees of freedom each."""
    known = np.array(values)[np.isfinite(values)]
    low, high = chi2.ppf([0.025, 0.975], DOF * len(known)) / len(known)
    mean = float(known.mean())
    return {"mean": mean, "low": low, "high": high, "inside": bool(low <= mean <= high), "samples": len(known)}


def main() -> None:
    """Fly, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    seeds = parser.parse_args().seeds
    nees: list[float] = []
    nis: list[float] = []
    for seed in range(seeds):
        for every, of_seed in zip((nees, nis), samples(seed), strict=True):
            every.extend(of_seed)
    names = ("mujoco", "numpy", "filterpy", "numba")
    print(
        json.dumps(
            {
                "seeds": seeds,
                "nees": verdict(nees),
                "nis": verdict(nis),
                "machine": platform.processor() or platform.machine(),
                "versions": {name: version(name) for name in names},
            },
            indent=2,
        )
    )


if __name__ == "__main__":
    main()
