"""Conduct a study: plan its runs, have those flown that are not finished yet, and write every row as it comes."""

import os
import platform
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import NamedTuple

from swarm import __version__
from swarm.results.disk import write_text
from swarm.results.run_writer import versions
from swarm.studies.campaign import cluster
from swarm.studies.campaign.plan import PlannedRun, default_folder, plan
from swarm.studies.campaign.study import Study, study_toml
from swarm.studies.campaign.study_folder import STUDY, FinishedStudy, Row, StudyFolder, open_study
from swarm.studies.campaign.task import COMPLETE, FAILED, Flown, Order

OVERHEAD_CRAFT = 10
"""What a run costs beside its craft, in craft: for the time left."""


class StudyProgress(NamedTuple):
    """How far a study is. done, failed: of `total` runs, earlier starts included. share_left: of this start's work."""

    done: int
    failed: int
    total: int
    share_left: float


def conduct(
    study: Study,
    *,
    out: Path | None = None,
    force: bool = False,
    resume: bool = False,
    scheduler: str | None = None,
    serial: bool = False,
    command: str = "",
    progress: Callable[[StudyProgress], None] | None = None,
) -> FinishedStudy:
    """Fly a study into the folder `out` (default `runs/<study>`), and open it.

    force: replace what is there. resume: keep what is finished there. scheduler: a dask scheduler's address; without,
    this machine's cores, or one run after the other in this process where `serial`. command: told in study.json.
    Raises SwarmError: a wrong study, a folder in the way, no scheduler; KeyboardInterrupt leaves a study that resumes.
    """
    runs = plan(study)
    made_with = versions()
    folder = StudyFolder.open(out or default_folder(study), runs, made_with, force=force, resume=resume)
    try:
        return _conduct(study, runs, folder, made_with, scheduler, serial, command, progress)
    finally:
        folder.release()


def _conduct(
    study: Study,
    runs: list[PlannedRun],
    folder: StudyFolder,
    made_with: list[str],
    scheduler: str | None,
    serial: bool,
    command: str,
    progress: Callable[[StudyProgress], None] | None,
) -> FinishedStudy:
    write_text(folder.path / STUDY, study_toml(study, made_with))
    began, earlier_s = time.monotonic(), _earlier_s(folder)
    head = {
        "name": study.name,
        "description": study.description,
        "version": __version__,
        "versions": made_with,
        "command": command,
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "where": scheduler or ("one process" if serial else _workers(study.workers or cluster.cores())),
        "planned": len(runs),
    }

    def state(status: str) -> None:
        rows = folder.rows.values()
        counts = {"finished": sum(r["status"] == COMPLETE for r in rows), "rows": len(rows)}
        folder.write_state(status, **head, **counts, wall_s=earlier_s + time.monotonic() - began)

    state("running")
    try:
        _fly_missing(study, runs, folder, scheduler, serial, progress)
    except BaseException:
        folder.pause()
        state("interrupted")
        raise
    folder.close()
    state("complete")
    return open_study(folder.path)


def _fly_missing(
    study: Study,
    runs: list[PlannedRun],
    folder: StudyFolder,
    scheduler: str | None,
    serial: bool,
    progress: Callable[[StudyProgress], None] | None,
) -> None:
    missing = {run.number: run for run in runs if run.key not in folder.rows}
    work = {number: _work(run) for number, run in missing.items()}
    left = total = sum(work.values())

    def tell() -> None:
        if progress is not None:
            rows = folder.rows.values()
            failed = sum(row["status"] != COMPLETE for row in rows)
            progress(StudyProgress(len(rows), failed, len(runs), left / total if total else 0.0))

    orders = []
    for run in missing.values():
        if run.scenario is None:
            folder.add(_row(run, Flown(run.number, run.key, FAILED, run.problem, 0.0, {})))
            left -= work[run.number]
        else:
            orders.append(
                Order(run.number, run.key, run.scenario.model_dump(mode="json"), study.measure, study.telemetry)
            )
    tell()
    if not orders:
        return
    # The longest first, so that no worker begins one when the others have nothing left to do.
    orders.sort(key=lambda order: -work[order.number])
    with _fleet(scheduler, serial, study.workers) as fleet:
        for flown in fleet(orders):
            folder.add(_row(missing[flown.number], flown), flown.telemetry)
            left -= work[flown.number]
            tell()


@contextmanager
def _fleet(scheduler: str | None, serial: bool, workers: int | None) -> Iterator[cluster.Fleet]:
    if serial:
        with nullcontext(cluster.in_this_process) as here:
            yield here
    elif scheduler:
        with cluster.on_cluster(scheduler) as there:
            yield there
    else:
        with cluster.on_this_machine(workers) as local:
            yield local


def _row(run: PlannedRun, flown: Flown) -> Row:
    return {
        "run": run.number,
        "key": run.key,
        "status": flown.status,
        "reason": flown.reason or None,
        "seed": run.seed,
        **run.parameters,
        **flown.metrics,
        "seconds": flown.seconds,
    }


def _work(run: PlannedRun) -> float:
    scenario = run.scenario
    return 0.0 if scenario is None else scenario.duration_s * (OVERHEAD_CRAFT + len(scenario.craft_names))


def _workers(count: int) -> str:
    return "1 worker" if count == 1 else f"{count} workers"


def _earlier_s(folder: StudyFolder) -> float:
    """Wall time of earlier starts [s], where there were any."""
    return float(open_study(folder.path).state.get("wall_s", 0.0)) if folder.rows else 0.0
