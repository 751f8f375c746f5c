"""Recordings of an object at rest before two Lighthouse 2.0 stations, of chosen angles, in two formats."""

import json
import math
import struct
import zlib
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from estimators.arrays import Floats

CHANNELS = (3, 11)
TICKS = {3: 949_000, 11: 911_000}
"""Nominal duration of a turn [ticks of 48 MHz]."""
CLOCK = 1 - 9e-6
"""Rate of the object's clock, relative to the stations'."""
BEGIN = 2**32 - 1_400_000
"""First tick: the 32-bit counter wraps in the second turn."""
TURNS = 25
WOBBLE = 4.0
"""Standard deviation of a turn's duration [ticks]."""
ANGLES = {
    3: np.array([[0.21, -0.14], [0.24, -0.11], [0.2, -0.19], [0.26, -0.16]]),
    11: np.array([[-0.62, 0.1], [-0.64, 0.12], [-0.61, 0.08], [-0.66, 0.13]]),
}
"""Sweep angles of each photodiode, plane 0 and plane 1, by channel [rad]."""
DEVICE = "OBJ"


def zeros(channel: int) -> Floats:
    """Return the instants of a rotor's zero [ticks of 48 MHz], TURNS + 1 of them."""
    rng = np.random.default_rng(channel)
    turns = TICKS[channel] * CLOCK + rng.normal(0, WOBBLE, TURNS)
    return BEGIN + 137_000 * (channel % 5) + np.concatenate([[0.0], np.cumsum(turns)])


def share(angle: float, plane: int) -> float:
    """Return the share of a turn at which a plane meets an angle [rad]."""
    return (angle + math.pi + (-1 if plane == 0 else 1) * math.pi / 3) / (2 * math.pi)


def hits(channel: int) -> list[tuple[float, int, int, int]]:
    """Return all hits of a station: instant [ticks of 48 MHz], photodiode, plane, turn."""
    zero = zeros(channel)
    return [
        (zero[n] + share(angle, plane) * (zero[n + 1] - zero[n]), k, plane, n)
        for n in range(TURNS)
        for k, row in enumerate(ANGLES[channel].tolist())
        for plane, angle in enumerate(row)
    ]


def lines() -> list[str]:
    """Return a libsurvive recording's lines."""
    table = {"modelPoints": np.eye(4, 3).tolist(), "modelNormals": [[0, 0, 1]] * 4, "channelMap": [7, 5, 3, 1]}
    head = [f"0.1 {DEVICE} CONFIG {json.dumps({'lighthouse_config': table})}"]
    events: list[tuple[float, str]] = []
    for channel in CHANNELS:
        zero = zeros(channel)
        events += [(at, f"Y {channel} {round(at) % 2**32} {n % 2} 1") for n, at in enumerate(zero.tolist())]
        for at, k, plane, n in hits(channel):
            before = zero[n] - zero[n - 1] if n else TICKS[channel]
            own = 2 * math.pi * (round(at) - round(zero[n])) / before - math.pi + (1, -1)[plane] * math.pi / 3
            events.append((at, f"W {channel} {k} {round(at) % 2**32} {k % 2}"))
            events.append((at, f"B {channel} {k} {round(at) % 2**32} {plane} {own:+.6f}"))
    events.sort(key=lambda event: event[0] // 40_000)
    return head + [f"{1 + (at - BEGIN) / 48e6:.6f} {DEVICE} {text}" for at, text in events]


TYPES = (
    (0, "activeMarkerModeChanged", ("mode(B)",)),
    (1, "lhAngle", ("sensor(B)", "basestation(B)", "sweep(B)", "angle(f)", "correctedAngle(f)")),
    (2, "lhUartFrame", ("sensor(B)", "basestation(B)", "offset(I)", "timestampFPGA(I)")),
    (65535, "fixedFrequency", tuple(f"{what}.{axis}(f)" for what in ("gyro", "acc") for axis in "xyz")),
)
FORMS = {0: "B", 1: "BBBff", 2: "BBII", 65535: "6f"}
SLOW = 1 - 0.011
"""Rate of the Crazyflie's own clock: a real one's."""


def crazyflie_log(
    version: int = 2,
    *,
    frames: bool = True,
    types: tuple[tuple[int, str, tuple[str, ...]], ...] = TYPES,
    forms: Mapping[int, str] = MappingProxyType(FORMS),
    more: Sequence[tuple[float, int, tuple[float, ...]]] = (),
) -> bytes:
    """Return a Crazyflie's event log of the same light: the first pulse of each sweep has no channel.

    Args:
        version: of the format.
        frames: whether raw pulses are logged.
        types: of events: id, name and variables.
        forms: form of the values per type.
        more: further events: time [s], type and values.
    """
    events: list[tuple[float, int, tuple[float, ...]]] = [(0.01, 0, (1,)), (0.4, 0, (0,)), *more]
    events += [(0.01 * i, 65535, (90.0, 0.0, -45.0, 0.0, 0.0, 1.0)) for i in range(20)]
    for channel in CHANNELS:
        zero = zeros(channel)
        blocks: dict[tuple[int, int], list[tuple[float, int]]] = {}
        for at, k, plane, n in hits(channel):
            blocks.setdefault((n, plane), []).append((at, k))
            values: tuple[float, ...] = (k, channel, plane, ANGLES[channel][k, plane], 0.0)
            events.append(((at - BEGIN) / 48e6 + 0.012, 1, values))
        for (n, _), block in blocks.items() if frames else ():
            for i, (at, k) in enumerate(sorted(block)):
                # Ticks of 24 MHz, the offset in steps of four, and only with the second and later pulses.
                stamp, offset = round(at / 2), round((at - zero[n]) / 8) * 4
                known = (channel, offset) if i in (1, 3) else (channel, 0) if i else (2, 0)
                events.append(((at - BEGIN) / 48e6 + 0.002, 2, (k, *known, stamp % 2**24)))
    events.sort(key=lambda event: event[0])
    out = bytearray(struct.pack("<BHH", 0xBC, version, len(types)))
    for number, name, variables in types:
        out += struct.pack("<H", number) + name.encode() + b"\0" + struct.pack("<H", len(variables))
        out += b"".join(variable.encode() + b"\0" for variable in variables)
    for time_s, number, shown in events:
        own_s = 11.0 + time_s * SLOW
        out += struct.pack("<H", number)
        out += struct.pack("<I", round(own_s * 1e3)) if version == 1 else struct.pack("<Q", round(own_s * 1e6))
        out += struct.pack("<" + forms[number], *shown)
    return bytes(out) + struct.pack("<I", zlib.crc32(out))


def system_config(generation: int = 2) -> str:
    """Return a system configuration of the two stations."""
    sweep = "{curve: 0.3, gibmag: -0.004, gibphase: 2.1, ogeemag: -0.3, ogeephase: 1.2, phase: 0.0, tilt: -0.05}"
    text = "calibs:\n"
    for channel in CHANNELS:
        text += f"  {channel}:\n    sweeps:\n    - {sweep}\n    - {sweep}\n    uid: {4000000000 + channel}\n"
    text += "geos:\n"
    for channel in CHANNELS:
        text += f"  {channel}:\n    origin: [1.5, -0.5, 3.0]\n    rotation: [[0, -1, 0], [1, 0, 0], [0, 0, 1]]\n"
    return text + f"systemType: {generation}\ntype: lighthouse_system_configuration\nversion: '1'\n"
