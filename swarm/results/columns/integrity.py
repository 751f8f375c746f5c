"""The telemetry columns of integrity: what a craft makes of its own pose, and what is wrong with it in truth."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from swarm.results.columns.extra import Extra

COLUMNS = (
    Extra(
        "dropped_photodiodes",
        "1",
        "photodiodes left out as false by the residual test; -1: the pose failed it and was not used",
        "count",
    ),
    Extra("pnp_position_protection_m", "m", "protection level of this period's pose: position"),
    Extra("pnp_attitude_protection_deg", "deg", "protection level of this period's pose: attitude"),
    Extra("position_protection_m", "m", "protection level of the filter's estimate: position"),
    Extra("attitude_protection_deg", "deg", "protection level of the filter's estimate: attitude"),
    Extra("alert", "", "a protection level is above its limit, or there is no estimate; null without limits", "yes"),
)


class Integrity(Protocol):
    """What is read of `swarm.onboard.integrity.Integrity`."""

    @property
    def dropped(self) -> Ints: ...  # noqa: D102
    @property
    def pnp_position_m(self) -> Floats: ...  # noqa: D102
    @property
    def pnp_attitude_deg(self) -> Floats: ...  # noqa: D102
    @property
    def position_m(self) -> Floats: ...  # noqa: D102
    @property
    def attitude_deg(self) -> Floats: ...  # noqa: D102
    @property
    def alert(self) -> Bools: ...  # noqa: D102
    @property
    def watched(self) -> bool: ...  # noqa: D102


def values(integrity: Integrity) -> Floats:
    """The columns' values, (C, len(COLUMNS)); an infinite level is none at all."""
    i = integrity
    alert = i.alert if i.watched else np.full(len(i.alert), np.nan)
    parts = (i.dropped, i.pnp_position_m, i.pnp_attitude_deg, i.position_m, i.attitude_deg, alert)
    out = np.stack([np.asarray(part, dtype=np.float64) for part in parts], axis=1)
    out[np.isinf(out)] = np.nan
    return out


def columns(watched: bool) -> list[Extra]:
    """`COLUMNS`; of a run in which something goes wrong, or may raise an alert, the recording plots the levels too."""
    titles = {"position_protection_m": "protection level", "attitude_protection_deg": "protection level"}
    return [column._replace(plot=titles.get(column.name, "") if watched else "") for column in COLUMNS]


def fault_column(names: Sequence[str]) -> Extra:
    """The column of a run with faults; names: what may be wrong, the codes' meanings."""
    return Extra(
        "fault", "", "what is wrong with the craft, or the lighthouse; the craft is not told", names=tuple(names)
    )
