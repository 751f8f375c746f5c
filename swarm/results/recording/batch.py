"""The data that a recording draws: copies of what it needs of each period, gathered for some time of flight."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.rotation import quaternion_from_matrix
from swarm.results.columns import ccd as ccd_columns
from swarm.results.columns.column import Column, Group
from swarm.results.period import Period
from swarm.results.records import Errors
from swarm.results.rows import referred_nis


class Cloud(NamedTuple):
    """A scan that became complete. craft: index of the observer. points: (n, 3) [m], where it believes them to be."""

    time_s: float
    frame: int
    craft: int
    points: Floats


class Batch(NamedTuple):
    """Data of one period, (C, ...), or stacked of n periods, (n, C, ...).

    body: the truth, or the estimate. ccd_seen: (P, 2, L), lights seen by the P pairs of cameras. ccd_error: (C, 2),
    distance [m] and angle [deg]. station_rows: (C, number of stations). shown: (C, S), the columns of `Shown`.
    pair_levels: (number of pairs, 2), protection level of the relative position [m] and whether there is an alert.
    dark: a fault takes the lighthouse's light.
    """

    time_s: Floats
    frame: Ints
    body_position: Floats
    body_quaternion: Floats
    position: Floats
    rotation: Floats
    covariance: Floats
    sight: NDArray[np.integer]
    status: Ints
    visible: Ints
    adop: Floats
    pdop: Floats
    pnp_position: Floats
    residual_rad: Floats
    nis: Floats
    errors: Errors
    peer_position: Floats
    sensor: Ints
    station_rows: Ints
    ccd_seen: Bools
    ccd_error: Floats
    ccd_nis: Floats
    shown: Floats
    pair_levels: Floats
    dark: Bools
    clouds: tuple[Cloud, ...] = ()


def kept(period: Period, errors: Errors, shown: Floats, dark: Bools) -> Batch:
    """Return copies of what is drawn of a period: its arrays may be the next period's workspace.

    Args:
        period: The period.
        errors: As telemetry computed them.
        shown: Values of the shown columns, (C, S).
        dark: The codes of `Period.fault` with which the lighthouse gives no light.
    """
    truth, estimate, peer, copy = period.truth, period.estimate, period.peer, np.array
    ccd_seen, ccd_error, ccd_nis = _cameras(period)
    return Batch(
        time_s=copy(period.time_s),
        frame=copy(period.frame),
        body_position=copy(estimate.position if truth is None else truth.position),
        body_quaternion=copy(quaternion_from_matrix(estimate.rotation) if truth is None else truth.quaternion),
        position=copy(estimate.position),
        rotation=copy(estimate.rotation),
        covariance=copy(estimate.covariance[:, 6:9, 6:9]),
        sight=copy(period.sight),
        status=copy(estimate.status),
        visible=copy(estimate.visible),
        adop=copy(estimate.dilution.adop_deg_per_rad),
        pdop=copy(estimate.dilution.pdop_m_per_rad),
        pnp_position=copy(estimate.pnp.position),
        residual_rad=copy(estimate.pnp.residual_rad),
        nis=referred_nis(estimate.nis, estimate.rows),
        errors=Errors(*(copy(error) for error in errors)),
        peer_position=np.full_like(estimate.position, np.nan) if peer is None else copy(peer.position),
        sensor=copy(estimate.sensor),
        station_rows=_station_rows(period),
        ccd_seen=ccd_seen,
        ccd_error=ccd_error,
        ccd_nis=ccd_nis,
        shown=copy(shown),
        pair_levels=_pair_levels(period),
        dark=np.array(period.fault is not None and bool(dark[period.fault].any())),
        clouds=tuple(Cloud(period.time_s, period.frame, scan.craft, scan.cloud) for scan in period.scans),
    )


def _cameras(period: Period) -> tuple[Bools, Floats, Floats]:
    """Return the lights that the cameras saw, and the errors and NIS of their poses."""
    ccd, truth, craft = period.estimate.ccd, period.truth, len(period.estimate.status)
    if ccd is None or truth is None:
        return np.zeros((0, 2, 0), dtype=np.bool_), np.full((craft, 2), np.nan), np.full(craft, np.nan)
    return np.array(ccd.seen), ccd_columns.errors(ccd, truth), np.array(ccd.nis)


def _station_rows(period: Period) -> Ints:
    """Return the rows of each of several stations in the filters, (C, S); of the one lighthouse, (C, 0)."""
    used = period.estimate.station_rows
    return np.zeros((len(period.estimate.status), 0), dtype=np.int64) if used is None else np.array(used)


def _pair_levels(period: Period) -> Floats:
    """Return level and alert of every pair, (P, 2)."""
    found = period.estimate.relative
    return np.zeros((0, 2)) if found is None else np.stack([found.position_level_m, found.alert], axis=1)


def stacked(rows: Sequence[Batch]) -> Batch:
    """Return one batch of all rows."""
    arrays = {
        name: np.stack([getattr(row, name) for row in rows])
        for name in Batch._fields
        if name not in ("errors", "clouds")
    }
    errors = Errors(*(np.stack(error) for error in zip(*(row.errors for row in rows), strict=True)))
    return Batch(**arrays, errors=errors, clouds=tuple(cloud for row in rows for cloud in row.clouds))


class Shown:
    """The columns of a run's groups that are shown for single craft: numbers as plots, states as lanes."""

    def __init__(self, groups: Sequence[Group]) -> None:
        self._groups = [group for group in groups if any(column.plot for column in group.columns)]
        columns = [column for group in self._groups for column in group.columns]
        self._rows = [row for row, column in enumerate(columns) if column.plot]
        self._count = len(columns)
        self.columns: list[Column] = [columns[row] for row in self._rows]

    def values(self, period: Period) -> Floats:
        """Return the columns' values, (C, len(columns))."""
        block, row = np.empty((self._count, len(period.estimate.status))), 0
        for group in self._groups:
            group.fill(period, block[row : row + len(group.columns)])
            row += len(group.columns)
        return block[self._rows].T
