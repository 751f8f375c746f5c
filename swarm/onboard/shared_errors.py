"""Errors that C craft share, kept along with their filters for others.

The filters know nothing of it, but for one thing: a station that rides on a craft is no surer than that craft is of
itself, and what it tells of a period is taken for noise of that period (`estimators.relative.bearers`). From what went
into filters in a period, and their covariances after it, follows how much of its error a filter keeps, and what it
takes over from errors that other craft have as well: those of the rotors, new in every sweep, those of the fans, which
stay (`estimators.relative.error_step`), and those of craft that carry stations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter import smoother
from estimators.filter.bank import FilterBank
from estimators.lighthouse.innovation import Innovations, RowBatch, light_of
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
from estimators.relative.bearers import BearerErrors, Told, moved_alike, with_common_error
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


def counted(
    step: ErrorStep,
    fix: PoseFix,
    taken: Taken,
    ran: Bools,
    covariance: Floats,
    off: tuple[Floats, Floats, Floats],
) -> ErrorStep:
    """Return the period with poses that the filters took in.

    Args:
        step: the period so far.
        fix: the poses.
        taken: their fate.
        ran: (C,), filters that ran before.
        covariance: (C, 12, 12), of the filters afterwards.
        off: by how much a pose is off by the draws (C, 6, M), by the constant errors (C, 6, Q), and the draws' instants
            (C, M) [s].
    """
    accepted, craft = taken.fresh & ran, len(ran)
    by_rows = np.zeros_like(ran) if fix.rows is None else accepted & fix.rows.mask
    whole = np.broadcast_to(np.eye(6), (craft, 6, 6))
    as_pose = sums_of_pose(whole, fix.coupling, off, accepted & ~by_rows, fix.covariance)
    step = updated(step, accepted & ~by_rows, covariance, as_pose)
    if fix.rows is not None:
        step = updated(step, by_rows, covariance, sums_of_pose(fix.rows.pose, fix.rows.rates, off, by_rows))
    return started(step, taken.fresh & ~ran, *off)


class SharedErrors:
    """The shared errors of C craft in one period after the other: `predict`, what was taken in, `end`.

    step: of the period. sensitivity: S (C, 12, Q), by how much each error is that of the fans: e = e' - S q. variance:
    (Q,), of the errors of the fans. bearers: errors of craft that carry stations; None without any. wanted: whether
    anybody asks; if not, nothing is done.
    """

    def __init__(
        self,
        relations: Relations,
        stations: Sequence[Station],
        noise: Sequence[AngleNoise],
        point_m: Floats,
        carried: Sequence[tuple[int, int]] = (),
    ) -> None:
        """Begin with filters that have not been started.

        Args:
            relations: what craft share.
            stations: all stations as the craft know them.
            noise: noise of the rows of each.
            point_m: (C, K, 3) [m], photodiodes in the body frames.
            carried: stations that stand where a craft tells of itself, with the index of that craft.
        """
        self.wanted = relations.any or bool(carried)
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
        bearers = np.unique(np.array([bearer for _, bearer in carried], dtype=np.int64))
        self.bearers = BearerErrors(bearers, craft) if carried else None
        self._carried = [[station for station, on in carried if on == bearer] for bearer in bearers]
        self._columns = errors + STATES * len(bearers)
        self._told: Told | None = None
        self._before: State | None = None
        self._ran: Bools = nobody

    def place(self, stations: Sequence[Station]) -> None:
        """Take stations to be where they are now."""
        self._light = light_of(packed(stations), self._noise)

    def assume(
        self,
        noise: Sequence[AngleNoise],
        common_rad: Sequence[float],
        reference_m: Floats | None = None,
        used: Bools | None = None,
    ) -> None:
        """Take the rows of the stations to have this noise from now on.

        Args:
            noise: per station, that each craft counts for itself.
            common_rad: per station, the part that is the same for all craft.
            reference_m: (K, 3) [m], photodiodes of reference craft that take the mean of their errors off all rows;
                None: without.
            used: (F, K), those that the mean of every fan's sweep is of.
        """
        if not self.wanted:
            return
        own, shared = (np.array(part) for part in zip(*noise, strict=True))
        self._light = self._light._replace(own=own, shared=shared)
        self._noise = list(noise)
        self._common = self._common._replace(sigma_rad=np.array(common_rad, dtype=np.float64))
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
            self.step = predicted(bank.transition(frame_s), self._ran, self.draws, self._columns)
        kept = smoother.predicted(bank, frame_s, move) if history else None
        if not history:
            move()
        if self.wanted:
            self._before = bank.state
            if coupling is not None:
                self.step.kept[:, :6] = coupling @ self.step.kept[:, :6]
        if self.bearers is not None:
            moved = self.step.kept @ self.sensitivity
            stays = (moved * self.variance) @ np.swapaxes(moved, 1, 2)
            self._told = self.bearers.told(self._ran, self.step.kept, bank.covariance, stays)
        return kept

    def _alike(self, mask: Bools, at: State) -> Floats:
        """Return T (C, m, 12, 12): errors of the bearers as those of the craft of the mask, zero for others."""
        assert self.bearers is not None
        assert self._before is not None
        out = np.zeros((len(mask), len(self._carried), STATES, STATES))
        for j, bearer in enumerate(self.bearers.bearers.tolist()):
            if self._ran[bearer]:
                alike = moved_alike(at, self._before.position[bearer], self._before.velocity[bearer])
                out[:, j] = np.where(mask[:, None, None], alike, 0.0)
        return out

    def _as_own(self, mask: Bools, at: State) -> Floats:
        """Return N = T D T^T (C, m, 12, 12), the covariances of the bearers' errors as errors of each craft."""
        assert self._told is not None
        alike = self._alike(mask, at)
        out: Floats = alike @ self._told.covariance @ np.swapaxes(alike, -1, -2)
        return out

    def with_bearers(self, found: Innovations, rows: RowBatch, kept: Bools, mask: Bools) -> Innovations:
        """Return innovations of the craft of the mask with the errors of craft that carry stations in their noise.

        Args:
            found: with the noise of the light.
            rows: that they are of.
            kept: (N,), those that were used.
            mask: (C,), the craft concerned.
        """
        if self.bearers is None or not mask.any():
            return found
        assert self._before is not None
        as_own, out = self._as_own(mask, self._before), found._replace(y=found.y.copy(), h=found.h.copy())
        for c in np.flatnonzero(mask & (found.number > 0)).tolist():
            own = slice(rows.first[c], rows.first[c + 1])
            source = rows.station[own][kept[own]]
            for j, stations in enumerate(self._carried):
                at = np.flatnonzero(np.isin(source, stations))
                if len(at):
                    out.y[c, at], out.h[c, at] = with_common_error(out.y[c, at], out.h[c, at], as_own[c, j])
        return out

    def of_stations(self, craft: int) -> dict[int, Floats]:
        """Return the covariance (12, 12) that the place of each carried station has, as one of a craft's own error."""
        if self.bearers is None:
            return {}
        assert self._before is not None
        mask = np.arange(len(self._ran)) == craft
        as_own = self._as_own(mask, self._before)[craft]
        return {station: as_own[j] for j, stations in enumerate(self._carried) for station in stations}

    def placed(self, fix: PoseFix, rows: RowBatch) -> PoseFix:
        """Return poses solved from rows with the errors of craft that carry stations in their covariances."""
        if self.bearers is None or not fix.known.any():
            return fix
        assert self._told is not None
        off = self._off(rows, fix, fix.known)[1][..., len(self.variance) :]
        parts = np.split(off, len(self._carried), axis=2)
        wider = sum(
            part @ own @ np.swapaxes(part, 1, 2) for part, own in zip(parts, self._told.covariance, strict=True)
        )
        return fix._replace(covariance=fix.covariance + wider)

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
        covariance, ran = bank.covariance, self._ran
        off = self._off(rows(), fix, taken.fresh) if rows is not None else self._nothing()
        if not alone:
            off = np.zeros_like(off[0]), off[1], np.full_like(off[2], np.nan)
        self.step = counted(self.step, fix, taken, ran, covariance, off)
        self._ran = ran | taken.fresh

    def _nothing(self) -> tuple[Floats, Floats, Floats]:
        craft = len(self._ran)
        off = np.zeros((craft, 6, self.draws)), np.zeros((craft, 6, self._columns))
        return *off, np.full((craft, self.draws), np.nan)

    def _off(self, rows: RowBatch, fix: PoseFix, mask: Bools) -> tuple[Floats, Floats, Floats]:
        """Return by how much poses solved from rows are off by draws (C, 6, M) and by errors of fans and of bearers
        (C, 6, Q + 12 m), and the instants of the draws (C, M).
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
        """Return the sums over rows, with the errors of bearers behind those of the fans among the considered."""
        if self.bearers is None:
            return self._of_light(rows, kept, mask, at, weighted=weighted)
        alike = self._alike(mask, at)
        as_own = self._as_own(mask, at)
        carried = np.isin(rows.station, [station for stations in self._carried for station in stations])
        out = self._of_light(rows, kept & ~carried, mask, at, weighted=weighted)
        columns = []
        for j, stations in enumerate(self._carried):
            part = self._of_light(rows, kept & np.isin(rows.station, stations), mask, at, weighted=weighted)
            if weighted:
                less = np.linalg.inv(np.eye(STATES) + part.information @ as_own[:, j])
                part = Shared._make((*(less @ own for own in part[:3]), part.instant))
            columns.append(-part.information @ alike[:, j])
            both = [whole + own for whole, own in zip(out[:3], part[:3], strict=True)]
            out = Shared._make((*both, np.where(np.isfinite(part.instant), part.instant, out.instant)))
        return out._replace(considered=np.concatenate([out.considered, *columns], axis=2))

    def _of_light(self, rows: RowBatch, kept: Bools, mask: Bools, at: State, *, weighted: bool) -> Shared:
        common, errors = self._common, self._errors
        return shared_sums(rows, kept, mask, self._light, common, errors, self._point_m, at, weighted=weighted)

    def end(self, bank: FilterBank) -> None:
        """End the period with the filters as they are."""
        if not self.wanted:
            return
        active, fans = bank.active[:, None, None], len(self.variance)
        kept, drawn, errors = (part * active for part in self.step[:3])
        self.step = ErrorStep(kept, drawn, errors[..., :fans], self.step.instant)
        before, self.sensitivity = self.sensitivity, considered(self.sensitivity, self.step)
        if self.bearers is None or self._told is None:
            return
        taken = -errors[..., fans:]
        told = self._told.transition @ before[self.bearers.bearers]
        self.sensitivity = self.sensitivity + taken @ told.reshape(taken.shape[2], fans)
        self.bearers.end(self.step, taken, self._told)

    def alone(self, covariance: Floats) -> Floats:
        """Return covariances (C, 12, 12) of the errors without those of the fans: what filters believe, and what they
        have taken over from bearers.
        """
        return covariance if self.bearers is None else covariance + self.bearers.beyond

    def widened(self, covariance: Floats) -> Floats:
        """Return covariances (C, 12, 12) with the considered errors in them, P + V + S V_q S^T."""
        covariance = self.alone(covariance)
        if not len(self.variance):
            return covariance
        out: Floats = covariance + (self.sensitivity * self.variance) @ np.swapaxes(self.sensitivity, 1, 2)
        return out
