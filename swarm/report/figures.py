"""Figures of a report: one look for all, drawn with matplotlib without a display, as SVG and as PNG."""

from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple, cast

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from estimators.arrays import Floats
from swarm.results.disk import writing

INK, GRID = "#1c2733", "#dfe5ec"
BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#1f6fb4", "#d9772b", "#2f8f5b", "#c0392b", "#7b5ea7", "#7d8a97"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, RED, "#128a94", "#a5762e", "#5c6fc4")
WIDTH_IN = 9.0
MOST_POINTS = 1500
STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.edgecolor": "#aab4bf",
    "axes.labelcolor": INK,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "lines.linewidth": 1.8,
    "lines.markersize": 5,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "svg.hashsalt": "lighthouse-swarm",
}


class Picture(NamedTuple):
    """A figure, drawn. name: of its files. alt: what it shows, for who cannot see it."""

    name: str
    caption: str
    alt: str
    svg: bytes
    png: bytes

    def write(self, folder: Path) -> list[Path]:
        """Write both forms into `folder`."""
        files = []
        for suffix, content in (("svg", self.svg), ("png", self.png)):
            file = folder / f"{self.name}.{suffix}"
            with writing(file):
                file.write_bytes(content)
            files.append(file)
        return files


def picture(
    name: str, caption: str, paint: Callable[[Figure], None], *, height_in: float = 3.4, alt: str = ""
) -> Picture:
    """Draw: `paint` gets an empty figure of the page's width."""
    with mpl.rc_context(cast(Any, STYLE)):
        figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
        paint(figure)
        svg, png = BytesIO(), BytesIO()
        figure.savefig(svg, format="svg", metadata={"Date": None})
        figure.savefig(png, format="png", dpi=160)
    return Picture(name, caption, alt or caption, svg.getvalue(), png.getvalue())


def band(
    axes: Axes, x: Floats, low: Floats, middle: Floats, high: Floats, label: str, colour: str, **style: Any
) -> None:
    """A line with the range between `low` and `high` behind it; gaps where a value is missing."""
    axes.fill_between(x, low, high, color=colour, alpha=0.16, linewidth=0)
    axes.plot(x, middle, color=colour, label=label, **style)


def thin(x: Floats, y: Floats, peaks: bool = False) -> tuple[Floats, Floats]:
    """At most about 1500 points of a long series (n,): means of neighbours, or where `peaks` their largest."""
    step = -(-len(x) // MOST_POINTS)
    if step <= 1:
        return x, y
    size = -(-len(x) // step) * step
    padded_x, padded_y = (np.append(v, np.full(size - len(v), np.nan)).reshape(-1, step) for v in (x, y))
    known = np.isfinite(padded_y)
    if peaks:
        merged = np.where(known, padded_y, -np.inf).max(axis=1)
    else:
        merged = np.where(known, padded_y, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    return np.nanmean(padded_x, axis=1), np.where(known.any(axis=1), merged, np.nan)


def plain_log(axes: Axes) -> None:
    """A logarithmic y axis with plain numbers at 1, 2 and 5 of every decade."""
    axes.set_yscale("log", subs=[2, 5])
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    low, high = axes.get_ylim()
    few = np.log10(high / low) < 2.5
    axes.yaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}") if few else NullFormatter())


def craft_axis(axes: Axes, counts: Floats) -> None:
    """A logarithmic axis of numbers of craft, ticked where there are runs."""
    axes.set_xscale("log")
    axes.set_xticks(counts, [f"{count:,.0f}".replace(",", " ") for count in counts])
    axes.set_xticks([], minor=True)
    axes.set_xlabel("craft in the swarm")
