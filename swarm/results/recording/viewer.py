"""The rerun viewer as a program beside ours: it listens on 127.0.0.1 only (its own default is every interface)."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from swarm.errors import SwarmError

HOST = "127.0.0.1"
START_LIMIT_S = 20.0
MAGIC = b"RRF2"
"""First bytes of a recording."""


def _command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "rerun_cli", *arguments, "--bind", HOST]


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])


def has_display() -> bool:
    """Return whether a window can be opened here."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def view(path: Path, web: bool = False, more: Sequence[Path] = ()) -> int:
    """Show a recording until its viewer is closed, in a window or in a browser.

    Args:
        path: The recording.
        web: Show it in a browser.
        more: Further files of the same recording.

    Returns:
        The viewer's exit code.

    Raises:
        SwarmError: There is no recording, or no display for a window.
    """
    for part in (path, *more):
        if not part.is_file():
            raise SwarmError(f"there is no recording {part}; was the run made with the recording off?")
        with part.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise SwarmError(f"{part} is not a rerun recording")
    if not web and not has_display():
        raise SwarmError(f"no display to open a window on; `swarm view --web {path.parent}` serves it to a browser")
    ports = ["--port", str(_free_port())]
    if web:
        ports += ["--web-viewer", "--web-viewer-port", str(_free_port())]
        print(f"The viewer opens in the browser, for this machine only: {HOST}:{ports[-1]}. Ctrl-C ends it.")  # noqa: T201
    # Its own log is for rerun's developers; errors still come through.
    environment = {**os.environ, "RUST_LOG": "error"}
    viewer = subprocess.Popen(_command(*map(str, (path, *more)), *ports), env=environment, start_new_session=True)
    try:
        return viewer.wait()
    finally:
        # However we end, by a signal too, the viewer ends with us.
        _end(viewer)


def _end(viewer: "subprocess.Popen[bytes]") -> None:
    """End a viewer in a session of its own: the Python process that was started, and the program that it started."""
    if sys.platform == "win32":
        viewer.terminate()
    else:
        with suppress(ProcessLookupError):
            os.killpg(viewer.pid, signal.SIGTERM)
    viewer.wait()


def start_live() -> str:
    """Open an empty viewer and return the address that a recording can stream to. Raises SwarmError where it cannot."""
    if not has_display():
        raise SwarmError("no display to open a window on")
    port = _free_port()
    # In a session of its own, a Ctrl-C at the terminal stops the run, not the viewer.
    viewer = subprocess.Popen(
        _command("--port", str(port), "--expect-data-soon"),
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    limit = time.monotonic() + START_LIMIT_S
    while time.monotonic() < limit:
        if viewer.poll() is not None:
            raise SwarmError(f"the viewer ended at once, with code {viewer.returncode}")
        with socket.socket() as probe:
            if probe.connect_ex((HOST, port)) == 0:
                return f"rerun+http://{HOST}:{port}/proxy"
        time.sleep(0.1)
    _end(viewer)
    raise SwarmError(f"the viewer did not answer within {START_LIMIT_S:.0f} s")
