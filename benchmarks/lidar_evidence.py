"""Acquisition by several scans of shapes that one scan leaves ambiguous, beside the truth. A table.

    PYTHONPATH=. python benchmarks/lidar_evidence.py FOLDER [--shapes ARC_ChaserBody IonCruiser] [--attitudes 10]
                                                            [--scans 20] [--step 0.5] [--seed 0] [--near | --range M]

Every target is drawn over SO(3), as in `benchmarks/lidar_shapes.py`, from its further range (`--near`: the nearer), and
turns by `--step` degrees from scan to scan about an axis of its own. `estimators.lidar.evidence` gets one scan after
the other until it believes a pose. Right and wrong are those of `swarm.studies.papers.lidar_shapes`.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from estimators import rotation as rot
from estimators.lidar.evidence import Evidence
from swarm.studies.papers.lidar_acquisition import random_rotations
from swarm.studies.papers.lidar_shapes import bench_of, errors, is_right


def main() -> None:
    """Run, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shapes", nargs="+", default=["ARC_ChaserBody", "IonCruiser"])
    parser.add_argument("--attitudes", type=int, default=10)
    parser.add_argument("--scans", type=int, default=20)
    parser.add_argument("--step", type=float, default=0.5, help="degrees from scan to scan")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--near", action="store_true")
    parser.add_argument("--range", type=float, help="m")
    given = parser.parse_args()
    print(
        "| shape | range | returns | right by one scan | in the end | by scan | wrong | mean | scan after the first |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name in given.shapes:
        number = 0 if given.near or given.range else 1
        bench = bench_of(given.folder / f"{name}.obj", number, given.seed, given.range)
        rng = np.random.default_rng([given.seed, number])
        after, wrong, off, points, seconds = [], 0, [], [], []
        for truth in random_rotations(given.attitudes, rng):
            axis = rng.standard_normal(3)
            turn = rot.exp(np.radians(given.step) * axis / np.linalg.norm(axis))
            evidence = Evidence(bench.shape)
            for k in range(given.scans):
                scan = bench.scan(truth)
                before = time.process_time()
                found = evidence.take(scan)
                if k:
                    seconds.append(time.process_time() - before)
                points.append(found.points)
                if found.found:
                    one = errors(bench.shape, truth, bench.position, found.rotation, found.position)
                    good = is_right(bench.shape, one, found.covariance)
                    wrong += not good
                    after += [k + 1] * good
                    off += [one[0]] * good
                    break
                truth = turn @ truth
        ranked = ", ".join(str(k) for k in sorted(after))
        mean = f"{np.mean(off):.2f}°" if off else ""
        ms = f"{1e3 * np.median(seconds):.0f} ms" if seconds else ""
        print(
            f"| {name} | {bench.position[0]:.3g} m | {np.median(points):.0f} | {after.count(1)} of {given.attitudes} | "
            f"{len(after)} | {ranked} | {wrong} | {mean} | {ms} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
