"""Reception of the light of Lighthouse 2.0 by a craft's circuits: overlaps, and hits whose station they know.

A photodiode hears one beam at a time. Where two are on it at once, neither can be read: both hits are lost, by time and
not by chance. With two stations whose turns last T, a photodiode that is lit for w by each loses the share

    2 (w_1 + w_2) / T                                                                                           (1)

of its hits: the other station sweeps over it twice a turn, and an overlap begins within w_1 + w_2.

The light carries one bit per 1/6 us. A hit that catches 17 bits, a *word*, knows the state of the station's shift
register, but every state belongs to all 32 sequences: which one it is, and so the channel and the offset from the
rotor's zero, is known from two words of one sweep, a known time apart. So the hits of a sweep that have a word know
channel and offset if at least two have one, within PAIR_S of each other; the others are instants only. A word that is
alone, or shorter than 17 bits, is one of these.
"""

import numpy as np

from estimators.arrays import Bools, Ints
from estimators.kernel import kernel
from swarm.sensors.passage import Passages

BIT_S = 1 / 6e6
"""Duration of a bit [s]."""
WORD_BITS = 17
"""Length of the shift register."""
PAIR_S = 0.4e-3
"""Largest time between two words that are compared [s]: a sweep over a craft of 40 cm, 3 m away, takes as long."""


@kernel
def in_order(passages: Passages, count: int, craft: int) -> tuple[Ints, Ints]:
    """Return the order of the passages by craft and time, and where each craft's begin in it, (C + 1,).

    Args:
        passages: passages of one period, in any order.
        count: number of them.
        craft: number of craft.
    """
    first = np.zeros(craft + 1, np.int64)
    for i in range(count):
        first[passages.craft[i] + 1] += 1
    for c in range(craft):
        first[c + 1] += first[c]
    order, filled = np.empty(count, np.int64), first[:-1].copy()
    for i in range(count):
        c, time = passages.craft[i], passages.instant_s[i]
        n = filled[c]
        while n > first[c] and passages.instant_s[order[n - 1]] > time:
            order[n] = order[n - 1]
            n -= 1
        order[n] = i
        filled[c] += 1
    return order, first


@kernel
def overlapped(passages: Passages, order: Ints, first: Ints) -> Bools:
    """Return which passages, by their index, are lost because another beam is on the photodiode at once.

    Args:
        passages: passages of one period.
        order: their order by craft and time.
        first: where each craft's begin in `order`, (C + 1,).
    """
    lost = np.zeros(len(order), np.bool_)
    for c in range(len(first) - 1):
        widest = 0.0
        for n in range(first[c], first[c + 1]):
            widest = max(widest, passages.width_s[order[n]])
        for n in range(first[c], first[c + 1]):
            i = order[n]
            for m in range(n + 1, first[c + 1]):
                j = order[m]
                apart = passages.instant_s[j] - passages.instant_s[i]
                if apart > widest:
                    break
                together = 2 * apart < passages.width_s[i] + passages.width_s[j]
                if together and passages.photodiode[i] == passages.photodiode[j]:
                    lost[i] = lost[j] = True
    return lost


@kernel
def identified(passages: Passages, lost: Bools, order: Ints, first: Ints) -> Bools:
    """Return which passages, by their index, know their channel and offset.

    Args:
        passages: passages of one period.
        lost: passages that no circuit logs.
        order: their order by craft and time.
        first: where each craft's begin in `order`, (C + 1,).
    """
    known = np.zeros(len(order), np.bool_)
    for c in range(len(first) - 1):
        for n in range(first[c], first[c + 1]):
            i = order[n]
            if lost[i] or passages.width_s[i] < WORD_BITS * BIT_S:
                continue
            for m in range(n + 1, first[c + 1]):
                j = order[m]
                if passages.instant_s[j] - passages.instant_s[i] > PAIR_S:
                    break
                if lost[j] or passages.width_s[j] < WORD_BITS * BIT_S:
                    continue
                same = passages.station[i] == passages.station[j] and passages.plane[i] == passages.plane[j]
                if same and passages.sweep[i] == passages.sweep[j] and passages.photodiode[i] != passages.photodiode[j]:
                    known[i] = known[j] = True
    return known
