"""The filters' estimates: an outline at each, and 3 sigma ellipsoids of the position, enlarged."""

import numpy as np
import rerun as rr

from estimators.rotation import quaternion_from_matrix, xyzw_from_wxyz
from swarm.results.recording import drawing
from swarm.results.recording.batch import Batch
from swarm.results.recording.canvas import Canvas, Send, turn
from swarm.results.recording.layer import Stage

ENLARGED = 50
"""Factor of the ellipsoids: millimetres would not be seen beside metres."""
LARGEST_ELLIPSOID_M = 0.5
"""Half the longest axis of an ellipsoid as drawn, at most: that of a craft long in the dark would hide the scene."""


class Estimates:
    """world/estimate/NAME; world/covariance."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage

    def begin(self, canvas: Canvas) -> None:
        """Draw the outlines; in a replay the craft itself stands at its estimate."""
        scene = self._stage.scene
        for i in self._stage.near if not scene.replay else ():
            edges = drawing.outline(scene.visuals[i]).astype(np.float32)
            lines = rr.LineStrips3D(edges, colors=[self._stage.colour[i]], radii=-0.6)
            canvas.static(f"world/estimate/{scene.craft[i]}/outline", lines)

    def send(self, send: Send, batch: Batch) -> None:
        """Move the outlines and draw the ellipsoids."""
        near = self._stage.near
        turns = turn(quaternion_from_matrix(batch.rotation[:, near]))
        for k, i in enumerate(near):
            at = rr.Transform3D.columns(translation=batch.position[:, i], quaternion=turns[:, k])
            send(f"world/estimate/{self._stage.scene.craft[i]}", at)
        covariance, position = batch.covariance[:, near], batch.position[:, near]
        known = np.isfinite(covariance).all(axis=(-1, -2)) & np.isfinite(position).all(axis=-1)
        half, quaternion = drawing.ellipsoids(covariance[known], 3.0)
        columns = rr.Ellipsoids3D.columns(
            half_sizes=half * np.minimum(ENLARGED, LARGEST_ELLIPSOID_M / half.max(axis=1, keepdims=True)),
            centers=position[known],
            quaternions=xyzw_from_wxyz(quaternion),
            colors=np.broadcast_to(self._stage.colour[near], (*known.shape, 4))[known],
        )
        send("world/covariance", columns.partition(np.count_nonzero(known, axis=1)))
