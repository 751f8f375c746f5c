"""Every command that README and docs show: the program takes its words, and scripts and shipped things are there."""

import re
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from swarm.assets import find_model, find_study, recordings
from swarm.cli.app import app
from swarm.scenario import load

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
PAGES += sorted((ROOT / "docs").glob("*.rst"))
FENCE = re.compile(r"^ *```(?:sh|)\n(.*?)^ *```|^\.\. code-block:: sh\n(.*?)^\S", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`((?:swarm|python) [^`]+)`")
OWN = re.compile(r"^(?:my|our|runs|probe|FLIGHT)\b|[./*]|^[A-Z_]+$|^(?:walk|NAME)")
"""Files of the reader, and placeholders."""


def commands(page: Path) -> Iterator[list[str]]:
    """Yield the words of the page's commands, in blocks and in sentences."""
    text = page.read_text(encoding="utf-8")
    lines = [
        line for blocks in FENCE.findall(text) for block in blocks for line in block.replace("\\\n", " ").splitlines()
    ]
    inline = [" ".join(one.split()) for one in INLINE.findall(FENCE.sub("", text))]
    # Of a command in a sentence often only its name is told, or an option.
    inline = [one for one in inline if "..." not in one and not re.fullmatch(r"swarm \S+(?: --\S+)?", one)]
    for line in [*lines, *inline]:
        for part in line.split(" && "):
            said = part.strip().removeprefix("$ ").removeprefix(".venv/bin/")
            said = said.rpartition(" | ")[2]
            if re.match(r"(?:swarm [a-z]|python3? (?:-m swarm )?(?:benchmarks|experiments|tests)/)", said):
                yield shlex.split(said, comments=True)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_program_takes_the_commands_of_a_page(page: Path) -> None:
    root = get_command(app)
    known: dict[str, Any] = root.commands  # type: ignore[attr-defined]
    finds: dict[str, Callable[[str], object]] = {"study": find_study, "layout": find_model}
    for words in commands(page):
        said = shlex.join(words)
        program, *rest = words
        if program != "swarm":
            script = ROOT / rest[0]
            assert script.is_file(), said
            source = script.read_text(encoding="utf-8")
            for word in rest[1:]:
                if word.startswith("--"):
                    name = word[2:].partition("=")[0].replace("-", "_")
                    assert re.search(rf"\b{name}\b|{word}\b", source) or name == "out", said
            continue
        name, *words = rest
        assert name in known, said
        try:
            with known[name].make_context(name, list(words)) as context:
                first = next(iter(words), "-")
                if first.startswith("-") or OWN.search(first):
                    continue
                if name in ("run", "check"):
                    sets = context.params["overrides"] or ()
                    load(first, [one for one in sets if not OWN.search(one.partition("=")[2])])
                elif name in ("replay", "survey"):
                    assert first in recordings(), said
                elif name in finds:
                    finds[name](first)
        except Exception as error:  # typer has its own copy of click, whose errors it does not export
            pytest.fail(f"{page.name}: {said}: {error}")


def test_no_page_is_without_its_commands() -> None:
    assert sum(len(list(commands(page))) for page in PAGES) > 150
