"""Source 2, section 2: when the backup camera fails, navigation falls back to one camera without a jump.

The scenario `ccd-docking`, flown with several seeds: 30 m to 1 m on the craft's own estimate, the backup camera dark
between 10 m and 4 m. At each switch, per axis of the pose,

    jump = |e_k - e_(k-1)| / sigma,    e = truth - estimate before and after, sigma the filter's own before it

and the mean NEES (6 degrees of freedom) over each stretch of the approach, against its 95 % chi-square band; the number
of independent values is that of `swarm.results.summary`. Of five stretches a consistent filter has one outside in 23 %
of the sets: the table says so where it happens.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.error_state import POSE_COLUMNS
from estimators.rotation import log, matrix_from_quaternion
from swarm import figures
from swarm.flight.flight import Flight
from swarm.onboard.ccd import CcdState
from swarm.results.summary import consistency
from swarm.scenario import Scenario, load
from swarm.studies.papers.experiment import Columns, Line, Outcome, Request, data, span, under

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

    @property
    def settled(self) -> Bools:
        """The periods (n,) in which the filter has a rate."""
        out: Bools = self.time_s > SETTLED_S
        return out

    def within(self, high: float, low: float) -> Bools:
        """Tell the periods (n,) at distances of at most `high` m and above `low` m.

        The first stretch begins at the start.
        """
        near = (self.distance_m <= high) | (high == STRETCHES_M[0][0])
        return near & (self.distance_m > low) & self.settled

    def switches(self, state: CcdState) -> Ints:
        """Return the periods in which another sensor came in, and left the craft in this state."""
        out: Ints = np.flatnonzero((np.diff(self.state) != 0) & (self.state[1:] == state)) + 1
        return out

    def jump(self, at: int) -> float:
        """Return the largest jump of an axis at period `at`, in sigmas."""
        return float(np.max(np.abs(self.error[at] - self.error[at - 1]) / self.sigma[at - 1]))


def run(request: Request) -> Outcome:
    """Fly the scenario with as many seeds as there are runs."""
    runs = request.sizes["runs"]
    flown = [_fly(request, i, load(SCENARIO, seed=request.seed + i)) for i in range(runs)]
    lines = [*_jumps(flown), *_consistency(flown), *_accuracy(flown)]
    accepted = np.concatenate([f.accepted for f in flown])
    lines += under("The gate", Line("poses taken in", "", None, float(accepted.mean())))
    return Outcome(lines, data(_columns(flown)), _draw(flown))


def _fly(request: Request, number: int, scenario: Scenario) -> Flown:
    flight, runs = Flight(scenario), request.sizes["runs"]
    count = round(scenario.duration_s / flight.period_s)
    time_s, distance, nees = np.empty((3, count))
    state, accepted = np.empty((2, count), dtype=np.int64)
    errors, sigmas = np.empty((2, count, 6))
    for frame in range(count):
        period = flight.period(frame)
        truth, estimate = period.truth, period.estimate
        assert truth is not None
        time_s[frame] = period.time_s
        covariance = estimate.covariance[CHASER][np.ix_(POSE_COLUMNS, POSE_COLUMNS)]
        turn = matrix_from_quaternion(truth.quaternion[CHASER]) @ estimate.rotation[CHASER].T
        error = np.concatenate([log(turn), truth.position[CHASER] - estimate.position[CHASER]])
        known = np.isfinite(error).all()
        nees[frame] = float(error @ np.linalg.solve(covariance, error)) if known else np.nan
        errors[frame], sigmas[frame] = error, np.sqrt(np.diagonal(covariance))
        assert estimate.ccd is not None
        distance[frame] = _gap(truth.position, truth.quaternion)
        state[frame], accepted[frame] = estimate.ccd.state[CHASER], estimate.sensor[CHASER] > 0
        if frame % 60 == 0:
            request.progress((number + frame / count) / runs, f"run {number + 1} of {runs}")
    return Flown(time_s, distance, state, nees, errors, sigmas, accepted)


def _gap(position: Floats, quaternion: Floats) -> float:
    """Return the distance of the docking points [m], the tips of the two booms, along the target's z axis."""
    chaser, target = matrix_from_quaternion(quaternion[[CHASER, TARGET]])
    tip = chaser @ np.array([0.0, 0.4, 1.5]) + position[CHASER]
    drogue = target @ np.array([0.0, 0.4, 1.3705]) + position[TARGET]
    return float((tip - drogue) @ target[:, 2])


def _jumps(flown: list[Flown]) -> list[Line]:
    lines, every = [], len(flown)
    for name, state in (("backup camera fails", CcdState.CAMERA), ("backup camera comes back", CcdState.STEREO)):
        at = [(f, k) for f in flown for k in f.switches(state)]
        lines += under(
            name,
            Line("switches", "", every, len(at), (every, every)),
            Line("distance", "m", None, span([f.distance_m[k] for f, k in at])),
            Line("largest jump of an axis", "sigma", "none", max(f.jump(k) for f, k in at), (None, MOST_SIGMA)),
        )
    return lines


def _consistency(flown: list[Flown]) -> list[Line]:
    lines = []
    for high, low in STRETCHES_M:
        inside = [f.within(high, low) for f in flown]
        frame = np.concatenate([np.flatnonzero(rows) for rows in inside])
        nees = np.concatenate([f.nees[rows] for f, rows in zip(flown, inside, strict=True)])
        found = consistency(frame, nees, float(flown[0].time_s[1] - flown[0].time_s[0]))
        assert found is not None
        independent = found["effective_samples"]
        low_band, high_band = 2 * gammaincinv(DOF / 2 * independent, OUTSIDE) / independent
        band = round(float(low_band), 2), round(float(high_band), 2)
        lines.append(Line(f"{high:g} m to {low:g} m", "", None, found["mean"], band))
    return under("NEES, mean (6 if consistent)", *lines)


def _accuracy(flown: list[Flown]) -> list[Line]:
    lines = []
    for high, low in STRETCHES_M:
        error = np.concatenate([f.error[f.within(high, low)] for f in flown])
        position, turn = (float(np.sqrt(np.mean(np.sum(e**2, axis=1)))) for e in (error[:, 3:], error[:, :3]))
        lines.append(Line(f"position, {high:g} m to {low:g} m", "mm", None, 1e3 * position))
        lines.append(Line(f"attitude, {high:g} m to {low:g} m", "deg", None, float(np.rad2deg(turn))))
    return under("EKF, RMS over the runs", *lines)


def _columns(flown: list[Flown]) -> Columns:
    columns: Columns = {
        "run": (np.repeat(np.arange(1, len(flown) + 1), [len(f.time_s) for f in flown]), "number of the run"),
        "time_s": (np.concatenate([f.time_s for f in flown]), "the epoch"),
        "distance_m": (np.concatenate([f.distance_m for f in flown]), "between the docking points"),
        "ccd": ([CcdState(s).name.lower() for f in flown for s in f.state], "what the images gave"),
        "nees": (np.concatenate([f.nees for f in flown]), "squared error over the filter's covariance"),
    }
    for name in ("error", "sigma"):
        values = np.concatenate([getattr(f, name) for f in flown])
        columns[f"{name}_*_m"] = values[:, 3:], f"{name} of the position, *"
        columns[f"{name}_*_deg"] = np.rad2deg(values[:, :3]), f"{name} of the attitude about *"
    return columns


def _draw(flown: list[Flown]) -> figures.Figure:
    page, axes = figures.page(3, 1, 6.0)
    for f in flown:
        settled = f.settled
        for place, part, scale in ((axes[0, 0], slice(3, 6), 1e3), (axes[1, 0], slice(0, 3), 180 / np.pi)):
            size = scale * np.linalg.norm(f.error[settled, part], axis=1)
            place.semilogy(f.distance_m[settled], size, "-", lw=0.4, alpha=0.6, color=figures.BLUE)
    first = flown[0]
    settled = first.settled
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
