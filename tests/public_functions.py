"""The public functions of a module and what their docstrings leave out, read from its syntax tree alone."""

import ast
import re
from collections.abc import Iterator
from typing import NamedTuple

MANY = 2
"""So many parameters a summary line can name by itself; a function with more has an `Args:` block."""
Function = ast.FunctionDef | ast.AsyncFunctionDef


class Public(NamedTuple):
    """One public function or method. name: with its classes. parameters: without the object or class of a method."""

    name: str
    node: Function
    parameters: tuple[str, ...]

    @property
    def undocumented(self) -> list[str]:
        """The parameters that the `Args:` block leaves out, one line per parameter; none where a line names them all.

        A command of the command line documents its parameters in its options: its docstring is a page for users.
        """
        if len(self.parameters) <= MANY or self.node.name.startswith("_"):
            return []
        block = re.search(r"^Args:\n((?:[ \t]+.*\n?|\n)*)", ast.get_docstring(self.node) or "", re.MULTILINE)
        named = re.findall(r"^    \*{0,2}(\w+)(?: \(.*?\))?:", block[1] if block else "", re.MULTILINE)
        return [name for name in self.parameters if name not in named]


def public_functions(module: ast.Module) -> Iterator[Public]:
    """Yield every public function and method of a module; those of private classes are private."""
    yield from _in(module.body, "")


def _in(body: list[ast.stmt], prefix: str) -> Iterator[Public]:
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _in(node.body, f"{prefix}{node.name}.")
        elif isinstance(node, Function) and not node.name.startswith("_"):
            yield Public(f"{prefix}{node.name}", node, tuple(_parameters(node, method=bool(prefix))))


def _parameters(function: Function, *, method: bool) -> list[str]:
    given = function.args
    names = [one.arg for one in (*given.posonlyargs, *given.args)]
    if method and not any(isinstance(one, ast.Name) and one.id == "staticmethod" for one in function.decorator_list):
        names = names[1:]
    names += [one.arg for one in given.kwonlyargs]
    return names + [one.arg for one in (given.vararg, given.kwarg) if one is not None]
