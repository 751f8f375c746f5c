"""Tracking, source 3 section 2 and figure 6: random attitudes within 10 degrees, from five starts.

At the start the attitude is acquired; every further scan is tracked from the last answer, without any prediction, as on
a turntable that jumps. Twice on the same scans: each against the known *model* (ours), and each against the last *scan*
(the paper's, whose errors accumulate).
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.lidar.acquisition import acquire
from estimators.lidar.scan import Scan
from estimators.lidar.tracking import Outcome as Fate
from estimators.lidar.tracking import TrackingSettings, chain, track
from swarm import figures
from swarm.studies.papers.experiment import Columns, Line, Outcome, Request, data, quantiles, under
from swarm.studies.papers.lidar import Turntable, error_deg, turned

STARTS_DEG = (0.0, 5.0, -5.0, 10.0, -10.0)
RANGE_DEG = 10.0
PAPER_DEG, WANTED_DEG, GROWTH_DEG = 2.0, 0.5, 0.005
JUMPS = TrackingSettings(walk_most_rad=np.radians(45.0), overlap_sure=1.0)
"""Two attitudes within 10 degrees about each axis can be 35 degrees apart: nothing here is a walk away."""
MODEL, SCANS = "Each scan against the model", "Each scan against the last, accumulated"
MEANINGS = {
    "track": "which track",
    "number": "the scan's place in it",
    "yaw_deg": "the turntable's angle about Z",
    "model_deg": "error, each scan against the model",
    "chain_deg": "error, each scan against the last one",
    "sigma_deg": "against the model: what the registration believes, root of the trace",
    "points": "returns of the target",
    "lost": "neither tracked nor acquired",
    "again": "tracking had failed, and it was acquired anew",
}


class Step(NamedTuple):
    """One measurement; its fields are the columns of the data, see MEANINGS."""

    track: int
    number: int
    yaw_deg: float
    model_deg: float
    chain_deg: float
    sigma_deg: float
    points: int
    lost: bool
    again: bool


def run(request: Request) -> Outcome:
    """Follow every track, and compare."""
    rng, bench = request.rng(), Turntable(request.seed)
    tracks, length = min(request.sizes["runs"], len(STARTS_DEG)), request.sizes["frames"]
    steps: list[Step] = []
    for i in range(tracks):
        random = rng.uniform(-RANGE_DEG, RANGE_DEG, (length - 1, 3))
        angles = np.concatenate([np.full((1, 3), STARTS_DEG[i]), random])
        steps += follow(bench, request.each(list(angles), f"track {i + 1} of {tracks}, scan", (i, tracks)), i)
    note = (
        f"{tracks} tracks of {length} scans: an acquisition, then attitudes drawn within {RANGE_DEG:g} deg about each "
        "axis. Growth: least squares through the errors of a track against the number of the scan."
    )
    drawn = draw(steps, [s.number + 1 for s in steps], "scan of the track", "Figure 6")
    return Outcome(compare(steps), data(columns(steps)), drawn, (note,))


def follow(bench: Turntable, angles_deg: Iterable[Floats], number: int) -> list[Step]:
    """Follow the target through one track.

    Args:
        bench: The turntable.
        angles_deg: Its roll, pitch and yaw (3,) at every scan [deg].
        number: The track's number.
    """
    steps: list[Step] = []
    rotation = chained = np.full((3, 3), np.nan)
    position = chained_position = bench.position
    before: Scan | None = None
    for i, angles in enumerate(angles_deg):
        truth = turned(angles)
        scan = bench.scan(truth)
        lost = again = False
        fit = track(scan, bench.shape, rotation, position, JUMPS) if np.isfinite(rotation).all() else None
        if fit is not None and fit.outcome is Fate.TRACKED:
            rotation, position, covariance, points = fit.rotation, fit.position, fit.covariance, fit.points
        else:
            found = acquire(scan, bench.shape)
            lost, again = not found.found, fit is not None
            rotation, position, covariance, points = found.rotation, found.position, found.covariance, found.points
        sigma = float(np.degrees(np.sqrt(np.trace(covariance[:3, :3]))))
        own = scan.around(bench.position, 1.2 * bench.shape.radius_m)
        if before is None:
            chained, chained_position = rotation, position
        else:
            chained, chained_position = chain(own, before, chained, chained_position)
        before = own
        model_deg, chain_deg = float(error_deg(truth, rotation)), float(error_deg(truth, chained))
        steps.append(Step(number, i, float(angles[2]), model_deg, chain_deg, sigma, points, lost, again))
    return steps


def compare(steps: list[Step], limit: str = f"< {PAPER_DEG:g}") -> list[Line]:
    """Return the comparison, without and with accumulation. limit: what the paper says of the largest error."""
    lines = []
    papers, targets = {"largest": limit}, {"largest": (None, PAPER_DEG), "mean": (None, WANTED_DEG)}
    for group, key in ((MODEL, "model_deg"), (SCANS, "chain_deg")):
        own = group == MODEL
        errors = np.array([getattr(s, key) for s in steps])
        found = [
            Line(f"{name} error", "deg", papers.get(name), value, targets.get(name) if own else None)
            for name, value in quantiles(errors).items()
        ]
        slope = _slope(np.array([s.number for s in steps], dtype=np.float64), errors)
        found.append(Line("growth", "deg/scan", None if own else "> 0", slope, (None, GROWTH_DEG) if own else None))
        if own:
            found.append(Line("lost", "", "0", float(sum(s.lost for s in steps)), (0.0, 0.0)))
            found.append(Line("acquired anew", "", None, float(sum(s.again for s in steps))))
        lines += under(group, *found)
    return lines


def columns(steps: list[Step]) -> Columns:
    """Return the data, a row per scan."""
    return {name: ([getattr(s, name) for s in steps], meaning) for name, meaning in MEANINGS.items()}


def draw(steps: list[Step], x: Sequence[float], label: str, title: str) -> figures.Figure:
    """Draw figure 6 or 7: the errors along the tracks, without accumulation and with it.

    Args:
        steps: All measurements.
        x: Abscissa of each.
        label: Name of the abscissa.
        title: Name of the figure.
    """
    page, axes = figures.page(1, 2, 2.8)
    for place, key, name in ((axes[0, 0], "model_deg", "against the model"), (axes[0, 1], "chain_deg", "accumulated")):
        for number in sorted({s.track for s in steps}):
            own = [i for i, s in enumerate(steps) if s.track == number]
            place.plot([x[i] for i in own], [getattr(steps[i], key) for i in own], ".-", ms=3, lw=0.7)
        place.axhline(PAPER_DEG, color=figures.GREY, lw=1, ls="--")
        place.set(xlabel=label, ylabel="attitude error, deg", title=f"{title}, {name}")
        place.set_ylim(bottom=0)
    return page


def _slope(x: Floats, y: Floats) -> float:
    known = np.isfinite(y)
    return float(np.polyfit(x[known], y[known], 1)[0]) if np.ptp(x) > 0 else float("nan")
