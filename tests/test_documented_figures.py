"""The documented figures: every one is of a command or has a reason, and the script that checks them sees a wrong one.

The commands themselves run in benchmarks/documented_figures.py, which takes hours.
"""

import importlib.util
import json
import shlex
import sys
from pathlib import Path
from types import ModuleType

import pytest
from typer.main import get_command

from swarm.cli.app import app
from swarm.studies.papers.catalogue import EXPERIMENTS

ROOT = Path(__file__).parents[1]


def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("documented_figures", ROOT / "benchmarks" / "documented_figures.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


figures = script()
PAGES = figures.pages()
CHECKED = [block for page in PAGES for block in figures.blocks(page) if block.command]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_figure_is_of_a_command_or_has_a_reason(page: Path) -> None:
    assert figures.uncovered(page) == []


@pytest.mark.parametrize("block", CHECKED, ids=lambda block: f"{block.page}:{block.line}")
def test_what_is_checked_stands_in_the_text_and_its_command_exists(block) -> None:
    nothing = figures.Results({}, {}, "")
    for found in figures.findings(block, nothing):
        # Without results every source is missing: nothing else may be wrong with a line.
        assert not found.ok
        assert "no " in found.measured or "not printed" in found.measured, (found.documented, found.measured)
    for part in block.command.split(" && "):
        program, name, *rest = shlex.split(part)
        if program == "swarm":
            assert name in get_command(app).commands  # type: ignore[attr-defined]
            assert name != "reproduce" or rest[0] in EXPERIMENTS
        else:
            assert program == "python"
            assert (ROOT / name).is_file()


PAGE = """# Page
<!-- figures: theory, all of it is made up -->

## Printed
<!-- figures (1 s): python figures.py
0.526 mm = clean.position_rms_mm
0.10 m = length_m ± 5 %
row of two = - ; low_deg & high_deg ; share
below 2 % = share
-->
It errs by 0.526 mm over 0.10 m.

| what | wanted | angles | |
|---|---|---|---|
| of two | 9° | 0.1° to 0.4° | 1.5 % |

The rest is below 2 %.
"""
VALUES = {"clean": {"position_rms_mm": 0.52649}, "length_m": 0.104, "low_deg": 0.1, "high_deg": 0.44, "share": 0.0154}


@pytest.fixture
def block(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    assert figures.uncovered(page) == []
    return figures.blocks(page)[1]


def verdicts(block, values: dict) -> list[bool]:
    return [found.ok for found in figures.findings(block, figures.Results(values, {}, json.dumps(values)))]


def test_a_figure_is_what_is_measured_to_its_last_digit(block) -> None:
    assert verdicts(block, VALUES) == [True] * 5
    for wrong, place in (
        ({"clean": {"position_rms_mm": 0.5266}}, 0),
        ({"length_m": 0.1051}, 1),
        ({"high_deg": 0.46}, 2),
        ({"share": 0.0156}, 3),
        ({"share": 0.021}, 4),
    ):
        found = verdicts(block, VALUES | wrong)
        assert not found[place], wrong
    assert verdicts(block, {**VALUES, "length_m": 104.0})[1] is False, "a unit's factor is part of the figure"


def test_a_figure_without_command_or_reason_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    bare = PAGE.replace("<!-- figures: theory, all of it is made up -->", "")
    bare = bare.replace("It errs", "Noise of 3.2 arcsec: it errs")
    page.write_text(bare, encoding="utf-8")
    assert figures.uncovered(page) == ["page.md:11: 3.2 arcsec"]
    page.write_text(bare.replace("of two", "of three", 1), encoding="utf-8")
    row = [f"page.md:15: {figure}" for figure in ("9°", "0.1°", "0.4°", "1.5 %")]
    assert figures.uncovered(page) == ["page.md:11: 3.2 arcsec", *row]


def test_a_wrong_figure_ends_the_script_with_1(tmp_path: Path, monkeypatch, capsys) -> None:
    page, made = tmp_path / "page.md", tmp_path / "figures.py"
    page.write_text(PAGE, encoding="utf-8")
    made.write_text(f"import json\nprint(json.dumps({VALUES}))\n", encoding="utf-8")
    monkeypatch.setattr(figures, "pages", lambda: [page])
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    monkeypatch.setattr(sys, "argv", ["documented_figures.py", "--quick"])
    for values, code, words in ((VALUES, 0, "5 figures, 0 that differ"), (VALUES | {"share": 0.03}, 1, "DIFFERS")):
        made.write_text(f"import json\nprint(json.dumps({values}))\n", encoding="utf-8")
        with pytest.raises(SystemExit) as ended:
            figures.main()
        assert ended.value.code == code
        assert words in capsys.readouterr().out
