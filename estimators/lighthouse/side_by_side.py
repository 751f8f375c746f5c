"""Tables of the sweep angles of several craft side by side, whose kernels take lanes (`estimators.lanes`).

A table of `projection` with lanes for numbers, wide ones: as many craft as the processor has room for. A craft has as
many rows as the one of them that sees most: those that it does not see repeat its first photodiode with weight zero,
after its own, so that no sum of its own rows changes by a bit. Craft are taken in the order of the number of
photodiodes that they see.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints, lined
from estimators.kernel import inlined, kernel
from estimators.lanes import (
    FOURS,
    LANES,
    WIDE,
    alike,
    fours_in,
    lanes_in,
    select,
    transposed,
    wide_in,
    width,
    with_lane,
)
from estimators.lighthouse.projection import COLUMNS, VALUE, WEIGHT, checked, write_motion
from estimators.rotation import exp_rows
from estimators.scratch import scratch

Places = NDArray[np.uint64]


class Room(NamedTuple):
    """Places for what is known of C craft with K photodiodes as they are taken.

    counts: (C, 1), number of each craft's lit photodiodes. order: (C + WIDE,), the craft in their order, the last one
    once more for every lane that is left over. begin: (K + 2,), where the craft of so many begin. seen: (K, L), of
    `seen_by`. table: (2 K, COLUMNS, WIDE), numbers. answer: (15, WIDE), numbers of each craft's answer.
    """

    counts: Ints
    order: Ints
    begin: Ints
    seen: Places
    table: Floats
    answer: Floats


def room_for(craft: int, photodiodes: int) -> Room:
    """Return places for so many craft and photodiodes."""
    count, order, begin = (np.empty(n, dtype=np.int64) for n in ((craft, 1), craft + WIDE, photodiodes + 2))
    seen, table = np.empty((photodiodes, WIDE), dtype=np.uint64), lined(2 * photodiodes, COLUMNS, WIDE)
    return Room(count, order, begin, seen, table, np.empty((15, WIDE)))


@kernel
def in_order(lit: Bools, mask: Bools, fewest: int, room: Room) -> int:
    """Put the craft that see at least `fewest` photodiodes in order, by their number; return how many they are.

    Args:
        lit: (C, K).
        mask: (C,), the craft to take.
        fewest: photodiodes at least.
        room: receives the counts and the order.
    """
    craft, photodiodes = lit.shape
    count, order, begin = room.counts, room.order, room.begin
    for n in range(photodiodes + 2):
        begin[n] = 0
    for c in range(craft):
        n = 0
        for k in range(photodiodes):
            n += lit[c, k]
        count[c, 0] = n
        if mask[c] and n >= fewest:
            begin[n + 1] += 1
    for n in range(photodiodes + 1):
        begin[n + 1] += begin[n]
    for c in range(craft):
        n = count[c, 0]
        if mask[c] and n >= fewest:
            order[begin[n]] = c
            begin[n] += 1
    taken = begin[photodiodes]
    for i in range(WIDE if taken else 0):
        order[taken + i] = order[taken - 1]
    return int(taken)


@kernel
def seen_by(who: Ints, lit: Bools, most: int, seen: Places) -> None:
    """Write each craft's lit photodiodes, then its first one again up to `most` of them, into `seen` (K, L).

    Args:
        who: (L,), craft.
        lit: (C, K).
        most: number to write.
        seen: receives c K + k for photodiode k of craft c. Unsigned: an index that may be negative takes longer.
    """
    for i in range(WIDE):
        c = who[i]
        n, first = 0, c * lit.shape[1]
        for k in range(lit.shape[1]):
            seen[n, i] = first + k
            n += lit[c, k]
            if n == most:
                break
        for j in range(n, most):
            seen[j, i] = seen[0, i]


@inlined
def taken(like: float, source: Floats | Ints, places: Ints | Places, at: int) -> float:
    """Return a column of some rows of an array as lanes.

    Args:
        like: lanes, as many as rows.
        source: (N, m).
        places: (L,), the rows.
        at: the column.
    """
    out = alike(like, float(source[places[0], at]))
    for i in range(1, width(like)):
        out = with_lane(out, i, float(source[places[i], at]))
    return out


@kernel
def rows_of(source: Floats, who: Ints, out: Floats) -> None:
    """Write the rows of some craft into lanes.

    Args:
        source: (C, m).
        who: (L,), craft.
        out: (m,), lanes.
    """
    for m in range(source.shape[1]):
        out[m] = taken(out[m], source, who, m)


@kernel
def matrices_of(source: Floats, who: Ints, out: Floats) -> None:
    """Write matrices of some craft into lanes.

    Args:
        source: (C, 9).
        who: (L,), craft.
        out: (3, 3), lanes.
    """
    for i in range(3):
        for j in range(3):
            out[i, j] = taken(out[i, j], source, who, 3 * i + j)


class Given(NamedTuple):
    """The poses and angles of C craft with K photodiodes that a table is made of, flat.

    lit: (C, K). rotation: (C, 9), position: (C, 3) [m], of the poses. point: (C K, 3) [m]. offset: (C K, 2) [s].
    angular_rate, velocity: (C, 3) [rad/s], [m/s].
    """

    lit: Bools
    rotation: Floats
    position: Floats
    point: Floats
    offset: Floats
    angular_rate: Floats
    velocity: Floats


def given(
    lit: Bools,
    rotation: Floats,
    position: Floats,
    point_m: Floats,
    offset_s: Floats,
    angular_rate: Floats,
    velocity: Floats,
) -> Given:
    """Return poses and angles, checked against the shape of `lit`, and flat.

    Args:
        lit: (C, K), photodiodes whose angles count.
        rotation: (C, 3, 3).
        position: (C, 3) [m].
        point_m: (C, K, 3) [m], body frame.
        offset_s: (C, K, 2) [s], instants of the angles minus the epoch.
        angular_rate: (C, 3) [rad/s].
        velocity: (C, 3) [m/s].

    Raises:
        ValueError: a shape does not fit; the message names the argument.
    """
    craft, photodiodes = lit.shape
    return Given(
        lit,
        checked("rotation", rotation, (craft, 3, 3)).reshape(craft, 9),
        checked("position", position, (craft, 3)),
        checked("point_m", point_m, (craft, photodiodes, 3)).reshape(-1, 3),
        checked("offset_s", offset_s, (craft, photodiodes, 2)).reshape(-1, 2),
        checked("angular_rate", angular_rate, (craft, 3)),
        checked("velocity", velocity, (craft, 3)),
    )


@inlined
def gather_craft(who: Ints, n: int, of: Given, room: Room, turn: Floats, place: Floats) -> None:
    """Write the poses and the angles of some craft into lanes: the table of `room`, without values and weights.

    Args:
        who: (L,), craft.
        n: rows of each fan.
        of: all craft.
        room: receives the table, and where its rows are from.
        turn: (3, 3), lanes, receives the rotations.
        place: (3,), lanes, receives the positions [m].
    """
    table = wide_in(room.table)
    rate, speed = scratch(table, 3), scratch(table, 3)
    seen_by(who, of.lit, n, room.seen)
    matrices_of(of.rotation, who, turn)
    rows_of(of.position, who, place)
    rows_of(of.angular_rate, who, rate)
    rows_of(of.velocity, who, speed)
    gather_lanes(room.seen, n, of.point, of.offset, rate, speed, table)


@inlined
def scatter_four(numbers: Floats, who: Ints, at: int, out: Floats) -> None:
    """Write four numbers of some craft, in lanes, to their places.

    Args:
        numbers: (4,), wide lanes.
        who: (L,), craft; those that are there twice have the same.
        at: the place.
        out: (C, m, 4), receives them at (., at).
    """
    places, four = lanes_in(out), scratch(numbers, LANES)
    parts = fours_in(four)
    four[0], four[1], four[2], four[3] = transposed(numbers[0], numbers[1], numbers[2], numbers[3])
    for i in range(LANES):
        for side in range(FOURS):
            places[who[LANES * side + i], at] = parts[i, side]


@inlined
def scatter_matrices(matrix: Floats, who: Ints, out: Floats) -> None:
    """Write matrices of some craft, in lanes, to their places.

    Args:
        matrix: (6, 6), wide lanes.
        who: (L,), craft; those that are there twice have the same.
        out: (C, 9, 4), receives their numbers.
    """
    numbers = matrix.reshape(36)
    for k in range(9):
        scatter_four(numbers[LANES * k : LANES * k + LANES], who, k, out)


@kernel
def gather_lanes(
    seen: Places,
    n: int,
    point: Floats,
    offset: Floats,
    angular_rate: Floats,
    velocity: Floats,
    out: Floats,
) -> None:
    """Write the angles of some craft into a table, n rows of fan X and n of fan Y, as `projection.gather`.

    Args:
        seen: of `seen_by`.
        n: rows of each fan.
        point: (C K, 3) [m].
        offset: (C K, 2) [s].
        angular_rate: (3,), lanes [rad/s].
        velocity: (3,), lanes [m/s].
        out: (2 K, COLUMNS), lanes, receives the rows.
    """
    for row in range(n):
        places = seen[row]
        for axis in range(3):
            place = taken(angular_rate[0], point, places, axis)
            out[row, axis] = place
            out[n + row, axis] = place
        for fan in range(2):
            tau = taken(angular_rate[0], offset, places, fan)
            turn = exp_rows(angular_rate[0] * tau, angular_rate[1] * tau, angular_rate[2] * tau)
            own = turn[0] if fan == 0 else turn[1]
            write_motion(out, fan * n + row, own, turn[2], velocity[fan], velocity[2], tau)


@kernel
def gather_measured_lanes(seen: Places, n: int, number: float, uv: Floats, weight: Floats, out: Floats) -> bool:
    """Write the value and the weight of each angle into a table; return where all of them are finite.

    Args:
        seen: of `seen_by`.
        n: rows of each fan.
        number: lanes, photodiodes that each craft sees.
        uv: (C K, 2), values.
        weight: (C K, 2), inverse noise; or empty where the values are those of angles with equal noise (13).
        out: (2 K, COLUMNS), lanes, receives the columns.
    """
    finite = True
    for row in range(n):
        places = seen[row]
        u, v = taken(number, uv, places, 0), taken(number, uv, places, 1)
        wider, higher = 1 + u * u, 1 + v * v
        over = 1 / (wider * higher)
        w_u, w_v = higher * over, wider * over
        if weight.size > 0:
            w_u, w_v = taken(number, weight, places, 0), taken(number, weight, places, 1)
        finite = finite & (abs(w_u * u) < np.inf) & (abs(w_v * v) < np.inf)
        own = number > row
        out[row, VALUE], out[n + row, VALUE] = u, v
        out[row, WEIGHT], out[n + row, WEIGHT] = select(own, w_u, 0.0), select(own, w_v, 0.0)
    return finite


@kernel
def gather_weights_lanes(seen: Places, n: int, number: float, equal: bool, weight: Floats, out: Floats) -> None:
    """Write the weight of each angle into a table, for `dop`.

    Args:
        seen: of `seen_by`.
        n: rows of each fan.
        number: lanes, photodiodes that each craft sees.
        equal: whether all angles have the weight 1.
        weight: (C K, 2), inverse noise, or empty where all are equal.
        out: (2 K, COLUMNS), lanes, receives the column.
    """
    for row in range(n):
        places = seen[row]
        own = select(number > row, 1.0, 0.0)
        for fan in range(2):
            out[fan * n + row, WEIGHT] = own
            if not equal:
                out[fan * n + row, WEIGHT] = own * taken(number, weight, places, fan)
