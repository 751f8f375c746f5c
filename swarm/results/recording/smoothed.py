"""smooth.rrd: lines of the smoothed estimates, which the viewer shows in the plots and the scene of the recording.

It has the recording's own id: a viewer that opens both files has one recording. Each line is an entity below that of
the plot that it belongs to, so that the layout stays as it is:

    detail/NAME/PLOT/smoothed    error and 3 sigma, NEES; in a replay the position
    world/smoothed               the ways of the craft
"""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from rerun.chunk import RrdReader

from estimators.arrays import Bools, Floats
from swarm.errors import SwarmError
from swarm.results.disk import unwritten, writing
from swarm.results.files import RECORDING, SCENARIO
from swarm.results.recording import drawing
from swarm.results.recording.canvas import ink
from swarm.results.recording.plots import MEDIUM, THIN, Line
from swarm.results.run_folder import Run
from swarm.results.table import doubles
from swarm.user_text import parse_toml

GREEN = 0xAED581FF
VALUE, SIGMA = Line("smoothed", GREEN, MEDIUM), Line("smoothed 3σ", 0xAED58180, THIN)
MOST_WAYS = 32
"""Largest number of craft whose ways are drawn."""
WAY_STEP = 6
"""One of so many periods is a point of a way."""
Values = Callable[[pa.Table], Floats]


class RecordingUnreadable(SwarmError):
    """The recording that the lines belong to is damaged."""


class Smoothed(NamedTuple):
    """The lines of one plot: its entity, and their values (rows,) from the rows of smooth.parquet."""

    entity: str
    lines: dict[Line, Values]


class SmoothedRecording:
    """Writes smooth.rrd: `send` some periods of rows, in any order, and `close` at the end."""

    def __init__(self, path: Path, run: Run, craft: Sequence[str], replay: bool) -> None:
        """Open the file.

        Args:
            path: the file.
            run: the run, with its recording.
            craft: names of its craft.
            replay: there is no truth.

        Raises:
            RecordingUnreadable: the recording is damaged.
            SwarmError: the file cannot be written.
        """
        self._craft = list(craft)
        self._single = [name for name in _detail(run) if name in craft] or self._craft[:1]
        self._plots = {name: _plots(name, replay) for name in self._single}
        self._ways: list[Floats] = []
        with writing(path), path.open("wb"):
            pass
        self._path = path
        self._stream = rr.RecordingStream("lighthouse-swarm", recording_id=_id(run.folder / RECORDING))
        try:
            self._stream.set_sinks(rr.FileSink(path))
        except RuntimeError as error:
            raise unwritten(path, error) from error
        for plot in (plot for plots in self._plots.values() for plot in plots):
            lines = rr.SeriesLines(
                names=[line.name for line in plot.lines],
                colors=ink(*(line.colour for line in plot.lines)),
                widths=[line.width for line in plot.lines],
                aggregation_policy="MinMaxAverage",
            )
            self._stream.log(plot.entity, lines, static=True)

    def send(self, rows: pa.Table) -> None:
        """Draw some periods: whole ones, with a row per craft each."""
        count = len(self._craft)
        time_s = doubles(rows, "time_s")[::count]
        frame = rows.column("frame").to_numpy()[::count]
        index: list[Any] = [
            rr.TimeColumn("sim_time", duration=np.rint(time_s * 1e9).astype("timedelta64[ns]")),
            rr.TimeColumn("frame", sequence=frame),
        ]
        for name, plots in self._plots.items():
            own = rows.take(pa.array(np.arange(self._craft.index(name), len(rows), count)))
            for plot in plots:
                values = np.stack([of(own) for of in plot.lines.values()], axis=1)
                self._stream.send_columns(plot.entity, index, rr.Scalars.columns(scalars=values))
        if count <= MOST_WAYS:
            places = np.stack([doubles(rows, f"smooth_p{a}_m") for a in "xyz"], axis=1).reshape(-1, count, 3)
            self._ways.append(places[frame % WAY_STEP == 0].astype(np.float32))

    def close(self) -> None:
        """Draw the ways and complete the file. Raises SwarmError on a full disk."""
        try:
            if self._ways:
                self._draw_ways(np.concatenate(self._ways[::-1]))
            self._stream.flush()
        except RuntimeError as error:
            raise unwritten(self._path, error) from error
        finally:
            self._stream.disconnect()

    def _draw_ways(self, way: Floats) -> None:
        """Draw ways (n, C, 3), each broken where nothing is known."""
        colours = drawing.palette(len(self._craft))
        strips, inks = [], []
        for i in range(len(self._craft)):
            known: Bools = np.all(np.isfinite(way[:, i]), axis=1)
            for piece in np.split(np.arange(len(way)), np.flatnonzero(~known)):
                piece = piece[known[piece]]
                if len(piece) > 1:
                    strips.append(way[piece, i])
                    inks.append(colours[i])
        lines = rr.LineStrips3D(strips, colors=inks, radii=-0.5)
        self._stream.log("world/smoothed", lines, static=True)


def _plots(name: str, replay: bool) -> list[Smoothed]:
    """Return the lines in the plots of one craft."""
    if replay:
        return [Smoothed(f"detail/{name}/position_{a}/smoothed", {VALUE: _column(f"smooth_p{a}_m")}) for a in "xyz"]
    out = [
        Smoothed(
            f"detail/{name}/{what}_error/smoothed",
            {VALUE: _column(f"smooth_{what}_error_{unit}", by), SIGMA: _column(f"smooth_{what}_sigma_{unit}", 3 * by)},
        )
        for what, unit, by in (("position", "m", 1e3), ("attitude", "deg", 1.0))
    ]
    return [*out, Smoothed(f"detail/{name}/nees/smoothed", {VALUE: _column("smooth_nees")})]


def _column(name: str, by: float = 1.0) -> Values:
    return lambda rows: by * doubles(rows, name)


def _detail(run: Run) -> Sequence[str]:
    """Return the names of the craft with plots of their own, as the scenario says."""
    text = run.scenario
    table = {} if text is None else parse_toml(text, str(run.folder / SCENARIO)).get("recording")
    detail = table.get("detail") if isinstance(table, dict) else None
    return [str(name) for name in detail] if isinstance(detail, list) else []


def _id(file: Path) -> str:
    """Return the id of a recording. Raises RecordingUnreadable where the file has none."""
    try:
        # rerun warns of a file that a kill has left without its end; the id is at the beginning.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            (store, *_) = RrdReader(str(file)).recordings()
        return str(store.recording_id)
    except (OSError, RuntimeError, ValueError) as error:
        raise RecordingUnreadable(f"cannot read {file}: {error}") from error
