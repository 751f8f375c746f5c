"""A central solver in place of the craft's own computers: its time, its precision, its bytes on the air.

Every 15th period, the poses of all craft that track are solved once more in one least squares with the rotor errors as
unknowns (`estimators.lighthouse.central`), from the same angles and from the same predicted poses as the craft used.
Errors are against the truth, for both over the same craft and periods. The time of a craft's own solution, PnP and
dilution, is that of one craft alone.

Bytes on the air of the central scheme: 4 for every angle that a craft sends down, 28 for the pose (position and
quaternion in single precision) that it gets back. On its own a craft sends and receives nothing but the light.
"""

from typing import Any, NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse import central
from estimators.lighthouse.dop import dilution
from estimators.lighthouse.pnp import refine
from estimators.lighthouse.sweep import correct
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.hardware import Photodiodes
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.navigation import Estimate
from swarm.onboard.settings import Status
from swarm.results.period import Period
from swarm.results.records import Truth
from swarm.scenario import Scenario
from swarm.studies.campaign.processor_time import fastest, median_us

EVERY = 15
ANGLE_BYTES, POSE_BYTES = 4, 28


class _Problem(NamedTuple):
    """A pose problem as the craft had it: angles, lit, layout, start, instants, rates; mask: who takes part."""

    theta: Floats
    lit: Bools
    point_m: Floats
    rotation: Floats
    position: Floats
    offset_s: Floats
    angular_rate: Floats
    velocity: Floats
    mask: Bools


class CentralCost:
    """Solves sampled periods centrally, beside the craft's own solutions."""

    def __init__(self, scenario: Scenario, photodiodes: Photodiodes) -> None:
        """Prepare for a flight of `scenario`; photodiodes: as the craft believe them to be."""
        if scenario.station:
            raise SwarmError(f"scenario {scenario.name}: the central solver has the angles of the one lighthouse only")
        self._point_m = photodiodes.point_m
        self._settings = builders.navigation(scenario)
        self._rate_hz = scenario.lighthouse.rate_hz
        self._before: Estimate | None = None
        self._times: list[tuple[float, float]] = []
        self._sums: list[Floats] = []
        self._counts: list[tuple[int, int, int]] = []

    def period(self, period: Period) -> None:
        """Remember what the craft know, and solve every 15th period centrally."""
        if period.frame % EVERY == EVERY - 1 and self._before is not None and period.truth is not None:
            self._compare(self._problem(period.angles, self._before, period.estimate), period.truth, period.estimate)
        self._before = period.estimate

    def _compare(self, problem: _Problem, truth: Truth, estimate: Estimate) -> None:
        """Solve centrally, and by one craft alone; add up errors and times."""
        rho = self._settings.rotor_correlation
        if not problem.mask.any() or rho >= 1:
            return
        answer, central_s = fastest(lambda: _together(problem, rho))
        _, own_s = fastest(lambda: _alone(problem, rho, int(np.flatnonzero(problem.mask)[0])))
        took = answer.solved & estimate.pnp.solved
        if not took.any():
            return
        self._times.append((central_s, own_s))
        self._counts.append((int(took.sum()), answer.iterations, int(np.count_nonzero(problem.lit[took]))))
        own_covariance = estimate.dilution.covariance[took]
        true = rot.matrix_from_quaternion(truth.quaternion[took])
        squares = [
            np.sum((truth.position[took] - answer.position[took]) ** 2, axis=1),
            np.sum((truth.position[took] - estimate.pnp.position[took]) ** 2, axis=1),
            rot.angle_between(answer.rotation[took], true) ** 2,
            rot.angle_between(estimate.pnp.rotation[took], true) ** 2,
            *(
                np.trace(covariance[:, part, part], axis1=1, axis2=2)
                for part in (slice(3, 6), slice(0, 3))
                for covariance in (answer.covariance[took], own_covariance, answer.covariance_rotor_known[took])
            ),
            np.full(int(took.sum()), 1 - np.trace(answer.rotor_covariance) / (2 * rho) if rho > 0 else 0.0),
        ]
        self._sums.append(np.array([part.sum() for part in squares]))

    def _problem(self, angles: SweepAngles, before: Estimate, estimate: Estimate) -> _Problem:
        settings = self._settings
        theta = correct(angles.theta, (settings.fan_x, settings.fan_y))
        tracked = (before.status == Status.TRACKING) & estimate.pnp.solved & np.isfinite(before.position).all(axis=1)
        moves = tracked[:, None] & np.full((1, 1), settings.motion_compensation)
        turn = rot.exp(np.nan_to_num(before.angular_rate) * settings.frame_s)
        return _Problem(
            theta,
            angles.lit & np.isfinite(theta).all(axis=-1),
            self._point_m,
            turn @ before.rotation,
            before.position + before.velocity * settings.frame_s,
            angles.offset_s,
            np.where(moves, before.angular_rate, 0.0),
            np.where(moves, before.velocity, 0.0),
            tracked,
        )

    def metrics(self) -> dict[str, Any]:
        """Return the figures; nothing where no period was solved."""
        if not self._sums:
            return {}
        central_s, own_s = zip(*self._times, strict=True)
        craft, iterations, lit = np.mean(np.array(self._counts, dtype=np.float64), axis=0)
        total = np.array(self._sums).sum(axis=0) / sum(count[0] for count in self._counts)
        rms = np.sqrt(total[:10])
        return {
            "central_solve_us": median_us(central_s),
            "own_solve_us": median_us(own_s),
            "central_craft": float(craft),
            "central_iterations": float(iterations),
            "central_air_bytes_per_s": float((2 * lit * ANGLE_BYTES + craft * POSE_BYTES) * self._rate_hz),
            "own_air_bytes_per_s": 0.0,
            "central_position_rms_m": float(rms[0]),
            "own_position_rms_m": float(rms[1]),
            "central_attitude_rms_deg": float(np.degrees(rms[2])),
            "own_attitude_rms_deg": float(np.degrees(rms[3])),
            "central_position_gain_share": float(1 - rms[4] / rms[5]),
            "rotor_known_position_gain_share": float(1 - rms[6] / rms[5]),
            "central_attitude_gain_share": float(1 - rms[7] / rms[8]),
            "rotor_known_attitude_gain_share": float(1 - rms[9] / rms[8]),
            "rotor_variance_found_share": float(total[10]),
        }


def _together(p: _Problem, rho: float) -> central.CentralSolution:
    """Solve the poses of all craft that take part."""
    return central.solve(
        p.theta, p.lit, p.point_m, p.rotation, p.position, p.offset_s, p.angular_rate, p.velocity, rho, p.mask
    )


def _alone(p: _Problem, rho: float, craft: int) -> None:
    """Solve one craft's pose as its own computer does."""
    one = slice(craft, craft + 1)
    lit, point_m, offset_s = p.lit[one], p.point_m[one], p.offset_s[one]
    rate, velocity = p.angular_rate[one], p.velocity[one]
    solution = refine(p.theta[one], lit, point_m, p.rotation[one], p.position[one], offset_s, rate, velocity)
    dilution(solution.rotation, solution.position, lit, point_m, offset_s, rate, velocity, rho, solution.solved)
