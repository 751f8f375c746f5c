"""Errors of what a craft takes for granted, the stations' places and fans and its own photodiodes', in its covariances.

A survey tells where stations stand with a standard deviation, fans keep some error after their calibration, and
photodiodes are where they are made to be within a tenth of a millimetre. What photodiodes of a sweep disagree by beside
that, at grazing light, stays as long as the object looks the same way: some tenths of a second, in which a single
station tells the distance. These errors q are taken as constant: a filter that takes thousands of rows in believes them
away, but not off. With y = H e + D q + noise, and a filter that does not know
of q (S. F. Schmidt's considered errors, `estimators.relative.cross`),

    e = e' - S q,    S <- (I - K H) F S + K D,    K = P H^T R^-1,    covariance = P + S V S^T

and S = P H^T R^-1 D for a state that was solved from rows. For a photodiode at x, u the derivative of its angle by x,

    D = [ -((x - t_s) x u)^T, -u^T ]    of the turn of its station s and of t_s
    D = 1                               of its fan's phase
    D = u^T R / cos i                   of its place on the body, lit at i from its normal
    D = 1 / cos^2 i                     of its own angle by its fan

At grazing light the middle of a pulse is not the photodiode's, but what its rim and glass leave of it. In recordings of
a Crazyflie, one of each generation, what photodiodes of a sweep disagree by is 40 to 70 urad within 50 degrees, 110 to
155 urad at 65 and 150 to 180 urad at 75; what one in ten exceeds is 90 to 270 urad there, and 440 to 690 at 65.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank
from estimators.lighthouse.innovation import RowBatch, noise_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import Rows, Station, linearise, packed
from estimators.state import STATES, State
from swarm.hardware import Photodiodes

POSE, FANS = 6, 2
GRAZING = 0.1
"""Least cosine of the incidence that counts: beyond, a photodiode sees next to nothing."""


@dataclass(frozen=True)
class PlaceSigma:
    """Standard deviations of the stations' and photodiodes' places.

    pose: (S, 6, 6), covariance of each station's turn about the world's axes and place [rad, m]. phase_rad: (S,),
    standard deviation of a fan's zero. place_m: of each coordinate of a photodiode on the body. lasting_rad: (S,), of
    an angle of one photodiode by one fan, which lasts while the object hardly turns.
    """

    pose: Floats
    phase_rad: Floats
    place_m: float
    lasting_rad: Floats

    def covariance(self, photodiodes: int) -> Floats:
        """Return V (Q, Q): of each station's pose, then of each one's fans, of each photodiode, and of each angle."""
        stations = len(self.pose)
        first, second = POSE * stations, (POSE + FANS) * stations
        third = second + 3 * photodiodes
        size = third + FANS * stations * photodiodes
        out = np.zeros((size, size))
        for s in range(stations):
            own = slice(POSE * s, POSE * s + POSE)
            out[own, own] = self.pose[s]
        fan, point, angle = np.arange(first, second), np.arange(second, third), np.arange(third, size)
        out[fan, fan] = np.repeat(np.square(self.phase_rad), FANS)
        out[point, point] = self.place_m**2
        out[angle, angle] = np.repeat(np.square(self.lasting_rad), FANS * photodiodes)
        return out


class PlaceErrors:
    """The considered errors of C craft: `begin` a period, `rows` or `started`, then `widened`."""

    def __init__(
        self,
        sigma: PlaceSigma | None,
        stations: Sequence[Station],
        noise: Sequence[AngleNoise],
        photodiodes: Photodiodes,
    ) -> None:
        """Begin with filters that have not been started.

        Args:
            sigma: how far things may be off; None: nothing is considered.
            stations: all stations.
            noise: noise of their rows.
            photodiodes: layouts, in the body frames.
        """
        point_m = np.ascontiguousarray(photodiodes.point_m)
        self._normal = photodiodes.normal
        self.wanted = sigma is not None
        self._stations, self._noise, self._point_m = packed(stations), list(noise), point_m
        self._variance = np.zeros((0, 0)) if sigma is None else sigma.covariance(point_m.shape[1])
        self._sensitivity = np.zeros((len(point_m), STATES, len(self._variance)))

    def begin(self, bank: FilterBank, frame_s: float) -> None:
        """Take along what the next prediction makes of the errors, before it is made."""
        if self.wanted:
            transition = np.where(bank.active[:, None, None], bank.transition(frame_s), 0.0)
            self._sensitivity = transition @ self._sensitivity

    def moved(self, coupling: Floats) -> None:
        """Take along what known motion beside the prediction makes of an error of the state, (C, 12, 12)."""
        if self.wanted:
            self._sensitivity = coupling @ self._sensitivity

    def updated(self, craft: int, gain: Floats, h: Floats) -> None:
        """Count in a measurement that no considered error is in.

        Args:
            craft: whose.
            gain: (12, n), of the filter's update.
            h: (n, 12), derivatives of the measurement by the state.
        """
        if self.wanted:
            self._sensitivity[craft] -= gain @ (h @ self._sensitivity[craft])

    def rows(self, rows: RowBatch, kept: Bools, fresh: Bools, before: tuple[State, Floats]) -> None:
        """Count in rows that the filters took in.

        The gain is that of the filter's update, at the prediction: with derivatives of another state, 1 - K H would
        be no contraction, and S grow without bounds.

        Args:
            rows: of all craft.
            kept: (N,), those that were used.
            fresh: (C,), craft whose filter took them in.
            before: the filters' states and covariances before that, (C, ...).
        """
        if not self.wanted:
            return
        for c in np.flatnonzero(fresh).tolist():
            own, p = rows.of(c, kept), before[1][c]
            h, d, noise = self._derivatives(c, own, before[0].of(c))
            gain = np.linalg.solve(h @ p @ h.T + noise, h @ p).T
            self._sensitivity[c] += gain @ (d - h @ self._sensitivity[c])

    def started(self, craft: int, rows: Rows, state: State, covariance: Floats) -> None:
        """Begin anew with the filter of a craft that starts with a state solved from rows.

        Args:
            craft: its index.
            rows: that the state was solved from.
            state: without the craft axis.
            covariance: (12, 12), likewise.
        """
        if self.wanted:
            h, d, noise = self._derivatives(craft, rows, state)
            self._sensitivity[craft] = covariance @ h.T @ np.linalg.solve(noise, d)

    def widened(self, covariance: Floats) -> Floats:
        """Return covariances (C, 12, 12) with the considered errors in them."""
        if not self.wanted:
            return covariance
        out: Floats = covariance + self._sensitivity @ self._variance @ np.swapaxes(self._sensitivity, 1, 2)
        return out

    def _derivatives(self, craft: int, rows: Rows, state: State) -> tuple[Floats, Floats, Floats]:
        """Return H (n, 12), D (n, Q) and R (n, n) of one craft's rows."""
        points, known = self._point_m[craft], self._stations
        _, h = linearise(rows, known, points, state.rotation, state.position, state.velocity, state.angular_rate)
        h = np.where(np.isfinite(h), h, 0.0)
        count, stations, every = len(rows.angle), len(known.first), np.arange(len(rows.angle))
        d, u = np.zeros((count, len(self._variance))), h[:, 6:9]
        away = state.position + rows.offset_s[:, None] * state.velocity + points[rows.photodiode] @ state.rotation.T
        away = away - known.position[rows.station]
        pose = -np.concatenate([np.cross(away, u), u], axis=1)
        d[every[:, None], POSE * rows.station[:, None] + np.arange(POSE)] = pose
        d[every, POSE * stations + FANS * rows.station + rows.fan] = 1.0
        towards = -away / np.linalg.norm(away, axis=1, keepdims=True)
        cosine = np.sum(towards * (self._normal[craft][rows.photodiode] @ state.rotation.T), axis=1)
        grazing = 1 / np.clip(cosine, GRAZING, 1.0)
        on_body = u @ state.rotation * grazing[:, None]
        d[every[:, None], (POSE + FANS) * stations + 3 * rows.photodiode[:, None] + np.arange(3)] = on_body
        stream = (FANS * rows.station + rows.fan) * len(points) + rows.photodiode
        d[every, (POSE + FANS) * stations + 3 * len(points) + stream] = grazing**2
        return h, d, noise_of(rows, self._noise)
