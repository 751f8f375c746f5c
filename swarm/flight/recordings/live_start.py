"""Start of a replay of lines as they come: the first ones tell the object, its photodiodes and its stations."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from swarm.errors import SwarmError
from swarm.flight.recordings.contents import FIRST_GENERATION, only_object_of
from swarm.flight.recordings.libsurvive import SECOND_GENERATION, LibsurviveReader
from swarm.flight.recordings.live_lines import WAIT_S, WHERE, Line, LiveLines
from swarm.flight.recordings.object_light import ObjectLight, object_of
from swarm.flight.recordings.windows import Source

LEARN_S = 3.0
"""Light from which stations and noise are learnt before the first estimate [s], on the host's clock."""
TELL_S = 5.0
"""Time without light after which that is told [s]."""
LIT = (*FIRST_GENERATION, *SECOND_GENERATION)
"""Operations of lines with light."""
MOST_GARBAGE = 1000
"""Damaged lines, beyond twice the good ones, at which lines without an object are given up."""


class Learnt(NamedTuple):
    """Knowledge from the first lines. reader: has them. light: of the object so far."""

    reader: LibsurviveReader
    light: ObjectLight


def learn(
    lines: LiveLines, name: str | None, source: Source, calibration: str | Path | None, tell: Callable[[str], None]
) -> Learnt:
    """Read lines until an object has been lit for `LEARN_S`, or they end.

    Args:
        lines: as they come.
        name: of the object; None: the only one.
        source: raw "pulses" or "angles".
        calibration: file of libsurvive's configuration, None without.
        tell: gets a sentence where nothing comes to fly by.

    Raises:
        SwarmError: there is nothing to fly by, or more than one object.
        KeyboardInterrupt: the lines were stopped before the first light.
    """
    seen = _Seen()
    began_s, told = time.monotonic(), False
    while not lines.ended and not seen.enough(name):
        seen.add(lines.take(WAIT_S))
        if not told and time.monotonic() - began_s > TELL_S and not seen.since_s:
            told = True
            tell("lines come, but no light yet" if seen.lines else f"waiting for lines on {WHERE}")
    if lines.stopped and not seen.since_s:
        raise KeyboardInterrupt
    if not seen.lines:
        raise SwarmError(f"{WHERE}: no line came: pipe a program into it that writes libsurvive's lines")
    read = [(line.number, line.text) for line in seen.lines]
    chosen = name or only_object_of(read, WHERE)
    reader = LibsurviveReader(Path(WHERE), chosen)
    for number, text in read:
        reader.read(text, number)
    recording = reader.recording(lines.lost, whole=lines.ended)
    return Learnt(reader, object_of(recording, source, calibration))


class _Seen:
    """Lines so far. since_s: host's time of the first light of each object [s]."""

    def __init__(self) -> None:
        self.lines: list[Line] = []
        self.since_s: dict[str, float] = {}
        self._until_s: dict[str, float] = {}
        self._configured: set[str] = set()
        self._garbage = 0

    def add(self, lines: Sequence[Line]) -> None:
        """Take lines; raise SwarmError where there is hardly anything else than garbage."""
        self.lines += lines
        for line in lines:
            head = line.text.split(None, 3)
            try:
                time_s = float(head[0])
                source, op = head[1:3]
            except (ValueError, IndexError):
                self._garbage += 1
                continue
            if op == "CONFIG":
                self._configured.add(source)
            elif op in LIT:
                self.since_s.setdefault(source, time_s)
                self._until_s[source] = time_s
        if self._garbage > MOST_GARBAGE + 2 * (len(self.lines) - self._garbage):
            raise SwarmError(
                f"{WHERE}: not a libsurvive recording: of {len(self.lines)} lines, {self._garbage} do not read "
                "'time_s source OP ...'"
            )

    def enough(self, name: str | None) -> bool:
        """Return whether the object, or any, has been lit for long enough, and is known."""
        return any(
            source in self._configured and self._until_s[source] - since_s >= LEARN_S
            for source, since_s in self.since_s.items()
            if name in (None, source)
        )
