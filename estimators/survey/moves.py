"""A station that was moved while a survey was recorded: the instant at which two places of it explain more than one.

With the objects' poses eliminated window by window, window w says of the stations' poses x (all but the frame's)

    N_w x = g_w,        N_w = B^T B - B^T A (A^T A + P)^-1 A^T B,      g_w likewise

from whitened rows A (pose) and B (stations) and the prior P of rates. A station s that stands e beside its place from
window k on lowers the sum of squares of all by

    drop = h^T M^-1 h,   h = (sum_w g_w, sum_w>=k g_w,s),   M = [sum N_w, sum_w>=k N_w,s ; . , sum_w>=k N_w,ss]

for every k and s at once, by sums from the end. The largest drop is a move where it is far more than noise or slow
systematic errors give (`RATIO`), and e more than `LEAST_M` or `LEAST_RAD`.

Of two stations and an object that may move itself, light alone tells only that they moved against each other. Where an
object rested meanwhile, the station whose angles of it jumped is the one.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.survey.problem import Problem, Room

RATIO = 60.0
"""Drop per unknown over the mean square of what remains: chance gives 1, a wrong calibration up to some 20."""
LEAST_M, LEAST_RAD = 2e-3, 1e-3
CUT = 100.0
"""Whitened residuals beyond this are mistaken hits, not a station's move."""
FEWEST = 2
"""Windows on either side of a move."""


class Step(NamedTuple):
    """A move. station: index. window: the first one after it, in order of time. ratio: as `RATIO`. shift: its turn and
    way, (6,) [rad, m], to first order.
    """

    station: int
    window: int
    ratio: float
    shift: Floats


def find_step(problem: Problem, room: Room, time_s: Floats) -> Step | None:
    """Return the most likely move of a station, None if there is none.

    Args:
        problem: the survey's, with free windows and stations.
        room: its solution without a move.
        time_s: of the windows (W,).
    """
    at = problem.station_at
    stations: Ints = np.flatnonzero(at >= 0).astype(np.int64)
    order: Ints = np.argsort(time_s, kind="stable").astype(np.int64)
    order = order[np.isin(order, np.unique(problem.rows.window))]
    if not len(stations) or len(order) < 2 * FEWEST:
        return None
    normal, slope, square, count = _eliminated(problem, room, stations, order)
    total, sum_slope = normal.sum(axis=0), slope.sum(axis=0)
    # From the end: what the windows from k on say.
    after_n, after_g = np.cumsum(normal[::-1], axis=0)[::-1], np.cumsum(slope[::-1], axis=0)[::-1]
    unknowns = 6 * len(stations)
    freedom = count - 6 * len(order) - unknowns - 6
    best: Step | None = None
    for i, s in enumerate(stations):
        own = slice(6 * i, 6 * i + 6)
        for k in range(FEWEST, len(order) - FEWEST + 1):
            matrix = np.block([[total, after_n[k][:, own]], [after_n[k][own], after_n[k][own, own]]])
            h = np.concatenate([sum_slope, after_g[k][own]])
            scale = np.sqrt(np.maximum(np.diag(matrix), 1e-30))
            try:
                step = np.linalg.solve(matrix / np.outer(scale, scale) + 1e-9 * np.eye(len(h)), h / scale) / scale
            except np.linalg.LinAlgError:
                continue
            drop = float(h @ step)
            ratio = (drop / 6) / max((square - drop) / max(freedom, 1.0), 0.1)
            if best is None or ratio > best.ratio:
                best = Step(int(s), int(order[k]), ratio, step[-6:])
    if best is None or best.ratio < RATIO:
        return None
    turned, way = float(np.linalg.norm(best.shift[:3])), float(np.linalg.norm(best.shift[3:]))
    return best if turned > LEAST_RAD or way > LEAST_M else None


def _eliminated(problem: Problem, room: Room, stations: Ints, order: Ints) -> tuple[Floats, Floats, float, int]:
    """Return N_w (n, 6 S, 6 S) and g_w (n, 6 S) of the windows in order, the sum of squares with the poses and stations
    at their best, and the number of rows.
    """
    raw, matrix = problem.linearise(room)
    residual, white = problem.whitening @ raw, (problem.whitening @ matrix).tocsr()
    known, prior = problem.priors(room)
    good = np.abs(residual) < CUT
    columns = np.concatenate([problem.station_at[s] + np.arange(6) for s in stations])
    normal = np.zeros((len(order), len(columns), len(columns)))
    slope = np.zeros((len(order), len(columns)))
    square = 0.0
    rows_of = [np.flatnonzero((problem.rows.window == w) & good) for w in order]
    for n, (w, mine) in enumerate(zip(order, rows_of, strict=True)):
        own = problem.window_columns(int(w))
        block = white[mine]
        a, b, r = block[:, own].toarray(), block[:, columns].toarray(), residual[mine]
        p = prior[:, own].tocsr()
        weak = np.unique(p.nonzero()[0])
        inner = a.T @ a + (p[weak].T @ p[weak]).toarray() + 1e-9 * np.eye(len(own))
        left = np.concatenate([b.T @ a, (a.T @ r + p[weak].T @ known[weak])[None]]) @ np.linalg.inv(inner)
        normal[n] = b.T @ b - left[:-1] @ (a.T @ b)
        slope[n] = b.T @ r - left[:-1] @ (a.T @ r + p[weak].T @ known[weak])
        square += float(r @ r) - float(left[-1] @ (a.T @ r))
    total = normal.sum(axis=0) + 1e-9 * np.eye(len(columns))
    summed = slope.sum(axis=0)
    return normal, slope, square - float(summed @ np.linalg.solve(total, summed)), int(good.sum())
