"""The message by which a craft lets others know their place relative to it with the true covariance.

Sent once per period, little-endian:

    u16 craft, u32 number of the period, u8 draws M, u16 fan errors Q                                           9 bytes
    f64 position [m]                                                                                            24
    f32 quaternion wxyz, velocity [m/s], angular rate [rad/s]                                                   40
    f32 what an undetected fault may do to position [m] and attitude [rad], beyond the covariance                8
    f32 P of the filter, lower triangle row by row                                                             312
    f32 A, what the filter has kept of its error in the period (`estimators.relative.error_step`), row by row  576
    f32 instant of every draw minus the epoch [s], NaN where there was none, and B                            52 M
    f32 S, by how much the error is that of the fans                                                          48 Q

With one Lighthouse 1.0 station M is 4, of which two are NaN, and Q 0, or 10 where fan errors are considered.
"""

import struct
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.relative.error_step import ErrorStep
from estimators.rotation import matrix_from_quaternion, quaternion_from_matrix
from estimators.state import STATES, State

_HEAD = struct.Struct("<HIBH")
_LOWER = np.tril_indices(STATES)
_POSITION_BYTES = 24


class PoseMessage(NamedTuple):
    """One craft's message. craft: index. period: number. state: without the craft axis. covariance: (12, 12), P.
    step: of the period, without the craft axis. sensitivity: (12, Q), S. fault: (2,), largest effect of an undetected
    fault on position [m] and attitude [rad].
    """

    craft: int
    period: int
    state: State
    covariance: Floats
    step: ErrorStep
    sensitivity: Floats
    fault: Floats


def encoded(message: PoseMessage) -> bytes:
    """Return the bytes of a message."""
    state, step, sensitivity = message.state, message.step, message.sensitivity
    draws, errors = len(step.instant), sensitivity.shape[1]
    numbers = (
        quaternion_from_matrix(state.rotation),
        state.velocity,
        state.angular_rate,
        message.fault,
        message.covariance[_LOWER],
        step.kept.ravel(),
        step.instant,
        step.drawn.ravel(),
        sensitivity.ravel(),
    )
    head = _HEAD.pack(message.craft, message.period, draws, errors)
    return head + state.position.astype("<f8").tobytes() + np.concatenate(numbers).astype("<f4").tobytes()


def decoded(data: bytes) -> PoseMessage:
    """Return the message in bytes. Raises ValueError where they are not those of one."""
    if len(data) < _HEAD.size:
        raise ValueError(f"a message of {len(data)} bytes has no head")
    craft, period, draws, errors = _HEAD.unpack_from(data)
    sizes = (4, 3, 3, 2, len(_LOWER[0]), STATES**2, draws, STATES * draws, STATES * errors)
    body = data[_HEAD.size :]
    if len(body) != _POSITION_BYTES + 4 * sum(sizes):
        raise ValueError(f"a message of {draws} draws and {errors} fan errors has {len(data)} bytes")
    position = np.frombuffer(body[:_POSITION_BYTES], "<f8").astype(np.float64)
    rest = np.split(np.frombuffer(body[_POSITION_BYTES:], "<f4").astype(np.float64), np.cumsum(sizes)[:-1])
    covariance = np.zeros((STATES, STATES))
    covariance[_LOWER] = covariance.T[_LOWER] = rest[4]
    step = ErrorStep(
        rest[5].reshape(STATES, STATES), rest[7].reshape(STATES, draws), np.zeros((STATES, errors)), rest[6]
    )
    turn = matrix_from_quaternion(rest[0] / np.linalg.norm(rest[0]))
    state = State(rotation=turn, position=position, velocity=rest[1], angular_rate=rest[2])
    return PoseMessage(craft, period, state, covariance, step, rest[8].reshape(STATES, errors), rest[3])


def bytes_per_second(draws: int, errors: int, rate_hz: float) -> float:
    """Return the data rate of one craft's messages [B/s].

    Args:
        draws: number M.
        errors: number Q.
        rate_hz: periods per second.
    """
    numbers = 12 + len(_LOWER[0]) + STATES**2 + (1 + STATES) * draws + STATES * errors
    return rate_hz * (_HEAD.size + _POSITION_BYTES + 4 * numbers)
