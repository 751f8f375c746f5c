"""The rotor of a Lighthouse 2.0 station: from instants of light to sweep angles.

One rotor carries two laser planes, a third of a turn apart, and turns once in 887 000 to 959 000 ticks of 48 MHz, for
each channel another number. With the instants z_n at which it passes its zero, light at the instant t of turn n comes
at

    share   = (t - z_n) / (z_{n+1} - z_n)                                                                          (1)
    alpha_0 = 2 pi share - pi + pi/3,    alpha_1 = 2 pi share - pi - pi/3                                          (2)

radians from boresight, by plane. The rotor's speed differs from turn to turn by some millionths, more than the instants
are uncertain, so the turn's own duration stands below the line in (1), not the mean: recordings at rest scatter by 22 %
to 31 % less. libsurvive divides by the duration of the turn before, which `previous` gives. Where zeros are missing,
the turns between two known ones are taken as equally long.

A share below one half is plane 0's and one above it plane 1's, unless the point is far off to a side: near one half it
can be either's. A point that both planes meet in one turn meets plane 0 first, up to an elevation of 56 degrees
(asin(tan 30 tan e) of 60 degrees): beyond, the planes have crossed, and the order of two hits does not tell.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints

CHANNEL_TICKS = (
    *(959_000, 957_000, 953_000, 949_000, 947_000, 943_000, 941_000, 939_000),
    *(937_000, 929_000, 919_000, 911_000, 907_000, 901_000, 893_000, 887_000),
)
"""Nominal duration of a turn of each channel [ticks of 48 MHz]."""
CHANNEL_CLOCK_HZ = 48e6
UNCERTAIN = 1 / 24
"""Distance of a share from one half within which a single hit may be of either plane [turns]: 15 degrees. Plane 0 meets
a point there only if it is 45 degrees or more off to a side, tilt included."""
_APART = 2e-4
"""Largest relative difference of a turn's duration from the nominal one: eight times that of the worst clock seen."""
_SAME = 1 / 400
"""Zeros within this distance [turns] are observations of one passage."""
_BRIDGED = 50
"""Largest number of turns between two known zeros that are taken as equally long."""
_BEYOND = 1.0
"""Turns before the first zero of a stretch and after its last one that are still decoded."""


class Rotor(NamedTuple):
    """Passages of one rotor's zero, in order, (N,) each.

    zero: instants [ticks]. turn: number of turns since the first. stretch: number of the stretch of turns without a
    long gap. period: mean duration of a turn [ticks], the nominal one where nothing tells. rejected: number of
    observations that fit no turn.
    """

    zero: Floats
    turn: Ints
    stretch: Ints
    period: float
    rejected: int


class Located(NamedTuple):
    """Instants as a rotor's angle, (N,) each: turn, the number of the turn; share, of that turn, NaN if not known."""

    turn: Ints
    share: Floats


class Planes(NamedTuple):
    """Hits as sweeps, (N,) each: plane, 0 or 1, -1 if it cannot be told; angle [rad] from boresight, NaN likewise."""

    plane: Ints
    angle: Floats


def track(observed: Floats, nominal: float) -> Rotor:
    """Return the passages of a rotor's zero.

    Of several observations of one passage the median counts. One that does not lie whole turns after the passage before
    is rejected, unless the next one confirms it: then the rotor was dark for long, or the clock has jumped, and a new
    stretch begins.

    Args:
        observed: instants at which zeros were observed, in any order, (N,) [ticks].
        nominal: nominal duration of a turn [ticks].
    """
    marks, counts = _passages(np.sort(observed), nominal)
    zero: list[float] = []
    turn: list[int] = []
    stretch: list[int] = []
    rejected = 0
    for i, tick in enumerate(marks):
        turns = round((tick - zero[-1]) / nominal) if zero else 0
        if zero and 1 <= turns <= _BRIDGED and abs(tick - zero[-1] - turns * nominal) < _APART * turns * nominal:
            number, part = turn[-1] + turns, stretch[-1]
        elif i + 1 < len(marks) and abs(marks[i + 1] - tick - nominal) < _APART * nominal:
            number, part = (turn[-1] + max(turns, 1), stretch[-1] + 1) if zero else (0, 0)
        else:
            rejected += counts[i]
            continue
        zero.append(tick)
        turn.append(number)
        stretch.append(part)
    return Rotor(*_as_arrays(zero, turn, stretch), _period(zero, turn, stretch, nominal), rejected)


def locate(rotor: Rotor, tick: Floats, *, previous: bool = False) -> Located:
    """Return the rotor's angles at instants (1).

    Args:
        rotor: the passages of its zero.
        tick: instants, (N,) [ticks].
        previous: divide by the duration of the turn before, as libsurvive does.
    """
    known = len(rotor.zero)
    if not known:
        return Located(np.zeros(len(tick), dtype=np.int64), np.full(len(tick), np.nan))
    begin = np.clip(np.searchsorted(rotor.zero, tick, side="right") - 1, 0, known - 1)
    end = np.minimum(begin + 1, known - 1)
    inside = (rotor.zero[begin] <= tick) & (end > begin) & (rotor.stretch[begin] == rotor.stretch[end])
    # Beyond the ends of a stretch the mean period serves, from whichever end is near.
    late = (end > begin) & ~inside & (rotor.zero[end] - tick < tick - rotor.zero[begin])
    begin = np.where(late, end, begin)
    turns = np.where(inside, rotor.turn[end] - rotor.turn[begin], 1)
    period = np.where(inside, (rotor.zero[end] - rotor.zero[begin]) / np.maximum(turns, 1), rotor.period)
    if previous:
        before = np.maximum(begin - 1, 0)
        usable = (before < begin) & (rotor.stretch[before] == rotor.stretch[begin])
        apart = np.maximum(rotor.turn[begin] - rotor.turn[before], 1)
        period = np.where(usable, (rotor.zero[begin] - rotor.zero[before]) / apart, period)
    elapsed = (tick - rotor.zero[begin]) / period
    whole = np.floor(elapsed)
    share = np.where(inside | (np.abs(elapsed - 0.5) <= 0.5 + _BEYOND), elapsed - whole, np.nan)
    return Located(rotor.turn[begin] + whole.astype(np.int64), share)


def planes(located: Located, photodiode: Ints, uncertain: float = UNCERTAIN) -> Planes:
    """Return the plane and the angle of every hit (2).

    Args:
        located: N hits of one rotor.
        photodiode: which one was hit, (N,).
        uncertain: distance of a share from one half within which only a pair of hits tells the plane [turns].
    """
    share = located.share
    plane = np.where(np.isfinite(share), (share > 0.5).astype(np.int64), -1)
    unsure = np.abs(share - 0.5) < uncertain
    if np.any(unsure):
        first, last = _of_two(located, photodiode)
        plane[unsure] = np.where(first[unsure], 0, np.where(last[unsure], 1, -1))
    return Planes(plane, np.where(plane < 0, np.nan, angle_of(share, plane)))


def angle_of(share: Floats, plane: Ints) -> Floats:
    """Return the angles [rad] from boresight at which planes (N,) are at shares of a turn (N,) (2)."""
    out: Floats = 2 * np.pi * share - np.pi + np.where(plane == 0, 1, -1) * np.pi / 3
    return out


def share_of(angle: Floats, plane: Ints) -> Floats:
    """Return the share of a turn at which planes (N,) meet angles (N,) [rad]: the inverse of (2)."""
    out: Floats = (angle + np.pi - np.where(plane == 0, 1, -1) * np.pi / 3) / (2 * np.pi)
    return out


def _passages(observed: Floats, nominal: float) -> tuple[list[float], list[int]]:
    """Return the median of the observations of each passage, and their number."""
    if not len(observed):
        return [], []
    groups = np.split(observed, np.flatnonzero(np.diff(observed) > _SAME * nominal) + 1)
    return [float(np.median(group)) for group in groups], [len(group) for group in groups]


def _as_arrays(zero: list[float], turn: list[int], stretch: list[int]) -> tuple[Floats, Ints, Ints]:
    return np.array(zero, dtype=np.float64), np.array(turn, dtype=np.int64), np.array(stretch, dtype=np.int64)


def _period(zero: list[float], turn: list[int], stretch: list[int], nominal: float) -> float:
    """Return the mean duration of a turn within the stretches."""
    ticks = turns = 0.0
    for i in range(1, len(zero)):
        if stretch[i] == stretch[i - 1]:
            ticks += zero[i] - zero[i - 1]
            turns += turn[i] - turn[i - 1]
    return ticks / turns if turns else nominal


def _of_two(located: Located, photodiode: Ints) -> tuple[Bools, Bools]:
    """Return which hits are the first, and which the second, of the two of their photodiode in their turn, (N,) each.

    Two hits are one of each plane only if they lie apart: a third of a turn, less what the tilt takes.
    """
    order = np.lexsort((located.share, photodiode, located.turn))
    key = np.stack([located.turn, photodiode])[:, order]
    share = located.share[order]
    same = np.all(key[:, 1:] == key[:, :-1], axis=0)
    alone_before = np.concatenate([[True], ~same[:-1]]) if len(same) else same
    alone_after = np.concatenate([~same[1:], [True]]) if len(same) else same
    pair = same & alone_before & alone_after & (share[1:] - share[:-1] > UNCERTAIN)
    first, last = np.zeros(len(share), dtype=np.bool_), np.zeros(len(share), dtype=np.bool_)
    first[order[:-1][pair]] = True
    last[order[1:][pair]] = True
    return first, last
