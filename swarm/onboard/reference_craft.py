"""Reference craft: they stand still at known places, and tell the others by how much each sweep is off there.

As a reference receiver of satellite navigation does, one measures what the angle of each of its photodiodes should not
be: y_k = measured - h(known place) = u + own noise, with u the error of the rotor in the sweep and of the flash, and
that of the fans as far as it is the same everywhere. Its mean over the n_i photodiodes of a sweep is broadcast, and the
others take the mean of all references' photodiodes, n in all, off their angles of the same sweep. With the noise a of
an angle, a craft's photodiodes then share

    b'^2 = f^2 + f^2 sum n_i^2 / n^2 + a^2 / n     f^2: rounding of a flash to a tick, of the craft's and of each clock

of which all but the first is the same for all craft. Lighthouse 2.0 has no flash, and no f. A sweep of the one
lighthouse that no reference sees is not corrected, nor is then the other fan's: noise is that of before. Of stations,
each is corrected by itself; where references see one, rows of a sweep that passes them by, as at the end of a period,
are left out.

Broadcast once per period: u16 craft, u32 period, and of each fan f32 mean and u8 n: 16 bytes; before stations, u16
craft, u32 period, and of each sweep u8 station, u8 fan, i32 instant, f32 mean and u8 n: 6 bytes, and 11 per sweep.
"""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.lighthouse.innovation import RowBatch
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import Station
from estimators.lighthouse.sweep import HALF_PI, FanPair, lighthouse_1, measured_angles
from estimators.relative.cross import SAME_S
from swarm.onboard.decoder import SweepAngles

BYTES = 16
"""Size of the broadcast of one period."""
HEAD_BYTES, SWEEP_BYTES = 6, 11
"""Sizes of its head and of one sweep before stations."""
OUTLIER = 6.0
"""Distance from the median of a sweep, in standard deviations, beyond which an angle is left out as false."""


class ReferencePlace(NamedTuple):
    """A craft whose pose in the lighthouse frame is known: its index, rotation (3, 3) and position (3,) [m]."""

    craft: int
    rotation: Floats
    position: Floats

    def points(self, point_m: Floats) -> Floats:
        """Return where its photodiodes are, (K, 3) [m]; point_m: (C, K, 3) [m], of all craft in their body frames."""
        out: Floats = point_m[self.craft] @ self.rotation.T + self.position
        return out


class SweepErrors(NamedTuple):
    """Errors of both fans' sweeps as reference craft find them.

    error: (2,) [rad]. used: (2, R K), photodiodes that they are means of. noise: of an angle from which they are taken
    off. common_rad: the part of its shared noise that is the same for all craft.
    """

    error: Floats
    used: Bools
    noise: AngleNoise
    common_rad: float

    def taken_off(self, angles: SweepAngles) -> SweepAngles:
        """Return angles of all craft without these errors."""
        return angles._replace(theta=angles.theta - self.error)


class ReferenceCraft:
    """R craft at known places. point_m: (R K, 3) [m], where their photodiodes are."""

    def __init__(
        self, places: Sequence[ReferencePlace], point_m: Floats, fans: FanPair, noise: AngleNoise, common_rad: float
    ) -> None:
        """Take where they are.

        Args:
            places: of the craft.
            point_m: (C, K, 3) [m], photodiodes of all craft in their body frames.
            fans: errors of the fans as craft know them.
            noise: of an angle.
            common_rad: the part of the shared noise that is the same for all craft.
        """
        there = np.stack([place.points(point_m) for place in places])
        self.point_m: Floats = there.reshape(-1, 3)
        self._craft, self._noise, self._common = [place.craft for place in places], noise, common_rad
        self._theta = HALF_PI + measured_angles(there, lighthouse_1(*fans))

    def observe(self, angles: SweepAngles) -> SweepErrors | None:
        """Return the errors of a period's sweeps; None where no reference has seen both fans."""
        off = angles.theta[self._craft] - self._theta
        used = np.stack([_honest(one, self._noise) for one in off])
        used[(used.sum(axis=1) == 0).any(axis=1)] = False
        number = used.sum(axis=(0, 1))
        if not number.all():
            return None
        error = np.where(used, off, 0.0).sum(axis=(0, 1)) / number
        common, noise = _left(self._noise, self._common, used.sum(axis=1))
        return SweepErrors(error, used.reshape(-1, 2).T, noise, common)


class RowErrors(NamedTuple):
    """Rows without the errors of their sweeps, and what is left in them.

    rows, kept: of all craft, and which of those that were asked about they are, (N,). noise: per station, of a row.
    common_rad: per station, the part of its shared noise that is the same for all craft. used: (F, R K), photodiodes of
    the references that the means of every fan are of.
    """

    rows: RowBatch
    kept: Bools
    noise: list[AngleNoise]
    common_rad: list[float]
    used: Bools


class ReferenceRows:
    """R craft at known places before several stations. point_m: (R K, 3) [m], where their photodiodes are."""

    def __init__(
        self,
        places: Sequence[ReferencePlace],
        point_m: Floats,
        stations: Sequence[Station],
        noise: Sequence[AngleNoise],
        common_rad: Sequence[float],
        turn_s: Sequence[float],
    ) -> None:
        """Take where they are.

        Args:
            places: of the craft, in the world.
            point_m: (C, K, 3) [m], photodiodes of all craft in their body frames.
            stations: as craft know them.
            noise: of the rows of each.
            common_rad: per station, the part of the shared noise that is the same for all craft.
            turn_s: per station, duration of a turn of its rotor.
        """
        there = np.stack([place.points(point_m) for place in places])
        self.point_m: Floats = there.reshape(-1, 3)
        self._craft, self._noise = [place.craft for place in places], list(noise)
        self._common, self._turn = list(common_rad), np.array(turn_s)
        known = [measured_angles((there - s.position) @ s.rotation, s.fans) for s in stations]
        self._first = np.concatenate([[0], np.cumsum([len(s.fans) for s in stations])])
        self._angle = np.concatenate(known, axis=2)

    def observe(self, rows: RowBatch) -> RowErrors:
        """Return the rows of a period without the errors of sweeps that references have seen."""
        instant = rows.offset_s - rows.angle * self._turn[rows.station] / (2 * np.pi)
        fan = self._first[rows.station] + rows.fan
        photodiodes, angle = self._angle.shape[1], rows.angle.copy()
        corrected, seen = np.zeros(len(angle), dtype=np.bool_), np.zeros(len(self._noise), dtype=np.bool_)
        used = np.zeros((self._angle.shape[2], len(self._craft), photodiodes), dtype=np.bool_)
        worst: dict[int, tuple[float, AngleNoise]] = {}
        own = [np.arange(rows.first[c], rows.first[c + 1]) for c in self._craft]
        for at, f in self._sweeps(instant, fan, own):
            station = int(np.searchsorted(self._first, f, side="right")) - 1
            total, number = 0.0, np.zeros((len(own), 1), dtype=np.int64)
            for r, mine in enumerate(own):
                of = mine[(fan[mine] == f) & (np.abs(instant[mine] - at) < SAME_S)]
                off = rows.angle[of] - self._angle[r, rows.photodiode[of], f]
                good = _honest(off[:, None], self._noise[station])[:, 0]
                total, number[r] = total + float(off[good].sum()), np.count_nonzero(good)
                used[f, r, rows.photodiode[of[good]]] = True
            if not number.any():
                continue
            same = (fan == f) & (np.abs(instant - at) < SAME_S)
            angle[same] -= total / float(number.sum())
            corrected |= same
            seen[station] = True
            left = _left(self._noise[station], self._common[station], number)
            worst[station] = max(worst.get(station, left), left, key=lambda one: one[0])
        kept = corrected | ~seen[rows.station]
        noise = [worst[s][1] if s in worst else known for s, known in enumerate(self._noise)]
        common = [worst[s][0] if s in worst else known for s, known in enumerate(self._common)]
        return RowErrors(rows._replace(angle=angle).where(kept), kept, noise, common, used.reshape(len(used), -1))

    @staticmethod
    def _sweeps(instant: Floats, fan: Ints, own: list[Ints]) -> list[tuple[float, int]]:
        """Return instant [s] and fan of every sweep that references have seen."""
        out: list[tuple[float, int]] = []
        every = np.concatenate(own)
        for i in every[np.lexsort((instant[every], fan[every]))].tolist():
            if not out or out[-1][1] != fan[i] or instant[i] - out[-1][0] >= SAME_S:
                out.append((float(instant[i]), int(fan[i])))
        return out


def _honest(off: Floats, noise: AngleNoise) -> Bools:
    """Return which angles (K, F) of one craft are not far from the others of their sweep; False where not seen."""
    seen = np.isfinite(off)
    out = np.zeros_like(seen)
    for f in np.flatnonzero(seen.any(axis=0)).tolist():
        out[seen[:, f], f] = np.abs(off[seen[:, f], f] - np.median(off[seen[:, f], f])) <= OUTLIER * noise.own_rad
    return out


def _left(noise: AngleNoise, common_rad: float, number: Ints) -> tuple[float, AngleNoise]:
    """Return the noise that is left where means are taken off: its part that is the same for all craft, and all of it.

    Args:
        noise: of an angle as it is measured.
        common_rad: the part of the shared noise that is the same for all craft.
        number: (R, F), photodiodes of each reference.
    """
    rounding, total = max(noise.shared_rad**2 - common_rad**2, 0.0), number.sum(axis=0)
    common = float((rounding * (number**2).sum(axis=0) / total**2 + noise.own_rad**2 / total).max())
    return sqrt(common), AngleNoise(noise.own_rad, sqrt(common + rounding))
