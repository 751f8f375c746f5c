"""The motion `waypoints`."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

from pydantic import Field, Strict

from swarm.scenario.motions.base import Place, Turned
from swarm.scenario.motions.paths import Path, smooth_through
from swarm.scenario.table import Mistake, Time, Vector


class Waypoints(Turned):
    """The craft passes smoothly through points at given times, from rest to rest, and stays at the last point."""

    starts_at: ClassVar[str] = "points_m"

    kind: Literal["waypoints"] = Field(description="The craft passes through points at given times.")
    points_m: Annotated[tuple[Vector, ...], Strict(False)] = Field(min_length=1, description="Points, in order.")
    times_s: Annotated[tuple[Time, ...], Strict(False)] = Field(
        min_length=1, description="Times at the points, one per point, strictly increasing."
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Require one time per point, in order."""
        if len(self.times_s) != len(self.points_m):
            yield f"has {len(self.times_s)} times for {len(self.points_m)} points_m", "times_s", "points_m"
        for i, (before, after) in enumerate(pairwise(self.times_s), start=1):
            if after <= before:
                yield f"must increase strictly: times_s[{i}] = {after} follows {before}", "times_s"

    def path(self, place: Place) -> Path:
        """Return the smooth way through the points."""
        return smooth_through(self.points_m, self.times_s)
