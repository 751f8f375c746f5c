"""What a photodiode sees of the lighthouse."""

from enum import IntEnum


class Sight(IntEnum):
    """What a photodiode sees of the lighthouse."""

    OUTSIDE = 0
    """Out of field or range, turned away, or not there at all (padding)."""
    BLOCKED = 1
    """Within reach of the light, but something stands in between."""
    LIT = 2
