"""Simulated Lighthouse 2.0 light, recorded in libsurvive's format and replayed: is it the light that the craft had?

    python benchmarks/recorded_stations.py [--seconds 10] [--seed 1] [--keep FOLDER]

A craft wanders between two stations with the errors of real ones. Each hit whose channel its receiver tells is written
as a `W` line, and each rotor's zero that the hits' bits tell as a `Y` line, in ticks of 48 MHz; the stations' poses and
calibrations go beside it, as libsurvive has them. The recording is then replayed by the code of `swarm replay`. What is
printed: how many of the craft's own rows the replay decodes, by how much their angles differ, beside the noise of the
light, and the errors against the truth, on board and of the replay, with their mean NEES.
"""

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from harness import machine
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from stations import difference, nees

from estimators.arrays import Floats
from estimators.lighthouse.rotor import CHANNEL_TICKS
from estimators.lighthouse.rows import Station
from estimators.lighthouse.tilted import TiltedErrors
from swarm.flight.flight import Flight
from swarm.flight.recordings.object_light import read_object
from swarm.flight.station_replay import StationPlayback, choose_stations
from swarm.messages import BeamHits
from swarm.onboard.settings import Status
from swarm.onboard.stations import StationNavigator
from swarm.scenario import for_replay, load

TICK_HZ = 48e6
BEGIN_TICK, BEGIN_S = 1_000_000, 1.0
TURN_SHARE = 0.5
SAME_S = 1e-3
FROM_SURVIVE = np.diag([1.0, -1.0, -1.0])
SETTLED_S = 1.0
SCENARIO = """
duration_s = {seconds}
seed = {seed}

[navigation]
acceleration_noise_m_s2 = 1.0
angular_acceleration_noise_deg_s2 = 60.0

[swarm]
count = 0

[[craft]]
name = "walker"
model = "mockup"
motion = {{ kind = "wander", centre_m = [0.0, 0.0, 3.0] }}

[[station]]
name = "left"
position_m = [-1.5, -0.5, 0.0]
attitude = {{ towards_m = [0.0, 0.0, 3.0] }}
plane_1 = {{ tilt_rad = 0.047, curve = 0.15, gibbous_phase_rad = 2.37, gibbous_magnitude = -0.0044 }}
plane_2 = {{ phase_rad = -0.0074, tilt_rad = -0.046, ogee_phase_rad = 0.97, ogee_magnitude = -0.22 }}

[[station]]
name = "right"
position_m = [1.5, 0.3, 0.2]
attitude = {{ towards_m = [0.0, 0.0, 3.0] }}
plane_1 = {{ tilt_rad = 0.05, curve = -0.07, gibbous_phase_rad = 2.5, gibbous_magnitude = -0.0038 }}
plane_2 = {{ phase_rad = -0.0022, tilt_rad = -0.044, ogee_phase_rad = 1.6, ogee_magnitude = -0.19 }}
"""


class Flown(NamedTuple):
    """A flight: instants [s], true positions (N, 3) [m] and rotations, the craft's own status, errors [m] and NEES, and
    its light: hits and rows (station, fan, photodiode, instant [s], angle) of every period.
    """

    time_s: Floats
    position: Floats
    rotation: Rotation
    status: Floats
    error: Floats
    nees: Floats
    hits: list[BeamHits]
    rows: Floats


def fly(flight: Flight) -> Flown:
    """Fly, and keep the light that the craft received."""
    measure, hits, rows = flight.sensors.signals, [], []
    columns: list[list[float]] = []

    def kept(*given: Any) -> Any:
        signals = measure(*given)
        assert signals.beams is not None
        hits.append(signals.beams)
        return signals

    flight.sensors.signals = kept  # type: ignore[method-assign, assignment]
    navigator = flight.computer.navigator
    assert isinstance(navigator, StationNavigator)
    position, quaternion = [], []
    for period in flight.fly():
        truth, estimate, own = period.truth, period.estimate, navigator.rows.of(0)
        assert truth is not None
        position.append(truth.position[0])
        quaternion.append(np.roll(truth.quaternion[0], -1))
        error = difference(truth, estimate)[0]
        square = nees(error, estimate.covariance[0]) if np.isfinite(error).all() else np.nan
        columns.append([period.time_s, float(estimate.status[0]), float(np.linalg.norm(error[6:9])), square])
        rows.append(np.stack([own.station, own.fan, own.photodiode, own.offset_s + period.time_s, own.angle], axis=1))
    turns = Rotation.from_quat(quaternion)
    time_s, status, away, squares = np.array(columns).T
    return Flown(time_s, np.array(position), turns, status, away, squares, hits, np.concatenate(rows))


def write(folder: Path, flown: Flown, flight: Flight, stations: list[Station], tick_s: float) -> Path:
    """Write the light as a recording, with the stations' configuration beside it; return the file."""
    layout = flight.world.photodiodes.of(0)
    points = {
        "modelPoints": layout.point_m[0].tolist(),
        "modelNormals": layout.normal[0].tolist(),
        "channelMap": list(range(layout.point_m.shape[1])),
    }
    assert flight.sensors.stations is not None
    begin_s = float(flight.sensors.stations.clock_offset_tick[0]) * tick_s
    events: list[tuple[float, str]] = []
    zeros: dict[int, list[float]] = {}
    for hits in flown.hits:
        for i in range(int(hits.total[0])):
            channel = int(hits.channel[0, i])
            if channel == 0:
                continue
            middle = (hits.rise_tick[0, i] + hits.width_tick[0, i] / 2) * tick_s - begin_s
            zeros.setdefault(channel - 1, []).append(middle - hits.offset_tick[0, i] * tick_s)
            events.append((middle, f"W {channel - 1} {hits.photodiode[0, i]} {_tick(middle)} 0"))
    for channel, found in zeros.items():
        turn_s, at = CHANNEL_TICKS[channel] / TICK_HZ, np.sort(found)
        for turn in np.split(at, np.flatnonzero(np.diff(at) > TURN_SHARE * turn_s) + 1):
            events.append((float(turn.mean()), f"Y {channel} {_tick(float(turn.mean()))} 0 1"))
    file = folder / "simulated.rec"
    lines = [f"0.1 OBJ CONFIG {json.dumps({'lighthouse_config': points})}"]
    lines += [f"{BEGIN_S + at:.6f} OBJ {text}" for at, text in sorted(events)]
    file.write_text("\n".join(lines) + "\n")
    file.with_name("simulated.rec.json").write_text(configuration(stations, sorted(zeros)))
    return file


def _tick(time_s: float) -> int:
    return round(BEGIN_TICK + time_s * TICK_HZ)


def configuration(stations: list[Station], channels: list[int]) -> str:
    """Return libsurvive's configuration of the stations."""
    out = f'"v":"0",\n"lighthouse-gen":"2",\n"lighthousecount":"{len(stations)}"\n'
    for number, (station, channel) in enumerate(zip(stations, channels, strict=True)):
        errors = [fan.errors for fan in station.fans]
        assert all(isinstance(error, TiltedErrors) for error in errors)
        quaternion = np.roll(Rotation.from_matrix(station.rotation @ FROM_SURVIVE).as_quat(), 1)
        table = {
            "index": str(number),
            "id": str(1000 + number),
            "mode": str(channel),
            "pose": [f"{v:.9f}" for v in (*station.position, *quaternion)],
        }
        signs = (1, -1, 1, 1, 1, 1, 1)
        names = ("phase", "tilt", "curve", "gibpha", "gibmag", "ogeephase", "ogeemag")
        for name, sign, values in zip(names, signs, zip(*errors, strict=True), strict=True):
            table[f"fcal{name}"] = [f"{sign * v:.9f}" for v in values]
        table |= {"OOTXSet": "1", "PositionSet": "1"}
        body = ",\n".join(f'"{key}":{json.dumps(value)}' for key, value in table.items())
        out += f'"lighthouse{number}":{{\n{body}\n}}\n'
    return out


def main() -> None:
    """Fly, record, replay and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder that keeps the recording")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = given.keep or Path(made)
        folder.mkdir(parents=True, exist_ok=True)
        compare(*recorded(folder, given.seconds, given.seed))
    print(json.dumps(machine()))


def recorded(folder: Path, seconds: float, seed: int) -> tuple[Flown, Path, list[float]]:
    """Fly and write the recording; return the flight, the file, and the noise of each station's angles [rad]."""
    text = folder / "simulated.toml"
    text.write_text(SCENARIO.format(seconds=seconds, seed=seed))
    scenario = load(text)
    flight = Flight(scenario)
    navigator = flight.computer.navigator
    assert isinstance(navigator, StationNavigator)
    flown = fly(flight)
    file = write(folder, flown, flight, navigator.stations, scenario.lighthouse.tick_ns * 1e-9)
    return flown, file, [noise.own_rad for noise in navigator.noise]


def apart(own: Floats, read: Floats) -> Floats:
    """Return by how much angles [rad] differ from those read at the same instant.

    Args:
        own: (N, 2), instants [s] and angles [rad].
        read: (M, 2), likewise, in order of time.
    """
    after = np.searchsorted(read[:, 0], own[:, 0])
    beside = np.clip(np.stack([after - 1, after]), 0, len(read) - 1)
    away = np.abs(read[beside, 0] - own[:, 0])
    nearest = np.where(away[0] < away[1], *beside)
    out: Floats = (read[nearest, 1] - own[:, 1])[away.min(axis=0) < SAME_S]
    return out


def compare(flown: Flown, file: Path, noise_rad: list[float]) -> None:
    """Replay the recording and print what differs."""
    source = read_object(file, "OBJ")
    hits, channels = source.light.hits, source.light.stations()
    at_s = (hits.tick - BEGIN_TICK) / TICK_HZ
    differences = []
    for s, channel in enumerate(channels):
        for fan in (0, 1):
            for k in range(source.photodiodes.point_m.shape[1]):
                own = flown.rows[(flown.rows[:, 0] == s) & (flown.rows[:, 1] == fan) & (flown.rows[:, 2] == k)]
                read = (hits.station == channel) & (hits.fan == fan) & (hits.photodiode == k)
                if not len(own) or not read.any():
                    continue
                order = np.argsort(at_s[read])
                differences.append(apart(own[:, 3:], np.stack([at_s[read], hits.angle[read]], axis=1)[order]))
    off = np.concatenate(differences)
    print(
        f"light: {len(off)} of the craft's {len(flown.rows)} rows are in the replay, "
        f"{1e6 * np.sqrt(np.mean(off**2)):.1f} urad RMS apart, {1e6 * np.abs(off).max():.1f} at most; "
        f"noise of the light {1e6 * np.mean(noise_rad):.1f} urad"
    )
    playback = StationPlayback(source, for_replay(file), choose_stations(source, None, None), given=False)
    path, spline = CubicSpline(flown.time_s, flown.position), flown.rotation
    error, square, time_s = [], [], []
    for period in playback.fly():
        at = playback.begin_s + period.time_s - BEGIN_S
        estimate = period.estimate
        if estimate.status[0] != Status.TRACKING or not flown.time_s[0] <= at <= flown.time_s[-1]:
            continue
        after = int(np.clip(np.searchsorted(flown.time_s, at), 1, len(flown.time_s) - 1))
        share = (at - flown.time_s[after - 1]) / (flown.time_s[after] - flown.time_s[after - 1])
        step = (spline[after] * spline[after - 1].inv()).as_rotvec()
        true = Rotation.from_rotvec(share * step) * spline[after - 1]
        place = path(at) - estimate.position[0]
        turn = (true * Rotation.from_matrix(estimate.rotation[0]).inv()).as_rotvec()
        error.append(float(np.linalg.norm(place)))
        pose = np.concatenate([turn, np.zeros(3), place, np.zeros(3)])
        square.append(nees(pose, estimate.covariance[0]))
        time_s.append(at)
    settled, later = flown.time_s > SETTLED_S, np.array(time_s) > SETTLED_S
    tracking = settled & (flown.status == Status.TRACKING)
    for name, place, squares in (
        ("on board", flown.error[tracking], flown.nees[tracking]),
        ("replayed", np.array(error)[later], np.array(square)[later]),
    ):
        print(
            f"{name}: {len(place)} periods, {1e3 * np.median(place):.3f} mm median, "
            f"{1e3 * np.quantile(place, 0.9):.3f} for 90 %, "
            f"{1e3 * place.max():.3f} at most, NEES {np.mean(squares):.2f}"
        )
    print(*playback.notes, sep="\n")


if __name__ == "__main__":
    main()
