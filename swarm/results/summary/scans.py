"""The LiDARs' part of a summary, per observer."""

from pathlib import Path
from typing import Any

import numpy as np

from estimators.arrays import Floats
from swarm.results.files import SCANS
from swarm.results.parquet import is_there, read_table
from swarm.results.summary.statistics import Moments, largest, mean, median

_FIGURES = {
    "measured_attitude_mean_deg": ("measured_attitude_error_deg", mean),
    "measured_attitude_max_deg": ("measured_attitude_error_deg", largest),
    "measured_position_mean_m": ("measured_position_error_m", mean),
    "measured_nees_mean": ("measured_nees", mean),
    "ekf_attitude_mean_deg": ("ekf_attitude_error_deg", mean),
    "ekf_attitude_max_deg": ("ekf_attitude_error_deg", largest),
    "ekf_position_mean_m": ("ekf_position_error_m", mean),
    "ekf_nees_mean": ("ekf_nees", mean),
}
"""Per figure: the column of scans.parquet, and its statistic."""


def scans(folder: Path) -> dict[str, Any]:
    """Return the figures of every observer; empty where the run has no scans. Raises SwarmError for a damaged file."""
    if not is_there(folder / SCANS):
        return {}
    table = read_table(folder / SCANS).to_pydict()
    observer = np.array(table["observer"], dtype=object)
    out: dict[str, Any] = {}
    for name in sorted(set(table["observer"])):
        mine = np.flatnonzero(observer == name).tolist()
        outcome = [table["outcome"][i] for i in mine]

        def column(key: str, rows: list[int] = mine) -> Floats:
            return np.array([np.nan if table[key][i] is None else table[key][i] for i in rows], dtype=np.float64)

        out[name] = {
            "target": table["target"][mine[0]],
            "scans": len(mine),
            "tracked_share": outcome.count("tracked") / len(mine),
            "acquisitions": sum(1 for i in mine if table["acquired"][i] and table["outcome"][i] == "found"),
            "outcomes": {word: outcome.count(word) for word in sorted(set(outcome))},
            "points_median": median(column("points")),
            **{figure: of(Moments.of(column(key))) for figure, (key, of) in _FIGURES.items()},
            "inertia": _inertia(table, mine),
        }
    return {"lidar": out}


def _inertia(table: dict[str, list[Any]], rows: list[int]) -> dict[str, Any] | None:
    """Return the target's ratios of inertia as the last of these rows has them; None where none has."""
    known = [i for i in rows if table.get("inertia_observed", [None] * (i + 1))[i] is not None]
    if not known:
        return None
    last = known[-1]
    return {
        "moments": [table[f"inertia_{a}"][last] for a in "123"],
        "sigmas": [table[f"inertia_sigma_{a}"][last] for a in "123"],
        "observed": table["inertia_observed"][last],
    }
