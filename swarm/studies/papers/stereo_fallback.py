"""Source 2's reason for it all: when the backup camera fails, navigation falls back to one camera without a jump.

The scenario `ccd-docking`, flown with several seeds: 30 m to 1 m on the craft's own estimate, the backup camera dark
between 10 m and 4 m. At each switch, per axis of the pose,

    jump = |e_k - e_(k-1)| / sigma,    e = truth - estimate before and after, sigma the filter's own before it

and the mean NEES (6 degrees of freedom) over each stretch of the approach, against its 95 % chi-square band; the number
of independent values is that of `swarm.results.summary`. Of five stretches a consistent filter has one outside in 23 %
of the sets: the table says so where it happens.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from scipy.special import gammaincinv

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.error_state import POSE_COLUMNS
from estimators.rotation import log, matrix_from_quaternion
from swarm import figures
from swarm.figures import Figure
from swarm.flight.flight import Flight
from swarm.onboard.ccd import CcdState
from swarm.results.summary import consistency
from swarm.scenario import Scenario, load
from swarm.studies.papers.results import Line, Outcome, Request, column, table_of

SCENARIO, CHASER, TARGET = "ccd-docking", 0, 1
MOST_SIGMA = 3.0
STRETCHES_M = ((30.0, 20.0), (20.0, 10.0), (10.0, 4.0), (4.0, 1.5), (1.5, 0.0))
DOF = 6
OUTSIDE = np.array([0.025, 0.975])
"""The 95 % band of each stretch by itself."""
SETTLED_S = 2.0
"""The filter starts without a rate; the stretches begin when it has one."""


class Flown(NamedTuple):
    """One run, period by period (n,): time_s, distance_m between the docking points, CcdState, NEES, and the pose's
    error (n, 6) [rad, m] with the filter's sigmas (n, 6); accepted: the pose was taken in.
    """

    time_s: Floats
    distance_m: Floats
    state: Ints
    nees: Floats
    error: Floats
    sigma: Floats
    accepted: Ints


def run(request: Request) -> Outcome:
    """Fly the scenario with as many seeds as there are runs."""
    runs = request.sizes["runs"]
    flown = []
    for i in range(runs):

        def tell(share: float, before: int = i) -> None:
            request.progress((before + share) / runs, f"run {before + 1} of {runs}")

        flown.append(_fly(load(SCENARIO, seed=request.seed + i), tell))
    period_s = float(flown[0].time_s[1] - flown[0].time_s[0])
    return Outcome(_compare(flown, period_s), _data(flown), _draw(flown))


def _fly(scenario: Scenario, progress: Callable[[float], None]) -> Flown:
    flight = Flight(scenario)
    count = round(scenario.duration_s / flight.period_s)
    rows = []
    for frame in range(count):
        time_s, truth, _, estimate = flight.period(frame)
        covariance = estimate.covariance[CHASER][np.ix_(POSE_COLUMNS, POSE_COLUMNS)]
        turn = matrix_from_quaternion(truth.quaternion[CHASER]) @ estimate.rotation[CHASER].T
        error = np.concatenate([log(turn), truth.position[CHASER] - estimate.position[CHASER]])
        known = np.isfinite(error).all()
        nees = float(error @ np.linalg.solve(covariance, error)) if known else np.nan
        sigma = np.sqrt(np.diagonal(covariance))
        assert estimate.ccd is not None
        gap = _gap(truth.position, truth.quaternion)
        rows.append((time_s, gap, estimate.ccd.state[CHASER], nees, error, sigma, int(estimate.sensor[CHASER] > 0)))
        if frame % 60 == 0:
            progress(frame / count)
    return Flown(*(np.array(part) for part in zip(*rows, strict=True)))


def _gap(position: Floats, quaternion: Floats) -> float:
    """Distance of the docking points [m], from the models: the tips of the two booms, along the target's z axis."""
    chaser, target = matrix_from_quaternion(quaternion[[CHASER, TARGET]])
    tip = chaser @ np.array([0.0, 0.4, 1.5]) + position[CHASER]
    drogue = target @ np.array([0.0, 0.4, 1.3705]) + position[TARGET]
    return float((tip - drogue) @ target[:, 2])


def _switches(flown: Flown) -> Ints:
    """Periods in which another sensor came in."""
    out: Ints = np.flatnonzero(np.diff(flown.state)) + 1
    return out


def _jump(flown: Flown, at: int) -> float:
    """The largest jump of an axis at period `at`, in sigmas."""
    return float(np.max(np.abs(flown.error[at] - flown.error[at - 1]) / flown.sigma[at - 1]))


def _compare(flown: list[Flown], period_s: float) -> list[Line]:
    lines = []
    for name, state in (("backup camera fails", CcdState.CAMERA), ("backup camera comes back", CcdState.STEREO)):
        at = [(f, k) for f in flown for k in _switches(f) if f.state[k] == state]
        jump = np.array([_jump(f, k) for f, k in at])
        lines += [
            Line("switches", "", len(flown), len(at), (len(flown), len(flown)), name),
            Line("distance", "m", None, _span(np.array([f.distance_m[k] for f, k in at])), None, name),
            Line("largest jump of an axis", "sigma", "none", float(jump.max()), (None, MOST_SIGMA), name),
        ]
    group = "NEES, mean (6 if consistent)"
    for high, low in STRETCHES_M:
        inside = [_within(f, high, low) for f in flown]
        frame = np.concatenate([np.flatnonzero(rows) for rows in inside])
        nees = np.concatenate([f.nees[rows] for f, rows in zip(flown, inside, strict=True)])
        found = consistency(frame, nees, period_s)
        assert found is not None
        independent = found["effective_samples"]
        low_band, high_band = 2 * gammaincinv(DOF / 2 * independent, OUTSIDE) / independent
        band = round(float(low_band), 2), round(float(high_band), 2)
        lines.append(Line(f"{high:g} m to {low:g} m", "", None, found["mean"], band, group))
    group = "EKF, RMS over the runs"
    for high, low in STRETCHES_M:
        error = np.concatenate([f.error[_within(f, high, low)] for f in flown])
        position, turn = (float(np.sqrt(np.mean(np.sum(e**2, axis=1)))) for e in (error[:, 3:], error[:, :3]))
        lines.append(Line(f"position, {high:g} m to {low:g} m", "mm", None, 1e3 * position, None, group))
        lines.append(Line(f"attitude, {high:g} m to {low:g} m", "deg", None, float(np.rad2deg(turn)), None, group))
    accepted = np.concatenate([f.accepted for f in flown])
    lines.append(Line("poses taken in", "", None, float(accepted.mean()), None, "The gate"))
    return lines


def _within(flown: Flown, high: float, low: float) -> Bools:
    """The periods (n,) at distances of at most `high` m and above `low`; the first stretch begins at the start."""
    near = (flown.distance_m <= high) | (high == STRETCHES_M[0][0])
    out: Bools = near & (flown.distance_m > low) & (flown.time_s > SETTLED_S)
    return out


def _data(flown: list[Flown]) -> pa.Table:
    number = np.repeat(np.arange(1, len(flown) + 1), [len(f.time_s) for f in flown])
    columns = [
        column("run", number, "1", "number of the run"),
        column("time_s", np.concatenate([f.time_s for f in flown]), "s", "the epoch"),
        column("distance_m", np.concatenate([f.distance_m for f in flown]), "m", "between the docking points"),
        column("ccd", [CcdState(s).name.lower() for f in flown for s in f.state], "", "what the images gave"),
        column("nees", np.concatenate([f.nees for f in flown]), "1", "squared error over the filter's covariance"),
    ]
    for name in ("error", "sigma"):
        values = np.concatenate([getattr(f, name) for f in flown])
        for i, a in enumerate("xyz"):
            turn = np.rad2deg(values[:, i])
            columns.append(column(f"{name}_{a}_m", values[:, 3 + i], "m", f"{name} of the position, {a}"))
            columns.append(column(f"{name}_{a}_deg", turn, "deg", f"{name} of the attitude about {a}"))
    return table_of(columns)


def _draw(flown: list[Flown]) -> Figure:
    page, axes = figures.page(3, 1, 6.0)
    for f in flown:
        settled = f.time_s > SETTLED_S
        for place, part, scale in ((axes[0, 0], slice(3, 6), 1e3), (axes[1, 0], slice(0, 3), 180 / np.pi)):
            size = scale * np.linalg.norm(f.error[settled, part], axis=1)
            place.semilogy(f.distance_m[settled], size, "-", lw=0.4, alpha=0.6, color=figures.BLUE)
    first = flown[0]
    settled = first.time_s > SETTLED_S
    for place, part, scale in ((axes[0, 0], slice(3, 6), 3e3), (axes[1, 0], slice(0, 3), 3 * 180 / np.pi)):
        sigma = scale * np.linalg.norm(first.sigma[settled, part], axis=1)
        place.semilogy(first.distance_m[settled], sigma, "-", lw=1.4, color=figures.VERMILLION, label="3 sigma")
        figures.legend(place)
    nees = np.mean([f.nees for f in flown], axis=0)
    axes[2, 0].plot(first.distance_m[settled], nees[settled], "-", lw=0.5, color=figures.GREEN)
    axes[2, 0].axhline(6, color=figures.GREY, lw=1.0)
    for place, label in zip(axes[:, 0], ("position error, mm", "attitude error, deg", "NEES, mean"), strict=True):
        place.axvspan(4, 10, color="#eeeeee", zorder=0)
        place.set_xlim(30.5, 0.5)
        place.set_ylabel(label)
    axes[2, 0].set_xlabel("distance of the docking points, m (grey: the backup camera is dark)")
    axes[0, 0].set_title(f"{len(flown)} approaches on the filter's own estimate")
    return page


def _span(values: Floats) -> tuple[float, float]:
    return float(values.min()), float(values.max())
