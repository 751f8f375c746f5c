"""The page of a study of swarm.count: precision, visibility and cost against the number of craft; a central solver."""

import numpy as np

from swarm.report.numbers import number
from swarm.report.page import Column, Fact, Section, Table, count, percent, prose
from swarm.report.rows import Rows
from swarm.report.scaling_figures import central_cost, central_gain, central_line, onboard, precision, visibility
from swarm.studies.campaign.study_folder import FinishedStudy

COUNT = "swarm.count"
PROSE = "scaling.txt.j2"


def is_scaling(study: FinishedStudy) -> bool:
    """Tell whether the study varies the number of craft, and measured what that costs."""
    rows = Rows.of(study, COUNT)
    return len(rows.points) >= 2 and (rows.has("onboard_alone_us") or rows.has("central_solve_us"))


def facts(rows: Rows) -> list[Fact]:
    """Return the answers in a few figures."""
    out, few, many = [], rows.points[0], rows.points[-1]
    if rows.has("onboard_alone_us"):
        time = rows.spread("onboard_alone_us").mean
        out.append(
            Fact(
                "A craft's own computer, per period",
                f"{number(time[-1])} µs",
                f"{number(time[-1] / time[0], 3)} times that of a swarm of {few:,.0f}, at {many:,.0f} craft",
            )
        )
    if rows.has("own_air_bytes_per_s"):
        air = rows.spread("central_air_bytes_per_s", 1e-6).mean
        out.append(Fact("On the air", "0 B/s", f"one-way light; a central scheme needs {number(air[-1])} MB/s"))
    lit, tracking = rows.spread("lit_share", 100).mean, rows.spread("tracking_share", 100).mean
    out.append(
        Fact(
            "Tracking",
            f"{number(tracking[-1])} %",
            f"of the time at {many:,.0f} craft; {number(lit[-1])} % of photodiodes lit",
        )
    )
    if rows.has("central_position_gain_share"):
        gain = rows.spread("central_position_gain_share", 100).mean
        bound = rows.spread("rotor_known_position_gain_share", 100).mean
        out.append(
            Fact(
                "A central solver would gain",
                percent(gain[-1]),
                f"in position, at {many:,.0f} craft; {percent(bound[-1])} were the rotor errors known",
            )
        )
    if (line := central_line(rows)) and line.limit_craft:
        out.append(Fact("It keeps pace up to", f"{number(line.limit_craft, 2)} craft", "on one core like this one"))
    return out


def sections(rows: Rows) -> list[Section]:
    """Return the sections of the page, one per question."""
    out = []
    if rows.has("onboard_alone_us"):
        out.append(Section("What a craft computes", _onboard(rows), [onboard(rows)]))
    out.append(Section("What a craft sees", _visibility(rows), [visibility(rows)]))
    out.append(Section("How well it knows its pose", _precision(rows), [precision(rows)]))
    if rows.has("central_solve_us"):
        pictures = [central_cost(rows), central_gain(rows)]
        out.append(Section("What a central solver would cost, and gain", _central(rows), pictures))
    out.append(Section("In figures", (), (), [_table(rows)]))
    return out


def _onboard(rows: Rows) -> list[str]:
    time = rows.spread("onboard_alone_us").mean
    return prose(
        PROSE,
        "onboard",
        **_ends(rows),
        least=np.nanmin(time),
        most=np.nanmax(time),
        growth=time[-1] / time[0],
        apart_m=np.nanmax(rows.column("onboard_alone_apart_m")),
    )


def _visibility(rows: Rows) -> list[str]:
    lit, tracking = rows.spread("lit_share", 100).mean, rows.spread("tracking_share", 100).mean
    return prose(PROSE, "visibility", **_ends(rows), lit=lit, tracking=tracking)


def _precision(rows: Rows) -> list[str]:
    nees = rows.spread("nees_mean").mean
    return prose(PROSE, "precision", least=np.nanmin(nees), most=np.nanmax(nees))


def _central(rows: Rows) -> list[str]:
    cost, own = rows.spread("central_solve_us").mean, rows.spread("own_solve_us").mean
    return prose(
        PROSE,
        "central",
        **_ends(rows),
        line=central_line(rows),
        own=np.nanmean(own),
        crossing=next((n for n, c, o in zip(rows.points, cost, own, strict=True) if c > o), None),
        load=cost[-1] / own[-1],
        full=100 * cost[-1] / line.period_us if (line := central_line(rows)) else None,
        gain=rows.spread("central_position_gain_share", 100).mean,
        bound=rows.spread("rotor_known_position_gain_share", 100).mean[-1],
        found=rows.spread("rotor_variance_found_share", 100).mean[-1],
        air=rows.spread("central_air_bytes_per_s", 1e-6).mean[-1],
    )


def _ends(rows: Rows) -> dict[str, float]:
    return {"few": rows.points[0], "many": rows.points[-1]}


def _table(rows: Rows) -> Table:
    wanted = [
        ("lit_share", 100, Column("photodiodes lit", "%")),
        ("tracking_share", 100, Column("tracking", "%")),
        ("ekf_position_rms_m", 1000, Column("position RMS", "mm")),
        ("ekf_attitude_rms_deg", 1, Column("attitude RMS", "°")),
        ("nees_mean", 1, Column("NEES")),
        ("onboard_alone_us", 1, Column("own computer", "µs/period")),
        ("onboard_swarm_per_craft_us", 1, Column("batch", "µs/craft")),
        ("own_solve_us", 1, Column("own solve", "µs")),
        ("central_solve_us", 1e-3, Column("central solve", "ms")),
        ("central_air_bytes_per_s", 1e-6, Column("central, air", "MB/s")),
    ]
    known = [(rows.spread(name, scale).mean, column) for name, scale, column in wanted if rows.has(name)]
    runs = [str(np.count_nonzero(chosen)) for chosen in rows.members]
    body = [[count(point), runs[i], *(number(mean[i]) for mean, _ in known)] for i, point in enumerate(rows.points)]
    columns = [Column("craft"), Column("runs"), *(c for _, c in known)]
    if rows.has("central_position_gain_share"):
        columns.append(Column("central gain", "%"))
        for row, gain in zip(body, rows.spread("central_position_gain_share", 100).mean, strict=True):
            row.append(percent(gain).removesuffix(" %"))
    return Table(columns, body, "Means over the seeds.", left=0)
