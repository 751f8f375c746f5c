"""How a command ends: with a report, with one message about a mistake, or stopped by a signal and closed properly."""

import signal
from collections.abc import Callable, Iterator, Mapping
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
    """Run it under a progress bar, then report; stopped on the way, report what there is."""
    from rich.console import Console

    from estimators.kernel import told_of_compilation
    from swarm.report.run_table import print_report
    from swarm.results.progress import ProgressDisplay
    from swarm.results.run_folder import open_run

    try:
        with (
            stoppable(),
            ProgressDisplay(Console(stderr=True), title) as progress,
            told_of_compilation(progress.compiling),
        ):
            run = fly(progress)
    except KeyboardInterrupt as stop:
        number = stopped_by(stop)
        try:
            run = open_run(folder)
        except SwarmError:
            _error(f"stopped by {signal.Signals(number).name} before anything was written")
        else:
            print_report(Console(), run.summary, run.folder)
        raise typer.Exit(128 + number) from None
    print_report(Console(), run.summary, run.folder)
    if run.status != "complete":
        raise typer.Exit(128 + signal.SIGINT)
    if run.summary.get("criteria_held") is False:
        raise typer.Exit(1)


def experiment_and_report(
    name: str, *, out: Path | None, force: bool, seed: int | None, sizes: Mapping[str, int]
) -> None:
    """Do an experiment under a progress bar, then print its table; stopped on the way, it leaves nothing."""
    from rich.console import Console
    from rich.progress import Progress as Bar

    from estimators.kernel import told_of_compilation
    from swarm.results.progress import COMPILING
    from swarm.studies.papers import find, reproduce
    from swarm.studies.papers.results import print_comparison

    find(name)
    try:
        with stoppable(), Bar(console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(name, total=1.0)

            told: list[int] = []

            def compiling(done: int) -> None:
                if not told:
                    bar.console.print(f"{name}: {COMPILING}", markup=False, highlight=False)
                told.append(done)

            def tell(share: float, what: str) -> None:
                bar.update(task, completed=share, description=f"{name}: {what}")

            with told_of_compilation(compiling):
                done = reproduce(name, out=out, force=force, seed=seed, sizes=sizes, progress=tell)
            tell(1.0, "done")
    except KeyboardInterrupt as stop:
        number = stopped_by(stop)
        _error(f"stopped by {signal.Signals(number).name} before anything was written")
        raise typer.Exit(128 + number) from None
    print_comparison(Console(), done)


def stopped_by(stop: KeyboardInterrupt) -> int:
    """The signal that stopped it."""
    return stop.number if isinstance(stop, Stopped) else signal.SIGINT


@contextmanager
def stoppable() -> Iterator[None]:
    """Let a polite kill, or a terminal that closes, end a run as Ctrl-C does: closed, and readable."""

    def stop(number: int, frame: FrameType | None) -> None:
        # A second signal of the kind ends the program at once.
        signal.signal(number, signal.SIG_DFL)
        raise Stopped(number)

    asked = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    # What is ignored stays so: `nohup swarm run` outlives its terminal.
    before = {number: signal.signal(number, stop) for number in asked if signal.getsignal(number) != signal.SIG_IGN}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def mistakes() -> Iterator[None]:
    """Print a mistake in the input as one message, without a traceback."""
    try:
        yield
    except SwarmError as error:
        _error(str(error))
        raise typer.Exit(2) from None
    except KeyboardInterrupt:
        raise typer.Exit(128 + signal.SIGINT) from None


def _error(message: str) -> None:
    from rich.console import Console
    from rich.text import Text

    for line in message.splitlines():
        text = Text.assemble(("error: ", "bold red"), line)
        Console(stderr=True, highlight=False).print(text, soft_wrap=True)
