"""The figures of one craft, or of several together, from blocks of the telemetry's rows.

Errors are distances and angles from the truth (25) at each period's epoch, as RMS and maximum over the periods that
have them. A block adds to the moments of every craft, so that a run's figures can be taken while it flies as well as
from its file, with the same result; only what a median or an autocorrelation is of stays in memory, row by row.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from swarm.results.records import Equipment
from swarm.results.rows import referred_nis
from swarm.results.summary import motion_bias
from swarm.results.summary.chi_square import consistency
from swarm.results.summary.integrity import integrity, levels
from swarm.results.summary.motion_bias import MotionBias
from swarm.results.summary.statistics import (
    Moments,
    Series,
    add_moments,
    among,
    any_known,
    count,
    largest,
    mean,
    median,
    no_moments,
    ratio,
    rms,
    runs_of,
    together,
    total,
    where_both,
)
from swarm.results.table import TelemetryTable

Figures = dict[str, Any]


class Setting(NamedTuple):
    """Properties of the run that figures need beside its rows.

    period_s: length of a lighthouse period [s]. noise_rad: standard deviation of a sweep angle that the craft assume
    [rad]; None: unknown.
    """

    period_s: float
    noise_rad: float | None


class Part(NamedTuple):
    """Some rows of a run. slots: the craft that they are of, (n,), as `Account` counts them. first, past: where they
    begin and end among all rows craft by craft. sensors: numbers of the sets of sensors of several craft; None: one.
    """

    slots: Ints
    first: int
    past: int
    sensors: Ints | None = None


class Arranged(NamedTuple):
    """The rows of a run craft by craft: group by group of those with the same sensors, then those that are aside.

    order: the rows in this order, (rows,). own: those of all craft that find themselves. groups: of these, those with
    the same sensors, by the sensors' names, where not all have the same. craft: name, whether it is aside, and rows.
    """

    order: Ints
    own: Part
    groups: dict[str, Part]
    craft: list[tuple[str, bool, Part]]


def _light(rows: TelemetryTable) -> Series:
    """Return how much light there was, and what became of it."""
    visible, solved, tracking = rows.column("visible"), np.isfinite(rows.column("pnp_px_m")), rows.by_light
    every = visible >= 0
    return {
        "samples": (count, np.ones(len(rows))),
        "tracking_share": (mean, among(tracking, every)),
        "single_sweeps_share": (mean, among(rows.being("status", "single_sweeps"), every)),
        "refused_share": (mean, among(np.isfinite(rows.column("nis")) & ~tracking, solved)),
        "mean_visible": (mean, visible),
        "contact_periods": (total, rows.column("contact")),
        "solved_share": (mean, among(solved, visible >= 4)),
        "solved_share_with_5_photodiodes": (mean, among(solved, visible >= 5)),
        "ambiguous_share": (mean, among(rows.being("status", "ambiguous"), every)),
    }


def _solutions(rows: TelemetryTable) -> Series:
    """Return how the geometry dilutes the precision of the solved poses."""
    return {
        "mean_iterations": (mean, rows.column("pnp_iterations")),
        "mean_adop_deg_per_rad": (mean, rows.column("adop_deg_per_rad")),
        "mean_pdop_m_per_rad": (mean, rows.column("pdop_m_per_rad")),
    }


def _errors(rows: TelemetryTable) -> Series:
    """Return the errors of the solved poses and of the filter."""
    out: Series = {}
    for what, unit in (("position", "m"), ("attitude", "deg")):
        pnp, ekf = rows.column(f"pnp_{what}_error_{unit}"), rows.column(f"{what}_error_{unit}")
        for whose, error in (("pnp", pnp), ("ekf", ekf)):
            out[f"{whose}_{what}_rms_{unit}"] = rms, error
            out[f"{whose}_{what}_max_{unit}"] = largest, error
        out[f"ekf_to_pnp_{what}_ratio"] = ratio, *where_both(ekf, pnp)
    return out


def _single(rows: TelemetryTable) -> Series:
    """Return what only single craft have, where a run has it."""
    of = {"delta_v_m_s": ("delta_v_m_s", largest), "observed": ("observer", any_known)}
    return {
        name: (statistic, rows.column(column)) for name, (column, statistic) in of.items() if column in rows.columns
    }


def _nis(rows: TelemetryTable) -> Floats:
    """Return the NIS as if all were of poses, (rows,).

    In a replay, light that was refused is left out: a hand or a reflection, whose NIS, of no known degrees of freedom,
    says nothing of the filter's errors, and of which a few would be all of the mean. `refused_share` counts them.
    """
    nis = rows.column("nis")
    if "rows" in rows.columns:
        nis = referred_nis(nis, rows.column("rows"))
    return np.where(rows.by_light, nis, np.nan) if "peer_px_m" in rows.columns else nis


_SMALL = {"slot": np.int32, "frame": np.int32}
"""Types of what is kept of whole numbers."""
_WHO = ("slot", "frame", "time_s")


class Account:
    """Takes the rows of a run, block by block, and gives the figures of its craft.

    The rows of craft k of n are those of slot k, and of slot n + k where it does not find itself: where it carries no
    sensor, or others observe it.
    """

    def __init__(self, names: Sequence[str], still: Sequence[str] = (), equipment: Sequence[Equipment] = ()) -> None:
        """Begin without rows.

        Args:
            names: Names of the craft.
            still: Names of those without any sensor.
            equipment: The equipment of each; craft with the same sensors make a group. Empty: unknown.
        """
        sensors = [" and ".join(each.sensors) for each in equipment] or [""] * len(names)
        self.names = tuple(names)
        self._slot = {name: i + len(names) * (name in still) for i, name in enumerate(names)}
        self._kinds = list(dict.fromkeys(sensors))
        """The words of the craft's sets of sensors."""
        self._kind = np.array([self._kinds.index(words) for words in sensors] + [-1] * len(names), dtype=np.int64)
        self._moments: dict[str, tuple[Any, list[Floats]]] = {}
        self._position, self._attitude = MotionBias(self._kind), MotionBias(self._kind)
        self._kept: dict[str, list[Any]] = {}
        self._replay = False

    def take(self, rows: TelemetryTable) -> None:
        """Take some rows. Raises SwarmError where their file is damaged."""
        if not len(rows):
            return
        slot, frame = self._slots(rows), rows.frame
        runs = runs_of(slot)
        watched = "dropped_photodiodes" in rows.columns
        self._replay = "peer_px_m" in rows.columns
        series = _light(rows) | _solutions(rows) | _errors(rows) | _single(rows) | (integrity(rows) if watched else {})
        for name, (statistic, *values) in series.items():
            if name not in self._moments:
                self._moments[name] = statistic, [no_moments(len(self._kind)) for _ in values]
            for value, moments in zip(values, self._moments[name][1], strict=True):
                add_moments(runs, slot, value, moments)
        if not self._replay:
            self._position.add(frame, slot, *motion_bias.position_errors(rows))
            self._attitude.add(frame, slot, *motion_bias.attitude_errors(rows))
        time_s = rows.column("time_s")
        kept = {
            "slot": slot,
            "frame": frame,
            "time_s": np.array([time_s.min(), time_s.max()]),
            "residual_median_rad": rows.column("residual_rad"),
            "nees": rows.column("nees"),
            "nis": _nis(rows),
            **(levels(rows) if watched else {}),
        }
        for name, value in kept.items():
            # Copies: the rows may be the next ones' workspace.
            self._kept.setdefault(name, []).append(np.array(value, _SMALL.get(name)))

    def _slots(self, rows: TelemetryTable) -> Ints:
        slot = np.array([self._slot[name] for name in rows.names_of("craft")], dtype=np.int64)[rows.craft]
        if "observer" not in rows.columns:
            return slot
        return np.where(np.isfinite(rows.column("observer")) & (slot < len(self.names)), slot + len(self.names), slot)

    @property
    def times(self) -> tuple[int, int, float]:
        """The number of periods, the last one's number from the first, and the length of a period [s]."""
        frame, time_s = self._whole("frame"), self._whole("time_s")
        first = int(frame.min())
        span = int(frame.max()) - first
        periods = int(np.count_nonzero(np.bincount(frame - first)))
        return periods, span, float(time_s.max() - time_s.min()) / span if span else 0.0

    def __bool__(self) -> bool:
        return bool(self._kept)

    def _whole(self, name: str) -> Any:
        return np.concatenate(self._kept[name])

    def arranged(self) -> Arranged:
        """Return the rows craft by craft."""
        slot = self._whole("slot")
        there = np.flatnonzero(np.bincount(slot, minlength=len(self._kind)))
        kind = self._kind[there]
        by_kind = np.argsort(np.where(kind < 0, len(self._kinds), kind), kind="stable")
        there, kind = there[by_kind], kind[by_kind]
        rank = np.zeros(len(self._kind), dtype=np.int64)
        rank[there] = np.arange(len(there))
        ranks = rank[slot]
        edges = [0, *np.cumsum(np.bincount(ranks, minlength=len(there))).tolist()]

        def part(which: Ints) -> Part:
            """Return the rows of neighbours that find themselves."""
            first, past = (int(which[0]), int(which[-1]) + 1) if len(which) else (0, 0)
            return Part(there[which], edges[first], edges[past], np.unique(kind[which]))

        own = part(np.flatnonzero(kind >= 0))
        groups = {} if own.sensors is None else {self._kinds[k]: part(np.flatnonzero(kind == k)) for k in own.sensors}
        craft = [
            (self.names[k % len(self.names)], k >= len(self.names), Part(there[i : i + 1], edges[i], edges[i + 1]))
            for i, k in enumerate(there.tolist())
        ]
        return Arranged(np.argsort(ranks, kind="stable"), own, groups if len(groups) > 1 else {}, craft)

    def figures(self, every: Sequence[Part], order: Ints, setting: Setting) -> list[Figures]:
        """Return the figures of some parts.

        Args:
            every: The parts.
            order: As `arranged` gives it.
            setting: What they take from the run.
        """
        out: list[Figures] = [{} for _ in every]
        for name, (statistic, series) in self._moments.items():
            for found, moments in zip(out, zip(*(_taken(each, every) for each in series), strict=True), strict=True):
                found[name] = statistic(*moments)
        frame = self._whole("frame")[order]
        for name in [name for name in self._kept if name not in _WHO]:
            value = self._whole(name)[order]
            for found, part in zip(out, every, strict=True):
                rows = slice(part.first, part.past)
                chi_square = name in ("nees", "nis")
                found[name] = (
                    consistency(frame[rows], value[rows], setting.period_s) if chi_square else median(value[rows])
                )
        for found, part in zip(out, every, strict=True):
            found["pnp_motion_bias"] = (
                None if self._replay else motion_bias.told(self._position, self._attitude, part.slots, part.sensors)
            )
            for what, unit, dop in (
                ("attitude", "deg", "mean_adop_deg_per_rad"),
                ("position", "m", "mean_pdop_m_per_rad"),
            ):
                known = found[dop] is not None and setting.noise_rad is not None
                found[f"predicted_{what}_{unit}"] = found[dop] * setting.noise_rad if known else None
            if not found["ambiguous_share"]:
                del found["ambiguous_share"]
        return [_nested(found) for found in out]


def _taken(moments: Floats, every: Sequence[Part]) -> list[Moments]:
    """Return the moments of parts from those of the slots, (4, slots)."""
    taken = moments[:, [part.slots[0] if len(part.slots) else 0 for part in every]]
    for i, part in enumerate(every):
        if part.sensors is not None:
            taken[:, i] = together(moments[:, part.slots])
    return [Moments(*row) for row in taken.T.tolist()]


def _nested(figures: Figures) -> Figures:
    """Return figures of which some stand under others, by points in their names."""
    out: Figures = {}
    for name, value in figures.items():
        *above, last = name.split(".")
        of = out
        for each in above:
            of = of.setdefault(each, {})
        of[last] = value
    return out
