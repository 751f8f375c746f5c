"""The telemetry columns of a run with guided craft: what each is doing, where it should be, how it stands to its port.

All of the truth, at the epoch; rows of craft that are not guided, or do not dock, are null.
"""

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from swarm.hardware import Closing
from swarm.results.columns.extra import Extra

PHASES = (
    "wait",
    "transfer",
    "hold",
    "approach",
    "final",
    "docked",
    "retreat",
    "lost",
    "aborted",
    "keep",
)
"""Names of the phases 0 to 9; beyond, not guided, is null."""

COLUMNS = (
    Extra("phase", "", f"what its guidance does: {', '.join(PHASES)}", names=PHASES),
    *(Extra(f"reference_p{a}_m", "m", f"where its guidance wants it: position, {a}") for a in "xyz"),
    Extra("reference_error_m", "m", "distance of the truth from where its guidance wants it", plot="off its reference"),
    Extra("gave_way", "", "flew otherwise than it wanted, to keep clear of another craft", "yes"),
)
DOCKING_COLUMNS = (
    Extra("docking_range_m", "m", "its port before the target's, along the target's axis", plot="range of the ports"),
    Extra("docking_lateral_m", "m", "its port beside the target's axis", plot="lateral offset of the ports"),
    Extra("docking_angle_deg", "deg", "angle between the axes of the two ports"),
    Extra("docking_speed_m_s", "m/s", "closing speed of the two ports, along the target's axis", plot="closing speed"),
)


def values(phase: Ints, gave_way: Bools, reference: Floats, position: Floats) -> Floats:
    """The values of COLUMNS, (C, 6); reference: (C, 3) [m] at the epoch, position: (C, 3) [m] the truth."""
    guided = phase < len(PHASES)
    error = np.linalg.norm(position - reference, axis=1)
    block = np.column_stack([phase, reference, error, gave_way]).astype(np.float64)
    block[~guided] = np.nan
    return block


def docking_values(craft: int, pairs: Sequence[tuple[int, Closing]]) -> Floats:
    """The values of DOCKING_COLUMNS, (craft, 4); pairs: who docks, and how it stands."""
    block = np.full((craft, len(DOCKING_COLUMNS)), np.nan)
    for i, at in pairs:
        block[i] = at.range_m, at.lateral_m, np.degrees(at.angle_rad), at.speed_m_s
    return block
