"""The craft of a large swarm that are not drawn singly: instances of one entity per model and state, in its colour.

A craft that tracks has the colour of its position error, any other that of its status, so that craft change from one
entity to another while they fly. A label names the worst of them.
"""

from typing import Any

import numpy as np
import rerun as rr

from estimators.arrays import Bools, Floats, Ints
from swarm.onboard.settings import by_light
from swarm.results.columns.core import STATUS
from swarm.results.recording import drawing
from swarm.results.recording.batch import Batch
from swarm.results.recording.canvas import Canvas, Send, ink, mesh, turn
from swarm.results.recording.layer import Stage

ERRORS_MM = (1.0, 3.0, 10.0, 30.0)
"""Steps of the position error at which the colour changes [mm]."""
STATES = {
    "within-1mm": 0x4FC3F7,
    "within-3mm": 0x4DB6AC,
    "within-10mm": 0x9CCC65,
    "within-30mm": 0xFFEE58,
    "beyond-30mm": 0xFFA726,
    "searching": 0xFF1744,
    "coasting": 0xF4511E,
    "ambiguous": 0xBA68C8,
    "without-sensors": 0x90A4AE,
}
"""States and their colours: by light, by the error; without, by the status; nothing to know."""
TINT = 0.75
"""Share of a state's colour in that of a craft; the rest is its own."""
WORST = "world/crowd/worst"
ABOVE = 0.06
"""Height of the label above the craft, as a share of the scene: above the names of other craft."""


class Crowd:
    """world/crowd/MODEL/STATE; world/crowd/worst."""

    def __init__(self, stage: Stage) -> None:
        self._scene = stage.scene
        self._above_m = ABOVE * stage.reach_m * stage.upwards
        names = list(STATES)
        self._by_status = np.array([names.index(s) if s in names else 0 for s in STATUS])
        self._dark = np.isin(self._scene.craft, self._scene.without_sensors)
        self._crowd = np.setdiff1d(np.arange(len(self._scene.craft)), stage.near)
        members: dict[tuple[bytes, ...], list[int]] = {}
        for i in self._crowd:
            key = tuple(part.tobytes() for mesh, rgba in self._scene.visuals[i] for part in (*mesh, rgba))
            members.setdefault(key, []).append(int(i))
        self._groups: dict[str, tuple[drawing.Solid, Ints]] = {}
        """Per model its body and its members; a model without visible parts is left out."""
        for number, group in enumerate(members.values()):
            body = drawing.solid(drawing.plainer(self._scene.visuals[group[0]]))
            if body is not None:
                self._groups[f"world/crowd/model-{number}"] = body, np.array(group)
        self._drawn: set[str] = set()
        self._first: tuple[Floats, Ints] | None = None

    def begin(self, canvas: Canvas) -> None:
        """Prepare the label; the models are drawn when a craft first has their state."""
        self._canvas = canvas
        label = rr.Points3D.from_fields(colors=ink(0xFFFFFFFF), radii=[-2.5], show_labels=True)
        canvas.static(WORST, label)

    def send(self, send: Send, batch: Batch) -> None:
        """Move the instances, each in the entity of its state."""
        states = self._states(batch)
        turns = turn(batch.body_quaternion)
        for model, (body, who) in self._groups.items():
            place, quaternion = batch.body_position[:, who], turns[:, who]
            for code, state in enumerate(STATES):
                mine, entity = states[:, who] == code, f"{model}/{state}"
                if entity in self._drawn or mine.any():
                    if entity not in self._drawn:
                        self._draw(entity, body, STATES[state])
                    send(entity, _poses(place, quaternion, mine))
        self._label(send, batch)
        self._first = self._first or (batch.time_s[:1], batch.frame[:1])

    def _draw(self, entity: str, body: drawing.Solid, colour: int) -> None:
        """Draw a model in the colour of a state, which nobody had until now."""
        self._drawn.add(entity)
        self._canvas.static(entity, mesh(drawing.tinted(body, colour, TINT)))
        if self._first is None:
            return
        nowhere, nobody = np.full((1, 1, 3), np.nan), np.zeros((1, 1), dtype=np.bool_)
        self._canvas.at(*self._first)(entity, _poses(nowhere, np.eye(4)[None, 3:], nobody))

    def _states(self, batch: Batch) -> Ints:
        """Return the index in `STATES` of every craft, (n, C)."""
        by_error = np.searchsorted(ERRORS_MM, 1e3 * np.nan_to_num(batch.errors.position_error_m))
        out: Ints = np.where(by_light(batch.status), by_error, self._by_status[batch.status])
        out[:, self._dark] = list(STATES).index("without-sensors")
        return out

    def _label(self, send: Send, batch: Batch) -> None:
        """Name the craft that tracked least in the batch, of those that tracked most the one with the largest error."""
        who = self._crowd[~self._dark[self._crowd]]
        if not len(who):
            return
        # Searching counts twice, for it is worse than coasting.
        status = batch.status[:, who]
        lost = np.count_nonzero(~by_light(status), axis=0)
        lost += np.count_nonzero(status == STATUS.index("searching"), axis=0)
        error: Floats = np.nan_to_num(batch.errors.position_error_m[:, who]).max(axis=0)
        k = int(np.lexsort((error, lost))[-1])
        i, periods = int(who[k]), len(batch.time_s)
        at_worst = batch.status[~by_light(batch.status[:, i]), i]
        what = STATUS[int(at_worst[-1])] if lost[k] else f"{1e3 * error[k]:.3g} mm"
        points = rr.Points3D.columns(
            positions=batch.body_position[:, i] + self._above_m,
            labels=[f"worst: {self._scene.craft[i]}, {what}"] * periods,
        )
        send(WORST, points)


def _poses(place: Floats, quaternion: Floats, mine: Bools) -> Any:
    """Return the columns of the instances of one state; where nobody has it, one at no place, which is not drawn.

    Args:
        place: (n, C, 3) [m].
        quaternion: xyzw, (n, C, 4).
        mine: Who has the state, (n, C).
    """
    shown = mine.copy()
    nobody: Bools = np.logical_not(mine.any(axis=1))
    shown[nobody, 0] = True
    at = np.where(nobody[:, None, None], np.nan, place)[shown]
    poses = rr.InstancePoses3D.columns(translations=at, quaternions=quaternion[shown])
    return poses.partition(np.count_nonzero(shown, axis=1))
