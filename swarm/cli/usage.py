"""Messages about a command line that cannot be understood, in the words and the form of all other messages.

typer and click find these mistakes; what they say (`Invalid value for '--seed': Input should be a valid integer`) is
not what a user sees.
"""

import re
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any

from swarm.errors import did_you_mean, question
from swarm.user_text import short

TAKE_KEYS = ("run", "check", "study")
"""Commands whose `--set` takes every key of a scenario."""
MOST_KEYS = 3
"""Scenario keys that a message proposes at most."""


def is_usage(error: BaseException) -> bool:
    """Tell whether an error is typer's or click's about the command line; their classes moved between versions."""
    return hasattr(error, "format_message") and hasattr(error, "exit_code")


def usage_message(error: Any, arguments: Sequence[str]) -> str:
    """Return the message about a mistake on the command line.

    Args:
        error: The error of typer or click.
        arguments: The command line, without the program's name.
    """
    context = getattr(error, "ctx", None)
    command = "swarm" if context is None else context.command_path
    kind = type(error).__name__
    if kind == "NoSuchOption":
        return f"{command}: no option {error.option_name}{_option_meant(error.option_name, context, arguments)}"
    if kind == "MissingParameter":
        return f"{command}: {_name(error.param)} is missing: {_help(error.param)} ({command} -h)"
    if kind == "BadOptionUsage":
        return f"{error.option_name}: a value is missing"
    if kind == "BadParameter" and error.param is not None:
        return f"{_name(error.param)}: {_wrong_value(error, arguments)}"
    text = str(error.format_message())
    if found := re.match(r"No such command '(.*?)'", text):
        commands = [] if context is None else context.command.list_commands(context)
        return f"no command {found[1]!r}{did_you_mean(found[1], commands)}"
    if found := re.match(r"Got unexpected extra arguments?(?:\(s\))? \((.*)\)", text):
        return f"{command}: unexpected {short(found[1])!r} after the last argument ({command} -h)"
    return _within(text)


def _within(sentence: str) -> str:
    """Return a sentence as the part of a message: without its capital and its stop."""
    return f"{sentence[:1].lower()}{sentence[1:]}".rstrip(".")


def _name(parameter: Any) -> str:
    options = [name for name in parameter.opts if name.startswith("--")]
    return str(options[0] if options else parameter.metavar or parameter.name.upper())


def _help(parameter: Any) -> str:
    return _within(str(getattr(parameter, "help", "") or ""))


def _wrong_value(error: Any, arguments: Sequence[str]) -> str:
    """Return what is wrong with the value of an option or an argument."""
    text = str(error.message)
    given = _values(error.param.opts, arguments)
    said = _refused(error, given) or next(reversed(given), None)
    value = "" if said is None else f"{short(said)!r}"
    if found := re.search(r"is not one of (.*?)\.?$", text):
        choices = re.findall(r"'([^']*)'", found[1])
        return f"{value} must be one of {', '.join(map(repr, choices))}".strip() + _near(said, choices)
    if "valid integer" in text:
        return f"{value} is not a whole number"
    if re.search(r"valid (number|float)", text):
        return f"{value} is not a number"
    if found := re.search(r"greater than or equal to (\S+)|x>=(\S+?)\.?$", text):
        return f"{value} must be at least {found[1] or found[2]}"
    return f"{value} {_within(text)}".strip()


def _near(said: str | None, choices: Sequence[str]) -> str:
    return question(next(iter(get_close_matches(said or "", choices, n=1, cutoff=0.6)), ""))


def _values(names: Sequence[str], arguments: Sequence[str]) -> list[str]:
    """Return the values that the command line gives to an option, which may be repeated."""
    found: list[str] = []
    for i, word in enumerate(arguments):
        option, equals, value = word.partition("=")
        if option in names:
            found += [value] if equals else arguments[i + 1 : i + 2]
    return found


def _refused(error: Any, given: Sequence[str]) -> str | None:
    """Return the one of several values that the error is about; pydantic, whose error is the cause, knows it."""
    details: list[Any] = getattr(error.__cause__, "errors", list)()
    return next((value for value in given for detail in details if str(detail.get("input")) == value), None)


def _option_meant(option: str, context: Any, arguments: Sequence[str]) -> str:
    """Return the option that is meant, or the key of a scenario that `--set` would change."""
    options = [] if context is None else [name for p in context.command.params for name in p.opts if name[:2] == "--"]
    keys: list[str] = []
    exact = False
    if context is not None and context.info_name in TAKE_KEYS:
        from swarm.scenario.mistakes import keys_called

        keys, exact = keys_called(option.lstrip("-").replace("-", "_"))
    near = get_close_matches(option, options, n=1, cutoff=0.75)
    if near and not exact:
        return f"; did you mean {near[0]}?"
    if keys:
        value = next(iter(_values([option], arguments)), "-")
        value = "VALUE" if value.startswith("-") else value
        return "; did you mean " + " or ".join(f"--set {key}={value}" for key in keys[:MOST_KEYS]) + "?"
    return f"; {context.command_path} -h lists those there are" if context is not None else ""
