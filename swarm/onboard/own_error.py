"""Errors of the observers' own fixes in the filters of their targets: correlated from scan to scan, and accounted for.

An observer's own filter has the error o (12) and the covariance O. Between two updates of it,

    o <- M o + w,   M = O_after O_before^-1 F_o,   O_before = F_o O F_o^T + Q_o

for what its filter keeps of an error is (I - K H) = O_after O_before^-1. Its scans give the target's pose with the
error A o + n: A o is the same error in the next scan, for what M leaves of it. Schmidt's filter ("Application of
state-space methods to navigation problems", 1966) considers such errors without estimating them: beside the target's
covariance P, it keeps C = E[x o^T], x the error of the target's filter,

    predict   C <- F C M^T
    update    y = H x - (A o + n),   K = (P H^T - C A^T) S^-1,   C <- (I - K H) C + K A O

A filter that knows only y = H' x + noise of covariance R' takes the same step with

    H' = H - A C^T P^-1,   R' = A O A^T + R - A C^T P^-1 C A^T

the noise without what the target's own error says of it. The rates count: the rays are older than the epoch by tau, so
that A takes o's pose and tau times its rates.
"""

from collections.abc import Sequence

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.filter.error_state import POSE_COLUMNS, RATE_COLUMNS, STATES, process_noise_into, transition_into

GREW = 1.5
"""An own covariance that is so much larger than predicted, in any direction, is that of a filter that started anew."""


class OwnErrors:
    """The correlations between the filters of the targets, by row, and the errors of the observers' own fixes."""

    def __init__(self, pairs: Sequence[tuple[int, int]], acceleration_m_s2: float, turning_rad_s2: float) -> None:
        """Take the pairs (row, observer) that meet, and the process noise of the observers' own filters.

        Args:
            pairs: rows of the filter bank, each with an observer that updates it.
            acceleration_m_s2: white acceleration per axis [m/s^2].
            turning_rad_s2: white angular acceleration per axis [rad/s^2].
        """
        self._correlation = {pair: np.zeros((STATES, STATES)) for pair in pairs}
        self._own: dict[int, Floats] = {}
        self._noise = acceleration_m_s2, turning_rad_s2

    def predict(self, dt: float, transition: Floats, own: dict[int, tuple[Floats, Floats]]) -> None:
        """Move all correlations on by one period.

        Args:
            dt: length of the period [s].
            transition: (R, 12, 12), F of the rows; NaN where a filter is not active.
            own: per observer, its angular rate (3,) [rad/s] and its covariance (12, 12) at the end of the period.
        """
        kept = {i: self._kept(i, dt, *state) for i, state in own.items()}
        self._own = {i: covariance for i, (_, covariance) in own.items()}
        for (row, i), correlation in self._correlation.items():
            known = np.isfinite(transition[row]).all()
            self._correlation[row, i] = transition[row] @ correlation @ kept[i].T if known else 0.0 * correlation

    def _kept(self, i: int, dt: float, rate: Floats, after: Floats) -> Floats:
        """Return M (12, 12) of one observer: zero where its filter has started anew, or is not known."""
        last = self._own.get(i)
        if last is None or not (np.isfinite(last).all() and np.isfinite(after).all()):
            return np.zeros((STATES, STATES))
        own, noise = np.empty((STATES, STATES)), np.empty((STATES, STATES))
        transition_into(rate, dt, own)
        process_noise_into(dt, *self._noise, noise)
        before = own @ last @ own.T + noise
        share = np.linalg.solve(before, after).T
        if np.abs(np.linalg.eigvals(share)).max() > GREW:
            return np.zeros((STATES, STATES))
        out: Floats = share @ own
        return out

    def restart(self, row: int, i: int, a: Floats, own: Floats) -> None:
        """Let a row start from the pose of one observer's scan.

        Args:
            row: of the filter bank.
            i: the observer.
            a: (6, 12), A.
            own: (12, 12), O.
        """
        for pair in self._correlation:
            if pair[0] == row:
                self._correlation[pair] = np.zeros((STATES, STATES))
        self._correlation[row, i][POSE_COLUMNS] = a @ own

    def decorrelated(
        self, row: int, i: int, covariance: Floats, h: Floats, a: Floats, noise: Floats
    ) -> tuple[Floats, Floats]:
        """Return H' (6, 12) and R' (6, 6) of a scan.

        Args:
            row: of the filter bank.
            i: the observer.
            covariance: (12, 12), P of the row.
            h: (6, 12), H.
            a: (6, 12), A.
            noise: (6, 6), A O A^T + R.
        """
        shared = self._correlation[row, i] @ a.T
        known = np.linalg.solve(covariance, shared).T
        left = noise - known @ shared
        return h - known, (left + left.T) / 2

    def update(self, row: int, i: int, gain: Floats, h: Floats, a: Floats, own: Floats) -> None:
        """Take in that a row was updated by a scan.

        Args:
            row: of the filter bank.
            i: the observer.
            gain: (12, 6), K.
            h: (6, 12), H.
            a: (6, 12), A.
            own: (12, 12), O.
        """
        left = np.eye(STATES) - gain @ h
        for pair in self._correlation:
            if pair[0] == row:
                self._correlation[pair] = left @ self._correlation[pair]
        self._correlation[row, i] += gain @ a @ own


def own_part(arm: Floats, age_s: float) -> Floats:
    """Return A (6, 12): what an observer's own error makes of the pose that its scan gives.

    Args:
        arm: (3,) [m], from the observer to the target, lighthouse frame.
        age_s: time of the rays relative to the epoch [s], negative.
    """
    pose = np.eye(6)
    pose[3:, :3] = -rot.skew(arm)
    out = np.zeros((6, STATES))
    out[:, POSE_COLUMNS], out[:, RATE_COLUMNS] = pose, age_s * pose
    return out
