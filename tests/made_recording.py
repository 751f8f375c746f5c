"""A recording in libsurvive's format of an object that is moved by hand before two simulated stations.

    python tests/made_recording.py scenarios/recordings

writes handheld.rec.gz and its calibration, handheld.json, which the package contains. Tests make others, with faults.
"""

import gzip
import json
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from synthetic_recording import FCAL, STATIONS, calibration_text

from estimators.arrays import Floats
from estimators.lighthouse.sweep import FanPair, from_libsurvive, measured_theta

TICK_S = 1 / 48e6
TURN_S = 1 / 60
BEGIN_TICK = 2**32 - 5 * 48_000_000
FLIP = np.diag([1.0, -1.0, -1.0])
DEVICE = "WAND"
RADIUS_M = 0.07
PHASES = np.array([0.0, 2.0, 4.0])
IMU_TURN, IMU_AT_M = Rotation.from_rotvec([0.4, -1.1, 2.0]), np.array([0.03, -0.05, 0.02])
GYRO_BIAS, FORCE_BIAS = np.array([0.02, -0.01, 0.015]), np.array([0.4, -1.9, 0.1])
G_M_S2 = 9.80665


class Made(NamedTuple):
    """What a recording is made with.

    duration_s: length [s]. own_rad, rotor_rad: noise of an angle of one photodiode, and common to a sweep. misplaced_m:
    1 sigma of a photodiode's place. liar: (photodiode, fan, angle [rad]) of a constant reflection that it sees in place
    of station 0's direct light. echo: share of the sweeps of station 0 in which a photodiode sees a second pulse, some
    milliradians off. imu: operation of the lines of a gyroscope and accelerometer, "i" for counts, "I" for g and rad/s;
    empty for none. Their biases are in CONFIG, but for a tenth.
    """

    duration_s: float = 15.0
    own_rad: float = 30e-6
    rotor_rad: float = 20e-6
    misplaced_m: float = 1e-4
    liar: tuple[int, int, float] | None = None
    echo: float = 0.0
    imu: str = ""


def layout() -> Floats:
    """Directions of the 20 photodiodes: the corners of a dodecahedron, (20, 3)."""
    g = (1 + 5**0.5) / 2
    corners = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    corners += [np.roll([0, a / g, b * g], shift).tolist() for a in (-1, 1) for b in (-1, 1) for shift in range(3)]
    return np.array(corners) / 3**0.5


def pose(time_s: Floats | float) -> tuple[Rotation, Floats]:
    """The object's true poses in the world: rotations, and positions (..., 3) [m]."""
    sway = 2 * np.pi * np.array([0.12, 0.09, 0.07]) * np.asarray(time_s, dtype=np.float64)[..., None]
    vector = np.array([0.5, 0.4, 0.9]) * np.sin(sway + np.array([0.3, 1.1, 2.0]))
    return Rotation.from_rotvec(vector), np.array([0.1, 0.2, -0.1]) + 0.15 * np.sin(1.3 * sway + PHASES)


def in_station(station: int, vectors: Floats, time_s: Floats) -> tuple[Floats, Floats]:
    """Points of the object (K, 3) at an instant each (K,), and the same vectors only turned, in our station's frame."""
    rotation, position = pose(time_s)
    station_rotation, station_position = STATIONS[station]
    to_ours = FLIP @ station_rotation.inv().as_matrix()
    turned = rotation.apply(vectors)
    return (turned + position - station_position) @ to_ours.T, turned @ to_ours.T


def sweep(station: int, fan: int, points_m: Floats, flash_s: float, errors: FanPair) -> tuple[Floats, Floats]:
    """Angles (K,) [rad] at which the fan meets the photodiodes on their way, and which of them it lights (K,)."""
    theta = np.full(len(points_m), np.pi / 2)
    for _ in range(4):
        points, _ = in_station(station, points_m, flash_s + theta / (2 * np.pi) * TURN_S)
        theta = measured_theta(points, errors)[:, fan]
    _, normals = in_station(station, layout(), flash_s + theta / (2 * np.pi) * TURN_S)
    return theta, -np.sum(points * normals, axis=1) > 0.3 * np.linalg.norm(points, axis=1)


def true_in_station(station: int, time_s: Floats) -> tuple[Floats, Floats]:
    """The object's true poses in our frame of the station: rotations (N, 3, 3), positions (N, 3) [m]."""
    rotation, position = pose(time_s)
    station_rotation, station_position = STATIONS[station]
    to_ours = FLIP @ station_rotation.inv().as_matrix()
    return to_ours @ rotation.as_matrix(), (position - station_position) @ to_ours.T


HANDHELD = Made()


def lines(made: Made = HANDHELD, seed: int = 3) -> list[str]:
    """The recording's lines."""
    rng = np.random.default_rng(seed)
    directions = layout()
    points = RADIUS_M * directions
    true_points = points + rng.normal(0, made.misplaced_m, points.shape)
    config = {
        "lighthouse_config": {
            "channelMap": list(range(len(points))),
            "modelPoints": points.round(6).tolist(),
            "modelNormals": directions.round(6).tolist(),
        }
    }
    if made.imu:
        config["imu"] = imu_config()
    out = ["0.000000 INFO LOG Recording, simulated", f"0.1 {DEVICE} CONFIG {json.dumps(config)}"]
    out += [f"0.2 {n} LH_POSE {_numbers(rotation, position)}" for n, (rotation, position) in STATIONS.items()]
    errors = {n: from_libsurvive(f["phase"], f["tilt"], f["curve"], f["gibpha"], f["gibmag"]) for n, f in FCAL.items()}
    for half in range(round(made.duration_s / TURN_S * 2)):
        out += _half_turn(made, rng, true_points, half, BEGIN_TICK, errors)
    if made.imu:
        out += inertial_lines(made)
        out[2:] = sorted(out[2:], key=lambda line: float(line.split(None, 1)[0]))
    return out


def moved(time_s: Floats, d: float = 1e-3) -> tuple[Floats, Floats, Floats]:
    """Rates and accelerations of rates in the body frame, and the origin's specific force there, (N, 3) each."""

    def rate(at: Floats) -> Floats:
        before, after = pose(at - d)[0], pose(at + d)[0]
        turned: Floats = (before.inv() * after).as_rotvec() / (2 * d)
        return turned

    push = (pose(time_s + d)[1] - 2 * pose(time_s)[1] + pose(time_s - d)[1]) / d**2
    force = pose(time_s)[0].inv().apply(push + np.array([0.0, 0.0, G_M_S2]))
    return rate(time_s), (rate(time_s + d) - rate(time_s - d)) / (2 * d), force


def imu_config() -> dict[str, list[float]]:
    """What CONFIG tells of the gyroscope and accelerometer."""
    axes = IMU_TURN.as_matrix()
    return {
        "plus_x": axes[:, 0].tolist(),
        "plus_z": axes[:, 2].tolist(),
        "position": IMU_AT_M.tolist(),
        "gyro_bias": (0.9 * GYRO_BIAS).tolist(),
        "acc_bias": (0.9 * FORCE_BIAS).tolist(),
    }


def inertial_lines(made: Made) -> list[str]:
    """The lines of the gyroscope and accelerometer, 250 a second."""
    time_s = np.arange(0.0, made.duration_s, 0.004)
    rate, faster, force = moved(time_s)
    there = force + np.cross(faster, IMU_AT_M) + np.cross(rate, np.cross(rate, IMU_AT_M))
    shown = np.hstack([IMU_TURN.inv().apply(there) + FORCE_BIAS, IMU_TURN.inv().apply(rate) + GYRO_BIAS])
    shown[:, :3] /= G_M_S2
    if made.imu == "i":
        shown = np.round(shown * np.repeat([4096.0, 32768 / np.radians(2000.0)], 3))
    out = []
    for number, (at_s, row) in enumerate(zip(time_s.tolist(), shown.tolist(), strict=True)):
        words = " ".join(f"{value:.6f}" for value in (*row, 0.0, 0.0, 0.0))
        tick = (BEGIN_TICK + round(at_s / TICK_S)) % 2**32
        out.append(f"{1 + at_s:.6f} {DEVICE} {made.imu} 3 {tick} {words} {number}")
    return out


def _half_turn(
    made: Made, rng: np.random.Generator, points_m: Floats, half: int, begin: int, errors: dict[int, FanPair]
) -> list[str]:
    """The lines of half a turn: two flashes, one sweep, and the peer's pose."""
    fan, station = half % 2, 1 if half % 4 < 2 else 0
    at_s = half * TURN_S / 2
    flash_s = at_s + (20_000 * TICK_S if station == 0 else 0.0)
    theta, lit = sweep(station, fan, points_m, flash_s, errors[station])
    theta = theta + rng.normal(0, made.own_rad, theta.shape) + rng.normal(0, made.rotor_rad)
    if made.liar is not None and station == 0 and fan == made.liar[1]:
        theta[made.liar[0]] += made.liar[2]
    events: list[tuple[int, str]] = []
    slow_data = rng.integers(0, 2, 2)
    seen = np.flatnonzero(np.asarray(lit, bool) | (rng.random(len(lit)) < 0.1))
    for which, first_s in ((1, at_s), (0, at_s + 20_000 * TICK_S)):
        code = fan | 2 * slow_data[which] | (0 if which == station else 4)
        for k in seen:
            late = int(rng.integers(0, 6))
            rise = begin + round(first_s / TICK_S) + late
            events.append((rise, f"C {k} {rise % 2**32} {3000 + 500 * code - 2 * late}"))
    for k in np.flatnonzero(lit):
        width = int(rng.integers(150, 400))
        pulses = [theta[k]]
        if made.echo and station == 0 and rng.random() < made.echo:
            pulses.append(theta[k] + rng.choice([-1, 1]) * rng.uniform(15e-3, 40e-3))
        for angle in pulses:
            rise = begin + round((flash_s + angle / (2 * np.pi) * TURN_S) / TICK_S - width / 2)
            events.append((rise, f"C {k} {rise % 2**32} {width}"))
            text = f"A {k} {fan} {rise % 2**32} {width * TICK_S:.9f} {angle - np.pi / 2:.6f} {station}"
            events.append((rise, text))
    rotation, position = pose(at_s)
    # The peer is good to a millimetre.
    peer = _numbers(rotation, position + rng.normal(0, 6e-4, 3))
    out = [(rise + int(rng.exponential(48_000)), text) for rise, text in sorted(events)]
    out.append((begin + round(at_s / TICK_S), f"POSE {peer}"))
    return [f"{1 + (tick - begin) * TICK_S:.6f} {DEVICE} {text}" for tick, text in sorted(out)]


def _numbers(rotation: Rotation, position: Floats) -> str:
    return " ".join(f"{v:.6f}" for v in (*position, *np.roll(rotation.as_quat(), 1)))


def write(path: Path, text: list[str]) -> Path:
    """Write lines as a packed recording, the same bytes every time."""
    path.write_bytes(gzip.compress(("\n".join(text) + "\n").encode(), 9, mtime=0))
    return path


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    write(folder / "handheld.rec.gz", lines())
    (folder / "handheld.json").write_text(calibration_text())
