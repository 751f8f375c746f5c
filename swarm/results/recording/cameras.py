"""The cameras: their fields, and lines of sight to the lights that they see."""

import numpy as np
import rerun as rr

from estimators.arrays import Floats
from estimators.rotation import matrix_from_quaternion
from swarm.results.recording import drawing
from swarm.results.recording.batch import Batch
from swarm.results.recording.canvas import Canvas, Send, ink
from swarm.results.recording.layer import Stage

SIGHT_LINES = {"main": 0x40C4FF90, "backup": 0xFFD54F90}
"""Colours of the lines of sight."""


class Cameras:
    """world/craft/NAME/ccd; world/cameras."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage

    def begin(self, canvas: Canvas) -> None:
        """Draw the fields and set the lines' colours."""
        for pair in self._stage.scene.ccd:
            if pair.craft not in self._stage.near:
                continue
            strips = drawing.field(pair.field_rad, 0.6)
            for camera, colour in enumerate(SIGHT_LINES.values()):
                turned = [strip @ pair.rotation[camera].T + pair.pinhole_m[camera] for strip in strips]
                lines = rr.LineStrips3D([line.astype(np.float32) for line in turned], colors=[colour], radii=-0.6)
                canvas.static(f"{self._stage.body(pair.craft)}/ccd/{camera}", lines)
        for which, colour in SIGHT_LINES.items():
            canvas.static(f"world/cameras/{which}", rr.LineStrips3D.from_fields(colors=ink(colour), radii=[-0.5]))

    def send(self, send: Send, batch: Batch) -> None:
        """Draw the lines of sight, period by period those of all pairs."""
        pairs = self._stage.scene.ccd
        rotation = matrix_from_quaternion(batch.body_quaternion)
        for camera, name in enumerate(SIGHT_LINES):
            strips: list[Floats] = []
            for pair in pairs:
                eye = rotation[:, pair.craft] @ pair.pinhole_m[camera] + batch.body_position[:, pair.craft]
                light = np.einsum("nij,kj->nki", rotation[:, pair.target], pair.light_m)
                light += batch.body_position[:, None, pair.target]
                strips.append(np.stack([np.broadcast_to(eye[:, None], light.shape), light], axis=2))
            seen = np.concatenate([batch.ccd_seen[:, p, camera, : len(q.light_m)] for p, q in enumerate(pairs)], axis=1)
            lines = np.concatenate(strips, axis=1)[seen].astype(np.float32)
            columns = rr.LineStrips3D.columns(strips=lines).partition(np.count_nonzero(seen, axis=1))
            send(f"world/cameras/{name}", columns)
