"""Acquisition, source 3 section 2 and figure 5: the attitude of a satellite from one scan, from nothing.

125 attitudes of the turntable, -10 to 10 degrees in steps of 5 about each axis, and attitudes drawn uniformly over
SO(3). Three methods on the same scans: ours (`estimators.lidar.acquisition`), the paper's templates as they are, and
the same templates with the whole cloud compared instead of its most complete feature.
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lidar.acquisition import Acquisition, acquire
from estimators.lidar.feature_templates import Templates
from swarm import figures
from swarm.studies.papers.experiment import Columns, Line, Outcome, Request, data, quantiles, under
from swarm.studies.papers.lidar import Turntable, error_deg, turned

STEPS_DEG = (-10.0, -5.0, 0.0, 5.0, 10.0)
PAPER_DEG, WANTED_DEG, RIGHT_DEG, RIGHT_SHARE = 1.5, 0.5, 2.0, 0.95
TURNTABLE, RANDOM = "Turntable, -10 to 10 deg", "Any attitude"


class Result(NamedTuple):
    """One scan: the true attitude (3, 3), what ours found, and the errors of all three methods [deg]."""

    group: str
    truth: Floats
    ours: Acquisition
    ours_deg: float
    template_deg: float
    whole_deg: float


def run(request: Request) -> Outcome:
    """Scan every attitude and compare."""
    rng, bench = request.rng(), Turntable(request.seed)
    templates = bench.templates()
    grid = np.array([(x, y, z) for z in STEPS_DEG for y in STEPS_DEG for x in STEPS_DEG])
    chosen = grid[np.unique(np.linspace(0, len(grid) - 1, request.sizes["poses"]).round().astype(int))]
    truths = [(TURNTABLE, turned(angles)) for angles in chosen]
    truths += [(RANDOM, rotation) for rotation in random_rotations(request.sizes["draws"], rng)]
    results = [_measure(bench, templates, group, truth) for group, truth in request.each(truths, "attitude")]
    verdicts = [r.ours.verdict.value for r in results if r.group == RANDOM]
    counted = ", ".join(f"{verdicts.count(v)} {v}" for v in sorted(set(verdicts)))
    notes = (
        f"16 lines, 2 deg apart, 0.2 deg along the line, range noise 1 cm, {bench.position[0]:g} m away. "
        f"Ours says of the attitudes drawn at random: {counted}.",
        "The paper's templates are 24 different attitudes 90 deg apart. A feature alone looks the same in several of "
        "them: the two panels in four. It is measured as it is, and with the whole cloud compared.",
    )
    groups = [(group, [r for r in results if r.group == group]) for group in (TURNTABLE, RANDOM)]
    lines = [line for group, part in groups if part for line in _compare(group, part)]
    return Outcome(lines, data(_columns(results)), _draw(results), notes)


def random_rotations(count: int, rng: np.random.Generator) -> Floats:
    """Draw attitudes (count, 3, 3), uniform over SO(3)."""
    q = rng.standard_normal((count, 4))
    return rot.matrix_from_quaternion(q / np.linalg.norm(q, axis=1, keepdims=True))


def _measure(bench: Turntable, templates: Templates, group: str, truth: Floats) -> Result:
    scan = bench.scan(truth)
    ours = acquire(scan, bench.shape)

    def template_error(whole: bool) -> float:
        try:
            fit = templates.acquire(scan.point, bench.shape, scan.noise_m, compare_whole=whole).fit
        except ValueError:
            return float("nan")
        return float(error_deg(truth, fit.rotation))

    errors = float(error_deg(truth, ours.rotation)), template_error(False), template_error(True)
    return Result(group, truth, ours, errors[0], errors[1], errors[2])


def _compare(group: str, part: list[Result]) -> list[Line]:
    ours, template, whole = np.array([(r.ours_deg, r.template_deg, r.whole_deg) for r in part]).T
    found, right = np.array([r.ours.found for r in part]), ours < RIGHT_DEG
    lines = [Line(f"{name} error", "deg", None, value) for name, value in quantiles(ours).items()]
    if group == TURNTABLE:
        lines[0] = lines[0]._replace(paper=f"< {PAPER_DEG}", target=(None, PAPER_DEG))
        lines.append(Line("mean error, wanted", "deg", None, float(np.mean(ours)), (None, WANTED_DEG)))
    lines += [
        Line(f"within {RIGHT_DEG:g} deg", "", None, float(np.mean(right)), (RIGHT_SHARE, None)),
        Line("wrong, and not flagged", "", None, float(np.sum(found & ~right)), (None, 0.0)),
        Line("right, but flagged", "", None, float(np.sum(~found & right))),
    ]
    for title, other in (("64 templates as they are", template), ("... whole cloud compared", whole)):
        lines += [
            Line(f"{title}: within {RIGHT_DEG:g} deg", "", None, float(np.mean(other < RIGHT_DEG))),
            Line("... median error", "deg", None, float(np.nanmedian(other))),
        ]
    return under(group, *lines)


def _columns(results: list[Result]) -> Columns:
    ours = [r.ours for r in results]
    return {
        "group": ([r.group for r in results], "turntable, or drawn at random"),
        "q*": (rot.quaternion_from_matrix(np.array([r.truth for r in results])), "true attitude quaternion, *"),
        "points": ([a.points for a in ours], "returns of the target"),
        "error_deg": ([r.ours_deg for r in results], "ours: angle from the truth"),
        "verdict": ([a.verdict.value for a in ours], "ours: what it says of itself"),
        "confidence": ([a.confidence for a in ours], "ours: above a half where found"),
        "overlap": ([a.overlap for a in ours], "ours: share of the rays that agree"),
        "margin": ([a.margin if np.isfinite(a.margin) else None for a in ours], "ours: of the runner-up"),
        "template_error_deg": ([r.template_deg for r in results], "the paper's templates"),
        "whole_error_deg": ([r.whole_deg for r in results], "templates, whole cloud compared"),
    }


def _draw(results: list[Result]) -> figures.Figure:
    """Draw figure 5, the error at every attitude of the turntable; beside it the distributions from any attitude."""
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
