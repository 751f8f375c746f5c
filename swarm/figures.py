"""Figures, drawn without a display. The only file that imports matplotlib.

`page` returns a figure in the style of those that stand beside a paper's: it fits a page's width, in colours that the
colour-blind can distinguish (Okabe and Ito's palette). `rendered` draws in any other style, such as that of the HTML
report.
"""

from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator
from numpy.typing import NDArray

from estimators.arrays import Floats

__all__ = ["Axes", "Figure"]

BLUE, ORANGE, GREEN, VERMILLION, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#777777"
INKS = (BLUE, ORANGE, GREEN)
"""Colours of three series side by side, such as the axes x, y and z."""
_PAGE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "svg.fonttype": "none",
}
FEW_DECADES = 2.5
"""Axes of fewer decades than these have numbers at 1, 2 and 5 of each."""


def page(rows: int, columns: int, height_in: float, width_in: float = 7.0) -> tuple[Figure, NDArray[np.object_]]:
    """Return an empty figure in the papers' style, and its axes (rows, columns).

    Args:
        rows: number of rows of axes.
        columns: number of columns of axes.
        height_in: height of the figure [inch].
        width_in: width of the figure [inch].
    """
    with mpl.rc_context(_PAGE):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        return figure, figure.subplots(rows, columns, squeeze=False)


def rendered(
    paint: Callable[[Figure], None], look: Mapping[Any, Any], width_in: float, height_in: float
) -> tuple[bytes, bytes]:
    """Draw a figure and return it as SVG and as PNG.

    Args:
        paint: function that draws into an empty figure.
        look: matplotlib settings.
        width_in: width of the figure [inch].
        height_in: height of the figure [inch].
    """
    with mpl.rc_context(dict(look)):
        figure = _painted(paint, (width_in, height_in))
        return _saved(figure, "svg"), _saved(figure, "png")


def draw_to(kind: str, paint: Callable[[Figure], None], look: Mapping[Any, Any], size_in: tuple[float, float]) -> bytes:
    """Draw a figure and return it in one format.

    Args:
        kind: the format: "svg", "png" or "pdf".
        paint: function that draws into an empty figure.
        look: matplotlib settings.
        size_in: width and height of the figure [inch].
    """
    with mpl.rc_context(dict(look)):
        return _saved(_painted(paint, size_in), kind)


def _painted(paint: Callable[[Figure], None], size_in: tuple[float, float]) -> Figure:
    figure = Figure(figsize=size_in, layout="constrained")
    paint(figure)
    return figure


def _saved(figure: Figure, kind: str) -> bytes:
    out = BytesIO()
    undated = {"svg": "Date", "pdf": "CreationDate"}.get(kind)
    figure.savefig(out, format=kind, dpi=160, metadata=None if undated is None else {undated: None})
    # The second format has the same layout: to find it takes longer than to draw it.
    figure.set_layout_engine("none")
    return out.getvalue()


def texts_of(figure: Figure) -> list[Text]:
    """Return all texts of a figure but the numbers at its ticks, which are made when it is drawn."""
    ticks = {id(text) for axes in figure.axes for text in (*axes.get_xticklabels(), *axes.get_yticklabels())}
    return [text for text in figure.findobj(Text) if isinstance(text, Text) and id(text) not in ticks]


def save(figure: Figure, file: Path, salt: str | None = None) -> None:
    """Write a figure in the format that the file's suffix selects (.png or .svg).

    Args:
        figure: the figure.
        file: path of the file; a suffix `.tmp` may follow the format's.
        salt: text from which the SVG's identifiers are computed; with it the file is the same every time.
    """
    kind = file.name.removesuffix(".tmp").rpartition(".")[2]
    options: dict[str, Any] = {"metadata": {"Date": None}} if kind == "svg" else {"dpi": 150}
    with mpl.rc_context({} if salt is None else {"svg.hashsalt": salt}):
        figure.savefig(file, format=kind, **options)


def legend(
    axes: Axes,
    columns: int = 1,
    place: Literal["best", "upper left", "upper right", "lower center", "lower right"] = "best",
) -> None:
    """Add a legend in the papers' style.

    Args:
        axes: axes to label.
        columns: number of columns.
        place: location in the axes.
    """
    with mpl.rc_context(_PAGE):
        axes.legend(ncols=columns, loc=place)


def measured_and_said(axes: Axes, x: Any, measured: Any, said: Any, ink: str, label: str, size: float = 2.5) -> None:
    """Draw measured values as dots and predicted ones as a line of the same colour.

    Args:
        axes: axes to draw in; their scales stay as they are.
        x: abscissas, (n,).
        measured: measured values, (n,).
        said: predicted values, (n,).
        ink: colour of both.
        label: label of the dots in the legend.
        size: size of the dots [pt].
    """
    axes.plot(x, measured, "o", ms=size, color=ink, label=label)
    axes.plot(x, said, "-", lw=0.9, color=ink)


def plain_log_y(axes: Axes) -> None:
    """Make the y axis logarithmic, with plain numbers at 1, 2 and 5 of every decade."""
    axes.set_yscale("log", subs=[2, 5])
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    low, high = axes.get_ylim()
    few = np.log10(high / low) < FEW_DECADES
    axes.yaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}") if few else NullFormatter())


def decade_ticks(low: float, high: float) -> list[float]:
    """Return 1, 2 and 5 of every decade from `low` to `high`; of many decades, the powers of ten."""
    first, last = np.log10(low), np.log10(high)
    steps = (1.0, 2.0, 5.0) if last - first < FEW_DECADES else (1.0,)
    decades = range(int(np.floor(first)), int(np.ceil(last)) + 1)
    return [step * 10.0**n for n in decades for step in steps if first <= np.log10(step) + n <= last]


def plain_log_x(axes: Axes, ticks: Sequence[float]) -> None:
    """Make the x axis logarithmic, with plain numbers at `ticks` and nothing between them."""
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def count_map(axes: Axes, counts: Floats, extent: tuple[float, float, float, float], label: str) -> None:
    """Draw whole numbers (columns, rows) as shades of blue, with a colour bar.

    Args:
        axes: axes to draw in.
        counts: numbers from 0 on, NaN where missing, (columns, rows); the first axis runs to the right.
        extent: left, right, bottom and top edges in data coordinates.
        label: label of the colour bar.
    """
    most = int(np.nanmax(counts))
    shades = [(0.93 - 0.81 * s, 0.95 - 0.51 * s, 0.97 - 0.26 * s) for s in np.linspace(0, 1, most + 1)]
    image = axes.imshow(
        counts.T,
        aspect="auto",
        interpolation="nearest",
        extent=extent,
        cmap=ListedColormap(shades),
        norm=BoundaryNorm(np.arange(most + 2) - 0.5, most + 1),
    )
    figure = axes.get_figure(root=True)
    assert figure is not None
    figure.colorbar(image, ax=axes, ticks=range(0, most + 1, max(1, -(-most // 5))), label=label)
    axes.grid(visible=False)


def polygons(axes: Axes, corners: Floats, colours: Floats) -> None:
    """Draw filled polygons, each over the previous ones.

    Args:
        axes: axes to draw in.
        corners: corners of the polygons, (n, k, 2).
        colours: RGB colours, (n, 3).
    """
    axes.add_collection(PolyCollection(list(corners), facecolors=colours, edgecolors=colours, lw=0.6))


def strips(axes: Axes, paths: Floats, colour: str, label: str) -> None:
    """Draw many faint paths as one picture of pixels, and let the axes hold them.

    Args:
        axes: axes to draw in.
        paths: corners of the paths, NaN where missing, (n, k, 2).
        colour: colour of all.
        label: label of all in the legend.
    """
    alpha = float(np.clip(12 / len(paths), 0.08, 0.6))
    axes.add_collection(LineCollection(list(paths), colors=colour, linewidths=0.7, alpha=alpha, rasterized=True))
    axes.plot([], [], color=colour, linewidth=0.8, label=label)
    known = paths[np.isfinite(paths).all(axis=2)]
    axes.update_datalim(known)
    axes.autoscale_view()


def value_points(axes: Axes, points: Floats, values: Floats, label: str) -> None:
    """Draw points coloured by their values, the largest over the others, with a colour bar.

    Args:
        axes: axes to draw in.
        points: places, (n, 2).
        values: numbers, (n,).
        label: label of the colour bar.
    """
    order = np.argsort(values)
    x, y = points[order].T
    drawn = axes.scatter(x, y, s=7, c=values[order], cmap="viridis", linewidths=0)
    figure = axes.get_figure(root=True)
    assert figure is not None
    figure.colorbar(drawn, ax=axes, label=label, shrink=0.8)


def value_map(axes: Axes, values: Floats) -> None:
    """Draw numbers (columns, rows) as colours, a cell each, with a colour bar; the first row is below.

    Args:
        axes: axes to draw in.
        values: numbers, NaN where missing, (columns, rows).
    """
    image = axes.imshow(values.T, aspect="auto", interpolation="nearest", origin="lower", cmap="viridis")
    figure = axes.get_figure(root=True)
    assert figure is not None
    figure.colorbar(image, ax=axes)
    axes.grid(visible=False)
