"""A libsurvive recording of an object at rest before two stations, written with libsurvive's own frames and formula."""

import gzip
import json
import math
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from estimators.arrays import Floats

TURN = 800_000
FRAMES = 12
BEGIN = 2**32 - 3_000_000
"""First X flash of station 1, slot 0 [ticks]: the 32-bit counter wraps in the second period."""
CHANNELS = [3, 1, 4, 0, 9, 5]
POINTS = np.array(
    [[0.09, 0.01, 0.03], [-0.08, 0.02, 0.04], [0.02, 0.08, 0.06], [0.01, -0.09, 0.05], [0.05, 0.05, 0.0], [0, 0, 0.1]]
)
NORMALS = np.array([[0, 0, 2.0]] * 6)
HEAD = (Rotation.from_euler("xyz", [20, -35, 100], degrees=True), np.array([0.01, 0.02, -0.04]))
"""Pose of the head in the model frame."""
STATIONS = {
    0: (Rotation.from_euler("xyz", [-50, 30, 5], degrees=True), np.array([1.2, 1.9, 1.6])),
    1: (Rotation.from_euler("xyz", [-35, -40, -3], degrees=True), np.array([-1.5, 1.6, 1.8])),
}
"""Poses of the stations in the world."""
MODEL = (Rotation.from_euler("zyx", [10, 5, -40], degrees=True), np.array([0.1, 0.2, -0.1]))
"""Pose of the object's model frame in the world."""
FCAL = {
    0: {
        "phase": (0.0586, 0.0622),
        "tilt": (0.0013, 0.0001),
        "curve": (-0.0019, -0.0036),
        "gibpha": (2.89, 0.024),
        "gibmag": (0.0047, -0.004),
    },
    1: {
        "phase": (0.0228, 0.0291),
        "tilt": (-0.0095, -0.0079),
        "curve": (0.0023, 0.0021),
        "gibpha": (1.81, -1.18),
        "gibmag": (0.0206, -0.0123),
    },
}


def survive_angle(station: int, fan: int, photodiode: int) -> float:
    """What libsurvive's station measures of the photodiode, from its boresight [rad]."""
    rotation, position = STATIONS[station]
    world = MODEL[0].apply(POINTS[photodiode]) + MODEL[1]
    x, y, z = rotation.inv().apply(world - position)
    z = -z
    assert z > 0.5
    fcal = {key: value[fan] for key, value in FCAL[station].items()}
    if fan == 0:
        along, across, other = math.atan2(x, z), y, math.atan2(y, z)
        a = math.pi / 2 - along - fcal["phase"]
    else:
        along, across, other = math.atan2(y, z), x, math.atan2(x, z)
        a = math.pi / 2 + along - fcal["phase"]
    a -= math.asin(fcal["tilt"] * across / math.hypot(x if fan == 0 else y, z))
    a -= fcal["gibmag"] * math.cos(fcal["gibpha"] + a)
    a += fcal["curve"] * other**2
    return a - math.pi / 2


def lines(drop_frames: tuple[int, ...] = ()) -> list[str]:
    """The recording's lines. drop_frames: periods of two turns in which the object saw nothing."""
    config = {
        "lighthouse_config": {
            "channelMap": CHANNELS,
            "modelPoints": POINTS.tolist(),
            "modelNormals": NORMALS.tolist(),
        },
        "head": {
            "plus_x": HEAD[0].as_matrix()[:, 0].tolist(),
            "plus_z": HEAD[0].as_matrix()[:, 2].tolist(),
            "position": HEAD[1].tolist(),
        },
    }
    out = ["0.000000 INFO LOG Recording", f"0.1 OBJ CONFIG {json.dumps(config)}", "0.2 OTH C 3 100 3000"]
    events: list[tuple[float, str]] = []
    for frame in range(FRAMES):
        if frame in drop_frames:
            continue
        for half in range(4):
            at, fan, station = BEGIN + frame * 2 * TURN + half * TURN // 2, half % 2, 1 if half < 2 else 0
            for which, flash in ((1, at), (0, at + 20_000)):
                width = 3000 + 500 * (fan | (0 if which == station else 4))
                events += [
                    (flash + 5 * i, f"C {c} {(flash + 5 * i) % 2**32} {width - 5 * i}") for i, c in enumerate(CHANNELS)
                ]
            for k, channel in enumerate(CHANNELS):
                angle = survive_angle(station, fan, k)
                middle = at + (20_000 if station == 0 else 0) + (angle / math.pi + 0.5) * TURN / 2
                rise = round(middle - 150)
                events.append((rise, f"C {channel} {rise % 2**32} 300"))
                width_s = 2 * (middle - rise) / 48e6
                events.append((rise, f"A {k} {fan | 4} {rise % 2**32} {width_s:.12f} {angle:.12f} {station}"))
    head = MODEL[0] * HEAD[0], MODEL[0].apply(HEAD[1]) + MODEL[1]
    pose = " ".join(f"{v:.9f}" for v in (*head[1], *np.roll(head[0].as_quat(), 1)))
    begin, end = int(events[0][0]), int(events[-1][0])
    events += [(tick, f"POSE {pose}") for tick in range(begin, end, 200_000)]
    # The host gets its data in bundles: not in order of rise.
    events.sort(key=lambda event: (event[0] // 10_000, event[1]))
    out += [f"{1 + (tick - BEGIN) / 48e6:.6f} OBJ {text}" for tick, text in events]
    for number, (rotation, position) in STATIONS.items():
        out.append(
            f"2.0 {number} LH_POSE " + " ".join(f"{v:.9f}" for v in (*position, *np.roll(rotation.as_quat(), 1)))
        )
    return out


def write(path: Path, text: list[str]) -> Path:
    """Write lines as a recording, packed if the name says so."""
    data = ("\n".join(text) + "\n").encode()
    path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)
    return path


def calibration_text() -> str:
    """libsurvive's calibration file of the two stations."""
    out = '"v":"0",\n"lighthousecount":"2"\n'
    for number, fcal in FCAL.items():
        rotation, position = STATIONS[number]
        table = {f"fcal{key}": [f"{v:.6f}" for v in values] for key, values in fcal.items()}
        table["pose"] = [f"{v:.9f}" for v in (*position, *np.roll(rotation.as_quat(), 1))]
        body = ",\n".join(f'"{key}":{json.dumps(value)}' for key, value in table.items())
        out += f'"lighthouse{number}":{{\n"index":"{number}",\n{body},\n"OOTXSet":"1",\n"PositionSet":"1"\n}}\n'
    return out


def in_our_frame(station: int) -> tuple[Floats, Floats]:
    """The object's pose in our lighthouse frame: (3, 3) and (3,) [m]."""
    flip = Rotation.from_euler("x", 180, degrees=True)
    rotation, position = STATIONS[station]
    to_ours = flip * rotation.inv()
    return (to_ours * MODEL[0]).as_matrix(), to_ours.apply(MODEL[1] - position)
