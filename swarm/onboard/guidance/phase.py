"""The phases of a guided craft; the names are `swarm.results.columns.guidance.PHASES`."""

from enum import IntEnum


class Phase(IntEnum):
    """The phases of every guided motion, docking's first."""

    WAIT = 0
    """Stays where it is until its navigation is good enough to leave."""
    TRANSFER = 1
    """Flies to its first hold point, or to its place in another formation."""
    HOLD = 2
    """Waits at a hold point."""
    APPROACH = 3
    """Flies inwards along the docking axis to the next hold point."""
    FINAL = 4
    """Flies the last leg, to contact."""
    DOCKED = 5
    """Captured: it flies no longer."""
    RETREAT = 6
    """Flies outwards to the hold point that it came from."""
    LOST = 7
    """Its navigation is lost: it brakes and stays."""
    ABORTED = 8
    """Has given up, and stays at its first hold point."""
    KEEP = 9
    """Stays in its place."""
    NONE = 10
    """Not guided: it follows the scenario's motion."""
