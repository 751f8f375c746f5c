"""Writing to disk so that a kill leaves the old file or the new one, and so that a full disk is one clear message."""

import errno
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from shutil import disk_usage
from types import ModuleType

from swarm.errors import PlaceError, SwarmError

fcntl: ModuleType | None
try:
    import fcntl
except ImportError:  # Windows has no advisory locks of this kind.
    fcntl = None

NO_ROOM = 65_536
"""Free bytes of a disk on which nothing more can be written."""
_NO_PLACE = {
    errno.ENOSPC: ("the disk is full; what was written before stays readable", "free some room"),
    errno.EDQUOT: ("the disk quota is used up; what was written before stays readable", "free some room"),
    errno.EROFS: ("the file system is read-only",),
    errno.EACCES: ("no permission to write there",),
    errno.EPERM: ("no permission to write there",),
}
"""What is wrong with a place, and what helps besides another one."""
_REASONS = {
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
        raise _unwritten(path, error.errno or 0, error.strerror or str(error)) from error


def has_room(path: Path) -> bool:
    """Return False where nothing more can be written beside `path`, for want of room."""
    return not path.parent.is_dir() or disk_usage(path.parent).free >= NO_ROOM


def unwritten(path: Path, error: RuntimeError) -> SwarmError:
    """Return what `writing` would say of a library's own error.

    Its text has the system's number where it has one; without, a disk on which there is no room is the reason.
    """
    number = re.search(r"os error (\d+)", str(error))
    full = not number and not has_room(path)
    return _unwritten(path, int(number[1]) if number else errno.ENOSPC if full else 0, str(error))


def _unwritten(path: Path, number: int, said: str) -> SwarmError:
    """Return the error of a system's number; said: its words, where there are no better ones."""
    if number in _NO_PLACE:
        fault, *ways = _NO_PLACE[number]
        return PlaceError(f"cannot write {path}: {fault}", *ways)
    return SwarmError(f"cannot write {path}: {_REASONS.get(number, said)}")


@contextmanager
def replacing(path: Path, temporary: Path | None = None) -> Iterator[Path]:
    """Give the block a file beside `path` to write, with the same ending, which takes its place at the end.

    A block that fails or is stopped leaves `path` as it was, and nothing beside it.

    Args:
        path: The file.
        temporary: The file to write, where it must have a certain name.

    Raises:
        SwarmError: As `writing`.
    """
    with writing(path), _replacing({path: temporary or _beside(path)}):
        yield temporary or _beside(path)


@contextmanager
def outputs(*paths: Path) -> Iterator[tuple[Path, ...]]:
    """Give the block files beside `paths`, in one folder, to write; all of them take their places at its end.

    A block that fails or is stopped leaves all files as they were, and nothing beside them: no folder either that was
    made for them. Raises SwarmError as `writing`.
    """
    temporaries = {path: _beside(path) for path in paths}
    folder = paths[0].parent
    with writing(paths[0] if len(paths) == 1 else folder):
        made = [one for one in (folder, *folder.parents) if not one.exists()]
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with _replacing(temporaries):
                yield tuple(temporaries.values())
        except BaseException:
            for one in made:
                with suppress(OSError):  # it was not made, or another program has put something there
                    one.rmdir()
            raise


def write_all(contents: Mapping[Path, bytes]) -> None:
    """Write files into one folder, all or none. Raises SwarmError where one of them cannot be written."""
    with outputs(*contents) as temporaries:
        for temporary, content in zip(temporaries, contents.values(), strict=True):
            temporary.write_bytes(content)


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.stem}.tmp{path.suffix}")


@contextmanager
def _replacing(temporaries: Mapping[Path, Path]) -> Iterator[None]:
    """Move the files that the block writes to their places, or remove them."""
    try:
        yield
        try:
            for path, temporary in temporaries.items():
                temporary.replace(path)
        except KeyboardInterrupt:
            # A set of old and new files would be neither.
            for path, temporary in temporaries.items():
                if temporary.exists():
                    temporary.replace(path)
            raise
    except BaseException:
        for temporary in temporaries.values():
            temporary.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str) -> None:
    """Replace the file `path` by `text` in one step. Raises SwarmError where it cannot be written."""
    with replacing(path, path.with_name(path.name + ".tmp")) as temporary:
        temporary.write_text(text, encoding="utf-8")


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
    """Look whether files can be written, before the work whose results they take.

    Args:
        files: The files.
        force: Files that are there may be replaced.

    Raises:
        SwarmError: A folder is in the place of one of them, or, unless `force`, a file; or they cannot be written.
    """
    for file in files:
        if file.is_dir():
            raise PlaceError(f"cannot write {file}: it is a folder")
        if file.exists() and not force:
            raise PlaceError(f"{file} is there already", "--force replaces it")
        with writing(file):
            refuse_closed(file.parent)


def refuse_closed(folder: Path) -> None:
    """Raise an OSError where no file can be made in a folder, or in the one that it would be made in."""
    while not folder.exists():
        folder = folder.parent
    if not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, "", str(folder))
    if not os.access(folder, os.W_OK | os.X_OK):
        read_only = hasattr(os, "statvfs") and os.statvfs(folder).f_flag & os.ST_RDONLY
        raise OSError(errno.EROFS if read_only else errno.EACCES, "", str(folder))
