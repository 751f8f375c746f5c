"""All light of one object of a recording, in one form whatever wrote the file, with what is known of the stations.

    libsurvive, Lighthouse 1.0    raw pulses, decoded station by station as on board, or libsurvive's own angles
    libsurvive, Lighthouse 2.0    raw hits and the rotors' zeros, or libsurvive's own angles
    Crazyflie                     raw pulses where they tell all, else the firmware's angles

World frame: that of the stations' poses. A station's axes are ours, x to the right, y down, z ahead, as it looks.
libsurvive's look along -z with y up, Bitcraze's along x with z up:

    R_w_s = R_survive diag(1, -1, -1),    R_w_s = R_bitcraze T,    T = [0 0 1; -1 0 0; 0 -1 0]
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lighthouse.sweep import FanErrors, from_libsurvive
from estimators.lighthouse.tilted import TiltedErrors, from_station
from swarm.errors import SwarmError
from swarm.flight.recordings.crazyflie import NORMAL, POINT_M, CrazyflieLog, Inertial, read_crazyflie
from swarm.flight.recordings.formats import Format, format_of
from swarm.flight.recordings.hits import Hits, Light, Lost, joined
from swarm.flight.recordings.libsurvive import Recording, WorldPose, read_libsurvive
from swarm.flight.recordings.libsurvive_config import FactoryStation, read_factory_stations
from swarm.flight.recordings.object_clock import TICK_S
from swarm.flight.recordings.pulse_light import PulseLight, own_angles
from swarm.flight.recordings.rotor_light import FRAME_HZ, decode_rotor_log
from swarm.flight.recordings.station_terms import SweepTerms
from swarm.flight.recordings.stations_file import PlacedStation
from swarm.flight.recordings.sweep_instants import timed
from swarm.flight.recordings.system_config import ConfiguredStation, SystemConfig, config_beside
from swarm.flight.recordings.windows import Source
from swarm.hardware import Photodiodes, pad

_FROM_SURVIVE = np.diag([1.0, -1.0, -1.0])
_FROM_BITCRAZE = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
CRAZYFLIE = "Crazyflie"
"""Name of the object in an event log."""


Pair = tuple[FanErrors, FanErrors] | tuple[TiltedErrors, TiltedErrors]
"""Errors of a station's two fans."""


class ObjectLight(NamedTuple):
    """Light of one object and what is known beside it.

    path: the file. name: of the object. photodiodes: its layout, a batch of one. light: hits of all stations. time_0_s,
    time_1: the recording's clock, time_s = time_0_s + time_1 tick. placed: stations of which a pose is known, by
    number. errors: of the fans of stations whose calibration is known, by number. identities: ids of stations, by
    number. peer_time_s (N,), peer (N, ...): the recording's own poses of the object in the stations' world, on its
    clock. inertial: empty without. marks_s: marks on the recording's clock, which a motion capture system sees too.
    notes: sentences about what is lost or taken. recording: libsurvive's, of which this is; None for another.
    """

    path: Path
    name: str
    photodiodes: Photodiodes
    light: Light
    time_0_s: float
    time_1: float
    placed: dict[int, PlacedStation]
    errors: dict[int, Pair]
    identities: dict[int, str]
    peer_time_s: Floats
    peer: WorldPose
    inertial: Inertial
    marks_s: Floats
    notes: list[str]
    recording: Recording | None = None

    def time_s(self, tick: Floats) -> Floats:
        """Return instants on the recording's clock [s] of ticks, any shape."""
        out: Floats = self.time_0_s + self.time_1 * np.asarray(tick)
        return out


def read_object(
    path: str | Path,
    name: str | None,
    source: Source = "pulses",
    calibration: str | Path | None = None,
    recording: Recording | None = None,
) -> ObjectLight:
    """Return the light of one object.

    Args:
        path: libsurvive's recording or a Crazyflie's event log.
        name: of the object; a log has only one.
        source: raw "pulses", or the "angles" that the recording's own software derived from them.
        calibration: libsurvive's configuration; None: that beside the recording, FILE.json, if it is there. A log's
            system-config.yaml beside it is always taken.
        recording: libsurvive's recording of this object, where it has been read already.

    Raises:
        SwarmError: a file cannot be read, or the object is not in it.
    """
    file = Path(path)
    if format_of(file) is Format.CRAZYFLIE:
        if name not in (None, CRAZYFLIE):
            raise SwarmError(f"{file}: no object {name!r} in this log: its only one is {CRAZYFLIE!r}")
        return _of_crazyflie(read_crazyflie(file), config_beside(file), source)
    if name is None:
        raise SwarmError(f"{file}: which object?")
    recording = read_libsurvive(file, name) if recording is None else recording
    return object_of(recording, source, calibration if calibration is not None else configuration_beside(file))


def object_of(recording: Recording, source: Source = "pulses", calibration: str | Path | None = None) -> ObjectLight:
    """Return the light of a libsurvive recording's object.

    Args:
        recording: of the object.
        source: raw "pulses" or "angles", as in `read_object`.
        calibration: libsurvive's configuration; None: none.

    Raises:
        SwarmError: the configuration cannot be read, or there is no light.
    """
    notes = recording.losses.sentences()
    stations = []
    if calibration is not None:
        stations = read_factory_stations(calibration)
        notes.append(f"the stations' poses and calibrations are those of {calibration}")
    second = saw_second(recording)
    light = second_light(recording, source) if second else _first(recording, source)
    notes += light.lost.sentences()
    line = _line(recording, second)
    placed, errors = _placed(recording, stations, light, second)
    numbers = {number: s.identity for s in stations if (number := s.channel if second else s.number) is not None}
    return ObjectLight(
        path=recording.path,
        name=recording.device,
        photodiodes=recording.photodiodes,
        light=light,
        time_0_s=line[0],
        time_1=line[1],
        placed=placed,
        errors=errors,
        identities={number: identity for number, identity in numbers.items() if identity is not None},
        peer_time_s=recording.peer_time_s,
        peer=recording.peer,
        inertial=recording.inertial._replace(time_s=line[0] + line[1] * recording.inertial.time_s),
        marks_s=np.zeros(0),
        notes=notes,
        recording=recording,
    )


def saw_second(recording: Recording) -> bool:
    """Return whether the object's light is of Lighthouse 2.0."""
    return recording.rotors.any() and not (len(recording.pulses.rise_tick) or len(recording.angles.middle_tick))


def configuration_beside(file: Path) -> Path | None:
    """Return libsurvive's configuration beside a recording, None if it is not there."""
    config = file.with_name(f"{file.name}.json")
    return config if config.is_file() else None


def _line(recording: Recording, second: bool) -> tuple[float, float]:
    """Return the host's time as a straight line of the object's ticks: the host logs events late and irregularly."""
    pulses, angles, rotors = recording.pulses, recording.angles, recording.rotors
    if second:
        tick, time_s = rotors.hit_tick, rotors.hit_time_s
        if not len(tick):
            tick, time_s = rotors.own_tick, rotors.own_time_s
    else:
        tick = np.concatenate([pulses.rise_tick, angles.middle_tick])
        time_s = np.concatenate([pulses.time_s, angles.time_s])
    if len(tick) < 2 or np.ptp(tick) == 0:
        return (float(time_s[0] - tick[0] * TICK_S) if len(tick) else 0.0), TICK_S
    offset, slope = np.polynomial.Polynomial.fit(tick, time_s, 1).convert().coef
    return float(offset), float(slope)


def second_light(recording: Recording, source: Source) -> Light:
    """Return light of Lighthouse 2.0; raise SwarmError where there is none."""
    log = recording.rotors
    decoded = decode_rotor_log(log)
    if source == "pulses" and len(decoded.hits.tick):
        return decoded
    own = joined([Hits(log.own_channel, log.own_plane, log.own_photodiode, log.own_tick, log.own_angle)])
    if not len(own.tick):
        what = "hit with its rotor's zero (W and Y lines)" if source == "pulses" else "angle (B lines)"
        raise SwarmError(f"{recording.path}: no {what} of {recording.device!r}")
    return Light("2.0", TICK_S, own, Lost(), decoded.turn_s)


def _first(recording: Recording, source: Source) -> Light:
    """Return light of Lighthouse 1.0."""
    hits = own_angles(recording) if source == "angles" else PulseLight().decode(recording)
    if not len(hits.tick):
        what = "raw pulses (C lines)" if source == "pulses" else "sweep angles (A lines)"
        raise SwarmError(f"{recording.path}: no period of a station among the {what} of {recording.device!r}")
    return Light("1.0", TICK_S, hits, Lost(), {})


def _placed(
    recording: Recording, stations: list[FactoryStation], light: Light, second: bool
) -> tuple[dict[int, PlacedStation], dict[int, Pair]]:
    """Return the stations whose pose is known, and the errors of those whose calibration is, by number.

    Args:
        recording: of the object.
        stations: of the configuration, none without one.
        light: the object's.
        second: whether the stations are of Lighthouse 2.0, whose number is the channel.
    """
    generation = "2.0" if second else "1.0"
    placed: dict[int, PlacedStation] = {}
    known: dict[int, Pair] = {}
    for station in stations:
        number = station.channel if second else station.number
        if number is None:
            continue
        if station.terms is not None:
            known[number] = _errors(station.terms, generation)
        pose = station.pose or recording.station(station.number, station.identity)
        if pose is not None:
            errors = _errors(station.terms, generation)
            placed[number] = _station(number, generation, pose, errors, station.identity)
    if not stations:
        # Lines without a configuration: their number is that of `A` lines, of Lighthouse 2.0 it tells no channel.
        for number, pose in recording.stations.items():
            if not second and number in light.stations():
                placed[number] = _station(number, generation, pose, _errors(None, generation), None)
    return placed, known


def _station(number: int, generation: str, pose: WorldPose, errors: Pair, identity: str | None) -> PlacedStation:
    rotation = rot.matrix_from_quaternion(pose.quaternion) @ _FROM_SURVIVE
    return PlacedStation(_name(number, generation), number, generation, identity, rotation, pose.position, errors)


def _name(number: int, generation: str) -> str:
    return f"channel {number}" if generation == "2.0" else f"station {number}"


def _errors(terms: tuple[SweepTerms, SweepTerms] | None, generation: str) -> Pair:
    """Return a station's errors in our form; none without terms."""
    if generation == "2.0":
        if terms is None:
            return TiltedErrors(), TiltedErrors()
        first, second = (from_station(*term) for term in terms)
        return first, second
    if terms is None:
        return FanErrors(), FanErrors()
    phase, tilt, curve, gibbous_phase, gibbous_magnitude = ((a, b) for a, b in list(zip(*terms, strict=True))[:5])
    return from_libsurvive(phase, tilt, curve, gibbous_phase, gibbous_magnitude)


def _of_crazyflie(log: CrazyflieLog, config: SystemConfig | None, source: Source) -> ObjectLight:
    """Return the light of an event log."""
    notes = [f"the log is {log.lost}: the rest of it is lost, all before is used"] if log.lost else []
    notes += [f"events with impossible values, left out: {log.damaged}"] if log.damaged else []
    generation = config.generation if config is not None else "2.0" if log.has_rotors() else "1.0"
    if log.has_rotors() and source == "pulses":
        light = log.light(generation)
        notes += light.lost.sentences()
    else:
        found = timed(log.angles, 1e-6, log.frames) if generation == "1.0" else None
        if found is None:
            light = Light(generation, 1e-6, log.angles, Lost(), {})
        else:
            light = Light(generation, found.tick_s, found.hits, Lost(), {})
            notes += [f"angles that were logged before, left out: {found.repeated}"] if found.repeated else []
            notes += [f"angles without a pulse, left out: {found.untimed}"] if found.untimed else []
            notes += [f"angles of which only the pulses were logged, taken: {found.added}"] if found.added else []
            if not found.exact and len(log.angles.tick):
                notes.append("the angles have the times at which they were logged, some milliseconds late")
    if not len(light.hits.tick):
        raise SwarmError(f"{log.path}: no sweep angle is in this log")
    slope, offset = light.tick_s, 0.0
    if light.tick_s == 1 / FRAME_HZ:
        # The receiver's clock agrees with the stations', the logger's does not: only its zero is taken over.
        offset = float(np.median(log.frames.time_s[:100] - log.frames.tick[:100] / FRAME_HZ))
    placed: dict[int, PlacedStation] = {}
    known: dict[int, Pair] = {}
    identities: dict[int, str] = {}
    if config is not None:
        notes.append(f"the stations' poses and calibrations are those of {config.path}")
        for number, station in config.stations.items():
            if station.identity is not None:
                identities[number] = station.identity
            if station.terms is not None:
                known[number] = _errors(station.terms, generation)
            if station.position is not None and station.rotation is not None:
                placed[number] = _configured(number, generation, station)
    nothing = np.zeros((0, 3)), np.zeros((0, 4))
    return ObjectLight(
        path=log.path,
        name=CRAZYFLIE,
        photodiodes=pad([POINT_M], [NORMAL]),
        light=light,
        time_0_s=offset,
        time_1=slope,
        placed=placed,
        errors=known,
        identities=identities,
        peer_time_s=np.zeros(0),
        peer=WorldPose(*nothing),
        inertial=log.inertial._replace(time_s=_on_the_clock(log, log.inertial.time_s, offset, slope)),
        marks_s=_on_the_clock(log, log.mark_s, offset, slope),
        notes=notes,
    )


def _on_the_clock(log: CrazyflieLog, time_s: Floats, offset: float, slope: float) -> Floats:
    """Return times of a log's events on the clock of its light."""
    if slope != 1 / FRAME_HZ or not len(log.frames.tick):
        return time_s
    out: Floats = offset + slope * np.interp(time_s, log.frames.time_s, log.frames.tick)
    return out


def _configured(number: int, generation: str, station: ConfiguredStation) -> PlacedStation:
    assert station.rotation is not None
    assert station.position is not None
    # The nearest rotation: files have rounded estimates.
    rotation = rot.mean_rotation((station.rotation @ _FROM_BITCRAZE)[None])
    errors = _errors(station.terms, generation)
    return PlacedStation(
        _name(number, generation) if generation == "1.0" else f"station {number}",
        number,
        generation,
        station.identity,
        rotation,
        station.position,
        errors,
    )
