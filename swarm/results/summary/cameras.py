"""The cameras' part of a summary."""

from typing import Any

import numpy as np

from swarm.results.summary.chi_square import consistency
from swarm.results.summary.statistics import Moments, rms
from swarm.results.table import TelemetryTable


def cameras(rows: TelemetryTable, period_s: float) -> dict[str, Any]:
    """Return the figures of the rows of craft that carry cameras; None without such rows, and none without cameras."""
    if "ccd" not in rows.columns:
        return {}
    state = rows.column("ccd")
    sensor, on_board = rows.column("sensor"), np.isfinite(state)
    # Craft by craft, in the order of time.
    order = np.lexsort((rows.frame[on_board], rows.column("craft")[on_board]))
    who, used = rows.column("craft")[on_board][order], sensor[on_board][order]
    switched = np.count_nonzero((np.diff(used) != 0) & (np.diff(who) == 0))
    return {
        "ccd": {
            "samples": int(np.count_nonzero(on_board)),
            "stereo_share": float(np.mean(rows.being("ccd", "stereo")[on_board])),
            "camera_share": float(np.mean(rows.being("ccd", "camera")[on_board])),
            "sensor_share": {
                name: float(np.mean(sensor[on_board] == code))
                for code, name in enumerate(rows.names_of("sensor"))
                if np.any(sensor[on_board] == code)
            },
            "sensor_switches": int(switched),
            "position_rms_m": rms(Moments.of(rows.column("ccd_position_error_m"))),
            "attitude_rms_deg": rms(Moments.of(rows.column("ccd_attitude_error_deg"))),
            "nis": consistency(rows.column("frame"), rows.column("ccd_nis"), period_s),
        }
        if on_board.any()
        else None
    }
