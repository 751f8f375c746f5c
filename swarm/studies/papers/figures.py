"""How the experiments' figures look: sober axes, colours that the colour-blind tell apart, fit for a page's width."""

from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY, GREY = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
    "#777777",
)
"""Okabe and Ito's palette."""
STYLE: dict[Any, Any] = {
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


def page(rows: int, columns: int, height_in: float, width_in: float = 7.0) -> tuple[Figure, NDArray[np.object_]]:
    """A figure and its axes (rows, columns), without a window."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        return figure, figure.subplots(rows, columns, squeeze=False)


def legend(
    axes: Axes,
    columns: int = 1,
    place: Literal["best", "upper left", "upper right", "lower center", "lower right"] = "best",
) -> None:
    """A legend without a frame."""
    with mpl.rc_context(STYLE):
        axes.legend(ncols=columns, loc=place)
