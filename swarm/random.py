"""Random numbers: one seed per run, and an independent stream for everything that is drawn from it.

A stream is named by the run's seed, its purpose, and further numbers, such as the key of the craft that it belongs to.
No other craft, no other purpose and no order of calls changes it. What is drawn once is drawn from streams; what is
drawn in every period has no stream to be started, but numbers without a state (`swarm.draws`).
"""

from collections.abc import Iterable
from enum import Enum
from zlib import crc32

import numpy as np

_LIGHTHOUSE, _CCD = 0x4C48, 0x434344


class Purpose(Enum):
    """The purpose of a stream; its value is the beginning of the stream's spawn key, unique among purposes."""

    SAMPLE = range(0)
    """Values that a study draws; the key of the scenario and the sample follow. An empty tuple would not be kept as the
    value by the enumerations of Python 3.11.2."""
    ALIGNMENT = (0,)
    """Poses and noise of a paper's alignment."""
    START = (0x7374617274,)
    WANDER = (0x77616E646572,)
    DRIFT = (0x6472696674,)
    PUSH = (0x70757368,)
    THRUST = (0x746872757374,)
    LIDAR = (0x6C69646172,)
    FAULT = (0x6661756C74,)
    PLUG_IN = (0x706C7567696E,)
    """Draws of a navigator or a controller of the user."""
    MOUNTING = (_LIGHTHOUSE, 0)
    CLOCK = (_LIGHTHOUSE, 1)
    STATION = (_LIGHTHOUSE, 8)
    """Phase of a station's rotor, and the error of its survey."""
    LIGHT = (_LIGHTHOUSE, 9)
    """Light, its losses and strays: names of craft, rotors and stations follow."""
    CAMERA_MOUNTING = (_CCD, 0)
    IMAGE = (_CCD, 1)
    LOST_IMAGE = (_CCD, 2)
    CAMERA_OUTAGE = (_CCD, 3)


def key(name: str) -> int:
    """Return the number that names a craft, or another object, in its streams; it depends on the name alone."""
    return crc32(name.encode())


def keys(names: Iterable[str]) -> list[int]:
    """Return the `key` of every name."""
    return [key(name) for name in names]


def stream(seed: int, purpose: Purpose, *numbers: int) -> np.random.Generator:
    """Return a new generator at the beginning of a stream.

    Args:
        seed: The run's seed.
        purpose: The purpose of the stream.
        numbers: Further parts of the stream's name, such as the key of a craft, each at least 0.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(*purpose.value, *numbers)))
