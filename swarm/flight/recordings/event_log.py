"""The Crazyflie's binary event log: a table of event types, then events with a time each.

    0xBC, u16 version, u16 number of types
    type:   u16 id, name NUL, u16 number of variables, each "name(t)" NUL with t a code of Python's struct module
    event:  u16 id, time (version 1: u32 [ms], version 2: u64 [us]), values
    u32     CRC-32 of all before

All is little-endian. The file is read in blocks; events are given one by one.
"""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from swarm.errors import SwarmError

MAGIC = 0xBC
BLOCK = 1 << 16
"""Bytes that are read at a time."""
HEADER_MAX = 1 << 16
"""Bytes of the table of types: real ones have some hundreds."""
_CRC = 4
_CODES = "?bBhHiIlLqQfd"
_TIME = {1: (struct.Struct("<I"), 1e-3), 2: (struct.Struct("<Q"), 1e-6)}
"""Form and unit [s] of an event's time, by version."""


class EventType(NamedTuple):
    """One kind of event: its name, the names of its variables, and the form of their values."""

    name: str
    variables: tuple[str, ...]
    form: struct.Struct


class Event(NamedTuple):
    """One event: type, time [s] and values."""

    kind: EventType
    time_s: float
    values: tuple[float, ...]


class EventLog:
    """One log; iterate once for its events.

    version: of the format. types: by id. lost: why and where the log ends early, or that its checksum does not match;
    empty where all is well; known after the iteration. Before the iteration, `types` is empty.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._data = b""
        self._place = 0
        self.version = 0
        self.types: dict[int, EventType] = {}
        self.lost = ""

    def __iter__(self) -> Iterator[Event]:
        """Read the log.

        Raises:
            SwarmError: the file cannot be read, or its beginning is no such log.
        """
        try:
            with self._path.open("rb") as file:
                yield from self._events(file)
        except OSError as error:
            raise SwarmError(f"{self._path}: {error.strerror or error}") from None

    def _events(self, file: BinaryIO) -> Iterator[Event]:
        self._data = file.read(HEADER_MAX)
        self._header()
        time_form, unit_s = _TIME[self.version]
        crc, number, whole = zlib.crc32(self._data[: self._place]), 0, True
        data, place = self._data, self._place
        while True:
            # The last four bytes are the checksum: they are known as such only at the end of the file.
            begin = place
            while place + 2 <= len(data) - _CRC:
                kind = self.types.get(data[place] | data[place + 1] << 8)
                if kind is None:
                    whole = False
                    break
                end = place + 2 + time_form.size + kind.form.size
                if end > len(data) - _CRC:
                    break
                number += 1
                time_s = time_form.unpack_from(data, place + 2)[0] * unit_s
                yield Event(kind, time_s, kind.form.unpack_from(data, place + 2 + time_form.size))
                place = end
            crc = zlib.crc32(data[begin:place], crc)
            data, place = data[place:], 0
            more = file.read(BLOCK) if whole else b""
            if not more:
                break
            data += more
        self._end(data, crc, number, whole=whole)

    def _end(self, rest: bytes, crc: int, number: int, *, whole: bool) -> None:
        """Say how the log ends, with the bytes `rest` after event `number`."""
        if not whole:
            self.lost = f"damaged after event {number}: {rest[0] | rest[1] << 8} is no type of event"
        elif len(rest) != _CRC:
            self.lost = f"truncated: it ends within event {number + 1}"
        elif crc != int.from_bytes(rest, "little"):
            self.lost = f"damaged, or truncated after event {number}: its checksum does not match"

    def _header(self) -> None:
        if self._take("<B")[0] != MAGIC:
            raise self._refused(f"its first byte is not {MAGIC:#x}")
        self.version, types = self._take("<HH")
        if self.version not in _TIME:
            raise self._refused(f"its version is {self.version}, and {' and '.join(map(str, _TIME))} are known")
        for _ in range(types):
            number, name = self._take("<H")[0], self._name()
            variables = [self._name() for _ in range(self._take("<H")[0])]
            codes = [text[-2] if text[-3:-2] + text[-1:] == "()" else "" for text in variables]
            if not all(code and code in _CODES for code in codes):
                raise self._refused(f"event {name!r} has a variable without a known type")
            names = tuple(text[:-3] for text in variables)
            self.types[number] = EventType(name, names, struct.Struct("<" + "".join(codes)))

    def _take(self, form: str) -> tuple[int, ...]:
        size = struct.calcsize(form)
        if self._place + size > len(self._data):
            raise self._refused("its table of events is not whole")
        values = struct.unpack_from(form, self._data, self._place)
        self._place += size
        return values

    def _name(self) -> str:
        end = self._data.find(b"\0", self._place)
        if end < 0:
            raise self._refused("its table of events is not whole")
        text = self._data[self._place : end]
        self._place = end + 1
        if not text.isascii() or not text.decode("ascii").isprintable():
            raise self._refused("its table of events has names that are no text")
        return text.decode("ascii")

    def _refused(self, why: str) -> SwarmError:
        return SwarmError(f"{self._path}: not a Crazyflie's event log: {why}")
