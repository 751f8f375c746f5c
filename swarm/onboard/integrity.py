"""How far a craft trusts its own pose: the residual test, false photodiodes dropped, protection levels, the alert.

Per lighthouse period, after PnP:

- the residuals are tested (`estimators.integrity`); a pose that fails is solved again without the fewest photodiodes
  that make the others agree, or is not believed at all;
- a protection level bounds the error of what passed: with K the normal quantile of the integrity risk,

      PL = K s PDOP + slope sqrt(L) sqrt(1 - rho) s     of this period's pose, likewise with ADOP for the attitude
      PL = K sqrt(tr P) + the same second term          of the filter's estimate, P its position's or attitude's

  The first term is the noise: for every Gaussian of covariance P, P(|e| > K sqrt(tr P)) is no more than the two-sided
  tail of one normal variable beyond K, for any K above 1.24 (Szekely and Bakirov, Probab. Theory Relat. Fields 126,
  2003). The second one is the fault: one false photodiode that the residual test has missed (`estimators.slope`), L
  being the noncentrality that it misses with the probability `missed_detection`. A filter that coasts keeps the second
  term of the last pose that it took in. Where its gate refuses a pose, one of the two is wrong: the filter's level then
  reaches as far beyond the pose as the pose's own level.
- the alert is raised where the filter's level passes its limit, or there is no estimate to have one.

The rotor's speed is watched on the way: flashes come once per turn, and a turn that is too long or short by the craft's
own clock turned the fans slower or faster through their angles, theta = w (t - t_0) (1), by the same share.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from estimators.arrays import Bools, Floats, Ints
from estimators.dop import Dilution
from estimators.integrity import (
    AngleNoise,
    Sweeps,
    consistent_subset,
    noncentralities,
    statistic,
    thresholds,
)
from estimators.pnp import PoseSolution
from estimators.rotation import angle_between
from swarm.onboard.decoder import SweepAngles

LARGEST_SPEED_ERROR = 1e-3
"""A turn that is off by more is a mistaken flash, not a rotor."""


@dataclass(frozen=True)
class IntegritySettings:
    """In SI units. residual_test: False lets every fit pass, where the noise does not account for all errors.

    false_alarm, missed_detection: of the residual test, per pose. risk: of an error beyond its protection level, per
    estimate. rounding_rad: of a sweep to a tick, 1 sigma, beside the angle noise. alert_position_m, alert_attitude_rad:
    limits of the filter's protection levels; infinite for none. tick_s, speed_tolerance: of the clock, and the error of
    a turn's length, as a share, that is taken for the clock's; None: the rotor's speed is not watched.
    """

    residual_test: bool = True
    false_alarm: float = 1e-7
    missed_detection: float = 1e-4
    risk: float = 1e-7
    rounding_rad: float = 0.0
    alert_position_m: float = np.inf
    alert_attitude_rad: float = np.inf
    tick_s: float | None = None
    speed_tolerance: float = 20e-6


class Integrity(NamedTuple):
    """What C craft make of their own pose, each (C,).

    dropped: photodiodes left out as false; -1: the residuals failed and no subset agreed. pnp_position_m,
    pnp_attitude_deg: protection levels of this period's pose, NaN without one. position_m, attitude_deg: of the
    filter's estimate, NaN without one. alert: one of those has passed its limit; watched: whether there is any.
    """

    dropped: Ints
    pnp_position_m: Floats
    pnp_attitude_deg: Floats
    position_m: Floats
    attitude_deg: Floats
    alert: Bools
    watched: bool


class Screened(NamedTuple):
    """PnP's answer after the test: the poses, the photodiodes (C, K) that they are from, how many were dropped (C,)."""

    solution: PoseSolution
    lit: Bools
    dropped: Ints


class Filtered(NamedTuple):
    """What became of the poses in the filters: by_lighthouse (C,), whose filter took this period's in; refused (C,), of
    the gate; active (C,), who has a filter; its rotation (C, 3, 3), position (C, 3) [m], covariance (C, 12, 12).
    """

    by_lighthouse: Bools
    refused: Bools
    active: Bools
    rotation: Floats
    position: Floats
    covariance: Floats


class Monitor:
    """The integrity of C craft, each by itself: nothing in here mixes rows of the craft axis."""

    def __init__(
        self, settings: IntegritySettings, angle_noise_rad: float, rotor_correlation: float, shape: tuple[int, int]
    ) -> None:
        """Settings of the navigation: s and rho of (18), (19); shape (C, K)."""
        craft, most = shape
        self.settings = settings
        self._sigma_rad = angle_noise_rad
        own = float(np.hypot(angle_noise_rad * np.sqrt(1 - rotor_correlation), settings.rounding_rad))
        self._noise = AngleNoise(own, angle_noise_rad * float(np.sqrt(rotor_correlation)))
        self._threshold = thresholds(most, settings.false_alarm)
        self._missed = np.sqrt(noncentralities(self._threshold, settings.missed_detection))
        self._quantile = -float(ndtri(settings.risk / 2))
        self._held = np.zeros((2, craft))
        self._turn = RotorWatch(craft)

    def forget(self, mask: Bools) -> None:
        """Forget what these craft (C,) have held."""
        self._held[:, mask] = 0.0
        self._turn.forget(mask)

    def speed(self, angles: SweepAngles, frame_s: float) -> Floats | None:
        """Each craft's rotor speed (C,) against the nominal one, from its flashes; None where all keep to it."""
        s = self.settings
        return None if s.tick_s is None else self._turn.speed(angles, frame_s / s.tick_s, s.speed_tolerance)

    def screen(
        self,
        sweeps: Sweeps,
        asked: Bools,
        solution: PoseSolution,
        start: tuple[Floats, Floats],
        rate_covariance: Callable[[int], Floats],
    ) -> Screened:
        """Test the poses of the craft `asked` (C,), which were solved from `start`: rotation and position.

        rate_covariance: of the rates that they assumed, (6, 6), asked for only of craft whose pose is in doubt.
        """
        lit, dropped = sweeps.lit & asked[:, None], np.zeros(len(asked), dtype=np.int64)
        if not self.settings.residual_test:
            return Screened(solution, lit, dropped)
        limit = self._threshold[np.count_nonzero(lit, axis=1)]
        with np.errstate(invalid="ignore"):
            sound = solution.solved & (solution.cost <= limit * self._noise.own_rad**2)
        doubtful = np.flatnonzero(asked & ~sound)
        if not len(doubtful):
            return Screened(solution, lit, dropped)
        parts = PoseSolution._make(part.copy() for part in solution)
        covariance = np.array([rate_covariance(int(c)) for c in doubtful])
        some = sweeps.of(doubtful)._replace(lit=lit[doubtful])
        value = statistic(some, parts.rotation[doubtful], parts.position[doubtful], self._noise, covariance)
        for i, c in enumerate(doubtful):
            if parts.solved[c] and value[i] <= limit[c]:
                continue
            one = some.of(np.array([i]))
            found = consistent_subset(one, start[0][c], start[1][c], self._noise, covariance[i], self._threshold)
            if found is None:
                parts.solved[c], dropped[c] = False, -1
                continue
            dropped[c] = np.count_nonzero(lit[c]) - np.count_nonzero(found.lit)
            lit[c] = found.lit
            for part, own in zip(parts, found.solution, strict=True):
                part[c] = own[0]
        return Screened(parts, lit, dropped)

    def levels(self, screened: Screened, precision: Dilution, filtered: Filtered) -> Integrity:
        """Protection levels of this period's poses, and of the filters after them."""
        s, missed = self.settings, self._missed[np.count_nonzero(screened.lit, axis=1)]
        noise = self._quantile * self._sigma_rad * np.stack([precision.pdop_m_per_rad, precision.adop_deg_per_rad])
        slope = np.stack([precision.position_slope_m_per_rad, precision.attitude_slope_deg_per_rad])
        fault = slope * (missed * self._noise.own_rad) if s.residual_test else np.zeros_like(slope)
        single = noise + fault
        self._held = np.where(filtered.by_lighthouse, fault, np.where(filtered.active, self._held, 0.0))
        variance = np.diagonal(filtered.covariance, axis1=1, axis2=2)
        sigma = np.sqrt(np.stack([variance[:, 6:9].sum(axis=1), variance[:, :3].sum(axis=1)]))
        sigma[1] = np.rad2deg(sigma[1])
        level = self._quantile * sigma + self._held
        if filtered.refused.any():
            at, pose = np.flatnonzero(filtered.refused), screened.solution
            distance = np.linalg.norm(pose.position[at] - filtered.position[at], axis=1)
            angle = np.rad2deg(angle_between(pose.rotation[at], filtered.rotation[at]))
            level[:, at] = np.fmax(level[:, at], np.stack([distance, angle]) + single[:, at])
        limits = np.array([[s.alert_position_m], [np.rad2deg(s.alert_attitude_rad)]])
        watched = np.isfinite(limits)
        with np.errstate(invalid="ignore"):
            alert = np.any(watched & ~(level <= limits), axis=0)
        return Integrity(screened.dropped, single[0], single[1], level[0], level[1], alert, bool(watched.any()))


class RotorWatch:
    """The rotor's speed from the flashes of C craft, by each one's own clock."""

    def __init__(self, craft: int) -> None:
        self._last = np.full(craft, -1, dtype=np.int64)
        self._speed = np.ones(craft)

    def forget(self, mask: Bools) -> None:
        """Forget the flashes of these craft (C,)."""
        self._last[mask], self._speed[mask] = -1, 1.0

    def speed(self, angles: SweepAngles, turn_tick: float, tolerance: float) -> Floats | None:
        """Speed (C,) against the nominal one of a turn of `turn_tick` ticks; None where nobody's is off.

        A turn between two flashes that were seen is a measurement; without one, the last one stands.
        """
        seen = (angles.epoch_tick >= 0) & (angles.missed_sync == 0)
        turn = np.where(seen & (self._last >= 0), angles.epoch_tick - self._last, turn_tick)
        off = np.abs(turn / turn_tick - 1)
        measured = seen & (self._last >= 0) & (off < LARGEST_SPEED_ERROR)
        self._last = np.where(seen, angles.epoch_tick, -1)
        self._speed = np.where(measured, np.where(off > tolerance, turn_tick / turn, 1.0), self._speed)
        return self._speed if np.any(self._speed != 1.0) else None
