"""Cold starts from random poses beside OpenCV's SQPNP: found the truth, flagged, silently wrong, and time. Prints JSON.

    PYTHONPATH=. python benchmarks/cold_start.py [--poses 10000] [--seed 0] [--target dome | cloud | plane]

Poses: 1 m to 5 m, anywhere in the 120 x 120 degree field, any attitude, 8.8 arcsec of angle noise with rho = 0.8717.
`dome`: the 12.5 cm target, 5 or more of its 12 photodiodes lit and not in one plane. `cloud`: 5 random photodiodes in
a 12.5 cm cube. `plane`: 4 in a 12.5 cm square, where two poses often fit equally well.

A solve is *right* if its best candidate is the minimum next to the truth, *ambiguous* if the costs of the first two
differ by less than 25 independent variances (then `flagged_without_truth` counts those that lost the truth), *wrong*
otherwise. SQPNP returns a pose without a flag; it is right if refinement leads from it to the truth's minimum. The NEES
(6 degrees of freedom, against the truth itself) shows that the truth's minimum is near the truth.
"""

import argparse
import importlib
import json
import os
import platform
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from estimators.arrays import Floats
from estimators.lighthouse.dop import dilution
from estimators.lighthouse.pnp import PoseSolution, refine_projections
from estimators.lighthouse.pnp_start import cold_start
from estimators.lighthouse.projection import angle_weights, projections
from estimators.rotation import angle_between, log

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from convex_target import ANGLE_NOISE, RHO, Draw, angle_errors, angles, draw, random_position, random_rotation

SURE = 25 * (1 - RHO) * ANGLE_NOISE**2
SAME_RAD = 1e-5


def drawn(target: str, rng: np.random.Generator, count: int) -> Draw:
    """Random poses of the target that the lighthouse sees."""
    if target == "dome":
        return draw(rng, count, 1.0, 5.0)
    photodiodes, depth = (5, 1.0) if target == "cloud" else (4, 0.0)
    point = 0.0625 * rng.uniform(-1, 1, (count, photodiodes, 3)) * [1, 1, depth]
    lit = np.ones((count, photodiodes), dtype=np.bool_)
    return Draw(random_rotation(rng, count), random_position(rng, count, 1.0, 5.0), lit, point)


def finished(d: Draw, theta: Floats, rotation: Floats, position: Floats) -> PoseSolution:
    """The minima next to the given poses, however many iterations they take."""
    uv, count = projections(theta), len(theta)
    still = np.zeros_like(theta), np.zeros((count, 3)), np.zeros((count, 3))
    return refine_projections(uv, angle_weights(uv), d.lit, d.point, rotation, position, *still, iterations_max=300)


def solve_ours(d: Draw, theta: Floats, truth: PoseSolution, nees: Floats) -> dict[str, Any]:
    """Counts and time of `cold_start`, one craft at a time as on board."""
    still = np.zeros((theta.shape[1], 2)), np.zeros(3), np.zeros(3)
    count = {"right": 0, "ambiguous": 0, "flagged_without_truth": 0, "wrong": 0, "no_answer": 0}
    seconds, trusted = [], 0.0
    cold_start(theta[0], d.lit[0], d.point[0], *still)
    for c in range(len(theta)):
        began = time.perf_counter()
        found = cold_start(theta[c], d.lit[c], d.point[c], *still)
        seconds.append(time.perf_counter() - began)
        same = angle_between(found.rotation, truth.rotation[c]) < SAME_RAD
        if len(same) == 0:
            count["no_answer"] += 1
        elif len(same) > 1 and found.cost[1] - found.cost[0] < SURE:
            count["ambiguous"] += 1
            count["flagged_without_truth"] += int(not same.any())
        else:
            count["right" if same[0] else "wrong"] += 1
            trusted = max(trusted, float(nees[c]) if same[0] else 0.0)
    return {
        **count,
        "nees_max_of_right": trusted,
        "ms_mean": 1e3 * np.mean(seconds),
        "ms_99_percent": 1e3 * np.quantile(seconds, 0.99),
    }


def solve_sqpnp(d: Draw, theta: Floats, truth: PoseSolution) -> dict[str, Any] | None:
    """The same with OpenCV's SQPNP (Terzakis and Lourakis 2020) on (u, v); None without OpenCV."""
    try:
        cv2 = importlib.import_module("cv2")
    except ImportError:
        return None
    cv2.setNumThreads(1)
    uv, seconds = projections(theta), 0.0
    rotation, position = np.full((len(theta), 3, 3), np.nan), np.full((len(theta), 3), np.nan)
    for c in range(len(theta)):
        point, image = d.point[c, d.lit[c]].copy(), uv[c, d.lit[c]].copy()
        began = time.perf_counter()
        try:
            ok, turned, moved = cv2.solvePnP(point, image, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
        except cv2.error:
            ok = False
        seconds += time.perf_counter() - began
        if ok:
            rotation[c], position[c] = cv2.Rodrigues(turned)[0], moved[:, 0]
    answered = np.isfinite(position).all(axis=1)
    end = finished(d, theta, rotation, position)
    right = end.solved & (angle_between(np.nan_to_num(end.rotation), truth.rotation) < SAME_RAD)
    return {
        "version": version_of("opencv-python-headless", "opencv-python", "opencv-contrib-python"),
        "right": int(right.sum()),
        "wrong": int((answered & ~right).sum()),
        "no_answer": int((~answered).sum()),
        "ms_mean": 1e3 * seconds / len(theta),
    }


def version_of(*names: str) -> str | None:
    """The version of the first of these distributions that is installed."""
    for name in names:
        try:
            return version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return None


def nees_of_truth(d: Draw, truth: PoseSolution) -> Floats:
    """Normalised squared errors (C,) of the minima next to the truth, with the covariance (18)."""
    count, photodiodes = d.lit.shape
    still = np.zeros((count, photodiodes, 2)), np.zeros((count, 3)), np.zeros((count, 3))
    h = dilution(truth.rotation, truth.position, d.lit, d.point, *still, RHO, truth.solved).covariance
    attitude = log(d.rotation @ np.swapaxes(truth.rotation, -1, -2))
    error, out = np.hstack([attitude, d.position - truth.position]), np.full(count, np.nan)
    good = truth.solved
    out[good] = np.sum(error[good] * np.linalg.solve(h[good], error[good, :, None])[..., 0], axis=-1)
    return out / ANGLE_NOISE**2


def main() -> None:
    """Draw, solve, count, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--target", choices=["dome", "cloud", "plane"], default="dome")
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    d = drawn(options.target, rng, options.poses)
    still = np.zeros((*d.lit.shape, 2)), np.zeros((options.poses, 3)), np.zeros((options.poses, 3))
    theta = angles(d.rotation, d.position, d.point, *still) + angle_errors(rng, *d.lit.shape)
    truth = finished(d, theta, d.rotation, d.position)
    nees = nees_of_truth(d, truth)
    result = {
        "benchmark": "cold_start",
        "target": options.target,
        "poses": options.poses,
        "seed": options.seed,
        "machine": {"platform": platform.platform(), "processor": platform.machine(), "cpus": os.cpu_count()},
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("numpy", "numba", "scipy")},
        },
        "minimum_next_to_truth": {
            "solved": int(truth.solved.sum()),
            "nees_mean": float(np.nanmean(nees)),
            "nees_max": float(np.nanmax(nees)),
        },
        "cold_start": solve_ours(d, theta, truth, nees),
        "opencv_sqpnp": solve_sqpnp(d, theta, truth),
    }
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
