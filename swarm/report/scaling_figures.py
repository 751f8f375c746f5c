"""The figures of a scaling study: everything against the number of craft, and the central solver's cost as a line.

The central solver's time is fitted by t = a + b N over the runs, relative errors counting alike. The swarm that one
computer like this can just follow is where the measured times, joined by straight lines and the last one carried on,
meet the lighthouse's period.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from swarm.figures import Axes, Figure, plain_log_y
from swarm.report.figures import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    Picture,
    band,
    picture,
)
from swarm.report.page import number
from swarm.report.rows import Rows

NEES_DOF = 6


def craft_axis(axes: Axes, counts: Floats) -> None:
    """Make the x axis logarithmic in the number of craft, with ticks where there are runs."""
    axes.set_xscale("log")
    axes.set_xticks(counts, [f"{count:,.0f}".replace(",", " ") for count in counts])
    axes.set_xticks([], minor=True)
    axes.set_xlabel("craft in the swarm")


class Line(NamedTuple):
    """t = start + slope N [us] over all sizes, and the number of craft at which the period is full (None if never)."""

    start_us: float
    slope_us: float
    period_us: float
    limit_craft: float | None


def central_line(rows: Rows) -> Line | None:
    """The central solver's cost as a straight line; None where it was not measured at two sizes at least."""
    cost, craft = rows.column("central_solve_us"), rows.column("central_craft")
    known = np.isfinite(cost) & np.isfinite(craft)
    if len(np.unique(craft[known])) < 2:
        return None
    matrix = np.stack([np.ones(known.sum()), craft[known]], axis=1) / cost[known, None]
    start, slope = np.linalg.lstsq(matrix, np.ones(known.sum()), rcond=None)[0]
    period_us = float(1e6 * np.nanmedian(rows.column("flown_s") / rows.column("periods")))
    return Line(float(start), float(slope), period_us, _meets(rows, period_us))


def _meets(rows: Rows, period_us: float) -> float | None:
    """Where the mean times meet the period [craft]: between two sizes, or beyond the last; None if they do not rise."""
    points, cost = rows.points, rows.spread("central_solve_us").mean
    points, cost = points[np.isfinite(cost)], cost[np.isfinite(cost)]
    above = np.flatnonzero(cost >= period_us)
    end = min(max(int(above[0]) if above.size else len(cost) - 1, 1), len(cost) - 1)
    rise = (cost[end] - cost[end - 1]) / (points[end] - points[end - 1])
    return float(points[end] + (period_us - cost[end]) / rise) if rise > 0 else None


def onboard(rows: Rows) -> Picture:
    """On-board time."""

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        for name, label, colour in (
            ("onboard_alone_us", "craft 0 on its own computer", BLUE),
            ("onboard_swarm_per_craft_us", "all craft as one batch, per craft", ORANGE),
        ):
            s = rows.spread(name)
            band(axes, rows.points, s.low, s.mean, s.high, label, colour, marker="o")
        craft_axis(axes, rows.points)
        plain_log_y(axes)
        axes.set_ylabel("time per craft and period [µs]")
        axes.legend()

    return picture(
        "onboard-time",
        "On-board time per craft and lighthouse period (decode, PnP, dilution, filter) against the number of "
        "craft; medians over a run, bands over the seeds.",
        paint,
    )


def visibility(rows: Rows) -> Picture:
    """Photodiodes lit and tracking."""

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        for name, label, colour, style in (
            ("lit_share", "photodiodes lit by both fans", BLUE, "-"),
            ("tracking_share", "time tracking", GREEN, "-"),
            ("first_craft_lit_share", "photodiodes lit, craft 0", GREY, "--"),
        ):
            if rows.has(name):
                s = rows.spread(name, 100)
                band(axes, rows.points, s.low, s.mean, s.high, label, colour, marker="o", linestyle=style)
        craft_axis(axes, rows.points)
        axes.set_ylim(0, 104)
        axes.set_ylabel("share [%]")
        axes.legend(loc="lower left")

    return picture(
        "visibility",
        "Photodiodes lit and time tracking as the volume fills. Craft 0 is in the middle, at the "
        "same place in every run.",
        paint,
    )


def precision(rows: Rows) -> Picture:
    """Errors and NEES."""

    def paint(figure: Figure) -> None:
        position, attitude, nees = figure.subplots(1, 3)
        for axes, name, scale, label in (
            (position, "position_rms_m", 1000, "position error, RMS [mm]"),
            (attitude, "attitude_rms_deg", 1, "attitude error, RMS [°]"),
        ):
            for prefix, text, colour, style in (
                ("pnp", "PnP, one period", ORANGE, "-"),
                ("ekf", "filter", BLUE, "-"),
                ("first_craft_ekf", "filter, craft 0", GREY, "--"),
            ):
                if rows.has(f"{prefix}_{name}"):
                    s = rows.spread(f"{prefix}_{name}", scale)
                    band(axes, rows.points, s.low, s.mean, s.high, text, colour, marker="o", linestyle=style)
            craft_axis(axes, rows.points)
            plain_log_y(axes)
            axes.set_title(label)
        position.legend()
        s = rows.spread("nees_mean")
        band(nees, rows.points, s.low, s.mean, s.high, "mean over swarm and time", BLUE, marker="o")
        nees.fill_between(
            rows.points,
            rows.spread("nees_band_low").mean,
            rows.spread("nees_band_high").mean,
            color=GREY,
            alpha=0.15,
            linewidth=0,
            label="95 % band",
        )
        nees.axhline(NEES_DOF, color=GREY, linewidth=1, linestyle=":")
        craft_axis(nees, rows.points)
        nees.set_ylim(bottom=0)
        nees.set_title("NEES, 6 is consistent")
        nees.legend(loc="lower left")
        for axes in (position, attitude, nees):
            axes.tick_params(axis="x", labelrotation=45)

    return picture(
        "precision",
        "Errors against the truth, and the filter's consistency, against the number of craft.",
        paint,
        height_in=3.6,
    )


def central_cost(rows: Rows) -> Picture:
    """What a central solver costs."""

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        for name, label, colour in (
            ("central_solve_us", "central: all poses and the rotor errors", RED),
            ("own_solve_us", "own: one craft's PnP and dilution", BLUE),
        ):
            s = rows.spread(name, 1e-3)
            band(axes, rows.points, s.low, s.mean, s.high, label, colour, marker="o")
        if line := central_line(rows):
            axes.axhline(line.period_us * 1e-3, color=GREY, linewidth=1.2)
            axes.annotate(
                f"one period, {line.period_us * 1e-3:.1f} ms",
                (rows.points[0], line.period_us * 1e-3),
                xytext=(0, 4),
                textcoords="offset points",
                color=GREY,
            )
            if line.limit_craft:
                ends = rows.points[-1], line.limit_craft
                last = rows.spread("central_solve_us").mean[-1]
                axes.plot(ends, np.array([last, line.period_us]) * 1e-3, color=RED, linewidth=1, linestyle=":")
                axes.plot([line.limit_craft], [line.period_us * 1e-3], "D", color=RED)
                axes.annotate(
                    f"{number(line.limit_craft, 2)} craft",
                    (line.limit_craft, line.period_us * 1e-3),
                    xytext=(8, -12),
                    textcoords="offset points",
                    color=RED,
                )
        craft_axis(axes, rows.points)
        plain_log_y(axes)
        axes.set_ylabel("time per period [ms]")
        axes.legend(loc="upper left", bbox_to_anchor=(0, 0.9))

    return picture(
        "central-cost",
        "Time to solve a period's poses: one central computer for all craft, and one craft for itself; "
        "dotted, carried on from the last two sizes.",
        paint,
    )


def central_gain(rows: Rows) -> Picture:
    """What it gains."""

    def paint(figure: Figure) -> None:
        gain, rotor = figure.subplots(1, 2)
        for name, label, colour, style in (
            ("rotor_known_position_gain_share", "position, rotor errors known", BLUE, "--"),
            ("central_position_gain_share", "position, central", BLUE, "-"),
            ("rotor_known_attitude_gain_share", "attitude, rotor errors known", PURPLE, "--"),
            ("central_attitude_gain_share", "attitude, central", PURPLE, "-"),
        ):
            s = rows.spread(name, 100)
            band(gain, rows.points, s.low, s.mean, s.high, label, colour, marker="o", linestyle=style)
        gain.set_title("1 sigma smaller than alone [%]")
        gain.legend()
        s = rows.spread("rotor_variance_found_share", 100)
        band(rotor, rows.points, s.low, s.mean, s.high, "", RED, marker="o")
        rotor.set_title("rotor errors' variance found [%]")
        rotor.set_ylim(0, 100)
        for axes in (gain, rotor):
            craft_axis(axes, rows.points)
            axes.tick_params(axis="x", labelrotation=45)

    return picture(
        "central-gain",
        "What solving together would gain in one period, from the covariances: the central solver, and "
        "its bound, rotor errors known exactly.",
        paint,
    )
