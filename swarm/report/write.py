"""Write the report of a run or a study: report.html, and its figures as SVG and PNG in `figures/` beside it."""

from pathlib import Path

from swarm.errors import SwarmError
from swarm.report import run as of_run
from swarm.report import scaling, sweep
from swarm.report.page import Page, Section, html
from swarm.report.rows import Rows
from swarm.results.disk import write_text, writing
from swarm.results.files import SUMMARY
from swarm.results.run_folder import SCENARIO, Run, open_run
from swarm.results.summary_shape import check_summary
from swarm.studies.campaign.study_folder import FIGURES, REPORT, FinishedStudy, is_study, open_study
from swarm.studies.campaign.task import COMPLETE

REPRODUCE = (
    "The same seeds give the same numbers, bit for bit, on the same machine and versions, for any number of workers; "
    "only wall-clock times differ."
)


def write_report(path: str | Path, out: Path | None = None) -> tuple[Path, list[Path]]:
    """Write the page of the run or the study at `path` to `out`, by default `report.html` in its folder.

    Returns the page's file and the files of its figures. Raises SwarmError where `path` is neither a run nor a study,
    or where nothing can be written.
    """
    folder, page = _page(path)
    file = out or folder / REPORT
    figures = file.parent / (FIGURES if out is None else f"{file.stem}-{FIGURES}")
    with writing(figures):
        file.parent.mkdir(parents=True, exist_ok=True)
        if page.pictures:
            figures.mkdir(exist_ok=True)
    write_text(file, html(page))
    return file, [written for picture in page.pictures for written in picture.write(figures)]


def _page(path: str | Path) -> tuple[Path, Page]:
    """Return the folder at `path`, and the page of the run or the study in it."""
    result = open_study(path) if is_study(path) else open_run(path)
    if isinstance(result, Run):
        check_summary(result.summary, str(result.folder / SUMMARY))
    try:
        return result.folder, run_page(result) if isinstance(result, Run) else study_page(result)
    except SwarmError as error:
        raise SwarmError(f"{result.folder}: {error}") from error
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        # Every value has the right type by now; what is left are figures that contradict each other.
        told = f"its files contradict each other, as after a change by hand ({type(error).__name__}: {error})"
        raise SwarmError(f"{result.folder}: no report can be made: {told}") from error


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


def run_page(run: Run) -> Page:
    """Return the page of one run."""
    scenario = run.scenario or ""
    head = [line.removeprefix("# ") for line in scenario.splitlines() if line.startswith("# ")]
    versions = [line for line in head if len(line.split()) == 2 and line.split()[1][:1].isdigit()]
    warning = (
        "" if run.status == "complete" else f"This run is not complete ({run.summary.get('reason', 'it was killed')})."
    )
    return Page(
        title=f"Run: {run.folder.name}",
        subtitle=of_run.extent(run),
        facts=of_run.facts(run) if run.summary.get("swarm") else [],
        sections=of_run.sections(run),
        warning=warning,
        reproduce="The scenario below has every value and the seed.",
        commands=[f"swarm run {run.folder}/{SCENARIO} --out again"] if scenario else [],
        versions=versions,
        source_name=SCENARIO,
        source=scenario,
    )
