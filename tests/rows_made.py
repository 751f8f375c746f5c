"""Rows of made rooms: stations of either generation about a craft, and what they see of it."""

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats
from estimators.lighthouse.innovation import RowBatch, gathered
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import Rows, Station
from estimators.lighthouse.sweep import FanErrors, lighthouse_1, lighthouse_2, measured_angles
from estimators.lighthouse.tilted import TiltedErrors
from estimators.rotation import exp
from estimators.state import State

FIRST = lighthouse_1(FanErrors(0.05, -0.002, -0.003, 1.0, 0.004), FanErrors(0.03, 0.003, 0.002, 2.0, -0.003))
SECOND = lighthouse_2(
    TiltedErrors(0.0, 0.05, 0.3, 1.0, 0.003, 0.5, -0.3), TiltedErrors(-0.007, -0.046, 0.3, 2.0, -0.003, 0.9, -0.2)
)
DECK = np.array([[-0.015, 0.0075, 0.0], [-0.015, -0.0075, 0.0], [0.015, 0.0075, 0.0], [0.015, -0.0075, 0.0]])
"""Four photodiodes in a plane, as of a Crazyflie's deck [m]."""
BODY = np.random.default_rng(3).normal(size=(8, 3)) * 0.05
"""Eight photodiodes in space [m]."""


def room(generations: Sequence[int], distance_m: float = 3.0) -> list[Station]:
    """Return stations about the origin that look at it, one per generation."""
    out = []
    for i, generation in enumerate(generations):
        turn = 2 * np.pi * i / 3.3
        at = distance_m * np.array([np.cos(turn), np.sin(turn), 0.5 + 0.1 * i])
        ahead = -at / np.linalg.norm(at)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(ahead, right), ahead], axis=1)
        out.append(Station(rotation, at, FIRST if generation == 1 else SECOND))
    return out


def seen(
    stations: Sequence[Station],
    point_m: Floats,
    state: State,
    noise: Sequence[AngleNoise],
    rng: np.random.Generator,
    *,
    spread_s: float = 0.0,
    shown: float = 1.0,
) -> RowBatch:
    """Return one period's rows of C craft that move at constant rates, sweeps at different instants.

    Args:
        stations: all stations.
        point_m: (K, 3) [m].
        state: true states at the epoch.
        noise: of each station.
        rng: draws.
        spread_s: time over which the sweeps come.
        shown: share of the hits that are seen.
    """
    craft, columns = [], []
    for c in range(len(state.position)):
        for s, station in enumerate(stations):
            for fan in (0, 1):
                tau = spread_s * (rng.random() - 0.5)
                turned = exp(state.angular_rate[c] * tau) @ state.rotation[c]
                place = point_m @ turned.T + state.position[c] + state.velocity[c] * tau
                angle = measured_angles((place - station.position) @ station.rotation, station.fans)[:, fan]
                angle += noise[s].shared_rad * rng.standard_normal()
                angle += noise[s].own_rad * rng.standard_normal(len(angle))
                for k in np.flatnonzero((rng.random(len(angle)) < shown) & np.isfinite(angle)):
                    craft.append(c)
                    columns.append((s, fan, k, 0, tau, angle[k]))
    table = np.array(columns).reshape(-1, 6)
    s, fan, k, sweep = table[:, :4].astype(np.int64).T
    return gathered(
        np.array(craft, dtype=np.int64), Rows(s, fan, k, sweep, table[:, 4], table[:, 5]), len(state.position)
    )


def still(rotation: Floats, position: Floats) -> State:
    """Return states at rest, (C, 3, 3) and (C, 3) [m]."""
    none = np.zeros_like(position)
    return State(rotation, position, none, none)
