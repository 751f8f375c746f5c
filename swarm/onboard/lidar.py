"""Motion compensation of one craft's LiDAR scan on board: all rays moved to one instant.

Craft and target move while the scanner turns. A ray measured at the time tau relative to the epoch is moved with the
target, by the estimated motion of both: with the scanner at (S(tau), s(tau)) in the lighthouse frame and the target at
(c(tau), rate w)

    x = S(tau) r d + s(tau),   x_epoch = Exp(-[w]x tau) (x - c(tau)) + c(0),   in s:  S(0)^T (x_epoch - s(0))

so that the scan shows the target as if measured at once at the epoch. A ray that did not return is moved as if it had
passed at the target's distance.
"""

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lidar.scan import Scan
from estimators.state import State
from swarm.messages import LidarPattern, LidarScan

TYPICAL_M = 10.0
"""Distance at which a ray is assumed to pass while the target's pose is unknown [m]."""


def rays(scan: LidarScan, pattern: LidarPattern) -> Scan:
    """Return the scan unchanged, in the scanner's frame: correct if nothing moves."""
    return Scan(
        scan.direction,
        scan.range_m,
        pattern.spacing_rad,
        pattern.noise_m,
        scan.line,
        scan.step,
        pattern.jitter_rad,
    )


def scanner(own: State, pattern: LidarPattern) -> tuple[Floats, Floats]:
    """Return the scanner's pose in the lighthouse frame at the epoch: R_l_s (3, 3) and position (3,) [m]."""
    return own.rotation @ pattern.rotation, own.position + own.rotation @ pattern.position


def at_epoch(scan: LidarScan, pattern: LidarPattern, own: State, target: State | None, epoch_s: float) -> Scan:
    """Return the scan in the scanner's frame at the epoch.

    Args:
        scan: scan of one craft.
        pattern: the LiDAR's pattern, noise and mount.
        own: estimated state of the craft at the epoch.
        target: estimated state of the target at the epoch; None while it is unknown.
        epoch_s: epoch on the LiDAR's clock [s].
    """
    instant, which = np.unique(scan.time_s, return_inverse=True)
    tau = (instant - epoch_s)[:, None]
    body = rot.exp(own.angular_rate * tau) @ own.rotation
    turn, place = body @ pattern.rotation, own.position + own.velocity * tau + body @ pattern.position
    now_turn, now_place = scanner(own, pattern)
    typical = TYPICAL_M if target is None else float(np.linalg.norm(target.position - now_place))
    depth = np.where(np.isfinite(scan.range_m), scan.range_m, typical)
    x = np.einsum("nij,nj->ni", turn[which], scan.direction * depth[:, None]) + place[which]
    if target is not None:
        moved = target.position + target.velocity * tau
        back = rot.exp(-target.angular_rate * tau)
        x = np.einsum("nij,nj->ni", back[which], x - moved[which]) + target.position
    seen = (x - now_place) @ now_turn
    distance = np.linalg.norm(seen, axis=1)
    return Scan(
        seen / distance[:, None],
        np.where(np.isfinite(scan.range_m), distance, np.nan),
        pattern.spacing_rad,
        pattern.noise_m,
        scan.line,
        scan.step,
        pattern.jitter_rad,
    )
