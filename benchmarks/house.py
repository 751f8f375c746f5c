"""Counts of the house: rooms, floors, arrows, lines, long functions, undocumented parameters, and files per task.

python benchmarks/house.py                               # this tree
python benchmarks/house.py --against DIR                 # DIR before, this tree after
git worktree add DIR REVISION                            # such a DIR

A *room* is a folder or a single file in `swarm/`, or a folder in `estimators/`, whose single files are one room more;
`__init__` and `__main__` are none. An *arrow* goes from a room to another one that it imports, at any place in a file;
*floors* are the rooms on the longest chain of arrows. Everything is read from syntax trees: nothing is imported.

Files of a task are counted twice. By *example*, in any tree: the files of `swarm/` and `estimators/` whose name or code
(not docstrings and comments) names an example of the thing that the task adds; not those that only show it. By *table*:
the files that the table of docs/architecture.md names, where the tree has one.
"""

import argparse
import ast
import io
import json
import re
import sys
import tokenize
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from public_functions import Function, public_functions

HERE = Path(__file__).resolve().parents[1]
PACKAGES = ("swarm", "estimators")
LONG = 60
"""Lines of a function that is too long."""
EXAMPLES = {
    "pose sensor": r"ccd",
    "motion kind": r"tumble",
    "telemetry column": r"rejected_pulses",
    "fault kind": r"thrusterstuck|thruster_stuck",
    "CLI command": r"swarm[./](cli|commands)[./]calibrat",
    "criterion statistic": r"at_contact",
    "experiment of a paper": r"stereo_baseline",
}
"""Regular expression, small letters, of one thing that each task has added already."""
USERS = re.compile(r"^swarm/(studies/(?!papers)|report/|results/(report|recorder|recording|plots|summary))")
"""Files that only use or show what the tasks add."""
TASK = re.compile(r"^\| (?P<task>[^|]+?) \| (?P<files>[^|]*`[^|]+?) \|", re.MULTILINE)


class Lines(NamedTuple):
    """Lines of source: with code, inside docstrings, with nothing but a comment, blank."""

    code: int
    docstrings: int
    comments: int
    blank: int

    @property
    def total(self) -> int:
        """All lines."""
        return sum(self)


class Module(NamedTuple):
    """One file: its path in the tree, dotted name, syntax tree and text."""

    path: str
    name: str
    tree: ast.Module
    text: str

    @property
    def room(self) -> str:
        """The room that it is in; empty for `__init__` and `__main__` of a package."""
        package, *rest = self.path.removesuffix(".py").split("/")
        if not rest or rest[0] in ("__init__", "__main__"):
            return ""
        if package == "estimators":
            return f"{package}.{rest[0]}" if len(rest) > 1 else package
        return f"{package}.{rest[0]}"


def modules(tree: Path) -> list[Module]:
    """Return every file of the packages in a checkout."""
    out = []
    for file in sorted(file for package in PACKAGES for file in (tree / package).rglob("*.py")):
        path, text = file.relative_to(tree).as_posix(), file.read_text()
        name = path.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
        out.append(Module(path, name, ast.parse(text), text))
    return out


def imported(module: Module, known: Mapping[str, Module]) -> Iterator[str]:
    """Yield the dotted names of the modules of the house that a module imports, anywhere in it."""
    for node in ast.walk(module.tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [one.name for one in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for one in node.names:
                longer = f"{node.module}.{one.name}"
                names.append(longer if longer in known else node.module)
        yield from (name for name in names if name in known)


def arrows(house: Sequence[Module]) -> dict[str, set[str]]:
    """Return for every room the rooms that it imports."""
    known = {module.name: module for module in house}
    out: dict[str, set[str]] = {module.room: set() for module in house if module.room}
    for module in house:
        if module.room:
            out[module.room] |= {known[name].room for name in imported(module, known)} - {module.room, ""}
    return out


def floors(rooms: Mapping[str, set[str]]) -> int:
    """Return the number of rooms on the longest chain of arrows. Raises ValueError where there is a circle."""

    @cache
    def height(room: str) -> int:
        if room in above:
            raise ValueError(f"circle of imports through {room}")
        above.add(room)
        out = 1 + max((height(below) for below in rooms[room]), default=0)
        above.discard(room)
        return out

    above: set[str] = set()
    return max(map(height, rooms))


def docstrings(tree: ast.Module) -> list[ast.Constant]:
    """Return the docstrings of a module, and the strings below names that document them."""
    return [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    ]


def lines(module: Module) -> Lines:
    """Return the lines of a module by what is in them."""
    every = range(1, len(module.text.splitlines()) + 1)
    told = {n for node in docstrings(module.tree) for n in range(node.lineno, (node.end_lineno or node.lineno) + 1)}
    coded: set[int] = set()
    said: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(module.text).readline):
        if token.type == tokenize.COMMENT:
            said.add(token.start[0])
        elif token.type not in (tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER):
            coded |= set(range(token.start[0], token.end[0] + 1))
    coded -= told
    said -= coded | told
    return Lines(len(coded), len(told), len(said), len(every) - len(coded | told | said))


def added(parts: Sequence[Lines]) -> Lines:
    """Return the sum."""
    return Lines(*map(sum, zip(*parts, strict=True)))


def is_kernel(function: Function) -> bool:
    """Return whether numba compiles the function."""
    return any(re.search(r"kernel|inlined|formula|jit", ast.unparse(one)) for one in function.decorator_list)


def long_functions(house: Sequence[Module]) -> list[str]:
    """Return the functions longer than LONG lines, kernels left out."""
    return [
        f"{module.path}:{node.lineno} {node.name}, {length} lines"
        for module in house
        for node in ast.walk(module.tree)
        if isinstance(node, Function)
        and (length := (node.end_lineno or node.lineno) - node.lineno + 1) > LONG
        and not is_kernel(node)
    ]


def undocumented(house: Sequence[Module]) -> list[str]:
    """Return the public functions with parameters that their docstrings leave out; the command line's left out."""
    return [
        f"{module.path} {one.name}"
        for module in house
        if not module.path.startswith(("swarm/cli", "swarm/commands"))
        for one in public_functions(module.tree)
        if one.undocumented
    ]


def by_example(house: Sequence[Module]) -> dict[str, list[str]]:
    """Return for every task the files whose code names the example."""
    out: dict[str, list[str]] = {task: [] for task in EXAMPLES}
    for module in house:
        if USERS.match(module.path):
            continue
        told = {id(node) for node in docstrings(module.tree)}
        words = {
            str(word).lower()
            for node in ast.walk(module.tree)
            if id(node) not in told
            for key in ("id", "attr", "name", "arg", "module", "value")
            if isinstance(word := getattr(node, key, None), str)
        }
        for task, pattern in EXAMPLES.items():
            if any(re.search(pattern, word.replace("-", "_")) for word in (module.path, *words)):
                out[task].append(module.path)
    return out


def by_table(tree: Path) -> dict[str, list[str]]:
    """Return for every task the files that docs/architecture.md names."""
    page = tree / "docs" / "architecture.md"
    text = page.read_text().partition("## To add X")[2] if page.exists() else ""
    return {
        row["task"]: re.findall(r"`((?:swarm|estimators|scenarios)/[^`]+)`", row["files"])
        for row in TASK.finditer(text)
    }


def counts(tree: Path) -> dict[str, Any]:
    """Return all counts of a checkout."""
    house = modules(tree)
    rooms = arrows(house)
    by_room = {
        room: added([lines(module) for module in house if module.room == room])._asdict() for room in sorted(rooms)
    }
    return {
        "rooms": len(rooms),
        "folders": sum((tree / room.replace(".", "/")).is_dir() for room in rooms),
        "files": len(house),
        "floors": floors(rooms),
        "arrows": sum(map(len, rooms.values())),
        "lines": added([lines(module) for module in house])._asdict() | {"all": sum(lines(m).total for m in house)},
        "long_functions": long_functions(house),
        "undocumented": undocumented(house),
        "files_by_example": by_example(house),
        "files_by_table": by_table(tree),
        "room": by_room,
    }


def shown(found: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of the table, a column per tree."""

    def row(what: str, values: Sequence[Any]) -> str:
        return f"{what:<58}" + "".join(f"{value:>10}" for value in values)

    for key in ("rooms", "folders", "files", "floors", "arrows"):
        yield row(key, [one[key] for one in found])
    for kind in ("all", *Lines._fields):
        yield row(f"lines: {kind}", [one["lines"][kind] for one in found])
    yield row(f"functions over {LONG} lines, kernels left out", [len(one["long_functions"]) for one in found])
    yield row("public functions with undocumented parameters", [len(one["undocumented"]) for one in found])
    for title, key in (("by example", "files_by_example"), ("by table", "files_by_table")):
        for task in dict.fromkeys(task for one in found for task in one[key]):
            yield row(f"files {title}: {task}", [len(one[key][task]) if task in one[key] else "-" for one in found])
    for room in sorted({room for one in found for room in one["room"]}):
        sizes = [sum(one["room"][room].values()) if room in one["room"] else "-" for one in found]
        yield row(f"lines of {room}", sizes)


def main() -> None:
    """Count, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--tree", type=Path, default=HERE, metavar="DIR", help="the checkout; default: this one")
    parser.add_argument("--against", type=Path, metavar="DIR", help="an older checkout, shown beside it")
    parser.add_argument("--json", action="store_true", help="print JSON, with the names of what is counted")
    chosen = parser.parse_args()
    trees = [tree for tree in (chosen.against, chosen.tree) if tree is not None]
    found = [counts(tree) for tree in trees]
    if chosen.json:
        names = ["before", "after"] if len(found) == 2 else ["tree"]
        print(json.dumps(dict(zip(names, found, strict=True)), indent=1))
    else:
        print(*shown(found), sep="\n")


if __name__ == "__main__":
    main()
