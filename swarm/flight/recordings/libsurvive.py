"""Recordings of real Lighthouse 1.0 hardware by libsurvive: one event per line, `time_s source OP ...`.

    CONFIG json             the object: lighthouse_config.modelPoints [m], modelNormals, channelMap
    C channel rise width    a raw light pulse, ticks of the object's 48 MHz clock, which wraps at 32 bits
    A sensor acode rise width_s angle lighthouse     libsurvive's own sweep angle [rad] from boresight; acode & 1: fan Y
    POSE x y z qw qx qy qz  libsurvive's own pose of the object's head in its world: a peer's estimate, not the truth
    LH_POSE (same)          libsurvive's pose of a station (the source is the station's number)

Other lines are not read. A photodiode is the index of its channel in channelMap. Lines that end early or have invalid
values are counted and skipped, because real recordings contain some; a file that is mostly such lines is rejected.
"""

import gzip
import math
import zlib
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.recordings.tracked_object import TrackedObject, read_config
from swarm.hardware import Photodiodes, pad

TICK_S = 1 / 48e6
"""Nominal tick of the objects' clocks [s]."""
_TOKENS = {"C": 6, "A": 9, "POSE": 10, "LH_POSE": 10}
_WRAP = 1 << 32


class PulseLog(NamedTuple):
    """N raw pulses in order of rise, (N,) each.

    time_s: time at which the host logged the pulse. photodiode: -1 for an unknown channel. rise_tick: unwrapped.
    width_tick: [ticks].
    """

    time_s: Floats
    photodiode: Ints
    rise_tick: Ints
    width_tick: Ints


class AngleLog(NamedTuple):
    """N sweeps as libsurvive decoded them, in the file's order, (N,) each.

    time_s: time at which the host logged the sweep. photodiode: index. fan: 0 for X, 1 for Y. lighthouse: libsurvive's
    number. middle_tick: middle of the pulse, unwrapped. angle_rad: angle from boresight.
    """

    time_s: Floats
    photodiode: Ints
    fan: Ints
    lighthouse: Ints
    middle_tick: Floats
    angle_rad: Floats


class WorldPose(NamedTuple):
    """A pose in libsurvive's world frame: position (..., 3) [m], quaternion (..., 4) wxyz, world from body."""

    position: Floats
    quaternion: Floats


class Recording(NamedTuple):
    """Data of one object of a recording.

    path: file. device: name of the object. photodiodes: its layout, a batch of one, in its own model frame. pulses,
    angles: its light. peer_time_s (N,), peer (N, ...): its `POSE` lines, as poses of the model frame. stations: last
    `LH_POSE` of each. damaged_lines: number of lines that could not be read.
    """

    path: Path
    device: str
    photodiodes: Photodiodes
    pulses: PulseLog
    angles: AngleLog
    peer_time_s: Floats
    peer: WorldPose
    stations: dict[int, WorldPose]
    damaged_lines: int


def read_libsurvive(path: str | Path, device: str) -> Recording:
    """Read the data of `device` (such as "HMD") from a recording, gzip or plain.

    Raises:
        SwarmError: the file is missing, truncated, damaged or no recording, or the device is not in it, or its CONFIG
            is missing or unusable; the message names file and line.
    """
    file = Path(path)
    reader = _Reader(file, device)
    number = 0
    try:
        for number, line in enumerate(_lines(file), 1):
            reader.read(line, number)
    except OSError as error:
        if isinstance(error, gzip.BadGzipFile):
            raise SwarmError(f"{file}: damaged gzip data after line {number} ({error})") from None
        raise SwarmError(f"{file}: {error.strerror or error}") from None
    except EOFError:
        raise SwarmError(f"{file}: truncated gzip file, it ends within line {number + 1}") from None
    except zlib.error as error:
        raise SwarmError(f"{file}: damaged gzip data after line {number} ({error})") from None
    return reader.recording(number)


def _lines(path: Path) -> Iterator[str]:
    with path.open("rb") as raw:
        packed = raw.read(2) == b"\x1f\x8b"
    with gzip.open(path, "rt", errors="replace") if packed else path.open(errors="replace") as text:
        yield from text


class _Reader:
    """Collector of the lines of one device; the number of the CONFIG line is kept for messages."""

    def __init__(self, path: Path, device: str) -> None:
        self._path, self._device = path, device
        self._config: tuple[int, str] | None = None
        self._devices: set[str] = set()
        self._good = self._damaged = 0
        self._last_tick: int | None = None
        self._pulses: list[tuple[float, ...]] = []
        self._angles: list[tuple[float, ...]] = []
        self._poses: list[tuple[float, ...]] = []
        self._stations: dict[int, tuple[float, ...]] = {}

    def read(self, line: str, number: int) -> None:
        head = line.split(None, 3)
        if not head:
            return
        try:
            if len(head) < 3:
                raise ValueError
            time_s = _finite(head[0])
            source, op = head[1], head[2]
            if op == "CONFIG" or op in _TOKENS:
                self._event(time_s, source, op, line, number)
        except ValueError:
            self._damaged += 1
        else:
            self._good += 1

    def _event(self, time_s: float, source: str, op: str, line: str, number: int) -> None:
        if op == "CONFIG":
            self._devices.add(source)
            if source == self._device:
                self._config = (number, line.split("CONFIG", 1)[1])
            return
        token = line.split()
        if len(token) != _TOKENS[op]:
            raise ValueError
        if op == "LH_POSE":
            self._stations[_within(int(source), 0, 16)] = _pose(token[3:])
            return
        self._devices.add(source)
        if source != self._device:
            return
        if op == "POSE":
            self._poses.append((time_s, *_pose(token[3:])))
        elif op == "C":
            channel, width = int(token[3]), _within(int(token[5]), 0, 1 << 31)
            self._pulses.append((time_s, channel, self._unwrap(token[4]), width))
        else:
            width_s, angle, lighthouse = _finite(token[6]), _finite(token[7]), _within(int(token[8]), 0, 2)
            if not (0 <= width_s < 1 and abs(angle) < math.pi / 2):
                raise ValueError
            # The file has the width rounded to microseconds; the effect on the middle is within half a tick.
            middle = self._unwrap(token[5]) + 0.5 * width_s / TICK_S
            self._angles.append(
                (time_s, _within(int(token[3]), 0, 1 << 15), int(token[4]) & 1, lighthouse, middle, angle)
            )

    def _unwrap(self, text: str) -> int:
        """Return the tick of a 32-bit counter that is nearest to the last one read."""
        tick = _within(int(text), 0, _WRAP)
        if self._last_tick is not None:
            tick = self._last_tick + (tick - self._last_tick + _WRAP // 2) % _WRAP - _WRAP // 2
        self._last_tick = tick
        return tick

    def recording(self, lines: int) -> Recording:
        """Return the collected data as arrays; raise SwarmError if they do not make a recording."""
        if not self._devices or self._damaged > self._good:
            raise SwarmError(
                f"{self._path}: not a libsurvive recording: of {lines} lines, "
                f"{self._damaged} do not read 'time_s source OP ...', and {len(self._devices)} objects appear"
            )
        if self._device not in self._devices:
            raise SwarmError(
                f"{self._path}: no object {self._device!r} in this recording{did_you_mean(self._device, self._devices)}"
            )
        if self._config is None:
            raise SwarmError(
                f"{self._path}: object {self._device!r} has no CONFIG line, so where its photodiodes sit is not known"
            )
        number, text = self._config
        tracked = read_config(text, f"{self._path}, line {number}: CONFIG of {self._device!r}")
        index = {channel: photodiode for photodiode, channel in enumerate(tracked.channels)}
        pulses = np.array(self._pulses, dtype=np.float64).reshape(-1, 4)
        pulses = pulses[np.argsort(pulses[:, 2], kind="stable")]
        angles = np.array([a for a in self._angles if a[1] < len(index)], dtype=np.float64).reshape(-1, 6)
        poses = np.array(self._poses, dtype=np.float64).reshape(-1, 8)
        return Recording(
            path=self._path,
            device=self._device,
            photodiodes=pad([tracked.point_m], [tracked.normal]),
            pulses=PulseLog(
                pulses[:, 0],
                np.array([index.get(int(channel), -1) for channel in pulses[:, 1]], dtype=np.int64),
                pulses[:, 2].astype(np.int64),
                pulses[:, 3].astype(np.int64),
            ),
            angles=AngleLog(
                angles[:, 0],
                angles[:, 1].astype(np.int64),
                angles[:, 2].astype(np.int64),
                angles[:, 3].astype(np.int64),
                angles[:, 4],
                angles[:, 5],
            ),
            peer_time_s=poses[:, 0],
            peer=_of_model(poses[:, 1:4], poses[:, 4:], tracked),
            stations={k: WorldPose(np.array(pose[:3]), np.array(pose[3:])) for k, pose in self._stations.items()},
            damaged_lines=self._damaged + len(self._angles) - len(angles),
        )


def _of_model(position: Floats, quaternion: Floats, tracked: TrackedObject) -> WorldPose:
    """Return poses of the model frame from poses of the head frame: (N, 3) [m] and (N, 4) wxyz."""
    head = rot.matrix_from_quaternion(quaternion)
    model = head @ tracked.head_rotation.T
    return WorldPose(position - model @ tracked.head_position, rot.quaternion_from_matrix(model))


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError
    return value


def _within(value: int, low: int, high: int) -> int:
    if not low <= value < high:
        raise ValueError
    return value


def _pose(token: list[str]) -> tuple[float, ...]:
    values = [_finite(text) for text in token]
    length = math.hypot(*values[3:])
    if abs(length - 1) > 1e-2:
        raise ValueError
    return tuple(chain(values[:3], (q / length for q in values[3:])))
