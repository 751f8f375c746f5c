"""Messages about the mistakes in a scenario: one line each, with file, key, value, limit and the nearest right name.

pydantic finds the mistakes; the messages are for a user who wrote the file and does not know pydantic.
"""

import re
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from typing import Any, Literal, NamedTuple, get_args, get_origin

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from swarm.errors import did_you_mean, nearest, question
from swarm.scenario.limits import limits_of
from swarm.scenario.schema import Scenario
from swarm.scenario.table import Table
from swarm.scenario.text import toml_value
from swarm.units import split_unit, written_unit
from swarm.user_text import short

Path = tuple[str | int, ...]
"""The path of a value: ("craft", 1, "motion", "from_m", 0) is craft[1].motion.from_m[0]."""

TYPES = {"float": "a number", "int": "a whole number", "bool": "true or false", "string": "a string", "tuple": "a list"}
EITHER = "expected a whole number, or a list of whole numbers"
TYPO = 0.85
"""Similarity from which on another key of the same table is meant rather than the same key of another table."""
LIMITS = {
    "greater_than": ("above", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("below", "lt"),
    "less_than_equal": ("at most", "le"),
    "multiple_of": ("a multiple of", "multiple_of"),
    "string_too_long": ("at most this many letters:", "max_length"),
}


class Problem(NamedTuple):
    """One mistake. rank: orders the messages. keys: the place, and other places that could be changed instead."""

    rank: int
    keys: tuple[Path, ...]
    text: str


class Place(NamedTuple):
    """A path, without pydantic's tags, the table that its last key belongs to, and that key's annotation."""

    path: Path
    table: type[Table]
    annotation: Any


def dotted(path: Path) -> str:
    """Write a path as `--set` and the messages do: `craft[1].motion.from_m`."""
    return "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in path).removeprefix(".")


def parse_path(key: str) -> Path:
    """Parse what `dotted` writes; `craft.1.motion` is understood too. The path is empty if `key` is not a key."""
    if not re.fullmatch(r"[\w-]+(\[[0-9]{1,9}\]|\.[\w-]+)*", key):
        return ()
    return tuple(int(p) if re.fullmatch(r"[0-9]{1,9}", p) else p for p in re.findall(r"[\w-]+", key))


def tables_of(annotation: Any) -> tuple[type[Table], ...]:
    """Return the tables that a field may hold: one, several kinds, or none if it holds a value."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return (annotation,)
    return tuple(table for part in get_args(annotation) for table in tables_of(part))


class Visited(NamedTuple):
    """A table of the schema. keys: the keys that lead to it. single: nothing else can be there, nor several of it."""

    keys: tuple[str, ...]
    table: type[Table]
    single: bool


def every_table(root: type[Table] = Scenario) -> Iterator[Visited]:
    """Yield all tables of a schema, breadth first; one that several keys may hold is yielded for each of them."""
    waiting = deque([Visited((), root, True)])
    while waiting:
        keys, table, single = here = waiting.popleft()
        yield here
        for key, field in table.model_fields.items():
            inner = tables_of(field.annotation)
            alone = single and len(inner) == 1 and _plain(field.annotation) is not tuple
            waiting.extend(Visited((*keys, key), one, alone) for one in inner)


def kind_of(table: type[Table]) -> str:
    """Return the `kind` that a table stands for, empty for a table without kinds, or of several."""
    kind = table.model_fields.get("kind")
    choices = get_args(kind.annotation) if kind else ()
    return str(choices[0]) if len(choices) == 1 else ""


def _choices(annotation: Any) -> tuple[Any, ...]:
    """Return the values that a field with a fixed choice may have, also inside a list."""
    if get_origin(annotation) is Literal:
        return get_args(annotation)
    return tuple(choice for part in get_args(annotation) for choice in _choices(part))


def value_at(data: Any, path: Path) -> Any:
    """Return the value at `path` in the data, None where there is none."""
    for part in path:
        if isinstance(data, str):
            # One word where a list of words may stand.
            return data
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def report(problems: Iterable[Problem], data: Mapping[str, Any], sources: Mapping[Path, str], file: str) -> str:
    """Return one line per mistake, the most specific first.

    Args:
        problems: The mistakes.
        data: The tables with the mistakes.
        sources: The source (`--set`) of every path that `file` did not set.
        file: The name of the file.
    """
    lines = []
    for _, keys, text in sorted(problems, key=lambda p: p.rank):
        changed = {key: _source(key, sources, data) for key in keys}
        path = next((key for key in keys if changed[key]), keys[0])
        value = value_at(data, path)
        shown = "" if value is None or isinstance(value, dict) else f" = {short(toml_value(value))}"
        lines.append(f"{changed[path] or file}: {dotted(path)}{shown}: {text}")
    return "\n".join(dict.fromkeys(lines))


def problems_of(
    error: ValidationError, data: Mapping[str, Any], root: type[Table] = Scenario, kinds_set: Iterable[Path] = ()
) -> list[Problem]:
    """Return every mistake that pydantic found, with its message.

    Args:
        error: The error of pydantic.
        data: The tables with the mistakes.
        root: The class of the whole file.
        kinds_set: Tables whose `kind` alone was changed: all keys that do not fit the new kind are one mistake.
    """
    problems = [p for detail in error.errors(include_url=False) for p in _problems(detail, root)]
    problems = [p for p in problems if not _of_the_other_form(p, problems)]
    for table in kinds_set:
        problems = list(_of_another_kind(problems, table, value_at(data, (*table, "kind"))))
    # A misspelt key is one mistake, not two: the right one is not also "missing".
    meant = {(*p.keys[0][:-1], name) for p in problems if p.rank == 0 for name in re.findall(r"'(\w+)'", p.text)}
    return [p for p in problems if not (p.rank == 1 and p.keys[0] in meant)]


def _of_the_other_form(problem: Problem, problems: list[Problem]) -> bool:
    """Tell whether a value has the wrong type only for a form that was not meant: a number where a list may stand too.

    Then the mistake is within the form that was meant, and is among the problems by itself.
    """
    path = problem.keys[0]
    within = (p for p in problems if p.keys[0][: len(path)] == path and EITHER not in p.text)
    return EITHER in problem.text and any(within)


def _of_another_kind(problems: list[Problem], table: Path, kind: Any) -> Iterator[Problem]:
    """Merge the problems of missing and unknown keys in `table`, whose kind was changed, into one."""
    here = [p for p in problems if p.rank in (0, 1) and p.keys[0][:-1] == table]
    yield from (p for p in problems if p not in here)
    if here:
        missing = [str(p.keys[0][-1]) for p in here if p.rank == 1]
        unknown = [str(p.keys[0][-1]) for p in here if p.rank == 0]
        said = [f"needs {' and '.join(missing)}"] * bool(missing) + [f"has no {' or '.join(unknown)}"] * bool(unknown)
        example = ", ".join([f"kind = {toml_value(kind)}", *(f"{key} = ..." for key in missing)])
        whole = f"--set '{dotted(table)}={{{example}}}'"
        yield Problem(0, ((*table, "kind"),), f"this kind {' and '.join(said)}: set the whole table, {whole}")


def _problems(detail: ErrorDetails, root: type[Table]) -> Iterator[Problem]:
    place = _place(detail["loc"], root)
    path, kind, context = place.path, detail["type"], detail.get("ctx", {})
    key = next((p for p in reversed(path) if isinstance(p, str)), "")
    unit = written_unit(key)
    inside = isinstance(path[-1], int) if path else False
    if kind == "between_keys":
        for text, *keys in context["mistakes"]:
            yield Problem(4, tuple(path + parse_path(k) for k in keys), text)
    elif kind == "extra_forbidden":
        yield Problem(0, (path,), f"unknown key{_meant(str(path[-1]), place.table, root)}")
    elif kind == "missing" and not inside:
        field = place.table.model_fields[key]
        yield Problem(1, (path,), f"missing{f' (in {unit})' if unit else ''}: {field.description}")
    elif kind.startswith("union_tag"):
        kinds = [kind_of(t) for t in tables_of(place.table.model_fields[key].annotation)]
        near = nearest(str(context["tag"]), kinds) if "tag" in context else ""
        must = "must be" if "tag" in context else "missing:"
        yield Problem(2, ((*path, "kind"),), f"{must} one of {', '.join(map(repr, kinds))}{question(near)}")
    elif kind == "literal_error":
        choices = _choices(place.table.model_fields[key].annotation)
        near = nearest(str(detail["input"]), map(str, choices)) if len(choices) > 1 else ""
        yield Problem(2, (path,), f"must be {' or '.join(map(repr, choices))}{question(near)}")
    elif kind in LIMITS:
        word, limit = LIMITS[kind]
        number = f"{context[limit]:g}" if isinstance(context[limit], int | float) else context[limit]
        why = _reason(place, word)
        yield Problem(3, (path,), f"must be {word} {number}{f' {unit}' if unit else ''}{f': {why}' if why else ''}")
    elif not (kind == "too_short" and detail["input"]):  # otherwise its entries are wrong, and have been told
        yield Problem(2, (path[:-1] if kind == "missing" else path,), _expected(detail, place, unit))


def _expected(detail: ErrorDetails, place: Place, unit: str) -> str:
    """Return what is expected instead of a value of the wrong type."""
    value, kind, context = detail["input"], detail["type"], detail.get("ctx", {})
    of_unit = f" in {unit}" if unit else ""
    if kind == "missing" or (kind in ("too_long", "too_short") and context.get("max_length") == 3):
        return f"expected a list of three numbers{of_unit}"
    if kind == "too_short":
        return "must not be empty"
    if kind == "finite_number":
        return f"must be a finite number{of_unit}"
    if kind == "string_pattern_mismatch":
        return "must be letters, digits, '-', '_' and '.' only, and begin with a letter or digit"
    if kind.startswith(("model", "dataclass")):
        return 'expected a table, such as { kind = "hold" }' if place.path[-1] == "motion" else "expected a table"
    if kind == "tuple_type" and tables_of(place.annotation):
        return f"expected a list of tables: begin each with [[{dotted(place.path)}]], or write [{{...}}, {{...}}]"
    if kind == "dict_type":
        return f"expected a table of keys: begin it with [{dotted(place.path)}]"
    whole = place.annotation
    if isinstance(place.path[-1], str) and {int, tuple} <= {_plain(form) for form in get_args(whole)}:
        return f"{EITHER}, not {_type_name(value)}"
    name = TYPES.get(kind.partition("_")[0])
    if name is None:
        return f"{detail['msg'][:1].lower()}{detail['msg'][1:]}"
    hint = ""
    if isinstance(value, str) and (number := re.match(r"\s*[-+]?[\d.]+(e[-+]?\d+)?", value)):
        same_unit = value[number.end() :].strip() in ("", unit)
        hint = f"; write {number[0].strip()}" if same_unit else f"; convert it to {unit}"
    what = _entries(whole, of_unit) if name == "a list" else ""
    return f"expected {name}{what if name == 'a list' else of_unit}, not {_type_name(value)}{hint if of_unit else ''}"


def _reason(place: Place, word: str) -> str:
    """Return why a number must be `word` its limit, empty where the table does not say."""
    field = place.table.model_fields.get(next((p for p in reversed(place.path) if isinstance(p, str)), ""))
    why = next((limits.why for limits in limits_of(field)), None) if field else None
    if why is None:
        return ""
    return why.high if word in ("below", "at most") else why.low


def _plain(annotation: Any) -> Any:
    """Return the class of an annotation: int for a bounded int, tuple for any tuple."""
    if hasattr(annotation, "__metadata__"):
        annotation = get_args(annotation)[0]
    return get_origin(annotation) or annotation


def _entries(annotation: Any, of_unit: str) -> str:
    """Return what the entries of a list are, empty where they may be anything."""
    leaves = set(_leaves(annotation))
    return "" if Any in leaves else " of strings" if str in leaves else f" of numbers{of_unit}"


def _leaves(annotation: Any) -> Iterator[Any]:
    if not (parts := get_args(annotation)):
        yield annotation
    elif get_origin(annotation) is Literal:
        yield type(parts[0])
    else:
        if get_origin(annotation) is dict:
            parts = parts[1:]
        for part in parts[:1] if hasattr(annotation, "__metadata__") else parts:
            yield from _leaves(part)


def _meant(key: str, table: type[Table], root: type[Table]) -> str:
    """Return a question with the right key: the same name with another unit, another table, or a near name."""
    fields = table.model_fields
    stem = split_unit(key)[0]
    same = [k for k in fields if split_unit(k)[0] == stem] or [k for k in fields if k.startswith(f"{stem}_")]
    elsewhere = _owners(key, root)
    if kind_of(table):
        # Another kind of the same thing is meant, not another table, where one has the key.
        elsewhere = [owner for owner in elsewhere if owner.startswith("kind ")] or elsewhere
    typo = get_close_matches(key, fields, n=1, cutoff=TYPO)
    if not same and not typo and elsewhere:
        own = f" of kind {kind_of(table)!r}" if kind_of(table) else " here"
        return f"{own}; it belongs to {' or '.join(elsewhere)}"
    near = same or typo or get_close_matches(key, fields, n=1, cutoff=0.5)
    if not near:
        return did_you_mean(key, fields)
    unit = written_unit(near[0])
    return f"; did you mean {near[0]!r}{f' (in {unit})' if unit else ''}?"


def _owners(key: str, root: type[Table]) -> list[str]:
    """Return the tables that have this key."""
    found = [
        f"kind {kind_of(table)!r}" if kind_of(table) else f"[{keys[-1]}]" if keys else "the top of the file"
        for keys, table, _ in every_table(root)
        if key in table.model_fields
    ]
    return list(dict.fromkeys(found))


def keys_called(word: str) -> tuple[list[str], bool]:
    """Return the keys of single tables whose name, without its unit, is a word, or else has it as a part.

    `duration` means duration_s, `count` swarm.count, `noise` lighthouse.angle_noise_arcsec and others.

    Returns:
        The keys, the ones at the top of the file first, and whether the word is their whole name.
    """
    found: list[tuple[int, int, str]] = []
    for keys, table, single in every_table():
        for key, field in table.model_fields.items() if single else ():
            stem = split_unit(key)[0]
            rank = 0 if word in (key, stem) else 1 if word in stem.split("_") else None
            if rank is not None and not tables_of(field.annotation):
                found.append((rank, len(keys), ".".join((*keys, key))))
    best = min(found, default=(1, 0, ""))[0]
    return [key for rank, _, key in sorted(found, key=lambda one: one[:2]) if rank == best], best == 0


def _place(loc: Path, root: type[Table]) -> Place:
    """Walk down the schema along `loc`, and leave out the tags that pydantic adds for kinds."""
    table: type[Table] = root
    inner: tuple[type[Table], ...] = (root,)
    path: list[str | int] = []
    keyed, annotation = False, None
    for part in loc:
        if len(inner) > 1 and isinstance(part, str):
            inner = tuple(t for t in inner if kind_of(t) == part)
            continue
        if isinstance(part, str) and path and not inner and not keyed:
            # The name that pydantic gives to one of several forms of a value.
            continue
        path.append(part)
        if isinstance(part, str) and inner and not keyed:
            table = inner[0]
            field = table.model_fields.get(part)
            annotation = field.annotation if field else None
            inner = tables_of(annotation)
            keyed = get_origin(annotation) is dict
        else:
            # A key that the user chose, or the number of an entry.
            keyed = False
    return Place(tuple(path), table, annotation)


def _source(path: Path, sources: Mapping[Path, str], data: Any) -> str:
    """Return what has set the value at `path`, or all values of a table there; empty: the file."""
    for key, who in sources.items():
        if path[: len(key)] == key:
            return who
    within = [who for key, who in sources.items() if key[: len(path)] == path]
    return within[0] if within and len(within) == _values(value_at(data, path)) else ""


def _values(value: Any) -> int:
    """Return the number of values in a table and the tables in it."""
    return sum(map(_values, value.values())) if isinstance(value, dict) else 1


def _type_name(value: Any) -> str:
    names = {bool: "true or false", str: "a string", int: "a number", float: "a decimal", dict: "a table"}
    return names.get(type(value), "a list" if isinstance(value, list | tuple) else "a date or time")


def _explain(error: ValidationError, data: Mapping[str, Any], table: type[Table]) -> str:
    return report(problems_of(error, data, table), data, {}, table.__name__)


Table.explain = staticmethod(_explain)
