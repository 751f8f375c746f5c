"""Lines of a recording that is being made, as they come through a pipe, each with the time at which it came.

A thread of its own reads them, so that nothing is held up in the pipe while the program works.
"""

import os
import time
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import NamedTuple

from swarm.errors import SwarmError
from swarm.flight.recordings.event_log import MAGIC
from swarm.flight.recordings.text_lines import TextLines

NAME = "live"
"""Name of a run of lines as they come."""
WHERE = "standard input"
"""Name of the lines in messages."""
WAIT_S = 0.05
"""Longest time that a reader waits for the next line before it looks about [s]."""


class Line(NamedTuple):
    """One line. number: from 1. came_s: time at which it came [s], of `time.monotonic`."""

    number: int
    text: str
    came_s: float


class LiveLines:
    """Lines of an open file, in order. name: of a run of them. ended: no more come."""

    name = NAME

    def __init__(self, descriptor: int = 0) -> None:
        """Name the open file by its descriptor, 0 for the standard input; `take` begins to read."""
        self._descriptor = descriptor
        self._queue: SimpleQueue[Line | SwarmError | None] = SimpleQueue()
        self._stopped = Event()
        self._thread: Thread | None = None
        self._text = TextLines(Path(WHERE), self)
        self._first = True
        self.ended = False

    @property
    def lost(self) -> str:
        """Return why and where the text ends early, empty where it is whole."""
        return self._text.lost

    @property
    def stopped(self) -> bool:
        """Return whether `stop` was called."""
        return self._stopped.is_set()

    def stop(self) -> None:
        """Take no further line: those that have come are the last. A handler of a signal may call this."""
        self._stopped.set()

    def take(self, wait_s: float) -> list[Line]:
        """Return all lines that have come since the last call; wait for the first one, but not longer than asked.

        Raises:
            SwarmError: what comes is of a known kind that is no text.
        """
        if self._thread is None and not self.ended:
            self._thread = Thread(target=self._read, name="lines", daemon=True)
            self._thread.start()
        out: list[Line] = []
        while not self.ended:
            try:
                line = self._queue.get_nowait() if out or self.stopped else self._queue.get(timeout=wait_s)
            except Empty:
                self.ended = self.stopped
                return out
            if isinstance(line, SwarmError):
                self.ended = True
                raise line
            if line is None:
                self.ended = True
            else:
                out.append(line)
        return out

    def _read(self) -> None:
        try:
            for number, text in self._text:
                self._queue.put(Line(number, text, time.monotonic()))
            self._queue.put(None)
        except SwarmError as error:
            self._queue.put(error)

    def read(self, most: int) -> bytes:
        """Return the bytes that are there, `most` at most; wait for the first ones."""
        # Past Python's own buffer: at exit its lock, held by a thread that waits, would be an error.
        block = os.read(self._descriptor, most)
        if self._first and block[:1] == bytes([MAGIC]):
            raise SwarmError(
                f"{WHERE}: a Crazyflie's event log, which is complete only once it has landed: swarm replay FILE"
            )
        self._first = False
        return block
