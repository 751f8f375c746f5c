"""Figures of a report: one look for all, each as SVG and as PNG."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Floats
from swarm.figures import Axes, Figure, rendered
from swarm.report.rows import Spread
from swarm.results.disk import writing

BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#1f6fb4", "#d9772b", "#2f8f5b", "#c0392b", "#7b5ea7", "#7d8a97"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, RED, "#128a94", "#a5762e", "#5c6fc4")
WIDTH_IN = 9.0
MOST_POINTS = 1500
_INK = "#1c2733"
_LOOK: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.edgecolor": "#aab4bf",
    "axes.labelcolor": _INK,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#dfe5ec",
    "grid.linewidth": 0.8,
    "text.color": _INK,
    "xtick.color": _INK,
    "ytick.color": _INK,
    "lines.linewidth": 1.8,
    "lines.markersize": 5,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "svg.hashsalt": "lighthouse-swarm",
}


class Picture(NamedTuple):
    """A finished figure of a report: the name of its files, a caption, and both forms of it."""

    name: str
    caption: str
    svg: bytes
    png: bytes

    def write(self, folder: Path) -> list[Path]:
        """Write both forms into `folder`, and return the files."""
        files = []
        for suffix, content in (("svg", self.svg), ("png", self.png)):
            file = folder / f"{self.name}.{suffix}"
            with writing(file):
                file.write_bytes(content)
            files.append(file)
        return files


def picture(name: str, caption: str, paint: Callable[[Figure], None], height_in: float = 3.4) -> Picture:
    """Draw a figure of a report.

    Args:
        name: Stem of the figure's files.
        caption: Sentence that says what is seen; also the text for those who cannot see it.
        paint: Function that draws into an empty figure of the page's width.
        height_in: Height of the figure [inch].
    """
    return Picture(name, caption, *rendered(paint, _LOOK, WIDTH_IN, height_in))


def band(axes: Axes, x: Floats, spread: Spread, label: str, colour: str, **style: Any) -> None:
    """Draw means as a line with their range behind it; a missing value leaves a gap.

    Args:
        axes: Where to draw.
        x: Abscissas (n,).
        spread: Means and ranges (n,).
        label: Label in the legend.
        colour: Colour of line and range.
        **style: More of the line's properties.
    """
    axes.fill_between(x, spread.low, spread.high, color=colour, alpha=0.16, linewidth=0)
    axes.plot(x, spread.mean, color=colour, label=label, **style)


def thin(x: Floats, y: Floats, peaks: bool = False) -> tuple[Floats, Floats]:
    """Thin a long series to about 1500 points.

    Args:
        x: Abscissas (n,).
        y: Values (n,), NaN where missing.
        peaks: Keep the largest of neighbouring values instead of their mean.
    """
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
