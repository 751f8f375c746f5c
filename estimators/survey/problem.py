"""The sparse least-squares problem of a survey: what is unknown, residuals, Jacobian, and the rotor's shared noise.

In *window* w an object has the pose (R, p) at the window's epoch and moves with constant rates (w, v), zero where it
is at rest. Photodiode b that fan f of station s hits tau after the epoch is at q in the station's frame,

    x = p + v tau + Exp([w]x tau) R b,      q = R_s^T (x - t_s)
    y = angle - h_sf(q)                     h: `estimators.lighthouse.sweep`
    dy = -g^T R_s^T (dx_w - dx_s),          g = grad h(q)
    dx_w = -[Exp([w]x tau) R b]x (d + tau dw) + dp + tau dv         the window's, from the left
    dx_s = -[x - t_s]x d_s + dt_s                                   the station's, from the left

(dw's lever turns with the object only to second order in w tau.) g and the derivatives by the fans' terms
(`estimators.survey.terms`) are differences: h is smooth, and one code serves both generations.

Noise of the n rows of one sweep: a^2 I + b^2 1 1^T, the rotor's error b being one draw. Rows are whitened by
(I - c 1 1^T / n) / a with c = 1 - 1 / sqrt(1 + n b^2 / a^2), which is the inverse's root. Rows of an average over many
turns have no shared part left.

Unknowns: (d, dp) of every window and (dw, dv) of the moving ones; (d_s, dt_s) of all stations but the first, whose
pose is the frame; terms that are adjusted, with a prior about their start. Rates have a weak prior about zero, since
hands move so fast and no faster: two stations' light of a small object tells them poorly.

Where another system knows the place m of a marker on the object, l in the object's frame, three rows more,

    y = m - (p + R l),      dy = -(dp - [R l]x d + R dl)

fix frame and scale; l is unknown, with a wide prior, and all stations are free.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy import sparse

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.lighthouse.sweep import Fan, FanErrors, lighthouse_1, lighthouse_2, measured_angles
from estimators.lighthouse.tilted import TiltedErrors
from estimators.survey.terms import TERMS, TYPICAL, Errors, columns, errors_of, numbers

RATE_PRIOR = 3.0
"""Standard deviation of an object's angular rate about each axis [rad/s]."""
VELOCITY_PRIOR = 1.0
"""The same of its velocity along each axis [m/s]."""
LEVER_PRIOR_M = 0.03
"""Standard deviation of a marker's place on its object along each axis [m]."""
BEHIND_RAD = 0.3
"""Residual of a row whose photodiode is not in front of its station, or that its fan never meets."""
_STEP = 1e-6
"""Step of the differences, relative to the distance or, of a term, absolute."""


class Rows(NamedTuple):
    """M sweep angles, (M,) each.

    station, fan, window: indices. point: the photodiode in the object's frame (M, 3) [m]. offset_s: instant after the
    window's epoch. angle: from boresight [rad]. own, shared: standard deviations a and b of the noise [rad]. sweep:
    number of the sweep, the same for rows that share b. photodiode: number, for messages only.
    """

    station: Ints
    fan: Ints
    window: Ints
    point: Floats
    offset_s: Floats
    angle: Floats
    own: Floats
    shared: Floats
    sweep: Ints
    photodiode: Ints

    def of(self, rows: Ints | Bools) -> "Rows":
        """Return some of the rows."""
        return Rows._make(column[rows] for column in self)


@dataclass(frozen=True)
class Room:
    """Poses and terms: what is sought, or a start for it.

    rotation (S, 3, 3), position (S, 3) [m]: R_w_s, t_s of the stations. terms: (S, 2, TERMS). like: their errors at the
    start, which tell the generation. window_rotation (W, 3, 3), window_position (W, 3) [m], rate (W, 3) [rad/s],
    velocity (W, 3) [m/s]: of the object in each window, in the world frame. lever: (B, 3) [m], the markers' places on
    their objects.
    """

    rotation: Floats
    position: Floats
    terms: Floats
    like: tuple[tuple[Errors, Errors], ...]
    window_rotation: Floats
    window_position: Floats
    rate: Floats
    velocity: Floats
    lever: Floats = field(default_factory=lambda: np.zeros((0, 3)))

    def errors(self, station: int) -> tuple[Errors, Errors]:
        """Return the errors of a station's two fans."""
        first, second = (errors_of(self.terms[station, f], self.like[station][f]) for f in (0, 1))
        return first, second

    def fans(self, station: int) -> tuple[Fan, Fan]:
        """Return the two fans of a station."""
        return fans_of(self.errors(station))


def fans_of(errors: tuple[Errors, Errors]) -> tuple[Fan, Fan]:
    """Return the fans of a station with these errors."""
    first, second = errors
    if isinstance(first, TiltedErrors) and isinstance(second, TiltedErrors):
        return lighthouse_2(first, second)
    assert isinstance(first, FanErrors)
    assert isinstance(second, FanErrors)
    return lighthouse_1(first, second)


def generation_of(errors: tuple[Errors, Errors]) -> str:
    """Return the generation of a station with these errors."""
    return "2.0" if isinstance(errors[0], TiltedErrors) else "1.0"


class Truth(NamedTuple):
    """Places of the objects' markers from another system.

    place: (W, 3) [m] at the windows' epochs, NaN where unknown. marker: (W,), number of the marker. sigma_m: standard
    deviation of a coordinate.
    """

    place: Floats
    marker: Ints
    sigma_m: float

    @property
    def markers(self) -> int:
        """Return the number of markers."""
        return int(self.marker.max(initial=-1)) + 1


@dataclass(frozen=True)
class Free:
    """The unknowns that are adjusted. stations: (S,), their poses. windows: whether objects' poses are. parts: names of
    `estimators.survey.terms.PARTS`.
    """

    stations: Bools
    windows: bool = True
    parts: tuple[str, ...] = ()


@dataclass
class Problem:
    """A survey's rows with the windows that move, (W,), what is free, a start, and what another system knows."""

    rows: Rows
    moving: Bools
    free: Free
    start: Room
    truth: Truth | None = None
    term_columns: list[Ints] = field(init=False)

    def __post_init__(self) -> None:
        rows, start = self.rows, self.start
        none = np.zeros(0, dtype=np.int64)
        self.term_columns = [
            columns(self.free.parts, generation_of(like)) if self.free.parts else none for like in start.like
        ]
        self._window_at: Ints = np.full(len(self.moving), -1, dtype=np.int64)
        if self.free.windows:
            width = np.where(self.moving, 12, 6)
            self._window_at = np.concatenate([[0], np.cumsum(width)])[:-1].astype(np.int64)
        at = int(np.sum(np.where(self.moving, 12, 6))) if self.free.windows else 0
        self.shared_at = at
        self._station_at = np.full(len(start.position), -1)
        stations = int(np.count_nonzero(self.free.stations))
        self._station_at[self.free.stations] = at + 6 * np.arange(stations)
        at += 6 * stations
        self._terms_at = np.full(len(start.position), -1)
        for i, wanted in enumerate(self.term_columns):
            if len(wanted):
                self._terms_at[i] = at
                at += 2 * len(wanted)
        self._lever_at = at
        self.size = at + (0 if self.truth is None else 3 * self.truth.markers)
        self.whitening = _whitening(rows)
        self._streams = {
            (s, f): mine
            for s in range(len(start.position))
            for f in (0, 1)
            if len(mine := np.flatnonzero((rows.station == s) & (rows.fan == f)))
        }

    @property
    def station_at(self) -> Ints:
        """Return the first unknown of each station's pose, (S,), -1 where it is held."""
        return self._station_at

    def window_columns(self, window: int) -> Ints:
        """Return the unknowns of a window, none where windows are held."""
        if not self.free.windows:
            return np.zeros(0, dtype=np.int64)
        out: Ints = self._window_at[window] + np.arange(12 if self.moving[window] else 6)
        return out

    def term_sigma(self, shared: Floats) -> Floats:
        """Return standard deviations of the terms (S, 2, TERMS), 0 where not adjusted, of the shared covariance."""
        out = np.zeros_like(self.start.terms)
        for s, wanted in enumerate(self.term_columns):
            if len(wanted):
                at = self._terms_at[s] - self.shared_at
                out[s][:, wanted] = np.sqrt(np.diagonal(shared)[at : at + 2 * len(wanted)]).reshape(2, -1)
        return out

    def take(self, room: Room, step: Floats) -> Room:
        """Return the room after a step of the unknowns, (size,)."""
        rotation, position, terms = room.rotation.copy(), room.position.copy(), room.terms.copy()
        for i in np.flatnonzero(self._station_at >= 0).tolist():
            d = step[self._station_at[i] : self._station_at[i] + 6]
            rotation[i], position[i] = rot.exp(d[:3]) @ rotation[i], position[i] + d[3:]
        for s, wanted in enumerate(self.term_columns):
            if len(wanted):
                d = step[self._terms_at[s] : self._terms_at[s] + 2 * len(wanted)].reshape(2, -1)
                terms[s][:, wanted] += d
        lever = room.lever if self.truth is None else room.lever + step[self._lever_at :].reshape(-1, 3)
        out = replace(room, rotation=rotation, position=position, terms=terms, lever=lever)
        if not self.free.windows:
            return out
        at = self._window_at
        pose = step[at[:, None] + np.arange(6)]
        rate, velocity = room.rate.copy(), room.velocity.copy()
        moving = np.flatnonzero(self.moving)
        rates = step[at[moving][:, None] + np.arange(6, 12)]
        rate[moving] += rates[:, :3]
        velocity[moving] += rates[:, 3:]
        return replace(
            out,
            window_rotation=rot.exp(pose[:, :3]) @ room.window_rotation,
            window_position=room.window_position + pose[:, 3:],
            rate=rate,
            velocity=velocity,
        )

    def residuals(self, room: Room) -> Floats:
        """Return y (M,) [rad], not whitened; `BEHIND_RAD` where a station cannot see the photodiode."""
        _, local = self._places(room)
        return self._compare(self._angles(local, room))

    def linearise(self, room: Room) -> tuple[Floats, sparse.csr_array]:
        """Return y (M,) and its matrix H (M, size), y = H step + noise, both before whitening."""
        rows = self.rows
        arm, local = self._places(room)
        at = self._angles(local, room)
        # Steps along the station's axes, in proportion to the distance.
        step = _STEP * np.linalg.norm(local, axis=1)
        gradient = np.empty_like(local)
        for i in range(3):
            away = local.copy()
            away[:, i] += step
            gradient[:, i] = (self._angles(away, room) - at) / step
        bad = ~np.isfinite(at) | ~np.isfinite(gradient).all(axis=1)
        gradient[bad] = 0.0
        outward = np.einsum("nij,nj->ni", room.rotation[rows.station], gradient)
        parts = self._window_columns(arm, outward) + self._station_columns(local, outward, room)
        parts += self._term_columns(local, at, room)
        row, column, value = (np.concatenate([p[i] for p in parts]) if parts else np.zeros(0) for i in range(3))
        matrix = sparse.coo_array(
            (value, (row.astype(np.int64), column.astype(np.int64))), shape=(len(rows.angle), self.size)
        )
        return self._compare(at), matrix.tocsr()

    def priors(self, room: Room) -> tuple[Floats, sparse.csr_array]:
        """Return what is known of the unknowns beforehand, as whitened rows."""
        own, matrix = self._known_before(room)
        if self.truth is None:
            return own, matrix
        seen, places = self._truth_rows(room, self.truth)
        return np.concatenate([own, seen]), sparse.vstack([matrix, places]).tocsr()

    def _truth_rows(self, room: Room, truth: Truth) -> tuple[Floats, sparse.csr_array]:
        """Return the rows of the markers' places and of their levers' prior, whitened."""
        known = np.flatnonzero(np.isfinite(truth.place).all(axis=1))
        marker = truth.marker[known]
        turn = room.window_rotation[known]
        arm = np.einsum("nij,nj->ni", turn, room.lever[marker])
        away = (truth.place[known] - room.window_position[known] - arm) / truth.sigma_m
        count = 3 * len(known)
        row = np.arange(count)
        unit = np.tile(np.eye(3), (len(known), 1, 1))
        parts = []
        if self.free.windows:
            pose = np.concatenate([-rot.skew(arm), unit], axis=2).reshape(-1, 6) / truth.sigma_m
            parts.append(_block(row, np.repeat(self._window_at[known], 3), pose))
        parts.append(_block(row, self._lever_at + 3 * np.repeat(marker, 3), turn.reshape(-1, 3) / truth.sigma_m))
        levers = 3 * truth.markers
        parts.append(
            (count + np.arange(levers), self._lever_at + np.arange(levers), np.full(levers, 1 / LEVER_PRIOR_M))
        )
        place, column, value = (np.concatenate([p[i] for p in parts]) for i in range(3))
        matrix = sparse.coo_array((value, (place, column)), shape=(count + levers, self.size))
        return np.concatenate([away.ravel(), -room.lever.ravel() / LEVER_PRIOR_M]), matrix.tocsr()

    def _known_before(self, room: Room) -> tuple[Floats, sparse.csr_array]:
        """Return the priors of rates and terms, whitened."""
        y: list[Floats] = []
        columns_: list[Ints] = []
        scale: list[Floats] = []
        if self.free.windows and np.any(self.moving):
            moving = np.flatnonzero(self.moving)
            at = self._window_at[moving]
            for value, offset, wide in ((room.rate, 6, RATE_PRIOR), (room.velocity, 9, VELOCITY_PRIOR)):
                y.append(-value[moving].ravel() / wide)
                columns_.append((at[:, None] + np.arange(offset, offset + 3)).ravel())
                scale.append(np.full(3 * len(moving), 1 / wide))
        for s, wanted in enumerate(self.term_columns):
            if len(wanted):
                sigma = TYPICAL[generation_of(self.start.like[s])][wanted]
                away = (self.start.terms[s][:, wanted] - room.terms[s][:, wanted]) / sigma
                y.append(away.ravel())
                columns_.append(self._terms_at[s] + np.arange(away.size))
                scale.append(np.tile(1 / sigma, 2))
        if not y:
            return np.zeros(0), sparse.csr_array((0, self.size))
        value, column = np.concatenate(scale), np.concatenate(columns_)
        matrix = sparse.coo_array((value, (np.arange(len(value)), column)), shape=(len(value), self.size))
        return np.concatenate(y), matrix.tocsr()

    def _places(self, room: Room) -> tuple[Floats, Floats]:
        """Return the photodiodes' arms at their instants, in the world's axes, and their places in their stations'
        frames, (M, 3) each [m].
        """
        rows = self.rows
        turn = rot.exp(room.rate[rows.window] * rows.offset_s[:, None]) @ room.window_rotation[rows.window]
        arm = np.einsum("nij,nj->ni", turn, rows.point)
        world = arm + room.window_position[rows.window] + room.velocity[rows.window] * rows.offset_s[:, None]
        local = np.einsum("nji,nj->ni", room.rotation[rows.station], world - room.position[rows.station])
        return arm, local

    def _angles(self, local: Floats, room: Room) -> Floats:
        out = np.full(len(local), np.nan)
        for (s, f), mine in self._streams.items():
            out[mine] = measured_angles(local[mine], (room.fans(s)[f],))[:, 0]
        return out

    def _compare(self, angles: Floats) -> Floats:
        y = self.rows.angle - angles
        out: Floats = np.where(np.isfinite(y), y, BEHIND_RAD)
        return out

    def _window_columns(self, arm: Floats, outward: Floats) -> list[tuple[Ints, Ints, Floats]]:
        if not self.free.windows:
            return []
        rows = self.rows
        at = self._window_at[rows.window]
        turned = np.cross(arm, outward)
        pose = np.concatenate([turned, outward], axis=1)
        every = np.arange(len(at))
        out = [_block(every, at, pose)]
        moving = np.flatnonzero(self.moving[rows.window])
        if len(moving):
            out.append(_block(moving, at[moving] + 6, pose[moving] * rows.offset_s[moving][:, None]))
        return out

    def _station_columns(self, local: Floats, outward: Floats, room: Room) -> list[tuple[Ints, Ints, Floats]]:
        rows = self.rows
        mine = np.flatnonzero(self._station_at[rows.station] >= 0)
        from_station = np.einsum("nij,nj->ni", room.rotation[rows.station[mine]], local[mine])
        values = -np.concatenate([np.cross(from_station, outward[mine]), outward[mine]], axis=1)
        return [_block(mine, self._station_at[rows.station[mine]], values)]

    def _term_columns(self, local: Floats, at: Floats, room: Room) -> list[tuple[Ints, Ints, Floats]]:
        out = []
        for s, wanted in enumerate(self.term_columns):
            for f in (0, 1):
                mine = self._streams.get((s, f))
                if mine is None or not len(wanted):
                    continue
                slope = np.empty((len(mine), len(wanted)))
                for i, term in enumerate(wanted.tolist()):
                    terms = room.terms[s, f].copy()
                    terms[term] += _STEP
                    pair = list(room.errors(s))
                    pair[f] = errors_of(terms, room.like[s][f])
                    fan = fans_of((pair[0], pair[1]))[f]
                    slope[:, i] = (measured_angles(local[mine], (fan,))[:, 0] - at[mine]) / _STEP
                slope[~np.isfinite(slope)] = 0.0
                out.append(_block(mine, np.full(len(mine), self._terms_at[s] + f * len(wanted)), slope))
        return out


def room_of(
    stations: Sequence[tuple[Floats, Floats, tuple[Errors, Errors]]], rotation: Floats, position: Floats
) -> Room:
    """Return a room of stations (rotation, position, errors) and of windows at rest.

    Args:
        stations: of each.
        rotation: (W, 3, 3), of the windows.
        position: (W, 3) [m].
    """
    none = np.zeros((len(position), 3))
    return Room(
        np.array([s[0] for s in stations]),
        np.array([s[1] for s in stations]),
        np.array([[numbers(e) for e in s[2]] for s in stations]).reshape(-1, 2, TERMS),
        tuple(s[2] for s in stations),
        rotation,
        position,
        none,
        none.copy(),
    )


def _block(rows: Ints, at: Ints, values: Floats) -> tuple[Ints, Ints, Floats]:
    """Return entries (row, column, value) of values (n, k) in rows (n,) from columns `at` (n,) on."""
    width = values.shape[1]
    return np.repeat(rows, width), (at[:, None] + np.arange(width)).ravel(), values.ravel()


def _whitening(rows: Rows) -> sparse.csr_array:
    """Return the matrix (M, M) that whitens the rows, sweep by sweep."""
    count = len(rows.angle)
    _, group, size = np.unique(rows.sweep, return_inverse=True, return_counts=True)
    n = size[group]
    c = 1 - 1 / np.sqrt(1 + n * (rows.shared / rows.own) ** 2)
    member = sparse.coo_array((np.ones(count), (np.arange(count), group)), shape=(count, len(size))).tocsr()
    mean = sparse.diags_array(c / n / rows.own) @ member @ member.T
    return (sparse.diags_array(1 / rows.own) - mean).tocsr()
