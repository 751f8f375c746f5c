"""The part of a craft's summary about others that it navigates relative to."""

from typing import Any

import numpy as np

from swarm.results.summary.statistics import Moments, count, largest, mean, rms
from swarm.results.table import TelemetryTable

_BEGIN, _END = "to_", "_message_bytes"


def pairs(rows: TelemetryTable, period_s: float) -> dict[str, Any]:
    """Return the figures of every craft that this one navigates relative to, by its name; empty without any.

    Args:
        rows: of one craft.
        period_s: length of a period [s].
    """
    names = [column[len(_BEGIN) : -len(_END)] for column in rows.columns if column.endswith(_END)]
    found = {name: _pair(rows, f"{_BEGIN}{name}_", period_s) for name in names}
    out = {name: of for name, of in found.items() if of["samples"]}
    return {"relative": out} if out else {}


def _pair(rows: TelemetryTable, prefix: str, period_s: float) -> dict[str, Any]:
    def moments(name: str) -> Moments:
        return Moments.of(rows.column(prefix + name))

    position, attitude, sigma = map(moments, ("position_error_m", "attitude_error_deg", "position_sigma_m"))
    size = mean(moments("message_bytes"))
    with np.errstate(invalid="ignore"):
        over = np.logical_or(
            *(
                rows.column(f"{prefix}{what}_error_{unit}") > rows.column(f"{prefix}{what}_protection_{unit}")
                for what, unit in (("position", "m"), ("attitude", "deg"))
            )
        )
    return {
        "samples": count(sigma),
        "position_rms_m": rms(position),
        "position_max_m": largest(position),
        "attitude_rms_deg": rms(attitude),
        "attitude_max_deg": largest(attitude),
        "position_sigma_m": rms(sigma),
        "independent_sigma_m": rms(moments("independent_sigma_m")),
        "nees_mean": mean(moments("nees")),
        "beyond": int(np.count_nonzero(over)),
        "alert_share": mean(moments("alert")),
        "bytes_per_second": size / period_s if size is not None and period_s else None,
    }
