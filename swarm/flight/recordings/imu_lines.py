"""Gyroscope and accelerometer of a libsurvive object: its lines, and where CONFIG puts the sensor.

    i mask timecode ax ay az gx gy gz mx my mz number     counts of the sensor
    I mask timecode ax ay az gx gy gz mx my mz number     the same in g and rad/s, scales of CONFIG applied, biases not

libsurvive writes `i` lines unless it is told not to, `I` lines only where it is told to (`record-cal-imu`). One g is
8192 counts on a headset and 4096 on anything else, 500 and 2000 deg/s are 2^15. CONFIG has `acc_scale`, `acc_bias`
[m/s^2], `gyro_scale`, `gyro_bias` [rad/s] and the sensor's pose in the model frame b: as `trackref_from_imu`, or as the
axes and position of `imu`, which may have scales and biases in it. A reading is scale x counts - bias.

What the sensor shows is not what the origin of b does: with r the sensor's place and w the rate,
f_b = f - dw/dt x r - w x (w x r).
"""

import math
from array import array
from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Floats
from swarm.flight.recordings.crazyflie import GRAVITY, Inertial
from swarm.flight.recordings.line_values import as_rows, finite, keep_from, within
from swarm.flight.recordings.object_clock import TICK_S, WRAP, ObjectClock

TOKENS = {"I": (12, 13, 14, 15), "i": (12, 13, 14, 15)}
"""Numbers of words that a line may have: older libsurvive leaves out the magnetometer or the sample's number."""
HEADSET_COUNTS, OTHER_COUNTS = 8192.0, 4096.0
"""Counts of one g."""
HEADSET_DEG_S, OTHER_DEG_S = 500.0, 2000.0
"""Rate of 2^15 counts."""
FASTEST_RAD_S, STRONGEST_G = 70.0, 32.0
"""Readings beyond these are damage: twice what such sensors can show."""
_COLUMNS = 8


class ImuMount(NamedTuple):
    """An object's gyroscope and accelerometer.

    rotation: R_b_i, (3, 3). position: in the model frame (3,) [m]. headset: whether its counts are those of a headset.
    scale, bias: of the accelerometer, [m/s^2], and of the gyroscope, [rad/s], (2, 3) each.
    """

    rotation: Floats
    position: Floats
    headset: bool
    scale: Floats
    bias: Floats


def imu_mount(config: dict[str, Any], pose: tuple[Floats, Floats]) -> ImuMount | None:
    """Return what CONFIG tells of an object's inertial sensors; None where scales or biases make no sense.

    Args:
        config: the JSON of CONFIG.
        pose: R_b_i and the sensor's place in the model frame.
    """
    inner = config.get("imu")
    table = {**config, **inner} if isinstance(inner, dict) else config
    values = []
    for key in ("acc_scale", "gyro_scale", "acc_bias", "gyro_bias"):
        default = 1.0 if key.endswith("scale") else 0.0
        try:
            value = np.array(table.get(key, [default] * 3), dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            return None
        if value.shape != (3,) or not np.isfinite(value).all():
            return None
        values.append(value)
    headset = config.get("device_class") == "hmd"
    return ImuMount(*pose, headset, np.stack(values[:2]), np.stack(values[2:]))


class ImuLines:
    """Collector of one object's lines. Their ticks tell nothing of its clock, but are told by it."""

    def __init__(self, clock: ObjectClock) -> None:
        """Begin without a line; `clock` is the object's."""
        self._clock = clock
        self._rows = array("d")

    def add(self, time_s: float, op: str, token: list[str]) -> None:
        """Take a line; raise ValueError if it is damaged.

        Args:
            time_s: host's time [s].
            op: "I" or "i".
            token: all words of the line.
        """
        counter = within(int(token[4]), 0, WRAP)
        values = [finite(word) for word in token[5:11]]
        if op == "I" and (max(map(abs, values[:3])) > STRONGEST_G or max(map(abs, values[3:])) > FASTEST_RAD_S):
            raise ValueError
        if op == "i" and max(map(abs, values)) > 1 << 15:
            raise ValueError
        tick = self._clock.tick(time_s, counter)
        if tick is not None:
            self._rows.extend((float(op == "I"), tick, *values))

    def any(self) -> bool:
        """Return whether there is a line."""
        return len(self._rows) > 0

    def forget(self, tick: float) -> None:
        """Forget what is older than a tick."""
        keep_from(self._rows, _COLUMNS, 1, tick)

    def inertial(self, mount: ImuMount | None) -> Inertial:
        """Return the readings in the model frame at its origin, their times in ticks; none without a mount."""
        rows = as_rows(self._rows, _COLUMNS)
        ready = rows[:, 0] == 1
        rows = rows[ready] if ready.any() else rows
        _, first = np.unique(rows[:, 1], return_index=True)
        rows = rows[first]
        if mount is None or len(rows) < 2:
            return Inertial(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
        force, rate = rows[:, 2:5], rows[:, 5:8]
        if ready.any():
            force = force * GRAVITY
        else:
            counts, deg_s = (HEADSET_COUNTS, HEADSET_DEG_S) if mount.headset else (OTHER_COUNTS, OTHER_DEG_S)
            force = force * mount.scale[0] * (GRAVITY / counts)
            rate = rate * mount.scale[1] * (math.radians(deg_s) / (1 << 15))
        force, rate = (force - mount.bias[0]) @ mount.rotation.T, (rate - mount.bias[1]) @ mount.rotation.T
        faster = np.gradient(rate, rows[:, 1], axis=0) / TICK_S
        force = force - np.cross(faster, mount.position) - np.cross(rate, np.cross(rate, mount.position))
        return Inertial(rows[:, 1], rate, force)
