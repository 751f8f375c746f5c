"""Visibility of the lighthouse from a photodiode."""

from enum import IntEnum


class Sight(IntEnum):
    """Visibility of the lighthouse from a photodiode."""

    OUTSIDE = 0
    """Out of field or range, turned away, or absent (padding)."""
    BLOCKED = 1
    """Within field, range and incidence, but something stands in between."""
    LIT = 2
    DEAD = 3
    """In whatever light there is, it does not answer."""
