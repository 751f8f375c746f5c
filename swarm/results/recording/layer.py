"""A layer draws one kind of thing: at the beginning its static part, then every batch of periods."""

from typing import NamedTuple, Protocol

import numpy as np

from estimators.arrays import Floats, Ints
from swarm.results.recording.batch import Batch
from swarm.results.recording.canvas import Canvas, Send
from swarm.results.recording.drawing import Colours
from swarm.results.scene import Scene


class Stage(NamedTuple):
    """The scene as all layers draw it.

    near: craft, by index, that are drawn singly. crowd: there are others, drawn as a crowd, and the plots show spreads.
    detail: craft with plots of their own. colour: (C, 4), the craft's. reach_m: how far the scene reaches. begin_s:
    time of the first period that is drawn.
    """

    scene: Scene
    near: Ints
    crowd: bool
    detail: list[int]
    colour: Colours
    reach_m: float
    begin_s: float

    @property
    def navigating(self) -> list[int]:
        """The near craft that have sensors."""
        still = set(self.scene.without_sensors)
        return [i for i in self.near.tolist() if self.scene.craft[i] not in still]

    @property
    def upwards(self) -> Floats:
        """Unit vector that points up in the world, (3,)."""
        return np.array([0.0, 0.0, 1.0]) if self.scene.up == "z" else np.array([0.0, -1.0, 0.0])

    def body(self, i: int) -> str:
        """Entity of a craft's body: at the truth, in a replay at the estimate."""
        return f"world/{'estimate' if self.scene.replay else 'craft'}/{self.scene.craft[i]}"


class Layer(Protocol):
    """One kind of thing."""

    def begin(self, canvas: Canvas) -> None:
        """Draw the static part."""

    def send(self, send: Send, batch: Batch) -> None:
        """Draw a batch."""
