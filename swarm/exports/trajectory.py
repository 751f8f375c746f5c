"""The trajectories of a run: poses of each craft over time, as truth, as the filter's estimate, or otherwise known.

Poses are of the craft's body in the lighthouse frame (x right, y down, z forward), at the epochs of the lighthouse
periods, counted in seconds from the start of the run. Periods in which a pose is not known are left out.
"""

from collections.abc import Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from swarm.errors import SwarmError, did_you_mean
from swarm.results.table import TelemetryTable


class Source(StrEnum):
    """The origin of a pose."""

    TRUTH = "truth"
    ESTIMATE = "estimate"
    SMOOTHED = "smoothed"
    PNP = "pnp"
    PEER = "peer"


PREFIXES = {
    Source.TRUTH: "true",
    Source.ESTIMATE: "ekf",
    Source.SMOOTHED: "smooth",
    Source.PNP: "pnp",
    Source.PEER: "peer",
}
"""Beginnings of the telemetry's columns."""
MEANINGS = {
    Source.TRUTH: "the truth",
    Source.ESTIMATE: "the estimate of the craft's own filter",
    Source.SMOOTHED: "the smoothed estimate",
    Source.PNP: "the pose of the light of one period alone",
    Source.PEER: "the pose that came with the recording",
}
WITHOUT = {
    Source.TRUTH: "a replay has no truth",
    Source.SMOOTHED: "swarm smooth makes it",
    Source.PEER: "only a replay has it",
}
"""Why a run may not have a source."""
USUAL = (Source.TRUTH, Source.ESTIMATE)
SIGMAS = ("position_sigma_m", "attitude_sigma_deg")
"""Columns of the standard deviations of an estimate."""


class Trajectory(NamedTuple):
    """Poses of one craft from one source.

    frame: numbers of the periods (n,). time_s: (n,). position: (n, 3) [m]. quaternion: wxyz, (n, 4). velocity: (n, 3)
    [m/s]; angular_rate: (n, 3) [rad/s], both in the lighthouse frame, None where the source has none. sigma: standard
    deviations of position [m] and attitude [deg], (n, 2), None where it has none.
    """

    craft: str
    source: Source
    frame: Ints
    time_s: Floats
    position: Floats
    quaternion: Floats
    velocity: Floats | None
    angular_rate: Floats | None
    sigma: Floats | None

    def part(self, rows: Ints | Bools | slice) -> "Trajectory":
        """Return some of the rows."""
        return self._replace(
            frame=self.frame[rows],
            time_s=self.time_s[rows],
            position=self.position[rows],
            quaternion=self.quaternion[rows],
            velocity=None if self.velocity is None else self.velocity[rows],
            angular_rate=None if self.angular_rate is None else self.angular_rate[rows],
            sigma=None if self.sigma is None else self.sigma[rows],
        )

    def stretches(self) -> "Iterator[Trajectory]":
        """Yield the parts between gaps, in each of which every period has a pose."""
        if not len(self.frame):
            return
        for rows in np.split(np.arange(len(self.frame)), np.flatnonzero(np.diff(self.frame) > 1) + 1):
            yield self.part(rows)


class Trajectories:
    """The trajectories of a run."""

    def __init__(self, folder: Path, craft: Sequence[str] = ()) -> None:
        """Read the run in `folder`; craft: only these. Raises SwarmError where there is no such craft, or no row."""
        self._table = TelemetryTable.of_run(folder)
        if not len(self._table):
            raise SwarmError(f"{folder} has not one lighthouse period recorded: there is nothing to export")
        names = self._table.names_of("craft")
        for name in craft:
            if name not in names:
                raise SwarmError(f"--craft: no craft {name!r} in {folder}{did_you_mean(name, names)}")
        self.craft = list(dict.fromkeys(craft)) or names
        index = {name: i for i, name in enumerate(names)}
        order = np.argsort(self._table.craft, kind="stable")
        edges = np.searchsorted(self._table.craft[order], np.arange(len(names) + 1))
        self._rows = {name: order[edges[index[name]] : edges[index[name] + 1]] for name in self.craft}
        self._folder = folder

    def sources(self, wanted: Sequence[Source]) -> list[Source]:
        """Return the sources to export: those that are wanted, or else truth and estimate as far as there are such.

        Raises SwarmError where the run does not have one that is wanted, or none at all.
        """
        found = [source for source in (wanted or USUAL) if self._has(source)]
        for source in wanted:
            if source not in found:
                why = f": {WITHOUT[source]}" if source in WITHOUT else ""
                raise SwarmError(f"--what: {self._folder} has no {source}{why}")
        if not found:
            raise SwarmError(f"{self._folder} has neither truth nor estimate: there is nothing to export")
        return list(dict.fromkeys(found))

    def of(self, craft: str, source: Source) -> Trajectory:
        """Return the known poses of a craft, perhaps none."""
        prefix, rows = PREFIXES[source], self._rows[craft]
        position, quaternion = self._table.position(prefix)[rows], self._table.quaternion(prefix)[rows]
        sigma = tuple(f"smooth_{name}" if source is Source.SMOOTHED else name for name in SIGMAS)
        found = Trajectory(
            craft,
            source,
            self._table.frame[rows],
            self._table.column("time_s")[rows],
            position,
            quaternion,
            self._stacked(rows, *(f"{prefix}_v{axis}_m_s" for axis in "xyz")),
            self._stacked(rows, *(f"{prefix}_w{axis}_rad_s" for axis in "xyz")),
            self._stacked(rows, *sigma) if source in (Source.ESTIMATE, Source.SMOOTHED) else None,
        )
        known = np.isfinite(np.concatenate([position, quaternion], axis=1)).all(axis=1)
        return found.part(np.flatnonzero(known))

    def _has(self, source: Source) -> bool:
        column = f"{PREFIXES[source]}_px_m"
        return column in self._table.columns and bool(np.isfinite(self._table.column(column)).any())

    def _stacked(self, rows: Ints, *names: str) -> Floats | None:
        return self._table.stacked(*names)[rows] if set(names) <= set(self._table.columns) else None
