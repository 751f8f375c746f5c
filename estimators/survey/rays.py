"""Directions in which a station sees photodiodes, from the angles of its two fans, whatever their tilt and errors.

The point (u, v, 1) of a direction solves the two equations of `estimators.lighthouse.sweep` by Newton's method, from
the ideal fans' crossing: of two straight fans u and v are tangents of the angles, and of a V of tilted planes with
angles a_0 and a_1 the azimuth is their mean and tan(elevation) = sin(a_1 - a_0) / (tan 30 deg (cos a_0 + cos a_1)).
"""

import numpy as np

from estimators.arrays import Floats
from estimators.lighthouse.sweep import Fan, measured_angles
from estimators.lighthouse.tilted import TILT_RAD, TiltedErrors

_ROUNDS = 12
_STEP = 1e-6
"""Step of the differences, of coordinates near 1: their error is of its square."""
_SETTLED = 1e-10


def directions(angle: Floats, fans: tuple[Fan, Fan]) -> Floats:
    """Return (u, v) = (x/z, y/z), (..., 2), of angles (..., 2) [rad] from boresight; NaN where there is no such ray."""
    flat = np.ascontiguousarray(angle, dtype=np.float64).reshape(-1, 2)
    uv = _start(flat, fans)
    step = np.zeros_like(uv)
    along_u, along_v = np.array([_STEP, 0.0]), np.array([0.0, _STEP])
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for _ in range(_ROUNDS):
            at = _angles(uv, fans)
            by_u = (_angles(uv + along_u, fans) - at) / _STEP
            by_v = (_angles(uv + along_v, fans) - at) / _STEP
            miss = flat - at
            size = by_u[:, 0] * by_v[:, 1] - by_u[:, 1] * by_v[:, 0]
            step = np.stack(
                [by_v[:, 1] * miss[:, 0] - by_v[:, 0] * miss[:, 1], by_u[:, 0] * miss[:, 1] - by_u[:, 1] * miss[:, 0]],
                axis=1,
            )
            step /= size[:, None]
            uv = uv + step
            if not np.any(np.abs(step) > _SETTLED):
                break
    uv[~(np.abs(step) < 1e-6).all(axis=1)] = np.nan
    return uv.reshape(angle.shape)


def _angles(uv: Floats, fans: tuple[Fan, Fan]) -> Floats:
    return measured_angles(np.concatenate([uv, np.ones((len(uv), 1))], axis=1), fans)


def _start(angle: Floats, fans: tuple[Fan, Fan]) -> Floats:
    """Return the crossing of the ideal fans."""
    phase = np.array([fan.errors.phase_rad for fan in fans])
    a = np.clip(angle + phase, -1.4, 1.4)
    if not isinstance(fans[0].errors, TiltedErrors):
        straight: Floats = -np.tan(a)
        return straight
    azimuth = a.mean(axis=1)
    rise = np.sin(a[:, 1] - a[:, 0]) / (np.tan(TILT_RAD) * (np.cos(a[:, 0]) + np.cos(a[:, 1])))
    return np.stack([-np.tan(azimuth), -rise / np.cos(azimuth)], axis=1)
