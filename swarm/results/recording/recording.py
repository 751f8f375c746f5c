"""The recording of a run for the rerun viewer, readable at once.

Everything is in the lighthouse frame (x right, y down, z forward), or of several stations in the frame in which they
stand, on the timelines `sim_time` and `frame`:

    world/lighthouse     its body, field and axes; world/stations/NAME of several
    world/fans           its two fans, which turn as the real ones do, slowed down; world/fans/NAME of several stations
    world/light/NAME     lines from one of several stations to the craft whose filters take in its light
    world/craft/NAME     the craft at its true pose, its photodiodes by what they see
    world/estimate/NAME  an outline at the filter's estimate; in a replay the craft itself
    world/covariance     3 sigma ellipsoids of the position, enlarged, up to half a metre
    world/crowd          the craft of a large swarm, by model and state, and a label of the worst
    world/rays           from the lighthouse to every photodiode in reach: lit or blocked
    world/trails         where the craft have been in the last seconds
    world/lidar/NAME     the last scan of a LiDAR, where its craft believes the returns to be
    world/directions     at the lighthouse of a scenario with an orbit: to the Earth, along the flight, to the sun
    orbit                the Earth, the orbit and the lighthouse on it, in a view of its own
    world/cameras        lines of sight from cameras to the lights that they see; world/craft/NAME/ccd their fields
    status/NAME/sensor   whose pose went into the filter, of craft with cameras
    status/NAME/COLUMN   the columns of states to be shown: what a craft is doing, or what has failed
    swarm, detail        plots of all craft, of single craft; status: what each craft knows

Periods are gathered and sent by columns about once per simulated second. In a swarm of more than 32 the craft that are
not in the scene's `detail` are instances of one entity per model, at a reduced rate, and the plots show their spread.
Every entity has a row in every period sent, so that any cut of the recording shows everything.
"""

from pathlib import Path

import numpy as np
import rerun as rr

from estimators.arrays import Floats
from swarm.results.columns.groups import groups_of
from swarm.results.period import Period
from swarm.results.recording import drawing
from swarm.results.recording.about import about
from swarm.results.recording.batch import Batch, Shown, kept, stacked
from swarm.results.recording.blueprint import blueprint
from swarm.results.recording.cameras import Cameras
from swarm.results.recording.canvas import Canvas, Send, ink
from swarm.results.recording.craft import Bodies, Trails
from swarm.results.recording.crowd import Crowd
from swarm.results.recording.estimates import Estimates
from swarm.results.recording.lanes import Lanes
from swarm.results.recording.layer import Layer, Stage
from swarm.results.recording.lidars import Lidars
from swarm.results.recording.lighthouse import Lighthouse
from swarm.results.recording.orbit import Orbit, tips
from swarm.results.recording.pairs import Pairs
from swarm.results.recording.plots import Plot, craft_plots, shown_plots, swarm_plots
from swarm.results.recording.rays import Rays
from swarm.results.recording.stations import Stations
from swarm.results.records import Errors
from swarm.results.scene import Scene

DARK = "lighthouse-dark"
"""The fault without light."""
MOST_SINGLE = 32
"""A swarm of more craft is drawn as a crowd."""
WAIT_FOR_POSE_S = 1.0
"""Time that a recording waits for the first pose before it draws without."""
SEND_EVERY_S, SEND_EVERY_LIVE_S = 2.0, 0.2
"""Time of flight that waits in memory: as much as of telemetry, for most of sending is the same for any number of
periods; a viewer is fed sooner."""


class Recording:
    """Writes `path`, and with `live` feeds a viewer too: `append` every period, `close` at the end.

    A live viewer that cannot be opened is no error: `notice` says why, and the file is written all the same.
    """

    def __init__(self, path: Path, scene: Scene, live: bool = False) -> None:
        """Open the file.

        Args:
            path: The file.
            scene: What does not change during the run.
            live: Feed a viewer too.

        Raises:
            SwarmError: The file cannot be written.
        """
        self._scene, self._canvas = scene, Canvas(path, live)
        self.notice = self._canvas.notice
        self._send_every_s = SEND_EVERY_LIVE_S if self._canvas.live else SEND_EVERY_S
        craft = len(scene.craft)
        self.draws_every = min(6, -(-craft // MOST_SINGLE)) if craft > MOST_SINGLE else 1
        """One of so many periods is drawn."""
        self._shown = Shown(groups_of(scene))
        self._dark = np.array([DARK in name.split(" + ") for name in scene.faults], dtype=np.bool_)
        self._early: list[tuple[Period, Errors]] = []
        self._layers: list[Layer] = []
        self._waiting: list[Batch] = []

    def append(self, period: Period, errors: Errors) -> None:
        """Take one period; it is sent when enough have gathered."""
        if self._layers:
            self._take(period, errors)
            return
        # The camera is aimed at the craft: in a replay, some periods pass before it is known where that is.
        self._early.append((period, errors))
        if len(_known(period)) or period.time_s - self._early[0][0].time_s >= WAIT_FOR_POSE_S:
            self._begin()

    def _begin(self) -> None:
        """Draw everything that does not move, once the first pose shows where things are."""
        latest, _ = self._early[-1]
        known = _known(latest)
        scene, craft = self._scene, self._scene.craft
        crowd = len(craft) > MOST_SINGLE
        detail = [craft.index(name) for name in scene.detail] or list(range(min(1, len(craft))))
        near = np.array(detail if crowd else range(len(craft)), dtype=np.int64)
        places = np.array([station.position for station in scene.stations if station.craft < 0]).reshape(-1, 3)
        shown = np.concatenate([known, places])
        if scene.stations:
            reach_m = 1.25 * float(np.linalg.norm(np.ptp(shown, axis=0)) or 3.0)
        else:
            reach_m = 1.25 * float(np.linalg.norm(known, axis=1).max()) if len(known) else 3.0
        if scene.orbit is not None:
            shown = np.concatenate([shown, tips(scene.orbit, reach_m)])
        stage = Stage(scene, near, crowd, detail, drawing.palette(len(craft)), reach_m, latest.time_s)
        lanes, plots = Lanes(stage, self._shown.columns, self._shown.values(latest)), Plots(stage, self._shown)
        self._canvas.lay_out(
            blueprint(
                plots.swarm,
                plots.single,
                shown,
                lanes.count,
                self._canvas.live,
                scene.up,
                not scene.stations,
                scene.orbit,
            )
        )
        self._layers = [
            Stations(stage) if scene.stations else Lighthouse(stage),
            Bodies(stage),
            Estimates(stage),
            Rays(stage),
            *([Pairs(stage)] if scene.pairs else []),
            *([Cameras(stage)] if scene.ccd else []),
            *([Lidars(stage)] if scene.lidar else []),
            Trails(stage),
            *([Orbit(stage, scene.orbit)] if scene.orbit is not None else []),
            *([Crowd(stage)] if crowd else []),
            lanes,
            plots,
        ]
        axes = rr.ViewCoordinates.RIGHT_HAND_Z_UP if scene.up == "z" else rr.ViewCoordinates.RDF
        self._canvas.static("world", axes)
        self._canvas.static("about", rr.TextDocument(about(scene, crowd), media_type="text/markdown"))
        for layer in self._layers:
            layer.begin(self._canvas)
        for period, errors in self._early:
            self._take(period, errors)
        self._early.clear()

    def _take(self, period: Period, errors: Errors) -> None:
        if period.frame % self.draws_every:
            return
        self._waiting.append(kept(period, errors, self._shown.values(period), self._dark))
        if period.time_s - float(self._waiting[0].time_s) >= self._send_every_s:
            self._send()

    def _send(self) -> None:
        if not self._waiting:
            return
        batch, self._waiting = stacked(self._waiting), []
        send = self._canvas.at(batch.time_s, batch.frame)
        for layer in self._layers:
            layer.send(send, batch)
        self._canvas.flush()

    def close(self) -> None:
        """Send what is left and complete the file."""
        try:
            if self._early:
                self._begin()
            self._send()
            self._canvas.flush()
        finally:
            self._canvas.close()


class Plots:
    """swarm, detail: plots of all craft, and of single ones."""

    def __init__(self, stage: Stage, shown: Shown) -> None:
        scene, craft = stage.scene, stage.scene.craft
        # Translucent, so that the lines of many craft do not hide each other.
        inks = [int.from_bytes(colour[:3].tobytes() + b"\xb4", "big") for colour in stage.colour]
        watching = {pair.craft for pair in scene.ccd}
        untold = scene.replay and not scene.truth
        self.swarm = swarm_plots(craft, inks, stage.crowd, untold, scene.without_sensors)
        self.single = {
            craft[i]: [
                *craft_plots(craft[i], i, untold, i in watching),
                *shown_plots(craft[i], i, shown.columns),
            ]
            for i in stage.detail
        }

    @property
    def _all(self) -> list[Plot]:
        return [*self.swarm, *(plot for plots in self.single.values() for plot in plots)]

    def begin(self, canvas: Canvas) -> None:
        """Name, colour and weigh the lines."""
        for plot in self._all:
            lines = rr.SeriesLines(
                names=[line.name for line in plot.lines],
                colors=ink(*(line.colour for line in plot.lines)),
                widths=[line.width for line in plot.lines],
                aggregation_policy="MinMaxAverage",
            )
            canvas.static(plot.entity, lines)

    def send(self, send: Send, batch: Batch) -> None:
        """Send the values."""
        for plot in self._all:
            send(plot.entity, rr.Scalars.columns(scalars=plot.values(batch)))


def _known(period: Period) -> Floats:
    """Return where craft are, (n, 3) [m], of those of which it is known."""
    at = period.estimate.position if period.truth is None else period.truth.position
    known: Floats = at[np.isfinite(at).all(axis=1)]
    return known
