"""Contents of a recording: its objects, the light that each saw of each station, and what of it can be replayed."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.lighthouse.rotor import CHANNEL_CLOCK_HZ, CHANNEL_TICKS
from swarm.errors import SwarmError
from swarm.flight.recordings.crazyflie import POINT_M, CrazyflieLog, read_crazyflie
from swarm.flight.recordings.formats import Format, format_of
from swarm.flight.recordings.framing import frame_angles, frame_pulses
from swarm.flight.recordings.hits import Hits, Light, Lost, joined
from swarm.flight.recordings.libsurvive import MOST_DAMAGED, SECOND_GENERATION, Recording, read_libsurvive
from swarm.flight.recordings.libsurvive_config import read_factory_stations
from swarm.flight.recordings.object_clock import TICK_S
from swarm.flight.recordings.rotor_light import decode_rotor_log
from swarm.flight.recordings.system_config import NAME, SystemConfig, config_beside, read_system_config
from swarm.flight.recordings.text_lines import TextLines
from swarm.flight.recordings.trajectory import Trajectory, read_trajectory

FIRST_GENERATION = ("C", "A")
"""Operations of Lighthouse 1.0 that are read."""
MOST_OBJECTS = 1000
"""Names beyond so many are no objects but damage."""


class Listed(NamedTuple):
    """One object and one station, or one object without usable light.

    generation: of the lighthouse, empty without light. photodiodes: number, None if it is not known. station: number,
    None without light, for Lighthouse 2.0 its channel. pulses, angles: periods that raw pulses and sweep angles give,
    for 2.0 turns of the rotor. begin_s, end_s: of the light. remark: why it cannot be replayed, empty if it can.
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
    """All of a recording: its format, a row per object and station, what else is known of it, and what is lost."""

    format: Format
    rows: list[Listed]
    facts: list[str]
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
    """Return what a recording, or a file that goes with one, contains.

    Raises:
        SwarmError: the file cannot be read, or nothing usable is in it.
    """
    file = Path(path)
    kind = format_of(file)
    if kind is Format.CRAZYFLIE:
        return _of_crazyflie(read_crazyflie(file))
    if kind is Format.TRAJECTORY:
        return _of_trajectory(read_trajectory(file))
    if kind is Format.SYSTEM_CONFIG:
        return Contents(kind, [], _of_config(read_system_config(file)), [])
    return _of_libsurvive(file)


def _of_libsurvive(file: Path) -> Contents:
    seen = _seen(TextLines(file))
    if not seen.lines:
        raise SwarmError(
            f"{file}: {seen.lost + ': ' if seen.lost else ''}not a libsurvive recording: no object is in it"
        )
    rows: list[Listed] = []
    facts: list[str] = []
    losses: list[str] = []
    for name in seen.objects():
        remark = _remark(seen, name)
        if not remark:
            try:
                recording = read_libsurvive(file, name)
            except SwarmError as error:
                remark = str(error).removeprefix(f"{file}: ").removeprefix(f"{file}, ")
            else:
                found = _stations(recording) + _channels(recording, facts, losses)
                rows += found or [_unusable(recording)]
                losses += [f"{name}: {text}" for text in recording.losses._replace(end="").sentences()]
                continue
        second = seen.number_of(name, SECOND_GENERATION)
        generation = "2.0" if second else "1.0" if seen.number_of(name, FIRST_GENERATION) else ""
        rows.append(Listed(name, generation, None, None, 0, 0, None, None, remark))
    if seen.lost:
        losses.insert(0, f"the recording is {seen.lost}: the rest of it is lost")
    _beside(file, facts, losses)
    return Contents(Format.LIBSURVIVE, rows, facts, losses)


def _beside(file: Path, facts: list[str], losses: list[str]) -> None:
    """Say what libsurvive's configuration beside a recording, if it is there, knows of the stations."""
    config = file.with_name(f"{file.name}.json")
    if not config.is_file():
        return
    try:
        stations = read_factory_stations(config)
    except SwarmError as error:
        losses.append(str(error))
        return
    for station in stations:
        mode = "" if station.channel is None else f", mode {station.channel}"
        facts.append(f"{config.name}: station {station.number}{mode}: {_known(station.pose, station.terms)}")


def _known(pose: object, terms: object) -> str:
    """Return in words what is known of a station."""
    parts = ["a pose" if pose is not None else "", "a calibration" if terms is not None else ""]
    return " and ".join(part for part in parts if part) or "nothing"


def only_object(path: str | Path) -> str:
    """Return the name of the one object of a recording that can be replayed.

    Raises:
        SwarmError: the file cannot be read, or none or several of its objects can be replayed.
    """
    seen = _seen(TextLines(Path(path)))
    return _only(seen, f"{path}: {seen.lost}" if seen.lost else f"{path}")


def only_object_of(lines: Iterable[tuple[int, str]], where: str) -> str:
    """Return the name of the one object of numbered lines that can be replayed; `where` opens a message.

    Raises:
        SwarmError: as `only_object`.
    """
    return _only(_seen(lines), where)


def _only(seen: _Seen, where: str) -> str:
    """Return the only object that can be replayed; raise SwarmError, opened by `where`, if there is not one."""
    usable = [name for name in seen.objects() if not _remark(seen, name)]
    if len(usable) == 1:
        return usable[0]
    if usable:
        options = ", ".join(f"--object {name}" for name in usable)
        raise SwarmError(f"{where}: {len(usable)} objects saw light, choose one: {options}")
    if not seen.lines:
        raise SwarmError(f"{where}: not a libsurvive recording: no object is in it")
    raise SwarmError(f"{where}: " + "; ".join(f"object {name!r}: {_remark(seen, name)}" for name in seen.objects()[:8]))


def _seen(text: Iterable[tuple[int, str]]) -> _Seen:
    lines: Counter[tuple[str, str]] = Counter()
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
    return _Seen(lines, text.lost if isinstance(text, TextLines) else "")


def _remark(seen: _Seen, name: str) -> str:
    """Return why an object cannot be replayed, as far as the numbers of its lines tell."""
    first, second = (seen.number_of(name, operations) for operations in (FIRST_GENERATION, SECOND_GENERATION))
    if not first and not second:
        return "saw no light"
    if not seen.number_of(name, ("CONFIG",)):
        return "has no CONFIG line"
    if not first and not seen.number_of(name, ("Y", "B")):
        return "no hit with its rotor's zero"
    return ""


def _stations(recording: Recording) -> list[Listed]:
    """Return a row per Lighthouse 1.0 station."""
    photodiodes = recording.photodiodes.present.shape[1]
    begin_s, end_s = _span(recording)
    out = []
    for station in (0, 1):
        pulses = len(frame_pulses(recording.pulses, station).start)
        angles = len(frame_angles(recording.angles, station).start)
        if pulses or angles:
            out.append(Listed(recording.device, "1.0", photodiodes, station, pulses, angles, begin_s, end_s, ""))
    return out


def _channels(recording: Recording, facts: list[str], losses: list[str]) -> list[Listed]:
    """Return a row per Lighthouse 2.0 station, and say how it turns and what of its light is lost."""
    log = recording.rotors
    if not log.any():
        return []
    light = decode_rotor_log(log)
    own = joined([Hits(log.own_channel, log.own_plane, log.own_photodiode, log.own_tick, log.own_angle)])
    theirs = Light("2.0", TICK_S, own, Lost(), {})
    facts += [f"{recording.device}: {text}" for text in _turning(light)]
    losses += [f"{recording.device}: {text}" for text in light.lost.sentences()]
    photodiodes = recording.photodiodes.present.shape[1]
    begin_s, end_s = _ends([log.hit_time_s if len(log.hit_time_s) else log.own_time_s])
    row = Listed(recording.device, "2.0", photodiodes, None, 0, 0, begin_s, end_s, "")
    return _per_station(row, light, theirs)


def _per_station(row: Listed, raw: Light, decoded: Light) -> list[Listed]:
    """Return an object's row once per station, with the turns that its raw pulses and its decoded angles give."""
    return [
        row._replace(station=station, pulses=raw.turns(station), angles=decoded.turns(station))
        for station in sorted({*raw.stations(), *decoded.stations()})
    ]


def _unusable(recording: Recording) -> Listed:
    """Return the row of an object whose light gives no period."""
    second = recording.rotors.any()
    photodiodes = recording.photodiodes.present.shape[1]
    remark = "no hit with its rotor's zero" if second else "no period of light is whole"
    return Listed(recording.device, "2.0" if second else "1.0", photodiodes, None, 0, 0, *_span(recording), remark)


def _span(recording: Recording) -> tuple[float | None, float | None]:
    """Return the times of an object's first and last light, None without any."""
    rotors = recording.rotors
    return _ends([recording.pulses.time_s, recording.angles.time_s, rotors.hit_time_s, rotors.own_time_s])


def _ends(logs: Iterable[Floats]) -> tuple[float | None, float | None]:
    """Return the first and the last of the times of several logs, None without any."""
    times = [time_s for time_s in logs if len(time_s)]
    return min((float(t.min()) for t in times), default=None), max((float(t.max()) for t in times), default=None)


def _turning(light: Light) -> list[str]:
    """Return a sentence per Lighthouse 2.0 station about its rotor."""
    return [
        f"station {channel} turns at {1 / turn_s:.4f} Hz on the object's clock, "
        f"its channel's nominal is {CHANNEL_CLOCK_HZ / CHANNEL_TICKS[channel]:.4f} Hz"
        for channel, turn_s in sorted(light.turn_s.items())
    ]


def _of_crazyflie(log: CrazyflieLog) -> Contents:
    config, mistake = None, ""
    try:
        config = config_beside(log.path)
    except SwarmError as error:
        mistake = str(error)
    generation = config.generation if config is not None else ""
    light, decoded = log.light(generation), log.decoded(generation)
    has_rotors = log.has_rotors()
    raw = light if has_rotors else light._replace(hits=joined([]))
    row = Listed("Crazyflie", light.generation, len(POINT_M), None, 0, 0, log.begin_s, log.end_s, "")
    rows = _per_station(row, raw, decoded)
    facts = [f"event log, version {log.version}: " + _numbers(log.counts)]
    facts += _turning(light)
    if len(log.inertial.time_s):
        facts.append(f"inertial measurements: {len(log.inertial.time_s)}")
    if len(log.mark_s):
        facts.append("marks at " + ", ".join(f"{mark:.3f} s" for mark in log.mark_s[:8].tolist()))
    if len(log.frames.tick) and not has_rotors:
        facts.append("its raw pulses tell no rotor's zero, so only the firmware's angles are used")
    facts += [f"{config.path} is taken", *_of_config(config)] if config is not None else [f"no {NAME} is beside it"]
    losses = [f"the log is {log.lost}: the rest of it is lost, all before is used"] if log.lost else []
    losses += [f"events with impossible values, left out: {log.damaged}"] if log.damaged else []
    losses += [mistake] if mistake else []
    return Contents(Format.CRAZYFLIE, rows, facts, losses + light.lost.sentences())


def _numbers(counts: dict[str, int]) -> str:
    """Return the numbers of events by name, the most frequent first."""
    most = sorted(counts.items(), key=lambda item: -item[1])
    return ", ".join(f"{number} {name}" for name, number in most[:8]) or "no event"


def _of_config(config: SystemConfig) -> list[str]:
    """Return a sentence per station of a system configuration."""
    return [
        f"station {number}, Lighthouse {config.generation}: {_known(station.position, station.terms)}"
        for number, station in config.stations.items()
    ]


def _of_trajectory(found: Trajectory) -> Contents:
    begin_s, end_s = found.time_s[0], found.time_s[-1]
    turned = int(np.count_nonzero(np.isfinite(found.quaternion).all(axis=1)))
    facts = [
        f"{len(found.time_s)} positions in {end_s - begin_s:.1f} s, {found.rate_hz:.0f} Hz, time in {found.unit}"
        + (f", {turned} with an attitude" if turned else ", without attitude"),
        "a trajectory is truth for a recording, and is no recording itself",
    ]
    losses = [f"the file is {found.lost}: the rest of it is lost"] if found.lost else []
    losses += [f"rows without a position: {found.unseen}"] if found.unseen else []
    losses += [f"damaged rows, left out: {found.damaged}"] if found.damaged else []
    return Contents(Format.TRAJECTORY, [], facts, losses)
