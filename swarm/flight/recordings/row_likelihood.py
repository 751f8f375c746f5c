"""Noise of a recording's sweeps and of the hand that moves its object, by the likelihood of a filter's innovations.

What a filter has to be told is what its innovations are: noise of the photodiodes a, of whole sweeps b (with what
geometry and calibration leave behind), and white accelerations of the motion. Fits to single periods cannot tell b from
motion within the period. Here filters run over stretches of the recording, each from a solved state, and with S the
covariance of the innovations y of a period,

    -2 log L = sum over periods of  log |S| + min(y^T S^-1 y, gate)

is made least over (a, b, acceleration, angular acceleration), with the gate at which a filter refuses a period's rows:
a false row costs as much as it would with any noise. Rows that contradict the others
(`estimators.lighthouse.row_snooping`) are left out before, as the navigator leaves them out, and again with the noise
that was found: noise is what honest rows have, and what they lose beyond the limit is made good as for normal noise.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.special import ndtr

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import gates
from estimators.filter.compiled import CompiledFilterBank
from estimators.lighthouse.innovation import RowBatch, gathered, innovations, light_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.row_motion import HandMotion
from estimators.lighthouse.row_snooping import LIMIT, snooped
from estimators.lighthouse.rows import Rows, Station, packed
from estimators.state import State
from swarm.flight.recordings.row_windows import RowWindows
from swarm.onboard.motion_search import MotionSearch

STRETCHES, STRETCH_S = 24, 0.6
"""Stretches of a recording that are filtered, and their duration [s]."""
TRIES = 12
"""Periods after one another in which a stretch looks for its first state."""
FEWEST = 4
"""Stretches below which nothing is told."""
GATE = 0.9999
ROUNDS = ((0.7, 50), (0.3, 30), (0.2, 30))
"""First steps and number of trials of noise and motion, after rows are left out anew in each round."""
CORE = 0.4
"""Share of the noise of single periods with which rows are first left out. From too little, the noise grows with the
rows that it admits; from too much, false rows are noise."""
_LEAST = np.log([5e-6, 5e-6, 0.05, np.radians(10.0)])
_MOST = np.log([3e-3, 1e-2, 60.0, np.radians(20000.0)])
_START = np.array([2e-4, 8.0, np.radians(1500.0)])
"""Shared noise, acceleration and angular acceleration at first."""


class Likely(NamedTuple):
    """Noise and motion that make a recording most likely.

    noise: of each station. acceleration_m_s2, angular_acceleration_rad_s2: of the motion, white and constant over a
    period. nis: mean of the innovations' normalised squares per row, of periods within the gate.
    """

    noise: list[AngleNoise]
    acceleration_m_s2: float
    angular_acceleration_rad_s2: float
    nis: float


class _Stretches(NamedTuple):
    """Stretches side by side: state and covariance at their beginnings, (C, ...), and the rows of every period after
    that, of all stretches, with those that are used. The filter's period is frame_s.
    """

    state: State
    covariance: Floats
    periods: list[RowBatch]
    kept: list[Bools]
    frame_s: float


def likely(
    windows: RowWindows, stations: Sequence[Station], point_m: Floats, hand: HandMotion, own: Sequence[float]
) -> Likely | None:
    """Return the most likely noise and motion; None where too few stretches have a first state.

    Args:
        windows: light of one object.
        stations: that its rows name.
        point_m: (K, 3) [m], photodiodes in the body frame.
        hand: how a hand may move the object.
        own: what the photodiodes of a sweep agree to, per station [rad]: a start, and the stations' ratios.
    """
    middle = float(np.sqrt(np.mean(np.square(own))))
    ratio = np.array(own) / middle

    def noise_of(x: Floats) -> list[AngleNoise]:
        return [AngleNoise(float(np.exp(x[0]) * r), float(np.exp(x[1]))) for r in ratio]

    x = np.clip(np.log([CORE * middle, *_START]), _LEAST, _MOST)
    found = _stretches(windows, stations, point_m, noise_of(x), hand)
    if found is None:
        return None
    points = np.broadcast_to(point_m, (len(found.state.position), *point_m.shape)).copy()

    def cost(x: Floats) -> float:
        inside = np.clip(x, _LEAST, _MOST)
        outside = float(np.sum((x - inside) ** 2))
        value, _ = _run(found, stations, points, noise_of(inside), np.exp(inside[2:]))
        return value + 1e3 * outside

    for step, evaluations in ROUNDS:
        _run(found, stations, points, noise_of(x), np.exp(x[2:]), clean=True)
        best = minimize(
            cost,
            x,
            method="Nelder-Mead",
            options={
                "initial_simplex": np.concatenate([x[None], x + step * np.eye(4)]),
                "maxfev": evaluations,
                "xatol": 0.03,
                "fatol": 1.0,
            },
        )
        cut, x = LIMIT * np.exp(x[0]), np.clip(best.x, _LEAST, _MOST)
        x[0] = np.clip(np.log(_before_cut(float(np.exp(x[0])), float(cut))), _LEAST[0], _MOST[0])
    _, nis = _run(found, stations, points, noise_of(x), np.exp(x[2:]))
    return Likely(noise_of(x), float(np.exp(x[2])), float(np.exp(x[3])), nis)


def _before_cut(sigma: float, cut: float) -> float:
    """Return the standard deviation of normal noise of which `sigma` is left without what lies beyond `cut`."""

    def left(value: float) -> float:
        c = cut / value
        lost = 2 * c * np.exp(-c * c / 2) / np.sqrt(2 * np.pi) / (2 * ndtr(c) - 1)
        return float(value * np.sqrt(max(1 - lost, 0.0)) - sigma)

    if left(sigma) >= 0:
        return sigma
    return float(brentq(left, sigma, 2 * sigma)) if left(2 * sigma) > 0 else 2 * sigma


def _stretches(
    windows: RowWindows, stations: Sequence[Station], point_m: Floats, noise: list[AngleNoise], hand: HandMotion
) -> _Stretches | None:
    """Return stretches, evenly over the recording, that begin where an object's state is certain."""
    length = round(STRETCH_S / windows.frame_s)
    begins, states, covariances = [], [], []
    for begin in np.linspace(0, max(len(windows) - length - TRIES, 0), STRETCHES).astype(np.int64).tolist():
        search = MotionSearch(point_m[None], stations, noise, windows.frame_s, hand)
        for i in range(begin, min(begin + TRIES, len(windows))):
            search.gather(windows.window(i).light.rows)
            result = search.search(0)
            if result.state is not None and result.covariance is not None:
                begins.append(i)
                states.append(result.state)
                covariances.append(result.covariance)
                break
    if len(begins) < FEWEST:
        return None
    periods = []
    for t in range(1, length):
        craft: list[Ints] = []
        parts: list[Rows] = []
        for c, begin in enumerate(begins):
            if begin + t < len(windows):
                own = windows.window(begin + t).light.rows.of(0)
                parts.append(own)
                craft.append(np.full(len(own.angle), c))
        rows = Rows._make(np.concatenate(column) for column in zip(*parts, strict=True))
        periods.append(gathered(np.concatenate(craft), rows, len(begins)))
    state = State._make(np.stack(part) for part in zip(*states, strict=True))
    kept = [np.ones(len(rows.angle), dtype=np.bool_) for rows in periods]
    return _Stretches(state, np.stack(covariances), periods, kept, windows.frame_s)


def _run(
    stretches: _Stretches,
    stations: Sequence[Station],
    points: Floats,
    noise: list[AngleNoise],
    motion: Floats,
    *,
    clean: bool = False,
) -> tuple[float, float]:
    """Return -2 log L of all stretches, and the mean normalised square per row of periods within the gate.

    Args:
        stretches: of the recording.
        stations: that the rows name.
        points: (C, K, 3) [m].
        noise: of each station.
        motion: acceleration [m/s^2] and angular acceleration [rad/s^2].
        clean: find out on the way which rows are used, and note them in `stretches`.
    """
    craft = len(points)
    bank = CompiledFilterBank(
        craft,
        acceleration_noise_m_s2=float(motion[0]),
        angular_acceleration_noise_rad_s2=float(motion[1]),
        gate_probability=GATE,
    )
    every: Bools = np.ones(craft, dtype=np.bool_)
    bank.adopt(every, stretches.state, stretches.covariance)
    total = square = number = 0.0
    known = packed(stations)
    for rows, used in zip(stretches.periods, stretches.kept, strict=True):
        bank.predict(stretches.frame_s, every)
        if clean:
            state, covariance = bank.state, bank.covariance
            for c in range(craft):
                own = rows.of(c)
                used[rows.first[c] : rows.first[c + 1]] = snooped(
                    own, known, points[c], state.of(c), covariance[c], noise
                )
        kept = used.copy()
        found = innovations(rows, kept, every, light_of(known, noise), points, bank.state)
        asked = found.number > 0
        result = bank.update(asked, found.y, found.h, np.ones_like(found.y), found.number, found.pivot)
        gate = gates(GATE, int(found.number.max(initial=0)))[found.number]
        total += float(np.sum((result.log_determinant + np.minimum(result.nis, gate))[asked]))
        total += _log_noise(rows, kept, noise)
        taken = asked & result.accepted
        square += float(np.sum(result.nis[taken]))
        number += float(np.sum(found.number[taken]))
    return total, square / max(number, 1.0)


def _log_noise(rows: RowBatch, kept: Bools, noise: list[AngleNoise]) -> float:
    """Return log |R| of the kept rows of all craft."""
    craft = np.repeat(np.arange(len(rows.first) - 1), np.diff(rows.first))
    key = np.stack([craft, rows.station, rows.fan, rows.sweep])[:, kept]
    if not key.shape[1]:
        return 0.0
    sweeps, size = np.unique(key, axis=1, return_counts=True)
    own, shared = np.array(noise).T[:, sweeps[1]]
    return float(np.sum(2 * (size - 1) * np.log(own) + np.log(own**2 + size * shared**2)))
