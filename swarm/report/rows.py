"""The rows of a study for its report: finished runs only, as arrays, grouped by what was varied."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from swarm.studies.campaign.study_folder import FinishedStudy
from swarm.studies.campaign.task import COMPLETE


class Spread(NamedTuple):
    """Mean, least and largest over the seeds, at every point; NaN where nothing is known."""

    mean: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True)
class Rows:
    """Finished runs. points: the distinct values of `parameter`, ascending, and which runs have each."""

    columns: dict[str, list[Any]]
    parameter: str
    points: Floats
    members: Sequence[Bools]

    @classmethod
    def of(cls, study: FinishedStudy, parameter: str) -> "Rows":
        """Return the finished runs of a study, by the values of one numeric parameter."""
        columns = finished(study)
        value = as_floats(columns.get(parameter, []))
        points = np.unique(value[np.isfinite(value)])
        return cls(columns, parameter, points, [value == point for point in points])

    def has(self, name: str) -> bool:
        """Tell whether any run knows this figure."""
        return any(value is not None for value in self.columns.get(name, ()))

    def column(self, name: str) -> Floats:
        """Return one figure of all runs, NaN where unknown."""
        return as_floats(self.columns[name]) if name in self.columns else np.full(self.count, np.nan)

    @property
    def count(self) -> int:
        """The number of runs."""
        return len(self.columns["run"])

    def spread(self, name: str, scale: float = 1.0) -> Spread:
        """Return a figure against the parameter, over the runs of each point."""
        value = scale * self.column(name)
        known = [value[chosen & np.isfinite(value)] for chosen in self.members]
        ends = [(v.mean(), v.min(), v.max()) if v.size else (np.nan,) * 3 for v in known]
        mean, low, high = np.array(ends, dtype=np.float64).reshape(-1, 3).T
        return Spread(mean, low, high)


def finished(study: FinishedStudy) -> dict[str, list[Any]]:
    """Return the columns of the runs that were flown."""
    rows = [row for row in study.rows.to_pylist() if row["status"] == COMPLETE]
    return {name: [row[name] for row in rows] for name in study.rows.column_names}


def as_floats(values: Sequence[Any]) -> Floats:
    """Return numbers as an array, NaN for what is none."""
    out: Floats = np.array([v if isinstance(v, int | float) else np.nan for v in values], dtype=np.float64)
    return out
