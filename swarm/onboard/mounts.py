"""Stations that ride on craft: where they are at every instant of a period, and rows as if they stood still in it.

Where the bearer is known, its motion comes as a signal. Where it tells of its own estimate, the station is where the
bearer predicts itself to be, at the rates of its prediction; without a prediction nobody navigates by the station, and
the bearer itself never does.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from estimators.frame import Frame
from estimators.lighthouse.innovation import RowBatch
from estimators.lighthouse.rows import Station
from estimators.lighthouse.sweep import measured_angles
from estimators.state import State
from swarm.messages import Bearers
from swarm.onboard.tracks import Tracks


class Mount(NamedTuple):
    """A station that rides on a craft: index of the station, index of the craft, frame of the one in that of the other,
    and whether the craft tells where it is by its estimate; if not, it is known.
    """

    station: int
    craft: int
    frame: Frame
    told: bool = False


class Mounts:
    """The stations that ride on craft: `place` once per period."""

    def __init__(self, mounts: Sequence[Mount], point_m: Floats, frame_s: float) -> None:
        """Take the mounts.

        Args:
            mounts: in the order of `Signals.bearers`.
            point_m: photodiodes as the craft assume them, (C, K, 3) [m].
            frame_s: length of a period [s].
        """
        self._mounts, self._point_m, self._frame_s = tuple(mounts), point_m, frame_s

    def __bool__(self) -> bool:
        return bool(self._mounts)

    @property
    def carried(self) -> list[tuple[int, int]]:
        """Stations that stand where a craft tells of itself, with the index of that craft."""
        return [(mount.station, mount.craft) for mount in self._mounts if mount.told]

    def place(self, rows: RowBatch, bearers: Bearers | None, stations: list[Station], tracks: Tracks) -> RowBatch:
        """Place the stations for this period, and return the rows as if they stood still in it.

        With the craft's predicted place p at the instant of a row, T that of the station then and T_0 at the epoch, the
        angle changes by h(T_0^-1 p) - h(T^-1 p): what the bearer's motion within the period does.

        Args:
            rows: of all craft.
            bearers: motion of the bearers.
            stations: all stations; updated.
            tracks: filters, predicted to the epoch.

        Raises:
            ValueError: there is no signal of the bearers.
        """
        if bearers is None:
            raise ValueError("stations that ride on craft need the signal `bearers`")
        active, state, angle = tracks.bank.active, tracks.bank.state, rows.angle.copy()
        craft = np.repeat(np.arange(len(rows.first) - 1), np.diff(rows.first))
        used = np.ones(len(angle), dtype=np.bool_)
        for i, mount in enumerate(self._mounts):
            motion = _Motion(bearers.offset_s, bearers.rotation[:, i], bearers.position[:, i])
            if mount.told:
                own = rows.station == mount.station
                used &= ~(own & (craft == mount.craft)) & (active[mount.craft] | ~own)
                if not active[mount.craft]:
                    continue
                motion = _predicted(state.of(mount.craft), self._frame_s)
            fans = stations[mount.station].fans
            rotation, position = _borne(motion, mount.frame, np.zeros(1))
            stations[mount.station] = Station(rotation[0], position[0], fans)
            who = np.flatnonzero((rows.station == mount.station) & active[craft])
            there = self._places(state, craft[who], rows.photodiode[who], rows.offset_s[who])
            still = (there - position) @ rotation[0]
            rotation, position = _borne(motion, mount.frame, rows.offset_s[who])
            moved = np.swapaxes(rotation, -1, -2) @ (there - position)[..., None]
            change = measured_angles(still, fans) - measured_angles(moved[..., 0], fans)
            own = change[np.arange(len(who)), rows.fan[who]]
            angle[who] += np.where(np.isfinite(own), own, 0.0)
        rows = rows._replace(angle=angle)
        return rows if used.all() else rows.where(used)

    def _places(self, state: State, craft: Ints, photodiode: Ints, offset_s: Floats) -> Floats:
        """Return where photodiodes are expected at instants after the epoch, (N, 3) [m], in the world."""
        turn = rot.exp(state.angular_rate[craft] * offset_s[:, None]) @ state.rotation[craft]
        arm = (turn @ self._point_m[craft, photodiode][..., None])[..., 0]
        out: Floats = state.position[craft] + state.velocity[craft] * offset_s[:, None] + arm
        return out


class _Motion(NamedTuple):
    """Motion of one craft at instants after the epoch, (n + 1,) [s]: rotation (n + 1, 3, 3), position (n + 1, 3)."""

    offset_s: Floats
    rotation: Floats
    position: Floats


def _predicted(state: State, frame_s: float) -> _Motion:
    """Return the motion of a craft at constant rates, from its state without the craft axis."""
    offset_s = np.array([-frame_s / 2, frame_s / 2])
    rotation = rot.exp(state.angular_rate * offset_s[:, None]) @ state.rotation
    return _Motion(offset_s, rotation, state.position + state.velocity * offset_s[:, None])


def _borne(motion: _Motion, frame: Frame, offset_s: Floats) -> tuple[Floats, Floats]:
    """Return where a station is that rides on a craft: rotations (N, 3, 3) and positions (N, 3) [m] in the world.

    Args:
        motion: motion of the craft.
        frame: the station's frame in the craft's.
        offset_s: instants minus the epoch, (N,) [s].
    """
    knot, turns, places = motion
    j = np.clip(np.searchsorted(knot, offset_s, side="right") - 1, 0, len(knot) - 2)
    share = ((offset_s - knot[j]) / (knot[j + 1] - knot[j]))[:, None]
    rotation = rot.exp(share * rot.log(turns[j + 1] @ np.swapaxes(turns[j], -1, -2))) @ turns[j]
    position = places[j] + share * (places[j + 1] - places[j])
    return rotation @ frame.rotation, position + rotation @ frame.position
