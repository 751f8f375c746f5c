"""The figures of one craft, or of all craft together, in sections that each read a few columns of the telemetry.

Errors are distances and angles from the truth (25) at each period's epoch, as RMS and maximum over the periods that
have them.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from swarm.results.rows import referred_nis
from swarm.results.summary.cameras import cameras
from swarm.results.summary.chi_square import consistency
from swarm.results.summary.integrity import estimate_levels, pose_levels, residual_test
from swarm.results.summary.motion_bias import attitude_bias, position_bias
from swarm.results.summary.peer import peer_scatter
from swarm.results.summary.smooth import smoothed
from swarm.results.summary.statistics import largest, mean, median, ratio, rms, share
from swarm.results.table import TelemetryTable


class Setting(NamedTuple):
    """Properties of the run that figures need beside its rows.

    period_s: length of a lighthouse period [s]. noise_rad: standard deviation of a sweep angle that the craft assume
    [rad]; None: unknown.
    """

    period_s: float
    noise_rad: float | None


Figures = dict[str, Any]
Section = Callable[[TelemetryTable, Setting], Figures]
"""Returns some figures of the rows of one craft, or of several."""


def _solved(rows: TelemetryTable) -> Bools:
    out: Bools = np.isfinite(rows.column("pnp_px_m"))
    return out


def _light(rows: TelemetryTable, setting: Setting) -> Figures:
    """Return how much light there was, and what became of it."""
    visible, solved = rows.column("visible"), _solved(rows)
    tracking = rows.by_light
    return {
        "samples": len(visible),
        "tracking_share": share(tracking, visible >= 0),
        "single_sweeps_share": share(rows.being("status", "single_sweeps"), visible >= 0),
        "refused_share": share(np.isfinite(rows.column("nis")) & ~tracking, solved),
        "mean_visible": mean(visible),
        "contact_periods": int(np.count_nonzero(rows.column("contact") == 1)),
        "solved_share": share(solved, visible >= 4),
        "solved_share_with_5_photodiodes": share(solved, visible >= 5),
    }


def _solutions(rows: TelemetryTable, setting: Setting) -> Figures:
    """Return how well the solved poses fit, and how the geometry dilutes their precision."""
    adop, pdop = mean(rows.column("adop_deg_per_rad")), mean(rows.column("pdop_m_per_rad"))
    noise_rad = setting.noise_rad
    return {
        "residual_median_rad": median(rows.column("residual_rad")),
        "mean_iterations": mean(rows.column("pnp_iterations")),
        "mean_adop_deg_per_rad": adop,
        "mean_pdop_m_per_rad": pdop,
        "predicted_attitude_deg": None if adop is None or noise_rad is None else adop * noise_rad,
        "predicted_position_m": None if pdop is None or noise_rad is None else pdop * noise_rad,
    }


def _errors(rows: TelemetryTable, setting: Setting) -> Figures:
    """Return the errors of the solved poses and of the filter."""
    pnp = rows.column("pnp_position_error_m"), rows.column("pnp_attitude_error_deg")
    ekf = rows.column("position_error_m"), rows.column("attitude_error_deg")
    return {
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
    }


def _consistency(rows: TelemetryTable, setting: Setting) -> Figures:
    """Return whether the filter's errors are as large as it promises.

    In a replay, light that was refused is left out: a hand or a reflection, whose NIS, of no known degrees of freedom,
    says nothing of the filter's errors, and of which a few would be all of the mean. `refused_share` counts them.
    """
    nis: Floats = rows.column("nis")
    if "rows" in rows.columns:
        sweeps = rows.column("rows")
        nis = referred_nis(nis, sweeps) if (sweeps > 0).any() else nis
        if "peer_px_m" in rows.columns:
            nis = np.where(rows.by_light, nis, np.nan)
    return {
        "nees": consistency(rows.column("frame"), rows.column("nees"), setting.period_s),
        "nis": consistency(rows.column("frame"), nis, setting.period_s),
    }


def _position_bias(rows: TelemetryTable, setting: Setting) -> Figures:
    """Return the motion bias of positions; None in a replay, which has no truth."""
    return {"pnp_motion_bias": None if "peer_px_m" in rows.columns else position_bias(rows)}


def _attitude_bias(rows: TelemetryTable, setting: Setting) -> Figures:
    """Return the motion bias of attitudes."""
    return {} if "peer_px_m" in rows.columns else {"pnp_motion_bias": attitude_bias(rows)}


def _ambiguity(rows: TelemetryTable, setting: Setting) -> Figures:
    """Return how often the pose was ambiguous, where it ever was."""
    ambiguous = rows.being("status", "ambiguous")
    return {"ambiguous_share": share(ambiguous, rows.column("visible") >= 0)} if ambiguous.any() else {}


def _cameras(rows: TelemetryTable, setting: Setting) -> Figures:
    return cameras(rows, setting.period_s) if "ccd" in rows.columns else {}


def _integrity(part: Callable[[TelemetryTable], Figures]) -> Section:
    """Return the section of a part of the figures of integrity."""
    return lambda rows, setting: {"integrity": part(rows)} if "dropped_photodiodes" in rows.columns else {}


def _smoothed(rows: TelemetryTable, setting: Setting) -> Figures:
    return smoothed(rows, setting.period_s) if "smooth_px_m" in rows.columns else {}


def _peer(rows: TelemetryTable, setting: Setting) -> Figures:
    return peer_scatter(rows) if "peer_px_m" in rows.columns else {}


SECTIONS: tuple[Section, ...] = (
    _light,
    _solutions,
    _errors,
    _consistency,
    _position_bias,
    _attitude_bias,
    _ambiguity,
    _cameras,
    _integrity(pose_levels),
    _integrity(estimate_levels),
    _integrity(residual_test),
    _smoothed,
    _peer,
)


def figures(every: list[TelemetryTable], setting: Setting) -> list[Figures]:
    """Return the figures of every part of a table.

    Section by section, so that no more columns are in memory than one section reads.

    Args:
        every: Parts of one table, at least one.
        setting: What they take from the run.
    """
    out: list[Figures] = [{} for _ in every]
    for section in SECTIONS:
        every[0].forget()
        for found, rows in zip(out, every, strict=True):
            for name, value in section(rows, setting).items():
                found[name] = found[name] | value if name in found else value
    return out
