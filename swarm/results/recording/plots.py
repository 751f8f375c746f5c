"""The recording's plots: their lines, and the values of these for a batch of periods; plain arrays, no viewer.

Angles in degrees, lengths in millimetres, dilutions per milliradian of angle noise. A 3 sigma line is three times the
root of the trace of the filter's covariance, as in telemetry.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from estimators.arrays import Floats, Ints
from swarm.results.columns.column import Column
from swarm.results.columns.core import STATUS_TEXT
from swarm.results.recording.batch import Batch

DOF = 6
ORANGE, BLUE, RED = 0xFFB74DFF, 0x4FC3F7FF, 0xFF5252FF
STATUS_COLOURS = (0xC62828FF, 0x2E7D32FF, 0xEF6C00FF, 0x8E24AAFF, 0x7CB342FF)
"""Colours of the names in `STATUS_TEXT`."""
THIN, MEDIUM, BOLD = 1.2, 1.6, 2.2
Values = Callable[[Batch], Floats]


class Line(NamedTuple):
    """One line of a plot."""

    name: str
    colour: int
    width: float


SOLUTION = Line("PnP", 0xFFB74D90, THIN)
FILTER = Line("EKF", BLUE, MEDIUM)
SIGMA = Line("EKF 3σ", 0xECEFF1FF, BOLD)
SWARM_SIGMA = Line("3σ (RMS)", 0xECEFF1FF, BOLD)
CAMERAS = Line("cameras", 0x69F0AE90, THIN)
RECORDED = Line("recorded pose", 0xECEFF1FF, THIN)
BAND = (Line("95 % low", 0x90A4AEC0, BOLD), Line("95 % high", 0x90A4AEC0, BOLD))
NEES, NIS = Line("NEES", 0xFFF176FF, THIN), Line("NIS", 0xFFF176FF, THIN)


class Plot(NamedTuple):
    """One plot: its entity, title with unit, lines, and their values (n, lines) for a batch."""

    entity: str
    title: str
    lines: Sequence[Line]
    values: Values


def band(count: NDArray[np.integer]) -> Floats:
    """Return the 95 % band, (..., 2), of the mean of `count` (...) chi-square values with 6 degrees of freedom."""
    counts, which = np.unique(count, return_inverse=True)
    n = np.where(counts > 0, counts, np.nan)
    edges = np.stack([2 * gammaincinv(DOF * n / 2, share) / n for share in (0.025, 0.975)], axis=-1)
    out: Floats = edges[which.reshape(count.shape)]
    return out


def _rms(x: Floats) -> Floats:
    """Return the RMS over the craft that know it, (n,)."""
    known = np.isfinite(x)
    count = np.count_nonzero(known, axis=1)
    total = np.sum(np.where(known, x, 0.0) ** 2, axis=1)
    out: Floats = np.sqrt(np.divide(total, count, out=np.full(len(x), np.nan), where=count > 0))
    return out


def _spread(x: Floats, shares: tuple[float, ...]) -> Floats:
    """Return quantiles over the craft that know it, (n, shares); `np.nanquantile` would go row by row."""
    ordered, last = np.sort(x, axis=1), np.count_nonzero(~np.isnan(x), axis=1) - 1
    place = np.maximum(last[:, None], 0) * np.array(shares)
    below = np.floor(place).astype(np.int64)
    above = np.minimum(below + 1, np.maximum(last[:, None], 0))
    low, high = (np.take_along_axis(ordered, which, axis=1) for which in (below, above))
    part = place - below
    out: Floats = np.where(part < 0.5, low + (high - low) * part, high - (high - low) * (1 - part))
    return out


HIGH = {"median": 0.5, "95 %": 0.95, "worst": 1.0}
"""Quantiles of a crowd where much is bad."""
LOW = {"median": 0.5, "5 %": 0.05, "fewest": 0.0}
"""Quantiles of a crowd where little is bad."""


class _Swarm(NamedTuple):
    """Plots of the craft that navigate: a line each, or in a crowd their spread.

    craft, colours: of these craft. crowd: show the spread. which: their indices.
    """

    craft: Sequence[str]
    colours: Sequence[int]
    crowd: bool
    which: Ints

    def plot(
        self, entity: str, title: str, of: Values, sigma: Values | None = None, spread: dict[str, float] = HIGH
    ) -> Plot:
        """Return a plot of a figure.

        Args:
            entity: Its name below `swarm`.
            title: Its title, with the unit.
            of: The figure, (n, C).
            sigma: The figure's 1 sigma, (n, C): three times its RMS over the swarm is a line of its own.
            spread: Quantiles that are shown of a crowd.
        """
        inks = (BLUE, ORANGE, RED) if self.crowd else self.colours
        names = zip(spread if self.crowd else self.craft, inks, strict=True)
        lines = [Line(name, colour, THIN) for name, colour in names]

        def values(batch: Batch) -> Floats:
            mine = of(batch)[:, self.which]
            lines = _spread(mine, tuple(spread.values())) if self.crowd else mine
            return lines if sigma is None else np.concatenate([lines, 3 * _rms(sigma(batch))[:, None]], axis=1)

        if sigma is not None:
            # A line for every craft leaves no room for a legend.
            title, lines = f"{title}; white: {SWARM_SIGMA.name}", [*lines, SWARM_SIGMA]
        return Plot(f"swarm/{entity}", title, lines, values)


def _nees(batch: Batch) -> Floats:
    nees = batch.errors.nees
    known = np.isfinite(nees)
    count = np.count_nonzero(known, axis=1)
    total = np.sum(np.where(known, nees, 0.0), axis=1)
    mean = np.divide(total, count, out=np.full(len(nees), np.nan), where=count > 0)
    return np.concatenate([mean[:, None], band(count)], axis=1)


def _counts(batch: Batch) -> Floats:
    counts = [np.count_nonzero(batch.status == code, axis=1) for code in range(len(STATUS_TEXT))]
    return np.stack(counts, axis=1).astype(np.float64)


def swarm_plots(
    craft: Sequence[str], colours: Sequence[int], crowd: bool, replay: bool, without: Sequence[str] = ()
) -> list[Plot]:
    """Return the plots over the craft that navigate, from the top down.

    Args:
        craft: Names of the craft.
        colours: Their colours.
        crowd: Show the spread instead of the craft.
        replay: There is no truth.
        without: Names of craft without a sensor, which are left out; if there are no others, they are shown.
    """
    which = [i for i, name in enumerate(craft) if name not in set(without)] or list(range(len(craft)))
    swarm = _Swarm([craft[i] for i in which], [colours[i] for i in which], crowd, np.array(which, dtype=np.int64))
    if replay:
        first = [
            swarm.plot("residual", "PnP residual RMS [µrad]", lambda b: 1e6 * b.residual_rad),
            swarm.plot("position_sigma", "EKF position 3σ [mm]", lambda b: 3 * (1e3 * b.errors.position_sigma_m)),
            swarm.plot("attitude_sigma", "EKF attitude 3σ [deg]", lambda b: 3 * (1.0 * b.errors.attitude_sigma_deg)),
        ]
    else:
        first = [
            swarm.plot(
                "position_error",
                "EKF position error [mm]",
                lambda b: 1e3 * b.errors.position_error_m,
                lambda b: 1e3 * b.errors.position_sigma_m,
            ),
            swarm.plot(
                "attitude_error",
                "EKF attitude error [deg]",
                lambda b: b.errors.attitude_error_deg,
                lambda b: b.errors.attitude_sigma_deg,
            ),
            Plot("swarm/nees", "NEES, mean of the swarm [6 if consistent]", (NEES, *BAND), _nees),
        ]
    states = [Line(name, colour, BOLD) for name, colour in zip(STATUS_TEXT, STATUS_COLOURS, strict=True)]
    return [
        *first,
        swarm.plot("adop", "ADOP [deg/rad]", lambda b: b.adop),
        swarm.plot("pdop", "PDOP [m/rad]", lambda b: b.pdop),
        swarm.plot("lit", "Photodiodes lit", lambda b: b.visible.astype(np.float64), spread=LOW),
        *([Plot("swarm/status", "Craft by status", states, _counts)] if crowd else []),
    ]


def _detail(craft: str, entity: str, title: str, lines: Mapping[Line, Values]) -> Plot:
    def values(batch: Batch) -> Floats:
        return np.stack([of(batch) for of in lines.values()], axis=1)

    return Plot(f"detail/{craft}/{entity}", f"{craft}: {title}", list(lines), values)


def _of(field: str, *index: int) -> Values:
    """Return what takes one craft's series out of a field of a batch."""
    return lambda batch: getattr(batch, field)[:, *index]


def _constant(value: float, batch: Batch) -> Floats:
    return np.full(len(batch.time_s), value)


def craft_plots(name: str, i: int, replay: bool, ccd: bool = False) -> list[Plot]:
    """Return the plots of one craft, from the top down.

    Args:
        name: The craft.
        i: Its index.
        replay: There is no truth, but another program's pose.
        ccd: The craft carries cameras.
    """
    edges = band(np.array(1))
    limits = {line: partial(_constant, float(edge)) for line, edge in zip(BAND, edges, strict=True)}
    if replay:
        parts = ((SOLUTION, "pnp_position"), (FILTER, "position"), (RECORDED, "peer_position"))
        axes = [
            _detail(name, f"position_{axis}", f"{axis} [m]", {line: _of(field, i, a) for line, field in parts})
            for a, axis in enumerate("xyz")
        ]
        return [*axes, _detail(name, "nis", "NIS", {NIS: _of("nis", i), **limits})]
    position: dict[Line, Values] = {
        CAMERAS: lambda b: 1e3 * b.ccd_error[:, i, 0],
        SOLUTION: lambda b: 1e3 * b.errors.pnp_position_error_m[:, i],
        FILTER: lambda b: 1e3 * b.errors.position_error_m[:, i],
        SIGMA: lambda b: 3e3 * b.errors.position_sigma_m[:, i],
    }
    attitude: dict[Line, Values] = {
        CAMERAS: lambda b: b.ccd_error[:, i, 1],
        SOLUTION: lambda b: b.errors.pnp_attitude_error_deg[:, i],
        FILTER: lambda b: b.errors.attitude_error_deg[:, i],
        SIGMA: lambda b: 3 * b.errors.attitude_sigma_deg[:, i],
    }
    if not ccd:
        del position[CAMERAS], attitude[CAMERAS]
    nis = _of("ccd_nis" if ccd else "nis", i)
    return [
        _detail(name, "position_error", "position error [mm]", position),
        _detail(name, "attitude_error", "attitude error [deg]", attitude),
        _detail(name, "nees", "NEES", {NEES: lambda b: b.errors.nees[:, i], **limits}),
        _detail(name, "nis", "NIS of the cameras" if ccd else "NIS", {NIS: nis, **limits}),
    ]


def shown_plots(name: str, i: int, columns: Sequence[Column]) -> list[Plot]:
    """Return a plot of each shown column of numbers.

    Args:
        name: The craft.
        i: Its index.
        columns: The shown columns, in the order of `Batch.shown`.
    """
    return [
        _detail(
            name,
            c.name,
            c.plot if c.unit in ("", "1") else f"{c.plot} [{c.unit}]",
            {Line(c.plot, BLUE, MEDIUM): _of("shown", i, row)},
        )
        for row, c in enumerate(columns)
        if not c.names
    ]
