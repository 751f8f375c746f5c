"""The posterior Cramer-Rao bound of the craft of a flight, and how far their filters are from it.

The information recursion of Tichavsky, Muravchik and Nehorai (IEEE Trans. Signal Process. 46, 1998), linear about the
truth, for craft that move as the table [navigation] has it, pushed at random:

    J' = (F J^-1 F^T + Q)^-1 + sum of H^T R^-1 H

over the rows of a period (`estimators.lighthouse.innovation`). Errors and bound are compared in the periods in which a
craft sees as many photodiodes as in the last one, after the first of them.
"""

from typing import Any

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.filter.error_state import STATES, process_noise_into, transition_into
from estimators.lighthouse.innovation import innovations, light_of, rows_of_sweeps
from estimators.lighthouse.rows import Station, packed
from estimators.lighthouse.sweep import lighthouse_1
from estimators.state import State
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.onboard.tracks import UNKNOWN_RATE
from swarm.results.period import Period
from swarm.results.records import Truth
from swarm.scenario import Scenario

UNKNOWN_POSE = (np.pi, 10.0)
"""Standard deviation per axis of a craft's pose before it has seen light: attitude [rad], position [m]."""


class PosteriorBound:
    """The information of the light of C craft, from one period to the next, and the errors of their estimates."""

    def __init__(self, scenario: Scenario, flight: Flight) -> None:
        """Begin with craft that know nothing.

        Raises:
            SwarmError: the scenario has several stations.
        """
        if scenario.station:
            raise SwarmError(f"scenario {scenario.name}: the bound is computed with the one lighthouse only")
        s = self._settings = builders.navigation(scenario)
        fans = lighthouse_1(s.fan_x, s.fan_y)
        self._light = light_of(packed([Station(s.station.rotation, s.station.position, fans)]), [s.noise])
        self._point_m = np.nan_to_num(flight.world.photodiodes.point_m)
        turn, place = UNKNOWN_POSE
        prior = np.repeat([turn, UNKNOWN_RATE[0], place, UNKNOWN_RATE[1]], 3)
        self._covariance = np.tile(np.diag(prior**2), (len(self._point_m), 1, 1))
        self._noise = np.zeros((STATES, STATES))
        process_noise_into(s.frame_s, s.acceleration_noise_m_s2, s.angular_acceleration_noise_rad_s2, self._noise)
        self._rate: Floats | None = None
        self._found: list[tuple[Floats, Floats]] = []

    def period(self, period: Period) -> None:
        """Add the light of one period, and compare the estimates of its end with the bound."""
        truth = period.truth
        if truth is None:
            return
        self._move()
        self._rate = truth.angular_rate
        self._see(period, truth)
        error = rot.angle_between(rot.matrix_from_quaternion(truth.quaternion), period.estimate.rotation)
        away = np.linalg.norm(truth.position - period.estimate.position, axis=1)
        p = self._covariance
        bound = [np.trace(p[:, part, part], axis1=1, axis2=2) for part in (slice(0, 3), slice(6, 9))]
        lit = np.count_nonzero(period.angles.lit, axis=1)
        self._found.append((np.array([error**2, away**2, *bound]), lit.astype(np.float64)))

    def _move(self) -> None:
        """Move the covariances on by one period, at the true rates."""
        if self._rate is None:
            return
        f = np.zeros((STATES, STATES))
        for c, rate in enumerate(self._rate):
            transition_into(rate, self._settings.frame_s, f)
            self._covariance[c] = f @ self._covariance[c] @ f.T + self._noise

    def _see(self, period: Period, truth: Truth) -> None:
        """Take in the rows of one period, linear about the truth."""
        theta, every = period.angles.theta, np.ones(len(self._point_m), dtype=np.bool_)
        rows = rows_of_sweeps(theta, period.angles.offset_s)
        kept: Bools = np.ones(len(rows.angle), dtype=np.bool_)
        state = State(
            rotation=rot.matrix_from_quaternion(truth.quaternion),
            position=truth.position,
            velocity=truth.velocity,
            angular_rate=truth.angular_rate,
        )
        found = innovations(rows, kept, every, self._light, self._point_m, state)
        for c, n in enumerate(found.number):
            if n:
                h, p = found.h[c, :n], self._covariance[c]
                gain = np.linalg.solve(np.eye(n) + h @ p @ h.T, h @ p)
                self._covariance[c] = p - p @ h.T @ gain

    def metrics(self) -> dict[str, Any]:
        """Return the bound, and RMS errors over it: of what craft know, in the periods of as many lit as at the end."""
        names = ("bound_attitude_deg", "bound_position_m", "attitude_over_bound", "position_over_bound")
        if not self._found:
            return dict.fromkeys(("bound_lit", *names))
        values, lit = (np.stack(part) for part in zip(*self._found, strict=True))
        # The first of these periods still has what was known before.
        same = (lit == lit[-1]) & np.isfinite(values).all(axis=1)
        same[1:] &= lit[:-1] == lit[1:]
        if not same.any():
            return dict.fromkeys(("bound_lit", *names))
        turned, away, attitude, position = (float(np.sqrt(part[same].mean())) for part in np.moveaxis(values, 1, 0))
        figures = float(np.degrees(attitude)), position, turned / attitude, away / position
        return {"bound_lit": float(lit[-1].mean())} | dict(zip(names, figures, strict=True))
