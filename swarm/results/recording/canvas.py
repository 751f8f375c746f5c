"""The stream that a recording is written to: a file, and with `live` a viewer too."""

import ctypes
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from rerun.blueprint import Blueprint

from estimators.arrays import Bools, Floats, Ints
from estimators.rotation import xyzw_from_wxyz
from swarm.errors import SwarmError
from swarm.results.disk import has_room, unwritten, writing
from swarm.results.recording.drawing import Solid
from swarm.results.recording.viewer import start_live

Send = Callable[[str, Iterable[Any]], None]
"""Sends an entity's columns, at the times of its batch."""
LOOK_S, PATIENCE_S = 1.0, 30.0
"""Time after which a file that is flushed is looked at [s], and time without growth after which it is given up."""


class Canvas:
    """The open stream. live: a viewer is fed. notice: why there is none, where one was wanted."""

    def __init__(self, path: Path, live: bool) -> None:
        """Open the file. Raises SwarmError where it cannot be written."""
        self.notice: str | None = None
        self._path = path
        self._broken: SwarmError | None = None
        with writing(path), path.open("wb"):
            pass
        self._stream = rr.RecordingStream("lighthouse-swarm")
        sinks: list[Any] = [rr.FileSink(path)]
        if live:
            try:
                sinks.append(rr.GrpcSink(start_live()))
            except SwarmError as error:
                self.notice = f"no live view: {error}; the recording is written all the same"
        self.live = len(sinks) > 1
        try:
            self._stream.set_sinks(*sinks)
        except RuntimeError as error:
            raise unwritten(path, error) from error
        self._stream.send_recording_name(path.absolute().parent.name)

    def lay_out(self, blueprint: Blueprint) -> None:
        """Send the viewer's layout."""
        self._stream.send_blueprint(blueprint)

    def static(self, entity: str, what: Any) -> None:
        """Draw something that does not change."""
        self._stream.log(entity, what, static=True)

    def at(self, time_s: Floats, frame: Ints) -> Send:
        """Return what sends columns at these times (n,) [s] and frames (n,)."""
        index = [
            rr.TimeColumn("sim_time", duration=np.rint(time_s * 1e9).astype("timedelta64[ns]")),
            rr.TimeColumn("frame", sequence=frame),
        ]
        return lambda entity, columns: self._stream.send_columns(entity, index, columns)

    def flush(self) -> None:
        """Hand everything to the operating system, so that it survives a kill. Raises SwarmError on a full disk.

        rerun waits for the thread that writes, for ever where that has ended on a full disk.
        """
        size, waited_s = -1, 0.0
        while not self._broken:
            try:
                self._stream.flush(timeout_sec=LOOK_S)
                return
            except RuntimeError as error:
                before, size = size, self._path.stat().st_size
                waited_s = waited_s + LOOK_S if size == before else 0.0
                if "timed out" in str(error) and waited_s < PATIENCE_S and has_room(self._path):
                    continue
                self._broken = unwritten(self._path, error)
                _abandon(self._stream)
        raise self._broken

    def close(self) -> None:
        """Complete the file, if it can be written."""
        if not self._broken:
            self._stream.disconnect()


def _abandon(stream: rr.RecordingStream) -> None:
    """Leave a stream that cannot be written: to let go of it, or to end Python, is to wait for its thread for ever."""
    rr.unregister_shutdown()
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))


def mesh(solid: Solid) -> rr.Mesh3D:
    """Return a solid as rerun draws it."""
    return rr.Mesh3D(vertex_positions=solid.vertex, vertex_normals=solid.normal, vertex_colors=solid.colour)


def turn(quaternion: Floats) -> Floats:
    """Return quaternions as xyzw; no turn where unknown, since the viewer would ignore the whole transform."""
    known = np.isfinite(quaternion).all(axis=-1, keepdims=True)
    return xyzw_from_wxyz(np.where(known, quaternion, np.array([1.0, 0.0, 0.0, 0.0])))


def ink(*colours: int) -> Any:
    """Return rgba colours as an array."""
    return np.array(colours, dtype=np.uint32)


def send_segments(send: Send, entity: str, end: Floats, drawn: Bools) -> None:
    """Send segments from the origin to points.

    Args:
        send: The batch's sender.
        entity: Where they go.
        end: Points (n, C, K, 3) [m].
        drawn: Which of them, (n, C, K).
    """
    to = end[drawn]
    strips = np.stack([np.zeros_like(to), to], axis=1).astype(np.float32)
    send(entity, rr.LineStrips3D.columns(strips=strips).partition(np.count_nonzero(drawn, axis=(1, 2))))
