"""An MP4 file (H.264), written picture by picture with the library PyAV. The only file that imports av."""

from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from swarm.errors import SwarmError

QUALITY = "20"
"""H.264's constant rate factor: lower is better and larger."""


def check_library() -> None:
    """Raise SwarmError where the library is not installed."""
    try:
        import av  # noqa: F401
    except ImportError:
        raise SwarmError("a video needs the library PyAV: pip install '.[video]' in the clone") from None


class Mp4:
    """A video that is being written, as a context manager."""

    def __init__(self, file: Path, width: int, height: int, fps: int) -> None:
        """Open the file.

        Args:
            file: The video.
            width: Its width [px], even.
            height: Its height [px], even.
            fps: Pictures per second.

        Raises:
            OSError: It cannot be written.
        """
        import av

        self._frame: Any = av.VideoFrame
        self._container: Any = av.open(str(file), "w", format="mp4", options={"movflags": "faststart"})
        self._stream = self._container.add_stream("libx264", rate=fps, options={"crf": QUALITY})
        self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, "yuv420p"

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Add a picture, (height, width, 3). Raises OSError where it cannot be written."""
        frame = self._frame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
        self._container.mux(self._stream.encode(frame))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._container.mux(self._stream.encode())
            self._container.close()
            return
        with suppress(OSError):  # the first error is what the user must see
            self._container.close()
