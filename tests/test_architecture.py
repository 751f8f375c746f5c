"""docs/architecture.md is true: the files that it names exist, no room is left out, and the loop is the code's."""

import ast
import re
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`((?:swarm|estimators|tests|benchmarks|docs)/[\w./-]*)`", PAGE)))
LOOP = "swarm/flight/flight.py"


def children(package: str) -> list[str]:
    """Return the folders, with a slash, and the files of a package."""
    here = ROOT / package
    folders = [f"{package}/{child.name}/" for child in here.iterdir() if (child / "__init__.py").exists()]
    files = [f"{package}/{file.name}" for file in here.glob("*.py") if not file.name.startswith("__")]
    return sorted(folders + files)


@pytest.mark.parametrize("name", [name for name in NAMED if "NEW" not in name])
def test_a_file_that_is_named_exists(name: str) -> None:
    path = ROOT / name
    assert path.is_dir() if name.endswith("/") else path.is_file()


@pytest.mark.parametrize("name", children("swarm") + children("estimators"))
def test_no_room_is_left_out(name: str) -> None:
    assert f"`{name}`" in PAGE


@pytest.mark.parametrize("method", ["fly", "period", "move"])
def test_the_loop_is_quoted_as_it_is(method: str) -> None:
    text = (ROOT / LOOP).read_text(encoding="utf-8")
    (flight,) = (node for node in ast.parse(text).body if isinstance(node, ast.ClassDef) and node.name == "Flight")
    (code,) = (node for node in flight.body if isinstance(node, ast.FunctionDef) and node.name == method)
    assert code.end_lineno is not None
    now = textwrap.dedent("\n".join(text.splitlines()[code.lineno - 1 : code.end_lineno]))
    assert f"\n{now}\n" in PAGE, f"quote {LOOP} in docs/architecture.md as it is now:\n{now}"


@pytest.mark.parametrize(
    ("record", "file"), re.findall(r"^\| `(\w+)` \| `([\w/.]+)` \|", PAGE, re.MULTILINE), ids=lambda one: str(one)
)
def test_a_record_is_where_the_page_says(record: str, file: str) -> None:
    names = {node.name for node in ast.parse((ROOT / file).read_text()).body if isinstance(node, ast.ClassDef)}
    assert record in names


def test_no_function_is_longer_than_a_screen() -> None:
    """60 lines with the docstring; a kernel is one loop, and may be longer."""
    found = [
        f"{file.relative_to(ROOT)}:{node.lineno} {node.name}"
        for package in ("swarm", "estimators")
        for file in (ROOT / package).rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
        and node.end_lineno is not None
        and node.end_lineno - node.lineno >= 60
        and not any(ast.unparse(one).startswith(("kernel", "inlined")) for one in node.decorator_list)
    ]
    assert not found
