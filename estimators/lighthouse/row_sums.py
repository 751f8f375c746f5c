"""Sums of many rows of one craft, which say all that the rows say: as fewer rows, or as a measured pose.

With H the whitened rows of `estimators.lighthouse.innovation`, H^T H = L L^T and H^T y, the twelve rows

    L^T x = L^-1 H^T y + noise

say all that they say of x. What the rows have beyond, y^T y - |L^-1 H^T y|^2, is a row without x, for the gate. The
pose comes first, so that the last six rows are of the rates alone, which one sweep hardly tells: most of them count for
the gate only. Where all of them do, the first six, [U V] x = z, are a pose at once,

    [I B] x = U^-1 z + noise of covariance (U^T U)^-1,   B = U^-1 V

as those of PnP are, and a filter takes them in as it does these. Of these sums four craft are computed side by side.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lanes import LANES, any_of, lane, lanes_in, pack, select
from estimators.lighthouse.innovation import Innovations, RowBatch, StationArrays
from estimators.lighthouse.rows import row_into
from estimators.lighthouse.side_by_side import rows_of
from estimators.pivot import is_wide
from estimators.state import STATES, State

CONDENSED = 8
"""Rows of a craft above which their sums take their place."""
NEGLIGIBLE = 1e-5
"""Information of a sum relative to the prediction's, below which the sum counts for the gate only."""
LITTLE = 1e-3
"""Likewise, below which sums of the rates do not keep the others from being a pose, as PnP leaves them out as well."""
POSE, ORDER = 6, np.array([0, 1, 2, 6, 7, 8, 3, 4, 5, 9, 10, 11])
"""Columns of H, those of the pose first."""
ROUNDING = 1e-12
"""Share of a sum of squares below which what is left of it is rounding."""


def condense(found: Innovations, mask: Bools, covariance: Floats) -> tuple[Innovations, Ints]:
    """Return the rows of the craft of the mask, with their sums in the place of many, and how many (C,) each one had.

    Args:
        found: innovations.
        mask: (C,), the craft concerned; the others have no rows in what is returned.
        covariance: (C, 12, 12) of the predictions, which tells the information that may be left out.
    """
    craft, most = found.y.shape
    width = min(most, STATES + 1)
    number = np.zeros_like(found.number)
    out = Innovations(np.empty((craft, width)), np.empty((craft, width, STATES)), number, found.pivot)
    _condense_all(mask, covariance, found, out)
    return out, np.where(mask, found.number, 0)


@kernel
def _condense_all(mask: Bools, covariance: Floats, found: Innovations, out: Innovations) -> None:
    """Write the rows of every craft of the mask, or their sums if it has more than CONDENSED."""
    for c in range(len(mask)):
        if not mask[c]:
            continue
        n = found.number[c]
        if n > CONDENSED:
            out.number[c] = _condense(found.y[c], found.h[c], n, covariance[c], out.y[c], out.h[c])
            continue
        out.number[c] = n
        for k in range(n):
            out.y[c, k] = found.y[c, k]
            out.h[c, k] = found.h[c, k]


@kernel
def _condense(y: Floats, h: Floats, n: int, p: Floats, sum_y: Floats, sum_h: Floats) -> int:
    """Write fewer rows that say the same as n rows with noise of variance one, and return their number.

    Args:
        y: (m,), innovations.
        h: (m, 12), their derivatives.
        n: number of rows.
        p: (12, 12), covariance of the prediction.
        sum_y: (13,), or as many as there are rows if these are fewer: receives the innovations.
        sum_h: (13, 12), likewise: receives their derivatives.
    """
    lower, total, moved = np.zeros((STATES, STATES)), np.zeros(STATES), np.empty(STATES)
    square, _ = _root_of_sums(y, h, n, lower, total, moved)
    count = 0
    for j in range(STATES):
        if j >= POSE and _worth(j, lower, p) < NEGLIGIBLE:
            square += total[j] * total[j]
            continue
        sum_y[count] = total[j]
        sum_h[count] = 0.0
        for i in range(j, STATES):
            sum_h[count, ORDER[i]] = lower[i, j]
        count += 1
    if count < n:
        sum_y[count], sum_h[count] = np.sqrt(max(square, 0.0)), 0.0
        count += 1
    return count


@kernel
def _root_of_sums(y: Floats, h: Floats, n: int, lower: Floats, total: Floats, moved: Floats) -> tuple[float, bool]:
    """Write L and L^-1 H^T y of n rows, of numbers or of lanes; return y^T y - |L^-1 H^T y|^2, and whether the rows
    decide the pose.

    Args:
        y: (m,), innovations.
        h: (m, 12), their derivatives.
        n: number of rows.
        lower: (12, 12), zero, receives L; its rows and columns are in the order ORDER.
        total: (12,), zero, receives L^-1 H^T y.
        moved: (12,), workspace.
    """
    square = y[0] * 0.0
    for k in range(n):
        square += y[k] * y[k]
        for i in range(STATES):
            moved[i] = h[k, ORDER[i]]
        for i in range(STATES):
            total[i] += moved[i] * y[k]
            for j in range(i + 1):
                lower[i, j] += moved[i] * moved[j]
    decided = square == square
    for j in range(STATES):
        before, pivot = lower[j, j], lower[j, j]
        for k in range(j):
            pivot -= lower[j, k] * lower[j, k]
        told = pivot > ROUNDING * before
        if j < POSE:
            decided = decided & told
        scale = select(told, 1 / np.sqrt(pivot), 0.0)
        for i in range(j, STATES):
            value = lower[i, j]
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            lower[i, j] = value * scale
        value = total[j]
        for k in range(j):
            value -= lower[j, k] * total[k]
        total[j] = value * scale
        square -= total[j] * total[j]
    return square, decided


@kernel
def _worth(j: int, lower: Floats, p: Floats) -> float:
    """Return the information of sum j, one of the rates alone, relative to that of a prediction, of numbers or lanes.

    Args:
        j: its place behind the pose's.
        lower: (12, 12), L.
        p: (12, 12), covariance of the prediction.
    """
    worth: float = lower[j, j] * 0.0
    for i in range(j, STATES):
        for k in range(j, STATES):
            worth += lower[i, j] * p[ORDER[i], ORDER[k]] * lower[k, j]
    return worth


class PoseSums(NamedTuple):
    """Sums of many rows of C craft as measurements y = [I B] x + noise of their poses.

    told: (C,), the craft that have them. y: (C, 6). h: (C, 6, 12), [I B]. r: (C, 6, 6), covariance of the noise.
    square: (C,), what the rows have beyond, for the gate. rows: (C,), number of rows. log_determinant: (C,), of the
    sums' information on the pose: what log det S of the rows themselves has beyond that of y.
    """

    told: Bools
    y: Floats
    h: Floats
    r: Floats
    square: Floats
    rows: Ints
    log_determinant: Floats


def pose_sums(
    rows: RowBatch, kept: Bools, mask: Bools, light: StationArrays, point_m: Floats, state: State, covariance: Floats
) -> PoseSums:
    """Return the sums of the craft of the mask that have more than CONDENSED rows, as poses.

    Only of craft whose rows decide the pose and, compared with the prediction, tell next to nothing of the rates, with
    all photodiodes in front of their stations, and whose attitude is not so wide that a correction bends.

    Args:
        rows: rows of the C craft.
        kept: (N,), the rows that are used.
        mask: (C,), the craft concerned.
        light: stations that the rows name.
        point_m: (C, K, 3) [m], photodiodes in the body frames.
        state: predicted states.
        covariance: (C, 12, 12) of the predictions.
    """
    craft = len(mask)
    out = PoseSums(
        np.zeros(craft, dtype=np.bool_),
        np.empty((craft, POSE)),
        np.zeros((craft, POSE, STATES)),
        np.empty((craft, POSE, POSE)),
        np.empty(craft),
        np.zeros(craft, dtype=np.int64),
        np.zeros(craft),
    )
    _pose_sums_into(rows, kept, mask, light, np.ascontiguousarray(point_m), state, covariance, out)
    return out


class _Places(NamedTuple):
    """Places for four craft: own (L, m), the rows of each; number, at, size (L,): how many, those behind, and those of
    a sweep; y (m,), h (m, 12), point (3,), state (18,), lower, inverse, p (12, 12), total, moved (12,), lanes.
    """

    own: Ints
    number: Ints
    at: Ints
    size: Ints
    y: Floats
    h: Floats
    point: Floats
    state: Floats
    lower: Floats
    inverse: Floats
    p: Floats
    total: Floats
    moved: Floats


@kernel
def _places(most: int) -> _Places:
    """Return places for craft of up to `most` rows, padded."""
    small = lanes_in(np.empty((3, STATES, LANES)))
    large = lanes_in(np.empty((3, STATES, STATES, LANES)))
    counts = np.empty((3, LANES), np.int64)
    return _Places(
        np.empty((LANES, most), np.int64),
        counts[0],
        counts[1],
        counts[2],
        lanes_in(np.empty((most, LANES))),
        lanes_in(np.empty((most, STATES, LANES))),
        small[2],
        lanes_in(np.empty((18, LANES))),
        large[0],
        large[1],
        large[2],
        small[0],
        small[1],
    )


@kernel
def _pose_sums_into(
    rows: RowBatch,
    kept: Bools,
    mask: Bools,
    light: StationArrays,
    point: Floats,
    state: State,
    covariance: Floats,
    out: PoseSums,
) -> None:
    """Write the sums of every craft of the mask, four at a time in the order of the number of their rows."""
    craft, most = len(mask), 0
    for c in range(craft):
        n = 0
        for r in range(rows.first[c], rows.first[c + 1]):
            n += kept[r]
        out.rows[c] = n if mask[c] and n > CONDENSED and not is_wide(covariance[c]) else 0
        most = max(most, out.rows[c])
    if most == 0:
        return
    begin, order = np.zeros(most + 2, np.int64), np.empty(craft + LANES, np.int64)
    for c in range(craft):
        begin[out.rows[c] + 1] += 1
    first = begin[1]
    for n in range(most + 1):
        begin[n + 1] += begin[n]
    for c in range(craft):
        order[begin[out.rows[c]]] = c
        begin[out.rows[c]] += 1
    for i in range(LANES):
        order[craft + i] = order[craft - 1]
    # A sweep has as many rows as the craft of the four that has most of it.
    places, alone = _places(LANES * most), np.empty(LANES, np.int64)
    for start in range(first, craft, LANES):
        who = order[start : start + LANES]
        if not _four_sums(who, rows, kept, light, point, state, covariance, places, out):
            # Craft before other sweeps, or one whose photodiode is not in front: each by itself.
            for i in range(min(LANES, craft - start)):
                alone[:] = who[i]
                _four_sums(alone, rows, kept, light, point, state, covariance, places, out)


@kernel
def _four_sums(
    who: Ints,
    rows: RowBatch,
    kept: Bools,
    light: StationArrays,
    point: Floats,
    state: State,
    covariance: Floats,
    places: _Places,
    out: PoseSums,
) -> bool:
    """Write the sums of four craft; return False, and write none, where they have not the same sweeps, or a photodiode
    is not in front of its station.

    Args:
        who: (L,), the craft.
        rows: rows of the C craft.
        kept: (N,), the rows that are used.
        light: stations that the rows name.
        point: (C, K, 3) [m].
        state: predicted states.
        covariance: (C, 12, 12) of the predictions.
        places: workspace.
        out: receives them.
    """
    own, y, h, s, lower = places.own, places.y, places.h, places.state, places.lower
    for i in range(LANES):
        c, n = who[i], 0
        for r in range(rows.first[c], rows.first[c + 1]):
            if kept[r]:
                own[i, n] = r
                n += 1
        places.number[i], places.at[i] = n, 0
    craft = len(state.position)
    rows_of(state.rotation.reshape(craft, 9), who, s[:9])
    rows_of(state.position, who, s[9:12])
    rows_of(state.velocity, who, s[12:15])
    rows_of(state.angular_rate, who, s[15:18])
    n = 0
    while places.at[0] < places.number[0]:
        added = _sweep_of_four(who, n, rows, light, point, places)
        if added == 0:
            return False
        n += added
    for i in range(LANES):
        if places.at[i] < places.number[i]:
            return False
    for i in range(STATES):
        places.total[i] = 0.0
        for j in range(STATES):
            lower[i, j] = 0.0
    square, told = _root_of_sums(y, h, n, lower, places.total, places.moved)
    rows_of(covariance.reshape(craft, STATES * STATES), who, places.p.reshape(STATES * STATES))
    for j in range(POSE, STATES):
        told = told & (_worth(j, lower, places.p) < LITTLE)
        square += places.total[j] * places.total[j]
    _solve_pose(lower, places.total, places.inverse)
    for i in range(LANES):
        if lane(told, i):
            _write_sums(who[i], i, square, places, out)
    return True


@kernel
def _sweep_of_four(who: Ints, n: int, rows: RowBatch, light: StationArrays, point: Floats, places: _Places) -> int:
    """Write the next sweep's rows of four craft behind the first n, whitened, and zero where one of them has fewer;
    return how many, 0 where the craft have not the same sweep, or a photodiode is not in front of its station.

    Args:
        who: (L,), the craft.
        n: rows before.
        rows: rows of the C craft.
        light: stations that the rows name.
        point: (C, K, 3) [m].
        places: of the four craft.
    """
    own, at, size, y, h, s = places.own, places.at, places.size, places.y, places.h, places.state
    one = own[0, at[0]]
    station, fan, most = rows.station[one], rows.fan[one], 0
    for i in range(LANES):
        if at[i] >= places.number[i]:
            return 0
        begin = own[i, at[i]]
        if rows.station[begin] != station or rows.fan[begin] != fan:
            return 0
        size[i] = 0
        while at[i] + size[i] < places.number[i]:
            r = own[i, at[i] + size[i]]
            if rows.station[r] != station or rows.fan[r] != fan or rows.sweep[r] != rows.sweep[begin]:
                break
            size[i] += 1
        most = max(most, size[i])
    number = pack(float(size[0]), float(size[1]), float(size[2]), float(size[3]))
    mean, total = number * 0.0, places.total
    for i in range(STATES):
        total[i] = 0.0
    for k in range(most):
        a = own[0, at[0] + (k if k < size[0] else 0)]
        b = own[1, at[1] + (k if k < size[1] else 0)]
        c = own[2, at[2] + (k if k < size[2] else 0)]
        d = own[3, at[3] + (k if k < size[3] else 0)]
        for i in range(3):
            places.point[i] = pack(
                point[who[0], rows.photodiode[a], i],
                point[who[1], rows.photodiode[b], i],
                point[who[2], rows.photodiode[c], i],
                point[who[3], rows.photodiode[d], i],
            )
        y[n + k] = row_into(
            pack(rows.offset_s[a], rows.offset_s[b], rows.offset_s[c], rows.offset_s[d]),
            pack(rows.angle[a], rows.angle[b], rows.angle[c], rows.angle[d]),
            light.rotation[station],
            light.position[station],
            light.fans[light.first[station] + fan],
            places.point,
            s[:9].reshape(3, 3),
            s[9:12],
            s[12:15],
            s[15:18],
            h[n + k],
        )
        if any_of(y[n + k] != y[n + k]):
            return 0
        mean += select(number > k, y[n + k], 0.0)
        for i in range(STATES):
            total[i] += select(number > k, h[n + k, i], 0.0)
    noise, shared = light.own[station], light.shared[station]
    share = (1 - noise / np.sqrt(noise * noise + number * shared * shared)) / number
    over = 1 / noise
    for k in range(most):
        y[n + k] = select(number > k, (y[n + k] - share * mean) * over, 0.0)
        for i in range(STATES):
            h[n + k, i] = select(number > k, (h[n + k, i] - share * total[i]) * over, 0.0)
    for i in range(LANES):
        at[i] += size[i]
    return most


@kernel
def _solve_pose(lower: Floats, total: Floats, inverse: Floats) -> None:
    """Solve the pose's six rows of L^T for the pose, of numbers or of lanes, by back substitution: [U V] x = z becomes
    [I B] x = U^-1 z.

    Args:
        lower: (12, 12), L; V^T becomes B^T.
        total: (12,), z; becomes U^-1 z.
        inverse: (12, 12), receives U^-1 in its first six rows and columns.
    """
    for j in range(POSE - 1, -1, -1):
        over = 1 / lower[j, j]
        for i in range(j + 1, POSE):
            total[j] -= lower[i, j] * total[i]
            for k in range(POSE, STATES):
                lower[k, j] -= lower[i, j] * lower[k, i]
        total[j] *= over
        for k in range(POSE, STATES):
            lower[k, j] *= over
        for k in range(j, POSE):
            value = over * 0.0 + (1.0 if k == j else 0.0)
            for i in range(j + 1, k + 1):
                value -= lower[i, j] * inverse[i, k]
            inverse[j, k] = value * over


@kernel
def _write_sums(c: int, i: int, square: float, places: _Places, out: PoseSums) -> None:
    """Write lane i of the sums of four craft as those of craft c.

    Args:
        c: the craft.
        i: the lane.
        square: lanes, what the rows have beyond.
        places: of the four craft, with the solved pose.
        out: receives them.
    """
    lower, inverse, volume = places.lower, places.inverse, 1.0
    out.told[c] = True
    out.square[c] = max(lane(square, i), 0.0)
    for a in range(POSE):
        volume *= lane(inverse[a, a], i)
        out.y[c, a] = lane(places.total[a], i)
        out.h[c, a, ORDER[a]] = 1.0
        for k in range(POSE, STATES):
            out.h[c, a, ORDER[k]] = lane(lower[k, a], i)
        for b in range(a + 1):
            value = 0.0
            for k in range(a, POSE):
                value += lane(inverse[a, k], i) * lane(inverse[b, k], i)
            out.r[c, a, b] = out.r[c, b, a] = value
    out.log_determinant[c] = -2 * np.log(volume)
