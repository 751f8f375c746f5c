"""Conduct a study: plan its runs, have those flown that are not finished yet, and write every row as it comes."""

import os
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from swarm.results.owned_folder import STOPPED
from swarm.results.run_writer import versions
from swarm.studies.campaign import cluster
from swarm.studies.campaign.plan import PlannedRun, default_folder, plan
from swarm.studies.campaign.study import Study, load_study, study_toml
from swarm.studies.campaign.study_folder import STUDY, FinishedStudy, Row, StudyFolder, open_study
from swarm.studies.campaign.task import COMPLETE, FAILED, Flown, Order
from swarm.version import VERSION

OVERHEAD_CRAFT = 10
"""The fixed cost of a run, in units of the cost of a craft; for the time left."""


class StudyProgress(NamedTuple):
    """The state of a study: done and failed of `total` runs, earlier starts included; share_left of the work."""

    done: int
    failed: int
    total: int
    share_left: float


def study(
    name_or_path: str | Path,
    overrides: Sequence[str] = (),
    *,
    craft: Sequence[int] = (),
    seeds: int | None = None,
    workers: int | None = None,
    out: str | Path | None = None,
    force: bool = False,
    resume: bool = False,
    scheduler: str | None = None,
    serial: bool = False,
    progress: Callable[[StudyProgress], None] | None = None,
) -> FinishedStudy:
    """Fly a scenario many times, as a study file says, and open the results.

    On all cores the runs are flown by processes of their own, which import the calling program: call this below
    `if __name__ == "__main__":`, or with `serial`.

    Args:
        name_or_path: Name or file of the study.
        overrides: Changes for every run, "key=value" each.
        craft: Numbers of craft; they replace the grid of swarm.count.
        seeds: Number of seeds; replaces the file's.
        workers: Runs at a time on this machine; default: one per core.
        out: Folder of the results; default `runs/<study>`.
        force: Replace what is there.
        resume: Keep the runs that are finished there.
        scheduler: Address of a dask scheduler; without it the runs are flown on this machine.
        serial: Fly one run after the other in this process.
        progress: Is told how far the study is.

    Returns:
        The study, opened.

    Raises:
        SwarmError: The study is wrong, a folder is in the way, or no scheduler answers.
    """
    chosen = load_study(name_or_path, overrides, craft=craft, seeds=seeds, workers=workers)
    return conduct(
        chosen,
        out=None if out is None else Path(out),
        force=force,
        resume=resume,
        scheduler=scheduler,
        serial=serial,
        progress=progress,
    )


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
    """Fly a study, and open its folder.

    Args:
        study: The study.
        out: Folder of the results; default `runs/<study>`.
        force: Replace what is there.
        resume: Keep the runs that are finished there.
        scheduler: Address of a dask scheduler; without it the runs are flown on this machine.
        serial: Fly one run after the other in this process, instead of on all cores.
        command: The command line, for study.json.
        progress: Is told how far the study is.

    Raises:
        SwarmError: The study is wrong, a folder is in the way, or no scheduler answers.
        KeyboardInterrupt: It was stopped; the study resumes.
    """
    runs, made_with = plan(study), versions()
    with StudyFolder.open(out or default_folder(study), runs, made_with, force=force, resume=resume) as folder:
        folder.write_text(STUDY, study_toml(study, made_with))
        began, earlier_s = time.monotonic(), _earlier_s(folder)
        head = {
            "name": study.name,
            "description": study.description,
            "version": VERSION,
            "versions": made_with,
            "command": command,
            "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
            "where": scheduler or ("one process" if serial else _workers(study.workers or cluster.cores())),
            "planned": len(runs),
        }

        def state() -> dict[str, Any]:
            rows = folder.rows.values()
            counts = {"finished": sum(row["status"] == COMPLETE for row in rows), "rows": len(rows)}
            return {**head, **counts, "wall_s": earlier_s + time.monotonic() - began}

        folder.mark("running", state())
        try:
            _fly_missing(study, runs, folder, _fleet(scheduler, serial, study.workers), progress)
        except BaseException as stop:
            folder.pause()
            reason = STOPPED if isinstance(stop, KeyboardInterrupt) else f"{type(stop).__name__}: {stop}"
            folder.interrupt(reason, state())
            raise
        folder.finish(state())
        return open_study(folder.path)


def _fly_missing(
    study: Study,
    runs: list[PlannedRun],
    folder: StudyFolder,
    fleet: AbstractContextManager[cluster.Fleet],
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
            scenario = run.scenario.model_dump(mode="json")
            orders.append(Order(run.number, run.key, scenario, study.measure, study.telemetry))
    tell()
    # The longest first, so that no worker begins one when the others have nothing left to do.
    orders.sort(key=lambda order: -work[order.number])
    if not orders:
        return
    with fleet as fly:
        for flown in fly(orders):
            folder.add(_row(missing[flown.number], flown), flown.telemetry)
            left -= work[flown.number]
            tell()


@contextmanager
def _fleet(scheduler: str | None, serial: bool, workers: int | None) -> Iterator[cluster.Fleet]:
    if serial:
        yield cluster.in_this_process
        return
    with cluster.on_cluster(scheduler) if scheduler else cluster.on_this_machine(workers) as fleet:
        yield fleet


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
