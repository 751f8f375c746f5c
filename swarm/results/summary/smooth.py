"""The part of a summary about the smoothed estimates, where `swarm smooth` has made them.

In a replay there is no truth. What a smoother takes away there is the scatter of the poses: their distance from the
mean of the poses within half a second, in which a craft hardly changes its velocity.
"""

from typing import Any

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.rotation import log, matrix_from_quaternion
from swarm.results.summary.chi_square import consistency
from swarm.results.summary.peer import peer_scatter
from swarm.results.summary.statistics import Moments, largest, number, ratio, rms, where_both
from swarm.results.table import TelemetryTable

HALF_WINDOW_S = 0.5
"""The scatter of a pose is from the mean of those at most so much earlier or later."""


def smoothed(rows: TelemetryTable, period_s: float) -> dict[str, Any]:
    """Return the figures of the smoothed estimates of these rows; none of a run that was not smoothed.

    rows: the telemetry of one craft, or of several. period_s: length of a lighthouse period [s].
    """
    if "smooth_px_m" not in rows.columns:
        return {}
    out: dict[str, Any] = {"smooth_nees": consistency(rows.column("frame"), rows.column("smooth_nees"), period_s)}
    for what, unit in (("position", "m"), ("attitude", "deg")):
        error, before = rows.column(f"smooth_{what}_error_{unit}"), rows.column(f"{what}_error_{unit}")
        out[f"smooth_{what}_rms_{unit}"] = rms(Moments.of(error))
        out[f"smooth_{what}_max_{unit}"] = largest(Moments.of(error))
        out[f"smooth_to_ekf_{what}_ratio"] = ratio(*map(Moments.of, where_both(error, before)))
    if "peer_px_m" not in rows.columns:
        return out
    for source in ("ekf", "smooth"):
        out |= {f"{source}_{key}": value for key, value in scatter(rows, source, period_s).items()}
        out |= {f"{source}_{key}": value for key, value in peer_scatter(rows, source).items() if key != "peer_samples"}
    return out


def scatter(rows: TelemetryTable, source: str, period_s: float) -> dict[str, float | None]:
    """Return the RMS scatter of the poses of a replay about their mean over a second.

    Args:
        rows: telemetry of one craft.
        source: "pnp", "ekf" or "smooth".
        period_s: length of a lighthouse period [s].
    """
    half = max(1, round(HALF_WINDOW_S / period_s)) if period_s else 1
    position = rows.position(source)
    turn = matrix_from_quaternion(rows.quaternion(source))
    # The way that the attitude has gone: small turns add up as vectors do.
    steps = np.full((max(len(turn) - 1, 0), 3), np.nan)
    known: Bools = np.all(np.isfinite(turn), axis=(1, 2))
    both = known[1:] & known[:-1]
    steps[both] = log(turn[1:][both] @ np.swapaxes(turn[:-1][both], 1, 2))
    way = np.concatenate([np.zeros((1, 3)), np.cumsum(np.where(both[:, None], steps, 0.0), axis=0)])[: len(turn)]
    return {
        "position_scatter_mm": number(1e3 * _about_mean(position, known, half)),
        "attitude_scatter_deg": number(np.degrees(_about_mean(way, known, half))),
    }


def _about_mean(x: Floats, known: Bools, half: int) -> float:
    """Return the RMS distance of vectors (n, 3) from the mean of 2 `half` + 1 of them, where all are known."""
    window = 2 * half + 1
    if len(x) < window:
        return float("nan")
    views = np.lib.stride_tricks.sliding_window_view(np.where(known[:, None], x, 0.0), window, axis=0)
    whole = np.lib.stride_tricks.sliding_window_view(known, window).all(axis=1)
    if not whole.any():
        return float("nan")
    away = x[half : len(x) - half][whole] - views.mean(axis=-1)[whole]
    return float(np.sqrt(np.mean(np.sum(away**2, axis=1))))
