"""Tracking, source 3 section 2 and figure 6: random attitudes within 10 degrees, from five starts.

At the start the attitude is acquired; every further scan is tracked from the last answer, without any prediction, as on
a turntable that jumps. Twice on the same scans: each against the known *model* (ours), and each against the last *scan*
(the paper's, whose errors accumulate).
"""

from typing import NamedTuple

import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure

from estimators.arrays import Floats
from estimators.lidar.acquisition import acquire
from estimators.lidar.scan import Scan
from estimators.lidar.tracking import Outcome as Fate
from estimators.lidar.tracking import TrackingSettings, chain, track
from swarm.studies.papers import figures
from swarm.studies.papers.lidar import Turntable, error_deg, quantiles, turned
from swarm.studies.papers.results import Line, Outcome, Request, column, table_of

STARTS_DEG = (0.0, 5.0, -5.0, 10.0, -10.0)
RANGE_DEG = 10.0
PAPER_DEG, WANTED_DEG = 2.0, 0.5
JUMPS = TrackingSettings(walk_most_rad=np.radians(45.0), overlap_sure=1.0)
"""Two attitudes within 10 degrees about each axis can be 35 degrees apart: nothing here is a walk away."""
MODEL, SCANS = "Each scan against the model", "Each scan against the last, accumulated"


class Step(NamedTuple):
    """One measurement. track, number: which track, and the place in it. model_deg, chain_deg: errors [deg]. sigma_deg:
    what the registration believes. lost: neither tracked nor, after that, acquired. again: acquired anew.
    """

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
    """Every track, and the comparison."""
    rng = np.random.default_rng(request.seed)
    bench = Turntable(request.seed)
    tracks, length = min(request.sizes["runs"], len(STARTS_DEG)), request.sizes["frames"]
    steps: list[Step] = []
    for i in range(tracks):
        random = rng.uniform(-RANGE_DEG, RANGE_DEG, (length - 1, 3))
        steps += follow(bench, np.concatenate([np.full((1, 3), STARTS_DEG[i]), random]), i)
        request.progress((i + 1) / tracks, f"track {i + 1} of {tracks}")
    notes = (
        f"{tracks} tracks of {length} scans: an acquisition, then attitudes drawn within {RANGE_DEG:g} deg about each "
        "axis. Growth: least squares through the errors of a track against the number of the scan.",
    )
    return Outcome(compare(steps), data(steps), draw(steps, "scan of the track", "Figure 6"), notes)


def follow(bench: Turntable, angles_deg: Floats, number: int) -> list[Step]:
    """One track through the turntable's angles (n, 3) [deg]."""
    steps: list[Step] = []
    rotation = chained = np.full((3, 3), np.nan)
    position = chained_position = bench.position
    before: Scan | None = None
    for i, angles in enumerate(angles_deg):
        truth, scan = turned(angles), None
        scan = bench.scan(truth)
        sigma, points, lost, again = np.nan, 0, False, False
        fit = track(scan, bench.shape, rotation, position, JUMPS) if np.isfinite(rotation).all() else None
        if fit is not None and fit.outcome is Fate.TRACKED:
            rotation, position, sigma, points = fit.rotation, fit.position, _sigma_deg(fit.covariance), fit.points
        else:
            found = acquire(scan, bench.shape)
            lost, again = not found.found, fit is not None
            rotation, position = found.rotation, found.position
            sigma, points = _sigma_deg(found.covariance), found.points
        own = scan.around(bench.position, 1.2 * bench.shape.radius_m)
        if before is None:
            chained, chained_position = rotation, position
        else:
            chained, chained_position = chain(own, before, chained, chained_position)
        before = own
        model_deg, chain_deg = float(error_deg(truth, rotation)), float(error_deg(truth, chained))
        steps.append(Step(number, i, float(angles[2]), model_deg, chain_deg, sigma, points, lost, again))
    return steps


def _sigma_deg(covariance: Floats) -> float:
    return float(np.degrees(np.sqrt(np.trace(covariance[:3, :3]))))


def growth(steps: list[Step], key: str) -> float:
    """Slope of the error along a track [deg per scan], least squares over all tracks."""
    x = np.array([s.number for s in steps], dtype=np.float64)
    y = np.array([getattr(s, key) for s in steps])
    known = np.isfinite(y)
    return float(np.polyfit(x[known], y[known], 1)[0]) if np.ptp(x) > 0 else float("nan")


def compare(steps: list[Step], limit: str = f"< {PAPER_DEG:g}") -> list[Line]:
    """Paper beside ours, without and with accumulation."""
    lines = []
    for group, key in ((MODEL, "model_deg"), (SCANS, "chain_deg")):
        own = group == MODEL
        errors = np.array([getattr(s, key) for s in steps])
        for name, value in quantiles(errors).items():
            target = {"largest": (None, PAPER_DEG), "mean": (None, WANTED_DEG)}.get(name) if own else None
            paper = limit if name == "largest" else None
            lines.append(Line(f"{name} error", "deg", paper, value, target, group))
        slope = growth(steps, key)
        lines.append(Line("growth", "deg/scan", None if own else "> 0", slope, (None, 0.005) if own else None, group))
        if own:
            lines.append(Line("lost", "", "0", float(sum(s.lost for s in steps)), (0.0, 0.0), group))
            lines.append(Line("acquired anew", "", None, float(sum(s.again for s in steps)), None, group))
    return lines


def data(steps: list[Step]) -> pa.Table:
    """A row per scan."""
    meanings = {
        "track": ("1", "which track"),
        "number": ("1", "the scan's place in it"),
        "yaw_deg": ("deg", "the turntable's angle about Z"),
        "model_deg": ("deg", "error, each scan against the model"),
        "chain_deg": ("deg", "error, each scan against the last one"),
        "sigma_deg": ("deg", "against the model: what the registration believes, root of the trace"),
        "points": ("1", "returns of the target"),
        "lost": ("", "neither tracked nor acquired"),
        "again": ("", "tracking had failed, and it was acquired anew"),
    }
    return table_of([column(name, [getattr(s, name) for s in steps], *text) for name, text in meanings.items()])


def draw(steps: list[Step], label: str, title: str, against_yaw: bool = False) -> Figure:
    """Figures 6 and 7: the errors along the tracks, without accumulation and with it."""
    page, axes = figures.page(1, 2, 2.8)
    for place, key, name in ((axes[0, 0], "model_deg", "against the model"), (axes[0, 1], "chain_deg", "accumulated")):
        for i in sorted({s.track for s in steps}):
            own = [s for s in steps if s.track == i]
            x = [s.yaw_deg if against_yaw else s.number + 1 for s in own]
            place.plot(x, [getattr(s, key) for s in own], ".-", ms=3, lw=0.7)
        place.axhline(PAPER_DEG, color=figures.GREY, lw=1, ls="--")
        place.set(xlabel=label, ylabel="attitude error, deg", title=f"{title}, {name}")
        place.set_ylim(bottom=0)
    return page
