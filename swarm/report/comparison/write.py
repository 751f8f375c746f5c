"""Write the comparison of runs to a file: its figure, or one HTML page with its table, its sentences and its figure."""

import shlex
from pathlib import Path

from swarm.errors import SwarmError
from swarm.report.comparison.comparison import Comparison
from swarm.report.comparison.measures import NOTHING
from swarm.report.page import Column, Page, Section, Table, html
from swarm.results.disk import write_all

FORMATS = ("html", "png", "svg", "pdf")
REPRODUCE = "The runs stay as they are; the same command makes the same page."


def check_format(file: Path) -> str:
    """Return the format of a comparison's file, by its ending. Raises SwarmError where there is none such."""
    kind = file.suffix.removeprefix(".").lower()
    if kind not in FORMATS:
        raise SwarmError(f"--out: {file}: the ending must be one of {', '.join(f'.{each}' for each in FORMATS)}")
    return kind


def write_comparison(comparison: Comparison, file: Path) -> None:
    """Write the comparison to a file. Raises SwarmError where its format is unknown or it cannot be written."""
    kind = check_format(file)
    picture = comparison.picture
    if kind == "html":
        content = html(comparison_page(comparison)).encode()
    elif picture is None:
        raise SwarmError(f"{file}: there is nothing to draw: no run has a period and a craft that navigates")
    else:
        content = picture.drawn(kind)
    write_all({file: content})


def comparison_page(comparison: Comparison) -> Page:
    """Return the page of a comparison."""
    names, picture = comparison.names, comparison.picture
    differing = Table(
        [Column("setting"), *(Column(name) for name in names)],
        [[row.key, *(NOTHING if value is None else value for value in row.values)] for row in comparison.settings],
        left=1 + len(names),
    )
    heads = [Column("figure"), Column("unit"), Column(names[0])]
    heads += [one for name in names[1:] for one in (Column(name), Column(f"{name[0]}/A"))]
    rows = []
    for row in comparison.measures:
        cells = [row.name, row.unit, row.text(0)]
        cells += [cell for run in range(1, len(names)) for cell in (row.text(run), row.ratio_text(run))]
        rows.append(cells)
    same = "The scenarios are the same, value by value."
    folders = [shlex.quote(str(subject.run.folder)) for subject in comparison.subjects]
    return Page(
        title=f"Comparison of {len(names)} runs",
        subtitle="; ".join(f"{label}: {folder}" for label, folder in zip(comparison.labels, folders, strict=True)),
        sections=[
            Section("Figures", comparison.notes, [] if picture is None else [picture], [Table(heads, rows, left=2)]),
            Section(
                "Different settings", [] if comparison.settings else [same], tables=[differing][: len(differing.rows)]
            ),
        ],
        commands=[f"swarm compare {' '.join(folders)} --out comparison.html"],
        reproduce=REPRODUCE,
    )
