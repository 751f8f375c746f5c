"""A comparison of runs: read, checked and lettered, with all that its table, its page and its figure show."""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from string import ascii_uppercase

from swarm.errors import SwarmError
from swarm.report.comparison.measures import Measure, measures
from swarm.report.comparison.notes import notes
from swarm.report.comparison.picture import comparison_picture
from swarm.report.comparison.settings import Setting, differing
from swarm.report.figures import Picture
from swarm.report.subject import Subject
from swarm.results.files import SUMMARY
from swarm.results.run_folder import open_run
from swarm.results.summary_shape import check_summary

MOST_RUNS = len(ascii_uppercase)


class Comparison:
    """Runs beside each other. labels: a letter for each, A for the first, to which all ratios refer."""

    def __init__(self, paths: Sequence[str | Path]) -> None:
        """Read the runs in the folders `paths`.

        Raises SwarmError where they are fewer than two or too many, one is not a run, or a file of it is damaged.
        """
        if not 2 <= len(paths) <= MOST_RUNS:
            advice = "give at least two" if len(paths) < 2 else "many runs are a study: swarm study, swarm report"
            raise SwarmError(f"a comparison is of 2 to {MOST_RUNS} runs, not of {len(paths)}: {advice}")
        self.subjects = [_read(path) for path in paths]
        folders = [subject.run.folder.resolve() for subject in self.subjects]
        for folder, path in zip(folders, paths, strict=True):
            if folders.count(folder) > 1:
                raise SwarmError(f"{path} is given twice")
        self.labels = ascii_uppercase[: len(paths)]

    @cached_property
    def settings(self) -> list[Setting]:
        """The settings in which the runs differ."""
        return differing(self.subjects)

    @cached_property
    def measures(self) -> list[Measure]:
        """The figures that at least one of the runs has."""
        return measures(self.subjects)

    @cached_property
    def notes(self) -> list[str]:
        """Sentences about what the runs do not have in common."""
        return notes(self.subjects, self.labels, self.settings)

    @property
    def names(self) -> list[str]:
        """The letter and the folder of each run."""
        return [f"{label} {subject.run.folder.name}" for label, subject in zip(self.labels, self.subjects, strict=True)]

    @property
    def picture(self) -> Picture | None:
        """The figure of the runs that have a period and a craft that navigates; None where no run has."""
        drawn = [
            (subject, name)
            for subject, name in zip(self.subjects, self.names, strict=True)
            if subject.recorded and len(subject.series.navigating)
        ]
        return comparison_picture([one for one, _ in drawn], [name for _, name in drawn]) if drawn else None


def _read(path: str | Path) -> Subject:
    run = open_run(path)
    where = str(run.folder / SUMMARY)
    check_summary(run.summary, where)
    if run.status == "running" and not run.summary.get("swarm"):
        pass  # its figures are computed from the rows that there are
    elif "swarm" not in run.summary:
        raise SwarmError(f"{where} is damaged: it has no figures of the swarm")
    subject = Subject(run)
    check_summary(subject.summary, where)
    _ = subject.scenario
    return subject
