"""Lines of a recording's text, read as a stream: of any size, packed by gzip or plain, in any common encoding.

Memory is bounded: by one block of text and one line, of which no more than `LONGEST_LINE` characters are kept. Text
that ends early, because a gzip stream is truncated or damaged, gives the lines before that place, and `lost` says so.
A file that is no text is refused by its name: a USB capture, an archive, another compression.
"""

import codecs
import zlib
from collections.abc import Iterator
from io import IncrementalNewlineDecoder
from pathlib import Path
from typing import Protocol

from swarm.errors import SwarmError

BLOCK = 1 << 16
"""Bytes that are read, and unpacked, at a time."""
LONGEST_LINE = 1 << 20
"""Characters of a line that are kept: the longest real ones, an object's CONFIG, have some 20 000."""
_GZIP = b"\x1f\x8b"
_CAPTURES = (b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\xc3\xd4", b"\x4d\x3c\xb2\xa1", b"\xa1\xb2\x3c\x4d", b"\x0a\x0d\x0d\x0a")
_PACKED = {
    b"PK\x03\x04": "a zip archive",
    b"BZh": "packed by bzip2",
    b"\xfd7zXZ": "packed by xz",
    b"\x28\xb5\x2f\xfd": "packed by zstd",
    b"7z\xbc\xaf": "a 7z archive",
}
_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
CONVERT = (
    "a USB capture (pcap), not a recording; libsurvive converts it (pip install pysurvive): "
    "python -m pysurvive --usbmon-playback FILE --playback-factor 0 --record OUT.rec --record-rawlight 1 -c OUT.json"
)


class Blocks(Protocol):
    """Source of bytes, such as an open file."""

    def read(self, most: int, /) -> bytes:
        """Return the next bytes, `most` at most, and none at the end."""


class TextLines:
    """Lines of one file; iterate once for (number, line), without blank ones. A line that is too long is cut.

    lost: why and where the text ends early, empty where it is whole; known after the iteration.
    """

    def __init__(self, path: Path, stream: Blocks | None = None) -> None:
        """Name the file; with a `stream` the bytes come from there, and the path is for messages only."""
        self._path, self._stream = path, stream
        self._number = 1
        self.lost = ""

    def __iter__(self) -> Iterator[tuple[int, str]]:
        """Read the lines.

        Raises:
            SwarmError: the file cannot be read, or is of a known kind that is no text.
        """
        if self._stream is not None:
            yield from self._split(self._decoded(self._blocks(self._stream)))
            return
        try:
            file = self._path.open("rb")
        except ValueError as error:
            raise SwarmError(f"{str(self._path)!r}: {error}") from None
        except OSError as error:
            raise SwarmError(f"{self._path}: {error.strerror or error}") from None
        with file:
            yield from self._split(self._decoded(self._blocks(file)))

    def _read(self, file: Blocks) -> bytes:
        try:
            return file.read(BLOCK)
        except OSError as error:
            raise SwarmError(f"{self._path}: {error.strerror or error}") from None

    def _blocks(self, file: Blocks) -> Iterator[bytes]:
        """Return the file's bytes in blocks, unpacked if they are packed."""
        head = self._read(file)
        if not head.startswith(_GZIP):
            while head:
                yield head
                head = self._read(file)
            return
        unpacker, packed = zlib.decompressobj(wbits=31), head
        while True:
            before = unpacker.copy()
            try:
                block = unpacker.decompress(packed, BLOCK)
            except zlib.error as error:
                self.lost = f"damaged gzip data ({error})"
                yield _until_error(before, packed)
                return
            yield block
            packed = unpacker.unconsumed_tail
            if unpacker.eof:
                packed = (unpacker.unused_data or self._read(file)).lstrip(b"\0")
                while not packed and (more := self._read(file)):
                    packed = more.lstrip(b"\0")
                if not packed:
                    return
                unpacker = zlib.decompressobj(wbits=31)
            elif not packed:
                packed = self._read(file)
                if not packed and len(block) < BLOCK:
                    self.lost = "a truncated gzip file"
                    return

    def _decoded(self, blocks: Iterator[bytes]) -> Iterator[str]:
        """Return the text in blocks, by the byte order mark or the NUL bytes of UTF-16 at its beginning."""
        head = b""
        for block in blocks:
            head += block
            if len(head) >= 8:
                break
        self._refuse(head)
        mark, encoding = next(((m, e) for m, e in _MARKS if head.startswith(m)), (b"", "utf-8"))
        if not mark and len(head) >= 2 and (head[0] == 0) != (head[1] == 0):
            encoding = "utf-16-be" if head[0] == 0 else "utf-16-le"
        decoder = IncrementalNewlineDecoder(codecs.getincrementaldecoder(encoding)(errors="replace"), translate=True)
        yield decoder.decode(head[len(mark) :])
        for block in blocks:
            yield decoder.decode(block)
        yield decoder.decode(b"", final=True)

    def _refuse(self, head: bytes) -> None:
        if head.startswith(_CAPTURES):
            raise SwarmError(f"{self._path}: {CONVERT.replace('FILE', str(self._path))}")
        for magic, what in _PACKED.items():
            if head.startswith(magic):
                raise SwarmError(f"{self._path}: {what}, not a recording: unpack it first")

    def _split(self, blocks: Iterator[str]) -> Iterator[tuple[int, str]]:
        rest = ""
        for block in blocks:
            if not rest and block.isspace():
                self._number += block.count("\n")
                continue
            if len(rest) >= LONGEST_LINE:
                if self._number == 1:
                    raise SwarmError(
                        f"{self._path}: not a libsurvive recording, nor a trajectory: "
                        f"its first {LONGEST_LINE} characters are one line"
                    )
                block = block[block.find("\n") :] if "\n" in block else ""
            *lines, rest = (rest + block).split("\n") if block else [rest]
            for line in lines:
                if line and not line.isspace():
                    yield self._number, line
                self._number += 1
        # The last line of a text that ends early is a part of one.
        if self.lost:
            self.lost += f", it ends within line {self._number}"
        elif rest.strip():
            yield self._number, rest


def _until_error(unpacker: "zlib._Decompress", packed: bytes) -> bytes:
    """Return what can be unpacked of a block with damage in it."""
    out = bytearray()
    try:
        for i in range(len(packed)):
            out += unpacker.decompress(packed[i : i + 1])
    except zlib.error:
        pass
    return bytes(out)
