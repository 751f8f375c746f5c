"""Recordings of real lighthouse hardware by libsurvive: one event per line, `time_s source OP ...`.

    CONFIG json             the object: lighthouse_config.modelPoints [m], modelNormals, channelMap
    C channel rise width    a raw light pulse, ticks of the object's 48 MHz clock, which wraps at 32 bits
    A sensor acode rise width_s angle lighthouse     libsurvive's own sweep angle [rad] from boresight; acode & 1: fan Y
    POSE x y z qw qx qy qz  libsurvive's own pose of the object's head in its world: a peer's estimate, not the truth
    LH_POSE (same) [id]     libsurvive's pose of a station; the source is its number, or with an id its channel

Lines of Lighthouse 2.0 (Y, W, B) are in `rotor_lines`, those of gyroscope and accelerometer (I, i) in `imu_lines`.
Others are not read. A photodiode is the index of its channel in
channelMap. Lines that end early, have invalid values, contradict the object's clock or repeat an earlier one are
counted and left out, because real recordings contain some; a file that is mostly such lines is rejected.
"""

import math
from array import array
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.recordings import imu_lines
from swarm.flight.recordings.crazyflie import Inertial
from swarm.flight.recordings.line_values import as_rows, finite, in_order, keep_from, once, within
from swarm.flight.recordings.object_clock import TICK_S, WRAP, ObjectClock
from swarm.flight.recordings.rotor_light import RotorLog
from swarm.flight.recordings.rotor_lines import TOKENS, RotorLines
from swarm.flight.recordings.text_lines import TextLines
from swarm.flight.recordings.tracked_object import TrackedObject, read_config
from swarm.hardware import Photodiodes, pad

SECOND_GENERATION = tuple(TOKENS)
"""Operations of Lighthouse 2.0."""
MOST_DAMAGED = 100_000
"""Damaged lines beyond twice the good ones at which a file is given up before its end."""
MOST_NAMES = 1000
"""Names of objects that are kept for messages."""
_TOKENS = {"C": (6,), "A": (9,), "POSE": (10,), "LH_POSE": (10, 11), **TOKENS, **imu_lines.TOKENS}


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


class Losses(NamedTuple):
    """Parts of a file that could not be used.

    damaged: number of lines that could not be read, or contradict the object's clock. repeated: number of lines that
    were there before. restarts: of the object's counter. end: why and where the file ends early, empty where it does
    not. unplaced: whether inertial sensors were recorded of which CONFIG does not tell how they sit.
    """

    damaged: int
    repeated: int = 0
    restarts: int = 0
    end: str = ""
    unplaced: bool = False

    def sentences(self) -> list[str]:
        """Return a sentence for each kind of loss."""
        out = []
        if self.end:
            out.append(f"the recording is {self.end}: the rest of it is lost, all before is used")
        if self.damaged:
            out.append(f"damaged lines, left out: {self.damaged}")
        if self.repeated:
            out.append(f"lines that repeat an earlier one, left out: {self.repeated}")
        if self.restarts:
            out.append(f"restarts of the object's clock, bridged by the host's time: {self.restarts}")
        if self.unplaced:
            out.append("the gyroscope and accelerometer are left out: CONFIG does not tell how they sit in the object")
        return out


class Recording(NamedTuple):
    """Data of one object of a recording.

    path: file. device: name of the object. photodiodes: its layout, a batch of one, in its own model frame. pulses,
    angles: its light of Lighthouse 1.0. rotors: of 2.0. peer_time_s (N,), peer (N, ...): its `POSE` lines, as poses of
    the model frame. stations: last `LH_POSE` of each number, of lines without an id. stations_by_id: the same by id, of
    lines with one. inertial: gyroscope and accelerometer in the model frame, times in ticks; empty without. losses:
    parts of the file that could not be used.
    """

    path: Path
    device: str
    photodiodes: Photodiodes
    pulses: PulseLog
    angles: AngleLog
    rotors: RotorLog
    peer_time_s: Floats
    peer: WorldPose
    stations: dict[int, WorldPose]
    stations_by_id: dict[str, WorldPose]
    inertial: Inertial
    losses: Losses

    @property
    def damaged_lines(self) -> int:
        """Number of lines that could not be read."""
        return self.losses.damaged

    def station(self, lighthouse: int, identity: str | None = None) -> WorldPose | None:
        """Return the pose of a station, None if it is not known.

        The numbers of `LH_POSE` lines with an id are channels, not the numbers of `A` lines: they match by id only.

        Args:
            lighthouse: number of the station.
            identity: its id, as `station_id` returns it.
        """
        if identity in self.stations_by_id:
            return self.stations_by_id[identity]
        return self.stations.get(lighthouse)


class Forgotten(NamedTuple):
    """Ends of what a reader forgets [ticks]: zeros of rotors before one, other light before the other."""

    zeros: float
    hits: float


def station_id(text: str) -> str:
    """Return a station's id in one form: libsurvive writes the same 32 bits with and without a sign, and in hex."""
    word = text.strip().lower().removeprefix("lhb-")
    for base in (10, 16):
        try:
            return str(int(word, base) % WRAP)
        except ValueError:
            continue
    return word


def read_libsurvive(path: str | Path, device: str) -> Recording:
    """Read the data of `device` (such as "HMD") from a recording, gzip or plain, as far as they are good.

    Raises:
        SwarmError: the file is missing or no recording, or the device is not in it, or its CONFIG is missing or
            unusable; the message names file and line.
    """
    file = Path(path)
    reader = LibsurviveReader(file, device)
    lines = TextLines(file)
    for number, line in lines:
        reader.read(line, number)
    return reader.recording(lines.lost)


class LibsurviveReader:
    """Collector of the lines of one device; the number of the CONFIG line is kept for messages.

    clock: the device's. damaged: number of lines that could not be read.
    """

    def __init__(self, path: Path, device: str) -> None:
        """Begin without a line.

        Args:
            path: of the recording, for messages.
            device: name of the object.
        """
        self._path, self._device = path, device
        self._config: tuple[int, str] | None = None
        self._known: tuple[int, TrackedObject] | None = None
        self._devices: set[str] = set()
        self._good = self.damaged = self._lines = 0
        self.clock = ObjectClock(f"{path}: {device}")
        self._pulses, self._angles, self._poses = array("d"), array("d"), array("d")
        self._rotors = RotorLines(self.clock)
        self._imu = imu_lines.ImuLines(self.clock)
        self._stations: dict[int, tuple[float, ...]] = {}
        self._stations_by_id: dict[str, tuple[float, ...]] = {}

    def read(self, line: str, number: int) -> None:
        """Take the next line, number `number`; raise SwarmError where too many are damaged."""
        self._lines = number
        head = line.split(None, 3)
        try:
            if len(head) < 3:
                raise ValueError
            time_s = finite(head[0])
            source, op = head[1], head[2]
            if op == "CONFIG" or op in _TOKENS:
                self._event(time_s, source, op, line, number)
        except ValueError:
            self.damaged += 1
            if self.damaged > MOST_DAMAGED + 2 * self._good:
                raise self._no_recording() from None
        else:
            self._good += 1

    def _event(self, time_s: float, source: str, op: str, line: str, number: int) -> None:
        if op == "CONFIG":
            self._note(source)
            if source == self._device:
                self._config = (number, line.split("CONFIG", 1)[1])
            return
        token = line.split()
        if len(token) not in _TOKENS[op]:
            raise ValueError
        if op == "LH_POSE":
            place, pose = within(int(source), 0, 16), _pose(token[3:10])
            if len(token) > 10:
                self._stations_by_id[station_id(token[10])] = pose
            else:
                self._stations[place] = pose
            return
        self._note(source)
        if source != self._device:
            return
        if op == "POSE":
            self._poses.extend((time_s, *_pose(token[3:])))
        elif op == "C":
            self._pulse(time_s, token)
        elif op in SECOND_GENERATION:
            self._rotors.add(time_s, op, token)
        elif op in imu_lines.TOKENS:
            self._imu.add(time_s, op, token)
        else:
            self._angle(time_s, token)

    def _note(self, source: str) -> None:
        # Of a file that is all damage, the names are without end.
        if len(self._devices) < MOST_NAMES or source == self._device:
            self._devices.add(source)

    def _pulse(self, time_s: float, token: list[str]) -> None:
        channel, width = within(int(token[3]), -(1 << 15), 1 << 15), within(int(token[5]), 0, 1 << 31)
        rise = within(int(token[4]), 0, WRAP)
        self.clock.add(time_s, rise, lambda tick: self._pulses.extend((time_s, channel, tick, width)))

    def _angle(self, time_s: float, token: list[str]) -> None:
        photodiode, fan, rise = within(int(token[3]), 0, 1 << 15), int(token[4]) & 1, within(int(token[5]), 0, WRAP)
        width_s, angle, lighthouse = finite(token[6]), finite(token[7]), within(int(token[8]), 0, 2)
        if not (0 <= width_s < 1 and abs(angle) < math.pi / 2):
            raise ValueError
        # The file has the width rounded to microseconds; the effect on the middle is within half a tick.
        half = 0.5 * width_s / TICK_S
        self.clock.add(
            time_s,
            rise,
            lambda tick: self._angles.extend((time_s, photodiode, fan, lighthouse, tick + half, angle)),
        )

    def _no_recording(self, where: str = "") -> SwarmError:
        return SwarmError(
            f"{where or self._path}: not a libsurvive recording: of {self._lines} lines, "
            f"{self.damaged} do not read 'time_s source OP ...', and {len(self._devices)} objects appear"
        )

    def forget(self, ticks: Forgotten, before_s: float) -> None:
        """Forget what is older than asked, so that lines without end take bounded memory.

        Args:
            ticks: ends of what is forgotten of the light [ticks].
            before_s: of the object's poses [s].
        """
        keep_from(self._pulses, 4, 2, ticks.hits)
        keep_from(self._angles, 6, 4, ticks.hits)
        keep_from(self._poses, 8, 0, before_s)
        self._rotors.forget(ticks.zeros, ticks.hits)
        self._imu.forget(ticks.hits)

    def recording(self, lost: str = "", *, whole: bool = True) -> Recording:
        """Return the collected data as arrays.

        Args:
            lost: why and where the file ends early, empty where it does not.
            whole: whether all lines have been read; if more come, those in doubt wait for them.

        Raises:
            SwarmError: the lines do not make a recording of this device.
        """
        if whole:
            self.clock.close()
        tracked = self._tracked(lost)
        index = {channel: photodiode for photodiode, channel in enumerate(tracked.channels)}
        pulses, twice = once(as_rows(self._pulses, 4), (1, 2, 3))
        pulses = in_order(pulses, 2)
        angles, angles_twice = once(as_rows(self._angles, 6), (1, 2, 3, 4, 5))
        known = angles[:, 1] < len(index)
        unknown, angles = int(np.count_nonzero(~known)), angles[known]
        poses, poses_twice = once(as_rows(self._poses, 8), range(8))
        poses = in_order(poses, 0)
        rotors, rotors_unknown, rotors_twice = self._rotors.log(len(index))
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
            rotors=rotors,
            peer_time_s=poses[:, 0],
            peer=_of_model(poses[:, 1:4], poses[:, 4:], tracked),
            stations={k: _world(pose) for k, pose in self._stations.items()},
            stations_by_id={k: _world(pose) for k, pose in self._stations_by_id.items()},
            inertial=self._imu.inertial(tracked.imu),
            losses=Losses(
                self.damaged + self.clock.damaged + unknown + rotors_unknown,
                twice + angles_twice + poses_twice + rotors_twice,
                self.clock.restarts,
                lost,
                self._imu.any() and tracked.imu is None,
            ),
        )

    def _tracked(self, lost: str) -> TrackedObject:
        """Return the device; raise SwarmError if the lines do not make a recording of it."""
        where = f"{self._path}: {lost}" if lost else f"{self._path}"
        if not self._devices or self.damaged > self._good:
            raise self._no_recording(where)
        if self._device not in self._devices:
            raise SwarmError(
                f"{where}: no object {self._device!r} in this recording{did_you_mean(self._device, self._devices)}"
            )
        if self._config is None:
            raise SwarmError(
                f"{where}: object {self._device!r} has no CONFIG line, so where its photodiodes sit is not known"
            )
        number, text = self._config
        if self._known is None or self._known[0] != number:
            where = f"{self._path}, line {number}: CONFIG of {self._device!r}"
            self._known = number, read_config(text, where)
        return self._known[1]


def _world(pose: tuple[float, ...]) -> WorldPose:
    return WorldPose(np.array(pose[:3]), np.array(pose[3:]))


def _of_model(position: Floats, quaternion: Floats, tracked: TrackedObject) -> WorldPose:
    """Return poses of the model frame from poses of the head frame: (N, 3) [m] and (N, 4) wxyz."""
    head = rot.matrix_from_quaternion(quaternion)
    model = head @ tracked.head_rotation.T
    return WorldPose(position - model @ tracked.head_position, rot.quaternion_from_matrix(model))


def _pose(token: list[str]) -> tuple[float, ...]:
    values = [finite(text) for text in token]
    length = math.hypot(*values[3:])
    if abs(length - 1) > 1e-2:
        raise ValueError
    return tuple(chain(values[:3], (q / length for q in values[3:])))
