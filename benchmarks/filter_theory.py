"""What filters of craft under one light can know, by theory: dense covariance recursions, nothing of the product's.

The rows of a craft in a period are y = H x + D q + noise of covariance a^2 I + b^2 1 1^T per sweep of a fan, of which
the sweep's draw is the same for all craft; q are the errors of the fans, constant. Craft stand where they are, so that
H and D stay. `separate` runs a Kalman filter per craft that knows neither the others nor q, and the covariance of all
their errors; `together` is the one filter of all craft and q, the least that any navigation can reach (posterior
Cramer-Rao bound).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.filter.error_state import STATES, process_noise_into

UNKNOWN = np.repeat([0.1, 1.0, 0.1, 1.0], 3) ** 2
"""Variances of a state before its first light."""


class Seen(NamedTuple):
    """Rows of one craft in every period: h (n, 12), d (n, Q), fan (n,) each."""

    h: Floats
    d: Floats
    fan: NDArray[np.int64]


class Model(NamedTuple):
    """own_rad, shared_rad: a and b. variance: (Q,), of q. acceleration_m_s2, angular_rad_s2: white, per axis. frame_s:
    a period. periods: how many.
    """

    own_rad: float
    shared_rad: float
    variance: Floats
    acceleration_m_s2: float
    angular_rad_s2: float
    frame_s: float
    periods: int


def noise_of(seen: list[Seen], model: Model) -> Floats:
    """Return the covariance of all rows of a period, (N, N)."""
    fan = np.concatenate([one.fan for one in seen])
    out: Floats = model.own_rad**2 * np.eye(len(fan)) + model.shared_rad**2 * (fan[:, None] == fan)
    return out


def _motion(craft: int, model: Model) -> tuple[Floats, Floats]:
    step, push = np.eye(STATES), np.empty((STATES, STATES))
    step[:3, 3:6] = step[6:9, 9:] = model.frame_s * np.eye(3)
    process_noise_into(model.frame_s, model.acceleration_m_s2, model.angular_rad_s2, push)
    moved: Floats = np.kron(np.eye(craft), step).astype(np.float64)
    pushed: Floats = np.kron(np.eye(craft), push).astype(np.float64)
    return moved, pushed


def _padded(matrix: Floats, more: int) -> Floats:
    out = np.eye(len(matrix) + more)
    out[: len(matrix), : len(matrix)] = matrix
    return out


def _start(craft: int, model: Model) -> Floats:
    return np.diag(np.concatenate([np.tile(UNKNOWN, craft), model.variance]))


def _blocks(parts: list[Floats]) -> Floats:
    out = np.zeros((sum(part.shape[0] for part in parts), sum(part.shape[1] for part in parts)))
    row = column = 0
    for part in parts:
        out[row : row + part.shape[0], column : column + part.shape[1]] = part
        row, column = row + part.shape[0], column + part.shape[1]
    return out


def together(seen: list[Seen], model: Model) -> Floats:
    """Return the covariance of the errors of all craft by one filter of everything, (12 C, 12 C)."""
    craft, errors = len(seen), len(model.variance)
    step, push = _motion(craft, model)
    step, push = _padded(step, errors), np.pad(push, (0, errors))
    h = np.hstack([_blocks([one.h for one in seen]), np.concatenate([one.d for one in seen])])
    light = h.T @ np.linalg.solve(noise_of(seen, model), h)
    covariance = _start(craft, model)
    used = np.diag(covariance) > 0
    for _ in range(model.periods):
        covariance = step @ covariance @ step.T + push
        scale = np.sqrt(np.diag(covariance)[used])
        part = covariance[np.ix_(used, used)] / np.outer(scale, scale)
        part = np.linalg.inv(np.linalg.inv(part) + light[np.ix_(used, used)] * np.outer(scale, scale))
        covariance[np.ix_(used, used)] = part * np.outer(scale, scale)
    return covariance[: STATES * craft, : STATES * craft]


def separate(seen: list[Seen], model: Model) -> Floats:
    """Return the covariance of the errors of all craft by a filter each, (12 C, 12 C)."""
    craft, errors = len(seen), len(model.variance)
    step, push = _motion(craft, model)
    d, noise = np.concatenate([one.d for one in seen]), noise_of(seen, model)
    all_errors, believed = _start(craft, model), [np.diag(UNKNOWN) for _ in seen]
    for _ in range(model.periods):
        gains: list[Floats] = []
        for c, one in enumerate(seen):
            before = step[:STATES, :STATES] @ believed[c] @ step[:STATES, :STATES].T + push[:STATES, :STATES]
            spread = one.h @ before @ one.h.T + noise_of([one], model)
            gain: Floats = np.linalg.solve(spread, one.h @ before).T.astype(np.float64)
            left = np.eye(STATES) - gain @ one.h
            believed[c] = left @ before @ left.T + gain @ noise_of([one], model) @ gain.T
            gains.append(gain)
        every = _blocks(gains)
        kept = _padded(np.eye(STATES * craft) - every @ _blocks([one.h for one in seen]), errors)
        kept[: STATES * craft, STATES * craft :] = -every @ d
        before = _padded(step, errors) @ all_errors @ _padded(step, errors).T + np.pad(push, (0, errors))
        all_errors = kept @ before @ kept.T + np.pad(every @ noise @ every.T, (0, errors))
    return all_errors[: STATES * craft, : STATES * craft]
