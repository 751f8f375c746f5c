"""The recording of a run for the rerun viewer, readable at once; the only file that imports rerun.

Everything is in the lighthouse frame (x right, y down, z forward), on the timelines `sim_time` and `frame`:

    world/lighthouse     its body, field and two fans (which turn as the real ones do, slowed down)
    world/craft/NAME     the craft at its true pose, its photodiodes by what they see
    world/estimate/NAME  an outline at the filter's estimate; in a replay the craft itself
    world/covariance     3 sigma ellipsoids of the position, enlarged, up to half a metre
    world/rays           from the lighthouse to every photodiode in reach: lit or blocked
    world/trails         where the craft have been in the last seconds
    world/lidar/NAME     the last scan of a LiDAR, where its craft believes the returns to be
    world/cameras        lines of sight from cameras to the lights that they see; world/craft/NAME/ccd their fields
    status/NAME/sensor   whose pose went into the filter, of craft with cameras
    status/NAME/COLUMN   the columns of states to be shown: what a craft is doing, or what has failed
    swarm, detail        plots of all craft, of single craft; status: what each craft knows

Periods are gathered and sent by columns about once per simulated second. In a swarm of more than 32 the craft that are
not in the scene's `detail` are instances of one entity per model, at a reduced rate, and the plots show their spread.
Every entity has a row in every period sent, so that any cut of the recording shows everything.
"""

from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.rotation import matrix_from_quaternion, quaternion_from_matrix, xyzw_from_wxyz
from swarm.errors import SwarmError
from swarm.results.columns.core import SENSORS, STATUS
from swarm.results.columns.groups import groups_of
from swarm.results.disk import writing
from swarm.results.period import Period
from swarm.results.recording import drawing
from swarm.results.recording.blueprint import blueprint
from swarm.results.recording.plots import (
    ABOUT,
    SENSOR_COLOURS,
    STATE_COLOURS,
    STATUS_COLOURS,
    Batch,
    Shown,
    craft_plots,
    kept,
    shown_plots,
    stacked,
    swarm_plots,
)
from swarm.results.recording.scene import Scene
from swarm.results.recording.viewer import start_live
from swarm.results.records import Errors
from swarm.sensors.sight import Sight

MOST_SINGLE = 32
"""A swarm of more craft is drawn as a crowd."""
WAIT_FOR_POSE_S = 1.0
"""So long a recording waits for the first pose before it draws without."""
SEND_EVERY_S, SEND_EVERY_LIVE_S = 1.0, 0.2
ENLARGED = 50
"""How much the ellipsoids are: millimetres would not be seen beside metres."""
LARGEST_ELLIPSOID_M = 0.5
"""Half the longest axis of an ellipsoid as drawn, at most: that of a craft long in the dark would hide the scene."""
FAN_TURN_S, REAL_FAN_TURN_S = 4.0, 1 / 60
TRAIL_POINTS, TRAIL_STEP_S = 20, 0.2
SIGHT_COLOURS = np.array([0x78909CFF, 0xFF5252FF, 0x69F0AEFF], dtype=np.uint32)
SIGHT_LINES = {"main": 0x40C4FF90, "backup": 0xFFD54F90}
"""Lines of sight of the cameras."""
ABOUT_LIDARS = """| bright points | the last scan of a LiDAR, where its craft believes the returns to be |
"""
ABOUT_CAMERAS = """| blue, yellow line | from the main and the backup camera to a light that it sees |
| pyramids on a craft | the fields of its cameras |
"""
RAY_COLOURS = {"lit": (Sight.LIT, 0x69F0AE38), "blocked": (Sight.BLOCKED, 0xFF525290)}

Send = Callable[[str, Iterable[Any]], None]


class Recording:
    """Writes `path`, and with `live` feeds a viewer too: `append` every period, `close` at the end.

    A live viewer that cannot be opened is no error: `notice` says why, and the file is written all the same.
    """

    def __init__(self, path: Path, scene: Scene, live: bool = False) -> None:
        """Raises SwarmError where the file cannot be written."""
        self.notice: str | None = None
        self._path = path
        self._scene = scene
        craft = len(scene.craft)
        self._crowd = craft > MOST_SINGLE
        self._every = min(6, -(-craft // MOST_SINGLE))
        self._detail = [scene.craft.index(name) for name in scene.detail] or list(range(min(1, craft)))
        self._near = np.array(self._detail if self._crowd else range(craft), dtype=np.int64)
        still = set(scene.without_sensors)
        self._navigating = {i for i in range(craft) if scene.craft[i] not in still}
        self._colour = drawing.palette(craft)
        self._early: list[tuple[Period, Errors]] = []
        self._waiting: list[Batch] = []
        self._clouds: list[tuple[float, int, int, Floats]] = []
        self._trail: deque[Floats] = deque(maxlen=TRAIL_POINTS)
        self._trail_due_s = -np.inf
        self._started, self._replay = False, scene.replay
        self._shown = Shown(groups_of(scene))
        with writing(path), path.open("wb"):
            pass
        self._stream = rr.RecordingStream("lighthouse-swarm")
        sinks: list[Any] = [rr.FileSink(path)]
        self._send_every_s = SEND_EVERY_S
        if live:
            try:
                sinks.append(rr.GrpcSink(start_live()))
                self._send_every_s = SEND_EVERY_LIVE_S
            except SwarmError as error:
                self.notice = f"no live view: {error}; the recording is written all the same"
        self._live = len(sinks) > 1
        try:
            self._stream.set_sinks(*sinks)
        except RuntimeError as error:
            raise SwarmError(f"cannot write {path}: {error}") from error
        self._stream.send_recording_name(path.absolute().parent.name)

    def append(self, period: Period, errors: Errors) -> None:
        """Take one period; it is sent when enough have gathered."""
        if self._started:
            self._take(period, errors)
            return
        # The camera is aimed at the craft: in a replay, some periods pass before it is known where that is.
        self._early.append((period, errors))
        if len(_known(period)) or period.time_s - self._early[0][0].time_s >= WAIT_FOR_POSE_S:
            self._begin()

    def _begin(self) -> None:
        self._start(self._early[-1][0])
        for period, errors in self._early:
            self._take(period, errors)
        self._early.clear()

    def _take(self, period: Period, errors: Errors) -> None:
        if self._crowd and period.frame % self._every:
            return
        truth = period.truth
        turn = quaternion_from_matrix(period.estimate.rotation) if truth is None else truth.quaternion
        self._waiting.append(kept(period, errors, turn, self._shown.values(period)))
        self._clouds += [(period.time_s, period.frame, scan.craft, scan.cloud) for scan in period.scans]
        if period.time_s - float(self._waiting[0].time_s) >= self._send_every_s:
            self._send()

    def close(self) -> None:
        """Send what is left and complete the file."""
        try:
            if self._early:
                self._begin()
            self._send()
            self._flush()
        finally:
            self._stream.disconnect()

    def _start(self, period: Period) -> None:
        """Everything that does not move, once the first period shows where things are."""
        self._started = True
        scene, craft = self._scene, self._scene.craft
        known = _known(period)
        reach_m = 1.25 * float(np.linalg.norm(known, axis=1).max()) if len(known) else 3.0
        # Translucent, so that the lines of many craft do not hide each other.
        inks = [int.from_bytes(colour[:3].tobytes() + b"\xb4", "big") for colour in self._colour]
        swarm = swarm_plots(craft, inks, self._crowd, self._replay)
        watching = {pair.craft for pair in scene.ccd}
        single = {
            craft[i]: [
                *craft_plots(craft[i], i, self._replay, i in watching),
                *shown_plots(craft[i], i, self._shown.columns),
            ]
            for i in self._detail
        }
        self._plots = [*swarm, *(plot for plots in single.values() for plot in plots)]
        self._stream.send_blueprint(
            blueprint(swarm, single, known, len(self._near) * (1 + len(self._states())), self._live)
        )
        self._static("world", rr.ViewCoordinates.RDF)
        solid = "the craft at its estimate: the truth is not known" if self._replay else "the craft where it truly is"
        trail_s, slowed = TRAIL_POINTS * TRAIL_STEP_S, FAN_TURN_S / REAL_FAN_TURN_S
        cameras = (ABOUT_CAMERAS if scene.ccd else "") + (ABOUT_LIDARS if scene.lidar else "")
        about = ABOUT.format(craft=solid, enlarged=ENLARGED, slowed=slowed, trail=trail_s, cameras=cameras)
        self._static("about", rr.TextDocument(about, media_type="text/markdown"))
        for plot in self._plots:
            lines = rr.SeriesLines(
                names=plot.names,
                colors=np.array(plot.colours, dtype=np.uint32),
                widths=plot.widths,
                aggregation_policy="MinMaxAverage",
            )
            self._static(plot.entity, lines)
        self._draw_lighthouse(np.radians(scene.field_deg), reach_m)
        for i in self._near:
            self._draw_craft(int(i))
        self._draw_cameras()
        for i, _ in scene.lidar:
            points = rr.Points3D.from_fields(colors=self._colour[i][None], radii=[-1.6])
            self._static(f"world/lidar/{craft[i]}", points)
        self._groups = self._draw_crowd() if self._crowd else {}
        if 0 < period.time_s < 0.1:
            # The timeline begins with the run, not with the middle of its first period.
            self._send_fans(self._sender(np.zeros(1), np.zeros(1, dtype=np.int64)), np.zeros(1))
        inks_near = self._colour[self._near]
        for name, (_, colour) in RAY_COLOURS.items():
            ink = np.array([colour], dtype=np.uint32)
            self._static(f"world/rays/{name}", rr.LineStrips3D.from_fields(colors=ink, radii=[-0.4]))
        self._static("world/trails", rr.LineStrips3D.from_fields(colors=inks_near, radii=[-0.8]))
        # The viewer has no text in space: names are the labels of points without size, above the craft.
        names = [craft[i] for i in self._near]
        label = rr.Points3D.from_fields(labels=names, colors=inks_near, radii=[0.0], show_labels=True)
        self._static("world/names", label)
        self._name_offset_m = np.array([0.0, -_size(scene, self._near) - 0.045 * reach_m, 0.0])

    def _static(self, entity: str, what: Any) -> None:
        self._stream.log(entity, what, static=True)

    def _draw_lighthouse(self, field_rad: float, reach_m: float) -> None:
        if (body := drawing.solid(self._scene.lighthouse)) is not None:
            self._static("world/lighthouse/body", _mesh(body))
        strips = drawing.field(field_rad, 0.12 * reach_m)
        self._static("world/lighthouse/field", rr.LineStrips3D(strips, colors=[0xB0BEC5A0], radii=-0.8))
        axes = 0.12 * reach_m * np.eye(3)
        inks = np.array([0xEF5350FF, 0x66BB6AFF, 0x42A5F5FF], dtype=np.uint32)
        self._static("world/lighthouse/axes", rr.Arrows3D(vectors=axes, colors=inks, radii=0.003 * reach_m))
        vertex, face = drawing.fan(field_rad, reach_m)
        for fan, points, colour in (("x", vertex, 0xFF8A6506), ("y", vertex[:, [1, 0, 2]], 0x4FC3F706)):
            mesh = rr.Mesh3D(vertex_positions=points, triangle_indices=face, albedo_factor=colour)
            self._static(f"world/lighthouse/fan_{fan}/light", mesh)
            ink = np.array([colour | 0x90], dtype=np.uint32)
            rim = rr.LineStrips3D([np.roll(points, -1, axis=0).astype(np.float32)], colors=ink, radii=-0.6)
            self._static(f"world/lighthouse/fan_{fan}/rim", rim)

    def _body(self, i: int) -> str:
        return f"world/{'estimate' if self._replay else 'craft'}/{self._scene.craft[i]}"

    def _draw_craft(self, i: int) -> None:
        name, visuals = self._scene.craft[i], self._scene.visuals[i]
        if (mesh := drawing.solid(visuals)) is not None:
            self._static(f"{self._body(i)}/mesh", _mesh(mesh))
        if not self._replay:
            lines = rr.LineStrips3D(drawing.outline(visuals).astype(np.float32), colors=[self._colour[i]], radii=-0.6)
            self._static(f"world/estimate/{name}/outline", lines)
        points = self._scene.photodiodes.point_m[i][self._scene.photodiodes.present[i]]
        self._static(f"{self._body(i)}/photodiodes", rr.Points3D(points, radii=-2.0))
        states = rr.StateConfiguration(values=list(STATUS), colors=np.array(STATUS_COLOURS, dtype=np.uint32))
        if i in self._navigating:
            self._static(f"status/{name}", states)
        for column in self._states():
            names = self._shown.columns[column].names
            ink = np.array([STATE_COLOURS[k % len(STATE_COLOURS)] for k in range(len(names))], dtype=np.uint32)
            entity = f"status/{name}/{self._shown.columns[column].name}"
            self._static(entity, rr.StateConfiguration(values=list(names), colors=ink))

    def _states(self) -> list[int]:
        """Return the shown columns that hold states."""
        return [k for k, column in enumerate(self._shown.columns) if column.names]

    def _draw_cameras(self) -> None:
        """The fields of the cameras, and the lines of sight's colours, where there are any."""
        for pair in self._scene.ccd:
            name = self._scene.craft[pair.craft]
            if pair.craft not in self._near:
                continue
            strips = drawing.field(pair.field_rad, 0.6)
            for camera, ink in enumerate(SIGHT_LINES.values()):
                turned = [strip @ pair.rotation[camera].T + pair.pinhole_m[camera] for strip in strips]
                lines = rr.LineStrips3D([line.astype(np.float32) for line in turned], colors=[ink], radii=-0.6)
                self._static(f"world/craft/{name}/ccd/{camera}", lines)
            states = rr.StateConfiguration(values=list(SENSORS), colors=np.array(SENSOR_COLOURS, dtype=np.uint32))
            self._static(f"status/{name}/sensor", states)
        if self._scene.ccd:
            for which, colour in SIGHT_LINES.items():
                colours = np.array([colour], dtype=np.uint32)
                self._static(f"world/cameras/{which}", rr.LineStrips3D.from_fields(colors=colours, radii=[-0.5]))

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

    def _sender(self, time_s: Floats, frame: Ints) -> Send:
        index = [
            rr.TimeColumn("sim_time", duration=np.rint(time_s * 1e9).astype("timedelta64[ns]")),
            rr.TimeColumn("frame", sequence=frame),
        ]

        def send(entity: str, columns: Iterable[Any]) -> None:
            self._stream.send_columns(entity, index, columns)

        return send

    def _send(self) -> None:
        if not self._waiting:
            return
        batch, self._waiting = stacked(self._waiting), []
        send = self._sender(batch.time_s, batch.frame)
        self._send_poses(send, batch)
        self._send_fans(send, batch.time_s)
        self._send_sight(send, batch)
        self._send_cameras(send, batch)
        self._send_clouds()
        self._send_covariance(send, batch)
        self._send_trails(send, batch)
        for plot in self._plots:
            send(plot.entity, rr.Scalars.columns(scalars=plot.values(batch)))
        for i in self._near:
            if int(i) in self._navigating:
                states = [STATUS[code] for code in batch.status[:, i]]
                send(f"status/{self._scene.craft[i]}", rr.StateChange.columns(state=states))
            for column in self._states():
                name, names = self._shown.columns[column].name, self._shown.columns[column].names
                codes = batch.shown[:, i, column]
                if np.isfinite(codes).all():
                    states = [names[int(code)] for code in codes]
                    send(f"status/{self._scene.craft[i]}/{name}", rr.StateChange.columns(state=states))
        self._flush()

    def _flush(self) -> None:
        """Hand everything to the operating system, so that it survives a kill."""
        try:
            self._stream.flush()
        except RuntimeError as error:
            raise SwarmError(f"cannot write {self._path}: the disk is full, or gone ({error})") from error

    def _send_poses(self, send: Send, batch: Batch) -> None:
        """Transforms: one to a place that is not a number hides what it carries, a craft that knows nothing."""
        turn = _turn(quaternion_from_matrix(batch.rotation[:, self._near]))
        true_turn = _turn(batch.body_quaternion)
        for k, i in enumerate(self._near):
            estimate = rr.Transform3D.columns(translation=batch.position[:, i], quaternion=turn[:, k])
            send(f"world/estimate/{self._scene.craft[i]}", estimate)
            if not self._replay:
                truth = rr.Transform3D.columns(translation=batch.body_position[:, i], quaternion=true_turn[:, i])
                send(f"world/craft/{self._scene.craft[i]}", truth)
        above = (batch.body_position[:, self._near] + self._name_offset_m).reshape(-1, 3)
        send("world/names", rr.Points3D.columns(positions=above).partition([len(self._near)] * len(batch.time_s)))
        for entity, who in self._groups.items():
            at, turns = batch.body_position[:, who].reshape(-1, 3), true_turn[:, who].reshape(-1, 4)
            poses = rr.InstancePoses3D.columns(translations=at, quaternions=turns)
            send(entity, poses.partition([len(who)] * len(batch.time_s)))

    def _send_fans(self, send: Send, time_s: Floats) -> None:
        """Sweep angle a from boresight: x/z = -tan a is a turn of -a about Y, y/z = -tan a one of a about X."""
        turn = time_s / FAN_TURN_S
        for fan, offset, axis, sign in (("x", 0.25, 1, -1.0), ("y", 0.75, 0, 1.0)):
            a = 2 * np.pi * ((turn - offset + 0.5) % 1 - 0.5)
            quaternion = np.zeros((len(a), 4))
            quaternion[:, axis], quaternion[:, 3] = np.sin(sign * a / 2), np.cos(a / 2)
            outside = np.abs(a) > np.radians(self._scene.field_deg) / 2
            at = np.where(outside[:, None], np.nan, np.zeros((len(a), 3)))
            send(f"world/lighthouse/fan_{fan}", rr.Transform3D.columns(translation=at, quaternion=quaternion))

    def _send_sight(self, send: Send, batch: Batch) -> None:
        present = self._scene.photodiodes.present[self._near]
        sight = batch.sight[:, self._near]
        for k, i in enumerate(self._near):
            colours = SIGHT_COLOURS[sight[:, k][:, present[k]]]
            columns = rr.Points3D.columns(colors=colours.reshape(-1))
            send(f"{self._body(int(i))}/photodiodes", columns.partition([colours.shape[1]] * len(colours)))
        rotation = matrix_from_quaternion(batch.body_quaternion[:, self._near])
        point = np.einsum("ncij,ckj->ncki", rotation, self._scene.photodiodes.point_m[self._near])
        point += batch.body_position[:, self._near, None]
        drawable = present & np.isfinite(point).all(axis=-1)
        for name, (state, _) in RAY_COLOURS.items():
            _send_segments(send, f"world/rays/{name}", point, drawable & (sight == state))

    def _send_cameras(self, send: Send, batch: Batch) -> None:
        """Lines of sight of every pair, and whose pose each of its craft took in."""
        pairs = self._scene.ccd
        if not pairs or self._replay:
            return
        rotation = matrix_from_quaternion(batch.body_quaternion)
        for camera, name in enumerate(SIGHT_LINES):
            strips: list[Floats] = []
            count = np.zeros(len(batch.time_s), dtype=np.int64)
            for p, pair in enumerate(pairs):
                seen = batch.ccd_seen[:, p, camera, : len(pair.light_m)]
                eye = rotation[:, pair.craft] @ pair.pinhole_m[camera] + batch.body_position[:, pair.craft]
                light = np.einsum("nij,kj->nki", rotation[:, pair.target], pair.light_m)
                light += batch.body_position[:, None, pair.target]
                strips.append(np.stack([np.broadcast_to(eye[:, None], light.shape), light], axis=2))
                count += np.count_nonzero(seen, axis=1)
            # Period by period, the lines of all pairs.
            seen = np.concatenate([batch.ccd_seen[:, p, camera, : len(q.light_m)] for p, q in enumerate(pairs)], axis=1)
            lines = np.concatenate(strips, axis=1)[seen].astype(np.float32)
            send(f"world/cameras/{name}", rr.LineStrips3D.columns(strips=lines).partition(count))
        for pair in pairs:
            if pair.craft in self._near:
                states = [SENSORS[code] for code in batch.sensor[:, pair.craft]]
                send(f"status/{self._scene.craft[pair.craft]}/sensor", rr.StateChange.columns(state=states))

    def _send_clouds(self) -> None:
        """The scans that became complete, each at its own time."""
        for i in sorted({who for _, _, who, _ in self._clouds}):
            mine = [(time_s, frame, cloud) for time_s, frame, who, cloud in self._clouds if who == i]
            send = self._sender(np.array([t for t, _, _ in mine]), np.array([f for _, f, _ in mine]))
            points = np.concatenate([cloud for _, _, cloud in mine]).astype(np.float32)
            columns = rr.Points3D.columns(positions=points).partition([len(cloud) for _, _, cloud in mine])
            send(f"world/lidar/{self._scene.craft[i]}", columns)
        self._clouds.clear()

    def _send_covariance(self, send: Send, batch: Batch) -> None:
        covariance, position = batch.covariance[:, self._near], batch.position[:, self._near]
        known = np.isfinite(covariance).all(axis=(-1, -2)) & np.isfinite(position).all(axis=-1)
        half, quaternion = drawing.ellipsoids(covariance[known], 3.0)
        colours = np.broadcast_to(self._colour[self._near], (*known.shape, 4))[known]
        columns = rr.Ellipsoids3D.columns(
            half_sizes=half * np.minimum(ENLARGED, LARGEST_ELLIPSOID_M / half.max(axis=1, keepdims=True)),
            centers=position[known],
            quaternions=xyzw_from_wxyz(quaternion),
            colors=colours,
        )
        send("world/covariance", columns.partition(np.count_nonzero(known, axis=1)))

    def _send_trails(self, send: Send, batch: Batch) -> None:
        strips: list[Floats] = []
        for time_s, position in zip(batch.time_s, batch.body_position[:, self._near], strict=True):
            if time_s >= self._trail_due_s:
                self._trail.append(position)
                self._trail_due_s = time_s + TRAIL_STEP_S
            # Padded with the oldest point, so that every strip has the same length.
            missing = TRAIL_POINTS - len(self._trail)
            strips.append(np.stack([*[self._trail[0]] * missing, *self._trail, position], axis=1))
        lines = np.concatenate(strips).astype(np.float32)
        columns = rr.LineStrips3D.columns(strips=lines)
        send("world/trails", columns.partition([len(self._near)] * len(strips)))


def _known(period: Period) -> Floats:
    """Where craft are, (n, 3) [m], of those of which it is known."""
    at = period.estimate.position if period.truth is None else period.truth.position
    known: Floats = at[np.isfinite(at).all(axis=1)]
    return known


def _turn(quaternion: Floats) -> Floats:
    """xyzw; where not known no turn, since the viewer would ignore the whole transform."""
    known = np.isfinite(quaternion).all(axis=-1, keepdims=True)
    return xyzw_from_wxyz(np.where(known, quaternion, np.array([1.0, 0.0, 0.0, 0.0])))


def _size(scene: Scene, craft: Ints) -> float:
    """Radius [m] about the body's origin of the largest of these craft."""
    points = [mesh.vertex for i in craft for mesh, _ in scene.visuals[i]] + [
        scene.photodiodes.point_m[i] for i in craft
    ]
    return max((float(np.linalg.norm(p, axis=1).max()) for p in points if len(p)), default=0.0)


def _mesh(solid: drawing.Solid) -> rr.Mesh3D:
    return rr.Mesh3D(vertex_positions=solid.vertex, vertex_normals=solid.normal, vertex_colors=solid.colour)


def _send_segments(send: Send, entity: str, end: Floats, drawn: Bools) -> None:
    """Segments from the origin to the `drawn` (n, C, K) of the points `end` (n, C, K, 3)."""
    to = end[drawn]
    count: NDArray[np.int64] = np.count_nonzero(drawn, axis=(1, 2))
    strips = np.stack([np.zeros_like(to), to], axis=1).astype(np.float32)
    columns = rr.LineStrips3D.columns(strips=strips)
    send(entity, columns.partition(count))
