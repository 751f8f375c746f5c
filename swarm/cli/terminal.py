"""The ends of a command: done, one message about a mistake, or stopped by a signal and closed properly."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import typer

from swarm.errors import SwarmError

if TYPE_CHECKING:
    from swarm.results.progress import Progress
    from swarm.results.run_folder import Run


class Stopped(KeyboardInterrupt):
    """A signal that asks the program to end, handled like Ctrl-C."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


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

    def report_the_rest(name: str) -> None:
        try:
            run = open_run(folder)
        except SwarmError:
            error_message(f"stopped by {name} before anything was written")
        else:
            print_report(Console(), run.summary, run.folder)

    with stoppable(report_the_rest), ProgressDisplay(Console(stderr=True), title) as progress:
        run = fly(progress.run)
    print_report(Console(), run.summary, run.folder)
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

    def stop(number: int, frame: FrameType | None) -> None:
        # A second signal of the kind ends the program at once.
        signal.signal(number, signal.SIG_DFL)
        raise Stopped(number)

    asked = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    # What is ignored stays so: `nohup swarm run` outlives its terminal.
    before = {number: signal.signal(number, stop) for number in asked if signal.getsignal(number) != signal.SIG_IGN}
    try:
        yield
    except KeyboardInterrupt as stop_asked:
        number = stop_asked.number if isinstance(stop_asked, Stopped) else signal.SIGINT
        stopped(signal.Signals(number).name)
        raise typer.Exit(128 + number) from None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def mistakes() -> Iterator[None]:
    """Print a mistake in the input as one message, without a traceback."""
    try:
        yield
    except SwarmError as error:
        error_message(str(error))
        raise typer.Exit(2) from None
    except KeyboardInterrupt:
        raise typer.Exit(128 + signal.SIGINT) from None


def error_message(message: str) -> None:
    """Print a message about an error, line by line, to standard error."""
    from rich.console import Console
    from rich.text import Text

    for line in message.splitlines():
        text = Text.assemble(("error: ", "bold red"), line)
        Console(stderr=True, highlight=False).print(text, soft_wrap=True)
