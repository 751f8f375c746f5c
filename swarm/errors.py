"""The family of user errors: each is one message that gives the place, the value and the limit."""

import re
from collections.abc import Iterable
from difflib import get_close_matches


class SwarmError(Exception):
    """A mistake in the input. The command line prints its message, without a traceback, and exits with 2."""


class PlaceError(SwarmError):
    """A place that cannot be written to; a command says with which option another one is chosen, if it has one.

    fault: what is wrong. ways: what helps besides another place.
    """

    def __init__(self, fault: str, *ways: str) -> None:
        """Take what is wrong, and what helps besides another place."""
        self.fault, self.ways = fault, ways
        super().__init__(self.advised("choose another place"))

    def advised(self, *elsewhere: str) -> str:
        """Return the message; elsewhere: how another place is chosen, nothing where there is no choice."""
        ways = ", or ".join((*self.ways, *elsewhere))
        return f"{self.fault}; {ways}" if ways else self.fault


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the known name that is meant, or an empty string.

    It is a similar one, or the only one that has `name` as a word: 'lighthouse-dark' for 'dark'.
    """
    names = sorted(set(known))
    near = get_close_matches(name, names, n=1, cutoff=0.5)
    holding = [one for one in names if name and name.lower() in re.split(r"[-_ ]", one)]
    return near[0] if near else holding[0] if len(holding) == 1 else ""


def question(near: str) -> str:
    """Return `"; did you mean 'formation'?"` for the nearest known name, or an empty string for none."""
    return f"; did you mean {near!r}?" if near else ""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return `"; did you mean 'formation'?"`, or the known names where none is near, or an empty string."""
    names = sorted(set(known))
    if near := nearest(name, names):
        return question(near)
    return f"; known: {', '.join(names)}" if names else ""


def surely_meant(name: str, known: Iterable[str]) -> str:
    """Return `"; did you mean 'mine.toml'?"` where one of the known names differs by a slip, or an empty string."""
    return question(next(iter(get_close_matches(name, sorted(known), n=1, cutoff=0.8)), ""))
