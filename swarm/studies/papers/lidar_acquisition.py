"""Acquisition, source 3 section 2 and figure 5: the attitude of a satellite from one scan, from nothing.

125 attitudes of the turntable, -10 to 10 degrees in steps of 5 about each axis, and attitudes drawn uniformly over
SO(3). Three methods on the same scans: ours (`estimators.lidar.acquisition`), the paper's templates as they are, and
the same templates with the whole cloud compared instead of its most complete feature.
"""

from typing import NamedTuple

import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lidar.acquisition import Acquisition, acquire
from estimators.lidar.feature_templates import Templates
from swarm.studies.papers import figures
from swarm.studies.papers.lidar import Turntable, error_deg, quantiles, turned
from swarm.studies.papers.results import Line, Outcome, Request, column, table_of

STEPS_DEG = (-10.0, -5.0, 0.0, 5.0, 10.0)
PAPER_DEG, WANTED_DEG, RIGHT_DEG, RIGHT_SHARE = 1.5, 0.5, 2.0, 0.95
TURNTABLE, RANDOM = "Turntable, -10 to 10 deg", "Any attitude"


class Result(NamedTuple):
    """One scan. truth: (3, 3). ours: what we found. template_deg, whole_deg: errors of the paper's templates [deg]."""

    group: str
    truth: Floats
    ours: Acquisition
    ours_deg: float
    template_deg: float
    whole_deg: float


def run(request: Request) -> Outcome:
    """Scan every attitude and compare."""
    rng = np.random.default_rng(request.seed)
    bench = Turntable(request.seed)
    templates = bench.templates()
    grid = np.array([(x, y, z) for z in STEPS_DEG for y in STEPS_DEG for x in STEPS_DEG])
    chosen = grid[np.unique(np.linspace(0, len(grid) - 1, request.sizes["poses"]).round().astype(int))]
    truths = [(TURNTABLE, turned(angles)) for angles in chosen]
    truths += [(RANDOM, rotation) for rotation in random_rotations(request.sizes["draws"], rng)]
    results = []
    for i, (group, truth) in enumerate(truths):
        results.append(measure(bench, templates, group, truth))
        request.progress((i + 1) / len(truths), f"attitude {i + 1} of {len(truths)}")
    verdicts = [r.ours.verdict.value for r in results if r.group == RANDOM]
    counted = ", ".join(f"{verdicts.count(v)} {v}" for v in sorted(set(verdicts)))
    notes = (
        f"16 lines, 2 deg apart, 0.2 deg along the line, range noise 1 cm, {bench.position[0]:g} m away. "
        f"Ours says of the attitudes drawn at random: {counted}.",
        "The paper's templates are 24 different attitudes 90 deg apart. A feature alone looks the same in several of "
        "them: the two panels in four. It is measured as it is, and with the whole cloud compared.",
    )
    return Outcome(compare(results), data(results), draw(results), notes)


def random_rotations(count: int, rng: np.random.Generator) -> Floats:
    """Attitudes (count, 3, 3), uniform over SO(3)."""
    q = rng.standard_normal((count, 4))
    return rot.matrix_from_quaternion(q / np.linalg.norm(q, axis=1, keepdims=True))


def measure(bench: Turntable, templates: Templates, group: str, truth: Floats) -> Result:
    """All three methods on one scan."""
    scan = bench.scan(truth)
    ours = acquire(scan, bench.shape)
    by_template = []
    for whole in (False, True):
        try:
            fit = templates.acquire(scan.point, bench.shape, scan.noise_m, compare_whole=whole).fit
            by_template.append(float(error_deg(truth, fit.rotation)))
        except ValueError:
            by_template.append(float("nan"))
    return Result(group, truth, ours, float(error_deg(truth, ours.rotation)), *by_template)


def compare(results: list[Result]) -> list[Line]:
    """Paper beside ours."""
    lines = []
    for group in (TURNTABLE, RANDOM):
        part = [r for r in results if r.group == group]
        if not part:
            continue
        of_table = group == TURNTABLE
        ours = np.array([r.ours_deg for r in part])
        found = np.array([r.ours.found for r in part])
        right = ours < RIGHT_DEG
        for name, value in quantiles(ours).items():
            first = of_table and name == "mean"
            target = (None, PAPER_DEG) if first else None
            lines.append(Line(f"{name} error", "deg", f"< {PAPER_DEG}" if first else None, value, target, group))
        if of_table:
            lines.append(Line("mean error, wanted", "deg", None, float(np.mean(ours)), (None, WANTED_DEG), group))
        share = float(np.mean(right))
        lines.append(Line(f"within {RIGHT_DEG:g} deg", "", None, share, (RIGHT_SHARE, None), group))
        lines.append(Line("wrong, and not flagged", "", None, float(np.sum(found & ~right)), (None, 0.0), group))
        lines.append(Line("right, but flagged", "", None, float(np.sum(~found & right)), None, group))
        for title, key in (("64 templates as they are", "template_deg"), ("... whole cloud compared", "whole_deg")):
            other = np.array([getattr(r, key) for r in part])
            label = f"{title}: within {RIGHT_DEG:g} deg"
            lines.append(Line(label, "", None, float(np.mean(other < RIGHT_DEG)), None, group))
            lines.append(Line("... median error", "deg", None, float(np.nanmedian(other)), None, group))
    return lines


def data(results: list[Result]) -> pa.Table:
    """A row per scan."""
    quaternion = rot.quaternion_from_matrix(np.array([r.truth for r in results]))
    ours = [r.ours for r in results]
    columns = [column("group", [r.group for r in results], "", "turntable, or drawn at random")]
    columns += [column(f"q{a}", quaternion[:, i], "1", f"true attitude quaternion, {a}") for i, a in enumerate("wxyz")]
    columns += [
        column("points", [a.points for a in ours], "1", "returns of the target"),
        column("error_deg", [r.ours_deg for r in results], "deg", "ours: angle from the truth"),
        column("verdict", [a.verdict.value for a in ours], "", "ours: what it says of itself"),
        column("confidence", [a.confidence for a in ours], "1", "ours: above a half where found"),
        column("overlap", [a.overlap for a in ours], "1", "ours: share of the rays that agree"),
        column("margin", [a.margin if np.isfinite(a.margin) else None for a in ours], "1", "ours: of the runner-up"),
        column("template_error_deg", [r.template_deg for r in results], "deg", "the paper's templates"),
        column("whole_error_deg", [r.whole_deg for r in results], "deg", "templates, whole cloud compared"),
    ]
    return table_of(columns)


def draw(results: list[Result]) -> Figure:
    """Figure 5: the error at every attitude of the turntable; beside it the distributions from any attitude."""
    page, axes = figures.page(1, 2, 2.9)
    left, right = axes[0]
    table = [r.ours_deg for r in results if r.group == TURNTABLE]
    left.plot(np.arange(1, len(table) + 1), table, "o", ms=3, color=figures.BLUE, label="ours")
    left.axhline(PAPER_DEG, color=figures.GREY, lw=1, ls="--", label="paper: mean below")
    left.set_ylim(0, 1.25 * max(PAPER_DEG, max(table, default=0)))
    left.set(xlabel="attitude of the turntable", ylabel="attitude error, deg", title="Figure 5")
    figures.legend(left)
    drawn = [r for r in results if r.group == RANDOM] or results
    # Names in the gap between the curves: a legend would lie across one.
    for key, label, place, colour in (
        ("ours_deg", "ours", (0.17, 0.55), figures.BLUE),
        ("whole_deg", "64 templates, whole cloud", (0.17, 0.27), figures.ORANGE),
        ("template_deg", "64 templates as they are", (0.17, 0.17), figures.VERMILLION),
    ):
        errors = np.sort([getattr(r, key) for r in drawn])
        right.plot(errors, np.arange(1, len(errors) + 1) / len(errors), color=colour)
        right.text(*place, label, color=colour, fontsize="small")
    right.set_xscale("log")
    right.axvline(RIGHT_DEG, color=figures.GREY, lw=1, ls="--")
    right.set(xlabel="attitude error, deg", ylabel="share below", title="Any attitude", ylim=(0, 1.02))
    return page
