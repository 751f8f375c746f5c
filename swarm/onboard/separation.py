"""Protection levels of a craft's filter by separation of solutions: whatever one or two photodiodes do, all the time.

Beside the running filter, every set of one or two photodiodes has the filter that never saw it, as its distance from
the running one (`estimators.lighthouse.separation`). Poses of the lighthouse go in with and without the set; single
sweeps and cameras go into both alike.

While there is no light the craft does not see what moves it: with `unseen_acceleration_m_s2`, a, the level of position
is larger by a t^2 / 2 after t seconds, and that of attitude likewise. That covers any push up to it, and none beyond.
"""

import numpy as np
from scipy.special import ndtri

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank
from estimators.lighthouse.separation import FEWEST_OTHERS, Linear, separate, sets_of, worst_levels
from estimators.relative.error_step import ErrorStep, predicted
from estimators.state import STATES
from swarm.onboard.integrity import IntegritySettings, Separated
from swarm.onboard.shared_errors import counted
from swarm.onboard.tracks import Filtered, PoseFix, Taken

POSITION, ATTITUDE = slice(6, 9), slice(0, 3)
_POSE = 6


class Separation:
    """The separated solutions of C craft: `begin`, what was taken in, `levels`, once per period. wanted: whether the
    settings ask for any; if not, nothing is done.
    """

    def __init__(
        self, settings: IntegritySettings, shape: tuple[int, int], axes: Floats, *, by_rows: bool = False
    ) -> None:
        """Begin with filters that have not been started.

        Args:
            settings: settings of the monitor.
            shape: numbers of craft and of photodiodes (C, K).
            axes: (3, 3), rotation from the lighthouse's frame, in which poses are solved, into the world.
            by_rows: whether all light goes into the filters row by row, without a pose: nothing is done then.
        """
        craft, photodiodes = shape
        self.wanted = settings.false_photodiodes > 0 and not by_rows
        self._sets = sets_of(photodiodes, settings.false_photodiodes)
        self._delta = np.zeros((craft, len(self._sets), STATES))
        self._added = np.zeros((craft, len(self._sets), 2))
        self._axes = np.kron(np.eye(2), axes)
        self._quantile = -float(ndtri(settings.risk / 2))
        self._unseen = settings.unseen_acceleration_m_s2, settings.unseen_angular_acceleration_rad_s2
        self._reach = np.zeros((craft, 2, STATES, STATES))
        self._spread = np.full((craft, 2), np.nan)
        self._step: ErrorStep = predicted(np.zeros((craft, STATES, STATES)), np.zeros(craft, dtype=np.bool_), _POSE, 0)
        self._ran = np.zeros(craft, dtype=np.bool_)
        self._covered = np.zeros(craft, dtype=np.bool_)

    def begin(self, bank: FilterBank, frame_s: float) -> None:
        """Begin a period with the filters before their prediction."""
        if self.wanted:
            self._ran = bank.active
            self._step = predicted(bank.transition(frame_s), self._ran, _POSE, 0)

    def poses(self, fix: PoseFix, taken: Taken, bank: FilterBank, *, separated: bool) -> None:
        """Count in poses that the filters took in.

        Args:
            fix: the poses.
            taken: their fate.
            bank: the filters afterwards.
            separated: whether they are the lighthouse's, of which photodiodes are left out.
        """
        if not self.wanted or not taken.fresh.any():
            return
        craft = len(self._ran)
        unit = np.broadcast_to(np.eye(_POSE) if separated else np.zeros((_POSE, _POSE)), (craft, _POSE, _POSE))
        off = unit, np.zeros((craft, _POSE, 0)), np.full((craft, _POSE), np.nan)
        self._step = counted(self._step, fix, taken, self._ran, bank.covariance, off)
        self._ran = self._ran | taken.fresh

    def rows(self, fresh: Bools, before: Floats, bank: FilterBank) -> None:
        """Count in single sweeps.

        Args:
            fresh: (C,), filters that took them in.
            before: (C, 12, 12), their covariances before.
            bank: the filters afterwards.
        """
        if self.wanted and fresh.any():
            who = np.flatnonzero(fresh)
            left = np.swapaxes(np.linalg.solve(before[who], bank.covariance[who]), 1, 2)
            self._step.kept[who], self._step.drawn[who] = left @ self._step.kept[who], left @ self._step.drawn[who]

    def end(self, linear: Linear | None, fresh: Bools, after: Filtered, own_rad: float) -> None:
        """Carry every set on to the end of the period.

        Args:
            linear: the lighthouse's poses.
            fresh: (C,), filters that took them in.
            after: the filters.
            own_rad: noise of one photodiode's angle.
        """
        if not self.wanted or linear is None:
            return
        active = after.active
        kept, gain = (part * active[:, None, None] for part in (self._step.kept, self._step.drawn))
        gain = gain @ self._axes
        traces = np.stack(
            [np.trace(after.covariance[:, part, part], axis1=1, axis2=2) for part in (POSITION, ATTITUDE)], axis=1
        )
        for i, part in enumerate((POSITION, ATTITUDE)):
            self._reach[:, i] = np.swapaxes(kept, 1, 2) @ self._reach[:, i] @ kept
            self._reach[:, i, part, part] += np.eye(3)
        weight = np.swapaxes(gain, 1, 2)[:, None] @ self._reach @ gain[:, None]
        with np.errstate(invalid="ignore", divide="ignore"):
            # Fades with the filter's memory where poses come in, and grows with its variance where none do.
            periods = np.stack(
                [np.trace(self._reach[:, i, p, p], axis1=1, axis2=2) / 3 for i, p in enumerate((POSITION, ATTITUDE))],
                axis=1,
            )
            memory = np.where(fresh[:, None], 1 - 1 / periods, np.fmax(traces / self._spread, 1.0))
        self._spread = traces
        memory = np.where(active[:, None] & np.isfinite(memory), memory, 0.0)
        self._covered = np.where(fresh, np.count_nonzero(linear.lit, axis=1) > FEWEST_OTHERS, self._covered & active)
        separate(
            linear.jacobian,
            linear.residual,
            linear.lit,
            fresh & active,
            self._sets,
            np.ascontiguousarray(np.nan_to_num(kept)),
            np.ascontiguousarray(np.nan_to_num(gain)),
            np.ascontiguousarray(np.nan_to_num(weight)),
            own_rad**2,
            memory,
            self._delta,
            self._added,
        )

    def levels(self, after: Filtered, since_update_s: Floats) -> Separated | None:
        """Return the protection levels of the filters; None: not wanted.

        Args:
            after: the filters, with everything in their covariances that craft consider.
            since_update_s: (C,), time without light [s].
        """
        if not self.wanted:
            return None
        traces = np.stack([np.trace(after.covariance[:, p, p], axis1=1, axis2=2) for p in (POSITION, ATTITUDE)])
        out = np.empty_like(traces)
        worst_levels(self._delta, self._added, traces, self._quantile, out)
        out += np.outer(self._unseen, since_update_s**2 / 2)
        out[1] = np.degrees(out[1])
        return Separated(out, self._covered.copy())
