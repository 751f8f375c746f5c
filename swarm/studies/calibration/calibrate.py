"""Calibrate a lighthouse and craft from a survey: a run that wrote its angles, or a recording of a real station.

    angles and poses of a survey -> every fifth second aside -> bundle adjustment (estimators.calibration.solve)
    -> the poses of those seconds solved with what it found: is noise all that is left?

Poses "truth": the telemetry's true poses and rates, as motion capture would give them in the lighthouse's own frame.
Poses "own": each craft's own PnP poses are where every pose starts, and its rates are straight lines through them
(`estimators.calibration.pose_rates`); all is done twice, the second time from poses and rates that the first
calibration gives.
"""

import time
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.calibration.check import Fit, Sightings, solve_poses
from estimators.calibration.model import fan_errors, linear_fans
from estimators.calibration.pose_rates import pose_rates
from estimators.calibration.problem import Survey
from estimators.calibration.solve import Calibration, Unobservable, calibrate
from swarm.errors import SwarmError
from swarm.flight.recordings.station_calibration import StationCalibration
from swarm.studies.calibration.survey import Observations

Poses = Literal["truth", "own"]
HELD_OUT_EVERY = 5
"""One second of so many is not used, but kept to check."""

Pose = tuple[Floats, Floats]
"""R_l_b (N, 3, 3) and position (N, 3) [m]; or their rates, (N, 3) [rad/s] and (N, 3) [m/s]."""


class Calibrated(NamedTuple):
    """A calibration and what it was made of.

    points: per craft, its rows of `result.point_m`. before, after: fit of the poses of held-out seconds with what was
    believed and with what was found. poses: number used. wall_s: time it took.
    """

    seen: Observations
    how: Poses
    result: Calibration
    points: tuple[slice, ...]
    before: Fit
    after: Fit
    poses: int
    wall_s: float

    def station(self) -> StationCalibration:
        """Return what a calibration file holds; craft of which no photodiode was placed are left out."""
        fan_x, fan_y = fan_errors(self.result.fans)
        by_name = {
            name: self.result.point_m[points]
            for name, points in zip(self.seen.believed.craft, self.points, strict=True)
            if self.result.placed[points].any()
        }
        return StationCalibration(fan_x, fan_y, by_name=by_name)


def calibrate_survey(seen: Observations, how: Poses | None = None, hold: Sequence[str] = ()) -> Calibrated:
    """Calibrate from a survey.

    Args:
        seen: What the craft of the survey saw.
        how: Go by the poses "truth" or "own"; default: the truth where there is one.
        hold: Parts that stay as they are believed to be, of `estimators.calibration.problem.PARTS`.

    Raises:
        SwarmError: The survey does not suffice.
    """
    began = time.perf_counter()
    how = how or ("own" if seen.truth is None else "truth")
    if how == "truth" and seen.truth is None:
        raise SwarmError(f"{seen.source} has no true poses: --poses own")
    known = how == "truth"
    pose, rates = (seen.truth, seen.true_rates) if known else (seen.own, None)
    assert pose is not None
    rates = rates or line_rates(seen, pose)
    believed, drawn = linear_fans(seen.believed.fans), np.concatenate(seen.believed.point_m)
    checked = held_out(seen)
    before = fit(seen, believed, drawn, pose, rates, checked)
    fans = believed
    try:
        for again in (False,) if known else (True, False):
            survey = to_survey(seen, fans, drawn, pose, rates, ~checked)
            result = calibrate(survey, seen.believed.noise, poses_known=known, hold=hold)
            if again:
                fans = result.fans
                # In the first calibration's own terms: the poses that it found, and the rates between them.
                solved = fit(seen, fans, result.point_m, pose, rates, np.ones_like(checked)).pose
                pose = solved.rotation, solved.position
                rates = line_rates(seen, pose)
    except Unobservable as poor:
        raise SwarmError(f"{seen.source}: {poor}. {_advice(seen, hold, how)}") from None
    after = fit(seen, result.fans, result.point_m, pose, rates, checked)
    return Calibrated(
        seen,
        how,
        result,
        _slices(seen),
        before,
        after,
        len(np.unique(survey.pose[result.used])),
        time.perf_counter() - began,
    )


def held_out(seen: Observations) -> Bools:
    """Return the mask (N,) of the rows that are kept to check."""
    first = seen.time_s[0] if len(seen.time_s) else 0.0
    out: Bools = np.floor(seen.time_s - first).astype(np.int64) % HELD_OUT_EVERY == HELD_OUT_EVERY // 2
    return out


def line_rates(seen: Observations, pose: Pose) -> Pose:
    """Return angular rates and velocities of every row, from the poses of its craft."""
    rate, velocity = np.full((2, len(seen.time_s), 3), np.nan)
    for craft in np.unique(seen.craft):
        mine = seen.craft == craft
        rate[mine], velocity[mine] = pose_rates(seen.time_s[mine], pose[0][mine], pose[1][mine])
    return rate, velocity


def to_survey(seen: Observations, fans: Floats, point_m: Floats, pose: Pose, rates: Pose, take: Bools) -> Survey:
    """Return the survey of some rows: those with a pose and rates, and the photodiodes that both fans hit.

    Args:
        seen: What the craft saw, N rows.
        fans: Believed errors of the fans.
        point_m: Believed places of the photodiodes, all craft's, one after the other [m].
        pose: Pose of every row.
        rates: Rates of every row.
        take: Rows to take (N,).
    """
    complete: Bools = np.isfinite(pose[1].sum(axis=1) + rates[1].sum(axis=1)) & take
    rows = np.flatnonzero(complete)
    lit: Bools = np.isfinite(seen.theta[rows].sum(axis=2))
    place, k = np.nonzero(lit)
    place, k, fan = np.repeat(place, 2), np.repeat(k, 2), np.tile([0, 1], len(place))
    begins = np.array([points.start for points in _slices(seen)], dtype=np.int64)
    owner = np.repeat(np.arange(len(begins)), [len(p) for p in seen.believed.point_m])
    return Survey(
        theta=seen.theta[rows][place, k, fan],
        fan=fan,
        photodiode=begins[seen.craft[rows][place]] + k,
        pose=place,
        offset_s=seen.offset_s[rows][place, k, fan],
        rotation=pose[0][rows],
        position=pose[1][rows],
        angular_rate=rates[0][rows],
        velocity=rates[1][rows],
        craft=seen.craft[rows],
        period=seen.period[rows],
        point_m=point_m,
        owner=owner,
        fans=fans,
    )


def fit(seen: Observations, fans: Floats, point_m: Floats, pose: Pose, rates: Pose, take: Bools) -> Fit:
    """Solve the poses of some rows from their angles. A photodiode that no craft has is NaN, and so never lit.

    Args:
        seen: What the craft saw, N rows.
        fans: Errors of the fans.
        point_m: Places of the photodiodes, all craft's, one after the other [m].
        pose: Pose of every row, to start from.
        rates: Rates of every row.
        take: Rows to take (N,).
    """
    padded = np.zeros((len(seen.believed.craft), seen.theta.shape[1], 3))
    for i, points in enumerate(_slices(seen)):
        padded[i, : points.stop - points.start] = point_m[points]
    lit: Bools = np.isfinite(seen.theta.sum(axis=2))
    sightings = Sightings(
        seen.theta[take], lit[take], np.where(lit[..., None], seen.offset_s, 0.0)[take], rates[0][take], rates[1][take]
    )
    return solve_poses(sightings, fans, padded[seen.craft[take]], pose[0][take], pose[1][take], seen.believed.noise)


def _slices(seen: Observations) -> tuple[slice, ...]:
    ends = np.cumsum([len(p) for p in seen.believed.point_m]).tolist()
    return tuple(slice(end - len(p), end) for end, p in zip(ends, seen.believed.point_m, strict=True))


def _advice(seen: Observations, hold: Sequence[str], how: Poses) -> str:
    ways = ["Survey anew: move and turn the craft through the whole field, near and far"]
    parts = [part for part in ("curve", "gibbous", "photodiodes") if part not in hold]
    if parts and not {"phase", "tilt"} <= set(hold):
        ways.append(f"leave parts as they are believed to be (--hold {','.join([*hold, *parts])})")
    if how == "own" and seen.truth is not None:
        ways.append("go by the known poses (--poses truth)")
    return "; or ".join(ways)
