"""A synthetic room: stations of either generation, an object that moves or rests in it, and the sweeps that it sees."""

import json
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from estimators.arrays import Bools, Floats
from estimators.lighthouse.sweep import FanErrors, measured_angles
from estimators.lighthouse.tilted import TiltedErrors
from estimators.survey.problem import Rows, fans_of
from estimators.survey.terms import Errors

FIRST = (FanErrors(0.02, -0.001, 0.002, 1.0, 0.005), FanErrors(-0.03, 0.004, -0.002, 0.3, -0.004))
SECOND = (TiltedErrors(0.0, 0.05, 0.2, 2.1, -0.004, 1.2, -0.2), TiltedErrors(0.003, -0.05, 0.3, 1.0, 0.002, 0.8, -0.3))
POINT = 0.05 * np.array(
    [
        [1, 0, 0.3],
        [-1, 0.2, 0.4],
        [0.2, 1, 0.6],
        [0.1, -1, 0.5],
        [0.6, 0.6, 0],
        [0, 0, 1],
        [-0.7, -0.6, 0.1],
        [0.8, -0.5, 1],
    ]
)
"""Photodiodes of the object, (8, 3) [m]."""
PLANE = np.array([[-0.015, 0.0075, 0], [-0.015, -0.0075, 0], [0.015, 0.0075, 0], [0.015, -0.0075, 0]])
"""The same of a Crazyflie's deck."""


class Room(NamedTuple):
    """Stations: rotation (S, 3, 3) R_w_s, position (S, 3) [m], errors; all look at the middle of the room."""

    rotation: Floats
    position: Floats
    errors: tuple[tuple[Errors, Errors], ...]


def room(errors: tuple[tuple[Errors, Errors], ...]) -> Room:
    """Stations on a ring, 2 m high and 2.2 m from the middle, that look down to it, each a little rolled."""
    rotation, position = [], []
    for s in range(len(errors)):
        turn = 2 * np.pi * s / 3 + 0.3 * s
        place = np.array([2.2 * np.cos(turn), 2.2 * np.sin(turn), 2.0])
        ahead = -place / np.linalg.norm(place)
        down = np.array([0.0, 0.0, -1.0]) - ahead * -ahead[2]
        down /= np.linalg.norm(down)
        axes = np.column_stack([np.cross(down, ahead), down, ahead])
        rotation.append(axes @ Rotation.from_euler("z", 5 * s, degrees=True).as_matrix())
        position.append(place)
    return Room(np.array(rotation), np.array(position), errors)


def relative(found_rotation: Floats, found_position: Floats) -> tuple[Floats, Floats]:
    """Poses of all stations in the first one's frame."""
    turn = found_rotation[0].T
    return turn @ found_rotation, (found_position - found_position[0]) @ turn.T


def light(
    where: Room,
    rng: np.random.Generator,
    windows: int,
    own: float = 3e-5,
    shared: float = 4e-5,
    *,
    moving: bool = True,
    point: Floats = POINT,
    turns: int = 2,
) -> tuple[Rows, Bools]:
    """Rows of an object at random places within 0.7 m of the middle, its top up within 35 degrees.

    Args:
        where: the stations.
        rng: of places, motion and noise.
        windows: their number.
        own: noise of an angle of its own [rad].
        shared: noise that the angles of one sweep share [rad].
        moving: whether it moves at up to 0.5 m/s and 60 deg/s.
        point: (K, 3) [m].
        turns: sweeps of each fan in a window.
    """
    stations, count = len(where.position), len(point)
    columns: list[list[Floats]] = [[] for _ in range(8)]
    sweep = 0
    for w in range(windows):
        place = rng.uniform(-0.7, 0.7, 3) * [1, 1, 0.5]
        tilt = Rotation.from_rotvec(rng.normal(0, 0.35, 3) * [1, 1, 0]) * Rotation.from_euler("z", rng.uniform(0, 6.28))
        velocity, rate = moving * rng.normal(0, 0.25, 3), moving * rng.normal(0, 0.5, 3)
        for s in range(stations):
            for f in (0, 1):
                for n in range(turns):
                    tau = (
                        0.04 * (n - (turns - 1) / 2) / max(turns - 1, 1)
                        + 0.003 * f
                        + 0.002 * s
                        + 1e-4 * np.arange(count)
                    )
                    turn = Rotation.from_rotvec(rate * tau[:, None]) * tilt
                    world = place + velocity * tau[:, None] + turn.apply(point)
                    local = (world - where.position[s]) @ where.rotation[s]
                    angle = measured_angles(local, fans_of(where.errors[s]))[:, f]
                    angle = angle + rng.normal(0, own, count) + rng.normal(0, shared)
                    for column, value in zip(
                        columns,
                        (s, f, w, tau, angle, sweep, np.arange(count), 0),
                        strict=True,
                    ):
                        column.append(np.broadcast_to(np.asarray(value), (count,)))
                    sweep += 1
    joined = [np.concatenate(column) for column in columns]
    station, fan, window, tau, angle, number, photodiode, _ = joined
    whole = [part.astype(np.int64) for part in (station, fan, window, number, photodiode)]
    noise = np.ones(len(angle))
    rows = Rows(
        whole[0], whole[1], whole[2], point[whole[4]], tau, angle, own * noise, shared * noise, whole[3], whole[4]
    )
    return rows, np.full(windows, moving)


CHANNELS = (3, 11)
TICKS = {3: 949_000, 11: 911_000}
"""Duration of a turn [ticks of 48 MHz]."""
PLACE_S = 0.9
"""Time that the object of a recording rests at a place [s]."""


def resting_places(rng: np.random.Generator, count: int) -> list[tuple[Rotation, Floats]]:
    """Places within 0.7 m of the middle, at which the object's top is up within 35 degrees."""
    out = []
    for _ in range(count):
        tilt = Rotation.from_rotvec(rng.normal(0, 0.35, 3) * [1, 1, 0]) * Rotation.from_euler("z", rng.uniform(0, 6.28))
        out.append((tilt, rng.uniform(-0.7, 0.7, 3) * [1, 1, 0.5]))
    return out


def recording_lines(rooms: list[Room], places: list[tuple[Rotation, Floats]], noise: float = 2e-5) -> list[str]:
    """libsurvive's lines of an object that rests at one place after the other before two Lighthouse 2.0 stations.

    Args:
        rooms: the stations while it rests at each place.
        places: attitude and position of the object.
        noise: of an angle [rad].
    """
    rng = np.random.default_rng(11)
    table = {
        "modelPoints": POINT.tolist(),
        "modelNormals": [[0, 0, 1]] * len(POINT),
        "channelMap": list(range(len(POINT))),
    }
    events: list[tuple[float, str]] = []
    for s, channel in enumerate(CHANNELS):
        turn = TICKS[channel]
        zeros = np.arange(50_000 * (s + 1), len(places) * PLACE_S * 48e6, turn)
        events += [(at, f"Y {channel} {round(at)} 0 1") for at in zeros.tolist()]
        for at in zeros.tolist():
            n = min(int(at / (PLACE_S * 48e6)), len(places) - 1)
            attitude, place = places[n]
            where = rooms[n]
            local = (attitude.apply(POINT) + place - where.position[s]) @ where.rotation[s]
            angles = measured_angles(local, fans_of(where.errors[s])) + rng.normal(0, noise, (len(POINT), 2))
            share = (angles + np.pi + np.array([-1, 1]) * np.pi / 3) / (2 * np.pi)
            for k, f in np.ndindex(share.shape):
                tick = at + turn * share[k, f]
                events.append((tick, f"W {channel} {k} {round(tick)} 0"))
    events.sort(key=lambda event: event[0])
    head = [f"0.1 OBJ CONFIG {json.dumps({'lighthouse_config': table})}"]
    return head + [f"{1 + tick / 48e6:.6f} OBJ {text}" for tick, text in events]


def configuration(where: Room) -> str:
    """libsurvive's configuration with the calibration of the stations, and no pose."""
    keys = ("fcalphase", "fcaltilt", "fcalcurve", "fcalgibpha", "fcalgibmag", "fcalogeephase", "fcalogeemag")
    tables = {}
    for s, channel in enumerate(CHANNELS):
        columns = zip(*where.errors[s], strict=True)
        values = {
            key: [repr(-float(x) if key == "fcaltilt" else float(x)) for x in column]
            for key, column in zip(keys, columns, strict=True)
        }
        head = {"index": str(s), "id": str(1000 + s), "mode": str(channel), "OOTXSet": "1"}
        tables[f"lighthouse{s}"] = {**head, **values}
    return json.dumps(tables)
