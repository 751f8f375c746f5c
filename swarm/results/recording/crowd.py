"""The craft of a large swarm that are not drawn singly: instances of one entity per model."""

import numpy as np
import rerun as rr

from estimators.arrays import Ints
from swarm.results.recording import drawing
from swarm.results.recording.batch import Batch
from swarm.results.recording.canvas import Canvas, Send, mesh, turn
from swarm.results.recording.layer import Stage


class Crowd:
    """world/crowd."""

    def __init__(self, stage: Stage) -> None:
        self._scene = stage.scene
        members: dict[tuple[bytes, ...], list[int]] = {}
        for i in np.setdiff1d(np.arange(len(stage.scene.craft)), stage.near):
            key = tuple(part.tobytes() for mesh, rgba in stage.scene.visuals[i] for part in (*mesh, rgba))
            members.setdefault(key, []).append(int(i))
        self._groups: dict[str, Ints] = {
            f"world/crowd/model-{number}": np.array(who) for number, who in enumerate(members.values())
        }

    def begin(self, canvas: Canvas) -> None:
        """Draw the models; a model without visible parts is left out."""
        for entity, who in list(self._groups.items()):
            if (body := drawing.solid(self._scene.visuals[who[0]])) is not None:
                canvas.static(entity, mesh(body))
            else:
                del self._groups[entity]

    def send(self, send: Send, batch: Batch) -> None:
        """Move the instances."""
        for entity, who in self._groups.items():
            at = batch.body_position[:, who].reshape(-1, 3)
            turns = turn(batch.body_quaternion[:, who]).reshape(-1, 4)
            poses = rr.InstancePoses3D.columns(translations=at, quaternions=turns)
            send(entity, poses.partition([len(who)] * len(batch.time_s)))
