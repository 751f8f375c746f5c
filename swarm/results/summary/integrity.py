"""The part of a summary about the craft's trust in their own poses."""

from typing import Any

import numpy as np

from estimators.arrays import Bools, Floats
from swarm.results.summary.statistics import largest, mean, median
from swarm.results.table import TelemetryTable


def integrity(rows: TelemetryTable) -> dict[str, Any]:
    """Return the errors against their protection levels, in position or attitude, and what the residual test did."""
    # A craft also tracks by cameras, or by the sweeps of four photodiodes, in a period whose own pose was refused.
    coupled = "coupling" in rows.columns
    accepted = rows.being("coupling", "loose") if coupled else rows.being("status", "tracking")
    dropped = rows.column("dropped_photodiodes")

    def worst(prefix: str, among: Bools) -> tuple[Floats, dict[str, Any]]:
        shares = [
            rows.column(f"{prefix}{kind}_error_{unit}") / rows.column(f"{prefix}{kind}_protection_{unit}")
            for kind, unit in (("position", "m"), ("attitude", "deg"))
        ]
        share = np.fmax(*shares)[among]
        return share, {"samples": int(np.count_nonzero(np.isfinite(share))), "beyond": int(np.count_nonzero(share > 1))}

    pose, of_poses = worst("pnp_", accepted)
    estimate, of_estimates = worst("", np.ones(len(accepted), dtype=np.bool_))
    return {
        "integrity": {
            "accepted_poses": {**of_poses, "worst_share_of_level": largest(pose)},
            "estimates": {**of_estimates, "worst_share_of_level": largest(estimate)},
            "position_protection_median_m": median(rows.column("position_protection_m")),
            "attitude_protection_median_deg": median(rows.column("attitude_protection_deg")),
            "mean_dropped_photodiodes": mean(np.maximum(dropped, 0)),
            "failed_residual_test_share": mean(np.where(np.isfinite(dropped), dropped < 0, np.nan)),
            "alert_share": mean(rows.column("alert")),
        }
    }
