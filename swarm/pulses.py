"""What passes through space from the lighthouse to a craft: light pulses, as its timing circuit logs them.

Sensors write `Pulses`, on-board computers read them; neither knows the other. A pulse is the instant at which
a photodiode's output rises, in ticks of that craft's own clock, and how long it stays high.

Sync flashes carry their meaning in their width, as in the Lighthouse 1.0 hardware: (3000 + 500 code) / 48 MHz,
where bit 0 of the code is the fan (0: X, 1: Y), bit 1 one bit of slow data, and bit 2 says that this station
skips the sweep that follows. Sweep pulses are at least ten times shorter.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
