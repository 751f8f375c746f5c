"""The family of user errors: each is one message that gives the place, the value and the limit."""

from collections.abc import Iterable
from difflib import get_close_matches


class SwarmError(Exception):
    """A mistake in the input. The command line prints its message, without a traceback, and exits with 2."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return `"; did you mean 'formation'?"`, or the known names where none is near, or an empty string."""
    names = sorted(known)
    near = get_close_matches(name, names, n=1, cutoff=0.5)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f"; known: {', '.join(names)}" if names else ""


def surely_meant(name: str, known: Iterable[str]) -> str:
    """Return `"; did you mean 'mine.toml'?"` where one of the known names differs by a slip, or an empty string."""
    near = get_close_matches(name, sorted(known), n=1, cutoff=0.8)
    return f"; did you mean {near[0]!r}?" if near else ""
