"""The motion bias: the part of the raw PnP error (solution - truth) that is proportional to the true rate.

It is found by least squares per axis of the lighthouse frame, position error e against velocity v and attitude error
against angular rate:

    b = sum e v / sum v^2,   sigma_b = sqrt(sum (e v - b v^2)^2) / sum v^2

Its slope b is a time: the solution shows the craft where it is that much later. Without motion compensation the two
fans, T/2 apart, leave about -T/4 in x and +T/4 in y, which along the velocity of a turning ring would cancel. The
craft of a period count as one sample: of several, e v and v^2 are summed per period before they are squared.
"""

from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel
from swarm.results.rows import attitude_errors_into
from swarm.results.summary.statistics import number
from swarm.results.table import TelemetryTable

Axes = tuple[Floats, Floats, Floats]
"""A vector of every row, as its components, (rows,) each."""
MIN_RATE = 1e-4
"""Below this RMS rate [m/s], [rad/s] an axis is at rest, and no bias can be told from it."""


class _Slopes(NamedTuple):
    """Slope and 1 sigma [s] per axis, None where at rest; the RMS of the error that the slopes explain."""

    slope_s: list[float | None]
    sigma_s: list[float | None]
    explained: float | None


class MotionBias:
    """The least squares of one kind of error against one kind of rate, from blocks of rows in whatever order."""

    def __init__(self, kind: Ints) -> None:
        """Begin with no rows.

        Args:
            kind: Of every part of the rows, (parts,), the number of the group that it is summed with per period; -1:
                it is in none.
        """
        self._kind = kind
        self._single = np.zeros((len(kind), 3, 5))
        self._along = np.zeros((len(kind), 3))
        self._first, self._by_frame = 0, np.zeros((int(kind.max(initial=0)) + 1, 2, 0, 3))

    def add(self, frame: Ints, part: Ints, error: Axes, rate: Axes) -> None:
        """Add rows.

        Args:
            frame: Their periods, (rows,).
            part: The part of each, (rows,).
            error: e of each axis, (rows,), NaN where unknown.
            rate: v of each axis, (rows,).
        """
        if not len(frame):
            return
        self._make_room(int(frame.min()), int(frame.max()) + 1)
        _add(frame, self._first, part, self._kind, error, rate, self._single, self._along, self._by_frame)

    def _make_room(self, first: int, past: int) -> None:
        """Make room for the sums of periods from `first` on, before `past`."""
        size = self._by_frame.shape[2]
        self._first = self._first if size else first
        before, behind = max(self._first - first, 0), max(past - self._first - size, 0)
        if before or behind:
            room = before, max(behind, size) if behind else 0
            self._by_frame = np.pad(self._by_frame, ((0, 0), (0, 0), room, (0, 0)))
            self._first -= before

    def along_velocity(self, parts: Ints) -> float | None:
        """Return the mean error along the rate, of rows of some parts that move; None where none does."""
        total, moving = self._along[parts, :2].sum(axis=0).tolist()
        return total / moving if moving else None

    def of_one(self, part: int) -> _Slopes:
        """Return the slopes of one part, whose rows are of different periods."""
        product, square, _, _, score = self._single[part].T
        return _slopes(product, square, np.maximum(score, 0.0), float(self._along[part, 2]))

    def of_groups(self, groups: Ints) -> _Slopes:
        """Return the slopes of groups of parts together."""
        product, square = self._by_frame[groups].sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            left = product - product.sum(axis=0) / square.sum(axis=0) * square
        count = float(self._along[np.isin(self._kind, groups), 2].sum())
        return _slopes(product.sum(axis=0), square.sum(axis=0), np.sum(left**2, axis=0), count)


def _slopes(product: Floats, square: Floats, score: Floats, count: float) -> _Slopes:
    """Return the slopes from the sums (3,) of e v, of v^2 and of (e v - b v^2)^2 over `count` rows."""
    moves = square > count * MIN_RATE**2
    slope, sigma = np.full((2, 3), np.nan)
    slope[moves] = product[moves] / square[moves]
    sigma[moves] = np.sqrt(score[moves]) / square[moves]
    explained = float(np.sqrt(np.sum(slope[moves] ** 2 * square[moves]) / count)) if count else None
    return _Slopes([number(b) for b in slope.tolist()], [number(b) for b in sigma.tolist()], explained)


@kernel
def _add(
    frame: Ints,
    first: int,
    part: Ints,
    kind: Ints,
    error: Axes,
    rate: Axes,
    single: Floats,
    along: Floats,
    by_frame: Floats,
) -> None:
    """Add rows whose errors are known.

    Args:
        frame: Their periods, (rows,).
        first: The first of them.
        part: Their parts, (rows,).
        kind: The group of each part, (parts,), -1 for none.
        error: e of each axis, (rows,).
        rate: v of each axis, (rows,).
        single: Per part and axis, (parts, 3, 5): the sums of e v, v^2, v^4, (e v - b v^2) v^2 and (e v - b v^2)^2, with
            the slope b of the rows so far.
        along: Per part, (parts, 3): the sum of the errors along the rates of rows that move, their number, and that of
            all rows.
        by_frame: Per group and period, (groups, 2, periods, 3): the sums of e v and of v^2.
    """
    for i in range(len(frame)):
        e, v = (error[0][i], error[1][i], error[2][i]), (rate[0][i], rate[1][i], rate[2][i])
        if not (np.isfinite(e[0]) and np.isfinite(e[1]) and np.isfinite(e[2])):
            continue
        p, f = part[i], frame[i] - first
        speed = way = 0.0
        for axis in range(3):
            x, y = e[axis] * v[axis], v[axis] * v[axis]
            way, speed = way + x, speed + y
            if kind[p] >= 0:
                by_frame[kind[p], 0, f, axis] += x
                by_frame[kind[p], 1, f, axis] += y
            sums = single[p, axis]
            before = sums[0] / sums[1] if sums[1] > 0 else 0.0
            sums[0] += x
            sums[1] += y
            slope = sums[0] / sums[1] if sums[1] > 0 else 0.0
            # What is left of the rows before changes with the slope that they are judged by.
            change, left = slope - before, x - slope * y
            sums[4] += change * (change * sums[2] - 2 * sums[3]) + left * left
            sums[3] += left * y - change * sums[2]
            sums[2] += y * y
        along[p, 2] += 1.0
        speed = np.sqrt(speed)
        if speed > MIN_RATE:
            along[p, 0] += way / speed
            along[p, 1] += 1.0


def position_errors(rows: TelemetryTable) -> tuple[Axes, Axes]:
    """Return the position errors of the solutions [m] and the velocities [m/s], (rows,) of each axis."""
    x, y, z = (rows.column(f"pnp_p{axis}_m") - rows.column(f"true_p{axis}_m") for axis in "xyz")
    return (x, y, z), _axes(rows, "true_v{}_m_s")


def attitude_errors(rows: TelemetryTable) -> tuple[Axes, Axes]:
    """Return the attitude errors of the solutions [rad] and the angular rates [rad/s], (rows,) of each axis."""
    true, pnp = (tuple(rows.column(f"{whose}_q{part}") for part in "wxyz") for whose in ("true", "pnp"))
    x, y, z = np.empty((3, len(rows)))
    attitude_errors_into(true, pnp, (x, y, z))
    return (x, y, z), _axes(rows, "true_w{}_rad_s")


def _axes(rows: TelemetryTable, name: str) -> Axes:
    x, y, z = (rows.column(name.format(axis)) for axis in "xyz")
    return x, y, z


def told(position: MotionBias, attitude: MotionBias, parts: Ints, groups: Ints | None) -> dict[str, Any]:
    """Return the slopes of parts, their 1 sigma, how much of the errors they explain, and the error along the velocity.

    Args:
        position: Of the positions.
        attitude: Of the attitudes.
        parts: The parts, (n,).
        groups: The groups that these are; None: they are one part.
    """
    place, turn = (
        bias.of_one(int(parts[0])) if groups is None else bias.of_groups(groups) for bias in (position, attitude)
    )
    return {
        "position_slope_s": place.slope_s,
        "position_slope_sigma_s": place.sigma_s,
        "position_rms_m": place.explained,
        "along_velocity_m": position.along_velocity(parts),
        "attitude_slope_s": turn.slope_s,
        "attitude_slope_sigma_s": turn.sigma_s,
        "attitude_rms_deg": None if turn.explained is None else float(np.degrees(turn.explained)),
    }
