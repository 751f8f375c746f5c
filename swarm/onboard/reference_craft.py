"""A reference craft: it stands still at a known place, and tells the others by how much each sweep is off there.

As a reference receiver of satellite navigation does, it measures what the angle of each of its photodiodes should not
be: y_k = measured - h(known place) = u + own noise, with u the error of the rotor in the sweep and of the flash, and
that of the fans as far as it is the same everywhere. Its mean over the n photodiodes of a sweep is broadcast, and the
others take it off their angles of the same sweep. With the noise a of an angle, a craft's photodiodes then share

    b'^2 = 2 f^2 + a^2 / n      f^2: rounding of the flash to a tick, of the craft's clock and of the reference's

of which f^2 + a^2 / n is the same for all craft. A sweep that the reference does not see is not corrected, nor is then
the other fan's: noise is that of before.

Broadcast once per period: u16 craft, u32 period, and of each fan f32 mean and u8 n: 16 bytes.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.sweep import HALF_PI, FanPair, lighthouse_1, measured_angles
from swarm.onboard.decoder import SweepAngles

BYTES = 16
"""Size of the broadcast of one period."""
OUTLIER = 6.0
"""Distance from the median of a sweep, in standard deviations, beyond which an angle is left out as false."""


class ReferencePlace(NamedTuple):
    """A craft whose pose in the lighthouse frame is known: its index, rotation (3, 3) and position (3,) [m]."""

    craft: int
    rotation: Floats
    position: Floats


class SweepErrors(NamedTuple):
    """Errors of both fans' sweeps as a reference craft finds them.

    error: (2,) [rad]. used: (2, K), photodiodes that they are means of. noise: of an angle from which they are taken
    off. common_rad: the part of its shared noise that is the same for all craft.
    """

    error: Floats
    used: Bools
    noise: AngleNoise
    common_rad: float

    def taken_off(self, angles: SweepAngles) -> SweepAngles:
        """Return angles of all craft without these errors."""
        return angles._replace(theta=angles.theta - self.error)


class ReferenceCraft:
    """One craft at a known place."""

    def __init__(
        self, place: ReferencePlace, point_m: Floats, fans: FanPair, noise: AngleNoise, common_rad: float
    ) -> None:
        """Take where it is.

        Args:
            place: of the craft.
            point_m: (K, 3) [m], its photodiodes in its body frame.
            fans: errors of the fans as craft know them.
            noise: of an angle.
            common_rad: the part of the shared noise that is the same for all craft.
        """
        self.point_m: Floats = point_m @ place.rotation.T + place.position
        self._craft, self._noise, self._common = place.craft, noise, common_rad
        self._theta = HALF_PI + measured_angles(self.point_m, lighthouse_1(*fans))

    def observe(self, angles: SweepAngles) -> SweepErrors | None:
        """Return the errors of a period's sweeps; None where a fan was not seen."""
        off = angles.theta[self._craft] - self._theta
        seen = np.isfinite(off)
        if not seen.any(axis=0).all():
            return None
        middle = np.array([np.median(off[seen[:, fan], fan]) for fan in (0, 1)])
        with np.errstate(invalid="ignore"):
            used = np.abs(off - middle) <= OUTLIER * self._noise.own_rad
        number = used.sum(axis=0)
        if not number.all():
            return None
        error = np.where(used, off, 0.0).sum(axis=0) / number
        own, rounding = self._noise.own_rad**2, max(self._noise.shared_rad**2 - self._common**2, 0.0)
        common = rounding + own / float(number.min())
        noise = AngleNoise(self._noise.own_rad, sqrt(common + rounding))
        return SweepErrors(error, used.T, noise, sqrt(common))
