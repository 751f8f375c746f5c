"""A tumbling target of unknown inertia, scanned for a while and then not for ten seconds: where it is believed to be.

    PYTHONPATH=. python benchmarks/lidar_blind.py [--tumbles 10] [--scans 120] [--blind 10] [--seed 0] [--json]

The satellite (inertia 32, 16, 26 kg m^2) tumbles by Euler's equation before the paper's LiDAR, 5 m away, at a rate
drawn per tumble, 2 to 6 deg/s about any axis. Every 0.25 s a scan is tracked from the prediction, and its attitude
taken in by `estimators.filter.tumble`, to which rates and inertia are unknown. Then nothing is seen for so long. One
scan follows, tracked from the prediction. Per tumble, and over all:

    error of the attitude at the end of the dark, its 1 sigma promised about the direction of the error, and their ratio
    error of constant rates and of the true inertia's motion from the same estimate, for comparison
    whether the first scan tracks, and how far it is off
    moments of inertia (mean one), their errors in sigmas, and how many of the five ratios are observed
"""

import argparse
import json
from typing import Any

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.filter.tumble import Tumble
from estimators.free_rotation import free_turns
from estimators.lidar.acquisition import acquire
from estimators.lidar.tracking import track
from swarm.studies.papers.lidar import Turntable, error_deg
from swarm.studies.papers.lidar_acquisition import random_rotations

MOMENTS = np.array([32.0, 16.0, 26.0])
PERIOD_S, STEP_S = 0.25, 0.05
SLOWEST_DEG_S, FASTEST_DEG_S = 2.0, 6.0
UNKNOWN_RATE_RAD_S = 0.3


def moved(rotation: Floats, rate: Floats, time_s: float) -> tuple[Floats, Floats]:
    """Return attitude and angular rate after a time, by Euler's equation."""
    tensor, one = np.diag(MOMENTS)[None], np.ones(1, dtype=np.bool_)
    for _ in range(round(time_s / STEP_S)):
        step = free_turns(one, rotation[None], rate[None], tensor, np.linalg.inv(tensor), STEP_S)
        rotation, rate = rot.exp(step.turn[0]) @ rot.exp(rate * STEP_S) @ rotation, rate + step.rate[0]
    return rotation, rate


def tumble(bench: Turntable, rng: np.random.Generator, scans: int, blind_s: float) -> dict[str, Any]:
    """Return the figures of one tumble.

    Args:
        bench: the turntable.
        rng: draws attitude and rate.
        scans: number of scans before the dark.
        blind_s: length of the dark [s].
    """
    truth = random_rotations(1, rng)[0]
    axis = rng.standard_normal(3)
    rate = np.radians(rng.uniform(SLOWEST_DEG_S, FASTEST_DEG_S)) * axis / np.linalg.norm(axis)
    found = acquire(bench.scan(truth), bench.shape)
    known, position, lost = Tumble(found.rotation, found.covariance[:3, :3], UNKNOWN_RATE_RAD_S), found.position, 0
    for _ in range(scans):
        truth, rate = moved(truth, rate, PERIOD_S)
        known.predict(PERIOD_S)
        fit = track(bench.scan(truth), bench.shape, known.rotation, position)
        if fit.tracked:
            known.update(fit.rotation, fit.covariance[:3, :3])
            position = fit.position
        lost += not fit.tracked
    inertia, true = known.inertia(), 3 * np.sort(MOMENTS) / MOMENTS.sum()
    steady = rot.exp(known.angular_rate * blind_s) @ known.rotation
    exact = moved(known.rotation, known.angular_rate, blind_s)[0]
    truth, rate = moved(truth, rate, blind_s)
    known.predict(blind_s)
    off = rot.log(truth @ known.rotation.T)
    size = float(np.linalg.norm(off))
    squared = float(off @ np.linalg.solve(known.covariance[:3, :3], off))
    fit = track(bench.scan(truth), bench.shape, known.rotation, position)
    return {
        "error_deg": np.degrees(size),
        "sigma_deg": np.degrees(known.sigma_rad),
        "sigmas": float(np.sqrt(squared)),
        "constant_rates_deg": float(error_deg(truth, steady)),
        "true_inertia_deg": float(error_deg(truth, exact)),
        "reacquired": fit.tracked,
        "after_deg": float(error_deg(truth, fit.rotation)),
        "scans_not_tracked": lost,
        "moments": inertia.moments.tolist(),
        "moments_off_sigmas": ((inertia.moments - true) / (inertia.sigma * true)).tolist(),
        "moments_sigma": inertia.sigma.tolist(),
        "observed": inertia.observed,
    }


def main() -> None:
    """Run, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tumbles", type=int, default=10)
    parser.add_argument("--scans", type=int, default=120)
    parser.add_argument("--blind", type=float, default=10.0, help="s")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    bench, rng = Turntable(given.seed), np.random.default_rng(given.seed)
    rows = []
    for _ in range(given.tumbles):
        rows.append(r := tumble(bench, rng, given.scans, given.blind))
        if not given.json:
            print(
                f"{r['error_deg']:.2f} deg, sigma {r['sigma_deg']:.2f} deg, {r['sigmas']:.1f} sigmas; constant rates "
                f"{r['constant_rates_deg']:.1f}, true inertia {r['true_inertia_deg']:.2f} deg; reacquired "
                f"{r['reacquired']}, {r['after_deg']:.2f} deg; moments {np.round(r['moments'], 2)}, off "
                f"{np.round(r['moments_off_sigmas'], 1)} sigmas, {r['observed']} of 5 observed",
                flush=True,
            )
    total = {
        "error_mean_deg": float(np.mean([r["error_deg"] for r in rows])),
        "error_largest_deg": float(np.max([r["error_deg"] for r in rows])),
        "constant_rates_mean_deg": float(np.mean([r["constant_rates_deg"] for r in rows])),
        # Three degrees of freedom: 99.7 % are within 3.76 of these sigmas, as 3 is for one.
        "within_3_sigma": sum(r["sigmas"] < 3.76 for r in rows),
        "reacquired": sum(bool(r["reacquired"]) for r in rows),
        "tumbles": len(rows),
    }
    print(json.dumps({"tumbles": rows, "all": total} if given.json else total, indent=2))


if __name__ == "__main__":
    main()
