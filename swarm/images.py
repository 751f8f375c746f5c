"""What the cameras deliver: plain arrays, the only thing that passes from the CCD sensor to the on-board computer.

One entry per pair of cameras, in the order of the scenario's `[craft.ccd]` tables; main camera first, then backup.
"""

from typing import NamedTuple

from estimators.arrays import Bools, Floats


class LightImages(NamedTuple):
    """The lights that P pairs of cameras saw at one epoch.

    image_m: (P, 2, L, 2) [m], x right and y down on the detector, from the optical axis, as measured; NaN where not
    seen. seen: (P, 2, L), whether the camera gave an image of the light; L lights, padded to the target that has most.
    """

    image_m: Floats
    seen: Bools
