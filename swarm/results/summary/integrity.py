"""The part of a summary about the craft's trust in their own poses."""

from typing import Any

import numpy as np

from estimators.arrays import Bools, Floats
from swarm.results.summary.statistics import largest, mean, median
from swarm.results.table import TelemetryTable


def pose_levels(rows: TelemetryTable) -> dict[str, Any]:
    """Return the errors of accepted poses against their protection levels, in position or attitude."""
    # A craft also tracks by cameras, or by the sweeps of four photodiodes, in a period whose own pose was refused.
    coupled = "coupling" in rows.columns
    accepted = rows.being("coupling", "loose") if coupled else rows.being("status", "tracking")
    return {"accepted_poses": _against_levels(rows, "pnp_", accepted)}


def estimate_levels(rows: TelemetryTable) -> dict[str, Any]:
    """Return the errors of estimates against their protection levels, and how large these are."""
    return {
        "estimates": _against_levels(rows, "", np.ones(len(rows), dtype=np.bool_)),
        "position_protection_median_m": median(rows.column("position_protection_m")),
        "attitude_protection_median_deg": median(rows.column("attitude_protection_deg")),
    }


def residual_test(rows: TelemetryTable) -> dict[str, Any]:
    """Return what the residual test did, and how often levels were beyond their limits."""
    dropped = rows.column("dropped_photodiodes")
    return {
        "mean_dropped_photodiodes": mean(np.maximum(dropped, 0)),
        "failed_residual_test_share": mean(np.where(np.isfinite(dropped), dropped < 0, np.nan)),
        "alert_share": mean(rows.column("alert")),
    }


def _against_levels(rows: TelemetryTable, prefix: str, among: Bools) -> dict[str, Any]:
    """Return how many errors of the columns with this prefix are beyond their levels, among some rows (rows,)."""
    of = [f"{prefix}{each}" for each in ("position_{}_m", "attitude_{}_deg")]
    columns = [each.format(what) for each in of for what in ("error", "protection")]
    share = rows.derived([f"{prefix}share of level"], columns, _larger_share)[0][among]
    return {
        "samples": int(np.count_nonzero(np.isfinite(share))),
        "beyond": int(np.count_nonzero(share > 1)),
        "worst_share_of_level": largest(share),
    }


def _larger_share(found: Floats) -> Floats:
    """Return the larger of two shares (1, n), of an error in its level, twice (4, n)."""
    out: Floats = np.fmax(found[0] / found[1], found[2] / found[3])[None]
    return out
