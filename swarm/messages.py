"""Messages between physics and a craft: light pulses, images and LiDAR scans in, commands and orders out.

Sensors write these records and on-board computers read them; neither imports the other. The light of one period reaches
a craft as `Pulses`: a pulse is the instant at which a photodiode's output rises, in ticks of that craft's own clock,
and the time for which it stays high. Sync flashes carry their meaning in their width, as in the Lighthouse 1.0
hardware: (3000 + 500 code) / 48 MHz, where bit 0 of the code is the fan (0: X, 1: Y), bit 1 is one bit of slow data,
and bit 2 says that this station skips the sweep that follows. Sweep pulses are at least ten times shorter.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints

SYNC_WIDTH_S = 3000 / 48e6
"""Width of a sync flash with code 0 [s]."""
SYNC_WIDTH_STEP_S = 500 / 48e6
"""Additional width of a sync flash per unit of its code [s]."""
FAN_BIT, DATA_BIT, SKIP_BIT = 1, 2, 4


class Pulses(NamedTuple):
    """Pulses of C craft, in order of time, padded to the largest number P per craft.

    photodiode: index into the craft's layout, (C, P) int16.
    rise_tick: rise on the craft's clock, (C, P) int64 [ticks].
    width_tick: width, (C, P) int32 [ticks].
    total: number of pulses that are not padding, (C,) int32.
    """

    photodiode: NDArray[np.int16]
    rise_tick: NDArray[np.int64]
    width_tick: NDArray[np.int32]
    total: NDArray[np.int32]


class BeamHits(NamedTuple):
    """Hits of Lighthouse 2.0 light on C craft, in order of time, padded to the largest number P per craft.

    photodiode: index into the craft's layout, (C, P) int16.
    rise_tick: rise on the craft's clock, (C, P) int64 [ticks].
    width_tick: width, (C, P) int32 [ticks].
    channel: channel that the light's bits tell, from 1, (C, P) int16; 0 where too few were caught.
    offset_tick: middle of the hit after the rotor's zero, by these bits, (C, P) int64 [ticks]; -1 likewise.
    total: number of hits that are not padding, (C,) int32.
    epoch_tick: middle of the period on the craft's clock, by which its computer works, (C,) int64 [ticks].
    """

    photodiode: NDArray[np.int16]
    rise_tick: NDArray[np.int64]
    width_tick: NDArray[np.int32]
    channel: NDArray[np.int16]
    offset_tick: NDArray[np.int64]
    total: NDArray[np.int32]
    epoch_tick: NDArray[np.int64]

    def without(self, dark: Bools) -> "BeamHits":
        """Return the hits but for those in the mask (C, P)."""
        kept = ~dark & (np.arange(dark.shape[1]) < self.total[:, None])
        # Those that remain come first, in their order; what follows them is padding.
        order = np.argsort(~kept, axis=1, kind="stable")
        return BeamHits(
            np.take_along_axis(self.photodiode, order, axis=1),
            np.take_along_axis(self.rise_tick, order, axis=1),
            np.take_along_axis(self.width_tick, order, axis=1),
            np.take_along_axis(self.channel, order, axis=1),
            np.take_along_axis(self.offset_tick, order, axis=1),
            np.count_nonzero(kept, axis=1).astype(np.int32),
            self.epoch_tick,
        )


class Bearers(NamedTuple):
    """Motion over a period of the B craft that stations ride on, one per such station, as these craft tell it.

    offset_s: instants, in order, minus the epoch, (n + 1,) [s].
    rotation: attitudes at these instants, R_w_b, (n + 1, B, 3, 3).
    position: positions at these instants, (n + 1, B, 3) [m].
    """

    offset_s: Floats
    rotation: Floats
    position: Floats


class LightImages(NamedTuple):
    """Images of lights that P camera pairs saw at one epoch, in the order of the scenario's `[craft.ccd]` tables.

    image_m: measured places on the detectors from the optical axis, x right and y down, main camera first,
        (P, 2, L, 2) [m]; NaN where not seen. L is the largest number of lights of any target.
    seen: True where the camera gave an image of the light, (P, 2, L).
    """

    image_m: Floats
    seen: Bools


class LidarScan(NamedTuple):
    """One scan of one craft's LiDAR, whose frame s has its origin in the scanner and its z axis along the spin axis.

    direction: nominal directions of the rays, (N, 3).
    range_m: ranges, NaN without a return, (N,) [m].
    time_s: times of the rays, (N,) [s].
    line: index of the line, (N,).
    step: index along the line, (N,).
    """

    direction: Floats
    range_m: Floats
    time_s: Floats
    line: Ints
    step: Ints


class LidarPattern(NamedTuple):
    """On-board knowledge of a craft's LiDAR.

    rotation: attitude of the scanner in the craft's body frame, R_b_s, (3, 3).
    position: position of the scanner in the craft's body frame, (3,) [m].
    spacing_rad: angle between lines, or between steps if that is larger [rad].
    noise_m: 1 sigma of a range [m].
    period_s: length of a scan [s].
    jitter_rad: 1 sigma of a ray's direction, per axis [rad].
    """

    rotation: Floats
    position: Floats
    spacing_rad: float
    noise_m: float
    period_s: float
    jitter_rad: float = 0.0


class Signals(NamedTuple):
    """All that C craft receive in one lighthouse period.

    pulses: pulses that the timing circuits logged.
    beams: hits of Lighthouse 2.0 stations; None without any.
    bearers: motion of the craft that stations ride on; None without any.
    images: images of the cameras at the epoch; None where no craft has cameras.
    scans: for each LiDAR the scan that was completed in the period; None where none was.
    epoch_s: epoch on the LiDARs' clock [s].
    """

    pulses: Pulses
    images: LightImages | None = None
    scans: Sequence[LidarScan | None] = ()
    epoch_s: float = 0.0
    beams: BeamHits | None = None
    bearers: Bearers | None = None


class Command(NamedTuple):
    """Accelerations that C craft order for one period, lighthouse frame; zero where a craft orders nothing.

    acceleration: linear accelerations, (C, 3) [m/s^2].
    angular_acceleration: angular accelerations, (C, 3) [rad/s^2].
    inertia: (C, 3, 3) [kg m^2], body frame, of craft that order no torque and whose wheels are at rest: they turn
        freely; NaN for the others; None: none of them.
    """

    acceleration: Floats
    angular_acceleration: Floats
    inertia: Floats | None = None

    def only(self, mask: Bools) -> "Command":
        """Return the command of the craft in `mask` (C,), and zero for the others."""
        if mask.all():
            return self
        if not mask.any():
            return Command(np.zeros_like(self.acceleration), np.zeros_like(self.angular_acceleration))
        flat = np.reshape(mask, (-1, 1))
        linear, angular = (np.where(flat, part, 0.0) for part in (self.acceleration, self.angular_acceleration))
        return Command(linear, angular, None if self.inertia is None else np.where(flat[:, None], self.inertia, np.nan))

    def of(self, craft: Ints | slice) -> "Command":
        """Return a copy of the command of some craft, by their indices."""
        inertia = None if self.inertia is None else self.inertia[craft].copy()
        return Command(self.acceleration[craft].copy(), self.angular_acceleration[craft].copy(), inertia)


class Order(NamedTuple):
    """Orders of C craft to their actuators for one period, and the accelerations that they stand for.

    force, torque: force through and torque about the centre of mass, lighthouse frame, (C, 3) [N] and (C, 3) [N m]:
        exactly applied to craft without thrusters or wheels, zero where actuators produce it.
    open_s: times for which the thrusters of the A craft with actuators open, (A, N) [s].
    wheel_torque: torques of the wheels on the craft, (A, W) [N m].
    wheel_momentum: total momentum of the wheels at the end of the period, (A, 3) [N m s], body frame.
    command: accelerations of all C craft.
    """

    force: Floats
    torque: Floats
    open_s: Floats
    wheel_torque: Floats
    wheel_momentum: Floats
    command: Command
