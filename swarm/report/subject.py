"""The material of a page's sections: a run with its figures, its telemetry, its scenario and its faults."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from swarm.report.series import Series
from swarm.results.columns.core import COLUMNS
from swarm.results.reasons import NO_FAULT
from swarm.results.run_folder import SCENARIO, Run
from swarm.results.summary import summarise_run
from swarm.results.table import TelemetryTable, doubles
from swarm.user_text import parse_toml


class Strike(NamedTuple):
    """One fault of one or several craft at one time.

    number: its place in the table of faults, from 1. craft: indices, none for a fault that strikes all.
    """

    number: int
    kind: str
    craft: tuple[int, ...]
    from_s: float
    to_s: float
    lasts: bool

    def strikes(self, craft: int) -> bool:
        """Tell whether a craft has this fault."""
        return not self.craft or craft in self.craft


class Subject:
    """A run, as its page shows it. summary: its figures, computed anew where a killed run has none."""

    def __init__(self, run: Run) -> None:
        """Take a run. Raises SwarmError where its files are damaged."""
        self.run = run
        self.recorded = len(run.telemetry) > 0
        known: Mapping[str, Any] = run.summary
        self.summary: dict[str, Any] = dict(known) if known.get("swarm") else {**known, **summarise_run(run.folder)}

    @cached_property
    def series(self) -> Series:
        """The telemetry as arrays. Raises SwarmError where a column of numbers holds words."""
        table = self.run.telemetry
        numbers = [c.name for c in COLUMNS if c.kind not in ("state", "name") and c.name in table.column_names]
        for name in numbers:
            if str(table.schema.field(name).type).startswith(("string", "large_string", "dictionary")):
                doubles(table, name)
        return Series(TelemetryTable.of(table))

    @cached_property
    def scenario(self) -> dict[str, Any]:
        """The scenario's tables, none where it was never written."""
        text = self.run.scenario
        return parse_toml(text, str(self.run.folder / SCENARIO)) if text else {}

    @property
    def verdicts(self) -> list[dict[str, Any]]:
        """The verdicts on the criteria."""
        return list(self.summary.get("criteria") or ())

    @cached_property
    def strikes(self) -> list[Strike]:
        """The faults that struck, by time: the same kind at the same time in several craft is one."""
        series = self.series
        if not series.has("fault"):
            return []
        step = float(np.median(np.diff(series.time_s))) if len(series.time_s) > 1 else 0.0
        spans: dict[tuple[float, float, str], list[int]] = {}
        kinds = sorted({kind for word in series.words("fault") for kind in word.split(" + ")} - {NO_FAULT})
        for kind in kinds:
            having = np.zeros(series.shape, dtype=np.bool_)
            for word in series.words("fault"):
                if kind in word.split(" + "):
                    having |= series.being("fault", word)
            for craft in range(series.shape[1]):
                edges = np.flatnonzero(np.diff(np.concatenate([[False], having[:, craft], [False]]).astype(np.int8)))
                for first, past in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
                    span = float(series.time_s[first]) - step / 2, float(series.time_s[past - 1]) + step / 2, kind
                    spans.setdefault(span, []).append(craft)
        end_s, everyone = float(series.time_s[-1]) + step / 4, series.shape[1]
        return [
            Strike(n, kind, () if len(craft) == everyone > 1 else tuple(craft), from_s, to_s, to_s >= end_s)
            for n, ((from_s, to_s, kind), craft) in enumerate(sorted(spans.items()), start=1)
        ]
