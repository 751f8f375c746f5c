"""The shape of what a folder's own JSON says, for a file that somebody may have edited since it was written.

A shape is a `Leaf`, a list of one shape, or a `Keys` with the shapes of a table's keys. `check_shape` names the first
value that has another one, so that nothing behind it meets a text where a number belongs.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Union

from swarm.errors import SwarmError
from swarm.user_text import short


class Leaf(Enum):
    """The kind of a single value, in the words of a message."""

    NUMBER = "a finite number"
    YES = "true or false"
    TEXT = "a text"
    ANY = "anything"


Shape = Union[Leaf, list["Shape"], "Keys"]


@dataclass(frozen=True)
class Keys:
    """The keys of a table.

    always: keys that are there and are never null. known: keys that are there, perhaps null. perhaps: keys that may be
    missing or null. rest: the shape of all other keys.
    """

    always: Mapping[str, Shape] = field(default_factory=dict)
    known: Mapping[str, Shape] = field(default_factory=dict)
    perhaps: Mapping[str, Shape] = field(default_factory=dict)
    rest: Shape = Leaf.ANY


def check_shape(value: Any, shape: Shape, where: str, key: str = "") -> None:
    """Check a value of a JSON file; null is good wherever `Keys.always` does not say otherwise.

    Args:
        value: The value.
        shape: What it should be.
        where: Opens the message: the file.
        key: The value's dotted key in it, empty for the whole file.

    Raises:
        SwarmError: It is of another kind; the message names file, key, value and what belongs there.
    """
    if value is None or shape is Leaf.ANY:
        return
    if isinstance(shape, list):
        if not isinstance(value, list):
            raise _wrong(where, key, value, "a list")
        for i, entry in enumerate(value):
            check_shape(entry, shape[0], where, f"{key}[{i}]")
    elif isinstance(shape, Keys):
        if not isinstance(value, dict):
            raise _wrong(where, key, value, "a table")
        for name in (*shape.always, *shape.known):
            if name not in value or (name in shape.always and value[name] is None):
                raise SwarmError(f"{where}: {_dotted(key, name)} is missing: the file was changed, or is damaged")
        shapes = {**shape.always, **shape.known, **shape.perhaps}
        for name, inner in value.items():
            check_shape(inner, shapes.get(name, shape.rest), where, _dotted(key, name))
    elif not _is(value, shape):
        raise _wrong(where, key, value, shape.value)


def _is(value: Any, kind: Leaf) -> bool:
    if kind is Leaf.NUMBER:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return isinstance(value, bool if kind is Leaf.YES else str)


def _dotted(key: str, name: str) -> str:
    return f"{key}.{name}".removeprefix(".")


def _wrong(where: str, key: str, value: Any, expected: str) -> SwarmError:
    return SwarmError(f"{where}: {key or 'the file'} = {short(repr(value))}: must be {expected}")
