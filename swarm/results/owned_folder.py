"""A folder of results that this program owns: claimed once, locked while it is written, marked with what it is worth.

A marker, a JSON file, is written first and says what the folder is worth: its `status` is "running" until the work has
ended, then "complete" or "interrupted" (with a `reason`); work that was killed stays "running" for ever. Its `program`
says which program wrote it, and that is the licence to replace the folder's files under `--force`: nothing else is ever
deleted. It lists under `inputs` the files that keep the names that a user gave them. While the work runs, the marker is
longer by `ROOM`, so that its end can be told in its place on a full disk. The lock is the operating system's (`flock`
on the folder itself): it needs no file, and a process that dies gives it back.

    CONTENTS = Contents("a study", "study.json", ("study.toml", "runs.parquet"), {"telemetry": ("*.parquet",)})
    with OwnedFolder(path, CONTENTS, force=force) as folder:     # marked as running, emptied of earlier work
        folder.write_text("study.toml", text)
        folder.replace("runs.parquet", lambda file: write(table, file))
        folder.finish({"runs": 12})                              # complete; if the block fails, interrupted
"""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from fnmatch import fnmatchcase
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any, Literal, NamedTuple, Self

from swarm.errors import SwarmError, question
from swarm.results.disk import FolderLock, overwrite, refuse_closed, replacing, write_text, writing
from swarm.user_text import parse_json, read_text, user_path

PROGRAM = "lighthouse-swarm"
RUNS = Path("runs")
"""Folder in which results go by default, and are looked for."""
MOST_NAMED = 8
"""Results that a message names at most."""
OTHERS = {
    "summary.json": "a run: swarm view {}",
    "study.json": "a study: swarm report {}",
    "comparison.json": "an experiment of a paper, whose table is in comparison.json",
}
"""Markers of all kinds of results, and what a folder with one is."""
Status = Literal["running", "complete", "interrupted"]
STOPPED = "stopped by the user"
ROOM = 64 * 1024
"""Blanks after the marker of work that is running: the summary of a run of 25 craft takes that many bytes."""


def folder_of(name: str, seed: int, out: str | Path | None = None) -> Path:
    """Return the folder of a result: `runs/<name>-<seed>`, or the one that was asked for.

    Args:
        name: Name of the scenario or the experiment.
        seed: Its seed.
        out: The folder, if not the usual one.

    Raises:
        SwarmError: `out` is no path.
    """
    return RUNS / f"{name}-{seed}" if out is None else user_path(out)


class Contents(NamedTuple):
    """The files of one kind of result.

    what: the kind, with its article. marker: name of the JSON file that marks it. files: names of the other files.
    folders: names of folders, with the patterns of the files in them and below, in any case of letters. instead: advice
    where there is such a result already.
    """

    what: str
    marker: str
    files: tuple[str, ...]
    folders: Mapping[str, tuple[str, ...]] = MappingProxyType({})
    instead: str = "--force (force=True) replaces it, --out (out=...) writes elsewhere"


def marker_in(folder: Path, contents: Contents) -> dict[str, Any] | None:
    """Return the marker in `folder` if this program wrote it, else None. Raises SwarmError where it is damaged."""
    file = folder / contents.marker
    if not user_path(file).is_file():
        return None
    text = read_text(file, str(file), "the JSON of a result")
    if not text.strip():
        raise SwarmError(f"{file} is damaged: it is empty")
    marker = parse_json(text, str(file), "the JSON of a result")
    return marker if isinstance(marker, dict) and marker.get("program") == PROGRAM else None


def find(path: str | Path, contents: Contents) -> tuple[Path, dict[str, Any]]:
    """Return the folder of a result of one kind, and its marker. Raises SwarmError as `find_any`."""
    return find_any(path, contents)[:2]


def find_any(path: str | Path, *kinds: Contents) -> tuple[Path, dict[str, Any], Contents]:
    """Return the folder `path`, or `runs/<path>` where there is no such folder, its marker, and its kind.

    A file of a result stands for its folder. Raises SwarmError where it is of none of the kinds, and names the nearest
    that is.
    """
    folder = user_path(path)
    if not folder.exists() and (RUNS / folder).exists():
        folder = RUNS / folder
    if folder.is_file() and any((folder.parent / kind.marker).is_file() for kind in kinds):
        folder = folder.parent
    for kind in kinds:
        marker = marker_in(folder, kind)
        if marker is not None:
            return folder, marker, kind
    what = " or ".join(kind.what for kind in kinds)
    raise SwarmError(f"{path} is not {what}: {_why_not(folder, kinds)}{_nearest(folder, kinds)}")


def _why_not(folder: Path, kinds: Sequence[Contents]) -> str:
    """Return why a folder is of none of the kinds."""
    if not folder.exists():
        return "there is no such folder"
    if folder.is_file():
        return "it is a file, and not in such a folder"
    for marker, what in OTHERS.items():
        if (folder / marker).is_file():
            return f"it is {what.format(folder)}"
    return f"it has no {' or '.join(kind.marker for kind in kinds)} of {PROGRAM}"


def _nearest(folder: Path, kinds: Sequence[Contents]) -> str:
    """Return a question with the nearest result, first of all another seed of the same scenario, or those there are."""
    places = [place for place in (folder, folder.parent, RUNS, Path()) if place.is_dir()]
    found = {file.parent for place in places for kind in kinds for file in place.glob(f"*/{kind.marker}")} - {folder}
    stem, dash, number = folder.name.rpartition("-")
    seeds = {
        one: one.name.rpartition("-")[2] for one in found if one.name.rpartition("-")[:2] == (stem, dash) != ("", "")
    }
    same = [one for one, seed in seeds.items() if seed.isdigit()]
    if same and number.isdigit():
        return question(str(min(same, key=lambda one: abs(int(seeds[one]) - int(number)))))
    named = {one.name: str(one) for one in sorted(found)}
    if near := get_close_matches(folder.name, named, n=1, cutoff=0.6):
        return question(named[near[0]])
    shown = list(named.values())[:MOST_NAMED]
    more = f" and {len(named) - MOST_NAMED} more" if len(named) > MOST_NAMED else ""
    return f"; known: {', '.join(shown)}{more}" if shown else ""


def refuse_taken(path: Path, contents: Contents, force: bool) -> None:
    """Look whether a result may be written to a folder, without touching it.

    Args:
        path: The folder; it need not exist.
        contents: What belongs to the result.
        force: An earlier result may be replaced.

    Raises:
        SwarmError: There is a result already, files stand in the way, or nothing can be written there.
    """
    if path.exists() and not path.is_dir():
        raise SwarmError(f"cannot write {path}: a file is in its place; choose another --out")
    with writing(path):
        refuse_closed(path)
    if marker_in(path, contents) is not None:
        if not force:
            raise SwarmError(f"{path} holds {contents.what} already; {contents.instead}")
        for name in contents.folders:
            if (path / name).is_symlink():
                raise SwarmError(f"{path / name} is a link, which {PROGRAM} does not make; move it away")
        return
    for name in (contents.marker, *contents.files, *contents.folders):
        if os.path.lexists(path / name):
            raise SwarmError(
                f"{path / name} was not written by {PROGRAM}, and {contents.what} would replace it; "
                "move it away or choose another --out"
            )


class OwnedFolder:
    """A claimed folder. As a context manager it marks the work as interrupted if the block fails.

    After the block `finish` must have been called: work that does not say so is not complete.
    """

    def __init__(self, path: Path, contents: Contents, *, force: bool = False, keep: bool = False) -> None:
        """Create and lock the folder, mark it as running, and empty it of earlier work.

        Args:
            path: The folder; it may hold other files, which stay.
            contents: The files of the result.
            force: Replace an earlier result.
            keep: Go on with an earlier result: its files and its marker stay.

        Raises:
            SwarmError: There is a result already, files stand in the way, somebody else is writing there, or nothing
                can be written.
        """
        self.path, self.contents = path, contents
        self._ended = False
        self._inputs: list[str] = []
        with writing(path):
            if path.exists() and not path.is_dir():
                raise SwarmError(f"cannot write {path}: a file is in its place; choose another --out")
            path.mkdir(parents=True, exist_ok=True)
        self._lock = FolderLock(path)
        try:
            self._claim(force, keep)
        except BaseException:
            self.release()
            raise

    def _claim(self, force: bool, keep: bool) -> None:
        if keep and marker_in(self.path, self.contents) is not None:
            return
        refuse_taken(self.path, self.contents, force)
        listed = (marker_in(self.path, self.contents) or {}).get("inputs")
        # They stay in the marker until they are gone.
        self._inputs = [name for name in listed if isinstance(name, str)] if isinstance(listed, list) else []
        earlier = self._earlier()
        self.mark("running")
        with writing(self.path):
            for file in (*map(self.path.joinpath, self.contents.files), *earlier):
                file.unlink(missing_ok=True)
            for folder in map(self.path.joinpath, self.contents.folders):
                if folder.is_dir():
                    for place in (*sorted(_folders_below(folder), reverse=True), folder):
                        place.rmdir()

    def _earlier(self) -> list[Path]:
        """Return the files of earlier work in the folder's folders. Raises SwarmError where there are others."""
        out = []
        for name, patterns in self.contents.folders.items():
            for file in (self.path / name).rglob("*"):
                if file.is_dir() and not file.is_symlink():
                    continue
                known = any(fnmatchcase(file.name.lower(), pattern) for pattern in patterns)
                if not known and file.relative_to(self.path).as_posix() not in self._inputs:
                    raise SwarmError(f"{file.parent} holds files that {PROGRAM} did not write; move them away")
                out.append(file)
        return out

    def list_inputs(self, names: Iterable[str]) -> None:
        """Write into the marker the names of files, whatever they are called, that are going to be written.

        names: their paths below this folder. Raises SwarmError where nothing can be written.
        """
        self._inputs = list(names)
        self.mark("running")

    def mark(self, status: Status, content: Mapping[str, Any] = MappingProxyType({})) -> None:
        """Replace the marker. Raises ValueError where the content has NaN, SwarmError where nothing can be written.

        On a full disk it is written over what is there, if it is not longer.
        """
        head: dict[str, Any] = {"program": PROGRAM, "version": _version(), "status": status}
        if self._inputs:
            head["inputs"] = self._inputs
        try:
            text = json.dumps({**head, **content}, indent=2, allow_nan=False)
        except ValueError as error:
            raise ValueError("a summary has null where a figure is missing, never NaN") from error
        try:
            self.write_text(self.contents.marker, text + " " * (ROOM if status == "running" else 0) + "\n")
        except SwarmError:
            if not overwrite(self.path / self.contents.marker, text + "\n"):
                raise

    def write_text(self, name: str, text: str) -> None:
        """Replace the file `name` by `text` in one step. Raises SwarmError where it cannot be written."""
        write_text(self.path / name, text)

    def replace(self, name: str, write: Callable[[Path], object]) -> None:
        """Replace the file `name` in one step by what `write` writes. Raises SwarmError where it cannot be written."""
        file = self.path / name
        with replacing(file, file.with_name(file.name + ".tmp")) as temporary:
            write(temporary)

    def finish(self, content: Mapping[str, Any]) -> None:
        """Mark the work as complete, with its figures (JSON-able, no NaN), and release the folder."""
        self.mark("complete", content)
        self._ended = True
        self.release()

    def interrupt(self, reason: str, content: Mapping[str, Any] | None = None) -> None:
        """Mark the work as ended early because of `reason`, with the figures that there are, and room for."""
        try:
            self.mark("interrupted", {"reason": reason, **(content or {})})
        except SwarmError:
            self.mark("interrupted", {"reason": reason})
        self._ended = True

    def release(self) -> None:
        """Let others write to the folder."""
        self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()
        if self._ended:
            return
        if kind is None:
            raise RuntimeError(f"the work in {self.path} ended without a summary")
        told = str(error) if issubclass(kind, SwarmError) else f"{kind.__name__}: {error}"
        reason = STOPPED if issubclass(kind, KeyboardInterrupt) else told
        try:
            self.interrupt(reason)
        except SwarmError:
            # The first error is what the user must see; where nothing at all can be written, "running" stays.
            return


def _folders_below(folder: Path) -> Iterator[Path]:
    return (one for one in folder.rglob("*") if one.is_dir() and not one.is_symlink())


def _version() -> str | None:
    try:
        return version(PROGRAM)
    except PackageNotFoundError:
        return None
