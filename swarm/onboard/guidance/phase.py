"""The phases of a guided craft; their names are `swarm.results.columns.guidance.PHASES`."""

from enum import IntEnum


class Phase(IntEnum):
    """The phases of every guided motion, docking's first."""

    WAIT = 0
    """The craft stays where it is until its navigation is good enough to leave."""
    TRANSFER = 1
    """The craft flies to its first hold point, or to its place in another formation."""
    HOLD = 2
    """The craft waits at a hold point."""
    APPROACH = 3
    """The craft flies inwards along the docking axis to the next hold point."""
    FINAL = 4
    """The craft flies the last leg, to contact."""
    DOCKED = 5
    """The craft is captured and flies no longer."""
    RETREAT = 6
    """The craft flies outwards to the hold point that it came from."""
    LOST = 7
    """The craft's navigation is lost: it brakes and stays."""
    ABORTED = 8
    """The craft has given up, and stays at its first hold point."""
    KEEP = 9
    """The craft stays in its place."""
    NONE = 10
    """The craft is not guided: it follows the scenario's motion."""
