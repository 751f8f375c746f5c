"""Choice among several rows of one photodiode in one sweep, as `swarm.onboard.rivals` chooses among pulses."""

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.innovation import RowBatch, StationArrays
from estimators.lighthouse.rows import row_into
from estimators.state import STATES, State
from swarm.onboard.rivals import CHOICE_RAD, CHOICE_RATIO


def chosen(rows: RowBatch, light: StationArrays, point_m: Floats, active: Bools, state: State) -> tuple[RowBatch, Ints]:
    """Return the rows without those that share photodiode and sweep, and the number of rows left out, (C,).

    Of several, the one that the craft expects is kept, if it stands out as in `swarm.onboard.rivals`.

    Args:
        rows: of C craft.
        light: the stations.
        point_m: (C, K, 3) [m], photodiodes in the body frames.
        active: (C,), whether the craft have an estimate.
        state: their estimates.
    """
    out, kept = np.zeros(len(point_m), dtype=np.int64), np.ones(len(rows.angle), dtype=np.bool_)
    _choose(rows, light, point_m, active, state, kept, out)
    return (rows.where(kept) if out.any() else rows), out


@kernel
def _choose(
    rows: RowBatch, light: StationArrays, point: Floats, active: Bools, state: State, kept: Bools, out: Ints
) -> None:
    """Take the rows that share photodiode and sweep off `kept` (N,), but for the one expected; write their numbers.

    out: (C,), number of rows left out. The rows of one sweep stand together.
    """
    unused = np.empty(STATES)
    for c in range(len(out)):
        begin = rows.first[c]
        while begin < rows.first[c + 1]:
            end = begin + 1
            while end < rows.first[c + 1] and (
                rows.station[end] == rows.station[begin]
                and rows.fan[end] == rows.fan[begin]
                and rows.sweep[end] == rows.sweep[begin]
            ):
                end += 1
            for r in range(begin, end):
                k, rivals, best, nearest, second = rows.photodiode[r], 0, -1, np.inf, np.inf
                for other in range(begin, end):
                    if rows.photodiode[other] != k:
                        continue
                    if other < r:
                        rivals = 0
                        break
                    rivals += 1
                if rivals < 2:
                    continue
                for other in range(r, end):
                    if rows.photodiode[other] != k:
                        continue
                    kept[other] = False
                    if not active[c]:
                        continue
                    s = rows.station[other]
                    away = abs(
                        row_into(
                            rows.offset_s[other],
                            rows.angle[other],
                            light.rotation[s],
                            light.position[s],
                            light.fans[light.first[s] + rows.fan[other]],
                            point[c, k],
                            state.rotation[c],
                            state.position[c],
                            state.velocity[c],
                            state.angular_rate[c],
                            unused,
                        )
                    )
                    if away < nearest:
                        best, nearest, second = other, away, nearest
                    elif away < second:
                        second = away
                out[c] += rivals
                if nearest <= CHOICE_RAD and nearest < CHOICE_RATIO * second:
                    kept[best] = True
                    out[c] -= 1
            begin = end
