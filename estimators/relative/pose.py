"""The state of one craft in the axes of another, and its covariance.

Craft a and b with rotation R, position p, velocity v and angular rate w in the world. In a's own axes, which turn with
it, and with r = p_b - p_a

    R_ab = R_a^T R_b,   p_ab = R_a^T r,   w_ab = R_a^T (w_b - w_a),   v_ab = d p_ab / dt = R_a^T (v_b - v_a - w_a x r)

With the errors (d, dw, dp, dv) of both, R_true = Exp([d]x) R and truth minus estimate for the rest, to first order

    d_ab = R_a^T (d_b - d_a)                    dp_ab = R_a^T (dp_b - dp_a + r x d_a)
    dw_ab = R_a^T (dw_b - dw_a + w x d_a)       dv_ab = R_a^T (dv_b - dv_a - w_a x (dp_b - dp_a) + r x dw_a + u x d_a)

with w = w_b - w_a and u = v_b - v_a - w_a x r. What both estimates have in common, such as a shift of the station,
cancels but for the turn of r.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.rotation import skew
from estimators.state import STATES, State


class Relative(NamedTuple):
    """State of craft b in the axes of craft a: rotation (3, 3) R_a_b, position (3,) [m], velocity (3,) [m/s] and
    angular_rate (3,) [rad/s] as seen from a; by_a, by_b: (12, 12), derivatives of its error (attitude, angular rate,
    position, velocity) by those of both, the attitude's in a's axes from the left.
    """

    rotation: Floats
    position: Floats
    velocity: Floats
    angular_rate: Floats
    by_a: Floats
    by_b: Floats


def relative(a: State, b: State) -> Relative:
    """Return the state of a craft b in the axes of a craft a, both without the craft axis."""
    turn = a.rotation.T
    apart, faster = b.position - a.position, b.velocity - a.velocity
    seen = faster - skew(a.angular_rate) @ apart
    spin = b.angular_rate - a.angular_rate
    by_a, by_b = np.zeros((2, STATES, STATES))
    for i in range(4):
        block = slice(3 * i, 3 * i + 3)
        by_b[block, block], by_a[block, block] = turn, -turn
    by_a[3:6, :3], by_a[6:9, :3], by_a[9:, :3] = (turn @ skew(vector) for vector in (spin, apart, seen))
    by_a[9:, 3:6] = turn @ skew(apart)
    by_a[9:, 6:9], by_b[9:, 6:9] = turn @ skew(a.angular_rate), -turn @ skew(a.angular_rate)
    return Relative(turn @ b.rotation, turn @ apart, turn @ seen, turn @ spin, by_a, by_b)


def seen_from(a: State, there: State) -> State:
    """Return the state of craft b in the world, from that of a and b's in a's axes: `relative` the other way round."""
    apart = a.rotation @ there.position
    return State(
        rotation=a.rotation @ there.rotation,
        position=a.position + apart,
        velocity=a.velocity + a.rotation @ there.velocity + skew(a.angular_rate) @ apart,
        angular_rate=a.angular_rate + a.rotation @ there.angular_rate,
    )


def covariance_between(between: Relative, of_a: Floats, of_b: Floats, cross: Floats) -> Floats:
    """Return the covariance (12, 12) of a relative state.

    Args:
        between: the state.
        of_a: (12, 12), covariance of a's error.
        of_b: (12, 12), that of b's.
        cross: (12, 12), E[e_a e_b^T]; zero as if both were independent.
    """
    mixed = between.by_a @ cross @ between.by_b.T
    out: Floats = between.by_a @ of_a @ between.by_a.T + between.by_b @ of_b @ between.by_b.T + mixed + mixed.T
    return out


def covariance_bound(between: Relative, of_a: Floats, of_b: Floats) -> Floats:
    """Return a covariance (12, 12) that holds whatever the errors of both share: A / s + B / (1 - s).

    A and B are the parts of both craft, s the share that makes the trace of the position least: the bound of covariance
    intersection, applied to a difference.

    Args:
        between: the relative state.
        of_a: (12, 12), covariance of a's error.
        of_b: (12, 12), that of b's.
    """
    parts = [by @ of @ by.T for by, of in ((between.by_a, of_a), (between.by_b, of_b))]
    sizes = [np.sqrt(np.trace(part[6:9, 6:9])) for part in parts]
    share = sizes[0] / (sizes[0] + sizes[1])
    out: Floats = parts[0] / share + parts[1] / (1 - share)
    return out
