"""A full turn, source 3 section 2 and figure 7: the satellite turned about Z in steps of 5 degrees, 72 scans.

A new track starts, with an acquisition, every 60 degrees. Without accumulation and with it, as in `lidar_tracking`;
where the scanner sees the panels edge-on there are fewest returns.
"""

import numpy as np

from swarm.studies.papers.lidar import Turntable
from swarm.studies.papers.lidar_tracking import MODEL, Step, compare, data, draw, follow
from swarm.studies.papers.results import Line, Outcome, Request

STEP_DEG, TRACK_DEG = 5.0, 60.0
FEW, MANY = 0.25, 0.75
"""Quantiles of the returns: edge-on, and face-on."""


def run(request: Request) -> Outcome:
    """The whole turn, and the comparison."""
    bench = Turntable(request.seed)
    number = min(request.sizes["poses"], round(360 / STEP_DEG))
    per_track = round(TRACK_DEG / STEP_DEG)
    yaw = STEP_DEG * np.arange(number)
    steps: list[Step] = []
    for i in range(0, number, per_track):
        part = yaw[i : i + per_track]
        steps += follow(bench, np.stack([np.zeros_like(part), np.zeros_like(part), part], axis=1), i // per_track)
        request.progress(len(steps) / number, f"{yaw[len(steps) - 1]:g} deg of the turn")
    return Outcome(
        [*compare(steps, "no loss"), *edge_on(steps)],
        data(steps),
        draw(steps, "angle about Z, deg", "Figure 7", against_yaw=True),
        (f"{number} scans, {STEP_DEG:g} deg apart; a new track every {TRACK_DEG:g} deg.",),
    )


def edge_on(steps: list[Step]) -> list[Line]:
    """Whether the error is larger where the target turns its edge to the scanner."""
    points = np.array([s.points for s in steps])
    error = np.array([s.model_deg for s in steps])
    few, many = (error[points <= np.quantile(points, FEW)], error[points >= np.quantile(points, MANY)])
    return [
        Line("mean error, fewest returns", "deg", "larger", float(np.nanmean(few)), None, MODEL),
        Line("mean error, most returns", "deg", "smaller", float(np.nanmean(many)), None, MODEL),
    ]
