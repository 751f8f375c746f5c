"""The result of a calibration, for the terminal and for the head of its file."""

from datetime import UTC, datetime
from math import hypot
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from estimators.arrays import Floats
from estimators.calibration.model import gibbous_sigma
from estimators.lighthouse.sweep import FanErrors
from swarm.flight.recordings.calibration_file import calibration_text
from swarm.flight.recordings.station_calibration import StationCalibration
from swarm.studies.calibration.calibrate import HELD_OUT_EVERY, Calibrated
from swarm.tables import table
from swarm.version import VERSION

LIMIT = 1.1
"""Held-out residuals up to so many times the noise are noise."""
UNKNOWABLE = (
    "Without known poses no angle tells a craft's size, and so its distances, nor where its body frame sits:",
    "the photodiodes keep the centroid, mean attitude and mean size that they were believed to have.",
)


def fan_sigmas(found: Calibrated) -> tuple[FanErrors, FanErrors]:
    """Return the standard deviations of both fans' errors, 0 for what was held."""
    result, covariance = found.result, found.result.covariance
    out = []
    for fan in (0, 1):
        gibbous = slice(5 * fan + 3, 5 * fan + 5)
        phase = magnitude = 0.0
        if covariance[gibbous, gibbous].any():
            sine, cosine = result.fans[fan, 3:]
            phase, magnitude = gibbous_sigma(sine, cosine, covariance[gibbous, gibbous])
        own = result.fan_sigma[fan].tolist()
        out.append(FanErrors(own[0], own[1], own[2], phase, magnitude))
    return out[0], out[1]


def findings(found: Calibrated) -> list[str]:
    """Return in sentences what the calibration was made of, and how well it fits."""
    result, seen = found.result, found.seen
    noise = seen.believed.noise
    total, dropped = len(result.used), int(np.count_nonzero(~result.used))
    duration = float(seen.time_s[-1] - seen.time_s[0])
    lines = [
        f"{seen.source}: {found.poses} poses of {len(seen.believed.craft)} craft in {duration:.0f} s, {total} angles, "
        f"{dropped} of them left out as wrong",
        "Poses: " + ("known" if found.how == "truth" else "unknown, found along with the rest"),
        f"Residual: {result.residual:.3f} of the noise ({1e6 * noise.own_rad:.1f} urad an angle of its own, "
        f"{1e6 * noise.rotor_rad:.1f} urad a sweep)",
        f"Held-out poses ({int(found.after.pose.solved.sum())}, one second in {HELD_OUT_EVERY}): residual "
        f"{found.after.ratio:.3f} of what noise leaves; before {found.before.ratio:.3g}",
        f"Condition: {result.condition:.3g}, from the best to the worst known mixture, in units of real errors' sizes",
    ]
    return lines + (list(UNKNOWABLE) if found.how == "own" else [])


def file_text(found: Calibrated) -> str:
    """Return the text of the calibration file."""
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    station = found.station()
    point_sigma = {
        name: found.result.point_sigma_m[points]
        for name, points in zip(found.seen.believed.craft, found.points, strict=True)
    }
    head = [f"Calibration by lighthouse-swarm {VERSION}, {now}", *findings(found)]
    return calibration_text(station, fan_sigmas(found), point_sigma, head)


def print_calibration(console: Console, found: Calibrated, file: Path) -> None:
    """Print what was found, and where it is.

    Args:
        console: Where to print.
        found: The calibration.
        file: Its file.
    """
    station = found.station()
    for i, line in enumerate(findings(found)):
        bad = line.startswith("Held-out") and not found.after.ratio <= LIMIT
        console.print(line, style="yellow" if bad else "bold" if i == 0 else "", highlight=False)
    console.print(_fans(station, fan_sigmas(found)))
    for name, points in zip(found.seen.believed.craft, found.points, strict=True):
        console.print(_places(name, found, points), highlight=False)
    console.print(f"\n{file}", style="bold", highlight=False)
    console.print(f"  swarm run SCENARIO --calibration {file}", highlight=False)


def _fans(station: StationCalibration, sigmas: tuple[FanErrors, FanErrors]) -> Table:
    made = table("", "fan X", "fan Y")
    for i, key in enumerate(FanErrors._fields):
        pairs = ((station.fan_x[i], sigmas[0][i]), (station.fan_y[i], sigmas[1][i]))
        made.add_row(
            key, *(f"{value:.6f} ± {sigma:.6f}" if sigma > 0 else f"{value:.6f}  (held)" for value, sigma in pairs)
        )
    return made


def _places(name: str, found: Calibrated, points: slice) -> str:
    placed = found.result.placed[points]
    if not placed.any():
        return f"{name}: photodiodes left where they are believed to be"
    drawn = np.concatenate(found.seen.believed.point_m)[points]
    moved: Floats = np.linalg.norm((found.result.point_m[points] - drawn)[placed], axis=1)
    sigma = found.result.point_sigma_m[points][placed]
    rms = hypot(*moved) / np.sqrt(len(moved))
    return (
        f"{name}: {int(placed.sum())} of {len(placed)} photodiodes placed, {1e3 * rms:.2f} mm RMS from where they were "
        f"believed to be (largest {1e3 * moved.max():.2f} mm), to {1e6 * np.sqrt(np.mean(sigma**2)):.1f} um per axis"
    )
