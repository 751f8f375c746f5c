"""The page of any study: the usual figures of merit against each key that it varied, and a table of its points."""

import math
from collections.abc import Sequence

import numpy as np

from swarm.report.numbers import number
from swarm.report.page import Column, Section, Table, plain
from swarm.report.rows import as_floats, finished
from swarm.report.sweep_figures import Key, against_one, against_two, known, named
from swarm.studies.campaign.study_folder import FinishedStudy
from swarm.studies.campaign.task import COMPLETE

MOST_FIGURES, MOST_ROWS = 4, 60


def sections(study: FinishedStudy) -> list[Section]:
    """Return the figures over the keys that were varied, then the table of points."""
    columns = finished(study)
    keys = [Key.of(key, columns.get(key, [])) for key in study.parameters]
    varied = [key for key in keys if len(key.points) >= 2]
    if len(varied) == 2:
        pictures = [against_two(columns, *varied)]
    else:
        pictures = [against_one(columns, key) for key in varied[:MOST_FIGURES]]
    out = [Section("Against what was varied", (), pictures)] if pictures and known(columns) else []
    out.append(Section("Point by point", (), (), [point_table(study)]))
    return out


def failures(study: FinishedStudy) -> list[Section]:
    """Return the section of the runs that could not be flown, with their reasons; none where there are none."""
    rows = [row for row in study.rows.to_pylist() if row["status"] != COMPLETE]
    if not rows:
        return []
    keys = study.parameters
    body = [
        [str(row["run"]), *(plain(row[key]) for key in keys), str(row["seed"]), row["status"], row["reason"] or ""]
        for row in rows[:MOST_ROWS]
    ]
    more = f" The first {MOST_ROWS} of them." if len(rows) > MOST_ROWS else ""
    columns = [
        Column("run"),
        *(Column(*named(key)) for key in keys),
        Column("seed"),
        Column("status"),
        Column("reason"),
    ]
    text = f"{len(rows)} of {len(study.rows)} runs have no figures.{more}"
    return [Section("Runs that failed", [text], (), [Table(columns, body, left=len(columns))])]


def point_table(study: FinishedStudy) -> Table:
    """Return a table with a row per point: means over its seeds, with the standard deviation of a run."""
    columns = finished(study)
    keys, merits = study.parameters, known(columns)
    groups: dict[tuple[str, ...], list[int]] = {}
    for i in range(len(columns["run"])):
        groups.setdefault(tuple(plain(columns[key][i]) for key in keys), []).append(i)
    body = []
    for point, members in list(groups.items())[:MOST_ROWS]:
        cells = [_mean_and_spread([columns[merit.column][i] for i in members], merit.scale) for merit in merits]
        body.append([*point, str(len(members)), *cells])
    more = (
        f" The first {MOST_ROWS} of {len(groups)} points; runs.parquet has them all." if len(groups) > MOST_ROWS else ""
    )
    heads = [
        *(Column(*named(key)) for key in keys),
        Column("runs"),
        *(Column(merit.label, merit.unit) for merit in merits),
    ]
    return Table(heads, body, f"Means over the seeds ± one standard deviation of a run.{more}", left=0)


def _mean_and_spread(values: Sequence[float | None], scale: float) -> str:
    """Return the mean, rounded where the spread of a run begins to be known: two digits of it."""
    known = scale * as_floats(values)
    known = known[np.isfinite(known)]
    if not known.size:
        return number(None)
    mean, spread = float(known.mean()), float(known.std(ddof=1)) if known.size > 1 else 0.0
    if spread <= 1e-9 * abs(mean):
        return plain(mean, 4) + (" ± 0" if known.size > 1 else "")
    decimals = max(1 - math.floor(math.log10(spread)), 0)
    return f"{mean:.{decimals}f} ± {spread:.{decimals}f}" if decimals < 9 else f"{number(mean)} ± {number(spread, 2)}"
