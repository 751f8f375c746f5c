"""The last scan of every LiDAR, where its craft believes the returns to be."""

import numpy as np
import rerun as rr

from swarm.results.recording.batch import Batch
from swarm.results.recording.canvas import Canvas, Send, ink
from swarm.results.recording.layer import Stage

RETURNS = 0xFFFF00FF
"""Colour of the returns: that of no craft and of no photodiode."""


class Lidars:
    """world/lidar/NAME. A scan is sent at the time at which it became complete."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage

    def begin(self, canvas: Canvas) -> None:
        """Set the colours."""
        self._canvas = canvas
        for i, _ in self._stage.scene.lidar:
            points = rr.Points3D.from_fields(colors=ink(RETURNS), radii=[-2.4])
            canvas.static(f"world/lidar/{self._stage.scene.craft[i]}", points)

    def send(self, send: Send, batch: Batch) -> None:
        """Draw the scans."""
        for i in sorted({cloud.craft for cloud in batch.clouds}):
            mine = [cloud for cloud in batch.clouds if cloud.craft == i]
            points = np.concatenate([cloud.points for cloud in mine]).astype(np.float32)
            columns = rr.Points3D.columns(positions=points).partition([len(cloud.points) for cloud in mine])
            at = self._canvas.at(np.array([cloud.time_s for cloud in mine]), np.array([cloud.frame for cloud in mine]))
            at(f"world/lidar/{self._stage.scene.craft[i]}", columns)
