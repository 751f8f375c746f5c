"""The computer of every craft: from its signals to its knowledge. C craft side by side, each by itself.

    pulses, and the angles that the tracks expect -> decoder -> sweep angles -> navigation, with the images ->
    estimate -> LiDAR scans of observed craft -> estimate

The same computer runs in a flight and on a recording of real light. Its only inputs are its own signals and commands.
"""

from typing import NamedTuple

from estimators.arrays import Bools
from swarm.messages import Command, Signals
from swarm.onboard.decoder import PulseDecoder, SweepAngles
from swarm.onboard.inspection import Inspection, LidarFix
from swarm.onboard.navigation import Estimate, Navigator


class Known(NamedTuple):
    """Results of the computers for one period: the sweep angles, the estimate, and the results of the LiDAR scans."""

    angles: SweepAngles
    estimate: Estimate
    scans: list[LidarFix]


class Computer:
    """Decoder, navigation and inspection of C craft: `step` takes one period's signals."""

    def __init__(self, decoder: PulseDecoder, navigator: Navigator, inspection: Inspection) -> None:
        """Assemble the parts.

        Args:
            decoder: timing circuits of the craft.
            navigator: navigation of the craft.
            inspection: LiDAR inspection; without observers it does nothing.
        """
        self.decoder, self.navigator, self.inspection = decoder, navigator, inspection

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
        expected = self.navigator.expected_angles(self.decoder.turn_s)
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
        estimate = self.navigator.step(angles, signals, command)
        scans = self.inspection.step(signals.scans, estimate, signals.epoch_s)
        return Known(angles, self.inspection.into(estimate), scans)
