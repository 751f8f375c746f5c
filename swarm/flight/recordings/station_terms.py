"""A station's factory calibration as it sends it, of either generation: terms per sweep, in one form for all files."""

from typing import NamedTuple


class SweepTerms(NamedTuple):
    """Terms of one sweep, as the station sends them; what they mean, with their signs, differs by generation.

    tilt: of Lighthouse 1.0 its tangent in libsurvive's files, of 2.0 an angle [rad] off the nominal tilt.
    """

    phase_rad: float = 0.0
    tilt: float = 0.0
    curve: float = 0.0
    gibbous_phase_rad: float = 0.0
    gibbous_magnitude: float = 0.0
    ogee_phase_rad: float = 0.0
    ogee_magnitude: float = 0.0
