"""The craft that are drawn singly: bodies and names at the truth, in a replay at the estimate, with their trails.

A transform to a place that is not a number hides what it carries: a craft that knows nothing is not drawn.
"""

from collections import deque

import numpy as np
import rerun as rr

from estimators.arrays import Floats
from swarm.results.recording import drawing
from swarm.results.recording.batch import Batch
from swarm.results.recording.canvas import Canvas, Send, mesh, turn
from swarm.results.recording.layer import Stage

TRAIL_POINTS, TRAIL_STEP_S = 20, 0.2


class Bodies:
    """world/craft/NAME and its mesh; world/names.

    The viewer has no text in space: names are the labels of points without size, above the craft.
    """

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._above_m = (self._size() + 0.02 * stage.reach_m) * stage.upwards

    def _size(self) -> float:
        """Radius [m] about the body's origin of the largest craft."""
        scene, near = self._stage.scene, self._stage.near
        points = [mesh.vertex for i in near for mesh, _ in scene.visuals[i]]
        points += [scene.photodiodes.point_m[i] for i in near]
        return max((float(np.linalg.norm(p, axis=1).max()) for p in points if len(p)), default=0.0)

    def begin(self, canvas: Canvas) -> None:
        """Draw meshes and names."""
        scene, near = self._stage.scene, self._stage.near
        for i in near:
            if (body := drawing.solid(scene.visuals[i])) is not None:
                canvas.static(f"{self._stage.body(i)}/mesh", mesh(body))
        names, inks = [scene.craft[i] for i in near], self._stage.colour[near]
        labels = rr.Points3D.from_fields(labels=names, colors=inks, radii=[0.0], show_labels=True)
        canvas.static("world/names", labels)

    def send(self, send: Send, batch: Batch) -> None:
        """Move bodies and names."""
        near, periods = self._stage.near, len(batch.time_s)
        if not self._stage.scene.replay:
            turns = turn(batch.body_quaternion[:, near])
            for k, i in enumerate(near):
                at = rr.Transform3D.columns(translation=batch.body_position[:, i], quaternion=turns[:, k])
                send(self._stage.body(i), at)
        above = (batch.body_position[:, near] + self._above_m).reshape(-1, 3)
        send("world/names", rr.Points3D.columns(positions=above).partition([len(near)] * periods))


class Trails:
    """world/trails: where the craft have been in the last seconds."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._trail: deque[Floats] = deque(maxlen=TRAIL_POINTS)
        self._due_s = -np.inf

    def begin(self, canvas: Canvas) -> None:
        """Set the colours."""
        inks = self._stage.colour[self._stage.near]
        canvas.static("world/trails", rr.LineStrips3D.from_fields(colors=inks, radii=[-0.8]))

    def send(self, send: Send, batch: Batch) -> None:
        """Draw the trails, padded with the oldest point, so that every strip has the same length."""
        strips: list[Floats] = []
        for time_s, position in zip(batch.time_s, batch.body_position[:, self._stage.near], strict=True):
            if time_s >= self._due_s:
                self._trail.append(position)
                self._due_s = time_s + TRAIL_STEP_S
            missing = TRAIL_POINTS - len(self._trail)
            strips.append(np.stack([*[self._trail[0]] * missing, *self._trail, position], axis=1))
        columns = rr.LineStrips3D.columns(strips=np.concatenate(strips).astype(np.float32))
        send("world/trails", columns.partition([len(self._stage.near)] * len(strips)))
