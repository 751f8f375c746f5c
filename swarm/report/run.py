"""What one run shows: error against 3 sigma, consistency, dilution and visibility over time, and a table per craft."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import chi2

from estimators.arrays import Bools, Floats
from swarm.figures import Axes, Figure, count_map, plain_log_y
from swarm.report.figures import BLUE, GREY, ORANGE, SERIES, Picture, picture, thin
from swarm.report.page import Column, Fact, Section, Table, number, prose
from swarm.report.run_table import about, limits, outcome
from swarm.results.run_folder import Run
from swarm.results.table import TelemetryTable

DOF = 6
MOST_LINES, MOST_PANELS, MOST_ROWS, MOST_DOTS = 10, 4, 60, 20_000
PROSE = "run.txt.j2"
STATUS_COLOURS = {"searching": "#c0392b", "ambiguous": "#7b5ea7", "coasting": "#e6a23c"}


class Series:
    """Telemetry as arrays (periods, craft), NaN where missing."""

    def __init__(self, rows: TelemetryTable) -> None:
        self._rows = rows
        self.names = rows.names_of("craft")
        self._row = rows.frame - rows.frame.min()
        self.shape = int(self._row.max()) + 1, len(self.names)
        self.time_s: Floats = np.nanmin(self.of("time_s"), axis=1)

    def of(self, column: str) -> Floats:
        """Return one column."""
        return self._grid(self._rows.column(column))

    def being(self, status: str) -> Bools:
        """Return whether a craft has this status, (periods, craft)."""
        out: Bools = self._grid(self._rows.being("status", status)) == 1
        return out

    def _grid(self, flat: Floats | Bools) -> Floats:
        out = np.full(self.shape, np.nan)
        out[self._row, self._rows.craft] = flat
        return out


def facts(run: Run) -> list[Fact]:
    """The run in a few figures."""
    swarm = run.summary.get("swarm") or {}
    out = [
        Fact(
            "Tracking",
            f"{number(swarm.get('tracking_share'), scale=100)} %",
            f"of the time, {run.summary['craft_count']} craft",
        ),
        Fact(
            "Position error, RMS",
            f"{number(swarm.get('ekf_position_rms_m'), scale=1000)} mm",
            f"at most {number(swarm.get('ekf_position_max_m'), scale=1000)} mm",
        ),
        Fact(
            "Attitude error, RMS",
            f"{number(swarm.get('ekf_attitude_rms_deg'))}°",
            f"at most {number(swarm.get('ekf_attitude_max_deg'))}°",
        ),
    ]
    if nees := swarm.get("nees"):
        side = "inside" if nees["inside_band"] else "outside"
        out.append(
            Fact(
                "NEES, mean",
                number(nees["mean"]),
                f"{side} the 95 % band {number(nees['band_low'])} to {number(nees['band_high'])}; 6 is consistent",
            )
        )
    return [fact for fact in out if not fact.value.startswith("–")]


def sections(run: Run) -> list[Section]:
    """Figures over time, then the craft in a table."""
    if not len(run.telemetry):
        return [Section("Nothing was recorded", ["Not one lighthouse period was recorded."])]
    series = Series(TelemetryTable.of(run.telemetry))
    out = []
    if np.isfinite(series.of("position_error_m")).any():
        which = prose(PROSE, "which", craft=len(series.names)) if len(series.names) > MOST_PANELS else []
        out += [
            Section("Error against what the filter believes", prose(PROSE, "error") + which, [_errors(series)]),
            Section("Consistency", prose(PROSE, "consistency"), [_nees(series)]),
        ]
    return [
        *out,
        Section("Geometry", prose(PROSE, "geometry"), [_dilution(series)]),
        Section("Visibility", (), [_visibility(series)]),
        *([Section("Criteria", (), (), [_criteria(verdicts)])] if (verdicts := run.summary.get("criteria")) else []),
        Section("Craft by craft", (), (), [_table(run.summary.get("craft", {}))]),
    ]


def _criteria(verdicts: Sequence[Mapping[str, Any]]) -> Table:
    rows = [[v["name"], outcome(v).lower(), about(v), number(v["value"]), limits(v)] for v in verdicts]
    return Table([Column(head) for head in ("criterion", "", "craft", "value", "limits")], rows, left=3)


def _chosen(series: Series) -> list[int]:
    """All craft if few; else evenly from the best to the worst by RMS position error."""
    count = len(series.names)
    if count <= MOST_PANELS:
        return list(range(count))
    error = series.of("position_error_m")
    known = np.isfinite(error)
    mean_square = np.where(known, error, 0.0)
    rms = np.where(known.any(axis=0), np.sqrt((mean_square**2).sum(axis=0) / np.maximum(known.sum(axis=0), 1)), np.inf)
    order = np.argsort(rms, kind="stable")
    return [int(order[i]) for i in np.linspace(0, count - 1, MOST_PANELS).round().astype(int)]


def _errors(series: Series) -> Picture:
    chosen = _chosen(series)

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
                # The start, when a craft has only just found itself, must not flatten the rest.
                settled = np.concatenate([wrong, believed])
                settled = settled[np.isfinite(settled)]
                if settled.size:
                    axes.set_ylim(
                        0,
                        1.15
                        * max(
                            np.quantile(believed[np.isfinite(believed)], 0.97),
                            np.quantile(wrong[np.isfinite(wrong)], 0.999),
                        ),
                    )
        grid[0][0].legend(loc="upper right", ncols=2)
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")

    return picture(
        "error", "Error of the filter's estimate and its 3 sigma, over time.", paint, height_in=0.6 + 1.75 * len(chosen)
    )


def _nees(series: Series) -> Picture:
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
    """Mean over the craft, and over windows of `over_s`."""
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else over_s
    window = np.ones(max(1, min(round(over_s / step), len(time_s))))
    known = np.isfinite(data)
    total = np.convolve(np.where(known, data, 0.0).sum(axis=1), window, "valid")
    count = np.convolve(known.sum(axis=1).astype(np.float64), window, "valid")
    centre = np.convolve(time_s, window / len(window), "valid")
    return centre, np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0)


def _dilution(series: Series) -> Picture:
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


def _visibility(series: Series) -> Picture:
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
    """A line per craft if they are few, else the median and the middle 90 % over the craft."""
    if len(series.names) <= MOST_LINES:
        for i, name in enumerate(series.names):
            axes.plot(*thin(series.time_s, data[:, i]), color=SERIES[i % len(SERIES)], linewidth=0.9, label=name)
        return
    known = np.isfinite(data).any(axis=1)
    low, middle, high = np.full((3, len(data)), np.nan)
    low[known], middle[known], high[known] = np.nanquantile(data[known], [0.05, 0.5, 0.95], axis=1)
    axes.fill_between(series.time_s, low, high, color=BLUE, alpha=0.2, linewidth=0, label="middle 90 % of the craft")
    axes.plot(series.time_s, middle, color=BLUE, linewidth=1, label="median craft")


def _table(craft: Mapping[str, Any]) -> Table:
    wanted = [
        ("tracking_share", 100.0, Column("tracking", "%")),
        ("mean_visible", 1.0, Column("photodiodes lit", "mean")),
        ("ekf_position_rms_m", 1000.0, Column("position RMS", "mm")),
        ("ekf_position_max_m", 1000.0, Column("position max", "mm")),
        ("ekf_attitude_rms_deg", 1.0, Column("attitude RMS", "°")),
        ("ekf_attitude_max_deg", 1.0, Column("attitude max", "°")),
        ("pnp_position_rms_m", 1000.0, Column("PnP position RMS", "mm")),
        ("mean_adop_deg_per_rad", 1.0, Column("ADOP", "°/rad")),
        ("mean_pdop_m_per_rad", 1.0, Column("PDOP", "m/rad")),
        ("peer_position_scatter_mm", 1.0, Column("peer scatter", "mm")),
    ]
    known = [w for w in wanted if any(figures.get(w[0]) is not None for figures in craft.values())]
    worst = sorted(craft.items(), key=lambda item: -(item[1].get("ekf_position_rms_m") or 0.0))[:MOST_ROWS]
    shown = list(craft.items()) if len(craft) <= MOST_ROWS else worst
    body = []
    for name, figures in shown:
        nees = figures.get("nees")
        band = f"{nees['band_low']:.2f}–{nees['band_high']:.2f}" if nees else "–"
        body.append(
            [
                name,
                *(number(figures.get(key), scale=scale) for key, scale, _ in known),
                number(nees["mean"] if nees else None),
                band,
            ]
        )
    caption = f"The {MOST_ROWS} worst of {len(craft)} craft." if len(shown) < len(craft) else ""
    return Table([Column("craft"), *(c for _, _, c in known), Column("NEES"), Column("95 % band")], body, caption)
