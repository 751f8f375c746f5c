"""A percentage is written in one way in all that a user reads, "86 %": in the sources' texts, the help, and docs/."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted(path for room in ("swarm", "estimators") for path in (ROOT / room).rglob("*.py"))
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "scenarios").rglob("*.toml")])
TOUCHING = re.compile(r"\d%")


def touching(code: str) -> Iterator[int]:
    """Yield the lines of a source in which a text has a percent sign right behind a number."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and TOUCHING.search(node.value):
            yield node.lineno  # a format such as .0% of an f-string is such a text too
        if isinstance(node, ast.JoinedStr):
            for value, behind in zip(node.values, node.values[1:], strict=False):
                if isinstance(value, ast.FormattedValue) and ast.unparse(behind).startswith("'%"):
                    yield node.lineno


@pytest.mark.parametrize(
    "code", ['f"{share:.0%} of the light"', 'f"{percent:.0f}% of the light"', '"97.5% of the light"', 'f"{1:.1%}"']
)
def test_a_sign_that_touches_its_number_is_found(code: str) -> None:
    assert list(touching(code))


def test_percent_signs_stand_apart_from_their_numbers() -> None:
    assert list(touching('f"{100 * share:.0f} % of the light"')) == []
    found = [f"{path.relative_to(ROOT)}:{line}" for path in SOURCES for line in touching(path.read_text())]
    found += [
        f"{path.relative_to(ROOT)}:{i}"
        for path in PAGES
        for i, line in enumerate(path.read_text().splitlines(), 1)
        if TOUCHING.search(line)
    ]
    assert found == []
