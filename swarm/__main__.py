"""Entry point of `swarm` and of `python -m swarm`: Ctrl-C ends the program quietly, also while it is still loading."""

import atexit
import os
import signal
import sys
from types import FrameType


def main() -> int:
    """Run the command line, and return the exit code."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, leave)
        # The interpreter's own end gives the signal back to the system, which would kill the program.
        atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)
    from swarm.cli.app import main as run

    return run(leave)


def leave(number: int, frame: FrameType | None) -> None:
    """End the program at once: nothing is open yet, or nothing any more, and a library must not swallow the signal."""
    os._exit(128 + number)


if __name__ == "__main__":
    sys.exit(main())
