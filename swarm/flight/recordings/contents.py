"""Contents of a recording: its objects, the light that each saw of each station, and what of it can be replayed."""

from collections import Counter
from pathlib import Path
from typing import NamedTuple

from swarm.errors import SwarmError
from swarm.flight.recordings.framing import frame_angles, frame_pulses
from swarm.flight.recordings.libsurvive import MOST_DAMAGED, SECOND_GENERATION, Recording, read_libsurvive
from swarm.flight.recordings.text_lines import TextLines

FIRST_GENERATION = ("C", "A")
"""Operations of Lighthouse 1.0 that are read."""
MOST_OBJECTS = 1000
"""Names beyond so many are no objects but damage."""


class Listed(NamedTuple):
    """One object and one station, or one object without usable light.

    generation: of the lighthouse, empty without light. photodiodes: number, None if it is not known. station: number,
    None without light. pulses, angles: periods that raw pulses and sweep angles give. begin_s, end_s: of the light.
    remark: why it cannot be replayed, empty if it can.
    """

    name: str
    generation: str
    photodiodes: int | None
    station: int | None
    pulses: int
    angles: int
    begin_s: float | None
    end_s: float | None
    remark: str


class Contents(NamedTuple):
    """All of a recording: a row per object and station, and what is lost of it."""

    rows: list[Listed]
    losses: list[str]


class _Seen(NamedTuple):
    """Numbers of lines per (object, operation). lost: why and where the file ends early."""

    lines: Counter[tuple[str, str]]
    lost: str

    def objects(self) -> list[str]:
        return list(dict.fromkeys(name for name, _ in self.lines))

    def number_of(self, name: str, operations: tuple[str, ...]) -> int:
        return sum(self.lines[name, op] for op in operations)


def contents(path: str | Path) -> Contents:
    """Return what a recording contains.

    Raises:
        SwarmError: the file cannot be read, or no object is in it.
    """
    file = Path(path)
    seen = _seen(file)
    if not seen.lines:
        raise SwarmError(
            f"{file}: {seen.lost + ': ' if seen.lost else ''}not a libsurvive recording: no object is in it"
        )
    rows, losses = [], []
    for name in seen.objects():
        remark = _remark(seen, name)
        if not remark:
            try:
                recording = read_libsurvive(file, name)
            except SwarmError as error:
                remark = str(error).removeprefix(f"{file}: ").removeprefix(f"{file}, ")
            else:
                rows += _stations(recording)
                losses += [
                    f"{name}: {text}" for text in recording.losses.sentences() if recording.losses.end not in text
                ]
                continue
        second = seen.number_of(name, SECOND_GENERATION)
        generation = "2.0" if second else "1.0" if seen.number_of(name, FIRST_GENERATION) else ""
        rows.append(Listed(name, generation, None, None, 0, 0, None, None, remark))
    if seen.lost:
        losses.insert(0, f"the recording is {seen.lost}: the rest of it is lost")
    return Contents(rows, losses)


def only_object(path: str | Path) -> str:
    """Return the name of the one object of a recording that can be replayed.

    Raises:
        SwarmError: the file cannot be read, or none or several of its objects can be replayed.
    """
    file = Path(path)
    seen = _seen(file)
    usable = [name for name in seen.objects() if not _remark(seen, name)]
    if len(usable) == 1:
        return usable[0]
    if usable:
        options = ", ".join(f"--object {name}" for name in usable)
        raise SwarmError(f"{file}: {len(usable)} objects saw light, choose one: {options}")
    where = f"{file}: {seen.lost}" if seen.lost else f"{file}"
    if not seen.lines:
        raise SwarmError(f"{where}: not a libsurvive recording: no object is in it")
    raise SwarmError(f"{where}: " + "; ".join(f"object {name!r}: {_remark(seen, name)}" for name in seen.objects()[:8]))


def _seen(file: Path) -> _Seen:
    lines: Counter[tuple[str, str]] = Counter()
    text = TextLines(file)
    names: set[str] = set()
    good = damaged = 0
    for _, line in text:
        head = line.split(None, 3)
        good, damaged = (good + 1, damaged) if len(head) > 2 else (good, damaged + 1)
        if damaged > MOST_DAMAGED + 2 * good:
            break
        if len(head) < 4 or head[2] not in ("CONFIG", *FIRST_GENERATION, *SECOND_GENERATION):
            continue
        if head[1] in names or len(names) < MOST_OBJECTS:
            names.add(head[1])
            lines[head[1], head[2]] += 1
    return _Seen(lines, text.lost)


def _remark(seen: _Seen, name: str) -> str:
    """Return why an object cannot be replayed, as far as the numbers of its lines tell."""
    if not seen.number_of(name, FIRST_GENERATION):
        if seen.number_of(name, SECOND_GENERATION):
            return "Lighthouse 2.0 is not supported yet"
        return "saw no light"
    return "" if seen.number_of(name, ("CONFIG",)) else "has no CONFIG line"


def _stations(recording: Recording) -> list[Listed]:
    photodiodes = recording.photodiodes.present.shape[1]
    times = [log.time_s for log in (recording.pulses, recording.angles) if len(log.time_s)]
    begin_s = min((float(t.min()) for t in times), default=None)
    end_s = max((float(t.max()) for t in times), default=None)
    out = []
    for station in (0, 1):
        pulses = len(frame_pulses(recording.pulses, station).start)
        angles = len(frame_angles(recording.angles, station).start)
        if pulses or angles:
            out.append(Listed(recording.device, "1.0", photodiodes, station, pulses, angles, begin_s, end_s, ""))
    remark = "no period of light is whole"
    return out or [Listed(recording.device, "1.0", photodiodes, None, 0, 0, begin_s, end_s, remark)]
