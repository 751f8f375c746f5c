"""The README keeps its word: its snippets run, its links lead somewhere, its commands exist."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.main import get_command

from swarm.cli.app import app

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
DOCS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "models").rglob("README.md"))]


def snippets(language: str) -> list[tuple[str, str]]:
    fence = re.compile(rf"^```{language}\n(.*?)^```", re.MULTILINE | re.DOTALL)
    # The architecture page quotes the program's own code, which test_architecture holds to it.
    pages = [page for page in DOCS if page.name != "architecture.md"]
    return [(str(page.relative_to(ROOT)), text) for page in pages for text in fence.findall(page.read_text("utf-8"))]


def test_it_has_two_commands_that_start_from_nothing():
    commands = re.findall(r"^python3 -m venv .*$", README, re.MULTILINE)
    assert len(commands) == 2
    assert commands[0].endswith("swarm run formation")
    assert "[test]" in commands[1]
    assert commands[1].endswith("pytest")


@pytest.mark.parametrize(("page", "text"), snippets("python"))
def test_python_snippets_run(page, text, tmp_path):
    if "../shared/data" in text or ".rec" in text:
        pytest.skip("needs a recording of a real lighthouse")
    done = subprocess.run(
        [sys.executable, "-c", text],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, f"{page}:\n{done.stderr}"


@pytest.mark.parametrize("page", DOCS, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https?://|#)([^)#]+)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_every_command_that_it_shows_exists():
    known = set(get_command(app).commands)  # type: ignore[attr-defined]
    shown = set(re.findall(r"^\| `swarm ([a-z]+)", README, re.MULTILINE))
    assert shown == known
