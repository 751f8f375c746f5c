"""Where photodiodes, cameras, lights, thrusters and wheels sit on a craft: what physics and on-board computer share."""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats


class Photodiodes(NamedTuple):
    """Photodiodes of C craft, padded to the largest number K.

    point_m: (C, K, 3) [m] and normal: (C, K, 3), unit, in the craft's body frame. present: (C, K), False where padded.
    """

    point_m: Floats
    normal: Floats
    present: Bools

    @property
    def craft_count(self) -> int:
        """The number of craft C."""
        return len(self.present)

    def of(self, craft: int) -> "Photodiodes":
        """The layout of one craft, as a batch of one without padding."""
        real = self.present[craft]
        return Photodiodes(self.point_m[craft][real][None], self.normal[craft][real][None], real[real][None])


def pad(points: list[Floats], normals: list[Floats]) -> Photodiodes:
    """One layout from a list of (k, 3) [m] points and (k, 3) normals per craft."""
    most = max((len(p) for p in points), default=0)
    craft = len(points)
    layout = Photodiodes(
        np.zeros((craft, most, 3)), np.zeros((craft, most, 3)), np.zeros((craft, most), dtype=np.bool_)
    )
    for i, (point, normal) in enumerate(zip(points, normals, strict=True)):
        layout.point_m[i, : len(point)] = point
        layout.normal[i, : len(normal)] = normal
        layout.present[i, : len(point)] = True
    return layout


class Cameras(NamedTuple):
    """A craft's cameras, main camera first.

    rotation: (N, 3, 3) R_b_c of the camera's frame, x right, y down in the image, z along the optical axis. position_m:
    (N, 3) [m], the pinholes in the body frame. N is 2, or 0 for a craft without a pair.
    """

    rotation: Floats
    position_m: Floats


class Lights(NamedTuple):
    """The lights that a craft shows to others' cameras: point_m (L, 3) [m], normal (L, 3), unit, in its body frame."""

    point_m: Floats
    normal: Floats


class Thrusters(NamedTuple):
    """A craft's on-off thrusters: point_m (N, 3) [m] and exhaust (N, 3), unit, in its body frame; the force on the
    craft is against the exhaust. force_n: (N,) [N] while open. minimum_impulse_ns: (N,) [N s] of the shortest pulse.
    """

    point_m: Floats
    exhaust: Floats
    force_n: Floats
    minimum_impulse_ns: Floats

    def none(self) -> "Thrusters":
        """The same craft without any."""
        return Thrusters(*(part[:0] for part in self))


class Wheels(NamedTuple):
    """A craft's reaction wheels: axis (W, 3), unit, in its body frame; torque_nm (W,) [N m] and momentum_nms (W,)
    [N m s], the most of each in either direction.
    """

    axis: Floats
    torque_nm: Floats
    momentum_nms: Floats

    def none(self) -> "Wheels":
        """The same craft without any."""
        return Wheels(*(part[:0] for part in self))
