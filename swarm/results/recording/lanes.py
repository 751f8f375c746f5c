"""The lanes of states below the scene: status, sensor, phase, fault."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from estimators.arrays import Floats
from swarm.results.columns.column import Column
from swarm.results.columns.core import SENSORS, STATUS_TEXT
from swarm.results.recording.batch import Batch
from swarm.results.recording.canvas import Canvas, Send, ink
from swarm.results.recording.layer import Stage
from swarm.results.recording.plots import STATUS_COLOURS

SENSOR_COLOURS = (0x616161FF, 0xFF8A65FF, 0x43A047FF, 0x26A69AFF, 0xFBC02DFF, 0xFB8C00FF, 0x7E57C2FF)
"""Colours of the names in `SENSORS`."""
STATE_COLOURS = (
    0x616161FF, 0x1E88E5FF, 0x43A047FF, 0x26A69AFF, 0xFBC02DFF, 0x7CB342FF,
    0xEF6C00FF, 0xE53935FF, 0x8E24AAFF, 0x5C6BC0FF, 0x455A64FF, 0xD81B60FF,
)  # fmt: skip
"""Colours of the names of any other column, in turn."""


class Lanes:
    """status/NAME; status/NAME/sensor of craft with cameras; status/NAME/COLUMN of the shown columns of states."""

    def __init__(self, stage: Stage, shown: Sequence[Column], values: Floats) -> None:
        """Choose the lanes.

        Args:
            stage: The scene.
            shown: The shown columns.
            values: Their values in the first period that is drawn, (C, columns): what means nothing to a craft, is not
                known then.
        """
        self._stage = stage
        self._states = [
            (row, column, [i for i in stage.near.tolist() if np.isfinite(values[i, row])])
            for row, column in enumerate(shown)
            if column.names
        ]
        self._watching = [pair.craft for pair in stage.scene.ccd if pair.craft in stage.near]

    @property
    def count(self) -> int:
        """Number of lanes."""
        states = sum(len(having) for _, _, having in self._states)
        return len(self._stage.navigating) + len(self._watching) + states

    def begin(self, canvas: Canvas) -> None:
        """Name and colour the states."""
        names = self._stage.scene.craft
        for i in self._stage.navigating:
            self._configure(canvas, f"status/{names[i]}", STATUS_TEXT, STATUS_COLOURS)
        for i in self._watching:
            self._configure(canvas, f"status/{names[i]}/sensor", SENSORS, SENSOR_COLOURS)
        for _, column, having in self._states:
            colours = [STATE_COLOURS[k % len(STATE_COLOURS)] for k in range(len(column.names))]
            for i in having:
                self._configure(canvas, f"status/{names[i]}/{column.name}", column.names, colours)

    def _configure(self, canvas: Canvas, entity: str, names: Sequence[str], colours: Sequence[int]) -> None:
        canvas.static(entity, rr.StateConfiguration(values=list(names), colors=ink(*colours)))

    def send(self, send: Send, batch: Batch) -> None:
        """Send the states; a column that is unknown in a part of the batch is left out."""
        names = self._stage.scene.craft
        for i in self._stage.navigating:
            send(f"status/{names[i]}", rr.StateChange.columns(state=[STATUS_TEXT[code] for code in batch.status[:, i]]))
        for i in self._watching:
            states = [SENSORS[code] for code in batch.sensor[:, i]]
            send(f"status/{names[i]}/sensor", rr.StateChange.columns(state=states))
        for row, column, having in self._states:
            for i in having:
                codes = batch.shown[:, i, row]
                if np.isfinite(codes).all():
                    states = [column.names[int(code)] for code in codes]
                    send(f"status/{names[i]}/{column.name}", rr.StateChange.columns(state=states))
