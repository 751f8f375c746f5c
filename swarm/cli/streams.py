"""Standard output and standard error that may be closed, full, or left by their reader.

What is said aside (progress, mistakes) never stops the work: standard error forgets what it cannot print. Standard
output is the product of some commands, so a failure there is an ending of its own: a reader that has gone ends the
program as SIGPIPE would, anything else is one message.
"""

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO, cast

PIPE_GONE = 128 + 13
"""Exit code of a program whose reader has gone: 128 + SIGPIPE, the signal that Python ignores."""


class Aside:
    """A text stream that forgets what it cannot write."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write the text, if that is possible."""
        with suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush what was written, if that is possible."""
        with suppress(OSError):
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def open_streams() -> Iterator[None]:
    """Give the block two streams that can be written to, or fail in the ways that this module knows."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # Else the next file that is opened becomes the standard output. Writing to it says that it is closed.
            os.open(os.devnull, os.O_RDONLY)
    before = sys.stdout, sys.stderr
    out, err = (stream or os.fdopen(n, "w", closefd=False) for n, stream in enumerate(before, start=1))
    for stream in (out, err):
        if hasattr(stream, "reconfigure"):
            # A terminal without Unicode shows '?' instead of failing.
            stream.reconfigure(errors="replace")
    sys.stdout, sys.stderr = out, cast("TextIO", Aside(err))
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
        try:
            err.flush()
        except OSError:
            _to_nowhere(2)


def ended_by_output(error: BaseException) -> int | None:
    """Return the exit code for a failure of the standard output, and say what it is; None for any other error."""
    cause: BaseException | None = error
    while cause is not None and not (isinstance(cause, OSError) and cause.filename is None):
        # The libraries that print turn a reader that has gone into an exit with 1.
        cause = cause.__context__ if isinstance(cause, SystemExit) and cause.code == 1 else None
    if cause is None:
        return None
    _to_nowhere(1)
    if cause.errno == errno.EPIPE:
        return PIPE_GONE
    print(f"error: cannot print: {cause.strerror}", file=sys.stderr)  # noqa: T201
    return 2


def _to_nowhere(number: int) -> None:
    """Let a stream's last words go nowhere: they would fail again while the program ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), number)
