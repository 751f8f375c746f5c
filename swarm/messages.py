"""Everything that passes between physics and a craft: light pulses, images and LiDAR scans in, commands and orders out.

Sensors write these records and on-board computers read them; neither knows the other. One period's light reaches a
craft as `Pulses`: a pulse is the instant at which a photodiode's output rises, in ticks of that craft's own clock, and
the time that it stays high. Sync flashes carry their meaning in their width, as in the Lighthouse 1.0 hardware: (3000 +
500 code) / 48 MHz, where bit 0 of the code is the fan (0: X, 1: Y), bit 1 is one bit of slow data, and bit 2 says that
this station skips the sweep that follows. Sweep pulses are at least ten times shorter.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints

SYNC_WIDTH_S = 3000 / 48e6
"""Width of a sync flash with code 0 [s]."""
SYNC_WIDTH_STEP_S = 500 / 48e6
"""How much longer the flash is per unit of its code [s]."""
FAN_BIT, DATA_BIT, SKIP_BIT = 1, 2, 4


class Pulses(NamedTuple):
    """Pulses of C craft, in order of time, padded to the busiest craft's number P.

    photodiode: (C, P) int16, index into the craft's layout. rise_tick: (C, P) int64, ticks of the craft's clock.
    width_tick: (C, P) int32 [ticks]. total: (C,) int32, how many of the P are real.
    """

    photodiode: NDArray[np.int16]
    rise_tick: NDArray[np.int64]
    width_tick: NDArray[np.int32]
    total: NDArray[np.int32]


def no_pulses(craft: int) -> Pulses:
    """Return the pulses of `craft` craft that saw no light."""
    return Pulses(
        np.zeros((craft, 0), dtype=np.int16),
        np.zeros((craft, 0), dtype=np.int64),
        np.zeros((craft, 0), dtype=np.int32),
        np.zeros(craft, dtype=np.int32),
    )


class LightImages(NamedTuple):
    """The lights that P pairs of cameras saw at one epoch, in the order of the scenario's `[craft.ccd]` tables.

    image_m: (P, 2, L, 2) [m], main camera first, x right and y down on the detector, from the optical axis, as
    measured; NaN where not seen. seen: (P, 2, L), whether the camera gave an image of the light; L lights, padded to
    the target that has most.
    """

    image_m: Floats
    seen: Bools


class LidarScan(NamedTuple):
    """One scan of one craft's LiDAR, whose frame s has its origin in the scanner and its z axis as the spin axis.

    direction: (N, 3), where the rays were meant to go. range_m: (N,) [m], NaN where nothing came back. time_s: (N,)
    [s], when. line, step: (N,), which of the lines, and the number along it.
    """

    direction: Floats
    range_m: Floats
    time_s: Floats
    line: Ints
    step: Ints


class LidarPattern(NamedTuple):
    """What a craft's computer knows of its LiDAR. rotation: (3, 3) R_b_s, position: (3,) [m], of the scanner in the
    craft's body. spacing_rad: between lines, or steps if that is more. noise_m: 1 sigma of a range. period_s: of
    a scan.
    """

    rotation: Floats
    position: Floats
    spacing_rad: float
    noise_m: float
    period_s: float


class Signals(NamedTuple):
    """Everything that C craft learn from outside in one lighthouse period.

    pulses: what the timing circuits logged. images: what the cameras saw at the epoch; None where no craft has any.
    scans: of each LiDAR the scan that was completed in the period, None where none was. epoch_s: the epoch on the
    LiDARs' clock [s].
    """

    pulses: Pulses
    images: LightImages | None = None
    scans: Sequence[LidarScan | None] = ()
    epoch_s: float = 0.0


class Command(NamedTuple):
    """The accelerations that C craft order for one period: acceleration (C, 3) [m/s^2] and angular_acceleration (C, 3)
    [rad/s^2], lighthouse frame; zero where a craft orders nothing.
    """

    acceleration: Floats
    angular_acceleration: Floats

    def only(self, mask: Bools) -> "Command":
        """Return the command of the craft in `mask` (C,), and zero for the rest."""
        flat = np.reshape(mask, (-1, 1))
        return Command(np.where(flat, self.acceleration, 0.0), np.where(flat, self.angular_acceleration, 0.0))


class Order(NamedTuple):
    """What C craft order their actuators to do in one period, and the accelerations that this stands for.

    force: (C, 3) [N] through, and torque: (C, 3) [N m] about the centre of mass, lighthouse frame: what craft without
    thrusters or wheels get exactly; zero where actuators make it. open_s: (A, N) [s], the time for which each thruster
    of the A craft with actuators opens. wheel_torque: (A, W) [N m] on the craft. wheel_momentum: (A, 3) [N m s], body
    frame, of the wheels at the end of the period. command: of all C craft.
    """

    force: Floats
    torque: Floats
    open_s: Floats
    wheel_torque: Floats
    wheel_momentum: Floats
    command: Command
