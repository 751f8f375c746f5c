"""The page of any study: the usual figures of merit against each key that it varied, and a table of its points."""

from collections.abc import Sequence

import numpy as np

from swarm.figures import Figure
from swarm.report.figures import BLUE, GREY, Picture, picture
from swarm.report.page import Column, Section, Table, number
from swarm.report.rows import Rows, as_floats, finished
from swarm.studies.campaign.study_folder import FinishedStudy
from swarm.studies.campaign.task import COMPLETE
from swarm.units import split_unit, written_unit

MERITS = (
    ("ekf_position_rms_m", 1000.0, "position error, RMS", "mm"),
    ("ekf_attitude_rms_deg", 1.0, "attitude error, RMS", "°"),
    ("nees_mean", 1.0, "NEES, mean", ""),
    ("tracking_share", 100.0, "time tracking", "%"),
)
MOST_FIGURES, MOST_ROWS = 4, 60


def sections(study: FinishedStudy) -> list[Section]:
    """Return a figure per key that was varied, then the table of points."""
    rows = [(key, Rows.of(study, key)) for key in study.parameters]
    varied = [(key, r) for key, r in rows if len(r.points) >= 2]
    pictures = [_against(key, r) for key, r in varied[:MOST_FIGURES]]
    out = [Section("Against what was varied", (), pictures)] if pictures else []
    out.append(Section("Point by point", (), (), [point_table(study)]))
    return out


def failures(study: FinishedStudy) -> list[Section]:
    """Return the section of the runs that could not be flown, with their reasons; none where there are none."""
    rows = [row for row in study.rows.to_pylist() if row["status"] != COMPLETE]
    if not rows:
        return []
    keys = study.parameters
    body = [
        [str(row["run"]), *(_shown(row[key]) for key in keys), str(row["seed"]), row["status"], row["reason"] or ""]
        for row in rows[:MOST_ROWS]
    ]
    more = f" The first {MOST_ROWS} of them." if len(rows) > MOST_ROWS else ""
    columns = [
        Column("run"),
        *(Column(*_name(key)) for key in keys),
        Column("seed"),
        Column("status"),
        Column("reason"),
    ]
    text = f"{len(rows)} of {len(study.rows)} runs have no figures.{more}"
    return [Section("Runs that failed", [text], (), [Table(columns, body, left=len(columns))])]


def _against(key: str, rows: Rows) -> Picture:
    value = rows.column(key)
    wide = rows.points[0] > 0 and rows.points[-1] / rows.points[0] > 20
    drawn = len(rows.points) > max(12, rows.count // 2)

    def paint(figure: Figure) -> None:
        for axes, (name, scale, label, unit) in zip(figure.subplots(2, 2).flat, MERITS, strict=True):
            figures = scale * rows.column(name)
            axes.plot(value, figures, "o", color=BLUE, alpha=0.35, markersize=4, markeredgewidth=0)
            if not drawn:
                axes.plot(rows.points, rows.spread(name, scale).mean, color=BLUE, marker="o")
            if name == "nees_mean":
                axes.axhline(6, color=GREY, linewidth=1, linestyle=":")
            if wide:
                axes.set_xscale("log")
            axes.set_title(f"{label} [{unit}]" if unit else label)
            axes.set_xlabel(" ".join(part for part in (_name(key)[0], f"[{_name(key)[1]}]") if part != "[]"))
            if np.isfinite(figures).any():
                axes.set_ylim(bottom=0)

    how = "a dot per run" if drawn else "a dot per run, the line through their means"
    return picture(f"against-{key.replace('.', '-')}", f"Figures of merit against {key}: {how}.", paint, 5.6)


def point_table(study: FinishedStudy) -> Table:
    """Return a table with a row per point: means over its seeds, with the standard deviation of a run."""
    columns = finished(study)
    keys = study.parameters
    groups: dict[tuple[str, ...], list[int]] = {}
    for i in range(len(columns["run"])):
        groups.setdefault(tuple(_shown(columns[key][i]) for key in keys), []).append(i)
    body = []
    for point, members in list(groups.items())[:MOST_ROWS]:
        cells = [
            _mean_and_spread([columns.get(name, [None] * len(columns["run"]))[i] for i in members], scale)
            for name, scale, _, _ in MERITS
        ]
        body.append([*point, str(len(members)), *cells])
    more = (
        f" The first {MOST_ROWS} of {len(groups)} points; runs.parquet has them all." if len(groups) > MOST_ROWS else ""
    )
    heads = [
        *(Column(*_name(key)) for key in keys),
        Column("runs"),
        *(Column(label, unit) for _, _, label, unit in MERITS),
    ]
    return Table(heads, body, f"Means over the seeds ± one standard deviation of a run.{more}", left=0)


def _mean_and_spread(values: Sequence[float | None], scale: float) -> str:
    known = scale * as_floats(values)
    known = known[np.isfinite(known)]
    if not known.size:
        return number(None)
    spread = f" ± {number(float(known.std(ddof=1)), 2)}" if known.size > 1 else ""
    return f"{number(float(known.mean()))}{spread}"


def _name(key: str) -> tuple[str, str]:
    return split_unit(key)[0].replace("_", " "), written_unit(key)


def _shown(value: object) -> str:
    return number(value, 4) if isinstance(value, float) else str(value)
