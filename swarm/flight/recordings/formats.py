"""Formats of recordings and of the files that go with them, told by a file's beginning and never by its name."""

from enum import StrEnum
from itertools import islice
from pathlib import Path

from swarm.errors import SwarmError
from swarm.flight.recordings.event_log import MAGIC
from swarm.flight.recordings.system_config import TYPE
from swarm.flight.recordings.text_lines import TextLines
from swarm.flight.recordings.trajectory import NPY, begins_trajectory

_LINES = 50
"""Lines of a text by which its format is told."""


class Format(StrEnum):
    """Format of a file."""

    LIBSURVIVE = "libsurvive recording"
    CRAZYFLIE = "Crazyflie event log"
    TRAJECTORY = "trajectory"
    SYSTEM_CONFIG = "Crazyflie system configuration"


def format_of(path: str | Path) -> Format:
    """Return the format of a file; a text of no other kind is taken for a libsurvive recording.

    Raises:
        SwarmError: the file cannot be read, or is of a known kind that is none of these.
    """
    file = Path(path)
    try:
        with file.open("rb") as opened:
            head = opened.read(len(NPY))
    except ValueError as error:
        raise SwarmError(f"{str(file)!r}: {error}") from None
    except OSError as error:
        raise SwarmError(f"{file}: {error.strerror or error}") from None
    if head[:1] == bytes([MAGIC]):
        return Format.CRAZYFLIE
    if head == NPY:
        return Format.TRAJECTORY
    lines = [line for _, line in islice(TextLines(file), _LINES)]
    if any(line.partition(":")[2].strip() == TYPE for line in lines) or _is_config(lines):
        return Format.SYSTEM_CONFIG
    return Format.TRAJECTORY if begins_trajectory(lines) else Format.LIBSURVIVE


def recording_format(path: str | Path, *others: Format) -> Format:
    """Return the format of a recording; raise SwarmError for a file that is none, or of one of the `others`."""
    kind = format_of(path)
    if kind in others:
        raise SwarmError(f"{path}: a {kind}, of which this makes nothing; swarm replay takes it")
    if kind not in (Format.LIBSURVIVE, Format.CRAZYFLIE):
        raise SwarmError(f"{path}: a {kind}, which goes with a recording but is none")
    return kind


def _is_config(lines: list[str]) -> bool:
    """Return whether a text begins as a system configuration does: the client writes its type last."""
    heads = {line.rstrip() for line in lines if line and not line[0].isspace()}
    return "calibs:" in heads or "geos:" in heads
