"""The notebooks: small, without outputs, and their code runs. `benchmarks/notebooks.py` runs them in a kernel."""

import json
import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest

ROOT = Path(__file__).parents[1]
BOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
LISTED = re.findall(r"notebooks/([\w-]+)\.ipynb", (ROOT / "docs" / "notebooks.md").read_text(encoding="utf-8"))


def cells(book: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(book.read_text(encoding="utf-8"))["cells"]
    return found


def test_the_page_lists_every_notebook() -> None:
    assert sorted(set(LISTED)) == [book.stem for book in BOOKS]
    assert len(BOOKS) == 4


@pytest.mark.parametrize("book", BOOKS, ids=lambda book: book.stem)
def test_a_notebook_is_small_and_has_no_outputs_and_no_paths_of_a_machine(book: Path) -> None:
    text = book.read_text(encoding="utf-8")
    assert len(text) < 10_000
    assert not re.search(r"/home/|/root|/tmp|/work|[A-Z]:\\\\", text)
    assert cells(book)[0]["cell_type"] == "markdown"
    assert "".join(cells(book)[0]["source"]).startswith("# ")
    for cell in cells(book):
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None
            compile("".join(cell["source"]), book.stem, "exec")


@pytest.mark.parametrize("book", BOOKS, ids=lambda book: book.stem)
def test_the_code_of_a_notebook_runs_and_draws(book: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "__main__"}
    try:
        for cell in cells(book):
            if cell["cell_type"] == "code":
                exec("".join(cell["source"]), names)
        drawn = [line for i in plt.get_fignums() for axes in plt.figure(i).axes for line in axes.lines]
        assert drawn
        assert all(len(line.get_xdata()) > 1 for line in drawn)  # type: ignore[arg-type]
    finally:
        plt.close("all")
