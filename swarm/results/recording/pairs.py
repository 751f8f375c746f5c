"""Craft that navigate relative to others: a line between both of every pair, with the protection level as its label."""

import numpy as np
import rerun as rr

from swarm.results.recording.batch import Batch
from swarm.results.recording.canvas import Canvas, Send
from swarm.results.recording.layer import Stage
from swarm.results.recording.plots import BLUE, RED

UNKNOWN = 0x90A4AEC0
"""Colour of a line without a level: one of both has no estimate."""


class Pairs:
    """world/pairs/CRAFT/TO, in the world's coordinates."""

    def __init__(self, stage: Stage) -> None:
        self._pairs = list(stage.scene.pairs)
        part = [rr.escape_entity_path_part(name) for name in stage.scene.craft]
        self._entities = [f"world/pairs/{part[craft]}/{to}" for craft, to in ((a, part[b]) for a, b in self._pairs)]

    def begin(self, canvas: Canvas) -> None:
        """Set the lines' width."""
        for entity in self._entities:
            canvas.static(entity, rr.LineStrips3D.from_fields(radii=[-1.0], show_labels=True))

    def send(self, send: Send, batch: Batch) -> None:
        """Draw every pair's line: red while there is an alert."""
        for number, ((craft, to), entity) in enumerate(zip(self._pairs, self._entities, strict=True)):
            strips = batch.body_position[:, (craft, to)].astype(np.float32)
            level, alert = batch.pair_levels[:, number].T
            known = np.isfinite(level)
            columns = rr.LineStrips3D.columns(
                strips=strips,
                labels=[label(value) for value in level.tolist()],
                colors=np.where(alert > 0, RED, np.where(known, BLUE, UNKNOWN)).astype(np.uint32),
            )
            send(entity, columns)


def label(level_m: float) -> str:
    """Return the label of a protection level [m], which may be unknown."""
    return f"level {1e3 * level_m:.3g} mm" if np.isfinite(level_m) else "no level"
