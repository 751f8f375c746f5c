"""The scenario reference (docs/scenario.md) and the JSON schema for editors, both generated from the models.

`python -m swarm.scenario docs` writes both files; a test asserts that they are up to date.
"""

import inspect
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

from annotated_types import Ge, Gt, Le, Lt, MultipleOf
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from swarm.scenario.limits import limits_of
from swarm.scenario.mistakes import every_table, kind_of, tables_of
from swarm.scenario.motions import Attitude
from swarm.scenario.schema import Scenario
from swarm.scenario.table import Box, Table, Vector
from swarm.scenario.text import toml_value
from swarm.units import written_unit

HEAD = """# The scenario file

A scenario is a TOML file; `swarm list` names those that are shipped, `swarm check FILE` validates one and prints it
with every default. All keys are optional unless the default says *required*; an unknown key is an error.
A key carries its unit as a suffix. Positions are metres in the lighthouse frame: x right, y down, z forward, away
from the lighthouse, which sits at the origin. Every key can be changed for one run, as in
`--set lighthouse.angle_noise_arcsec=20 --set craft[0].motion.speed_m_s=0.1`.

The shortest useful one:

```toml
duration_s = 10.0

[swarm]
count = 4
motion = { kind = "ring", radius_m = 1.0, rate_deg_s = 5.0 }
```

Editors complete and check a scenario with `scenario.schema.json`, from which this page comes too: with Taplo
("Even Better TOML"), begin the file with `#:schema PATH/scenario.schema.json`.
"""

VECTOR = get_args(Vector)[0]


def json_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a scenario file."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Scenario.model_json_schema()}


def markdown_reference() -> str:
    """Return the page of every table and key: unit or type, default, limits, meaning."""
    return "\n".join([HEAD, *_sections()]).rstrip() + "\n"


def _sections() -> Iterator[str]:
    yield from _section("Top of the file", "", Scenario)
    for key, field in Scenario.model_fields.items():
        for table in tables_of(field.annotation) if key != "fault" else ():
            several = key in ("craft", "criteria", "pair", "station")
            yield from _section(f"`[[{key}]]`" if several else f"`[{key}]`", key, table)
            for inner, below in table.model_fields.items():
                for part in (
                    tables_of(below.annotation)
                    if key in ("lighthouse", "navigation", "craft", "station") and inner != "motion"
                    else ()
                ):
                    yield from _section(f"`[{key}.{inner}]`", key, part)
                    for name, least in part.model_fields.items():
                        for entry in tables_of(least.annotation):
                            yield from _section(f"`[[{key}.{inner}.{name}]]`", key, entry)
    yield "## `[[fault]]`\n\nA fault and its time ([details](faults.md)); `kind` selects one of the tables below.\n"
    for table in tables_of(Scenario.model_fields["fault"].annotation):
        yield from _section(f'`kind = "{kind_of(table)}"`', "fault", table, level="###")
    motions = tables_of(Scenario.model_fields["craft"].annotation)[0].model_fields["motion"]
    yield "## `motion`\n\nA table of `[swarm]` and of every `[[craft]]`; `kind` selects one of the tables below.\n"
    for table in tables_of(motions.annotation):
        yield from _section(f'`kind = "{kind_of(table)}"`', "motion", table, level="###")
        for key, field in table.model_fields.items():
            for entry in tables_of(field.annotation) if key != "attitude" else ():
                yield from _section(f"`[[motion.{key}]]`", "motion", entry, level="####")
    yield from _section("`attitude`", "motion", Attitude, level="###")
    yield from _reasons()


def every_number() -> Iterator[tuple[type[Table], str, FieldInfo]]:
    """Yield every field of the schema that holds numbers, with its table and its key, each table once."""
    for table in dict.fromkeys(visited.table for visited in every_table()):
        for key, field in table.model_fields.items():
            if next(limits_of(field), None) is not None:
                yield table, key, field


def _reasons() -> Iterator[str]:
    """Yield the section of the reasons, each with the keys that it is about."""
    low: dict[str, list[str]] = {}
    high: dict[str, list[str]] = {}
    for _, key, field in every_number():
        why = next(limits_of(field)).why
        if why is not None:
            for reasons, reason in ((low, why.low), (high, why.high)):
                reasons.setdefault(reason, []).append(f"`{key}`")
    yield "## Reasons for the limits\n\nThe message about a number outside its limits gives the reason too.\n"
    yield "| limit | reason | keys |\n|---|---|---|"
    for side, reasons in (("lower", low), ("upper", high)):
        for reason, keys in reasons.items():
            yield f"| {side} | {reason} | {', '.join(dict.fromkeys(keys))} |"
    yield ""


def _section(title: str, name: str, table: type[Table], level: str = "##") -> Iterator[str]:
    yield f"{level} {title}\n\n{inspect.cleandoc(table.__doc__ or '')}\n"
    yield "| key | unit or type | default | limits | meaning |\n|---|---|---|---|---|"
    for key, field in table.model_fields.items():
        if not (key == "kind" and kind_of(table)) and not (name == "" and tables_of(field.annotation)):
            yield f"| `{key}` | {_type(key, field)} | {_default(field)} | {_limits(field)} | {field.description} |"
    yield ""


def _type(key: str, field: FieldInfo) -> str:
    unit = written_unit(key)
    kinds = tables_of(field.annotation)
    text = str(field.annotation)
    if kinds:
        return "table, see [motion](#motion)" if len(kinds) > 1 else "list of tables" if "tuple" in text else "table"
    if "Literal" in text:
        return " or ".join(f"`{toml_value(choice)}`" for choice in get_args(field.annotation))
    if field.annotation == VECTOR or {Vector, Box} & set(get_args(field.annotation)):
        return f"list of x, y, z, {unit}"
    if "tuple" in text:
        entries = unit or ("whole numbers" if "[int," in text else "strings")
        return f"list of {f'lists of x, y, z, {unit}' if text.count('tuple') > 1 else entries}"
    for name, word in (("bool", "true or false"), ("str", "string"), ("int", "whole number")):
        if name in text:
            return word
    return unit or "number"


def _default(field: FieldInfo) -> str:
    if field.default is PydanticUndefined:
        return "*required*"
    if field.default is None:
        return "unset"
    kind = getattr(field.default, "kind", None)
    return f'kind `"{kind}"`' if kind else "" if isinstance(field.default, Table) else f"`{toml_value(field.default)}`"


def _limits(field: FieldInfo) -> str:
    words = []
    for limit in field.metadata:
        for kind, word, name in (
            (Ge, "≥", "ge"),
            (Gt, ">", "gt"),
            (Le, "≤", "le"),
            (Lt, "<", "lt"),
            (MultipleOf, "multiple of", "multiple_of"),
        ):
            if isinstance(limit, kind):
                words.append(f"{word} {getattr(limit, name):g}")
    return ", ".join(words)


def write(folder: Path) -> None:
    """Write scenario.md and scenario.schema.json into `folder`."""
    (folder / "scenario.md").write_text(markdown_reference(), encoding="utf-8")
    (folder / "scenario.schema.json").write_text(json.dumps(json_schema(), indent=2) + "\n", encoding="utf-8")
