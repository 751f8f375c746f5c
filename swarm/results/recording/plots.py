"""The recording's plots: which lines there are, and their values for a batch of periods; plain arrays, no viewer.

Angles in degrees, lengths in millimetres, dilutions per milliradian of angle noise. A 3 sigma line is three times the
root of the trace of the filter's covariance, as in telemetry.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from estimators.arrays import Bools, Floats, Ints
from swarm.results.columns import ccd as ccd_columns
from swarm.results.columns.ccd import CCD_STATES
from swarm.results.columns.column import Column, Group
from swarm.results.columns.core import STATUS
from swarm.results.period import Period
from swarm.results.records import Errors

DOF = 6
WHITE, GREY = 0xECEFF1FF, 0x90A4AEC0
ORANGE, ORANGE_DIM, BLUE, RED, YELLOW = 0xFFB74DFF, 0xFFB74D90, 0x4FC3F7FF, 0xFF5252FF, 0xFFF176FF
GREEN_DIM = 0x69F0AE90
SENSOR_COLOURS = (0x616161FF, 0xFF8A65FF, 0x43A047FF, 0x26A69AFF, 0xFBC02DFF, 0xFB8C00FF, 0x7E57C2FF)
"""Of the names in `SENSORS`."""
STATE_COLOURS = (
    0x616161FF, 0x1E88E5FF, 0x43A047FF, 0x26A69AFF, 0xFBC02DFF, 0x7CB342FF,
    0xEF6C00FF, 0xE53935FF, 0x8E24AAFF, 0x5C6BC0FF, 0x455A64FF, 0xD81B60FF,
)  # fmt: skip
"""Of the names of any other column, in turn."""
STATUS_COLOURS = (0x616161FF, 0x2E7D32FF, 0xEF6C00FF, 0x8E24AAFF)
THIN, MEDIUM, BOLD = 1.2, 1.6, 2.2

ABOUT = """# What is drawn

| | |
|---|---|
| solid craft | {craft} |
| outline | where its filter believes it is |
| ellipsoid | the filter's 3 sigma of position, **enlarged {enlarged} times**, to half a metre at most |
| green ray, point | photodiode lit by the lighthouse |
| red ray, point | photodiode in reach, but something stands in between |
| grey point | photodiode outside field or range, or turned away |
| two translucent fans | the lighthouse's lasers, **slowed down {slowed:.0f} times** |
{cameras}| thin trail | where the craft was in the last {trail:.0f} s |

The axes are those of the lighthouse: x right (red), y down (green), z forward (blue).

# Plots

*Errors* are distances and angles from the truth; below the *3σ* line the filter deserves its confidence.
*NEES* is the squared error over the filter's own covariance: 6 on average if it is consistent; the band holds 95 % of
the values of independent craft. *ADOP* and *PDOP* say how much attitude and position suffer from angle noise. A
*protection level* is what the craft says its error is below, false photodiodes included.
"""


class Batch(NamedTuple):
    """What is drawn of one period, (C, ...), or stacked of n periods, (n, C, ...). body: the truth, or the estimate."""

    time_s: Floats
    frame: Ints
    body_position: Floats
    body_quaternion: Floats
    position: Floats
    rotation: Floats
    covariance: Floats
    sight: NDArray[np.integer]
    status: Ints
    visible: Ints
    adop: Floats
    pdop: Floats
    pnp_position: Floats
    residual_rad: Floats
    nis: Floats
    errors: Floats
    peer_position: Floats
    sensor: Ints
    ccd_state: Ints
    ccd_seen: Bools
    ccd_position: Floats
    ccd_error: Floats
    ccd_nis: Floats
    shown: Floats


def kept(period: Period, errors: Errors, body_quaternion: Floats, shown: Floats) -> Batch:
    """Copies of what is drawn of a period: its arrays may be the next period's workspace."""
    truth, estimate, peer = period.truth, period.estimate, period.peer
    kept_arrays = (
        np.array(values)
        for values in (
            period.time_s,
            period.frame,
            estimate.position if truth is None else truth.position,
            body_quaternion,
            estimate.position,
            estimate.rotation,
            estimate.covariance[:, 6:9, 6:9],
            period.sight,
            estimate.status,
            estimate.visible,
            estimate.dilution.adop_deg_per_rad,
            estimate.dilution.pdop_m_per_rad,
            estimate.pnp.position,
            estimate.pnp.residual_rad,
            estimate.nis,
            np.stack(errors, axis=1),
            np.full_like(estimate.position, np.nan) if peer is None else peer.position,
            estimate.sensor,
            *_ccd(period),
            shown,
        )
    )
    return Batch(*kept_arrays)


def _ccd(period: Period) -> tuple[Ints, Bools, Floats, Floats, Floats]:
    """State (C,), lights seen (P, 2, L), position (C, 3), errors (C, 2) [m, deg] and NIS (C,) of the cameras' poses."""
    ccd, truth, craft = period.estimate.ccd, period.truth, len(period.estimate.status)
    if ccd is None or truth is None:
        none = np.full((craft, 6), np.nan)
        state = np.full(craft, len(CCD_STATES), dtype=np.int64)
        return state, np.zeros((0, 2, 0), dtype=np.bool_), none[:, :3], none[:, 3:5], none[:, 5]
    error = ccd_columns.errors(ccd, truth)
    return ccd.state, ccd.seen, ccd.position, error, ccd.nis


def stacked(rows: Sequence[Batch]) -> Batch:
    """One batch of all rows."""
    return Batch(*(np.stack(values) for values in zip(*rows, strict=True)))


class Plot(NamedTuple):
    """One plot: its entity, title with unit, lines, and their values (n, lines) for a batch."""

    entity: str
    title: str
    names: list[str]
    colours: list[int]
    widths: list[float]
    values: Callable[[Batch], Floats]


def band(count: NDArray[np.integer]) -> Floats:
    """95 % band, (..., 2), of the mean of `count` (...) chi-square values with 6 degrees of freedom; NaN for none."""
    counts, which = np.unique(count, return_inverse=True)
    n = np.where(counts > 0, counts, np.nan)
    edges = np.stack([2 * gammaincinv(DOF * n / 2, share) / n for share in (0.025, 0.975)], axis=-1)
    out: Floats = edges[which.reshape(count.shape)]
    return out


def _rms(x: Floats) -> Floats:
    """Over the craft that know it."""
    known = np.isfinite(x)
    count = np.count_nonzero(known, axis=1)
    total = np.sum(np.where(known, x, 0.0) ** 2, axis=1)
    out: Floats = np.sqrt(np.divide(total, count, out=np.full(len(x), np.nan), where=count > 0))
    return out


def _spread(x: Floats, shares: tuple[float, ...]) -> Floats:
    """Quantiles over the craft that know it, (n, shares): `np.nanquantile`, which takes the rows one by one."""
    ordered, last = np.sort(x, axis=1), np.count_nonzero(~np.isnan(x), axis=1) - 1
    place = np.maximum(last[:, None], 0) * np.array(shares)
    below = np.floor(place).astype(np.int64)
    above = np.minimum(below + 1, np.maximum(last[:, None], 0))
    low, high = (np.take_along_axis(ordered, which, axis=1) for which in (below, above))
    part = place - below
    out: Floats = np.where(part < 0.5, low + (high - low) * part, high - (high - low) * (1 - part))
    return out


def _error(index: int, scale: float) -> Callable[[Batch], Floats]:
    return lambda batch: scale * batch.errors[:, :, index]


HIGH = {"median": 0.5, "95 %": 0.95, "worst": 1.0}
"""Quantiles of a crowd where much is bad."""


def _swarm(
    craft: Sequence[str], colours: Sequence[int], crowd: bool
) -> Callable[[str, str, Callable[[Batch], Floats], Callable[[Batch], Floats] | None], Plot]:
    """Plots of all craft: a line each, or in a crowd their spread; and, if given, the 3 sigma of the swarm."""

    def plot(
        entity: str, title: str, of: Callable[[Batch], Floats], sigma: Callable[[Batch], Floats] | None = None
    ) -> Plot:
        spread = {"median": 0.5, "5 %": 0.05, "fewest": 0.0} if entity == "lit" else HIGH
        names, inks = (list(spread), [BLUE, ORANGE, RED]) if crowd else (list(craft), list(colours))

        def values(batch: Batch) -> Floats:
            lines = _spread(of(batch), tuple(spread.values())) if crowd else of(batch)
            if sigma is None:
                return lines
            return np.concatenate([lines, 3 * _rms(sigma(batch))[:, None]], axis=1)

        widths = [THIN] * len(names)
        if sigma is not None:
            names, inks, widths = [*names, "3σ (RMS)"], [*inks, WHITE], [*widths, BOLD]
        return Plot(f"swarm/{entity}", title, names, inks, widths, values)

    return plot


def _nees(batch: Batch) -> Floats:
    nees = batch.errors[:, :, 6]
    known = np.isfinite(nees)
    count = np.count_nonzero(known, axis=1)
    total = np.sum(np.where(known, nees, 0.0), axis=1)
    mean = np.divide(total, count, out=np.full(len(nees), np.nan), where=count > 0)
    return np.concatenate([mean[:, None], band(count)], axis=1)


def _counts(batch: Batch) -> Floats:
    return np.stack([np.count_nonzero(batch.status == code, axis=1) for code in range(len(STATUS))], axis=1).astype(
        np.float64
    )


def swarm_plots(craft: Sequence[str], colours: Sequence[int], crowd: bool, replay: bool) -> list[Plot]:
    """The plots over all craft, from the top down."""
    plot = _swarm(craft, colours, crowd)
    lit = plot("lit", "Photodiodes lit", lambda b: b.visible.astype(np.float64), None)
    adop = plot("adop", "ADOP [deg/mrad]", lambda b: 1e-3 * b.adop, None)
    pdop = plot("pdop", "PDOP [mm/mrad]", lambda b: b.pdop, None)
    counts = Plot("swarm/status", "Craft by status", list(STATUS), list(STATUS_COLOURS), [BOLD] * 4, _counts)
    crowd_only = [counts] if crowd else []
    if replay:
        residual = plot("residual", "PnP residual RMS [µrad]", lambda b: 1e6 * b.residual_rad, None)
        position = plot("position_sigma", "EKF position 3σ [mm]", lambda b: 3 * _error(4, 1e3)(b), None)
        attitude = plot("attitude_sigma", "EKF attitude 3σ [deg]", lambda b: 3 * _error(5, 1.0)(b), None)
        return [residual, position, attitude, adop, pdop, lit, *crowd_only]
    position = plot("position_error", "EKF position error [mm]", _error(2, 1e3), _error(4, 1e3))
    attitude = plot("attitude_error", "EKF attitude error [deg]", _error(3, 1.0), _error(5, 1.0))
    nees = Plot(
        "swarm/nees",
        "NEES, mean of the swarm [6 if consistent]",
        ["NEES", "95 % low", "95 % high"],
        [YELLOW, GREY, GREY],
        [THIN, BOLD, BOLD],
        _nees,
    )
    return [position, attitude, nees, adop, pdop, lit, *crowd_only]


def craft_plots(name: str, i: int, replay: bool, ccd: bool = False) -> list[Plot]:
    """The plots of one craft with index `i`, from the top down; ccd: it carries cameras."""

    def plot(entity: str, title: str, lines: dict[str, tuple[int, float]], values: Callable[[Batch], Floats]) -> Plot:
        inks, widths = [ink for ink, _ in lines.values()], [width for _, width in lines.values()]
        return Plot(f"detail/{name}/{entity}", title, list(lines), inks, widths, values)

    def errors(*index: int, scale: tuple[float, ...]) -> Callable[[Batch], Floats]:
        return lambda batch: batch.errors[:, i, list(index)] * np.array(scale)

    def banded(of: Callable[[Batch], Floats]) -> Callable[[Batch], Floats]:
        edges = band(np.array(1))
        return lambda batch: np.concatenate([of(batch)[:, None], np.tile(edges, (len(batch.time_s), 1))], axis=1)

    def axis(a: int) -> Callable[[Batch], Floats]:
        return lambda b: np.stack([b.pnp_position[:, i, a], b.position[:, i, a], b.peer_position[:, i, a]], axis=1)

    limits = {"95 % low": (GREY, BOLD), "95 % high": (GREY, BOLD)}
    if replay:
        three = {"PnP": (ORANGE_DIM, THIN), "EKF": (BLUE, MEDIUM), "recorded pose": (WHITE, THIN)}
        axes = [plot(f"position_{a}", f"{name}: {a} [m]", three, axis(k)) for k, a in enumerate("xyz")]
        nis = plot("nis", f"{name}: NIS", {"NIS": (YELLOW, THIN), **limits}, banded(lambda b: b.nis[:, i]))
        return [*axes, nis]
    three = {"PnP": (ORANGE_DIM, THIN), "EKF": (BLUE, MEDIUM), "EKF 3σ": (WHITE, BOLD)}
    if ccd:
        four = {"cameras": (GREEN_DIM, THIN), **three}

        def with_cameras(which: int, of: Callable[[Batch], Floats], scale: float) -> Callable[[Batch], Floats]:
            return lambda b: np.concatenate([scale * b.ccd_error[:, i, which, None], of(b)], axis=1)

        position = with_cameras(0, errors(0, 2, 4, scale=(1e3, 1e3, 3e3)), 1e3)
        attitude = with_cameras(1, errors(1, 3, 5, scale=(1.0, 1.0, 3.0)), 1.0)
        return [
            plot("position_error", f"{name}: position error [mm]", four, position),
            plot("attitude_error", f"{name}: attitude error [deg]", four, attitude),
            plot("nees", f"{name}: NEES", {"NEES": (YELLOW, THIN), **limits}, banded(lambda b: b.errors[:, i, 6])),
            plot(
                "nis",
                f"{name}: NIS of the cameras",
                {"NIS": (YELLOW, THIN), **limits},
                banded(lambda b: b.ccd_nis[:, i]),
            ),
        ]
    return [
        plot("position_error", f"{name}: position error [mm]", three, errors(0, 2, 4, scale=(1e3, 1e3, 3e3))),
        plot("attitude_error", f"{name}: attitude error [deg]", three, errors(1, 3, 5, scale=(1.0, 1.0, 3.0))),
        plot("nees", f"{name}: NEES", {"NEES": (YELLOW, THIN), **limits}, banded(lambda b: b.errors[:, i, 6])),
        plot("nis", f"{name}: NIS", {"NIS": (YELLOW, THIN), **limits}, banded(lambda b: b.nis[:, i])),
    ]


class Shown:
    """The columns of a run's groups that are to be shown for single craft, as plots or as lanes of states."""

    def __init__(self, groups: Sequence[Group]) -> None:
        self._groups = [group for group in groups if any(column.plot for column in group.columns)]
        columns = [column for group in self._groups for column in group.columns]
        self._rows = [row for row, column in enumerate(columns) if column.plot]
        self._count = len(columns)
        self.columns: list[Column] = [columns[row] for row in self._rows]

    def values(self, period: Period) -> Floats:
        """Return the columns' values, (C, len(columns))."""
        block, row = np.empty((self._count, len(period.estimate.status))), 0
        for group in self._groups:
            group.fill(period, block[row : row + len(group.columns)])
            row += len(group.columns)
        return block[self._rows].T


def shown_plots(name: str, i: int, columns: Sequence[Column]) -> list[Plot]:
    """Return a plot of each shown column of numbers, of the craft `name` with index `i`."""

    def values(column: int) -> Callable[[Batch], Floats]:
        return lambda batch: batch.shown[:, i, column, None]

    return [
        Plot(f"detail/{name}/{c.name}", f"{name}: {c.plot}{_unit(c)}", [c.plot], [BLUE], [MEDIUM], values(column))
        for column, c in enumerate(columns)
        if not c.names
    ]


def _unit(column: Column) -> str:
    return "" if column.unit in ("", "1") else f" [{column.unit}]"
