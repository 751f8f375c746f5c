"""Random numbers: one seed per run, and an independent stream for everything that is drawn from it.

A stream is named by the run's seed, its purpose, and further numbers, such as the key of the craft that it belongs to
and the number of a block of frames. No other craft, no other purpose and no order of calls changes it.
"""

from collections.abc import Callable, Iterable
from enum import Enum
from typing import Generic, TypeVar
from zlib import crc32

import numpy as np

T = TypeVar("T")
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
    ROTOR = (_LIGHTHOUSE, 2)
    SYNC = (_LIGHTHOUSE, 3)
    ANGLE = (_LIGHTHOUSE, 4)
    MISSED_SYNC = (_LIGHTHOUSE, 5)
    LOST_PULSE = (_LIGHTHOUSE, 6)
    STRAY_PULSE = (_LIGHTHOUSE, 7)
    STATION = (_LIGHTHOUSE, 8)
    """Phase of a station's rotor, and the error of its survey."""
    SWEEP = (_LIGHTHOUSE, 9)
    """Name of the numbers without a state (`swarm.sensors.draws`) of a station's rotor, or of a craft before it."""
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
        numbers: Further parts of the stream's name, such as the key of a craft and the number of a block, each at
            least 0.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(*purpose.value, *numbers)))


class Blocks(Generic[T]):
    """Draws for whole blocks of frames, so that no frame pays for the start of its streams.

    A frame's draws do not depend on the order of the frames.
    """

    def __init__(self, frames: int, draw: Callable[[int], T]) -> None:
        """Take the number of frames per block, and the function that draws a block by its number."""
        self._frames, self._draw = frames, draw
        self._block = -1
        self._drawn: T

    def at(self, frame: int) -> tuple[T, int]:
        """Return the draws of the block that holds `frame`, and the frame's index in the block."""
        block, place = divmod(frame, self._frames)
        if block != self._block:
            self._block, self._drawn = block, self._draw(block)
        return self._drawn, place
