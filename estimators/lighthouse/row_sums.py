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
from estimators.lanes import LANES, all_of, lane, lanes_in, pack, select
from estimators.lighthouse.innovation import Innovations, RowBatch, StationArrays
from estimators.lighthouse.rows import arm_and_place, seen, slopes_into
from estimators.lighthouse.side_by_side import Places, rows_of
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
    angles = np.where(mask, found.number, 0)
    if most <= CONDENSED:
        return Innovations(found.y, found.h, angles, found.pivot), angles
    width = min(most, STATES + 1)
    number = np.zeros_like(found.number)
    out = Innovations(np.empty((craft, width)), np.empty((craft, width, STATES)), number, found.pivot)
    _condense_all(mask, covariance, found, out)
    return out, angles


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
            for i in range(STATES):
                out.h[c, k, i] = found.h[c, k, i]


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
    lower, total = np.empty((STATES, STATES)), np.empty(STATES)
    square, _ = _root_of_sums(y, h, n, lower, total)
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
def _root_of_sums(y: Floats, h: Floats, n: int, lower: Floats, total: Floats) -> tuple[float, bool]:
    """Write L and L^-1 H^T y of n rows, of numbers or of lanes; return y^T y - |L^-1 H^T y|^2, and whether the rows
    decide the pose.

    Args:
        y: (m,), innovations.
        h: (m, 12), their derivatives.
        n: number of rows.
        lower: (12, 12), receives L; its rows and columns are in the order ORDER.
        total: (12,), receives L^-1 H^T y.
    """
    square = y[0] * 0.0
    for k in range(n):
        square += y[k] * y[k]
    for i in range(0, STATES, 3):
        _products_with(y, h, n, i, total)
        for j in range(0, i + 1, 3):
            _products(h, n, i, j, lower)
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
def _products(h: Floats, n: int, i: int, j: int, out: Floats) -> None:
    """Write three by three elements of H^T H from row i and column j on, of n rows of numbers or of lanes.

    In registers, not in the matrix: a sum in memory waits for the one before.
    """
    a, b, c, d, e, f = ORDER[i], ORDER[i + 1], ORDER[i + 2], ORDER[j], ORDER[j + 1], ORDER[j + 2]
    ad = ae = af = bd = be = bf = cd = ce = cf = h[0, 0] * 0.0
    for k in range(n):
        x, y, z, u, v, w = h[k, a], h[k, b], h[k, c], h[k, d], h[k, e], h[k, f]
        ad, ae, af = ad + x * u, ae + x * v, af + x * w
        bd, be, bf = bd + y * u, be + y * v, bf + y * w
        cd, ce, cf = cd + z * u, ce + z * v, cf + z * w
    out[i, j], out[i, j + 1], out[i, j + 2] = ad, ae, af
    out[i + 1, j], out[i + 1, j + 1], out[i + 1, j + 2] = bd, be, bf
    out[i + 2, j], out[i + 2, j + 1], out[i + 2, j + 2] = cd, ce, cf


@kernel
def _products_with(y: Floats, h: Floats, n: int, i: int, out: Floats) -> None:
    """Write three elements of H^T y from row i on, of n rows of numbers or of lanes."""
    a, b, c = ORDER[i], ORDER[i + 1], ORDER[i + 2]
    p = q = r = h[0, 0] * 0.0
    for k in range(n):
        p, q, r = p + h[k, a] * y[k], q + h[k, b] * y[k], r + h[k, c] * y[k]
    out[i], out[i + 1], out[i + 2] = p, q, r


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
        np.empty((craft, POSE, STATES)),
        np.empty((craft, POSE, POSE)),
        np.empty(craft),
        np.zeros(craft, dtype=np.int64),
        np.zeros(craft),
    )
    _pose_sums_into(rows, kept, mask, light, np.ascontiguousarray(point_m), state, covariance, out)
    return out


class _Places(NamedTuple):
    """Places for four craft, lanes but for counts.

    alone (L,): one craft in the place of four. at, size (L,): the row that comes next of each, and how many a sweep
    has. row, spot (m, L): a sweep's rows, and their photodiodes as c K + k; unsigned, for an index that may be negative
    takes longer. Of a sweep: tau (m,), point, arm, place (m, 3). Of all: y (m,), h (m, 12), turn (9,) and the same as
    rotation (3, 3), position, velocity, rate (3,), p, of the rates alone, lower, inverse (12, 12), total (12,).
    """

    alone: Ints
    at: Ints
    size: Ints
    row: Places
    spot: Places
    tau: Floats
    point: Floats
    arm: Floats
    place: Floats
    y: Floats
    h: Floats
    turn: Floats
    rotation: Floats
    position: Floats
    velocity: Floats
    rate: Floats
    p: Floats
    lower: Floats
    inverse: Floats
    total: Floats


@kernel
def _places(most: int) -> _Places:
    """Return places for craft of up to `most` rows, padded."""
    vectors = lanes_in(np.empty((3, 3, LANES)))
    large = lanes_in(np.empty((3, STATES, STATES, LANES)))
    turn = lanes_in(np.empty((9, LANES)))
    sweep = lanes_in(np.empty((3, most, 3, LANES)))
    counts, which = np.empty((3, LANES), np.int64), np.empty((2, most, LANES), np.uint64)
    return _Places(
        counts[0],
        counts[1],
        counts[2],
        which[0],
        which[1],
        lanes_in(np.empty((most, LANES))),
        sweep[0],
        sweep[1],
        sweep[2],
        lanes_in(np.empty((most, LANES))),
        lanes_in(np.empty((most, STATES, LANES))),
        turn,
        turn.reshape(3, 3),
        vectors[0],
        vectors[1],
        vectors[2],
        large[0],
        large[1],
        large[2],
        lanes_in(np.empty((STATES, LANES))),
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
    flat = point.reshape(-1, 3), state.rotation.reshape(craft, 9)
    _all_sums(order[first:], rows, kept, light, point.shape[1], state, covariance, flat, _places(LANES * most), out)


@kernel
def _all_sums(
    order: Ints,
    rows: RowBatch,
    kept: Bools,
    light: StationArrays,
    photodiodes: int,
    state: State,
    covariance: Floats,
    flat: tuple[Floats, Floats],
    places: _Places,
    out: PoseSums,
) -> None:
    """Write the sums of craft, four at a time. By itself: what makes arrays counts references to all at every call.

    Args:
        order: (n + L,), the craft, the last one once more for every lane that is left over.
        rows: rows of the C craft.
        kept: (N,), the rows that are used.
        light: stations that the rows name.
        photodiodes: K.
        state: predicted states.
        covariance: (C, 12, 12) of the predictions.
        flat: points (C K, 3) [m] and predicted rotations (C, 9).
        places: workspace.
        out: receives them.
    """
    for start in range(0, len(order) - LANES, LANES):
        who = order[start : start + LANES]
        if _four_sums(who, rows, kept, light, photodiodes, state, covariance, flat, places, out):
            continue
        # Craft before other sweeps, or one whose photodiode is not in front: each by itself.
        for i in range(min(LANES, len(order) - LANES - start)):
            for k in range(LANES):
                places.alone[k] = who[i]
            _four_sums(places.alone, rows, kept, light, photodiodes, state, covariance, flat, places, out)


@kernel
def _four_sums(
    who: Ints,
    rows: RowBatch,
    kept: Bools,
    light: StationArrays,
    photodiodes: int,
    state: State,
    covariance: Floats,
    flat: tuple[Floats, Floats],
    places: _Places,
    out: PoseSums,
) -> bool:
    """Write the sums of four craft (L,); return False, and write none, where they have not the same sweeps, or a
    photodiode is not in front of its station. The other arguments are those of `_all_sums`.
    """
    point, rotation = flat
    lower = places.lower
    for i in range(LANES):
        places.at[i] = rows.first[who[i]]
    rows_of(rotation, who, places.turn)
    rows_of(state.position, who, places.position)
    rows_of(state.velocity, who, places.velocity)
    rows_of(state.angular_rate, who, places.rate)
    for i in range(POSE, STATES):
        for k in range(POSE, STATES):
            a, b = ORDER[i], ORDER[k]
            places.p[a, b] = pack(
                covariance[who[0], a, b], covariance[who[1], a, b], covariance[who[2], a, b], covariance[who[3], a, b]
            )
    n, added = 0, 1
    while added > 0:
        added = _sweep_of_four(who, n, rows, kept, light, point, photodiodes, places)
        n += max(added, 0)
    if added < 0:
        return False
    square, told = _root_of_sums(places.y, places.h, n, lower, places.total)
    for j in range(POSE, STATES):
        told = told & (_worth(j, lower, places.p) < LITTLE)
        square += places.total[j] * places.total[j]
    _solve_pose(lower, places.total, places.inverse)
    for i in range(LANES):
        if lane(told, i):
            _write_sums(who[i], i, square, places, out)
    return True


@kernel
def _sweep_of_four(
    who: Ints,
    n: int,
    rows: RowBatch,
    kept: Bools,
    light: StationArrays,
    point: Floats,
    photodiodes: int,
    places: _Places,
) -> int:
    """Write the next sweep's rows of four craft behind the first n, whitened, and zero where one of them has fewer;
    return how many: 0 where none has another one, -1 where they have not the same one, or a photodiode is not in front
    of its station.

    Args:
        who: (L,), the craft.
        n: rows before.
        rows: rows of the C craft.
        kept: (N,), the rows that are used.
        light: stations that the rows name.
        point: (C K, 3) [m].
        photodiodes: K.
        places: of the four craft.
    """
    at, size, row, spot, y, h = places.at, places.size, places.row, places.spot, places.y, places.h
    station, fan, most, fewest = -1, -1, 0, len(row)
    for i in range(LANES):
        r, end, count = at[i], rows.first[who[i] + 1], 0
        while r < end and not kept[r]:
            r += 1
        if r < end:
            sweep = rows.sweep[r]
            if i == 0:
                station, fan = rows.station[r], rows.fan[r]
            elif rows.station[r] != station or rows.fan[r] != fan:
                return -1
            while r < end and rows.station[r] == station and rows.fan[r] == fan and rows.sweep[r] == sweep:
                if kept[r]:
                    row[count, i], spot[count, i] = r, who[i] * photodiodes + rows.photodiode[r]
                    count += 1
                r += 1
        at[i], size[i] = r, count
        most, fewest = max(most, count), min(fewest, count)
    if fewest == 0:
        return 0 if most == 0 else -1
    for i in range(LANES):
        for k in range(size[i], most):
            row[k, i], spot[k, i] = row[0, i], spot[0, i]
    number = pack(float(size[0]), float(size[1]), float(size[2]), float(size[3]))
    mean, total = number * 0.0, places.total
    for i in range(STATES):
        total[i] = 0.0
    for k in range(most):
        a, b, c, d = row[k, 0], row[k, 1], row[k, 2], row[k, 3]
        places.tau[k] = pack(rows.offset_s[a], rows.offset_s[b], rows.offset_s[c], rows.offset_s[d])
        y[n + k] = pack(rows.angle[a], rows.angle[b], rows.angle[c], rows.angle[d])
        a, b, c, d = spot[k, 0], spot[k, 1], spot[k, 2], spot[k, 3]
        for i in range(3):
            places.point[k, i] = pack(point[a, i], point[b, i], point[c, i], point[d, i])
    # One step of all rows after the other: those of one row wait for each other.
    seat, at_m, front = light.rotation[station], light.position[station], number > 0
    rotation, position, velocity, rate = places.rotation, places.position, places.velocity, places.rate
    laser = light.fans[light.first[station] + fan]
    for k in range(most):
        arm, q = arm_and_place(places.tau[k], places.point[k], seat, at_m, rotation, position, velocity, rate)
        for i in range(3):
            places.arm[k, i], places.place[k, i] = arm[i], q[i]
        front = front & (q[2] > 0)
    if not all_of(front):
        return -1
    for k in range(most):
        q = places.place[k]
        expected, u = seen((q[0], q[1], q[2]), laser, seat)
        y[n + k] -= expected
        mean += select(number > k, y[n + k], 0.0)
        for i in range(3):
            q[i] = u[i]
    for k in range(most):
        arm, u = places.arm[k], places.place[k]
        slopes_into(places.tau[k], (arm[0], arm[1], arm[2]), (u[0], u[1], u[2]), rate, h[n + k])
    for k in range(most):
        for i in range(STATES):
            total[i] += select(number > k, h[n + k, i], 0.0)
    noise, shared = light.own[station], light.shared[station]
    share = (1 - noise / np.sqrt(noise * noise + number * shared * shared)) / number
    over = 1 / noise
    for k in range(most):
        y[n + k] = select(number > k, (y[n + k] - share * mean) * over, 0.0)
        for i in range(STATES):
            h[n + k, i] = select(number > k, (h[n + k, i] - share * total[i]) * over, 0.0)
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
        for b in range(POSE):
            out.h[c, a, ORDER[b]] = 1.0 if a == b else 0.0
        for k in range(POSE, STATES):
            out.h[c, a, ORDER[k]] = lane(lower[k, a], i)
        for b in range(a + 1):
            value = 0.0
            for k in range(a, POSE):
                value += lane(inverse[a, k], i) * lane(inverse[b, k], i)
            out.r[c, a, b] = out.r[c, b, a] = value
    out.log_determinant[c] = -2 * np.log(volume)
