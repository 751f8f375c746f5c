"""The computer of every craft: its signals in, what it knows out. C craft side by side, each by itself.

    pulses -> decoder -> sweep angles -> navigation, with the images -> estimate -> LiDAR scans of observed craft ->
    estimate

The same computer runs in a flight and on a recording of real light. It is told nothing but its own signals and
commands.
"""

from typing import NamedTuple

from estimators.arrays import Bools
from swarm.messages import Command, Signals
from swarm.onboard.decoder import PulseDecoder, SweepAngles
from swarm.onboard.inspection import Inspection, LidarFix
from swarm.onboard.navigation import Estimate, Navigator


class Known(NamedTuple):
    """What the computers made of one period: the sweep angles, the estimate, and what became of the LiDAR scans."""

    angles: SweepAngles
    estimate: Estimate
    scans: list[LidarFix]


class Computer:
    """Decoder, navigation and inspection of C craft: `step` takes one period's signals."""

    def __init__(self, decoder: PulseDecoder, navigator: Navigator, inspection: Inspection) -> None:
        """Put the parts together; an inspection without observers is one that does nothing."""
        self.decoder, self.navigator, self.inspection = decoder, navigator, inspection

    def step(self, signals: Signals, command: Command | None = None, off: Bools | None = None) -> Known:
        """Advance every craft by one lighthouse period.

        Args:
            signals: everything that the craft learn from outside.
            command: what the craft ordered their actuators to do in the period.
            off: (C,), the craft whose computer is starting again: they forget all and see nothing.
        """
        if off is not None and off.any():
            self.decoder.forget(off)
            self.navigator.forget(off)
        angles = self.decoder.decode(signals.pulses)
        if off is not None:
            angles = angles._replace(lit=angles.lit & ~off[:, None])
        return self.navigate(angles, signals, command)

    def navigate(self, angles: SweepAngles, signals: Signals, command: Command | None = None) -> Known:
        """Advance every craft by one period whose pulses have been decoded already; arguments as of `step`."""
        estimate = self.navigator.step(angles, signals.images, command)
        scans = self.inspection.step(signals.scans, estimate, signals.epoch_s)
        return Known(angles, self.inspection.into(estimate), scans)
