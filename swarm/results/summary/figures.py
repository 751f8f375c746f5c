"""The figures of one craft, or of all craft together.

Errors are distances and angles from the truth (25) at each period's epoch, as RMS and maximum over the periods that
have them.
"""

from typing import Any

import numpy as np

from swarm.results.rows import referred_nis
from swarm.results.summary.cameras import cameras
from swarm.results.summary.chi_square import consistency
from swarm.results.summary.integrity import integrity
from swarm.results.summary.peer import peer_scatter
from swarm.results.summary.smooth import smoothed
from swarm.results.summary.statistics import largest, mean, median, ratio, rms, share
from swarm.results.table import TelemetryTable


def figures(
    rows: TelemetryTable, period_s: float, bias: dict[str, Any] | None, noise_rad: float | None = None
) -> dict[str, Any]:
    """Return the figures of these rows.

    Args:
        rows: The telemetry of one craft, or of several.
        period_s: Length of a lighthouse period [s].
        bias: The rows' motion bias.
        noise_rad: Standard deviation of a sweep angle that the craft assume [rad]; None: unknown.
    """
    visible, solved = rows.column("visible"), np.isfinite(rows.column("pnp_px_m"))
    tracking = rows.by_light
    pnp = rows.column("pnp_position_error_m"), rows.column("pnp_attitude_error_deg")
    ekf = rows.column("position_error_m"), rows.column("attitude_error_deg")
    nis = rows.column("nis")
    if "rows" in rows.columns:
        nis = referred_nis(nis, rows.column("rows"))
    out: dict[str, Any] = {
        "samples": len(visible),
        "tracking_share": share(tracking, visible >= 0),
        "single_sweeps_share": share(rows.being("status", "single_sweeps"), visible >= 0),
        "refused_share": share(np.isfinite(rows.column("nis")) & ~tracking, solved),
        "mean_visible": mean(visible),
        "contact_periods": int(np.count_nonzero(rows.column("contact") == 1)),
        "solved_share": share(solved, visible >= 4),
        "solved_share_with_5_photodiodes": share(solved, visible >= 5),
        "residual_median_rad": median(rows.column("residual_rad")),
        "mean_iterations": mean(rows.column("pnp_iterations")),
        "mean_adop_deg_per_rad": (adop := mean(rows.column("adop_deg_per_rad"))),
        "mean_pdop_m_per_rad": (pdop := mean(rows.column("pdop_m_per_rad"))),
        "predicted_attitude_deg": None if adop is None or noise_rad is None else adop * noise_rad,
        "predicted_position_m": None if pdop is None or noise_rad is None else pdop * noise_rad,
        "pnp_position_rms_m": rms(pnp[0]),
        "pnp_position_max_m": largest(pnp[0]),
        "pnp_attitude_rms_deg": rms(pnp[1]),
        "pnp_attitude_max_deg": largest(pnp[1]),
        "ekf_position_rms_m": rms(ekf[0]),
        "ekf_position_max_m": largest(ekf[0]),
        "ekf_attitude_rms_deg": rms(ekf[1]),
        "ekf_attitude_max_deg": largest(ekf[1]),
        "ekf_to_pnp_position_ratio": ratio(ekf[0], pnp[0]),
        "ekf_to_pnp_attitude_ratio": ratio(ekf[1], pnp[1]),
        "nees": consistency(rows.frame, rows.column("nees"), period_s),
        "nis": consistency(rows.frame, nis, period_s),
        "pnp_motion_bias": bias,
    }
    if (ambiguous := rows.being("status", "ambiguous")).any():
        out["ambiguous_share"] = share(ambiguous, visible >= 0)
    if "ccd" in rows.columns:
        out |= cameras(rows, period_s)
    if "dropped_photodiodes" in rows.columns:
        out |= integrity(rows)
    if "smooth_px_m" in rows.columns:
        out |= smoothed(rows, period_s)
    return out | peer_scatter(rows) if "peer_px_m" in rows.columns else out
