"""Numbers of photodiodes and stations that rows come from, and whether these decide a pose."""

import numpy as np

from estimators.arrays import Bools, Ints
from estimators.kernel import kernel
from estimators.lighthouse.innovation import RowBatch
from swarm.onboard.settings import MIN_LIT

FEWEST_CROSSED = 3
"""Photodiodes whose rows decide a pose where several stations see them."""


def decides(photodiodes: Ints, stations: Ints) -> Bools:
    """Return whether rows of so many photodiodes and stations decide a pose, (C,)."""
    out: Bools = photodiodes >= np.where(stations > 1, FEWEST_CROSSED, MIN_LIT)
    return out


def numbers(rows: RowBatch, kept: Bools, photodiodes: int) -> tuple[Ints, Ints]:
    """Return the numbers of photodiodes and of stations that the kept rows of each craft come from, (C,) each.

    Args:
        rows: the rows, (N,).
        kept: which of them count, (N,).
        photodiodes: largest number of photodiodes of a craft.
    """
    out = np.zeros((2, len(rows.first) - 1), dtype=np.int64)
    most = int(rows.station.max(initial=0)) + 1
    _count(rows, kept, np.empty(photodiodes, np.int64), np.empty(most, np.int64), out)
    return out[0], out[1]


@kernel
def _count(rows: RowBatch, kept: Bools, photodiode: Ints, station: Ints, out: Ints) -> None:
    """Write the numbers of photodiodes and stations of each craft, (2, C); the others are workspace."""
    photodiode[:], station[:] = -1, -1
    for c in range(out.shape[1]):
        for r in range(rows.first[c], rows.first[c + 1]):
            if kept[r]:
                k, s = rows.photodiode[r], rows.station[r]
                out[0, c] += photodiode[k] != c
                out[1, c] += station[s] != c
                photodiode[k], station[s] = c, c
