"""Writing to disk so that a kill leaves the old file or the new one, and so that a full disk is one clear message."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from swarm.errors import SwarmError

fcntl: ModuleType | None
try:
    import fcntl
except ImportError:  # Windows has no advisory locks of this kind.
    fcntl = None

_ADVICE = {
    errno.ENOSPC: "the disk is full; what was written before stays readable",
    errno.EDQUOT: "the disk quota is used up; what was written before stays readable",
    errno.EROFS: "the file system is read-only; choose another place with --out",
    errno.EACCES: "no permission to write there; choose another place with --out",
    errno.EPERM: "no permission to write there; choose another place with --out",
    errno.ENOTDIR: "a part of the path is a file, not a folder",
    errno.EEXIST: "a file or a broken link is in its place",
    errno.ENAMETOOLONG: "the name is too long",
}


class FolderLock:
    """Lock of a folder that is being written to; the operating system takes it back from a process that dies."""

    def __init__(self, folder: Path, busy: str = "a run is being written there now; choose another --out") -> None:
        """Take the lock. Raises SwarmError, `busy` where somebody else is writing to `folder`."""
        self._file: int | None = None
        if fcntl is None:
            return
        with writing(folder):
            self._file = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.release()
            raise SwarmError(f"{folder}: {busy}") from None

    def release(self) -> None:
        """Give the lock back."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError of the block, which writes `path`, into a SwarmError that says what failed and where."""
    try:
        yield
    except OSError as error:
        reason = _ADVICE.get(error.errno or 0) or error.strerror or str(error)
        raise SwarmError(f"cannot write {path}: {reason}") from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give the block a file beside `path` to write, with the same ending, which takes its place at the end.

    A block that fails or is stopped leaves `path` as it was, and nothing beside it. Raises SwarmError as `writing`.
    """
    temporary = path.with_name(f".{path.stem}.tmp{path.suffix}")
    with writing(path):
        try:
            yield temporary
            temporary.replace(path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


def write_text(path: Path, text: str) -> None:
    """Replace the file `path` by `text` in one step. Raises SwarmError where it cannot be written."""
    temporary = path.with_name(path.name + ".tmp")
    with writing(path):
        try:
            temporary.write_text(text, encoding="utf-8")
            temporary.replace(path)
        except OSError:
            temporary.unlink(missing_ok=True)
            raise


def overwrite(path: Path, text: str) -> bool:
    """Replace what is in a file by `text` without a byte more on the disk; tell whether there was room for it.

    It is for a disk that is full, where `write_text` finds no room for a second file. A kill at that very moment may
    leave the text cut. Nothing is changed where the file is shorter than the text.
    """
    data = text.encode()
    try:
        with path.open("r+b", buffering=0) as file:
            if os.fstat(file.fileno()).st_size < len(data) or file.write(data) < len(data):
                return False
            file.truncate(len(data))
    except OSError:
        return False
    return True


def refuse_existing(*files: Path, force: bool) -> None:
    """Raise SwarmError where a folder is in the place of one of the files, or, unless `force`, a file."""
    for file in files:
        if file.is_dir():
            raise SwarmError(f"cannot write {file}: it is a folder; choose another --out")
        if file.exists() and not force:
            raise SwarmError(f"{file} is there already; --force replaces it, --out writes elsewhere")
