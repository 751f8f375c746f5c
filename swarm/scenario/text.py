"""Write a scenario as TOML text with every default, which loads again to an equal scenario."""

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from swarm.scenario.schema import Scenario


def toml_value(value: Any) -> str:
    """Write a value as TOML does, tables inline."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON's escapes are TOML's, but for DEL.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{k} = {toml_value(v)}" for k, v in value.items()) + " }" if value else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml_value(v) for v in value)}]"
    return str(value)


def to_toml(scenario: Scenario, comments: Iterable[str] = ()) -> str:
    """Write the scenario with every default; keys that are unset become comments.

    comments: lines for the head of the file, such as versions. `load` of the text gives an equal scenario.
    """
    lines = [f"# {line}" for line in comments]
    return "\n".join([*lines, *_table("", scenario)]).lstrip("\n") + "\n"


def changed(usual: BaseModel, table: BaseModel, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted keys whose values are not the usual ones, and their values; keys that were unset are left out.

    Args:
        usual: The usual values.
        table: A table of the same kind.
        name: Dotted key of the table, empty for a whole scenario.
    """
    for key in type(table).model_fields:
        before, value, dotted = getattr(usual, key), getattr(table, key), f"{name}.{key}".removeprefix(".")
        if isinstance(value, BaseModel) and type(value) is type(before):
            yield from changed(before, value, dotted)
        elif value != before and value is not None:
            yield dotted, value


def _table(name: str, table: BaseModel) -> Iterator[str]:
    keys = sorted(type(table).model_fields, key=lambda key: key not in ("name", "count"))
    values = {key: getattr(table, key) for key in keys}
    tables = {key: v for key, v in values.items() if isinstance(v, BaseModel)}
    lists = {key: v for key, v in values.items() if isinstance(v, tuple) and v and isinstance(v[0], BaseModel)}
    for key, value in values.items():
        if value is None:
            yield f"# {key}: {_unset(table, key)}"
        elif key not in tables and key not in lists and not (key == "craft" and value == ()):
            yield f"{key} = {toml_value(value)}"
    for key, value in tables.items():
        inner = f"{name}.{key}".removeprefix(".")
        yield from ("", f"[{inner}]", *_table(inner, value))
    for key, entries in lists.items():
        inner = f"{name}.{key}".removeprefix(".")
        for entry in entries:
            yield from ("", f"[[{inner}]]", *_table(inner, entry))


def _unset(table: BaseModel, key: str) -> str:
    description = type(table).model_fields[key].description or ""
    return description[description.index("Unset: ") + len("Unset: ") :] if "Unset: " in description else "unset"
