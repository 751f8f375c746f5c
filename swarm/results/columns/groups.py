"""The groups of columns that a run has beside the core, from its scene, and the page that describes all of them."""

from swarm.results.columns.actuation import ACTUATION, IDEAL
from swarm.results.columns.ccd import CCD
from swarm.results.columns.column import Group
from swarm.results.columns.core import core
from swarm.results.columns.faults import faults
from swarm.results.columns.guidance import DOCKING, GUIDANCE
from swarm.results.columns.integrity import integrity
from swarm.results.columns.observer import observer
from swarm.results.columns.pairs import pairs
from swarm.results.columns.peer import PEER
from swarm.results.columns.smooth import COLUMNS as SMOOTH
from swarm.results.columns.smooth import ONLY
from swarm.results.columns.station_rows import station_rows
from swarm.results.scene import Scene


def groups_of(scene: Scene) -> list[Group]:
    """Return the groups beside the core, in the order of their columns in the file."""
    simulated = not scene.replay
    here = (
        (scene.replay, PEER),
        (bool(scene.ccd), CCD),
        (bool(scene.lidar), observer(scene.craft, scene.lidar)),
        (True, integrity(scene.watched)),
        (bool(scene.stations), station_rows([station.name for station in scene.stations])),
        (bool(scene.pairs), pairs(scene.craft, scene.pairs)),
        (simulated, ACTUATION if scene.actuated else IDEAL),
        (scene.guided, GUIDANCE),
        (scene.docking, DOCKING),
        (bool(scene.faults), faults(scene.faults)),
    )
    return [group for has, group in here if has]


def column_reference() -> str:
    """Return the text of docs/telemetry.md: every column with type, unit and meaning."""
    lines = [
        "# telemetry.parquet",
        "",
        "One row per craft and lighthouse period, ordered by frame, then craft. Poses are of the craft's body in the",
        "lighthouse frame (x right, y down, z forward) at the epoch, quaternions wxyz; rates and velocities are in the",
        "lighthouse frame. With several stations that is the frame in which they stand.",
        "What is not known is null, never zero. Numbers in brackets are equations of source 1",
        "(DOI 10.19650/j.cnki.cjsi.J2311957). In a replay all `true_*` and error columns are null. The file itself has",
        "`unit` and `meaning` as metadata of each field. More about some of the columns: [integrity](integrity.md),",
        "[actuation](actuation.md), [guidance](guidance.md), [faults](faults.md).",
        "",
        "While a run flies, and after one that was killed or met a full disk, its rows are in the folder",
        "`telemetry.parquet.partial`: `rows` is the file without its end, a row group of about two seconds after the",
        "other, and the footer of each is beside it. `swarm.open_run(FOLDER).telemetry` and",
        "`swarm report FOLDER` read them as the finished file. `angles.parquet` and `scans.parquet` grow likewise.",
        "",
        "The columns `smooth_*` come from [`swarm smooth`](smoother.md). They are in a file of their own,",
        "`smooth.parquet`, with `time_s`, `frame` and `craft`, row for row as in telemetry.parquet;",
        "`swarm.open_run(FOLDER).telemetry` has both.",
        "",
        "This page is made from the columns (`swarm.results.columns.groups.column_reference`).",
        "",
        "| column | type | unit | meaning |",
        "|---|---|---|---|",
    ]
    further = (
        PEER,
        CCD,
        observer((), ()),
        integrity(False),
        station_rows(()),
        pairs((), ()),
        ACTUATION,
        GUIDANCE,
        DOCKING,
        faults(()),
    )
    for columns, where in (*((group.columns, group.only) for group in (core(()), *further)), (SMOOTH, ONLY)):
        for column in columns:
            kind = "string" if column.kind in ("state", "name") else str(column.field.type)
            only = f"; only {where}" if where else ""
            lines.append(f"| `{column.name}` | {kind} | {column.unit} | {column.meaning}{only} |")
    return "\n".join(lines) + "\n"
