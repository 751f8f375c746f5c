"""Telemetry as arrays (periods, craft), which the figures of a run are drawn from."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from swarm.errors import SwarmError
from swarm.results.table import TelemetryTable

MOST_GAPS = 10
"""Periods per row that the telemetry may have, for somebody may have kept a part of the rows."""


class Series:
    """Columns as arrays (periods, craft), NaN where missing. names: of the craft. time_s: (periods,)."""

    def __init__(self, rows: TelemetryTable) -> None:
        """Take the rows of a run."""
        self._rows = rows
        self.names = rows.names_of("craft")
        frame, craft = rows.column("frame"), rows.column("craft")
        if not (np.isfinite(frame).all() and np.isfinite(craft).all()):
            raise SwarmError("the telemetry has rows without a frame or a craft: it was changed, or is damaged")
        if np.ptp(frame) >= MOST_GAPS * len(frame):
            raise SwarmError(
                f"the telemetry's frames go from {frame.min():.0f} to {frame.max():.0f} in {len(frame)} rows"
            )
        self._row = rows.frame - rows.frame.min()
        self.shape = int(self._row.max()) + 1, len(self.names)
        self.time_s: Floats = np.nanmin(self.of("time_s"), axis=1)

    def has(self, column: str) -> bool:
        """Tell whether the run has a column, and a value in it."""
        return column in self._rows.columns and bool(np.isfinite(self._rows.column(column)).any())

    def of(self, column: str) -> Floats:
        """Return one column."""
        return self._grid(self._rows.column(column))

    def being(self, column: str, name: str) -> Bools:
        """Return whether a column of names says `name`, (periods, craft)."""
        out: Bools = self._grid(self._rows.being(column, name)) == 1
        return out

    @property
    def edges_s(self) -> tuple[float, float]:
        """The begin of the first period and the end of the last [s]; of a single period, 10 ms from its epoch."""
        first, last = float(self.time_s[0]), float(self.time_s[-1])
        half = (last - first) / (len(self.time_s) - 1) / 2 if last > first else 0.01
        return first - half, last + half

    @property
    def by_light(self) -> Bools:
        """The periods in which light went into a craft's filter, as a pose or as single sweeps, (periods, craft)."""
        out: Bools = self._grid(self._rows.by_light) == 1
        return out

    def words(self, column: str) -> Sequence[str]:
        """Return what the codes of a column of names stand for."""
        return self._rows.names_of(column)

    def position(self, prefix: str) -> Floats:
        """Return positions (periods, craft, 3) [m]; prefix: "true", "ekf", "reference"."""
        return np.stack([self.of(f"{prefix}_p{axis}_m") for axis in "xyz"], axis=-1)

    @property
    def replayed(self) -> bool:
        """The run is of a recording of real light, without a truth."""
        return "peer_px_m" in self._rows.columns

    @cached_property
    def navigating(self) -> Ints:
        """Indices of the craft that find their own pose: with a sensor of their own."""
        still = set(self._rows.without_sensors)
        return np.array([i for i, name in enumerate(self.names) if name not in still], dtype=np.int64)

    @cached_property
    def lit(self) -> Ints:
        """Indices of the navigating craft but those that are only observed, and never see the lighthouse."""
        seen: Bools = np.asarray((self.of("visible") > 0).any(axis=0))
        observed: Bools = np.zeros(len(seen), dtype=np.bool_)
        if self.has("observer"):
            observed = np.asarray(np.isfinite(self.of("observer")).any(axis=0))
        return np.array([i for i in self.navigating.tolist() if seen[i] or not observed[i]], dtype=np.int64)

    def _grid(self, flat: Floats | Bools) -> Floats:
        out = np.full(self.shape, np.nan)
        out[self._row, self._rows.craft] = flat
        return out
