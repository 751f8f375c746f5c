"""The shape of summary.json, as far as tables and reports rely on it."""

from typing import Any

from swarm.errors import SwarmError
from swarm.results.shape import Keys, Leaf, check_shape

_NUMBER, _YES, _TEXT = Leaf.NUMBER, Leaf.YES, Leaf.TEXT
_CONSISTENCY = Keys(
    always={
        "mean": _NUMBER,
        "band_low": _NUMBER,
        "band_high": _NUMBER,
        "inside_band": _YES,
        "effective_samples": _NUMBER,
    },
    rest=_NUMBER,
)
_BIAS = Keys(
    always={
        f"{what}_{figure}_s": [_NUMBER] for what in ("position", "attitude") for figure in ("slope", "slope_sigma")
    },
    known={"position_rms_m": _NUMBER, "attitude_rms_deg": _NUMBER},
    rest=_NUMBER,
)
_FIGURES = Keys(
    always={"samples": _NUMBER},
    known={"mean_visible": _NUMBER, "refused_share": _NUMBER},
    perhaps={
        "nees": _CONSISTENCY,
        "nis": _CONSISTENCY,
        "smooth_nees": _CONSISTENCY,
        "pnp_motion_bias": _BIAS,
        "ccd": Keys(always=dict.fromkeys(("stereo_share", "camera_share", "sensor_switches"), _NUMBER)),
        "integrity": Keys(),
        "navigates": _YES,
        "relative": Keys(rest=Keys(always={"samples": _NUMBER}, rest=_NUMBER)),
        "observed": _YES,
        "docking": Keys(always={"docked": _YES, "sentence": _TEXT}, known={"time_s": _NUMBER}),
    },
    rest=_NUMBER,
)
_LIDAR = Keys(
    always={"target": _TEXT, "acquisitions": _NUMBER, "tracked_share": _NUMBER, "scans": _NUMBER},
    known={"measured_attitude_mean_deg": _NUMBER, "measured_attitude_max_deg": _NUMBER},
    perhaps={"inertia": Keys(always={"moments": [_NUMBER], "sigmas": [_NUMBER], "observed": _NUMBER})},
)
_VERDICT = Keys(
    always={"name": _TEXT},
    known={"value": _NUMBER, "craft": _TEXT, "min": _NUMBER, "max": _NUMBER, "held": _YES},
    perhaps={"about": [_TEXT], "time_s": _NUMBER, "why": _TEXT},
)
_SUMMARY = Keys(
    perhaps={
        "status": _TEXT,
        "reason": _TEXT,
        "periods": _NUMBER,
        "duration_s": _NUMBER,
        "craft_count": _NUMBER,
        "swarm": _FIGURES,
        "groups": Keys(rest=_FIGURES),
        "craft": Keys(rest=_FIGURES),
        "lidar": Keys(rest=_LIDAR),
        "physics": Keys(known={"chosen": _YES}, rest=_NUMBER),
        "criteria": [_VERDICT],
        "criteria_held": _YES,
    }
)
_FLOWN = Keys(always={"craft_count": _NUMBER, "duration_s": _NUMBER, "craft": Keys()})


def check_summary(summary: dict[str, Any], where: str) -> None:
    """Check the summary of a run; `where` is its file. Raises SwarmError for the first key with a wrong value."""
    check_shape(summary, _SUMMARY, where)
    if summary.get("swarm") is not None:
        check_shape(summary, _FLOWN, where)
    parts = [summary.get(key) or {} for key in ("groups", "craft")]
    for name, figures in [("swarm", summary.get("swarm")), *(item for part in parts for item in part.items())]:
        bias = (figures or {}).get("pnp_motion_bias")
        for key, value in (bias or {}).items():
            if isinstance(value, list) and len(value) != 3:
                raise SwarmError(f"{where}: {name}: pnp_motion_bias.{key} must have three numbers, not {len(value)}")
    for i, verdict in enumerate(summary.get("criteria") or []):
        if verdict is None or (verdict["min"] is None and verdict["max"] is None):
            raise SwarmError(f"{where}: criteria[{i}] has neither min nor max")
