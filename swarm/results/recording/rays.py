"""The photodiodes by what they see, and rays from the lighthouse to those in reach: lit or blocked."""

import numpy as np
import rerun as rr

from estimators.rotation import matrix_from_quaternion
from swarm.results.recording.batch import Batch
from swarm.results.recording.canvas import Canvas, Send, ink, send_segments
from swarm.results.recording.layer import Stage
from swarm.sensors.sight import Sight

SIGHT_COLOURS = ink(0x78909CFF, 0xFF5252FF, 0x69F0AEFF, 0x212121FF)
"""Colours of the photodiodes, by `Sight`."""
RAY_COLOURS = {"lit": (Sight.LIT, 0x69F0AE38), "blocked": (Sight.BLOCKED, 0xFF525290)}


class Rays:
    """world/craft/NAME/photodiodes; world/rays."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._point_m = stage.scene.photodiodes.point_m[stage.near]
        self._present = stage.scene.photodiodes.present[stage.near]

    def begin(self, canvas: Canvas) -> None:
        """Draw the photodiodes and set the rays' colours."""
        for k, i in enumerate(self._stage.near):
            points = rr.Points3D(self._point_m[k][self._present[k]], radii=-2.0)
            canvas.static(f"{self._stage.body(i)}/photodiodes", points)
        for name, (_, colour) in RAY_COLOURS.items():
            canvas.static(f"world/rays/{name}", rr.LineStrips3D.from_fields(colors=ink(colour), radii=[-0.4]))

    def send(self, send: Send, batch: Batch) -> None:
        """Colour the photodiodes and draw the rays."""
        near = self._stage.near
        sight = batch.sight[:, near]
        for k, i in enumerate(near):
            colours = SIGHT_COLOURS[sight[:, k][:, self._present[k]]]
            columns = rr.Points3D.columns(colors=colours.reshape(-1))
            send(f"{self._stage.body(i)}/photodiodes", columns.partition([colours.shape[1]] * len(colours)))
        rotation = matrix_from_quaternion(batch.body_quaternion[:, near])
        point = np.einsum("ncij,ckj->ncki", rotation, self._point_m)
        point += batch.body_position[:, near, None]
        drawable = self._present & np.isfinite(point).all(axis=-1)
        if self._stage.scene.stations:
            # What a photodiode saw does not say of which station.
            drawable = np.zeros_like(drawable)
        for name, (state, _) in RAY_COLOURS.items():
            send_segments(send, f"world/rays/{name}", point, drawable & (sight == state))
