"""Error terms of a fan in a form that is linear where it can be: seven numbers for either generation.

    (phase, tilt, curve, G cos gamma, G sin gamma, O cos omega, O sin omega)

with gibbous magnitude G and phase gamma, ogee magnitude O and phase omega: a pair has no phase to lose where its
magnitude is zero. Lighthouse 1.0 has no ogee.
"""

import math
from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.lighthouse.sweep import FanErrors
from estimators.lighthouse.tilted import TiltedErrors

TERMS = 7
PARTS = {"phase": (0,), "tilt": (1,), "curve": (2,), "gibbous": (3, 4), "ogee": (5, 6)}
"""Numbers of each part."""
TYPICAL = {
    "1.0": np.array([1e-3, 1e-3, 2e-3, 2e-3, 2e-3, 0.0, 0.0]),
    "2.0": np.array([1e-3, 1e-3, 0.1, 1e-3, 1e-3, 0.1, 0.1]),
}
"""By how much a factory's terms are off, by generation: the prior of an adjustment, one standard deviation."""

Errors = FanErrors | TiltedErrors


def numbers(errors: Errors) -> Floats:
    """Return the seven numbers of a fan's errors."""
    ogee_phase, ogee = (
        (errors.ogee_phase_rad, errors.ogee_magnitude) if isinstance(errors, TiltedErrors) else (0.0, 0.0)
    )
    gamma, gibbous = errors.gibbous_phase_rad, errors.gibbous_magnitude
    return np.array(
        [
            *(errors.phase_rad, errors.tilt_rad, errors.curve),
            *(gibbous * math.cos(gamma), gibbous * math.sin(gamma)),
            *(ogee * math.cos(ogee_phase), ogee * math.sin(ogee_phase)),
        ]
    )


def errors_of(values: Floats, like: Errors) -> Errors:
    """Return a fan's errors of seven numbers (7,), of the generation of `like`; magnitudes keep the sign of its."""
    gibbous, gamma = _polar(values[3], values[4], like.gibbous_magnitude)
    first = (float(values[0]), float(values[1]), float(values[2]), gamma, gibbous)
    if isinstance(like, FanErrors):
        return FanErrors(*first)
    ogee, omega = _polar(values[5], values[6], like.ogee_magnitude)
    return TiltedErrors(*first, omega, ogee)


def _polar(cosine: float, sine: float, like: float) -> tuple[float, float]:
    """Return magnitude and phase, the magnitude negative where `like` is."""
    sign = -1.0 if like < 0 else 1.0
    return sign * math.hypot(cosine, sine), math.atan2(sign * sine, sign * cosine)


def columns(parts: Sequence[str], generation: str) -> Ints:
    """Return the places of the numbers of some parts, of those that a generation has."""
    last = 5 if generation == "1.0" else TERMS
    return np.array(sorted(i for part in parts for i in PARTS[part] if i < last), dtype=np.int64)
