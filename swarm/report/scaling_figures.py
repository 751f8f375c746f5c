"""The figures of a scaling study: everything against the number of craft, and the central solver's cost as a line.

The central solver's time is fitted by t = a + b N over the runs, relative errors counting alike. The swarm that one
computer like this can just follow is where the measured times, joined by straight lines, meet the lighthouse's period;
nothing is carried on beyond the largest swarm that was flown.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from swarm.figures import Axes, Figure, plain_log_y
from swarm.report.figures import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, Picture, band, legend, panels, picture
from swarm.report.numbers import number
from swarm.report.rows import Rows
from swarm.results.summary.chi_square import DOF


class Curve(NamedTuple):
    """One figure of the runs against the number of craft: mean over the seeds, and their range behind it."""

    name: str
    label: str
    colour: str
    style: str = "-"


class CostLine(NamedTuple):
    """The cost t = start + slope N [us] over all sizes, and the craft at which the period is full.

    limit_craft: None where the largest swarm that was flown does not fill it.
    """

    start_us: float
    slope_us: float
    period_us: float
    limit_craft: float | None


def central_line(rows: Rows) -> CostLine | None:
    """Return the central solver's cost as a straight line; None where it was not measured at two sizes at least."""
    cost, craft = rows.column("central_solve_us"), rows.column("central_craft")
    known = np.isfinite(cost) & np.isfinite(craft)
    if len(np.unique(craft[known])) < 2:
        return None
    matrix = np.stack([np.ones(known.sum()), craft[known]], axis=1) / cost[known, None]
    start, slope = np.linalg.lstsq(matrix, np.ones(known.sum()), rcond=None)[0]
    period_us = float(1e6 * np.nanmedian(rows.column("flown_s") / rows.column("periods")))
    return CostLine(float(start), float(slope), period_us, _meets(rows, period_us))


def _meets(rows: Rows, period_us: float) -> float | None:
    """Return the craft at which the mean times meet the period; None if they stay below it, as far as flown."""
    points, cost = rows.points, rows.spread("central_solve_us").mean
    points, cost = points[np.isfinite(cost)], cost[np.isfinite(cost)]
    above = np.flatnonzero(cost >= period_us)
    if not above.size:
        return None
    end = max(int(above[0]), 1)
    rise = (cost[end] - cost[end - 1]) / (points[end] - points[end - 1])
    return float(points[end] + (period_us - cost[end]) / rise) if rise > 0 else None


def onboard(rows: Rows) -> Picture:
    """Draw the on-board time."""

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        alone = Curve("onboard_alone_us", "craft 0 on its own computer", BLUE)
        _draw(axes, rows, alone, Curve("onboard_swarm_per_craft_us", "all craft as one batch, per craft", ORANGE))
        plain_log_y(axes)
        axes.set_ylabel("time per craft and period [µs]")
        legend(figure)

    caption = (
        "On-board time per craft and lighthouse period (decode, PnP, dilution, filter) against the number of craft; "
        "medians over a run, bands over the seeds."
    )
    return picture("onboard-time", caption, paint)


def visibility(rows: Rows) -> Picture:
    """Draw the photodiodes lit and the time tracking."""
    curves = (
        Curve("lit_share", "photodiodes lit by both fans", BLUE),
        Curve("tracking_share", "time tracking", GREEN),
        Curve("first_craft_lit_share", "photodiodes lit, craft 0", GREY, "--"),
    )

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        _draw(axes, rows, *curves, scale=100)
        axes.set_ylim(0, 104)
        axes.set_ylabel("share [%]")
        legend(figure)

    where = "Craft 0 is in the middle, at the same place in every run."
    caption = f"Photodiodes lit and time tracking as the volume fills. {where}"
    return picture("visibility", caption, paint)


def precision(rows: Rows) -> Picture:
    """Draw errors and NEES."""

    def paint(figure: Figure) -> None:
        position, attitude, nees = panels(figure, 3, 3)
        for axes, name, scale, label in (
            (position, "position_rms_m", 1000, "position error, RMS [mm]"),
            (attitude, "attitude_rms_deg", 1, "attitude error, RMS [°]"),
        ):
            curves = (
                Curve(f"pnp_{name}", "PnP, one period", ORANGE),
                Curve(f"ekf_{name}", "filter", BLUE),
                Curve(f"first_craft_ekf_{name}", "filter, craft 0", GREY, "--"),
            )
            _draw(axes, rows, *curves, scale=scale)
            plain_log_y(axes)
            axes.set_title(label)
        low, high = rows.spread("nees_band_low").mean, rows.spread("nees_band_high").mean
        _draw(nees, rows, Curve("nees_mean", "mean over swarm and time", BLUE))
        nees.fill_between(rows.points, low, high, color=GREY, alpha=0.15, linewidth=0, label="95 % band")
        nees.axhline(DOF, color=GREY, linewidth=1, linestyle=":")
        nees.set_ylim(bottom=0)
        nees.set_title("NEES, 6 is consistent")
        legend(figure)
        for axes in (position, attitude, nees):
            axes.tick_params(axis="x", labelrotation=45)

    caption = "Errors against the truth, and the filter's consistency, against the number of craft."
    return picture("precision", caption, paint, 3.9, 8.0)


def central_cost(rows: Rows) -> Picture:
    """Draw the time of a central solver."""

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        together = Curve("central_solve_us", "central: all poses and the rotor errors", RED)
        _draw(axes, rows, together, Curve("own_solve_us", "own: one craft's PnP and dilution", BLUE), scale=1e-3)
        if line := central_line(rows):
            period_ms = line.period_us * 1e-3
            axes.axhline(period_ms, color=GREY, linewidth=1.2)
            _note(axes, f"one period, {period_ms:.1f} ms", (rows.points[0], period_ms), (0, 4), GREY)
            if limit := line.limit_craft:
                axes.plot([limit], [period_ms], "D", color=RED)
                _note(axes, f"{number(limit, 2)} craft", (limit, period_ms), (8, -12), RED)
        plain_log_y(axes)
        axes.set_ylabel("time per period [ms]")
        legend(figure)

    caption = "Time to solve a period's poses: one central computer for all craft, and one craft for itself."
    return picture("central-cost", caption, paint)


def central_gain(rows: Rows) -> Picture:
    """Draw the gain of a central solver."""
    curves = (
        Curve("rotor_known_position_gain_share", "position, rotor errors known", BLUE, "--"),
        Curve("central_position_gain_share", "position, central", BLUE),
        Curve("rotor_known_attitude_gain_share", "attitude, rotor errors known", PURPLE, "--"),
        Curve("central_attitude_gain_share", "attitude, central", PURPLE),
    )

    def paint(figure: Figure) -> None:
        gain, rotor = panels(figure, 2)
        _draw(gain, rows, *curves, scale=100)
        gain.set_title("1 sigma smaller than alone [%]")
        legend(figure, [gain])
        _draw(rotor, rows, Curve("rotor_variance_found_share", "", RED), scale=100)
        rotor.set_title("rotor errors' variance found [%]")
        rotor.set_ylim(0, 100)
        for axes in (gain, rotor):
            axes.tick_params(axis="x", labelrotation=45)

    caption = (
        "What solving together would gain in one period, from the covariances: the central solver, and its bound, "
        "rotor errors known exactly."
    )
    return picture("central-gain", caption, paint, 3.6, 6.4)


def craft_axis(axes: Axes, counts: Floats) -> None:
    """Make the x axis logarithmic in the number of craft, with ticks where there are runs."""
    axes.set_xscale("log")
    axes.set_xticks(counts, [f"{count:,.0f}".replace(",", " ") for count in counts])
    axes.set_xticks([], minor=True)
    axes.set_xlabel("craft in the swarm")


def _draw(axes: Axes, rows: Rows, *curves: Curve, scale: float = 1.0) -> None:
    """Draw the curves that the runs know."""
    for curve in curves:
        if rows.has(curve.name):
            spread = rows.spread(curve.name, scale)
            band(axes, rows.points, spread, curve.label, curve.colour, marker="o", linestyle=curve.style)
    craft_axis(axes, rows.points)


def _note(axes: Axes, text: str, at: tuple[float, float], shift: tuple[float, float], colour: str) -> None:
    axes.annotate(text, at, xytext=shift, textcoords="offset points", color=colour)
