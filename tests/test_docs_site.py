"""The documentation's site and its tutorial: no warning, no page left out, and the commands run."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from swarm.assets import scenarios

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


def test_no_page_is_left_out() -> None:
    named = set(re.findall(r"^   ([a-z0-9-]+)$", (DOCS / "index.rst").read_text(), re.MULTILINE))
    assert {page.stem for page in DOCS.glob("*.md")} <= named


def test_the_gallery_has_every_scenario() -> None:
    """`python benchmarks/gallery.py --only NAME` adds one."""
    page = (DOCS / "gallery.md").read_text()
    assert re.findall(r"^## (.+)$", page, re.MULTILINE) == list(scenarios())
    for name in scenarios():
        assert f"`swarm run {name}`" in page
    pictures = re.findall(r"\]\((gallery/.+?)\)", page)
    assert len(pictures) >= 10
    assert all((DOCS / picture).is_file() for picture in pictures)


def test_the_citation_has_the_version_and_the_licence_of_the_package() -> None:
    def said(key: str, text: str) -> str:
        return re.findall(rf'^{key}\b\s*[:=]\s*"?([^"\n]+)', text, re.MULTILINE)[0]

    package, citation = (ROOT / "pyproject.toml").read_text(), (ROOT / "CITATION.cff").read_text()
    assert [said(key, citation) for key in ("version", "license")] == [
        said(key, package) for key in ("version", "license")
    ]


@pytest.mark.long
def test_the_tutorial_runs(tmp_path: Path) -> None:
    blocks = re.findall(r"^```sh\n(.*?)^```", (DOCS / "tutorial.md").read_text(), re.MULTILINE | re.DOTALL)
    commands = [shlex.split(line, comments=True) for block in blocks for line in block.splitlines()]
    assert len(commands) >= 8
    for program, *words in commands:
        assert program == "swarm"
        done = subprocess.run(
            [sys.executable, "-m", "swarm", *words],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=False,
        )
        # A criterion that reflections break is what the last flight is about.
        assert done.returncode in ((0, 1) if "runs/ghosts" in words else (0,)), f"{words}\n{done.stderr}"


@pytest.mark.long
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("sphinx", reason="needs the extra docs")
    pytest.importorskip("myst_parser", reason="needs the extra docs")
    pytest.importorskip("furo", reason="needs the extra docs")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", str(DOCS), str(tmp_path / "site")],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for page in ("index", "tutorial", "gallery", "commands", "python", "scenario"):
        assert (tmp_path / "site" / f"{page}.html").is_file()
