"""The progress of a run, a study or an experiment: one line that changes on a terminal, elsewhere a line now and then.

Compiling is told when it begins, in the same line while it lasts, and once more when all is done, with the time that it
took. Nobody knows beforehand which kernels a run needs: what is done is counted. Times left and speeds leave it out.
"""

import math
import time
from contextlib import ExitStack
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.progress import BarColumn, ProgressColumn, Task, TextColumn
from rich.progress import Progress as Bar
from rich.table import Column
from rich.text import Text

from swarm.cli.terminal import stop_again
from swarm.results.progress import Progress
from swarm.studies.campaign.conduct import StudyProgress
from swarm.tables import counted

if TYPE_CHECKING:
    from estimators.kernel import Compilation

COMPILING = (
    "compiling kernels that the cache does not hold, once: up to a minute of a processor, longer on a busy machine"
)
PLAIN_EVERY_S = 10.0
"""Least wall time between two plain lines; the first one and the last one count for themselves."""
WIDE = 76
"""Columns of a terminal from which the bar spells everything out."""


class ProgressDisplay:
    """The display of one piece of work, as a context manager; `run`, `study` and `experiment` show how far it is.

    Within the block it also tells the compiling of kernels.
    """

    def __init__(self, console: Console, title: str) -> None:
        """Prepare the display of the work `title` on `console`, such as a terminal's standard error."""
        self._console, self._title = console, title
        self._words, self._plain = "", ""
        self._share = 0.0
        self._first: tuple[float, float] | None = None
        self._began: tuple[float, float] | None = None
        self._last_line, self._last_line_s = "", 0.0
        self._compilation: Compilation | None = None
        self._compiling_since_s: float | None = None
        self._compiling_s = 0.0
        self._stack = ExitStack()
        self.wide = console.width >= WIDE
        self._bar: Bar | None = None
        if console.is_terminal and not console.is_dumb_terminal:
            title_column = (TextColumn("{task.description}", markup=False),) if self.wide else ()
            columns = (*title_column, BarColumn(None), _Words(self))
            self._bar = Bar(*columns, console=console, expand=True, refresh_per_second=5)
            self._task = self._bar.add_task(title, total=None)

    def __enter__(self) -> Self:
        from estimators.kernel import told_of_compilation

        self._stack.enter_context(told_of_compilation(self.compiling))
        if self._bar:
            self._bar.start()
        else:
            self._line("starting")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()
        if self._bar:
            self._bar.stop()
        elif self._plain and (last := self._plain + self._left()) != self._last_line:
            self._line(last)
        if self._compilation is not None and kind is None:
            kernels = counted(self._compilation.done, "kernel")
            self._line(f"{kernels} compiled in {self._compiling_s:.0f} s; {_next_time()}")

    def run(self, progress: Progress) -> None:
        """Show how far a run is. Raises Stopped where a library has swallowed the signal that asked it to end."""
        stop_again()
        p = progress
        if self._began is None:
            self._began = self._flying_s(), p.time_s
            if p.notice:
                self._line(p.notice)
        gap = "  " if self.wide else " "
        tracking, plain = f"{p.tracking}/{p.craft} tracking", f"{p.tracking} of {p.craft} craft tracking"
        if math.isinf(p.duration_s):
            self._show(0.0, f"{p.time_s:.1f} s{gap}{tracking}", f"{p.time_s:.1f} s, {plain}")
            return
        flying_s, flown_s = self._flying_s() - self._began[0], p.time_s - self._began[1]
        words = speed = ""
        if flying_s > 0 and flown_s > 0:
            factor = flown_s / flying_s
            words = f"{gap}{factor:.1f}x" + (" real time" if self.wide else "")
            speed = f", {factor:.1f} times real time"
        self._show(
            p.time_s / p.duration_s,
            f"{p.time_s:.1f}/{p.duration_s:.1f} s{words}{gap}{tracking}",
            f"{p.time_s:.1f} of {p.duration_s:.1f} s{speed}, {plain}",
        )

    def study(self, progress: StudyProgress) -> None:
        """Show how far a study is."""
        words = f"{progress.done}/{counted(progress.total, 'run')}"
        words += f", {progress.failed} failed" if progress.failed else ""
        if progress.share_left == 1:
            # The workers are other processes, and say nothing of their compiling.
            words += ", the first ones may compile"
        self._show(1 - progress.share_left, words, words)

    def experiment(self, share: float, what: str) -> None:
        """Show how far an experiment is: the share that is done, and what is being done. Raises Stopped as `run`."""
        stop_again()
        self._show(share, what, what)

    def compiling(self, compilation: "Compilation") -> None:
        """Tell how far the compiling of kernels is."""
        if self._compilation is None:
            self._line(COMPILING)
        self._compilation, now_s = compilation, time.monotonic()
        if compilation.busy and self._compiling_since_s is None:
            self._compiling_since_s = now_s
        elif not compilation.busy and self._compiling_since_s is not None:
            self._compiling_s += now_s - self._compiling_since_s
            self._compiling_since_s = None
        if not self._bar and now_s - self._last_line_s >= PLAIN_EVERY_S:
            self._line(self._compiling_words())

    def text(self) -> str:
        """Return the words beside the bar."""
        # Between two kernels of the beginning nothing else is done.
        if self._compiling_since_s is not None or (self._compilation is not None and not self._words):
            return self._compiling_words()
        return self._words + self._left() if self._words else "starting"

    def _compiling_words(self) -> str:
        done = 0 if self._compilation is None else self._compilation.done
        since_s = self._compiling_since_s
        took_s = self._compiling_s + (0.0 if since_s is None else time.monotonic() - since_s)
        return f"compiling: {counted(done, 'kernel')} done, {took_s:.0f} s"

    def _show(self, share: float, words: str, plain: str) -> None:
        self._share, self._words, self._plain = share, words, plain
        if self._first is None:
            self._first = self._flying_s(), share
        if self._bar:
            self._bar.update(self._task, completed=share, total=1.0)
        elif time.monotonic() - self._last_line_s >= PLAIN_EVERY_S:
            self._line(plain + self._left())

    def _flying_s(self) -> float:
        """Return a time that stands still while kernels are compiled, which the rest of the run does not do again."""
        now_s = time.monotonic()
        since_s = self._compiling_since_s
        return now_s - self._compiling_s - (0.0 if since_s is None else now_s - since_s)

    def _left(self) -> str:
        """Return the time left, in words; nothing where it is not known, or where nothing is left."""
        if self._first is None:
            return ""
        since_s, share = self._first
        if not share < self._share < 1:
            return ""
        left_s = round((self._flying_s() - since_s) * (1 - self._share) / (self._share - share))
        if not left_s:
            return ""
        minutes, seconds = divmod(left_s, 60)
        hours, minutes = divmod(minutes, 60)
        if hours:
            return f", {hours} h {minutes:02d} min left"
        return f", {minutes} min {seconds:02d} s left" if minutes else f", {seconds} s left"

    def _line(self, text: str) -> None:
        self._last_line, self._last_line_s = text, time.monotonic()
        self._console.print(f"{self._title}: {text}", markup=False, highlight=False, soft_wrap=True)


def _next_time() -> str:
    from estimators.kernel_cache import folder, kept

    if kept():
        return "the next run finds them in the cache"
    return (
        f"the next run compiles them again: {folder()} cannot be written, NUMBA_CACHE_DIR=FOLDER chooses another place"
    )


class _Words(ProgressColumn):
    def __init__(self, display: ProgressDisplay) -> None:
        super().__init__(Column(no_wrap=True))
        self._display = display

    def render(self, task: Task) -> Text:
        return Text(self._display.text())
