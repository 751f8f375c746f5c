"""How far a study is: a bar with the time left on a terminal, a plain line every few seconds where there is none."""

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.table import Column
from rich.text import Text

from swarm.results.progress import PLAIN_EVERY_S, WIDE
from swarm.studies.campaign.conduct import StudyProgress


class StudyProgressDisplay:
    """Call it with every `StudyProgress`; as a context manager it draws and cleans up."""

    def __init__(self, console: Console, title: str) -> None:
        """console: where to draw (a terminal's standard error, say). title: what runs."""
        self._console, self._title = console, title
        self._began_s, self._last_line_s = time.monotonic(), -PLAIN_EVERY_S
        self._latest: StudyProgress | None = None
        self._bar: Progress | None = None
        if console.is_terminal and not console.is_dumb_terminal:
            wide = console.width >= WIDE
            columns: list[ProgressColumn] = [TextColumn("{task.description}", markup=False)] if wide else []
            self._bar = Progress(
                *columns, BarColumn(None), _Figures(self), console=console, expand=True, refresh_per_second=2
            )
            self._task = self._bar.add_task(title, total=None)

    def __enter__(self) -> "StudyProgressDisplay":
        if self._bar:
            self._bar.start()
        return self

    def __call__(self, progress: StudyProgress) -> None:
        """Show how far the study is."""
        self._latest = progress
        if self._bar:
            self._bar.update(self._task, completed=progress.done, total=progress.total)
        elif time.monotonic() - self._last_line_s >= PLAIN_EVERY_S:
            self._line()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar:
            self._bar.stop()
        elif self._latest:
            self._line()

    def _line(self) -> None:
        self._last_line_s = time.monotonic()
        self._console.print(f"{self._title}: {self.text()}", markup=False, highlight=False, soft_wrap=True)

    def text(self) -> str:
        """Runs done, runs that failed, the time left."""
        p = self._latest
        if p is None:
            return "starting"
        parts = [f"{p.done}/{p.total} runs"]
        parts += [f"{p.failed} failed"] if p.failed else []
        done = 1 - p.share_left
        if p.share_left > 0:
            elapsed_s = time.monotonic() - self._began_s
            left_s = elapsed_s * p.share_left / done if done > 0 else None
            # A machine's first runs compile, and say nothing of those after them.
            parts.append("the first compile, ~15 s" if left_s is None else f"{_duration(left_s)} left")
        return ", ".join(parts)


class _Figures(ProgressColumn):
    def __init__(self, display: StudyProgressDisplay) -> None:
        super().__init__(Column(no_wrap=True))
        self._display = display

    def render(self, task: Task) -> Text:
        return Text(self._display.text())


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
