"""The faults of a run: a timeline, and a table with what each did to navigation."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from estimators.arrays import Bools, Ints
from swarm.figures import Figure
from swarm.report.figures import Picture, is_narrow, legend, picture
from swarm.report.findings import names
from swarm.report.numbers import number
from swarm.report.page import Column, Section, Table, prose
from swarm.report.subject import Strike, Subject
from swarm.units import split_unit, written_unit

MOST_ROWS, MOST_LANES = 60, 24
PALE = ("#8db8dc", "#ecb98a", "#8fcaa6", "#bba8d3", "#e0958c", "#84c6cc", "#d5b98d", "#a9b4e3")
"""Colours of the kinds, on which the numbers are read."""
AFTER_S = 1.0
"""The worst error counts until so long after the fault."""
NOT_DETAILS = ("kind", "craft", "at_s", "for_s", "until_s", "probability_per_s")


def section(subject: Subject) -> Section | None:
    """Return the section; None where nothing failed."""
    strikes = subject.strikes
    if not strikes:
        return None
    return Section("Faults", prose("run.txt.j2", "faults"), [_timeline(subject)], [_table(subject)])


def _timeline(subject: Subject) -> Picture:
    series = subject.series
    struck = [i for i in range(len(series.names)) if any(strike.strikes(i) for strike in subject.strikes)][:MOST_LANES]
    kinds = list(dict.fromkeys(strike.kind for strike in subject.strikes))

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        for lane, craft in enumerate(struck):
            tracks = _tracks([strike for strike in subject.strikes if strike.strikes(craft)])
            height = 0.84 / len(tracks)
            for track, strikes in enumerate(tracks):
                for strike in strikes:
                    colour, hatch = _look(kinds.index(strike.kind))
                    low, span = lane - 0.42 + height * track, (strike.from_s, strike.to_s - strike.from_s)
                    # Of no width, an edge is only the hatch's colour.
                    bars = axes.broken_barh([span], (low, 0.94 * height), facecolor=colour, label=strike.kind)
                    bars.set(edgecolor="white", linewidth=0, hatch=hatch)
                    axes.annotate(
                        str(strike.number),
                        (strike.from_s, low + height / 2),
                        xytext=(2, 0),
                        textcoords="offset points",
                        va="center",
                        fontsize=7.5,
                    )
        axes.set_yticks(range(len(struck)), [series.names[i] for i in struck])
        axes.set_ylim(len(struck) - 0.5, -0.5)
        axes.set_xlim(series.edges_s)
        axes.set_xlabel("time [s]")
        legend(figure, columns=2 if is_narrow(figure) else 5)

    caption = "Faults over time, per craft, with their numbers in the table."
    return picture("faults", caption, paint, 1.6 + 0.34 * len(struck), 2.0 + 0.4 * len(struck))


def _tracks(strikes: Sequence[Strike]) -> list[list[Strike]]:
    """Return the faults of one craft on as few tracks as hold them without overlap."""
    tracks: list[list[Strike]] = []
    for strike in strikes:
        free = next((track for track in tracks if track[-1].to_s <= strike.from_s), None)
        if free is None:
            tracks.append([strike])
        else:
            free.append(strike)
    return tracks


def _look(kind: int) -> tuple[str, str | None]:
    """Return the colour of a kind, and a hatch where the colours have been used up."""
    return PALE[kind % len(PALE)], "///" if kind >= len(PALE) else None


def _table(subject: Subject) -> Table:
    rows = [_row(subject, strike) for strike in subject.strikes[:MOST_ROWS]]
    more = f"The first {MOST_ROWS} of {len(subject.strikes)}. " if len(subject.strikes) > MOST_ROWS else ""
    columns = [
        Column("no."),
        Column("fault"),
        Column("craft"),
        Column("from", "s"),
        Column("to", "s"),
        Column("tracking meanwhile", "%"),
        Column("largest error", "mm"),
    ]
    caption = f"{more}The largest error of a craft that navigates counts until {AFTER_S:g} s after the fault."
    return Table(columns, rows, caption, left=3)


def _row(subject: Subject, strike: Strike) -> list[str]:
    series = subject.series
    craft = np.array([i for i in series.navigating.tolist() if strike.strikes(i)], dtype=np.int64)
    who = names([series.names[i] for i in strike.craft]) if strike.craft else "all"
    details = _details(subject.scenario.get("fault", []), strike, series.names)
    meanwhile = (series.time_s >= strike.from_s) & (series.time_s < strike.to_s)
    after = (series.time_s >= strike.from_s) & (series.time_s < strike.to_s + AFTER_S)
    share, worst = None, None
    if len(craft):
        share = 100 * float(np.mean(_part(series.by_light, meanwhile, craft)))
        error = series.of("position_error_m")[np.ix_(after, craft)]
        worst = 1000 * float(error[np.isfinite(error)].max()) if np.isfinite(error).any() else None
    return [
        str(strike.number),
        f"{strike.kind}{details}",
        who,
        f"{max(strike.from_s, 0.0):.1f}",
        "the end" if strike.lasts else f"{strike.to_s:.1f}",
        number(share),
        number(worst),
    ]


def _part(data: Bools, rows: Bools, craft: Ints) -> Bools:
    out: Bools = data[np.ix_(rows, craft)]
    return out


def _details(tables: Sequence[Mapping[str, Any]], strike: Strike, craft: Sequence[str]) -> str:
    """Return what the scenario says of a fault beside who and when: that of its table, if only one can be meant."""
    struck = {craft[i] for i in strike.craft}
    told = []
    for table in tables:
        named = table.get("craft") or ()
        who = {named} if isinstance(named, str) else set(named)
        mine = table.get("kind") == strike.kind and (not who or not struck or bool(who & struck))
        at_s = table.get("at_s")
        if mine and (at_s is None or abs(at_s - strike.from_s) < 0.1):
            told.append(", ".join(_detail(key, value) for key, value in table.items() if key not in NOT_DETAILS))
    return f" ({told[0]})" if len(set(told)) == 1 and told[0] else ""


def _detail(key: str, value: object) -> str:
    name = split_unit(key)[0].replace("_", " ")
    if isinstance(value, bool):
        return name if value else f"not {name}"
    parts = value if isinstance(value, list) else [value]
    shown = ", ".join(f"{part:g}" if isinstance(part, float) else str(part) for part in parts)
    return f"{name} {shown} {written_unit(key)}".rstrip()
