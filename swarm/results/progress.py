"""Progress of a run: a bar on a terminal, a plain line every few seconds where there is none (a log, a pipe)."""

import time
from types import TracebackType
from typing import NamedTuple

from rich.console import Console
from rich.progress import BarColumn, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.progress import Progress as RichProgress
from rich.table import Column
from rich.text import Text

PLAIN_EVERY_S = 5.0
"""Wall time between two plain lines."""
COMPILES_FOR_S = 30
"""Time that the compiling of a first run takes, roughly, on a core of 2023 that does little else."""
COMPILING = f"compiling the kernels that this kind of run needs, once: about {COMPILES_FOR_S} s the first time"
WIDE = 76
"""Columns from which the bar spells its units out."""


class Progress(NamedTuple):
    """State of a run. time_s of duration_s [s] are simulated; `tracking` of `craft` craft have their pose.

    notice: a message for the user, such as why there is no live view.
    """

    time_s: float
    duration_s: float
    real_time_factor: float
    tracking: int
    craft: int
    notice: str | None = None


class _Figures(ProgressColumn):
    """Simulated time, speed and craft tracking, shorter on a narrow terminal."""

    def __init__(self, wide: bool) -> None:
        super().__init__(Column(no_wrap=True))
        self._wide = wide

    def render(self, task: Task) -> Text:
        p: Progress | None = task.fields["figures"]
        if p is None:
            compiled: int | None = task.fields["compiled"]
            if compiled is None:
                return Text("starting")
            done = f"{compiled} so far"
            return Text(f"compiling kernels, once, ~{COMPILES_FOR_S} s: {done}" if self._wide else f"compiling {done}")
        time_s = f"{p.time_s:.1f}/{p.duration_s:.1f} s"
        tracking = f"{p.tracking}/{p.craft} tracking"
        if not self._wide:
            return Text(f"{time_s} {p.real_time_factor:.1f}x {tracking}")
        return Text(f"{time_s}  {p.real_time_factor:.1f}x real time  {tracking}")


class ProgressDisplay:
    """Display to be called with every `Progress`; as a context manager it draws and cleans up."""

    def __init__(self, console: Console, title: str) -> None:
        """console: where to draw (a terminal's standard error, say). title: what runs."""
        self._console = console
        self._title = title
        self._bar: RichProgress | None = None
        self._last_line = 0.0
        self._latest: Progress | None = None
        self._compiling_since: float | None = None
        self._compiled = 0
        if console.is_terminal and not console.is_dumb_terminal:
            wide = console.width >= WIDE
            columns: list[ProgressColumn] = [TextColumn("{task.description}", markup=False)] if wide else []
            columns += [BarColumn(None), _Figures(wide), *([TimeRemainingColumn(compact=True)] if wide else [])]
            self._bar = RichProgress(*columns, console=console, expand=True, refresh_per_second=5)
            self._task = self._bar.add_task(title, total=None, figures=None, compiled=None)

    def __enter__(self) -> "ProgressDisplay":
        if self._bar:
            self._bar.start()
        else:
            self._line("starting")
        return self

    def compiling(self, done: int) -> None:
        """Say that kernels are being compiled, `done` of them so far."""
        self._compiled = done
        if self._bar:
            self._bar.update(self._task, compiled=done)
        elif self._compiling_since is None:
            self._line(COMPILING)
        elif time.monotonic() - self._last_line >= PLAIN_EVERY_S:
            self._line(f"compiling the kernels: {done} so far")
        if self._compiling_since is None:
            self._compiling_since = time.monotonic()

    def __call__(self, progress: Progress) -> None:
        """Show the progress."""
        self._end_compiling()
        if self._latest is None and progress.notice:
            self._line(progress.notice)
        self._latest = progress
        if self._bar:
            self._bar.update(self._task, completed=progress.time_s, total=progress.duration_s, figures=progress)
        elif time.monotonic() - self._last_line >= PLAIN_EVERY_S:
            self._plain(progress)

    def _end_compiling(self) -> None:
        """Say how long it took, if anything was compiled since this was said last."""
        if self._compiling_since is not None:
            took_s = time.monotonic() - self._compiling_since
            self._line(f"{self._compiled} kernels compiled in {took_s:.0f} s; the next run finds them in the cache")
            self._compiling_since = None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._end_compiling()
        if self._bar:
            if kind is None and self._latest:
                self._bar.update(self._task, completed=self._latest.duration_s)
            self._bar.stop()
        elif self._latest:
            self._plain(self._latest)

    def _plain(self, p: Progress) -> None:
        self._line(
            f"{p.time_s:.1f} of {p.duration_s:.1f} s, {p.real_time_factor:.1f} times real time, "
            f"{p.tracking} of {p.craft} craft tracking"
        )

    def _line(self, text: str) -> None:
        self._last_line = time.monotonic()
        self._console.print(f"{self._title}: {text}", markup=False, highlight=False, soft_wrap=True)
