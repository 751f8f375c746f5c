"""Latency of a replay of lines as they come: the time from each line of light to the estimate that it is in."""

from collections import deque
from typing import Any

import numpy as np

_PER_DECADE = 200
_LEAST_S = 1e-5
_DECADES = 8


class Latency:
    """Latencies of all lines, counted in steps of 1.2 %, so that a run without end takes bounded memory."""

    def __init__(self) -> None:
        """Begin without a line."""
        self._waiting: deque[tuple[float, float]] = deque()
        self._counts = np.zeros(_PER_DECADE * _DECADES, dtype=np.int64)

    def came(self, tick: float, came_s: float) -> None:
        """Note that light of a tick came at a time [s]."""
        self._waiting.append((tick, came_s))

    def told(self, tick: float, now_s: float, since_s: float) -> None:
        """Note that the estimate of all light before a tick is there.

        Args:
            tick: end of that light.
            now_s: time of the estimate [s].
            since_s: lines that came before are not counted [s].
        """
        while self._waiting and self._waiting[0][0] < tick:
            _, came_s = self._waiting.popleft()
            if came_s >= since_s:
                place = _PER_DECADE * np.log10(max(now_s - came_s, _LEAST_S) / _LEAST_S)
                self._counts[min(int(place), len(self._counts) - 1)] += 1

    def summary(self) -> dict[str, Any]:
        """Return the number of lines, and the median, the 99 % point and the maximum [ms], None without a line."""
        total = int(self._counts.sum())
        cumulative = np.cumsum(self._counts)
        out: dict[str, Any] = {"lines_of_light": total}
        for name, share in (("median", 0.5), ("p99", 0.99), ("max", 1.0)):
            place = int(np.searchsorted(cumulative, share * total)) + 0.5
            out[f"latency_{name}_ms"] = round(1e3 * _LEAST_S * 10 ** (place / _PER_DECADE), 3) if total else None
        return out
