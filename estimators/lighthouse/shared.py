"""Errors that the sweep angles of several craft share: the rotor's error of each sweep, and the errors of the fans.

A row of a craft in a sweep f, of a station whose fans are off by q from what the craft know, is

    y = H x + g u_f + D q + own noise,    D = dh/dq

with u_f one draw of variance one for all craft that the sweep meets, and g the standard deviation of the error. A craft
for itself counts u_f to its noise, R = a^2 I + b^2 1 1^T per sweep (`estimators.lighthouse.innovation`); b^2 may have
parts that only its own photodiodes share. With the sums over a sweep's n rows S of H and d of D, k = b^2 / (a^2 + n
b^2), rows that go into a filter say

    information   H^T R^-1 H = sum_sweeps [H^T H - k S S^T] / a^2
    shared        H^T R^-1 g = g S / (a^2 + n b^2)                     of each sweep
    considered    H^T R^-1 D = sum_sweeps [H^T D - k S d^T] / a^2

and a pose that is solved from rows is off by (J^T J)^-1 J^T (g u + D q + own noise), J the pose's columns of H.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.innovation import RowBatch, StationArrays
from estimators.lighthouse.rows import Station, row_into
from estimators.lighthouse.sweep import FAN, FanErrors, kernel_fans, measured_angle
from estimators.lighthouse.tilted import TiltedErrors
from estimators.rotation import exp_into
from estimators.state import STATES, State

SWEEPS_PER_FAN = 2
"""Sweeps of one fan in a period that are told apart; what others share is counted to the noise."""
_POSE = np.array([0, 1, 2, 6, 7, 8])
_STEP = 1e-6
_LARGEST_CONDITION = 1e10


class Considered(NamedTuple):
    """Errors of fans that are considered, Q in all.

    fans: (Q, FAN), rows of `kernel_fans` with one error each larger by `step`. owner: (Q,), index of the fan that has
    it, among all stations'. terms: (Q,), what it is: "phase", "tilt", "curve", "gibbous" (a once-per-turn error m
    sin(b + phase) has two, m cos(phase) and m sin(phase): its phase alone means nothing where m is zero) or "ogee".
    """

    fans: Floats
    owner: Ints
    terms: tuple[str, ...]


def considered_errors(stations: Sequence[Station]) -> Considered:
    """Return all errors of all stations' fans, in the order of stations, fans and terms."""
    fans, owner, terms, count = [], list[int](), list[str](), 0
    for station in stations:
        for fan in station.fans:
            for term, errors in _increased(fan.errors):
                fans.append(fan._replace(errors=errors))
                owner.append(count)
                terms.append(term)
            count += 1
    return Considered(kernel_fans(fans), np.array(owner, dtype=np.int64), tuple(terms))


def _increased(errors: FanErrors | TiltedErrors) -> list[tuple[str, FanErrors | TiltedErrors]]:
    """Return the terms of one fan, each with the fan's errors of which it is larger by a step."""
    out: list[tuple[str, FanErrors | TiltedErrors]] = [
        ("phase", errors._replace(phase_rad=errors.phase_rad + _STEP)),
        ("tilt", errors._replace(tilt_rad=errors.tilt_rad + _STEP)),
        ("curve", errors._replace(curve=errors.curve + _STEP)),
    ]
    for by in (_STEP, 1j * _STEP):
        phase, size = _wave(errors.gibbous_phase_rad, errors.gibbous_magnitude, by)
        out.append(("gibbous", errors._replace(gibbous_phase_rad=phase, gibbous_magnitude=size)))
        if isinstance(errors, TiltedErrors):
            phase, size = _wave(errors.ogee_phase_rad, errors.ogee_magnitude, by)
            out.append(("ogee", errors._replace(ogee_phase_rad=phase, ogee_magnitude=size)))
    return out


def _wave(phase: float, size: float, by: complex) -> tuple[float, float]:
    both = size * np.exp(1j * phase) + by
    return float(np.angle(both)), float(np.abs(both))


class Shared(NamedTuple):
    """Sums over the rows of C craft, with M sweeps per craft (its fans times `SWEEPS_PER_FAN`).

    information: (C, 12, 12). sweeps: (C, 12, M), by draws of variance one. considered: (C, 12, Q). instant: (C, M),
    when a sweep passes the boresight after the epoch [s]; NaN where it has met no photodiode.
    """

    information: Floats
    sweeps: Floats
    considered: Floats
    instant: Floats


class Common(NamedTuple):
    """Errors of S stations' rows that are the same for all craft: sigma_rad (S,), standard deviation of the rotor's
    error with all that shifts a sweep for everybody; turn_s (S,), duration of a rotor's turn [s]; taken (F, Q), part
    of each considered error that somebody has taken off all rows of a fan.
    """

    sigma_rad: Floats
    turn_s: Floats
    taken: Floats


def shared_sums(
    rows: RowBatch,
    kept: Bools,
    mask: Bools,
    light: StationArrays,
    common: Common,
    considered: Considered,
    point_m: Floats,
    state: State,
    *,
    weighted: bool,
) -> Shared:
    """Return the sums over the rows of the craft of the mask; zero for the others.

    Args:
        rows: rows of C craft.
        kept: (N,), rows that are used.
        mask: (C,).
        light: the stations, with the noise that each craft counts for itself.
        common: the part of the noise that all craft share.
        considered: errors of the fans.
        point_m: (C, K, 3) [m], photodiodes in the body frames.
        state: states at which the rows are linearised.
        weighted: by R^-1, as in a filter; if not, H^T H, g S and H^T D, as in the least squares of a pose.
    """
    craft, slots = len(mask), SWEEPS_PER_FAN * len(light.fans)
    out = Shared(
        np.zeros((craft, STATES, STATES)),
        np.zeros((craft, STATES, slots)),
        np.zeros((craft, STATES, len(considered.owner))),
        np.full((craft, slots), np.nan),
    )
    fans = considered.fans if len(considered.owner) else np.empty((0, FAN))
    _sums_into(
        mask, rows, kept, light, common, fans, considered.owner, np.ascontiguousarray(point_m), state, weighted, out
    )
    return out


def mean_derivatives(light: StationArrays, considered: Considered, point_m: Floats, used: Bools) -> Floats:
    """Return the means of D over points before stations, (F, Q); zero of a fan without any.

    Args:
        light: the stations.
        considered: errors of the fans.
        point_m: (K, 3) [m], in the world.
        used: (F, K), points that the mean of each fan is over.
    """
    out = np.zeros((len(light.fans), len(considered.owner)))
    for column, fan in enumerate(considered.owner.tolist()):
        if not used[fan].any():
            continue
        s = int(np.searchsorted(light.first, fan, side="right")) - 1
        there = (point_m - light.position[s]) @ light.rotation[s]
        larger, known = considered.fans[column], light.fans[fan]
        part = [measured_angle(x, y, z, larger) - measured_angle(x, y, z, known) for x, y, z in there[used[fan]]]
        out[fan, column] = np.mean(part) / _STEP
    return out


def pose_sensitivity(sums: Shared, mask: Bools) -> tuple[Floats, Floats]:
    """Return by how much solved poses are off by draws of the sweeps (C, 6, M) and by fan errors (C, 6, Q).

    Args:
        sums: not weighted.
        mask: (C,), craft to compute; zero for the others, and where the rows do not decide a pose.
    """
    normal = sums.information[:, _POSE[:, None], _POSE].copy()
    normal[~mask] = np.eye(6)
    decided = np.linalg.cond(normal) < _LARGEST_CONDITION
    normal[~decided], mask = np.eye(6), mask & decided
    both = np.linalg.solve(normal, np.concatenate([sums.sweeps, sums.considered], axis=2)[:, _POSE])
    both[~mask] = 0.0
    slots = sums.sweeps.shape[2]
    return both[..., :slots], both[..., slots:]


@kernel
def _place(
    light: StationArrays, s: int, point: Floats, tau: float, state: State, c: int, turn: Floats, q: Floats
) -> None:
    """Write where a photodiode of craft c is in the frame of station s, tau after the epoch, into q (3,) [m]."""
    for i in range(3):
        q[i] = state.angular_rate[c, i] * tau
    exp_into(q, turn)
    arm0 = state.rotation[c, 0, 0] * point[0] + state.rotation[c, 0, 1] * point[1] + state.rotation[c, 0, 2] * point[2]
    arm1 = state.rotation[c, 1, 0] * point[0] + state.rotation[c, 1, 1] * point[1] + state.rotation[c, 1, 2] * point[2]
    arm2 = state.rotation[c, 2, 0] * point[0] + state.rotation[c, 2, 1] * point[1] + state.rotation[c, 2, 2] * point[2]
    x = state.position[c, 0] + state.velocity[c, 0] * tau - light.position[s, 0]
    y = state.position[c, 1] + state.velocity[c, 1] * tau - light.position[s, 1]
    z = state.position[c, 2] + state.velocity[c, 2] * tau - light.position[s, 2]
    x += turn[0, 0] * arm0 + turn[0, 1] * arm1 + turn[0, 2] * arm2
    y += turn[1, 0] * arm0 + turn[1, 1] * arm1 + turn[1, 2] * arm2
    z += turn[2, 0] * arm0 + turn[2, 1] * arm1 + turn[2, 2] * arm2
    r = light.rotation[s]
    for i in range(3):
        q[i] = r[0, i] * x + r[1, i] * y + r[2, i] * z


@kernel
def _sums_into(
    mask: Bools,
    rows: RowBatch,
    kept: Bools,
    light: StationArrays,
    common: Common,
    fans: Floats,
    owner: Ints,
    point: Floats,
    state: State,
    weighted: bool,
    out: Shared,
) -> None:
    """Write the sums of the craft of the mask."""
    q, turn, h, total = np.empty(3), np.empty((3, 3)), np.empty(STATES), np.empty(STATES)
    d, d_total = np.empty(len(owner)), np.empty(len(owner))
    seen = np.zeros(len(light.fans), np.int64)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        seen[:] = 0
        begin = rows.first[c]
        while begin < rows.first[c + 1]:
            s, fan = rows.station[begin], light.first[rows.station[begin]] + rows.fan[begin]
            own, shared = light.own[s], light.shared[s]
            over = 1 / (own * own) if weighted else 1.0
            total[:] = 0.0
            d_total[:] = 0.0
            n, instant, end = 0, 0.0, begin
            while (
                end < rows.first[c + 1]
                and rows.station[end] == s
                and rows.fan[end] == rows.fan[begin]
                and rows.sweep[end] == rows.sweep[begin]
            ):
                r = end
                end += 1
                if not kept[r]:
                    continue
                place = point[c, rows.photodiode[r]]
                residual = row_into(
                    rows.offset_s[r],
                    rows.angle[r],
                    light.rotation[s],
                    light.position[s],
                    light.fans[fan],
                    place,
                    state.rotation[c],
                    state.position[c],
                    state.velocity[c],
                    state.angular_rate[c],
                    h,
                )
                if np.isnan(residual):
                    continue
                n += 1
                instant += rows.offset_s[r] - rows.angle[r] * common.turn_s[s] / (2 * np.pi)
                if len(owner):
                    _place(light, s, place, rows.offset_s[r], state, c, turn, q)
                    angle = measured_angle(q[0], q[1], q[2], light.fans[fan])
                    for j in range(len(owner)):
                        d[j] = 0.0
                        if owner[j] == fan:
                            d[j] = (measured_angle(q[0], q[1], q[2], fans[j]) - angle) / _STEP - common.taken[fan, j]
                            d_total[j] += d[j]
                for i in range(STATES):
                    total[i] += h[i]
                    for j in range(STATES):
                        out.information[c, i, j] += over * h[i] * h[j]
                    for j in range(len(owner)):
                        out.considered[c, i, j] += over * h[i] * d[j]
            begin = end
            if not n:
                continue
            k, of_sweep = 0.0, common.sigma_rad[s]
            if weighted:
                of_sweep /= own * own + n * shared * shared
                k = over * shared * shared / (own * own + n * shared * shared)
            slot = fan * SWEEPS_PER_FAN + seen[fan]
            for i in range(STATES):
                for j in range(STATES):
                    out.information[c, i, j] -= k * total[i] * total[j]
                for j in range(len(owner)):
                    out.considered[c, i, j] -= k * total[i] * d_total[j]
                if seen[fan] < SWEEPS_PER_FAN:
                    out.sweeps[c, i, slot] = of_sweep * total[i]
            if seen[fan] < SWEEPS_PER_FAN:
                out.instant[c, slot] = instant / n
            seen[fan] += 1
