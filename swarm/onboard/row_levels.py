"""Protection levels of craft that navigate by rows of several stations (docs/integrity.md).

K sqrt(tr P)                     of the noise
o sqrt(lambda) slope             of a false photodiode that the gate would have missed, held until the next light
|x - x_S| + K sqrt(tr P_S)       of the sets of rows that may be false all the time, where asked for
"""

from functools import cache

import numpy as np
from scipy.special import ndtri

from estimators.arrays import Bools, Floats
from estimators.filter.bank import gates
from estimators.lighthouse.innovation import RowBatch, StationArrays
from estimators.lighthouse.integrity import shown_to_gate
from estimators.lighthouse.row_faults import row_faults
from estimators.lighthouse.row_pose import RowPose
from swarm.onboard.integrity import Integrity, Separated
from swarm.onboard.row_update import RowFate
from swarm.onboard.settings import NavigationSettings
from swarm.onboard.tracks import Filtered

_TABLE = 32


class RowLevels:
    """The levels of C craft: `step` in every period."""

    def __init__(self, settings: NavigationSettings, craft: int) -> None:
        """Begin without any light.

        Args:
            settings: of every craft's navigation.
            craft: C.
        """
        self._settings = settings
        self._quantile = -float(ndtri(settings.integrity.risk / 2))
        self._held = np.zeros((2, craft))

    def forget(self, mask: Bools) -> None:
        """Forget the levels of the craft of the mask (C,)."""
        self._held[:, mask] = 0.0

    def step(
        self,
        rows: RowBatch,
        light: StationArrays,
        pose: RowPose,
        fate: RowFate,
        after: Filtered,
        separated: Separated | None,
    ) -> Integrity:
        """Return protection levels and alerts of a period.

        Args:
            rows: as used.
            light: the stations.
            pose: of the rows alone.
            fate: of the rows.
            after: the filters.
            separated: levels by separation of solutions, where asked for.
        """
        s, craft = self._settings.integrity, len(pose.solved)
        active, _, covariance = after
        self._held[:, ~active] = 0.0
        fresh = fate.fresh & active
        if s.residual_test and fate.found is not None and fresh.any():
            slopes = row_faults(rows, fate.kept, fresh, fate.found, light, covariance, np.zeros(craft))
            table = _shown(self._settings.gate_probability, s.missed_detection, int(fate.rows.max()))
            missed = table[fate.rows[fresh]]
            self._held[:, fresh] = missed * slopes[0, fresh], missed * np.degrees(slopes[1, fresh])
        with np.errstate(invalid="ignore"):
            spread = [np.sqrt(np.trace(covariance[:, i : i + 3, i : i + 3], axis1=1, axis2=2)) for i in (6, 0)]
            alone = [np.sqrt(np.trace(pose.covariance[:, i : i + 3, i : i + 3], axis1=1, axis2=2)) for i in (3, 0)]
        levels = np.empty((4, craft))
        for i, unit in enumerate((1.0, 180 / np.pi)):
            levels[i] = np.where(pose.solved, self._quantile * unit * alone[i] + self._held[i], np.nan)
            levels[2 + i] = self._quantile * unit * spread[i] + self._held[i]
        if separated is not None:
            # Sets of photodiodes take the place of the fault that the gate would have missed; a station does not.
            own = separated.levels if s.false_photodiodes else np.fmax(levels[2:], separated.levels)
            levels[2:] = np.where(active, own, np.nan)
        limits = s.alert_position_m, float(np.rad2deg(s.alert_attitude_rad))
        watched = [i for i, limit in enumerate(limits) if np.isfinite(limit)]
        alert = np.zeros(craft, dtype=np.bool_)
        for i in watched:
            alert |= ~(levels[2 + i] <= limits[i])
        return Integrity(fate.dropped, levels[0], levels[1], levels[2], levels[3], alert, bool(watched))


def _shown(gate_probability: float, missed_detection: float, most: int) -> Floats:
    """Return the roots of the least noncentralities that the gate on 0, 1, ... rows does not miss, `most` or more."""
    return _shown_table(gate_probability, missed_detection, -(-most // _TABLE) * _TABLE)


@cache
def _shown_table(gate_probability: float, missed_detection: float, most: int) -> Floats:
    return np.sqrt(shown_to_gate(gates(gate_probability, most), missed_detection))
