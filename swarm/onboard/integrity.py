"""How far a craft trusts its own pose: the residual test, false photodiodes dropped, protection levels, the alert.

Per lighthouse period, after PnP:

- the residuals are tested (`estimators.lighthouse.integrity`); a pose that fails is solved again without the fewest
photodiodes
  that make the others agree, or is not believed at all;
- a protection level bounds the error of what passed: with K the normal quantile of the integrity risk,

      PL = K s PDOP + slope sqrt(L) sqrt(1 - rho) s     of this period's pose, likewise with ADOP for the attitude
      PL = K sqrt(tr P) + the same second term          of the filter's estimate, P its position's or attitude's

  The first term is the noise: for every Gaussian of covariance P, P(|e| > K sqrt(tr P)) is no more than the two-sided
  tail of one normal variable beyond K, for any K above 1.24 (Szekely and Bakirov, Probab. Theory Relat. Fields 126,
  2003). The second one is the fault: one false photodiode that the residual test has missed
  (`estimators.lighthouse.slope`), L being the noncentrality that it misses with the probability `missed_detection`. A
  filter that coasts keeps the second term of the last pose that it took in. Where its gate refuses a pose, one of the
  two is wrong: the filter's level then reaches as far beyond the pose as the pose's own level.
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
from estimators.kernel import kernel
from estimators.lighthouse.dop import Dilution
from estimators.lighthouse.integrity import (
    AngleNoise,
    Sweeps,
    consistent_subset,
    noncentralities,
    statistic,
    thresholds,
)
from estimators.lighthouse.pnp import PoseSolution
from estimators.rotation import angle_between
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.tracks import Filtered, Taken

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
    """PnP's answer after the test: the poses, the photodiodes (C, K) that they are from, their number and that of those
    that were dropped, (C,) each.
    """

    solution: PoseSolution
    lit: Bools
    used: Ints
    dropped: Ints


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
        count: Ints,
        solution: PoseSolution,
        start: tuple[Floats, Floats],
        rate_covariance: Callable[[int], Floats],
    ) -> Screened:
        """Test the poses of the craft `asked` (C,), solved with `count` (C,) photodiodes from `start`, a pose of each.

        rate_covariance: of the rates that they assumed, (6, 6), asked for only of craft whose pose is in doubt.
        """
        dropped = np.zeros(len(asked), dtype=np.int64)
        if not self.settings.residual_test:
            return Screened(solution, sweeps.lit, count, dropped)
        limit = self._threshold[count]
        # A cost that is not a number is not below its limit.
        doubtful = np.flatnonzero(asked & ~(solution.solved & (solution.cost <= limit * self._noise.own_rad**2)))
        if not len(doubtful):
            return Screened(solution, sweeps.lit, count, dropped)
        lit, count = sweeps.lit.copy(), count.copy()
        parts = PoseSolution._make(part.copy() for part in solution)
        covariance = np.array([rate_covariance(int(c)) for c in doubtful])
        some = sweeps.of(doubtful)
        value = statistic(some, parts.rotation[doubtful], parts.position[doubtful], self._noise, covariance)
        for i, c in enumerate(doubtful):
            if parts.solved[c] and value[i] <= limit[c]:
                continue
            one = some.of(np.array([i]))
            found = consistent_subset(one, start[0][c], start[1][c], self._noise, covariance[i], self._threshold)
            if found is None:
                parts.solved[c], dropped[c] = False, -1
                continue
            lit[c], kept = found.lit, np.count_nonzero(found.lit)
            dropped[c], count[c] = count[c] - kept, kept
            for part, own in zip(parts, found.solution, strict=True):
                part[c] = own[0]
        return Screened(parts, lit, count, dropped)

    def honest(self, one: Sweeps, rotation: Floats, position: Floats, rate_covariance: Floats) -> Bools | None:
        """The photodiodes (K,) that agree, of a craft, a batch of one, whose fit (3, 3), (3,) fails the test.

        None where it passes, or where none can be left out.
        """
        if not self.settings.residual_test:
            return None
        fit = rotation[None], position[None], self._noise, rate_covariance[None]
        if statistic(one, *fit)[0] <= self._threshold[np.count_nonzero(one.lit)]:
            return None
        found = consistent_subset(one, rotation, position, self._noise, rate_covariance, self._threshold)
        return None if found is None else found.lit

    def levels(self, screened: Screened, precision: Dilution, taken: Taken, after: Filtered) -> Integrity:
        """Return the protection levels of this period's poses, and of the filters after them.

        Args:
            screened: the poses after the residual test.
            precision: their dilution of precision.
            taken: what became of them in the filters.
            after: the filters, after every fix of the period.
        """
        s, out, active = self.settings, np.empty((4, len(screened.used))), after.active
        _levels_into(
            (precision.adop_deg_per_rad, precision.pdop_m_per_rad),
            (precision.attitude_slope_deg_per_rad, precision.position_slope_m_per_rad),
            screened.used,
            self._missed * self._noise.own_rad if s.residual_test else np.zeros_like(self._missed),
            self._quantile,
            self._sigma_rad,
            taken.fresh,
            active,
            after.covariance,
            self._held,
            out,
        )
        if (refused := taken.refused & active).any():
            at, pose = np.flatnonzero(refused), screened.solution
            distance = np.linalg.norm(pose.position[at] - after.state.position[at], axis=1)
            angle = np.rad2deg(angle_between(pose.rotation[at], after.state.rotation[at]))
            out[2:, at] = np.fmax(out[2:, at], np.stack([distance, angle]) + out[:2, at])
        limits = s.alert_position_m, float(np.rad2deg(s.alert_attitude_rad))
        watched = [i for i, limit in enumerate(limits) if np.isfinite(limit)]
        alert = np.zeros(out.shape[1], dtype=np.bool_)
        for i in watched:
            alert |= ~(out[2 + i] <= limits[i])
        return Integrity(screened.dropped, out[0], out[1], out[2], out[3], alert, bool(watched))


@kernel
def _levels_into(
    factors: tuple[Floats, Floats],
    slopes: tuple[Floats, Floats],
    count: Ints,
    missed: Floats,
    quantile: float,
    sigma: float,
    by_lighthouse: Bools,
    active: Bools,
    covariance: Floats,
    held: Floats,
    out: Floats,
) -> None:
    """Write levels (4, C): position [m] and attitude [deg] of the poses, then of the filters; `held` (2, C) is kept.

    factors, slopes: of attitude, then position, per radian; missed: sqrt(L) sqrt(1 - rho) s by the number of
    photodiodes; sigma: s [rad].
    """
    for c in range(len(count)):
        for i in range(2):
            # Position comes first here, attitude there.
            fault = slopes[1 - i][c] * missed[count[c]] if missed[count[c]] > 0 else 0.0
            out[i, c] = quantile * sigma * factors[1 - i][c] + fault
            if by_lighthouse[c]:
                held[i, c] = fault
            elif not active[c]:
                held[i, c] = 0.0
            first = 6 if i == 0 else 0
            variance = covariance[c, first, first] + covariance[c, first + 1, first + 1]
            spread = np.sqrt(variance + covariance[c, first + 2, first + 2])
            out[2 + i, c] = quantile * (spread if i == 0 else np.degrees(spread)) + held[i, c]


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
        off = _watch(angles.epoch_tick, angles.missed_sync, turn_tick, tolerance, self._last, self._speed)
        return self._speed if off else None


@kernel
def _watch(epoch: Ints, missed: Ints, turn_tick: float, tolerance: float, last: Ints, speed: Floats) -> bool:
    """Bring `last` and `speed` (C,) up to date; whether any speed is off."""
    off = False
    for c in range(len(epoch)):
        seen = epoch[c] >= 0 and missed[c] == 0
        if seen and last[c] >= 0:
            ratio = turn_tick / (epoch[c] - last[c])
            if abs(ratio - 1) < LARGEST_SPEED_ERROR:
                speed[c] = ratio if abs(ratio - 1) > tolerance else 1.0
        last[c] = epoch[c] if seen else -1
        off = off or speed[c] != 1.0
    return off
