"""The figures of a run: error against 3 sigma, consistency, dilution and visibility over time."""

import numpy as np
from scipy.stats import chi2

from estimators.arrays import Bools, Floats
from swarm.errors import SwarmError
from swarm.figures import Axes, Figure, count_map, plain_log_y
from swarm.report.figures import BLUE, GREY, ORANGE, SERIES, Picture, picture, thin
from swarm.results.table import TelemetryTable

DOF = 6
MOST_GAPS = 10
"""Periods per row that the telemetry may have, for somebody may have kept a part of the rows."""
MOST_LINES, MOST_PANELS, MOST_DOTS = 10, 4, 20_000
STATUS_COLOURS = {"searching": "#c0392b", "ambiguous": "#7b5ea7", "coasting": "#e6a23c"}


class Series:
    """Telemetry as arrays (periods, craft), NaN where missing."""

    def __init__(self, rows: TelemetryTable) -> None:
        """Take the rows of a run."""
        self._rows = rows
        self.names = rows.names_of("craft")
        frame, craft = rows.column("frame"), rows.column("craft")
        if not (np.isfinite(frame).all() and np.isfinite(craft).all()):
            raise SwarmError("the telemetry has rows without a frame or a craft: it was changed, or is damaged")
        if np.ptp(frame) >= MOST_GAPS * len(frame):
            raise SwarmError(
                f"the telemetry's frames go from {frame.min():.0f} to {frame.max():.0f} in {len(frame)} rows"
            )
        self._row = rows.frame - rows.frame.min()
        self.shape = int(self._row.max()) + 1, len(self.names)
        self.time_s: Floats = np.nanmin(self.of("time_s"), axis=1)

    def of(self, column: str) -> Floats:
        """Return one column."""
        return self._grid(self._rows.column(column))

    def has(self, column: str) -> bool:
        """Return whether the telemetry has the column."""
        return column in self._rows.columns

    def being(self, status: str) -> Bools:
        """Return whether a craft has this status, (periods, craft)."""
        out: Bools = self._grid(self._rows.being("status", status)) == 1
        return out

    def _grid(self, flat: Floats | Bools) -> Floats:
        out = np.full(self.shape, np.nan)
        out[self._row, self._rows.craft] = flat
        return out


def chosen_of(series: Series) -> list[int]:
    """Return all craft if few; else evenly from the best to the worst by RMS position error."""
    count = len(series.names)
    if count <= MOST_PANELS:
        return list(range(count))
    error = series.of("position_error_m")
    known = np.isfinite(error)
    mean_square = np.where(known, error, 0.0)
    rms = np.where(known.any(axis=0), np.sqrt((mean_square**2).sum(axis=0) / np.maximum(known.sum(axis=0), 1)), np.inf)
    order = np.argsort(rms, kind="stable")
    return [int(order[i]) for i in np.linspace(0, count - 1, MOST_PANELS).round().astype(int)]


def errors(series: Series) -> Picture:
    """Draw errors and 3 sigma of some craft over time."""
    chosen = chosen_of(series)

    def paint(figure: Figure) -> None:
        grid = figure.subplots(len(chosen), 2, sharex=True, squeeze=False)
        for row, craft in zip(grid, chosen, strict=True):
            for axes, error, sigma, scale, label in (
                (row[0], "position_error_m", "position_sigma_m", 1000, "position [mm]"),
                (row[1], "attitude_error_deg", "attitude_sigma_deg", 1, "attitude [°]"),
            ):
                wrong, believed = scale * series.of(error)[:, craft], 3 * scale * series.of(sigma)[:, craft]
                axes.plot(*thin(series.time_s, wrong, peaks=True), color=BLUE, linewidth=0.9, label="error")
                axes.plot(*thin(series.time_s, believed), color=ORANGE, linewidth=1.4, label="3 sigma")
                axes.set_title(f"{series.names[craft]}: {label}")
                settle(axes, wrong, believed)
        grid[0][0].legend(loc="upper right", ncols=2)
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")

    height_in = 0.6 + 1.75 * len(chosen)
    return picture("error", "Error of the filter's estimate and its 3 sigma, over time.", paint, height_in)


def settle(axes: Axes, wrong: Floats, believed: Floats) -> None:
    """Choose the height of a plot of errors and 3 sigma.

    The start, when a craft has only just found itself, must not flatten the rest.

    Args:
        axes: Plot to change.
        wrong: Errors (n,).
        believed: The 3 sigma (n,).
    """
    tops = [
        np.quantile(value[np.isfinite(value)], share)
        for value, share in ((believed, 0.97), (wrong, 0.999))
        if np.isfinite(value).any()
    ]
    if tops:
        axes.set_ylim(0, 1.15 * max(tops))


def consistency(series: Series) -> Picture:
    """Draw NEES over time."""
    nees = series.of("nees")
    low, high = chi2.ppf([0.025, 0.975], DOF)

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axhspan(low, high, color=GREY, alpha=0.14, linewidth=0, label="95 % of a craft's values")
        time, value = (part.ravel() for part in np.broadcast_arrays(series.time_s[:, None], nees))
        every = -(-len(value) // MOST_DOTS)
        axes.plot(
            time[::every], value[::every], ".", color=BLUE, alpha=0.25, markersize=3, markeredgewidth=0, rasterized=True
        )
        axes.plot(*_running_mean(series.time_s, nees), color=ORANGE, label="mean over the craft and one second")
        axes.axhline(DOF, color=GREY, linewidth=1, linestyle=":")
        plain_log_y(axes)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("NEES")
        axes.legend(loc="lower right", ncols=2)

    return picture("nees", "NEES over time: a dot per craft and period, thinned in a large swarm.", paint)


def _running_mean(time_s: Floats, data: Floats, over_s: float = 1.0) -> tuple[Floats, Floats]:
    """Return the mean over the craft and over windows of `over_s` [s]: time and value."""
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else over_s
    window = np.ones(max(1, min(round(over_s / step), len(time_s))))
    known = np.isfinite(data)
    total = np.convolve(np.where(known, data, 0.0).sum(axis=1), window, "valid")
    count = np.convolve(known.sum(axis=1).astype(np.float64), window, "valid")
    centre = np.convolve(time_s, window / len(window), "valid")
    return centre, np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0)


def dilution(series: Series) -> Picture:
    """Draw the dilution of precision over time."""

    def paint(figure: Figure) -> None:
        for axes, column, label in zip(
            figure.subplots(1, 2), ("adop_deg_per_rad", "pdop_m_per_rad"), ("ADOP [°/rad]", "PDOP [m/rad]"), strict=True
        ):
            _many(axes, series, series.of(column))
            axes.set_title(label)
            axes.set_xlabel("time [s]")
            axes.set_ylim(bottom=0)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=8)

    return picture("dilution", "Attitude and position dilution of precision, per craft.", paint)


def visibility(series: Series) -> Picture:
    """Draw how many photodiodes are lit, and what the craft know, over time."""
    visible = series.of("visible")

    def paint(figure: Figure) -> None:
        count = len(series.names)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        extent = (series.time_s[0], series.time_s[-1], count - 0.5, -0.5)
        count_map(above, visible, extent, "photodiodes lit")
        if count <= 16:
            above.set_yticks(range(count), series.names)
        else:
            above.set_ylabel("craft, by number")
        bottom = np.zeros(len(series.time_s))
        for name in ("tracking", *STATUS_COLOURS):
            share = 100 * np.mean(series.being(name), axis=1)
            below.fill_between(
                series.time_s,
                bottom,
                bottom + share,
                step="mid",
                linewidth=0,
                label=name,
                color=STATUS_COLOURS.get(name, "#bcd7ee"),
            )
            bottom += share
        below.set_ylabel("craft [%]")
        below.set_ylim(0, 100)
        below.set_xlabel("time [s]")
        below.legend(loc="lower left", ncols=4)

    return picture(
        "visibility",
        "Photodiodes lit by both fans, per craft; below, what the craft know of their pose.",
        paint,
        height_in=min(5.5, 2.9 + 0.2 * len(series.names)),
    )


def _many(axes: Axes, series: Series, data: Floats) -> None:
    """Draw a line per craft if they are few, else the median and the middle 90 % over the craft."""
    if len(series.names) <= MOST_LINES:
        for i, name in enumerate(series.names):
            axes.plot(*thin(series.time_s, data[:, i]), color=SERIES[i % len(SERIES)], linewidth=0.9, label=name)
        return
    known = np.isfinite(data).any(axis=1)
    low, middle, high = np.full((3, len(data)), np.nan)
    low[known], middle[known], high[known] = np.nanquantile(data[known], [0.05, 0.5, 0.95], axis=1)
    axes.fill_between(series.time_s, low, high, color=BLUE, alpha=0.2, linewidth=0, label="middle 90 % of the craft")
    axes.plot(series.time_s, middle, color=BLUE, linewidth=1, label="median craft")
