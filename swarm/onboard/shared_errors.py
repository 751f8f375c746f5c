"""Errors that C craft share, kept along with their filters for others.

The filters know nothing of it. From what went into them in a period, and their covariances after it, follows how much
of its error a filter keeps, and what it takes over from errors that other craft have as well: those of the rotors, new
in every sweep, and those of the fans, which stay (`estimators.relative.error_step`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter import smoother
from estimators.filter.bank import FilterBank
from estimators.lighthouse.innovation import RowBatch, light_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import Station, packed
from estimators.lighthouse.shared import (
    SWEEPS_PER_FAN,
    Common,
    Shared,
    considered_errors,
    mean_derivatives,
    pose_sensitivity,
    shared_sums,
)
from estimators.relative.cross import considered
from estimators.relative.error_step import ErrorStep, predicted, started, sums_of_pose, updated
from estimators.state import STATES, State
from swarm.messages import Command
from swarm.onboard.tracks import PoseFix, Taken, Tracks


@dataclass(frozen=True)
class Relations:
    """Shared errors of craft, and who wants to know of whom.

    pairs: (who knows, of whom), by index. limits: of every pair, protection levels of position [m] and attitude [rad]
    above which there is an alert; empty: none. common_rad: per station, standard deviation of the error of a sweep that
    is one for all craft. turn_s: per station, duration of a turn of its rotor. fan_sigma: standard deviation of what is
    left of each term of the fans' errors (`estimators.lighthouse.shared.Considered`); none is considered without.
    """

    pairs: tuple[tuple[int, int], ...] = ()
    limits: tuple[tuple[float, float], ...] = ()
    common_rad: tuple[float, ...] = ()
    turn_s: tuple[float, ...] = ()
    fan_sigma: tuple[tuple[str, float], ...] = ()

    @property
    def any(self) -> bool:
        """True if anybody asks for shared errors."""
        return bool(self.pairs or self.fan_sigma)


class SharedErrors:
    """The shared errors of C craft in one period after the other: `begin`, `predicted`, what was taken in, `end`.

    step: of the period. sensitivity: S (C, 12, Q), by how much each error is that of the fans: e = e' - S q. variance:
    (Q,), of the errors of the fans. wanted: whether anybody asks; if not, nothing is done.
    """

    def __init__(
        self, relations: Relations, stations: Sequence[Station], noise: Sequence[AngleNoise], point_m: Floats
    ) -> None:
        """Begin with filters that have not been started.

        Args:
            relations: what craft share.
            stations: all stations as the craft know them.
            noise: noise of the rows of each.
            point_m: (C, K, 3) [m], photodiodes in the body frames.
        """
        self.wanted = relations.any
        self._noise, self._point_m = list(noise), point_m
        self._errors = considered_errors(stations if relations.fan_sigma else ())
        nothing = np.zeros((sum(len(station.fans) for station in stations), len(self._errors.terms)))
        self._common = Common(np.array(relations.common_rad), np.array(relations.turn_s), nothing)
        self._taken: dict[bytes, Floats] = {}
        sigma = dict(relations.fan_sigma)
        self.variance = np.array([sigma[term] ** 2 for term in self._errors.terms])
        self.draws = SWEEPS_PER_FAN * sum(len(station.fans) for station in stations)
        self.place(stations)
        craft, errors = len(point_m), len(self.variance)
        nobody = np.zeros(craft, dtype=np.bool_)
        self.step: ErrorStep = predicted(np.zeros((craft, STATES, STATES)), nobody, self.draws, errors)
        self.sensitivity = np.zeros((craft, STATES, errors))
        self._before: State | None = None
        self._ran: Bools = nobody

    def place(self, stations: Sequence[Station]) -> None:
        """Take stations to be where they are now."""
        self._light = light_of(packed(stations), self._noise)

    def assume(
        self, noise: AngleNoise, common_rad: float, reference_m: Floats | None = None, used: Bools | None = None
    ) -> None:
        """Take the rows of the only station to have this noise from now on.

        Args:
            noise: that each craft counts for itself.
            common_rad: the part that is the same for all craft.
            reference_m: (K, 3) [m], photodiodes of a reference craft that takes the mean of its errors off all rows;
                None: without.
            used: (F, K), those that the mean of every fan's sweep is of.
        """
        if not self.wanted:
            return
        own, shared = (np.array([part]) for part in noise)
        self._light = self._light._replace(own=own, shared=shared)
        self._common = self._common._replace(sigma_rad=np.array([common_rad]))
        if not len(self.variance):
            return
        key = b"" if used is None else used.tobytes()
        if reference_m is None or used is None:
            taken = np.zeros((len(self._light.fans), len(self.variance)))
        elif key in self._taken:
            taken = self._taken[key]
        else:
            taken = self._taken[key] = mean_derivatives(self._light, self._errors, reference_m, used)
        self._common = self._common._replace(taken=taken)

    def predict(
        self, tracks: Tracks, command: Command | None, frame_s: float, *, history: bool
    ) -> smoother.Prediction | None:
        """Predict every filter to the next epoch, and take what that makes of the shared errors.

        Args:
            tracks: the filters.
            command: orders for the period, if known.
            frame_s: length of the period [s].
            history: whether the prediction is to be kept.

        Returns:
            The prediction as a smoother needs it; None where it is not kept.
        """
        bank = tracks.bank
        coupling: Floats | None = None

        def move() -> Floats | None:
            nonlocal coupling
            coupling = tracks.predict(command)
            return coupling

        if self.wanted:
            self._ran = bank.active
            self.step = predicted(bank.transition(frame_s), self._ran, self.draws, len(self.variance))
        kept = smoother.predicted(bank, frame_s, move) if history else None
        if not history:
            move()
        if self.wanted:
            self._before = bank.state
            if coupling is not None:
                self.step.kept[:, :6] = coupling @ self.step.kept[:, :6]
        return kept

    def poses(
        self,
        rows: Callable[[], RowBatch] | None,
        fix: PoseFix,
        taken: Taken,
        bank: FilterBank,
        *,
        alone: bool = True,
    ) -> None:
        """Count in poses that the filters took in.

        Args:
            rows: returns those that the poses were solved from; None: of a sensor that shares nothing.
            fix: the poses.
            taken: their fate.
            bank: the filters afterwards.
            alone: whether the poses were solved from these rows alone; if from those of periods before as well, what
                the draws of this one do to them is not counted.
        """
        if not self.wanted or not taken.fresh.any():
            return
        covariance, ran, craft = bank.covariance, self._ran, len(self._ran)
        off = self._off(rows(), fix, taken.fresh) if rows is not None else self._nothing()
        if not alone:
            off = np.zeros_like(off[0]), off[1], np.full_like(off[2], np.nan)
        accepted = taken.fresh & ran
        by_rows = np.zeros_like(ran) if fix.rows is None else accepted & fix.rows.mask
        whole = np.broadcast_to(np.eye(6), (craft, 6, 6))
        as_pose = sums_of_pose(whole, fix.coupling, off, accepted & ~by_rows, fix.covariance)
        self.step = updated(self.step, accepted & ~by_rows, covariance, as_pose)
        if fix.rows is not None:
            self.step = updated(
                self.step, by_rows, covariance, sums_of_pose(fix.rows.pose, fix.rows.rates, off, by_rows)
            )
        self.step = started(self.step, taken.fresh & ~ran, *off)
        self._ran = ran | taken.fresh

    def _nothing(self) -> tuple[Floats, Floats, Floats]:
        craft, errors = len(self._ran), len(self.variance)
        return np.zeros((craft, 6, self.draws)), np.zeros((craft, 6, errors)), np.full((craft, self.draws), np.nan)

    def _off(self, rows: RowBatch, fix: PoseFix, mask: Bools) -> tuple[Floats, Floats, Floats]:
        """Return by how much poses solved from rows are off by draws (C, 6, M) and fan errors (C, 6, Q), and the
        instants of the draws (C, M).
        """
        assert self._before is not None
        mask = mask & (np.diff(rows.first) > 0)
        rates = (np.nan_to_num(rate) for rate in (self._before.velocity, self._before.angular_rate))
        at = State(fix.rotation, fix.position, *rates)
        sums = self._sums(rows, np.ones(len(rows.angle), dtype=np.bool_), mask, at, weighted=False)
        return (*pose_sensitivity(sums, mask), sums.instant)

    def rows(self, rows: RowBatch | None, kept: Bools, fresh: Bools, bank: FilterBank) -> None:
        """Count in rows that the filters took in.

        Args:
            rows: of all craft; None: none.
            kept: (N,), those that were used.
            fresh: (C,), filters that took them in.
            bank: the filters afterwards.
        """
        if self.wanted and rows is not None and fresh.any():
            assert self._before is not None
            sums = self._sums(rows, kept, fresh, self._before, weighted=True)
            self.step = updated(self.step, fresh, bank.covariance, sums)

    def _sums(self, rows: RowBatch, kept: Bools, mask: Bools, at: State, *, weighted: bool) -> Shared:
        common, errors = self._common, self._errors
        return shared_sums(rows, kept, mask, self._light, common, errors, self._point_m, at, weighted=weighted)

    def end(self, bank: FilterBank) -> None:
        """End the period with the filters as they are."""
        if not self.wanted:
            return
        active = bank.active[:, None, None]
        kept, drawn, errors = (part * active for part in self.step[:3])
        self.step = ErrorStep(kept, drawn, errors, self.step.instant)
        self.sensitivity = considered(self.sensitivity, self.step)

    def widened(self, covariance: Floats) -> Floats:
        """Return covariances (C, 12, 12) with the considered errors in them, P + S V S^T."""
        if not len(self.variance):
            return covariance
        out: Floats = covariance + (self.sensitivity * self.variance) @ np.swapaxes(self.sensitivity, 1, 2)
        return out
