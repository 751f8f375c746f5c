"""Innovations of few photodiodes to second order, for a filter whose attitude is coarse.

To first order y = H x + noise about the prediction. Three photodiodes fit two poses, which meet where the craft turns
through a critical attitude, as the mirror images of a plane that is face-on: there y is a parabola along the direction
that is known worst. A filter to first order takes the slope at its own, wrong, place for information, and follows
the wrong branch out of it. With the prediction's error x ~ N(0, P) about the axes of the attitude's uncertainty,

    x = sum_k t_k x_k + rest,   t_k ~ N(0, 1),   x_k = P_d v_k / sqrt(l_k),   P_dd v_k = l_k v_k
    y = H x - sum_kl b_kl t_k t_l / 2 + noise,   b_kl second differences of y over one sigma

the filter gets y + sum_k b_kk / 2, of the noise covariance R + sum_kl b_kl b_kl^T / 2: the second-order filter of
Athans, Wishner and Bertolini (1968), in the coordinates of `estimators.pivot`, in which the turns that one or two
photodiodes leave open are straight. The two coarsest axes count. `estimators.lighthouse.planar` is the same for poses
of a plane.
"""

from collections.abc import Callable

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.lighthouse.innovation import Innovations
from estimators.pivot import ARMS, turn_about
from estimators.state import State

SIGNS = np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1]])
"""Places, in sigmas along the two coarsest axes of the attitude, at which y is asked."""


def to_second_order(
    found: Innovations, mask: Bools, state: State, covariance: Floats, asked: Callable[[State, Bools], Innovations]
) -> None:
    """Put the second-order terms of the predictions' errors into innovations, in place.

    Args:
        found: innovations at the predictions, with noise of variance one.
        mask: (C,), the craft concerned.
        state: predicted, of C craft.
        covariance: (C, 12, 12), of the predictions.
        asked: returns the innovations of the craft of a mask at other states.
    """
    who = np.flatnonzero(mask)
    variance, axes = np.linalg.eigh(covariance[who, :3, :3])
    sides = covariance[who][:, :, :3] @ axes[:, :, :0:-1] / np.sqrt(variance[:, None, :0:-1])
    values = []
    for signs in SIGNS:
        moved = state.copied(mask)
        arms = np.empty(ARMS)
        for c, x in zip(who.tolist(), sides @ signs, strict=True):
            place = moved.rotation[c], moved.angular_rate[c], moved.position[c], moved.velocity[c]
            turn_about(*place, x, found.pivot[c], arms)
        there = asked(moved, mask)
        full = there.number == found.number
        values.append(np.where(full[who, None], there.y[who], np.nan))
    y = found.y[who]
    first, second, both = (values[i] + values[i + 1] - 2 * y for i in (0, 2, 4))
    for i, c in enumerate(who.tolist()):
        n = found.number[c]
        mixed = (both[i, :n] - first[i, :n] - second[i, :n]) / 2
        bends = np.array([first[i, :n], second[i, :n], np.sqrt(2) * mixed])
        if not np.isfinite(bends).all():
            continue
        root = np.linalg.cholesky(np.eye(n) + bends.T @ bends / 2)
        found.y[c, :n] = np.linalg.solve(root, y[i, :n] + (bends[0] + bends[1]) / 2)
        found.h[c, :n] = np.linalg.solve(root, found.h[c, :n])
