"""Write the report of a run or a study: report.html, and its figures as SVG and PNG in `figures/` beside it."""

from pathlib import Path

from swarm.errors import SwarmError
from swarm.report import scaling, sweep
from swarm.report.page import Page, Section, html
from swarm.report.rows import Rows
from swarm.report.run import run_page
from swarm.report.subject import Subject
from swarm.results.disk import write_all
from swarm.results.files import FIGURES, REPORT, SUMMARY
from swarm.results.owned_folder import find_any
from swarm.results.run_folder import CONTENTS as RUN
from swarm.results.run_folder import Run, open_run
from swarm.results.summary_shape import check_summary
from swarm.studies.campaign.study_folder import CONTENTS as STUDY
from swarm.studies.campaign.study_folder import FinishedStudy, open_study
from swarm.studies.campaign.task import COMPLETE

REPRODUCE = (
    "The same seeds give the same numbers, bit for bit, on the same machine and versions, for any number of workers; "
    "only wall-clock times differ."
)


def write_report(path: str | Path, out: Path | None = None, paper: str | None = None) -> tuple[Path, list[Path]]:
    """Write the page of a run or a study, and its figures.

    Args:
        path: The folder of the run or the study.
        out: The page's file, by default `report.html` in that folder.
        paper: Write the figures for a paper, in this format of `swarm.report.figures.PAPER`.

    Returns:
        The page's file and the files of its figures.

    Raises:
        SwarmError: `path` is neither a run nor a study, its files are damaged, or nothing can be written.
    """
    folder, page, text = _page(path)
    file = out or folder / REPORT
    figures = file.parent / (FIGURES if out is None else f"{file.stem}-{FIGURES}")
    drawn = {figures / name: data for one in page.pictures for name, data in one.files().items()}
    if paper is not None:
        drawn |= {figures / name: data for one in page.pictures for name, data in one.files(paper).items()}
    write_all({file: text.encode()})
    if drawn:
        write_all(drawn)
    return file, list(drawn)


def report(path: str | Path, out: str | Path | None = None) -> Path:
    """Write the page as `write_report` does, and return its file."""
    return write_report(path, None if out is None else Path(out))[0]


def _page(path: str | Path) -> tuple[Path, Page, str]:
    """Return the folder at `path`, the page of the run or the study in it, and that page as HTML."""
    folder, _, kind = find_any(path, STUDY, RUN)
    result = open_study(folder) if kind is STUDY else open_run(folder)
    if isinstance(result, Run):
        check_summary(result.summary, str(result.folder / SUMMARY))
    try:
        page = run_page(Subject(result)) if isinstance(result, Run) else study_page(result)
        return result.folder, page, html(page)
    except SwarmError as error:
        raise SwarmError(f"{result.folder}: {error}") from error


def study_page(study: FinishedStudy) -> Page:
    """Return the page of a study."""
    state = study.state
    flown = sum(status == COMPLETE for status in study.rows.column("status").to_pylist())
    facts, sections = [], []
    if not flown:
        sections.append(Section("Nothing was flown", ["Not one run has figures."]))
    elif scaling.is_scaling(study):
        rows = Rows.of(study, scaling.COUNT)
        facts, sections = scaling.facts(rows), scaling.sections(rows)
    else:
        sections = sweep.sections(study)
    warning = ""
    if study.status != "complete":
        warning = f"This study is not complete: {len(study.rows)} of {state.get('planned')} runs are here."
    timed = f"{state.get('wall_s', 0.0):.0f} s on {state.get('where')} ({state.get('machine')})"
    return Page(
        title=f"Study: {state.get('name')}",
        subtitle=f"{state.get('description')}. {flown} runs, {timed}.".lstrip(". "),
        facts=facts,
        sections=[*sections, *sweep.failures(study)],
        warning=warning,
        reproduce=REPRODUCE,
        commands=[state.get("command") or "", f"swarm study {study.folder}/study.toml --out again"][
            not state.get("command") :
        ],
        versions=state.get("versions", []),
        source_name="study.toml",
        source=study.text,
    )
