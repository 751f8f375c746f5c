"""The schedule of faults: the `[[fault]]` tables of a scenario as windows of lighthouse periods.

A fault is on in the periods that begin within [from, to). For random faults, the gaps between the end of a fault and
its next onset are exponential with the given rate, from a separate stream for every fault and craft: the draws for one
are independent of the other craft and faults.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from swarm import random
from swarm.random import Purpose
from swarm.scenario.faults import KINDS, AnyFault, OfCraft

NONE = "none"
"""Name of the state without a fault."""


class Window(NamedTuple):
    """One fault of one craft, or of the lighthouse (craft -1), in the periods first ... past - 1.

    number: index of the fault in the scenario.
    """

    fault: AnyFault
    number: int
    craft: int
    first: int
    past: int


class Schedule:
    """All windows of a run."""

    def __init__(
        self,
        faults: Sequence[AnyFault],
        names: Sequence[str],
        keys: Sequence[int],
        seed: int,
        rate_hz: float,
        end_s: float,
    ) -> None:
        """Draw the windows of all faults.

        Args:
            faults: faults of the scenario.
            names: names of the craft.
            keys: number of each craft's random streams, independent of the craft's index.
            seed: seed of the run.
            rate_hz: lighthouse periods per second [Hz].
            end_s: length of the run [s].
        """
        self._craft = len(names)
        self.windows: list[Window] = []
        for number, fault in enumerate(faults):
            for craft in _struck(fault, names):
                key = keys[craft] if craft >= 0 else 0
                spans = _spans(fault, random.stream(seed, Purpose.FAULT, number, key), end_s)
                for from_s, to_s in spans:
                    # A time on a period's edge belongs to the period that begins there, despite rounding.
                    first, past = (int(np.ceil(time_s * rate_hz - 1e-6)) for time_s in (from_s, to_s))
                    self.windows.append(Window(fault, number, craft, first, max(past, first + 1)))
        self._first = np.array([window.first for window in self.windows], dtype=np.int64)
        self._past = np.array([window.past for window in self.windows], dtype=np.int64)
        changes = np.unique(np.concatenate([[0], self._first, self._past]))
        codes = {int(code) for frame in changes for code in self._bits(int(frame))}
        self._codes = np.array(sorted(codes | {0}), dtype=np.int64)
        self.names = tuple(_name(int(code)) for code in self._codes)
        """Names of the combinations of faults that a craft may have at one time, "none" first."""

    def at(self, frame: int) -> list[Window]:
        """Return the windows that contain a period, in the order of the scenario."""
        return [self.windows[i] for i in np.flatnonzero((self._first <= frame) & (frame < self._past))]

    def states(self, frame: int) -> Ints:
        """Return the index in `names` of every craft's faults, (C,)."""
        out: Ints = np.searchsorted(self._codes, self._bits(frame))
        return out

    def _bits(self, frame: int) -> Ints:
        bits = np.zeros(self._craft, dtype=np.int64)
        for window in self.at(frame):
            bit = 1 << KINDS.index(window.fault.kind)
            bits[slice(None) if window.craft < 0 else window.craft] |= bit
        return bits


def _name(code: int) -> str:
    return " + ".join(kind for i, kind in enumerate(KINDS) if code >> i & 1) or NONE


def _struck(fault: AnyFault, names: Sequence[str]) -> Iterable[int]:
    if not isinstance(fault, OfCraft):
        return (-1,)
    return [names.index(name) for name in dict.fromkeys(fault.craft)] if fault.craft else range(len(names))


def _spans(fault: AnyFault, stream: np.random.Generator, end_s: float) -> list[tuple[float, float]]:
    """Return the beginnings and ends [s] of a fault within the run."""
    length_s: float | None = fault.for_s
    until_s: float | None = getattr(fault, "until_s", None)
    if fault.at_s is not None:
        to_s = until_s if until_s is not None else np.inf if length_s is None else fault.at_s + length_s
        return [(fault.at_s, min(to_s, end_s))] if fault.at_s < end_s else []
    assert fault.probability_per_s is not None
    time_s = 0.0
    spans: list[tuple[float, float]] = []
    while True:
        time_s += stream.exponential(1 / fault.probability_per_s)
        if time_s >= end_s:
            return spans
        to_s = end_s if length_s is None else min(time_s + length_s, end_s)
        spans.append((time_s, to_s))
        time_s = to_s


def speed_swing(time_s: Floats | float, length_s: float, amplitude: float) -> tuple[Floats, Floats]:
    """Return speed error and phase [s] of a rotor whose speed swings once, as a sine: see `RotorDrift`.

    With d = amplitude sin(2 pi t / length) the rotor runs ahead by the integral of d: its zero comes that much sooner.

    Args:
        time_s: time t since the beginning of the swing [s].
        length_s: length of the swing [s].
        amplitude: largest relative speed error.
    """
    angle = 2 * np.pi * np.asarray(time_s) / length_s
    return amplitude * np.sin(angle), -amplitude * length_s / (2 * np.pi) * (1 - np.cos(angle))
