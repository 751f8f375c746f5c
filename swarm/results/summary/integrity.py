"""The part of a summary about the craft's trust in their own poses."""

import numpy as np

from estimators.arrays import Bools, Floats
from swarm.results.summary.statistics import Series, count, largest, mean, total
from swarm.results.table import TelemetryTable


def integrity(rows: TelemetryTable) -> Series:
    """Return the errors against their protection levels, what the residual test did, and the alerts."""
    # A craft also tracks by cameras, or by the sweeps of four photodiodes, in a period whose own pose was refused.
    coupled = "coupling" in rows.columns
    accepted = rows.being("coupling", "loose") if coupled else rows.being("status", "tracking")
    dropped = rows.column("dropped_photodiodes")
    return {
        **_against_levels(rows, "integrity.accepted_poses", "pnp_", accepted),
        **_against_levels(rows, "integrity.estimates", "", np.ones(len(rows), dtype=np.bool_)),
        "integrity.mean_dropped_photodiodes": (mean, np.maximum(dropped, 0)),
        "integrity.failed_residual_test_share": (mean, np.where(np.isfinite(dropped), dropped < 0, np.nan)),
        "integrity.alert_share": (mean, rows.column("alert")),
    }


def levels(rows: TelemetryTable) -> dict[str, Floats]:
    """Return the protection levels of the estimates, which their medians follow from."""
    return {
        f"integrity.{what}_protection_median_{unit}": rows.column(f"{what}_protection_{unit}") for what, unit in _LEVELS
    }


_LEVELS = (("position", "m"), ("attitude", "deg"))


def _against_levels(rows: TelemetryTable, name: str, prefix: str, which: Bools) -> Series:
    """Return how many errors of the columns with this prefix are beyond their levels, among some rows (rows,)."""
    position, attitude = (
        rows.column(f"{prefix}{what}_error_{unit}") / rows.column(f"{prefix}{what}_protection_{unit}")
        for what, unit in _LEVELS
    )
    share = np.where(which, np.fmax(position, attitude), np.nan)
    return {
        f"{name}.samples": (count, share),
        f"{name}.beyond": (total, (share > 1).astype(np.float64)),
        f"{name}.worst_share_of_level": (largest, share),
    }
