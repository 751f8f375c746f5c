"""The paper's tracking, each scan against the last: where its accumulated error stays below 2 degrees. As a table.

    PYTHONPATH=. python benchmarks/lidar_scan_to_scan.py [--tracks 2] [--scans 25] [--seed 0] [--json]

The satellite on the turntable (`swarm.studies.papers.lidar`), a LiDAR of so many lines over 30 degrees, so far away,
and attitudes that walk: every scan turns by the step about an axis that is drawn anew, and never leaves the paper's 10
degrees about each axis. `chain` of `estimators.lidar.tracking`, from the true first pose: mean and largest error over
all scans, and the mean of the last scans. A setting holds where the largest stays below 2 degrees.
"""

import argparse
import json
from itertools import product
from typing import Any

import numpy as np

from estimators.arrays import Floats
from estimators.lidar.tracking import chain
from swarm.studies.papers.lidar import SCANNER, Turntable, error_deg, turned

RANGES_M, LINES, STEPS_DEG = (3.0, 5.0), (16, 64), (1.0, 3.0, 10.0)
LIMIT_DEG, HELD_DEG = 10.0, 2.0


def walk(scans: int, step_deg: float, rng: np.random.Generator) -> Floats:
    """Return the attitudes (scans, 3, 3) of one track."""
    angles = [np.zeros(3)]
    while len(angles) < scans:
        way = rng.standard_normal(3)
        there = angles[-1] + step_deg * way / np.linalg.norm(way)
        if np.abs(there).max() <= LIMIT_DEG:
            angles.append(there)
    return turned(np.array(angles))


def track(bench: Turntable, truths: Floats) -> Floats:
    """Return the errors [deg] of all scans but the first."""
    rotation, position, errors = truths[0], bench.position, []
    scans = [bench.scan(truth).around(bench.position, 1.2 * bench.shape.radius_m) for truth in truths]
    for before, scan, truth in zip(scans, scans[1:], truths[1:], strict=False):
        rotation, position = chain(scan, before, rotation, position)
        errors.append(float(error_deg(truth, rotation)))
    return np.array(errors)


def main() -> None:
    """Run, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tracks", type=int, default=2)
    parser.add_argument("--scans", type=int, default=25)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    rows: list[dict[str, Any]] = []
    if not given.json:
        print(
            "| range | lines | step | mean | largest | last scans | below 2° |\n|---|---|---|---|---|---|---|",
            flush=True,
        )
    for range_m, lines in product(RANGES_M, LINES):
        bench = Turntable(given.seed, scanner=SCANNER.model_copy(update={"lines": lines}), distance_m=range_m)
        for step_deg in STEPS_DEG:
            rng = np.random.default_rng(given.seed)
            errors = np.array([track(bench, walk(given.scans, step_deg, rng)) for _ in range(given.tracks)])
            row = {"range_m": range_m, "lines": lines, "step_deg": step_deg, "mean_deg": float(errors.mean())}
            row |= {"largest_deg": float(errors.max()), "last_deg": float(errors[:, -5:].mean())}
            rows.append(row | {"held": bool(errors.max() < HELD_DEG)})
            if not given.json:
                print(
                    f"| {range_m:g} m | {lines} | {step_deg:g}° | {row['mean_deg']:.2f}° | {row['largest_deg']:.2f}° | "
                    f"{row['last_deg']:.2f}° | {'yes' if rows[-1]['held'] else 'no'} |",
                    flush=True,
                )
    if given.json:
        print(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
