"""Tracking without a model, scan against scan: where its accumulated error stays below 2 degrees. As a table.

    PYTHONPATH=. python benchmarks/lidar_scan_to_scan.py [--map] [--ranges 3 5] [--lines 16 64] [--steps 1 3 10]
                                                         [--tracks 2] [--scans 25] [--turn] [--seed 0] [--json]
                                                         [--rows FILE.json ...] [--figure FILE.png]

The satellite on the turntable (`swarm.studies.papers.lidar`), a LiDAR of so many lines over 30 degrees, so far away,
and attitudes that walk: every scan turns by the step about an axis that is drawn anew, and never leaves the paper's 10
degrees about each axis. From the true first pose: mean and largest error over all scans, and the mean of the last
scans. A setting holds where the largest stays below 2 degrees. The paper's own way is `chain` of
`estimators.lidar.tracking`, each scan against the last; `--map` joins the scans to a map of the target
(`estimators.lidar.local_map`), and tries turns about the last pose where the step is more than 5 degrees. `--turn`: one
whole turn about Z instead, in steps of the size given, and on until the first sides are seen again for five scans: the
error before the first side comes back, and after it. `--figure` draws mean and largest error against the range, a
curve for each number of lines, with the 2 degrees that are to be held; `--rows` takes in what earlier runs
have printed with `--json`, and runs nothing.
"""

import argparse
import json
from itertools import cycle, product
from pathlib import Path
from typing import Any

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lidar.local_map import LocalMap, surface
from estimators.lidar.tracking import chain
from swarm import figures
from swarm.studies.papers.lidar import SCANNER, Turntable, error_deg, turned

RANGES_M, LINES, STEPS_DEG = (3.0, 5.0), (16, 64), (1.0, 3.0, 10.0)
LIMIT_DEG, HELD_DEG = 10.0, 2.0
NEAR_DEG, TURNS = 5.0, 40


def walk(scans: int, step_deg: float, rng: np.random.Generator) -> Floats:
    """Return the attitudes (scans, 3, 3) of one track."""
    angles = [np.zeros(3)]
    while len(angles) < scans:
        way = rng.standard_normal(3)
        there = angles[-1] + step_deg * way / np.linalg.norm(way)
        if np.abs(there).max() <= LIMIT_DEG:
            angles.append(there)
    return turned(np.array(angles))


def whole_turn(step_deg: float) -> Floats:
    """Return the attitudes (n, 3, 3) of a whole turn about Z, and of five steps more."""
    yaw = step_deg * np.arange(round(360 / step_deg) + 6)
    return turned(np.stack([np.zeros_like(yaw), np.zeros_like(yaw), yaw], axis=1))


def track(bench: Turntable, truths: Floats) -> Floats:
    """Return the errors [deg] of all scans but the first."""
    rotation, position, errors = truths[0], bench.position, []
    scans = [bench.scan(truth).around(bench.position, 1.2 * bench.shape.radius_m) for truth in truths]
    for before, scan, truth in zip(scans, scans[1:], truths[1:], strict=False):
        rotation, position = chain(scan, before, rotation, position)
        errors.append(float(error_deg(truth, rotation)))
    return np.array(errors)


def track_by_map(bench: Turntable, truths: Floats, step_deg: float) -> Floats:
    """Return the errors [deg] of all scans but the first, each against the map of all before."""
    turns = None
    if step_deg > NEAR_DEG:
        way = np.random.default_rng(0).uniform(-1, 1, (4 * TURNS, 3))
        turns = rot.exp(np.radians(1.2 * step_deg) * way[np.linalg.norm(way, axis=1) <= 1][:TURNS])
        turns = np.concatenate([np.eye(3)[None], turns])
    rotation, position, errors = truths[0], bench.position, []
    known: LocalMap | None = None
    for truth in truths:
        scan = bench.scan(truth).around(bench.position, 1.2 * bench.shape.radius_m)
        own = surface(scan)
        if known is None:
            known = LocalMap(scan.noise_m)
        else:
            rotation, position = known.track(own, rotation, position, turns)[:2]
            errors.append(float(error_deg(truth, rotation)))
        known.join(own, rotation, position)
    return np.array(errors)


def drawn(rows: list[dict[str, Any]], file: Path) -> None:
    """Draw mean and largest error of every way, number of lines and step against the range."""
    page, axes = figures.page(1, 1, 3.4)
    (ax,) = axes[0]
    curves = dict.fromkeys((r["way"], r["lines"], r["step_deg"]) for r in rows)
    colours = (figures.BLUE, figures.VERMILLION, figures.GREEN, figures.ORANGE, figures.GREY)
    for (way, lines, step_deg), colour in zip(curves, cycle(colours), strict=False):
        own = [r for r in rows if (r["way"], r["lines"], r["step_deg"]) == (way, lines, step_deg)]
        own.sort(key=lambda r: float(r["range_m"]))
        ranges = [r["range_m"] for r in own]
        label, style = f"{way}, {lines} lines, {step_deg:g}°", "-o" if way == "map" else "--s"
        ax.plot(ranges, [r["mean_deg"] for r in own], style, color=colour, label=label, ms=4)
        ax.plot(ranges, [r["largest_deg"] for r in own], "v", color=colour, ms=4)
    ax.axhline(HELD_DEG, color=figures.GREY, lw=1, ls=":")
    ax.set_yscale("log")
    ax.set(xlabel="range, m", ylabel="attitude error, deg; triangles: largest")
    ax.legend(fontsize="x-small", ncols=2, frameon=False)
    figures.save(page, file)


def main() -> None:
    """Run, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tracks", type=int, default=2)
    parser.add_argument("--scans", type=int, default=25)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--map", action="store_true", help="each scan against the map of all before it")
    parser.add_argument("--turn", action="store_true", help="a whole turn about Z")
    parser.add_argument("--ranges", nargs="+", type=float, default=list(RANGES_M), help="m")
    parser.add_argument("--lines", nargs="+", type=int, default=list(LINES))
    parser.add_argument("--steps", nargs="+", type=float, default=list(STEPS_DEG), help="deg")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--rows", nargs="+", type=Path, help="rows of earlier runs; nothing is run")
    parser.add_argument("--figure", type=Path, help="a picture of the rows")
    given = parser.parse_args()
    rows: list[dict[str, Any]] = [row for file in given.rows or [] for row in json.loads(file.read_text())]
    if not given.json:
        print(
            "| range | lines | step | mean | largest | last scans | below 2° |\n|---|---|---|---|---|---|---|",
            flush=True,
        )
    for range_m, lines in product(given.ranges, given.lines) if not given.rows else ():
        bench = Turntable(given.seed, scanner=SCANNER.model_copy(update={"lines": lines}), distance_m=range_m)
        for step_deg in given.steps:
            rng = np.random.default_rng(given.seed)
            walks = [walk(given.scans, step_deg, rng) for _ in range(given.tracks)]
            if given.turn:
                walks = [whole_turn(step_deg)]
            errors = np.array([track_by_map(bench, w, step_deg) if given.map else track(bench, w) for w in walks])
            row = {"range_m": range_m, "lines": lines, "step_deg": step_deg, "mean_deg": float(errors.mean())}
            row["way"] = "map" if given.map else "last scan"
            row |= {"halfway_deg": float(errors[:, errors.shape[1] // 2].mean())}
            row |= {"largest_deg": float(errors.max()), "last_deg": float(errors[:, -5:].mean())}
            rows.append(row | {"held": bool(errors.max() < HELD_DEG)})
            if not given.json:
                print(
                    f"| {range_m:g} m | {lines} | {step_deg:g}° | {row['mean_deg']:.2f}° | {row['largest_deg']:.2f}° | "
                    f"{row['last_deg']:.2f}° | {'yes' if rows[-1]['held'] else 'no'} |",
                    flush=True,
                )
    if given.figure:
        drawn(rows, given.figure)
    if given.json:
        print(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
