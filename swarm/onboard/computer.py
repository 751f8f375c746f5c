"""The computer of every craft: from its signals to its knowledge. C craft side by side, each by itself.

    pulses, and the angles that the tracks expect -> decoder -> sweep angles -> navigation, with the images ->
    estimate -> LiDAR scans of observed craft -> estimate

The same computer runs in a flight and on a recording of real light. Its only inputs are its own signals and commands.
With several stations (`StationComputer`) the light becomes rows, and every row is navigated by itself:

    hits or pulses -> rows of all stations -> navigation -> estimate -> ...
"""

from collections.abc import Callable
from functools import partial
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from estimators.arrays import Bools
from swarm.messages import Command, Signals
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


_Decoder = TypeVar("_Decoder", bound=PulseDecoder | BeamDecoder | TurnDecoder)
_Navigation = TypeVar("_Navigation", bound=Navigator | StationNavigator)


class _Onboard(Generic[_Decoder, _Navigation]):
    """Decoder, navigation, inspection and navigators of the user's own of C craft, whatever light they see."""

    def __init__(
        self, decoder: _Decoder, navigator: _Navigation, inspection: Inspection, own: Navigators = NO_NAVIGATORS
    ) -> None:
        """Assemble the parts.

        Args:
            decoder: timing circuits of the craft.
            navigator: navigation of the craft.
            inspection: LiDAR inspection; without observers it does nothing.
            own: navigators of the user, in the place of the filter of some craft.
        """
        self.decoder, self.navigator, self.inspection, self._own = decoder, navigator, inspection, own

    def _restart(self, off: Bools) -> None:
        """Forget everything about the craft of the mask (C,)."""
        self.decoder.forget(off)
        self.navigator.forget(off)
        self._own.forget(off)

    def _known(
        self,
        angles: SweepAngles,
        found: Estimate,
        rows: Callable[[], Rowed],
        signals: Signals,
        command: Command | None,
    ) -> Known:
        """Return all that is known after a period, with the user's navigators and the LiDARs.

        Args:
            angles: decoded sweep angles.
            found: the estimate of the navigation.
            rows: returns the rows that the user's navigators get.
            signals: all signals that the craft receive.
            command: orders of the craft to their actuators for the period.
        """
        estimate = self._own.step(found, rows, self.navigator.tracks, command, signals.epoch_s)
        scans = self.inspection.step(signals.scans, estimate, signals.epoch_s)
        return Known(angles, self.inspection.into(estimate), scans)


class Computer(_Onboard[PulseDecoder, Navigator]):
    """Decoder, navigation and inspection of C craft: `step` takes one period's signals."""

    def step(self, signals: Signals, command: Command | None = None, off: Bools | None = None) -> Known:
        """Advance every craft by one lighthouse period.

        Args:
            signals: all signals that the craft receive.
            command: orders of the craft to their actuators for the period.
            off: craft whose computer is restarting, (C,): they forget everything and see nothing.
        """
        if off is not None and off.any():
            self._restart(off)
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
        return self._known(angles, found, lambda: rows_of(angles, self.navigator.settings), signals, command)


class StationComputer(_Onboard[BeamDecoder | TurnDecoder, StationNavigator]):
    """Decoder, navigation by rows, and inspection of C craft before several stations."""

    def step(self, signals: Signals, command: Command | None = None, off: Bools | None = None) -> Known:
        """Advance every craft by one period.

        Args:
            signals: all signals that the craft receive.
            command: orders of the craft to their actuators for the period.
            off: craft whose computer is restarting, (C,): they forget everything and see nothing.
        """
        if off is not None and off.any():
            self._restart(off)
        navigator = self.navigator
        if isinstance(self.decoder, BeamDecoder):
            if signals.beams is None:
                raise ValueError("Lighthouse 2.0 stations need the signal `beams`")
            light = self.decoder.decode(signals.beams, navigator)
        else:
            light = self.decoder.decode(signals.pulses)
        if off is not None and off.any():
            light = light._replace(rows=light.rows.where(~np.repeat(off, np.diff(light.rows.first))))
        found, angles = navigator.step(light, signals, command), _as_angles(light, navigator.photodiodes)
        return self._known(angles, found, lambda: Rowed(navigator.rows, tuple(navigator.stations)), signals, command)


def _as_angles(light: RowLight, photodiodes: int) -> SweepAngles:
    """Return the light of a period as sweep angles, of which only the photodiodes are told: rows are of many fans."""
    craft = len(light.rejected)
    shape = craft, photodiodes
    theta, offset = np.full((*shape, 2), np.nan), np.zeros((*shape, 2))
    lit = np.zeros(shape, dtype=np.bool_)
    lit[np.repeat(np.arange(craft), np.diff(light.rows.first)), light.rows.photodiode] = True
    none = np.full(craft, -1, dtype=np.int64)
    return SweepAngles(theta, offset, lit, none, light.missed_sync, light.rejected)
