"""Docstrings open as a sentence or a noun phrase, and a public function documents every one of many parameters."""

import ast
import re
from pathlib import Path

import pytest
from public_functions import Function, public_functions

ROOT = Path(__file__).parents[1]
MODULES = sorted(
    path.relative_to(ROOT).as_posix() for room in ("swarm", "estimators") for path in (ROOT / room).rglob("*.py")
)
FRAGMENTS = {"What", "Where", "How", "Of", "Who", "Whether", "Why", "When"}
"""Words with which a clause begins that does not stand alone."""
COMMANDS = "swarm/cli/"
"""Functions here document their parameters in their options: the docstrings are the pages of `swarm COMMAND --help`."""


def undocumented(module: str) -> dict[str, list[str]]:
    """Return the public functions of a module with parameters that their `Args:` block leaves out."""
    if module.startswith(COMMANDS):
        return {}
    functions = public_functions(ast.parse((ROOT / module).read_text()))
    return {one.name: one.undocumented for one in functions if one.undocumented}


def fragments(module: str) -> list[str]:
    """Return the docstrings of a module that open with a fragment, each with its line and name."""
    found = []
    for node in ast.walk(ast.parse((ROOT / module).read_text())):
        if not isinstance(node, ast.Module | ast.ClassDef | Function):
            continue
        text = ast.get_docstring(node) or ""
        if re.split(r"\W", text, maxsplit=1)[0] in FRAGMENTS:
            line, name = (1, "") if isinstance(node, ast.Module) else (node.lineno, f" {node.name}")
            found.append(f"{module}:{line}{name}: {text.splitlines()[0]}")
    return found


@pytest.mark.parametrize("module", MODULES)
def test_many_parameters_have_an_args_block(module: str) -> None:
    missing = undocumented(module)
    assert not missing, "no complete Args block: " + "; ".join(f"{f}({', '.join(p)})" for f, p in missing.items())


@pytest.mark.parametrize("module", MODULES)
def test_docstrings_do_not_open_with_a_fragment(module: str) -> None:
    found = fragments(module)
    assert not found, "\n".join(found)


def test_the_rule_is_held_where_it_is_broken() -> None:
    text = 'class A:\n def f(self, a, *b, c):\n  """F.\n\n  Args:\n      a: one.\n      *b: two.\n  """'
    (one,) = public_functions(ast.parse(text))
    assert (one.name, one.parameters, one.undocumented) == ("A.f", ("a", "c", "b"), ["c"])
