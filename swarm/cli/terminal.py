"""The ends of a command: done, one message about a mistake, or stopped by a signal and closed properly."""

import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import typer

from swarm.errors import PlaceError, SwarmError
from swarm.user_text import short

if TYPE_CHECKING:
    from swarm.results.progress import Progress
    from swarm.results.run_folder import Run


CLOSING_S = 10.0
"""Time for which a program that was asked to stop is left to close its files; after it, a further signal counts."""

PYTHON = re.compile(r" \((?:force=True|out=\.\.\.)\)")
"""What a message says beside an option to those who call the function."""
Handler = Callable[[int, FrameType | None], object]
"""Handler of a signal."""


class Stopped(KeyboardInterrupt):
    """A signal that asks the program to end, handled like Ctrl-C."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


class _Asked:
    """The first signal that asked this program to end. number: 0 before it; since_s: its time."""

    def __init__(self) -> None:
        self.number, self.since_s = 0, 0.0

    def stop(self, number: int, frame: FrameType | None) -> None:
        """Stop the work at the first signal; while its files are closed, further ones change nothing."""
        if self.number and time.monotonic() - self.since_s < CLOSING_S:
            return
        self.number, self.since_s = number, time.monotonic()
        raise Stopped(number)


_ASKED = _Asked()


def stop_again() -> None:
    """Stop the work if it goes on although it was asked to end: some library has swallowed that."""
    if _ASKED.number:
        raise Stopped(_ASKED.number)


@contextmanager
def stopping_once(outside: Handler = signal.default_int_handler) -> Iterator[None]:
    """Let the first Ctrl-C in the block raise KeyboardInterrupt, and none disturb the closing after it.

    outside: the handler that this one replaces for so long; any other, such as one that ignores Ctrl-C, stays.
    """
    _ASKED.number = 0
    before = signal.getsignal(signal.SIGINT)
    if before is outside:
        signal.signal(signal.SIGINT, _ASKED.stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def ending_once(end: Callable[[], None]) -> Iterator[None]:
    """Let the first Ctrl-C in the block call `end`, the proper end of work that has none; the next one stops it."""
    before = signal.getsignal(signal.SIGINT)

    def first(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, before)
        end()

    if before is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, first)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def fly_and_report(title: str, folder: Path, fly: Callable[[Callable[["Progress"], None]], "Run"]) -> None:
    """Fly a run under a progress bar, then report it; if it is stopped on the way, report what there is.

    Args:
        title: Name of the run.
        folder: Folder that it is written to.
        fly: Function that flies it, and tells its progress.

    Raises:
        typer.Exit: The run was stopped, or a criterion did not hold.
    """
    from rich.console import Console

    from swarm.cli.progress import ProgressDisplay
    from swarm.report.run_table import print_report
    from swarm.results.run_folder import open_run
    from swarm.tables import wide_console

    def report_the_rest(name: str) -> None:
        try:
            run = open_run(folder)
        except SwarmError:
            error_message(f"stopped by {name} before anything was written")
        else:
            print_report(wide_console(), run.summary, run.folder)

    with stoppable(report_the_rest), ProgressDisplay(Console(stderr=True), title) as progress:
        run = fly(progress.run)
    print_report(wide_console(), run.summary, run.folder)
    if run.status != "complete":
        raise typer.Exit(128 + signal.SIGINT)
    if run.summary.get("criteria_held") is False:
        raise typer.Exit(1)


@contextmanager
def stoppable(stopped: Callable[[str], None] = lambda name: None) -> Iterator[None]:
    """Let a polite kill, or a terminal that closes, end a command as Ctrl-C does: closed, and readable.

    Args:
        stopped: Is called after the block with the signal's name.

    Raises:
        typer.Exit: The command was stopped.
    """
    asked = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    # What is ignored stays so: `nohup swarm run` outlives its terminal.
    before = {
        number: signal.signal(number, _ASKED.stop) for number in asked if signal.getsignal(number) != signal.SIG_IGN
    }
    try:
        yield
    except KeyboardInterrupt as stop_asked:
        number = _number(stop_asked)
        stopped(signal.Signals(number).name)
        raise typer.Exit(128 + number) from None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def mistakes(elsewhere: str = "with --out") -> Iterator[None]:
    """Print a mistake in the input as one message, without a traceback; one line tells that a signal has stopped it.

    What a command writes by `swarm.results.disk.outputs` is there whole or not at all.

    elsewhere: how the command is told another place to write to, such as "as NAME"; empty where it has no choice.
    """
    try:
        with stoppable(lambda name: error_message(f"stopped by {name}; no file is left half-written")):
            yield
    except SwarmError as error:
        advice = (f"choose another place {elsewhere}",) if elsewhere else ()
        error_message(error.advised(*advice) if isinstance(error, PlaceError) else str(error))
        raise typer.Exit(2) from None
    except OSError as error:
        if error.filename is None:
            raise
        # A path that the system refuses, or a file that it does not give.
        error_message(f"{short(str(error.filename))}: {str(error.strerror).lower()}")
        raise typer.Exit(2) from None


def _number(stop: KeyboardInterrupt) -> int:
    """Return the number of the signal that stopped the program."""
    return stop.number if isinstance(stop, Stopped) else signal.SIGINT


def error_message(message: str) -> None:
    """Print a message about an error, line by line, to standard error, without what it says in Python's words."""
    from rich.console import Console
    from rich.text import Text

    from swarm.tables import say

    for line in PYTHON.sub("", message).splitlines():
        text = Text.assemble(("error: ", "bold red"), line)
        say(Console(stderr=True), text)
