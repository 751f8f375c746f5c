"""Acquisition and tracking of real spacecraft shapes from any attitude, beside the truth. A table, or JSON.

    PYTHONPATH=. python benchmarks/lidar_shapes.py FOLDER [--shapes HST ...] [--attitudes 20] [--seed 0] [--json]

FOLDER holds the shapes as `NAME.obj`: NASA's of github.com/ericstoneking/42, Model/. Every shape is scanned at
attitudes drawn over SO(3), with the paper's LiDAR (16 lines over 30 degrees, 0.2 degrees along the line, 1 cm), from
5 m and from 10 m. A shape longer than 3.3 m is scanned from further away, 1.5 and 3 times its length: at 5 m it would
not fit into the LiDAR's field, or would surround it.

`right`: believed, and within 2 degrees and 5 % of the shape's length, or within 4 sigma of what is promised where that
is more. `wrong`: believed, and not right. `flagged`: not believed, by the verdict. Errors count modulo the shape's own
symmetry. After an acquisition that was right, the target turns by 2 degrees per scan for some scans, each tracked from
the last pose: how many of them were tracked, and how many of these are wrong.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lidar.acquisition import acquire
from estimators.lidar.shape import Shape
from estimators.lidar.symmetry import symmetry
from estimators.lidar.tracking import track
from swarm.studies.papers.lidar import SCANNER, Turntable
from swarm.studies.papers.lidar_acquisition import random_rotations
from swarm.world.surface import known_shape

SHAPES = ("HST", "Cubesat_6U", "SpaceShuttleOrbiter", "ARC_ChaserBody", "IonCruiser", "Telescope", "JustACube")
RANGES_M, LENGTHS = (5.0, 10.0), (1.5, 3.0)
RIGHT_DEG, RIGHT_LENGTH, SIGMAS = 2.0, 0.05, 4.0
STEP_DEG, FOLLOWED = 2.0, 5


def bench_of(path: Path, number: int, seed: int) -> tuple[Turntable, float]:
    """Return the turntable with a shape at its range `number`, and that range [m]."""
    length_m = known_shape(path).diameter_m
    range_m = max(RANGES_M[number], LENGTHS[number] * length_m)
    settings = SCANNER.model_copy(update={"range_max_m": max(SCANNER.range_max_m, 3 * range_m)})
    return Turntable(seed, path, settings, range_m), range_m


def errors(shape: Shape, true: Floats, place: Floats, rotation: Floats, position: Floats) -> tuple[float, float]:
    """Return the errors of attitude [deg] and position [mm], of the true pose's equivalents beside the nearest."""
    if not np.isfinite(rotation).all():
        return np.nan, np.nan
    same, there = symmetry(shape).nearest(true, place, rotation)
    return float(np.degrees(rot.angle_between(same, rotation))), 1e3 * float(np.linalg.norm(there - position))


def right(shape: Shape, off: tuple[float, float], covariance: Floats) -> bool:
    """Return whether errors (deg, mm) are what a right answer may have."""
    promised = SIGMAS * np.sqrt([np.trace(covariance[:3, :3]), np.trace(covariance[3:, 3:])])
    turned, moved = max(RIGHT_DEG, np.degrees(promised[0])), 1e3 * max(RIGHT_LENGTH * shape.diameter_m, promised[1])
    return bool(off[0] <= turned and off[1] <= moved)


def follow(
    bench: Turntable, truth: Floats, rotation: Floats, position: Floats, axis: Floats, told: bool
) -> list[tuple[Any, ...]]:
    """Return what tracking says of a few more scans: errors, and whether they are believed and right."""
    out = []
    for _ in range(FOLLOWED):
        truth = rot.exp(np.radians(STEP_DEG) * axis) @ truth
        fit = track(bench.scan(truth), bench.shape, rotation, position)
        off = errors(bench.shape, truth, bench.position, fit.rotation, fit.position)
        wrong = fit.tracked and not right(bench.shape, off, fit.covariance)
        out.append((*off, fit.tracked, wrong))
        if told and (wrong or not fit.tracked):
            print(f"  {fit.outcome.value}, {off[0]:.2f} deg, {off[1]:.0f} mm, overlap {fit.overlap:.3f}", flush=True)
        if fit.tracked:
            rotation, position = fit.rotation, fit.position
    return out


def row(bench: Turntable, truths: Floats, rng: np.random.Generator, told: bool) -> dict[str, Any]:
    """Return one shape at one range. told: name every attitude that is not right."""
    shape, good, verdicts, wrong, followed = bench.shape, [], [], 0, []
    for number, truth in enumerate(truths):
        found = acquire(bench.scan(truth), shape)
        axis = rng.standard_normal(3)
        off = errors(shape, truth, bench.position, found.rotation, found.position)
        if found.found and right(shape, off, found.covariance):
            good.append(off)
            followed += follow(bench, truth, found.rotation, found.position, axis / np.linalg.norm(axis), told)
        elif found.found:
            wrong += 1
        else:
            verdicts.append(found.verdict.value)
        if told and not (found.found and off[0] <= RIGHT_DEG):
            print(
                f"  {number}: {found.verdict.value}, {off[0]:.2f} deg, {off[1]:.0f} mm, overlap {found.overlap:.3f}, "
                f"margin {found.margin:.2f}, {found.points} points, residual {1e3 * found.residual_m:.1f} mm",
                flush=True,
            )
    turned, moved = np.array(good).reshape(-1, 2).T
    tracks = np.array(followed, dtype=np.float64).reshape(-1, 4)
    some, any_track = len(good) > 0, len(tracks) > 0
    return {
        "attitudes": len(truths),
        "right": len(good),
        "wrong": wrong,
        "flagged": {word: verdicts.count(word) for word in sorted(set(verdicts))},
        "mean_deg": float(turned.mean()) if some else None,
        "largest_deg": float(turned.max()) if some else None,
        "mean_mm": float(moved.mean()) if some else None,
        "scans_followed": len(tracks),
        "lost": int(np.count_nonzero(tracks[:, 2] == 0)),
        "followed_wrong": int(tracks[:, 3].sum()),
        "followed_mean_deg": float(tracks[:, 0].mean()) if any_track else None,
    }


def main() -> None:
    """Run, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shapes", nargs="+", default=list(SHAPES))
    parser.add_argument("--ranges", nargs="+", type=int, default=[0, 1], choices=[0, 1], help="0: near, 1: far")
    parser.add_argument("--attitudes", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--told", action="store_true", help="name every attitude that is not right")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    rows = []
    if not given.json:
        print("| shape | range | right | flagged | wrong | mean | largest | position | tracked, wrong | mean |")
        print("|---|---|---|---|---|---|---|---|---|---|", flush=True)
    for name in given.shapes:
        for number in given.ranges:
            bench, range_m = bench_of(given.folder / f"{name}.obj", number, given.seed)
            rng = np.random.default_rng([given.seed, number])
            found = row(bench, random_rotations(given.attitudes, rng), rng, given.told)
            rows.append({"shape": name, "range_m": range_m} | found)
            if not given.json:
                print(line(rows[-1]), flush=True)
    if given.json:
        print(json.dumps(rows, indent=2))


def line(r: dict[str, Any]) -> str:
    """Return a row of the table."""
    flagged = ", ".join(f"{count} {word}" for word, count in r["flagged"].items()) or "0"

    def number(value: float | None, unit: str, digits: int) -> str:
        return "" if value is None else f"{value:.{digits}f}{unit}"

    return (
        f"| {r['shape']} | {r['range_m']:.3g} m | {r['right']} of {r['attitudes']} | {flagged} | {r['wrong']} | "
        f"{number(r['mean_deg'], '°', 2)} | {number(r['largest_deg'], '°', 2)} | {number(r['mean_mm'], ' mm', 1)} | "
        f"{r['scans_followed'] - r['lost']} of {r['scans_followed']}, {r['followed_wrong']} | "
        f"{number(r['followed_mean_deg'], '°', 2)} |"
    )


if __name__ == "__main__":
    main()
