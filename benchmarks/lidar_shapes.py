"""Acquisition and tracking of real spacecraft shapes from any attitude, beside the truth. A table, or JSON.

    PYTHONPATH=. python benchmarks/lidar_shapes.py [FOLDER] [--shapes HST ...] [--attitudes 20] [--seed 0] [--json]
                                                   [--range METRES] [--told] [--followed 20]
                                                   [--answers FILE.jsonl] [--bound]
    PYTHONPATH=. python benchmarks/lidar_shapes.py --table FILE.jsonl

What is measured is that of `swarm reproduce lidar-shapes` (`swarm.studies.papers.lidar_shapes`): FOLDER holds the
shapes, NASA's of github.com/ericstoneking/42, Model/, for instance; without it they are this package's. Here single
shapes, ranges and attitudes can be chosen, and `--told` names every answer that is not right. The first
attitudes only, `--followed`, are followed by tracking. `--answers` adds every answer to a file as it comes, and
`--table` prints the table of such a file, to which several runs with different seeds may have added.
`--bound` registers every scan from the truth instead, and prints how far off it is beside the least that its ranges
allow: noise, and the jitter of a ray's direction, which far away and at a slant makes most of a range's error.
Where none of n is wrong, the share of wrong ones is below 3/n with a confidence of 95 %.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from estimators.arrays import Floats
from estimators.lidar.ray_cast import cast
from estimators.lidar.registration import JUMP, register
from estimators.lidar.scan import Scan
from estimators.lidar.shape import Shape
from swarm.studies.papers.lidar_acquisition import random_rotations
from swarm.studies.papers.lidar_shapes import (
    FOLLOWED,
    RANGES_M,
    RIGHT_LENGTH,
    Answer,
    bench_of,
    by_setting,
    flagged,
    measured,
    shapes,
)

COLUMNS = (
    *("shape", "range", "returns", "right", "flagged", "wrong", "mean", "largest", "position"),
    *("followed: tracked, wrong", "mean"),
)


def row(answers: list[Answer]) -> dict[str, Any]:
    """Return the figures of one shape at one range."""
    first, later = [a for a in answers if a.scan == 0], [a for a in answers if a.scan > 0]
    off = np.array([(a.error_deg, a.error_mm) for a in first if a.right]).reshape(-1, 2)
    tracked = [a for a in later if a.believed]
    return {
        "shape": answers[0].shape,
        "range_m": answers[0].range_m,
        "points": float(np.median([a.points for a in first])),
        "attitudes": len(first),
        "right": len(off),
        "wrong": sum(a.wrong for a in first),
        "flagged": flagged(answers),
        "mean_deg": float(off[:, 0].mean()) if len(off) else None,
        "largest_deg": float(off[:, 0].max()) if len(off) else None,
        "mean_mm": float(off[:, 1].mean()) if len(off) else None,
        "scans_followed": len(later),
        "lost": len(later) - len(tracked),
        "followed_wrong": sum(a.wrong for a in later),
        "followed_mean_deg": float(np.mean([a.error_deg for a in tracked])) if tracked else None,
    }


def line(r: dict[str, Any]) -> str:
    """Return a row of the table."""
    words = ", ".join(f"{count} {word}" for word, count in r["flagged"].items()) or "0"

    def number(value: float | None, unit: str, digits: int) -> str:
        return "" if value is None else f"{value:.{digits}f}{unit}"

    return (
        f"| {r['shape']} | {r['range_m']:.3g} m | {r['points']:.0f} | {r['right']} of {r['attitudes']} | {words} | "
        f"{r['wrong']} | {number(r['mean_deg'], '°', 2)} | {number(r['largest_deg'], '°', 2)} | "
        f"{number(r['mean_mm'], ' mm', 1)} | {r['scans_followed'] - r['lost']} of {r['scans_followed']}, "
        f"{r['followed_wrong']} | {number(r['followed_mean_deg'], '°', 2)} |"
    )


def told(a: Answer) -> str:
    """Return an answer in words."""
    return (
        f"  {a.attitude}.{a.scan}: {'WRONG, ' if a.wrong else ''}{a.answer}, {a.error_deg:.2f} deg, "
        f"{a.error_mm:.0f} mm, overlap {a.overlap:.3f}, margin {a.margin:.2f}, {a.points} points"
    )


def answered(path: Path, number: int, given: argparse.Namespace) -> Iterator[Answer]:
    """Yield the answers of one shape at one of its ranges."""
    bench, rng = bench_of(path, number, given.seed, given.range), np.random.default_rng([given.seed, number])
    followed = given.attitudes if given.followed is None else given.followed
    for i, truth in enumerate(random_rotations(given.attitudes, rng)):
        yield from measured(bench, path.stem, i, truth, rng, FOLLOWED if i < followed else 0)


def bound(scan: Scan, shape: Shape, truth: Floats, place: Floats) -> Floats:
    """Return the least covariance (6, 6), ordered (attitude, position), that a scan's ranges allow at the truth.

    Infinite where they leave a direction free.
    """
    direction = scan.direction[scan.returned]
    hits = cast(shape.mesh, -truth.T @ place, direction @ truth)
    met = np.isfinite(hits.distance)
    along, depth, normal = direction[met], hits.distance[met], shape.mesh.normal[hits.triangle[met]] @ truth.T
    cosine = np.abs(np.sum(normal * along, axis=1))
    sideways = scan.jitter_rad * depth * np.sqrt(1 - np.minimum(cosine, 1.0) ** 2)
    jacobian = np.concatenate([np.cross(along * depth[:, None] - place, normal), normal], axis=1)
    variance = (scan.noise_m * cosine) ** 2 + sideways**2
    known = jacobian.T @ (jacobian / variance[:, None])
    if np.linalg.matrix_rank(known, hermitian=True) < 6:
        return np.full((6, 6), np.inf)
    out: Floats = np.linalg.inv(known)
    return out


def print_bounds(path: Path, number: int, given: argparse.Namespace) -> None:
    """Print errors of position, RMS, beside their bound and what is promised, of one shape at one of its ranges."""
    bench, rng = bench_of(path, number, given.seed, given.range), np.random.default_rng([given.seed, number])
    rows = []
    for truth in random_rotations(given.attitudes, rng):
        scan = bench.scan(truth)
        around = scan.around(bench.position, bench.shape.radius_m)
        edges = around.edges(JUMP * bench.shape.radius_m)
        reach_m = RIGHT_LENGTH * bench.shape.radius_m
        noise = scan.noise_m, scan.jitter_rad
        fit = register(around.point, bench.shape, truth, bench.position, *noise, edges=edges, reach_m=reach_m)
        least = np.trace(bound(around, bench.shape, truth, bench.position)[3:, 3:])
        if not fit.degenerate and np.isfinite(least):
            off = float(np.sum((fit.position - bench.position) ** 2))
            rows.append((off, least, np.trace(fit.covariance[3:, 3:]), len(around.point)))
    if rows:
        off_mm, least_mm, promised_mm = 1e3 * np.sqrt(np.mean(np.array(rows)[:, :3], axis=0))
        rays = float(np.median([r[3] for r in rows]))
        jitter_mm = 1e3 * scan.jitter_rad * bench.position[0]
        print(
            f"{path.stem} at {bench.position[0]:.3g} m, {len(rows)} scans of {rays:.0f} returns, jitter {jitter_mm:.0f}"
            f" mm: position {off_mm:.1f} mm RMS, bound of the ranges {least_mm:.1f} mm, ratio {off_mm / least_mm:.2f}; "
            f"promised {promised_mm:.1f} mm",
            flush=True,
        )


def main() -> None:
    """Run, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--shapes", nargs="+")
    parser.add_argument("--near-only", action="store_true")
    parser.add_argument("--far-only", action="store_true")
    parser.add_argument("--range", type=float, help="m, instead of the two")
    parser.add_argument("--attitudes", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--told", action="store_true", help="name every answer that is not right")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--followed", type=int, help="attitudes that are followed by tracking; default: all")
    parser.add_argument("--answers", type=Path, help="a file that gets all answers, a line each")
    parser.add_argument("--table", type=Path, help="print the table of such a file, and do nothing else")
    parser.add_argument("--bound", action="store_true", help="errors from the truth, beside the least possible")
    given = parser.parse_args()
    numbers = [0] if given.near_only or given.range else [1] if given.far_only else range(len(RANGES_M))
    answers: list[Answer] = []
    for path in [] if given.table else shapes(given.folder):
        if given.shapes and path.stem not in given.shapes:
            continue
        for number in numbers:
            if given.bound:
                print_bounds(path, number, given)
                continue
            for answer in answered(path, number, given):
                answers.append(answer)
                if given.answers:
                    with given.answers.open("a") as out:
                        out.write(json.dumps(answer._asdict()) + "\n")
                if given.told and not answer.right:
                    print(told(answer), flush=True)
    if given.table:
        answers = [Answer(**json.loads(text)) for text in given.table.read_text().splitlines()]
    if given.bound:
        return
    rows = [row(part) for _, _, part in by_setting(answers)]
    if not given.json:
        print(f"| {' | '.join(COLUMNS)} |\n{len(COLUMNS) * '|---'}|")
        for r in rows:
            print(line(r))
        tried, wrong = (sum(r[name] for r in rows) for name in ("attitudes", "wrong"))
        print(f"{wrong} of {tried} acquisitions silently wrong" + ("" if wrong else f": below {100 * 3 / tried:.2f} %"))
    if given.json:
        print(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
