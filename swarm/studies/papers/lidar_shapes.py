"""Real shapes by LiDAR: spacecraft from any attitude, near and far, acquired and then followed.

Every shape is scanned at attitudes drawn over SO(3), with the paper's LiDAR (16 lines over 30 degrees, 0.2 degrees
along the line, 1 cm), from 5 m and from 10 m. A shape longer than 3.3 m is scanned from further away, 1.5 and 3 times
its length: at 5 m it would not fit into the LiDAR's field, or would surround it. Shapes are models of this package, or
files of a folder, such as NASA's of github.com/ericstoneking/42, Model/.

Right is an answer that is believed, and within 2 degrees and 5 % of the shape's length, or within 4 sigma of what is
promised where that is more; wrong, one that is believed and not right; flagged, one that is not believed. Errors count
modulo the shape's own symmetry. After an acquisition that was right, the target turns by 2 degrees per scan for some
scans, each tracked from the last pose.

The figures beside ours are those of Aerospace 12(4), 314 (2025), on models like NASA's: 0.84 deg and 22 mm with a
sensor that is denser.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lidar.acquisition import acquire
from estimators.lidar.shape import Shape
from estimators.lidar.symmetry import symmetry
from estimators.lidar.tracking import track
from swarm import figures
from swarm.assets import find_model
from swarm.errors import SwarmError
from swarm.studies.papers.experiment import Line, Outcome, Request, data, under
from swarm.studies.papers.lidar import SCANNER, Turntable
from swarm.studies.papers.lidar_acquisition import random_rotations
from swarm.world.surface import known_shape

OWN = ("satellite", "shuttle", "chaser", "servicer", "inspector", "cubesat12u")
"""The shapes without a folder."""
SUFFIXES = (".obj", ".stl", ".xml")
RANGES_M, LENGTHS = (5.0, 10.0), (1.5, 3.0)
RIGHT_DEG, RIGHT_LENGTH, SIGMAS = 2.0, 0.05, 4.0
STEP_DEG, FOLLOWED = 2.0, 5
PAPER_DEG, PAPER_MM = 0.84, 22.0
MEANINGS = {
    "shape": "name of the shape",
    "range_m": "of the target's centre",
    "attitude": "number of the attitude drawn",
    "scan": "0: acquired; from 1: tracked from the scan before",
    "answer": "what acquisition or tracking says of itself",
    "believed": "whether it says that it can be believed",
    "right": "believed, and right",
    "error_deg": "angle from the truth, modulo symmetry",
    "error_mm": "distance from the truth, modulo symmetry",
    "overlap": "share of the rays that agree",
    "margin": "of the runner-up; of acquisitions",
    "points": "returns of the target",
}


class Answer(NamedTuple):
    """One answer beside the truth; its fields are the columns of the data, see MEANINGS."""

    shape: str
    range_m: float
    attitude: int
    scan: int
    answer: str
    believed: bool
    right: bool
    error_deg: float
    error_mm: float
    overlap: float
    margin: float
    points: int

    @property
    def wrong(self) -> bool:
        """True where it is silently wrong."""
        return self.believed and not self.right


def run(request: Request) -> Outcome:
    """Scan every shape at every attitude, near and far, and compare."""
    paths = shapes(request.folder)
    runs = [(path, number) for path in paths for number in range(len(RANGES_M))]
    answers: list[Answer] = []
    for k, (path, number) in enumerate(runs):
        bench = bench_of(path, number, request.seed)
        rng = np.random.default_rng([request.seed, number])
        truths = random_rotations(request.sizes["draws"], rng)
        name = f"{path.stem} at {bench.position[0]:.3g} m, attitude"
        for i, truth in enumerate(request.each(list(truths), name, (k, len(runs)))):
            answers += measured(bench, path.stem, i, truth, rng)
    lines = [line for _, _, part in by_setting(answers) for line in _compare(part)]
    columns = {name: ([getattr(a, name) for a in answers], meaning) for name, meaning in MEANINGS.items()}
    columns["margin"] = [m if np.isfinite(m) else None for m in columns["margin"][0]], MEANINGS["margin"]
    note = (
        f"{request.sizes['draws']} attitudes per shape and range, drawn over SO(3); 16 lines, 2 deg apart, 0.2 deg "
        f"along the line, range noise 1 cm. Each acquisition that is right is followed through {FOLLOWED} scans in "
        f"steps of {STEP_DEG:g} deg. Errors are modulo symmetry. The paper's sensor is denser."
    )
    return Outcome(lines, data(columns), _draw(answers), (note,))


def shapes(folder: Path | None) -> list[Path]:
    """Return the files of a folder's shapes, by name; None: of this package's. Raises SwarmError where none is."""
    if folder is None:
        return [find_model(name) for name in OWN]
    if not folder.is_dir():
        raise SwarmError(f"--shapes: {folder}: no such folder")
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    if not found:
        raise SwarmError(f"--shapes: {folder}: no shape ({', '.join('*' + suffix for suffix in SUFFIXES)})")
    return found


def bench_of(path: Path, number: int, seed: int, range_m: float | None = None) -> Turntable:
    """Return the turntable with a shape at one of its ranges.

    Args:
        path: the shape's file.
        number: of `RANGES_M`, 0 near and 1 far.
        seed: of the scanner's draws.
        range_m: another range [m] instead.
    """
    range_m = range_m or max(RANGES_M[number], LENGTHS[number] * known_shape(path).diameter_m)
    settings = SCANNER.model_copy(update={"range_max_m": max(SCANNER.range_max_m, 3 * range_m)})
    return Turntable(seed, path, settings, range_m)


def errors(shape: Shape, true: Floats, place: Floats, rotation: Floats, position: Floats) -> tuple[float, float]:
    """Return the errors of attitude [deg] and position [mm], of the true pose's equivalents beside the nearest.

    Args:
        shape: of the target.
        true: (3, 3), the true attitude.
        place: (3,) [m], the true position.
        rotation: (3, 3), found; NaN where none was.
        position: (3,) [m], found.
    """
    if not np.isfinite(rotation).all():
        return np.nan, np.nan
    same, there = symmetry(shape).nearest(true, place, rotation)
    return float(np.degrees(rot.angle_between(same, rotation))), 1e3 * float(np.linalg.norm(there - position))


def is_right(shape: Shape, off: tuple[float, float], covariance: Floats | None = None) -> bool:
    """Return whether errors are what a right answer may have.

    Args:
        shape: of the target.
        off: errors of attitude [deg] and position [mm].
        covariance: (6, 6), what the answer promises; None: nothing.
    """
    promised = np.zeros(2)
    if covariance is not None:
        promised = SIGMAS * np.sqrt([np.trace(covariance[:3, :3]), np.trace(covariance[3:, 3:])])
    turned, moved = max(RIGHT_DEG, np.degrees(promised[0])), 1e3 * max(RIGHT_LENGTH * shape.diameter_m, promised[1])
    return bool(off[0] <= turned and off[1] <= moved)


def measured(
    bench: Turntable, name: str, number: int, truth: Floats, rng: np.random.Generator, followed: int = FOLLOWED
) -> list[Answer]:
    """Return the acquisition at one attitude, and the scans that follow it if it is right.

    Args:
        bench: the turntable with the shape.
        name: of the shape.
        number: of the attitude.
        truth: (3, 3), R_s_t.
        rng: draws the axis about which the target turns.
        followed: scans that follow.
    """
    shape, range_m = bench.shape, float(bench.position[0])
    found = acquire(bench.scan(truth), shape)
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    off = errors(shape, truth, bench.position, found.rotation, found.position)
    right = found.found and is_right(shape, off, found.covariance)
    word, margin = found.verdict.value, found.margin
    out = [Answer(name, range_m, number, 0, word, found.found, right, *off, found.overlap, margin, found.points)]
    rotation, position = found.rotation, found.position
    for scan in range(1, 1 + followed if right else 1):
        truth = rot.exp(np.radians(STEP_DEG) * axis) @ truth
        fit = track(bench.scan(truth), shape, rotation, position)
        off = errors(shape, truth, bench.position, fit.rotation, fit.position)
        right = fit.tracked and is_right(shape, off, fit.covariance)
        word = fit.outcome.value
        out.append(Answer(name, range_m, number, scan, word, fit.tracked, right, *off, fit.overlap, np.nan, fit.points))
        if fit.tracked:
            rotation, position = fit.rotation, fit.position
    return out


def by_setting(answers: list[Answer]) -> Iterator[tuple[str, float, list[Answer]]]:
    """Yield name, range [m] and answers of every shape at every range."""
    for name, range_m in dict.fromkeys((a.shape, a.range_m) for a in answers):
        yield name, range_m, [a for a in answers if (a.shape, a.range_m) == (name, range_m)]


def flagged(answers: list[Answer]) -> dict[str, int]:
    """Return how many acquisitions say of themselves that they are none, by what they say."""
    words = [a.answer for a in answers if a.scan == 0 and not a.believed]
    return {word: words.count(word) for word in sorted(set(words))}


def _compare(part: list[Answer]) -> list[Line]:
    """Return the comparison of one shape at one range."""
    first, later = [a for a in part if a.scan == 0], [a for a in part if a.scan > 0]
    off = np.array([(a.error_deg, a.error_mm) for a in first if a.right]).reshape(-1, 2)
    words = ", ".join(f"{count} {word}" for word, count in flagged(part).items()) or "none"
    lines = [
        Line("acquired right", "", None, len(off) / len(first)),
        Line("flagged", "", None, words),
        Line("silently wrong", "", None, float(sum(a.wrong for a in first)), (None, 0.0)),
    ]
    if len(off):
        tracked = [a for a in later if a.believed]
        lines += [
            Line("mean error", "deg", PAPER_DEG, float(off[:, 0].mean()), (None, PAPER_DEG)),
            Line("mean error", "mm", PAPER_MM, float(off[:, 1].mean()), (None, PAPER_MM)),
            Line("followed scans tracked", "", None, len(tracked) / len(later)),
            Line("... silently wrong", "", None, float(sum(a.wrong for a in later)), (None, 0.0)),
        ]
    return under(f"{part[0].shape}, {part[0].range_m:.3g} m", *lines)


def _draw(answers: list[Answer]) -> figures.Figure:
    """Draw the shares of acquisitions that were right, flagged and wrong, and the errors of the right ones."""
    settings = [(f"{name}, {range_m:.3g} m", part) for name, range_m, part in by_setting(answers)]
    page, axes = figures.page(1, 2, max(2.8, 0.9 + 0.24 * len(settings)))
    left, right = axes[0]
    rows = np.arange(len(settings))[::-1]
    first = [[a for a in part if a.scan == 0] for _, part in settings]
    counts: Floats = np.array(
        [[sum(a.right for a in f), sum(not a.believed for a in f), sum(a.wrong for a in f)] for f in first]
    ) / np.array([[len(f)] for f in first])
    begin = np.zeros(len(settings))
    kinds = (("right", figures.BLUE), ("flagged", figures.GREY), ("wrong", figures.VERMILLION))
    for share, (label, colour) in zip(counts.T, kinds, strict=True):
        left.barh(rows, share, left=begin, color=colour, label=label, height=0.7)
        begin = begin + share
    left.set_yticks(rows, [name for name, _ in settings], fontsize="x-small")
    left.set(xlabel="share of the attitudes", xlim=(0, 1))
    left.legend(loc="upper center", bbox_to_anchor=(0.5, 1.12), ncols=3, fontsize="x-small", frameon=False)
    for row, part in zip(rows, first, strict=True):
        off = np.array([a.error_deg for a in part if a.right])
        right.plot(off, np.full(len(off), row), "|", ms=7, mew=0.7, color=figures.BLUE)
    right.set_xscale("log")
    right.axvline(PAPER_DEG, color=figures.GREY, lw=1, ls="--")
    known: Bools = np.array([a.right for a in answers])
    right.set_yticks(rows, [""] * len(rows))
    right.set(xlabel="attitude error, deg; dashed: published mean", ylim=left.get_ylim())
    if not known.any():
        right.set_xlim(0.01, 1)
    return page
