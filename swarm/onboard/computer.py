"""The computer of every craft: from its signals to its knowledge. C craft side by side, each by itself.

    pulses, and the angles that the tracks expect -> decoder -> sweep angles -> navigation, with the images ->
    estimate -> LiDAR scans of observed craft -> estimate

The same computer runs in a flight and on a recording of real light. Its only inputs are its own signals and commands.
With several stations (`StationComputer`) the light becomes rows, and every row is navigated by itself:

    hits or pulses -> rows of all stations -> navigation -> estimate -> ...
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.frame import Frame
from estimators.lighthouse.innovation import RowBatch
from estimators.lighthouse.rows import Station, expect_into
from estimators.lighthouse.sweep import measured_angles
from swarm.messages import Bearers, Command, Signals
from swarm.onboard.beams import BeamDecoder
from swarm.onboard.decoder import PulseDecoder, SweepAngles
from swarm.onboard.inspection import Inspection, LidarFix
from swarm.onboard.navigation import Estimate, Navigator
from swarm.onboard.own_navigators import NO_NAVIGATORS, Navigators, Rowed, rows_of
from swarm.onboard.stations import RowLight, StationNavigator
from swarm.onboard.turns import TurnDecoder


class Known(NamedTuple):
    """Results of the computers for one period: the sweep angles, the estimate, and the results of the LiDAR scans."""

    angles: SweepAngles
    estimate: Estimate
    scans: list[LidarFix]


class Computer:
    """Decoder, navigation and inspection of C craft: `step` takes one period's signals."""

    def __init__(
        self, decoder: PulseDecoder, navigator: Navigator, inspection: Inspection, own: Navigators = NO_NAVIGATORS
    ) -> None:
        """Assemble the parts.

        Args:
            decoder: timing circuits of the craft.
            navigator: navigation of the craft.
            inspection: LiDAR inspection; without observers it does nothing.
            own: navigators of the user, in the place of the filter of some craft.
        """
        self.decoder, self.navigator, self.inspection, self._own = decoder, navigator, inspection, own

    def step(self, signals: Signals, command: Command | None = None, off: Bools | None = None) -> Known:
        """Advance every craft by one lighthouse period.

        Args:
            signals: all signals that the craft receive.
            command: orders of the craft to their actuators for the period.
            off: craft whose computer is restarting, (C,): they forget everything and see nothing.
        """
        if off is not None and off.any():
            self.decoder.forget(off)
            self.navigator.forget(off)
            self._own.forget(off)
        expected = partial(self.navigator.expected_angles, self.decoder.turn_s)
        angles = self.decoder.decode(signals.pulses, expected)
        if off is not None:
            angles = angles._replace(lit=angles.lit & ~off[:, None])
        return self.navigate(angles, signals, command)

    def navigate(self, angles: SweepAngles, signals: Signals, command: Command | None = None) -> Known:
        """Advance every craft by one period whose pulses have been decoded already.

        Args:
            angles: decoded sweep angles.
            signals: all signals that the craft receive; the pulses are not used.
            command: orders of the craft to their actuators for the period.
        """
        found = self.navigator.step(angles, signals, command)
        estimate = self._own.step(
            found, lambda: rows_of(angles, self.navigator.settings), self.navigator.tracks, command, signals.epoch_s
        )
        scans = self.inspection.step(signals.scans, estimate, signals.epoch_s)
        return Known(angles, self.inspection.into(estimate), scans)


class Mount(NamedTuple):
    """A station that rides on a craft: its index, and its frame in the craft's."""

    station: int
    frame: Frame


class StationComputer:
    """Decoder, navigation by rows, and inspection of C craft before several stations."""

    def __init__(
        self,
        decoder: BeamDecoder | TurnDecoder,
        navigator: StationNavigator,
        inspection: Inspection,
        stations: Sequence[Station],
        point_m: Floats,
        mounts: Sequence[Mount] = (),
        own: Navigators = NO_NAVIGATORS,
    ) -> None:
        """Assemble the parts.

        Args:
            decoder: circuits of the craft.
            navigator: navigation of the craft.
            inspection: LiDAR inspection; without observers it does nothing.
            stations: the stations as the craft know them.
            point_m: photodiodes as the craft assume them, (C, K, 3) [m].
            mounts: those that ride on craft, in the order of `Signals.bearers`.
            own: navigators of the user, in the place of the filter of some craft.
        """
        self.decoder, self.navigator, self.inspection, self._own = decoder, navigator, inspection, own
        self._stations, self._mounts, self._point_m = list(stations), tuple(mounts), point_m

    def step(self, signals: Signals, command: Command | None = None, off: Bools | None = None) -> Known:
        """Advance every craft by one period.

        Args:
            signals: all signals that the craft receive.
            command: orders of the craft to their actuators for the period.
            off: craft whose computer is restarting, (C,): they forget everything and see nothing.
        """
        if off is not None and off.any():
            self.decoder.forget(off)
            self.navigator.forget(off)
            self._own.forget(off)
        if isinstance(self.decoder, BeamDecoder):
            if signals.beams is None:
                raise ValueError("Lighthouse 2.0 stations need the signal `beams`")
            light = self.decoder.decode(signals.beams, self._expect)
        else:
            light = self.decoder.decode(signals.pulses)
        if off is not None and off.any():
            light = light._replace(rows=light.rows.where(~np.repeat(off, np.diff(light.rows.first))))
        if self._mounts:
            light = light._replace(rows=self._ridden(light.rows, signals.bearers))
        found = self.navigator.step(light, signals, command)
        estimate = self._own.step(
            found, lambda: Rowed(light.rows, tuple(self._stations)), self.navigator.tracks, command, signals.epoch_s
        )
        scans = self.inspection.step(signals.scans, estimate, signals.epoch_s)
        return Known(_as_angles(light, self._point_m.shape[1]), self.inspection.into(estimate), scans)

    def _ridden(self, rows: RowBatch, bearers: Bearers | None) -> RowBatch:
        """Place the stations that ride on craft for this period, and return the rows as if they stood still in it.

        With the craft's predicted place p at the instant of a row, T that of the station then and T_0 at the epoch, the
        angle changes by h(T_0^-1 p) - h(T^-1 p): what the bearer's motion within the period does.
        """
        if bearers is None:
            raise ValueError("stations that ride on craft need the signal `bearers`")
        active, angle = self.navigator.tracks.bank.active, rows.angle.copy()
        craft = np.repeat(np.arange(len(rows.first) - 1), np.diff(rows.first))
        for i, (station, frame) in enumerate(self._mounts):
            fans = self._stations[station].fans
            rotation, position = _borne(bearers, i, frame, np.zeros(1))
            self._stations[station] = Station(rotation[0], position[0], fans)
            who = np.flatnonzero((rows.station == station) & active[craft])
            there = self._places(craft[who], rows.photodiode[who], rows.offset_s[who])
            still = (there - position) @ rotation[0]
            rotation, position = _borne(bearers, i, frame, rows.offset_s[who])
            moved = np.swapaxes(rotation, -1, -2) @ (there - position)[..., None]
            change = measured_angles(still, fans) - measured_angles(moved[..., 0], fans)
            own = change[np.arange(len(who)), rows.fan[who]]
            angle[who] += np.where(np.isfinite(own), own, 0.0)
        self.navigator.stations = self._stations
        return rows._replace(angle=angle)

    def _expect(self, craft: Ints, station: Ints, photodiode: Ints, offset_s: Floats) -> Floats:
        """Return where hits are expected, as `BeamDecoder.decode` asks for: (N, 2) [rad]."""
        out = np.empty((len(craft), 2))
        expect_into(
            (craft, station, photodiode, offset_s + self.navigator.settings.frame_s),
            self.navigator.tracks.bank.state,
            self._point_m,
            self.navigator.packed,
            out,
        )
        return out

    def _places(self, craft: Ints, photodiode: Ints, offset_s: Floats) -> Floats:
        """Return where photodiodes are expected at instants after the epoch to come, (N, 3) [m], in the world."""
        state = self.navigator.tracks.bank.state
        later = offset_s[:, None] + self.navigator.settings.frame_s
        turn = rot.exp(state.angular_rate[craft] * later) @ state.rotation[craft]
        arm = (turn @ self._point_m[craft, photodiode][..., None])[..., 0]
        out: Floats = state.position[craft] + state.velocity[craft] * later + arm
        return out


def _borne(bearers: Bearers, number: int, frame: Frame, offset_s: Floats) -> tuple[Floats, Floats]:
    """Return where a station is that rides on a craft: rotations (N, 3, 3) and positions (N, 3) [m] in the world.

    Args:
        bearers: motion of the craft.
        number: which of them.
        frame: the station's frame in the craft's.
        offset_s: instants minus the epoch, (N,) [s].
    """
    knot, turns, places = bearers.offset_s, bearers.rotation[:, number], bearers.position[:, number]
    j = np.clip(np.searchsorted(knot, offset_s, side="right") - 1, 0, len(knot) - 2)
    share = ((offset_s - knot[j]) / (knot[j + 1] - knot[j]))[:, None]
    rotation = rot.exp(share * rot.log(turns[j + 1] @ np.swapaxes(turns[j], -1, -2))) @ turns[j]
    position = places[j] + share * (places[j + 1] - places[j])
    return rotation @ frame.rotation, position + rotation @ frame.position


def _as_angles(light: RowLight, photodiodes: int) -> SweepAngles:
    """Return the light of a period as sweep angles, of which only the photodiodes are told: rows are of many fans."""
    craft = len(light.rejected)
    shape = craft, photodiodes
    theta, offset = np.full((*shape, 2), np.nan), np.zeros((*shape, 2))
    lit = np.zeros(shape, dtype=np.bool_)
    lit[np.repeat(np.arange(craft), np.diff(light.rows.first)), light.rows.photodiode] = True
    none = np.full(craft, -1, dtype=np.int64)
    return SweepAngles(theta, offset, lit, none, light.missed_sync, light.rejected)
