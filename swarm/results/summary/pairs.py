"""The part of a craft's summary about others that it navigates relative to."""

from typing import Any

import numpy as np

from swarm.results.summary.statistics import largest, mean, rms
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
    position, attitude = (rows.column(prefix + name) for name in ("position_error_m", "attitude_error_deg"))
    level, sigma = rows.column(f"{prefix}position_protection_m"), rows.column(f"{prefix}position_sigma_m")
    size = mean(rows.column(f"{prefix}message_bytes"))
    with np.errstate(invalid="ignore"):
        over = (position > level) | (attitude > rows.column(f"{prefix}attitude_protection_deg"))
    return {
        "samples": int(np.count_nonzero(np.isfinite(sigma))),
        "position_rms_m": rms(position),
        "position_max_m": largest(position),
        "attitude_rms_deg": rms(attitude),
        "attitude_max_deg": largest(attitude),
        "position_sigma_m": rms(sigma),
        "independent_sigma_m": rms(rows.column(f"{prefix}independent_sigma_m")),
        "nees_mean": mean(rows.column(f"{prefix}nees")),
        "beyond": int(np.count_nonzero(over)),
        "alert_share": mean(rows.column(f"{prefix}alert")),
        "bytes_per_second": size / period_s if size is not None and period_s else None,
    }
