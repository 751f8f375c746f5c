"""A full turn, source 3 section 2 and figure 7: the satellite turned about Z in steps of 5 degrees, 72 scans.

A new track starts, with an acquisition, every 60 degrees. Without accumulation and with it, as in `lidar_tracking`;
where the scanner sees the panels edge-on there are fewest returns.
"""

import numpy as np

from swarm.studies.papers.experiment import Line, Outcome, Request, data, under
from swarm.studies.papers.lidar import Turntable
from swarm.studies.papers.lidar_tracking import MODEL, Step, columns, compare, draw, follow

STEP_DEG, TRACK_DEG = 5.0, 60.0
FEW, MANY = 0.25, 0.75
"""Quantiles of the returns: edge-on, and face-on."""


def run(request: Request) -> Outcome:
    """Scan the whole turn, and compare."""
    bench = Turntable(request.seed)
    number = min(request.sizes["poses"], round(360 / STEP_DEG))
    per_track = round(TRACK_DEG / STEP_DEG)
    yaw = STEP_DEG * np.arange(number)
    steps: list[Step] = []
    starts = range(0, number, per_track)
    for i, begin in enumerate(starts):
        part = yaw[begin : begin + per_track]
        angles = np.stack([np.zeros_like(part), np.zeros_like(part), part], axis=1)
        steps += follow(bench, request.each(list(angles), f"track {i + 1} of {len(starts)}, scan", (i, len(starts))), i)
    points, error = np.array([s.points for s in steps]), np.array([s.model_deg for s in steps])
    few, many = error[points <= np.quantile(points, FEW)], error[points >= np.quantile(points, MANY)]
    edge_on = under(
        MODEL,
        Line("mean error, fewest returns", "deg", "larger", float(np.nanmean(few))),
        Line("mean error, most returns", "deg", "smaller", float(np.nanmean(many))),
    )
    drawn = draw(steps, [s.yaw_deg for s in steps], "angle about Z, deg", "Figure 7")
    note = f"{number} scans, {STEP_DEG:g} deg apart; a new track every {TRACK_DEG:g} deg."
    return Outcome([*compare(steps, "no loss"), *edge_on], data(columns(steps)), drawn, (note,))
