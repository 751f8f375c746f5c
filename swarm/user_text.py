"""The door for what a user gives as text: paths, files, TOML, JSON and YAML become values here, or a `SwarmError`.

Behind the door nothing is surprising. A text is Unicode without half characters, a path is one that the system takes, a
file is a regular one of bounded size, an integer has 64 bits as TOML says, and tables are at most `DEPTH_MAX` deep, so
that no walk over them overflows the stack.

    data = parse_toml(read_text(user_path(argument)), "my.toml")
"""

import json
import os
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from swarm.errors import SwarmError

DEPTH_MAX = 32
"""Tables and lists inside each other. The deepest key of a scenario is five deep, of a recording's object six."""
BYTES_MAX = 64 * 2**20
"""Size of a file that is read as one text: a calibration of 1000 craft has 2 MB, the journal of a large study 50 MB."""
YAML_MAX = 2**18
"""Characters of a YAML text: a Crazyflie's system configuration of 16 stations has some 15 000."""
INTEGER_MAX = 2**63 - 1
SHOWN_MAX = 60
"""Letters of a value that a message shows."""
TOO_DEEP = f"tables or lists are more than {DEPTH_MAX} deep inside each other"


class NotToml(SwarmError):
    """A text that breaks the rules of TOML, rather than one with a value that no file of this program can have."""


def user_path(text: str | Path, where: str = "") -> Path:
    """Return the path that a user means, with `~` replaced.

    Args:
        text: The path as the user gave it.
        where: Opens the message, such as the key or the option.

    Raises:
        SwarmError: The text is no path that a file can have.
    """
    opened = f"{where}: " if where else ""
    said = short(str(text))
    check_text(str(text), where or "path")
    if not str(text):
        raise SwarmError(f"{opened}an empty path names nothing; '.' is this folder")
    if "\0" in str(text):
        raise SwarmError(f"{opened}{said!r}: a path has no zero byte")
    try:
        path = Path(text).expanduser()
        os.lstat(path)
    except RuntimeError:
        raise SwarmError(f"{opened}{said}: there is no such user, whose home folder '~' would be") from None
    except OSError as error:
        if not isinstance(error, FileNotFoundError | NotADirectoryError | PermissionError):
            # Too long a name, or a circle of links: every further question about the path would fail too.
            raise SwarmError(f"{opened}{said}: {str(error.strerror).lower()}") from None
    return path


def check_text(text: str, where: str) -> None:
    """Raise SwarmError, opened by `where`, if the text has bytes or halves of characters that are not Unicode."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise SwarmError(f"{where}: {short(ascii(text))}: character {error.start + 1} is not UTF-8 text") from None


def read_text(path: Path, where: str, what: str = "a text file") -> str:
    """Return the text of a file, without a byte order mark.

    Args:
        path: The file.
        where: Opens the message: the file as its user would type it.
        what: The kind of file that is expected, for the message.

    Raises:
        SwarmError: The file cannot be read, is too large, or is not UTF-8 text.
    """
    try:
        if path.exists() and not path.is_file():
            raise SwarmError(f"{where}: cannot be read: {'a folder' if path.is_dir() else 'a device'}, not {what}")
        with path.open("rb") as file:
            data = file.read(BYTES_MAX + 1)
        if len(data) > BYTES_MAX:
            raise SwarmError(f"{where}: larger than {BYTES_MAX // 2**20} MB, so not {what}")
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise SwarmError(f"{where}, byte {error.start}: not UTF-8 text, so not {what}") from None
    except OSError as error:
        raise SwarmError(f"{where}: cannot be read: {error.strerror or error}") from None
    except ValueError:
        raise SwarmError(f"{where}: cannot be read: a path has no zero byte") from None


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Return the tables of a TOML text. Raises SwarmError, a syntax error as `NotToml`, opened by `where`."""
    check_text(text, where)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        place = re.search(r" \(at (?:line (\d+), column (\d+)|end of document)\)$", str(error))
        what = str(error)[: place.start()] if place else str(error)
        at = f"line {place[1]}, column {place[2]}" if place and place[1] else "at the end"
        raise NotToml(f"{where}, {at}: not TOML: {what[:1].lower()}{what[1:]}") from None
    except RecursionError:
        raise SwarmError(f"{where}: not TOML: {TOO_DEEP}") from None
    except (ValueError, OverflowError) as error:
        # Python's own: an integer of thousands of digits, a date that no calendar has.
        raise SwarmError(f"{where}: not TOML: {_python_says(error)}") from None
    check_values(data, where)
    return data


def parse_json(text: str, where: str, what: str = "JSON") -> Any:
    """Return the value of a JSON text.

    Args:
        text: The text.
        where: Opens the message.
        what: The kind of file that is expected, for the message about a text of several lines.

    Raises:
        SwarmError: The text is damaged; the message names the place in it.
    """
    check_text(text, where)
    try:
        value = json.loads(text)
    except json.JSONDecodeError as error:
        if "\n" in text.strip():
            raise SwarmError(f"{where}, line {error.lineno}: not {what}, or damaged: {error.msg}") from None
        raise SwarmError(f"{where} is damaged at column {error.colno}: {error.msg}") from None
    except RecursionError:
        raise SwarmError(f"{where} is damaged: {TOO_DEEP}") from None
    except ValueError as error:
        raise SwarmError(f"{where} is damaged: {_python_says(error)}") from None
    check_values(value, where)
    return value


def parse_yaml(text: str, where: str, what: str = "YAML") -> Any:
    """Return the value of a YAML text.

    Args:
        text: The text.
        where: Opens the message.
        what: The kind of file that is expected, for the message.

    Raises:
        SwarmError: The text is damaged, or too large; the message names the line.
    """
    check_text(text, where)
    if len(text) > YAML_MAX:
        raise SwarmError(f"{where}: has more than {YAML_MAX} characters, so it is not {what}")
    # Most commands read no YAML, and PyYAML takes its time to load.
    from swarm.yaml_loader import DamagedYaml, load_yaml

    try:
        value = load_yaml(text)
    except DamagedYaml as error:
        at, problem = (f", line {error.line}", str(error)) if error.line is not None else ("", short(str(error)))
        raise SwarmError(f"{where}{at}: not {what}, or damaged: {problem}") from None
    except RecursionError:
        raise SwarmError(f"{where}: not {what}: {TOO_DEEP}") from None
    except (ValueError, OverflowError, TypeError) as error:
        # A number or a date that Python cannot have, or a table as a key.
        raise SwarmError(f"{where}: not {what}, or damaged: {_python_says(error)}") from None
    check_values(value, where)
    return value


def check_values(data: Any, where: str) -> None:
    """Raise SwarmError, opened by `where` and the key, for a value that no file of this program can have."""
    waiting: list[tuple[str, Any, int]] = [("", data, 0)]
    while waiting:
        key, value, depth = waiting.pop()
        at = f"{where}: {short(key)}" if key else where
        if depth > DEPTH_MAX:
            raise SwarmError(f"{at}: {TOO_DEEP}")
        if isinstance(value, dict):
            for name, inner in value.items():
                check_text(str(name), where)
                waiting.append((f"{key}.{name}".removeprefix("."), inner, depth + 1))
        elif isinstance(value, list):
            waiting += [(f"{key}[{i}]", inner, depth + 1) for i, inner in enumerate(value)]
        elif isinstance(value, str):
            check_text(value, at)
        elif isinstance(value, int) and not -INTEGER_MAX - 1 <= value <= INTEGER_MAX:
            raise SwarmError(f"{at}: an integer must be within 64 bits, {-INTEGER_MAX - 1} to {INTEGER_MAX}")


def dotted_keys(
    table: Mapping[str, Any], is_leaf: Callable[[dict[str, Any]], bool] = lambda inner: not inner, prefix: str = ""
) -> Iterator[tuple[str, Any]]:
    """Yield the values of tables in tables by dotted keys: `swarm.count = [1, 2]` is a table `swarm` to TOML.

    Args:
        table: The tables.
        is_leaf: Tells whether an inner table is a value; an empty one is, by default.
        prefix: Opens the keys.
    """
    for key, value in table.items():
        if isinstance(value, dict) and not is_leaf(value):
            yield from dotted_keys(value, is_leaf, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def short(text: str) -> str:
    """Cut a text to the room that a message has."""
    return text if len(text) <= SHOWN_MAX else f"{text[: SHOWN_MAX - 3]}..."


def _python_says(error: Exception) -> str:
    """Return what a parser says of a value, in words of this program."""
    if "digits" in str(error):
        return f"an integer must be within 64 bits, {-INTEGER_MAX - 1} to {INTEGER_MAX}"
    return short(str(error))
