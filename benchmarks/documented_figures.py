"""Check the figures of README, CHANGELOG and docs: run the commands that print them, and compare.

    python benchmarks/documented_figures.py --list            the commands, with their run time and number of figures
    python benchmarks/documented_figures.py --quick           only commands that take less than 30 s
    python benchmarks/documented_figures.py --only integrity  only commands that contain this text; may be repeated
    python benchmarks/documented_figures.py                   all of them: some hours

Each command runs once, in a temporary folder. A line is printed per figure, and the exit code is 1 if one differs.

A comment before a paragraph or a table of a page says what prints its figures. The first line has the run time on two
idle cores, and the command; `&&` joins commands that need each other's files:

    <!-- figures (5 min): python benchmarks/integrity.py
    1.046 times = position_rms_ratio
    row position error RMS = clean.position_rms_mm ; with_ghosts.position_rms_mm
    -->

`TEXT = SOURCE` compares every number of TEXT, which stands so in the text below; `row LABEL = ...` compares the cells
of that row of the table, `-` being a cell that is not compared (the paper's, or a size that was asked for). SOURCE is

    clean.position_rms_mm          a path in the JSON that the command prints, or in the summary.json of its run
    Group > quantity               a line of an experiment's comparison; row > column of a table above it
    docking_lateral_m max          a column of a study's runs: max, min, mean, median, count or sum; with `[word]`
                                   behind it, of the runs with this word in another column
    /residual ([0-9.]+)/           what the last command prints: each group of the expression is a number

`NAME: SOURCE` is of the folder runs/NAME instead of the last one; `SOURCE least` or `most` is one end of a range.
Several sources, joined by ` & `, are the several numbers of one cell. Units follow from the names. A figure must be
what is measured, rounded to its last digit, or within an appended tolerance (`± 10 %`); "above", "below", "at least"
and "at most" in TEXT are bounds. Figures that no command prints are declared by the reason, up to the next heading of
the same level:

    <!-- figures: theory, sizes of the definitions -->

with `theory`, `setting`, `paper` or `unmeasurable`. tests/test_documented_figures.py finds figures without either.
"""

import argparse
import json
import math
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
REASONS = ("theory", "setting", "paper", "unmeasurable")
GENERATED = ("scenario.md", "telemetry.md")
"""Pages that are written from the program's own tables: their figures are its bounds and defaults."""
QUICK_S = 30.0
UNITS = {
    "um": ("m", 1e-6),
    "mm": ("m", 1e-3),
    "cm": ("m", 1e-2),
    "m": ("m", 1.0),
    "km": ("m", 1e3),
    "mm/s": ("m/s", 1e-3),
    "m/s": ("m/s", 1.0),
    "us": ("s", 1e-6),
    "ms": ("s", 1e-3),
    "ns": ("s", 1e-9),
    "s": ("s", 1.0),
    "min": ("s", 60.0),
    "arcsec": ("rad", math.radians(1 / 3600)),
    "urad": ("rad", 1e-6),
    "mrad": ("rad", 1e-3),
    "rad": ("rad", 1.0),
    "deg": ("rad", math.radians(1.0)),
    "degrees": ("rad", math.radians(1.0)),
    "°": ("rad", math.radians(1.0)),
    "%": ("1", 1e-2),
    "times": ("1", 1.0),
}
"""Units of figures: dimension, and size in SI."""
OTHER_UNITS = ("m/s²", "m³", "deg/s", "°/s", "h", "Hz", "MHz", "ppm", "GB", "MB", "bytes", "hours", "minutes", "sigma")
NUMBER = r"(?<![\w.])-?\d{1,3}(?: \d{3})+(?![\d.])|(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
_UNIT = "|".join(re.escape(unit) for unit in sorted((*UNITS, *OTHER_UNITS), key=len, reverse=True))
FIGURE = re.compile(rf"(?:{NUMBER})(?: to (?:{NUMBER}))? ?(?:{_UNIT})(?![\w/²³])")
"""A number, or a range, with its unit."""
FENCE = r"^```.*?^```"
COMMENT = re.compile(r"<!-- figures(?: \((?P<time>[^)]*)\))?: (?P<head>[^\n]*?)(?:\n(?P<lines>.*?))?\s*-->", re.DOTALL)


class Check(NamedTuple):
    """One line of a comment.

    text: as documented, or the label of a row. cells: a source per cell, None: not compared. tolerance: relative; None:
    the last digit.
    """

    text: str
    cells: tuple[str | None, ...]
    tolerance: float | None
    is_row: bool


class Block(NamedTuple):
    """A comment with the text that it speaks of. command: empty where `reason` says why there is none."""

    page: str
    line: int
    command: str
    time_s: float
    checks: tuple[Check, ...]
    reason: str
    body: str


class Finding(NamedTuple):
    """One figure: documented, and measured in the same unit, or the reason why nothing was."""

    block: Block
    documented: str
    measured: str
    ok: bool


def pages() -> list[Path]:
    """Return the pages that have figures."""
    docs = sorted(page for page in (ROOT / "docs").glob("*.md") if page.name not in GENERATED)
    return [ROOT / "README.md", ROOT / "CHANGELOG.md", *docs]


def text_of(page: Path) -> str:
    """Return the text of a page; of the changelog, that of the coming version."""
    text = page.read_text(encoding="utf-8")
    return re.split(r"^## \d", text, maxsplit=1, flags=re.MULTILINE)[0] if page.name == "CHANGELOG.md" else text


def blocks(page: Path) -> list[Block]:
    """Return the comments of a page, in its order. Raises ValueError where one cannot be read."""
    text = text_of(page)
    out = []
    for found in COMMENT.finditer(text):
        line = text.count("\n", 0, found.start()) + 1
        where = f"{page.name}:{line}"
        head = found["head"].strip()
        kind, _, reason = head.partition(", ")
        if kind in REASONS:
            if not reason:
                raise ValueError(f"{where}: {kind}: the reason is missing")
            out.append(Block(page.name, line, "", 0.0, (), head, _section(text, found.start(), found.end())))
            continue
        if found["time"] is None:
            raise ValueError(f"{where}: neither a run time with a command, nor one of {', '.join(REASONS)}")
        checks = tuple(_check(each.strip(), where) for each in (found["lines"] or "").splitlines() if each.strip())
        out.append(
            Block(page.name, line, head, _seconds(found["time"], where), checks, "", _to_heading(text, found.end()))
        )
    return out


def _section(text: str, start: int, end: int) -> str:
    """Return what a reason speaks of: all up to the next heading of the level of the one before the comment."""
    levels = re.findall(r"^(#+) ", _without(FENCE, text)[:start], re.MULTILINE)
    return _to_heading(text, end, len(levels[-1]) if levels else 1)


def _to_heading(text: str, begin: int, level: int = 6) -> str:
    """Return the text from `begin` to the next heading of this level or a higher one."""
    found = re.compile(rf"^#{{1,{level}}} ", re.MULTILINE).search(_without(FENCE, text), begin)
    return text[begin : found.start() if found else len(text)]


def _seconds(words: str, where: str) -> float:
    found = re.fullmatch(r"(\d+) (s|min|h)", words)
    if found is None:
        raise ValueError(f"{where}: a run time is written like '20 s', '5 min' or '2 h', not {words!r}")
    return float(found[1]) * {"s": 1, "min": 60, "h": 3600}[found[2]]


def _check(line: str, where: str) -> Check:
    text, equals, source = line.partition(" = ")
    if not equals:
        raise ValueError(f"{where}: {line!r}: 'TEXT = SOURCE' expected")
    tolerance = None
    if allowed := re.search(r" ± ([\d.]+) %$", source):
        tolerance, source = float(allowed[1]) / 100, source[: allowed.start()]
    row = text.startswith("row ")
    cells = [cell.strip() for cell in source.split(" ; ")] if row else [source.strip()]
    return Check(text.removeprefix("row "), tuple(None if cell == "-" else cell for cell in cells), tolerance, row)


def uncovered(page: Path) -> list[str]:
    """Return the figures of a page, with their lines, that neither a command nor a reason speaks of."""
    text = text_of(page)
    covered: set[tuple[int, int]] = set()
    for block in blocks(page):
        begin = text.index(block.body, _end_of_line(text, block.line)) if block.body.strip() else 0
        if block.reason:
            covered.add((begin, begin + len(block.body)))
            continue
        for check in block.checks:
            pattern = re.escape(check.text)
            if check.is_row:
                pattern = rf"^\| ?{pattern} \|.*$"
            for place in re.finditer(pattern, _without(r"<!--.*?-->", block.body), re.MULTILINE):
                covered.add((begin + place.start(), begin + place.end()))
    bare = _without_code(text)
    return [
        f"{page.name}:{bare.count(chr(10), 0, figure.start()) + 1}: {figure.group()}"
        for figure in FIGURE.finditer(bare)
        if not any(begin <= figure.start() and figure.end() <= end for begin, end in covered)
    ]


def _end_of_line(text: str, line: int) -> int:
    return sum(len(each) + 1 for each in text.split("\n")[: line - 1])


def _without_code(text: str) -> str:
    """Return the text with code, links and comments blanked, at the same places."""
    for pattern in (r"<!--.*?-->", FENCE, r"`[^`\n]*`", r"\]\([^)]*\)", r"^    [^\n]*$"):
        text = _without(pattern, text)
    return text


def _without(pattern: str, text: str) -> str:
    """Return the text with what matches the pattern blanked, at the same places."""
    return re.sub(pattern, lambda found: re.sub(r"[^\n]", " ", found[0]), text, flags=re.MULTILINE | re.DOTALL)


class Results(NamedTuple):
    """What a command gave. last: figures of what it printed or wrote last. by_folder: of every folder below runs."""

    last: Any
    by_folder: Mapping[str, Any]
    printed: str


def run(command: str, folder: Path) -> Results:
    """Run a command in `folder`. Raises RuntimeError where it fails."""
    printed = ""
    threads = {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT), "COLUMNS": "200"}
    for part in command.split(" && "):
        words = shlex.split(part)
        if words[0] == "swarm":
            words = [sys.executable, "-m", *words]
        elif words[0] == "python":
            words = [sys.executable, *(str(ROOT / word) if (ROOT / word).is_file() else word for word in words[1:])]
        else:
            raise RuntimeError(f"{part}: neither swarm nor python")
        done = subprocess.run(
            words, cwd=folder, env={**os.environ, **threads}, capture_output=True, text=True, check=False
        )
        # 1: a criterion that does not hold, which the figures will tell.
        if done.returncode not in (0, 1):
            raise RuntimeError(f"{part}: exit code {done.returncode}: {done.stderr.strip()[-300:]}")
        printed = done.stdout
    return results(folder, printed)


def results(folder: Path, printed: str) -> Results:
    """Return the figures of all runs, studies and experiments in `folder`, and of what the last command printed."""
    readers: dict[str, Callable[[Path], Any]] = {
        "summary.json": _json,
        "comparison.json": lambda file: _lines(_json(file)),
        "runs.parquet": _columns,
    }
    made = sorted((file for name in readers for file in folder.glob(f"runs/*/{name}")), key=lambda f: f.stat().st_mtime)
    by_folder = {file.parent.name: readers[file.name](file) for file in made}
    last = json.loads(printed) if printed.lstrip()[:1] == "{" else by_folder[made[-1].parent.name] if made else {}
    return Results(last, by_folder, printed)


def _json(file: Path) -> Any:
    return json.loads(file.read_text(encoding="utf-8"))


def _columns(file: Path) -> dict[str, Any]:
    """Return the statistics of a study's columns, of all runs and of those with each word of a column of words."""
    from swarm.results.parquet import read_table

    columns = read_table(file).to_pydict()
    of: dict[str, Callable[[Any], Any]] = {name: getattr(np, name) for name in ("max", "min", "mean", "median", "sum")}
    count = len(next(iter(columns.values())))
    chosen: dict[str, Sequence[int]] = {"": range(count)}
    for values in columns.values():
        words = {value for value in values if isinstance(value, str)}
        if 1 < len(words) < count:
            chosen |= {f" [{word}]": [i for i in range(count) if values[i] == word] for word in words}
    out: dict[str, Any] = {}
    for label, rows in chosen.items():
        for name, values in columns.items():
            known = [values[i] for i in rows if isinstance(values[i], int | float)]
            out[f"{name} count{label}"] = len(known)
            if known:
                out |= {f"{name} {how}{label}": float(made(known)) for how, made in of.items()}
    return out


def _lines(comparison: Mapping[str, Any]) -> dict[str, Any]:
    """Return an experiment's lines and tables, each value with its unit, by `group > quantity` and `row > column`."""
    out = {
        (f"{line['group']} > " if line["group"] else "") + line["quantity"]: (line["ours"], line["unit"] or None)
        for line in comparison["comparison"]
    }
    for grid in comparison["tables"]:
        for row, values in grid["rows"].items():
            for i, (column, value) in enumerate(zip(grid["columns"], values, strict=True)):
                unit = column.rpartition(", ")[2]
                # Columns may share a name: their number goes before it.
                out[f"{row} > {i + 1}"] = out[f"{row} > {column}"] = (value, unit)
    return out


def look_up(found: Results, source: str) -> list[tuple[float, str | None]]:
    """Return the values of a source, each with its unit. Raises KeyError with names that there are."""
    if source.startswith("/"):
        printed = re.search(source.strip("/"), found.printed)
        if printed is None:
            raise KeyError(f"{source}: not printed")
        return [(float(value.replace(" ", "")), None) for value in printed.groups()]
    out: list[tuple[float, str | None]] = []
    result = found.last
    for each in source.split(" & "):
        name, colon, path = each.partition(": ")
        if colon and name in found.by_folder:
            result, each = found.by_folder[name], path
        ends = {"least": min, "most": max}
        each, _, end = each.rpartition(" ") if each.endswith(tuple(f" {word}" for word in ends)) else (each, "", "")
        value, unit = _at(result, each)
        values = value if isinstance(value, list) else [value]
        out += [(float(v), unit) for v in ([ends[end](values)] if end else values)]
    return out


def _at(result: Any, source: str) -> tuple[Any, str | None]:
    if isinstance(result, Mapping) and source in result:
        found = result[source]
        return found if isinstance(found, tuple) else (found, _unit(source.partition(" ")[0]))
    at = result
    for key in re.findall(r'"[^"]+"|[^."]+', source):
        key = key.strip('"')
        if isinstance(at, list) and key.isdigit() and int(key) < len(at):
            at = at[int(key)]
        elif isinstance(at, Mapping) and key in at:
            at = at[key]
        else:
            names = ", ".join(list(at)[:12]) if isinstance(at, Mapping) else type(at).__name__
            raise KeyError(f"{source}: no {key!r} in {names}")
    return at, _unit(key)


def _unit(name: str) -> str | None:
    """Return the unit that a name's suffix says."""
    for unit in ("m_s", "mm", "um", "m", "ms", "us", "s", "deg", "rad"):
        if re.search(rf"(?:^|_){unit}(?:_median|_rms|_max|_per_pose)?$", name):
            return unit.replace("m_s", "m/s")
    return "1" if re.search(r"share|ratio|probability", name) else None


def numbers(text: str) -> list[tuple[float, float, str | None]]:
    """Return the numbers of a text: value, half of its last digit, and the unit that follows it or its neighbours."""
    out: list[tuple[float, float, str | None]] = []
    for found in re.finditer(NUMBER, text):
        written = found[0].replace(" ", "")
        mantissa, _, exponent = written.partition("e")
        digits = len(mantissa.partition(".")[2])
        behind = re.match(rf" ?({_UNIT})(?![\w/²³])", text[found.end() :])
        unit = behind[1] if behind else None
        out.append((float(written), 0.5 * 10.0 ** (int(exponent or 0) - digits), unit))
    following = None
    for i in reversed(range(len(out))):
        value, half, unit = out[i]
        following = unit or following
        out[i] = value, half, following
    return out


def compare(text: str, measured: Sequence[tuple[float, str | None]], tolerance: float | None) -> tuple[str, bool]:
    """Return the measured values in the text's units, and whether the text says them."""
    stated = numbers(re.sub(r"\*\*", "", text))
    if len(stated) != len(measured):
        return f"{len(measured)} values for the {len(stated)} numbers of {text!r}", False
    shown, ok = [], True
    for (value, half, unit), (found, found_unit) in zip(stated, measured, strict=True):
        found = found * _factor(found_unit, unit)
        shown.append(f"{found:.4g}")
        allowed = half * (1 + 1e-9) if tolerance is None else max(half, tolerance * abs(value))
        if re.match(r"(?:\.\.\. )?(above|at least)", text):
            ok &= found >= value
        elif re.match(r"(?:\.\.\. )?(below|at most)", text):
            ok &= found <= value
        else:
            ok &= abs(found - value) <= allowed
    return " ".join(shown), ok


def _factor(measured: str | None, documented: str | None) -> float:
    """Return what a measured value is multiplied with to be in the documented unit."""
    if documented is None or documented not in UNITS:
        return 1.0
    dimension, size = UNITS[documented]
    measured = None if measured == "1" else measured
    if measured is None:
        return 1 / size if dimension == "1" else 1.0
    if measured not in UNITS or UNITS[measured][0] != dimension:
        raise KeyError(f"measured in {measured}, documented in {documented}")
    return UNITS[measured][1] / size


def findings(block: Block, found: Results) -> Iterator[Finding]:
    """Compare the figures of a block with what its command gave."""
    body = _without(r"<!--.*?-->", block.body)
    for check in block.checks:
        if check.is_row:
            row = re.search(rf"^\| ?{re.escape(check.text)} \|(.*)\|\s*$", body, re.MULTILINE)
            texts = [cell.strip() for cell in row[1].split("|")] if row else []
            if len(texts) != len(check.cells):
                yield Finding(block, check.text, f"{len(check.cells)} sources for {len(texts)} cells", False)
                continue
        else:
            texts = [check.text]
            if check.text not in body:
                yield Finding(block, check.text, "is not in the text below", False)
                continue
        for text, source in zip(texts, check.cells, strict=True):
            if source is None:
                continue
            try:
                shown, ok = compare(text, look_up(found, source), check.tolerance)
            except (KeyError, TypeError, ValueError) as error:
                shown, ok = str(error), False
            label = f"{check.text}: {text}" if check.is_row else text
            yield Finding(block, label, shown, ok)


def commands(only: Sequence[str], quick: bool) -> dict[str, list[Block]]:
    """Return the blocks by their command, the shortest command first.

    Args:
        only: Texts, one of which a command must contain; none: every command.
        quick: Whether to leave out commands of 30 s and more.
    """
    out: dict[str, list[Block]] = {}
    every = [block for page in pages() for block in blocks(page) if block.command]
    for block in sorted(every, key=lambda block: block.time_s):
        if (not only or any(text in block.command for text in only)) and not (quick and block.time_s >= QUICK_S):
            out.setdefault(block.command, []).append(block)
    return out


def main() -> None:
    """Run the commands, and print a line per figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", default=[], metavar="TEXT", help="only commands that contain it")
    parser.add_argument("--quick", action="store_true", help=f"only commands below {QUICK_S:.0f} s")
    parser.add_argument("--list", action="store_true", help="print the commands and their run times")
    options = parser.parse_args()
    chosen = commands(options.only, options.quick)
    if options.list:
        for command, of in chosen.items():
            count = sum(len([c for c in check.cells if c]) for block in of for check in block.checks)
            print(f"{of[0].time_s:6.0f} s  {count:3d} figures  {', '.join(sorted({b.page for b in of}))}: {command}")
        return
    wrong = total = 0
    for command, of in chosen.items():
        print(f"\n$ {command}", flush=True)
        begin = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            try:
                given = run(command, Path(folder))
            except RuntimeError as error:
                print(f"  failed: {error}")
                wrong += 1
                continue
        for block in of:
            for each in findings(block, given):
                total, wrong = total + 1, wrong + (not each.ok)
                verdict = "ok" if each.ok else "DIFFERS"
                print(f"  {verdict:7s}  {each.documented}  |  {each.measured}  ({block.page}:{block.line})")
        print(f"  {time.monotonic() - begin:.0f} s", flush=True)
    print(f"\n{total} figures, {wrong} that differ or could not be measured")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
