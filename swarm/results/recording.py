"""The recording of a run for the rerun viewer, readable at once; the only file that imports rerun.

Everything is in the lighthouse frame (x right, y down, z forward), on the timelines `sim_time` and `frame`:

    world/lighthouse     its body, field and two fans (which turn as the real ones do, slowed down)
    world/craft/NAME     the craft at its true pose, its photodiodes by state
    world/estimate/NAME  an outline at the filter's estimate; in a replay the craft itself
    world/covariance     3 sigma ellipsoids of the position, enlarged
    world/rays           from the lighthouse to every photodiode: lit or blocked
    world/trails         where the craft have been in the last seconds
    swarm, detail, status    plots: all craft, single craft, what each knows

Periods are gathered and sent by columns about once per simulated second. In a swarm of more than 32, the craft that are
not in `detail` are instances of one entity per model, at a reduced rate, and the swarm's plots show its spread.
"""

from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.rotation import matrix_from_quaternion, quaternion_from_matrix, xyzw_from_wxyz
from swarm.errors import SwarmError
from swarm.results import drawing, plots
from swarm.results.disk import writing
from swarm.results.recorder import BLOCKED, LIT, Period, Scene
from swarm.results.telemetry import STATUS
from swarm.results.viewer import start_live

MOST_SINGLE = 32
"""A swarm of more craft is drawn as a crowd."""
SEND_EVERY_S, SEND_EVERY_LIVE_S = 1.0, 0.2
ENLARGED = 50
"""Of the ellipsoids: millimetres would not be seen beside metres."""
FAN_PERIOD_S = 4.0
"""A turn of the drawn fans; the real ones take 1/60 s."""
TRAIL_POINTS, TRAIL_STEP_S = 24, 0.25
SIGHT_COLOURS = np.array([0x5A6472FF, 0xFF5252FF, 0x69F0AEFF], dtype=np.uint32)
RAY_COLOURS = {LIT: 0x69F0AE50, BLOCKED: 0xFF525290}
STATUS_COLOURS = [0x616161FF, 0x2E7D32FF, 0xEF6C00FF, 0x8E24AAFF]
BARE = np.full(3, np.nan)


class Recording:
    """Writes `path`, and with `live` feeds a viewer too: `append` every period, `close` at the end.

    A live viewer that cannot be opened is no error: `notice` says why, the file is written all the same.
    """

    def __init__(self, path: Path, scene: Scene, live: bool = False) -> None:
        """Raises SwarmError where the file cannot be written."""
        self.notice: str | None = None
        self._scene, self._live = scene, live
        craft = len(scene.craft)
        self._crowd = craft > MOST_SINGLE
        self._every = min(6, -(-craft // MOST_SINGLE))
        chosen = [scene.craft.index(name) for name in scene.detail] or list(range(min(1, craft)))
        self._detail = np.array(chosen, dtype=np.int64)
        self._near = self._detail if self._crowd else np.arange(craft)
        self._colour = drawing.palette(craft)
        self._waiting: list[Period] = []
        self._trail: deque[Floats] = deque(maxlen=TRAIL_POINTS)
        self._trail_due_s = -np.inf
        self._started = False
        with writing(path), path.open("wb"):
            pass
        self._stream = rr.RecordingStream("lighthouse-swarm")
        sinks: list[Any] = [rr.FileSink(path)]
        if live:
            try:
                sinks.append(rr.GrpcSink(start_live()))
            except SwarmError as error:
                self._live = False
                self.notice = f"no live view: {error}; the recording is written all the same"
        self._stream.set_sinks(*sinks)
        self._stream.send_recording_name(path.parent.name or path.stem)

    def append(self, period: Period) -> None:
        """Take one period; sent when enough have gathered."""
        if not self._started:
            self._start(period)
        if self._crowd and period.frame % self._every:
            return
        self._waiting.append(_kept(period))
        if period.time_s - self._waiting[0].time_s >= (SEND_EVERY_LIVE_S if self._live else SEND_EVERY_S):
            self._send()

    def close(self) -> None:
        """Send what is left and complete the file."""
        self._send()
        self._stream.flush()
        self._stream.disconnect()

    def _static(self, entity: str, *what: Any) -> None:
        self._stream.log(entity, *what, static=True)

    def _start(self, period: Period) -> None:
        """Everything that does not move, once the first period shows where things are."""
        scene = self._scene
        replay = period.truth is None
        start = period.estimate.position if period.truth is None else period.truth.position
        known = start[np.isfinite(start).all(axis=1)]
        reach = 1.25 * float(np.linalg.norm(known, axis=1).max()) if len(known) else 3.0
        self._plots = plots.Plots(scene.craft, [scene.craft[i] for i in self._detail], self._crowd, replay)
        self._stream.send_blueprint(blueprint(self._plots, known, reach, self._live))
        self._static("world", rr.ViewCoordinates.RDF)
        self._static("about", rr.TextDocument(plots.ABOUT.format(enlarged=ENLARGED), media_type="text/markdown"))
        self._draw_lighthouse(np.radians(scene.field_deg), reach)
        for i in self._near:
            self._draw_craft(int(i), replay)
        self._groups = self._draw_crowd() if self._crowd else {}
        if not self._crowd:
            self._static("world/names", rr.Points3D.from_fields(radii=[0.0], labels=list(scene.craft)))
        for name, lines in self._plots.lines.items():
            self._static(
                name, rr.SeriesLines(names=lines.names, colors=lines.colours, widths=lines.widths, **_NO_AGGREGATION)
            )
        self._started = True

    def _draw_lighthouse(self, field_rad: float, reach_m: float) -> None:
        if (body := drawing.solid(self._scene.lighthouse)) is not None:
            self._static("world/lighthouse/body", _mesh(body))
        strips = drawing.field(field_rad, 0.2 * reach_m)
        self._static("world/lighthouse/field", rr.LineStrips3D(strips, colors=[0x90A4AE60], radii=-0.7))
        vertex, face = drawing.fan(field_rad, reach_m)
        for name, colour, turn in (("x", 0xFF8A6530, None), ("y", 0x4FC3F730, np.array([[0, 1, 0], [1, 0, 0]]))):
            # Fan X is a plane through the Y axis; fan Y is the same with x and y exchanged.
            points = vertex if turn is None else vertex[:, [1, 0, 2]]
            mesh = rr.Mesh3D(vertex_positions=points, triangle_indices=face, albedo_factor=colour)
            self._static(f"world/lighthouse/fan_{name}/light", mesh)

    def _draw_craft(self, i: int, replay: bool) -> None:
        name, visuals = self._scene.craft[i], self._scene.visuals[i]
        body = f"world/estimate/{name}" if replay else f"world/craft/{name}"
        if (mesh := drawing.solid(visuals)) is not None:
            self._static(f"{body}/mesh", _mesh(mesh))
        edges = drawing.outline(visuals)
        if len(edges) and not replay:
            lines = rr.LineStrips3D(edges, colors=[self._colour[i]], radii=-1.2)
            self._static(f"world/estimate/{name}/outline", lines)
        points = self._scene.photodiodes.point_m[i][self._scene.photodiodes.present[i]]
        self._static(f"{body}/photodiodes", rr.Points3D(points, radii=-3.0))

    def _draw_crowd(self) -> dict[str, Ints]:
        """Entities of the craft without detail, one per model, and who is in each."""
        members: dict[tuple[bytes, ...], list[int]] = {}
        for i in np.setdiff1d(np.arange(len(self._scene.craft)), self._near):
            key = tuple(part.tobytes() for mesh, rgba in self._scene.visuals[i] for part in (*mesh, rgba))
            members.setdefault(key, []).append(int(i))
        groups: dict[str, Ints] = {}
        for number, who in enumerate(members.values()):
            if (body := drawing.solid(self._scene.visuals[who[0]])) is not None:
                groups[f"world/crowd/model-{number}"] = np.array(who)
                self._static(f"world/crowd/model-{number}", _mesh(body))
        return groups

    def _send(self) -> None:
        if not self._waiting:
            return
        rows, self._waiting = self._waiting, []
        time = np.array([row.time_s for row in rows])
        frame = np.array([row.frame for row in rows])
        index = [
            rr.TimeColumn("sim_time", duration=np.rint(time * 1e9).astype("timedelta64[ns]")),
            rr.TimeColumn("frame", sequence=frame),
        ]

        def send(entity: str, columns: Any) -> None:
            self._stream.send_columns(entity, index, columns)

        position = np.stack([row.estimate.position for row in rows])
        rotation = np.stack([row.estimate.rotation for row in rows])
        quaternion = quaternion_from_matrix(rotation)
        body_position, body_rotation = position, rotation
        for row in rows:
            self._check(row)
        truths = [row.truth for row in rows if row.truth is not None]
        if truths:
            body_position = np.stack([truth.position for truth in truths])
            body_quaternion = np.stack([truth.quaternion for truth in truths])
            body_rotation = matrix_from_quaternion(body_quaternion)
            self._send_poses(send, "world/craft", body_position, body_quaternion)
            for entity, who in self._groups.items():
                self._send_crowd(send, entity, body_position[:, who], body_quaternion[:, who])
        self._send_poses(send, "world/estimate", position, quaternion)
        self._send_fans(send, time)
        self._send_sight(send, np.stack([row.sight for row in rows]), body_position, body_rotation, bool(truths))
        self._send_covariance(send, position, np.stack([row.estimate.covariance for row in rows])[..., 6:9, 6:9])
        self._send_trails(send, time, body_position)
        if not self._crowd:
            send("world/names", _split(rr.Points3D.columns(positions=_flat(body_position)), *body_position.shape[:2]))
        for name, values in self._plots.values(rows).items():
            send(name, rr.Scalars.columns(scalars=values))
        for i in self._near:
            states = [STATUS[row.estimate.status[i]] for row in rows]
            send(f"status/{self._scene.craft[i]}", rr.StateChange.columns(state=states))
        self._stream.flush(timeout_sec=10.0)
