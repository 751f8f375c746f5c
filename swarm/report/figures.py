"""Figures of a report: one look for all, in a wide layout and in a narrow one for a telephone.

A painter draws into an empty figure and asks `panels` for its axes, which stand beside each other in the wide layout
and below each other in the narrow one. Both are drawn with letters of the same size, so that they are read at the width
for which they are made. On request the same painter draws for a paper, in a format of `PAPER`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from estimators.arrays import Floats
from swarm.figures import Axes, Figure, draw_to, rendered, texts_of
from swarm.report.rows import Spread

BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#1f6fb4", "#d9772b", "#2f8f5b", "#c0392b", "#7b5ea7", "#7d8a97"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, RED, "#128a94", "#a5762e", "#5c6fc4")
WIDTH_IN, NARROW_IN = 9.0, 4.1
PAPER_WIDE_IN, PAPER_NARROW_IN = 7.1, 3.5
"""Widths of a page with two columns, and of one of its columns."""
LEAST_WIDE_IN = 5.5
"""A figure that is narrower has the narrow layout."""
NARROW_BELOW_PX = 640
"""Screens of less than this show the narrow layout."""
MOST_POINTS = 1500
PAPER = ("pdf", "svg")
"""Formats in which figures are drawn for a paper on request."""
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
_PAPER_LOOK: dict[str, Any] = {
    **_LOOK,
    "font.family": "STIXGeneral",
    "font.size": 8.0,
    "mathtext.fontset": "stix",
    "axes.formatter.use_mathtext": True,
    "axes.titlesize": 8.5,
    "axes.titleweight": "normal",
    "axes.edgecolor": "#444444",
    "axes.labelcolor": "black",
    "axes.linewidth": 0.6,
    "text.color": "black",
    "xtick.color": "black",
    "ytick.color": "black",
    "grid.linewidth": 0.4,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "legend.fontsize": 8.0,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
}
"""Letters of Times and mathematics as LaTeX sets them, embedded as TrueType, and text that stays text."""
_MATHEMATICS = {
    "°": r"$^{\circ}$",
    "µ": r"$\mu$",
    "σ": r"$\sigma$",
    "±": r"$\pm$",
    "≤": r"$\leq$",
    "≥": r"$\geq$",
    "²": r"$^{2}$",
    "–": "\u2013",
}
"""Signs of a label, and how LaTeX writes them."""
Paint = Callable[[Figure], None]


@dataclass(frozen=True)
class Picture:
    """A figure of a report: the name of its files, a caption, its painter, and its heights [inch]."""

    name: str
    caption: str
    paint: Paint
    height_in: float
    narrow_height_in: float

    @cached_property
    def _wide(self) -> tuple[bytes, bytes]:
        return rendered(self.paint, _LOOK, WIDTH_IN, self.height_in)

    @property
    def svg(self) -> bytes:
        """The wide layout as SVG."""
        return self._wide[0]

    @property
    def png(self) -> bytes:
        """The wide layout as PNG."""
        return self._wide[1]

    @cached_property
    def narrow(self) -> bytes:
        """The narrow layout as SVG."""
        return draw_to("svg", self.paint, _LOOK, (NARROW_IN, self.narrow_height_in))

    def drawn(self, kind: str) -> bytes:
        """Return the wide layout in one format: "png", "svg" or "pdf"."""
        return draw_to(kind, self.paint, _LOOK, (WIDTH_IN, self.height_in))

    def files(self, paper: str | None = None) -> dict[str, bytes]:
        """Return the files of the figure, by their names.

        paper: One of `PAPER`: draw the figure for a paper in this format, as wide as a page and as one of its two
        columns. None: the wide layout as SVG and as PNG.
        """
        return {f"{self.name}.svg": self.svg, f"{self.name}.png": self.png} if paper is None else self._for(paper)

    def _for(self, paper: str) -> dict[str, bytes]:
        sizes = (
            ("page", PAPER_WIDE_IN, self.height_in * PAPER_WIDE_IN / WIDTH_IN),
            ("column", PAPER_NARROW_IN, self.narrow_height_in * PAPER_NARROW_IN / NARROW_IN),
        )
        return {
            f"{self.name}-{name}.{paper}": draw_to(paper, self._in_mathematics, _PAPER_LOOK, (width_in, height_in))
            for name, width_in, height_in in sizes
        }

    def _in_mathematics(self, figure: Figure) -> None:
        self.paint(figure)
        for text in texts_of(figure):
            text.set_text(latex(text.get_text()))


def picture(
    name: str, caption: str, paint: Paint, height_in: float = 3.4, narrow_height_in: float | None = None
) -> Picture:
    """Return a figure of a report, which is drawn when it is asked for.

    Args:
        name: Stem of the figure's files.
        caption: Sentence that says what is seen; also the text for those who cannot see it.
        paint: Function that draws into an empty figure.
        height_in: Height of the wide layout [inch].
        narrow_height_in: Height of the narrow layout [inch], by default that of the wide one.
    """
    return Picture(name, caption, paint, height_in, narrow_height_in or height_in)


def is_narrow(figure: Figure) -> bool:
    """Tell whether a figure is of the narrow layout."""
    return float(figure.get_figwidth()) < LEAST_WIDE_IN


def panels(figure: Figure, count: int, columns: int = 2, **options: Any) -> list[Axes]:
    """Return axes in rows of `columns` in the wide layout, and all below each other in the narrow one.

    Args:
        figure: The figure.
        count: Number of axes.
        columns: Number of columns in the wide layout.
        **options: More of the axes' properties, as for `Figure.subplots`.
    """
    columns = 1 if is_narrow(figure) else min(columns, count)
    axes = list(figure.subplots(-(-count // columns), columns, squeeze=False, **options).flat)
    for empty in axes[count:]:
        empty.set_axis_off()
    return axes[:count]


def legend(figure: Figure, axes: Sequence[Axes] = (), columns: int = 5) -> None:
    """Put one legend above the axes, where it covers no curve; equal labels count once.

    Args:
        figure: The figure.
        axes: The axes whose labels are shown; none: all of the figure.
        columns: Most columns in the wide layout.
    """
    found: dict[str, Any] = {}
    for one in axes or figure.axes:
        for handle, label in zip(*one.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    if found:
        longest = max(map(len, found))
        fit = max(1, int((figure.get_figwidth() - 0.3) / (0.5 + 0.085 * longest)))
        figure.legend(
            list(found.values()), list(found), loc="outside upper left", ncols=min(columns, fit, len(found)),
            columnspacing=1.4, handlelength=1.6,
        )  # fmt: skip


def latex(text: str) -> str:
    """Return a label with its signs in LaTeX's mathematics."""
    if "$" in text:
        return text
    for sign, written in _MATHEMATICS.items():
        text = text.replace(sign, written)
    return text.replace("$$", "")


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
