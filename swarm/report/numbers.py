"""Figures as text, with few digits and no exponent within reason."""

import math
from typing import Any

import numpy as np

NOTHING = "–"


def number(value: float | np.floating[Any] | None, digits: int = 3, scale: float = 1.0) -> str:
    """Return the text of a figure, without an exponent within reason; a dash where there is none.

    Args:
        value: The figure.
        digits: Number of significant digits.
        scale: Factor that is applied first.
    """
    if value is None or not math.isfinite(value):
        return NOTHING
    value = float(value) * scale
    if value == 0:
        return "0"
    magnitude = math.floor(math.log10(abs(value)))
    if not -5 <= magnitude < 9:
        return f"{value:.{digits - 1}e}"
    value = round(value, digits - 1 - magnitude)
    magnitude = math.floor(math.log10(abs(value)))  # 99.96 has become 100
    text = f"{value:.{max(digits - 1 - magnitude, 0)}f}"
    return f"{float(text):,.0f}".replace(",", "\u202f") if magnitude >= 4 else text
