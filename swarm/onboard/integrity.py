"""Integrity of a craft's own pose: the residual test, exclusion of false photodiodes, protection levels, the alert.

Per lighthouse period, after PnP:

- The residuals are tested (`estimators.lighthouse.integrity`). A pose that fails is solved again without the smallest
  set of photodiodes whose exclusion makes the others agree; if there is none, the pose is rejected.
- A protection level bounds the error of a pose that passed. With K the normal quantile of the integrity risk,

      PL = K s PDOP + slope sqrt(L) sqrt(1 - rho) s     of this period's pose, likewise with ADOP for the attitude
      PL = K sqrt(tr P) + the same second term          of the filter's estimate, P its position's or attitude's

  The first term is the noise: for every Gaussian of covariance P, P(|e| > K sqrt(tr P)) is no more than the two-sided
  tail of one normal variable beyond K, for any K above 1.24 (Szekely and Bakirov, Probab. Theory Relat. Fields 126,
  2003). The second one is the fault: one false photodiode that the residual test has missed
  (`estimators.lighthouse.slope`), L being the noncentrality that it misses with the probability `missed_detection`. A
  filter that coasts keeps the second term of the last pose that it took in. If its gate refuses a pose, one of the
  two is wrong: the filter's level then covers the distance to the pose and the pose's own level.
- A filter that takes in single sweeps of one to three photodiodes has the term of its last pose and one for the false
  photodiode among these, which the gate has missed (`estimators.lighthouse.row_faults`).
- The alert is raised if the filter's level exceeds its limit, or if there is no estimate.

The rotor's speed is monitored as well. Flashes come once per turn; a turn that is too long or too short by the craft's
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
"""Relative error of a turn's length beyond which a flash was mistaken; no rotor is off by so much."""


@dataclass(frozen=True)
class IntegritySettings:
    """Settings of the integrity monitor, in SI units.

    residual_test: False lets every fit pass, for errors that the noise model does not account for. false_alarm,
    missed_detection: probabilities of the residual test, per pose. risk: probability of an error beyond its protection
    level, per estimate. alert_position_m, alert_attitude_rad: limits of the filter's protection levels; infinite for
    none. tick_s: tick of the clock; None: the rotor's speed is not monitored. speed_tolerance: relative error of a
    turn's length that is attributed to the clock. false_photodiodes: number of photodiodes that may be false all the
    time, for which the filter's levels allow by separation of solutions; 0: by the slope of one that is missed in a
    pose. false_stations: number of stations that may be so, 0 or 1. unseen_acceleration_m_s2,
    unseen_angular_acceleration_rad_s2: that a craft may have without light.
    """

    residual_test: bool = True
    false_alarm: float = 1e-7
    missed_detection: float = 1e-4
    risk: float = 1e-7
    alert_position_m: float = np.inf
    alert_attitude_rad: float = np.inf
    tick_s: float | None = None
    speed_tolerance: float = 20e-6
    false_photodiodes: int = 0
    false_stations: int = 0
    unseen_acceleration_m_s2: float = 0.0
    unseen_angular_acceleration_rad_s2: float = 0.0


class Integrity(NamedTuple):
    """Integrity of the poses of C craft, each (C,).

    dropped: number of photodiodes excluded as false; -1: the residuals failed and no subset agreed. pnp_position_m,
    pnp_attitude_deg: protection levels of this period's pose, NaN without one. position_m, attitude_deg: protection
    levels of the filter's estimate, NaN without one. alert: whether one of those exceeds its limit. watched: whether
    there is any limit.
    """

    dropped: Ints
    pnp_position_m: Floats
    pnp_attitude_deg: Floats
    position_m: Floats
    attitude_deg: Floats
    alert: Bools
    watched: bool

    @property
    def levels(self) -> Floats:
        """The protection levels of the filters, (2, C): position [m], attitude [rad]."""
        return np.stack([self.position_m, np.radians(self.attitude_deg)])


class Separated(NamedTuple):
    """Levels of the filters of C craft by separation of solutions. levels: (2, C), position [m] and attitude [deg].
    covered: (C,), whether any false photodiode of the last pose is separated; fewer lit than five leave none out.
    """

    levels: Floats
    covered: Bools


class Screened(NamedTuple):
    """Poses of PnP after the residual test.

    solution: the poses. lit: photodiodes that they are solved from, (C, K). used: number of those, (C,). dropped:
    number of photodiodes excluded, (C,); -1 as in `Integrity`.
    """

    solution: PoseSolution
    lit: Bools
    used: Ints
    dropped: Ints


class Monitor:
    """The integrity monitors of C craft, each by itself: no operation mixes rows of the craft axis."""

    def __init__(
        self, settings: IntegritySettings, noise: AngleNoise, angle_noise_rad: float, shape: tuple[int, int]
    ) -> None:
        """Start without a held fault term.

        Args:
            settings: settings of the monitor.
            noise: noise of an angle.
            angle_noise_rad: s of (18), (19), all of it [rad].
            shape: numbers of craft and of photodiodes (C, K).
        """
        craft, most = shape
        self.settings = settings
        self._noise, self._sigma_rad = noise, angle_noise_rad
        self._threshold = thresholds(most, settings.false_alarm)
        self._missed = np.sqrt(noncentralities(self._threshold, settings.missed_detection))
        self._quantile = -float(ndtri(settings.risk / 2))
        self._held = np.zeros((2, craft))
        limits = settings.alert_position_m, float(np.rad2deg(settings.alert_attitude_rad))
        self._watched = [(i, limit) for i, limit in enumerate(limits) if np.isfinite(limit)]
        self._turn = RotorWatch(craft)

    def assume(self, noise: AngleNoise) -> None:
        """Take angles to have this noise from now on."""
        self._noise, self._sigma_rad = noise, float(np.hypot(*noise))

    def forget(self, mask: Bools) -> None:
        """Forget the fault terms and flashes of the craft of the mask (C,)."""
        self._held[:, mask] = 0.0
        self._turn.forget(mask)

    def speed(self, angles: SweepAngles, frame_s: float) -> Floats | None:
        """Return each craft's rotor speed (C,) relative to the nominal one, by its flashes; None if all are nominal."""
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
        """Test the residuals of all poses, and solve the failing ones again without false photodiodes.

        Args:
            sweeps: this period's sweeps.
            asked: craft whose pose is tested, (C,).
            count: number of photodiodes of each pose, (C,).
            solution: the poses.
            start: the start poses that they were solved from, (C, 3, 3) and (C, 3) [m].
            rate_covariance: function of a craft's index that returns the covariance (6, 6) of its assumed rates; called
                only for craft whose pose is in doubt.
        """
        dropped = np.zeros(len(asked), dtype=np.int64)
        if not self.settings.residual_test:
            return Screened(solution, sweeps.lit, count, dropped)
        in_doubt = np.empty_like(asked)
        if not _doubt_into(asked, solution, count, self._threshold * self._noise.own_rad**2, in_doubt):
            return Screened(solution, sweeps.lit, count, dropped)
        doubtful, limit = np.flatnonzero(in_doubt), self._threshold[count]
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
        """Return the photodiodes (K,) of one craft that agree with each other, if its fit fails the test.

        Args:
            one: sweeps of the craft, a batch of one.
            rotation: rotation of the fit, (3, 3).
            position: position of the fit, (3,) [m].
            rate_covariance: covariance of the assumed rates, (6, 6).

        Returns:
            The mask; None if the fit passes the test, or if no subset agrees.
        """
        if not self.settings.residual_test:
            return None
        fit = rotation[None], position[None], self._noise, rate_covariance[None]
        if statistic(one, *fit)[0] <= self._threshold[np.count_nonzero(one.lit)]:
            return None
        found = consistent_subset(one, rotation, position, self._noise, rate_covariance, self._threshold)
        return None if found is None else found.lit

    def levels(
        self,
        screened: Screened,
        precision: Dilution,
        taken: Taken,
        after: Filtered,
        sweep_fault: Floats,
        separated: Separated | None = None,
    ) -> Integrity:
        """Return the protection levels of this period's poses, and of the filters after them.

        Args:
            screened: poses after the residual test.
            precision: their dilution of precision.
            taken: result of the update of every filter with its pose.
            after: filters after every fix of the period.
            sweep_fault: (2, C), what a false photodiode among single sweeps may do: position [m], attitude [deg].
            separated: levels of the filters by separation of solutions, where they are known so.
        """
        s, out, active = self.settings, np.empty((4, len(screened.used))), after.active
        refused = _levels_into(
            (precision.adop_deg_per_rad, precision.pdop_m_per_rad),
            (precision.attitude_slope_deg_per_rad, precision.position_slope_m_per_rad),
            screened.used,
            self._missed * self._noise.own_rad if s.residual_test else np.zeros_like(self._missed),
            self._quantile,
            self._sigma_rad,
            taken,
            active,
            after.covariance,
            screened.solution.solved,
            self._held,
            out,
        )
        out[2:] += sweep_fault
        if separated is not None:
            own = np.where(active, separated.levels + sweep_fault, np.nan)
            out[2:] = np.where(separated.covered, own, np.fmax(out[2:], own))
        if refused:
            at, pose = np.flatnonzero(taken.refused & active), screened.solution
            distance = np.linalg.norm(pose.position[at] - after.state.position[at], axis=1)
            angle = np.rad2deg(angle_between(pose.rotation[at], after.state.rotation[at]))
            out[2:, at] = np.fmax(out[2:, at], np.stack([distance, angle]) + out[:2, at])
        alert = np.zeros(out.shape[1], dtype=np.bool_)
        for i, limit in self._watched:
            alert |= ~(out[2 + i] <= limit)
        return Integrity(screened.dropped, out[0], out[1], out[2], out[3], alert, bool(self._watched))


@kernel
def _doubt_into(asked: Bools, solution: PoseSolution, count: Ints, limit: Floats, out: Bools) -> bool:
    """Write which poses fail the residual test; return whether any does.

    Args:
        asked: (C,), craft whose pose is tested.
        solution: the poses.
        count: (C,), number of photodiodes of each.
        limit: (K + 1,) [rad^2], largest cost by this number.
        out: (C,), receives it.
    """
    some = False
    for c in range(len(asked)):
        # A NaN cost is not below its limit.
        out[c] = asked[c] and not (solution.solved[c] and solution.cost[c] <= limit[count[c]])
        some |= out[c]
    return some


@kernel
def _levels_into(
    factors: tuple[Floats, Floats],
    slopes: tuple[Floats, Floats],
    count: Ints,
    missed: Floats,
    quantile: float,
    sigma: float,
    taken: Taken,
    active: Bools,
    covariance: Floats,
    solved: Bools,
    held: Floats,
    out: Floats,
) -> bool:
    """Write levels (4, C): position [m] and attitude [deg] of the poses, NaN where not solved, then of the filters;
    `held` (2, C) is kept. Return whether any filter refused its pose.

    factors, slopes: per radian, of the attitude, then of the position. missed: sqrt(L) sqrt(1 - rho) s by the number of
    photodiodes. sigma: s [rad].
    """
    refused = False
    for c in range(len(count)):
        for i in range(2):
            # The levels have the position first, `factors` and `slopes` the attitude.
            fault = slopes[1 - i][c] * missed[count[c]] if missed[count[c]] > 0 else 0.0
            out[i, c] = quantile * sigma * factors[1 - i][c] + fault if solved[c] else np.nan
            if taken.fresh[c]:
                held[i, c] = fault
            elif not active[c]:
                held[i, c] = 0.0
            first = 6 if i == 0 else 0
            variance = covariance[c, first, first] + covariance[c, first + 1, first + 1]
            spread = np.sqrt(variance + covariance[c, first + 2, first + 2])
            out[2 + i, c] = quantile * (spread if i == 0 else np.degrees(spread)) + held[i, c]
        refused |= taken.refused[c] and active[c]
    return refused


class RotorWatch:
    """The rotor speed that each of C craft measures from the flashes, by its own clock."""

    def __init__(self, craft: int) -> None:
        self._last = np.full(craft, -1, dtype=np.int64)
        self._speed = np.ones(craft)

    def forget(self, mask: Bools) -> None:
        """Forget the flashes of the craft of the mask (C,)."""
        self._last[mask], self._speed[mask] = -1, 1.0

    def speed(self, angles: SweepAngles, turn_tick: float, tolerance: float) -> Floats | None:
        """Return the speed (C,) relative to the nominal one; None if every craft's is nominal.

        The time between two flashes that were seen is a measurement; without one, the last measurement stands.

        Args:
            angles: sweep angles of this period, for the epochs and missed flashes.
            turn_tick: nominal length of a turn [ticks].
            tolerance: relative error of a turn's length that is attributed to the clock.
        """
        off = _watch(angles.epoch_tick, angles.missed_sync, turn_tick, tolerance, self._last, self._speed)
        return self._speed if off else None


@kernel
def _watch(epoch: Ints, missed: Ints, turn_tick: float, tolerance: float, last: Ints, speed: Floats) -> bool:
    """Update `last` and `speed` (C,); return whether any speed is off."""
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
