"""Smoothing of a run that was flown or replayed: from filter.history to smooth.parquet, summary and recording.

The parts of the history are read from the last one back, and each becomes a part of smooth.parquet: memory holds one
part of each, whatever the length of the run. The rows are those of the telemetry, which has the filters' estimates and
the truth. A run that was killed is smoothed as far as it was written.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from estimators.arrays import Floats, Ints
from estimators.filter.smoother import Estimates, Models, Prediction, Smoother
from estimators.rotation import matrix_from_quaternion
from estimators.state import STATES, State
from swarm.errors import SwarmError
from swarm.results.columns.column import fill_pose
from swarm.results.columns.smooth import COLUMNS
from swarm.results.disk import FolderLock, write_text, writing
from swarm.results.files import HISTORY, RECORDING, SMOOTH, SMOOTH_RECORDING, SUMMARY
from swarm.results.filter_history import Block, History
from swarm.results.owned_folder import find
from swarm.results.parquet import PARTIAL, GrowingParquet
from swarm.results.reading import RowReader, flown_columns
from swarm.results.rows import estimate_errors_into, quaternions_into
from swarm.results.run_folder import CONTENTS, Run, open_run
from swarm.results.summary import summarise_run
from swarm.results.table import TelemetryTable, doubles

if TYPE_CHECKING:
    from swarm.results.recording.smoothed import SmoothedRecording

WHO = ("time_s", "frame", "craft")
_TRUE = (*(f"true_p{a}_m" for a in "xyz"), *(f"true_q{a}" for a in "wxyz"))
_STATE = (
    *(f"ekf_q{a}" for a in "wxyz"),
    *(f"ekf_p{a}_m" for a in "xyz"),
    *(f"ekf_v{a}_m_s" for a in "xyz"),
    *(f"ekf_w{a}_rad_s" for a in "xyz"),
)
KILLED = "the program was killed"


def smooth(run: Run | str | Path, *, force: bool = False, progress: Callable[[float], None] | None = None) -> Run:
    """Smooth what the filters of a run have estimated, with all that they learned later.

    The run's telemetry gets the columns `smooth_*`, its summary their figures, and its recording their lines.

    Args:
        run: run, or its folder, as of `open_run`.
        force: replace what an earlier call has found.
        progress: function called with the share that is done.

    Returns:
        The run, opened again.

    Raises:
        SwarmError: there is no such run, it has no history of its filters, no estimate or another one's result, it is
            being written, or nothing can be written.
    """
    folder, _ = find(run.folder if isinstance(run, Run) else run, CONTENTS)
    lock = FolderLock(folder, "it is being written by another program; wait until it has ended")
    try:
        _, marker = find(folder, CONTENTS)
        craft = _check(folder, force)
        _write(folder, craft, progress or _untold)
        _rewrite_summary(folder, marker)
    finally:
        lock.release()
    return open_run(folder)


def refuse_unsmoothable(run: str | Path, force: bool) -> None:
    """Raise SwarmError, as `smooth`, where a run cannot be smoothed, before the work begins."""
    _check(find(run, CONTENTS)[0], force)


def _untold(share: float) -> None:
    """Ignore the progress."""


def _check(folder: Path, force: bool) -> list[str]:
    """Return the names of the craft of a run that can be smoothed. Raises SwarmError for any other."""
    if (folder / SMOOTH).exists() and not force:
        raise SwarmError(f"{folder} is smoothed already; --force (force=True) does it again")
    # What an earlier call has found may be damaged, and is going to be replaced.
    rows = TelemetryTable.of_flight(folder)
    if not len(rows):
        raise SwarmError(f"{folder} has no rows of telemetry, so there is nothing to smooth")
    names = rows.names_of("craft")
    if set(rows.without_sensors) >= set(names):
        raise SwarmError(f"no craft of {folder} navigates, so there is nothing to smooth")
    if not np.isfinite(rows.column("ekf_px_m")).any():
        raise SwarmError(f"no craft of {folder} ever had an estimate, so there is nothing to smooth")
    if not History(folder, len(names)):
        raise SwarmError(f"{folder} has no {HISTORY}: fly or replay it again with --set recording.filter=true")
    return list(names)


def _write(folder: Path, craft: list[str], tell: Callable[[float], None]) -> None:
    """Write smooth.parquet, and smooth.rrd beside a recording."""
    drawn = folder / (SMOOTH_RECORDING + ".tmp")
    _prepare(folder)
    try:
        schema = _schema(folder)
        file, drawer = GrowingParquet(folder / SMOOTH, schema), _drawer(folder, craft, drawn)
        for number, share, rows in _smoothed(folder, len(craft), schema):
            file.write(rows, number)
            if drawer is not None:
                drawer.send(rows)
            tell(share)
        if drawer is not None:
            drawer.close()
        file.close()
        with writing(folder / SMOOTH_RECORDING):
            (folder / SMOOTH_RECORDING).unlink(missing_ok=True)
            if drawer is not None:
                drawn.replace(folder / SMOOTH_RECORDING)
    except BaseException:
        with suppress(SwarmError):
            _prepare(folder)
        drawn.unlink(missing_ok=True)
        raise


def _prepare(folder: Path) -> None:
    """Take away the parts of a smoother that was stopped. Raises SwarmError where nothing can be written."""
    parts = folder / (SMOOTH + PARTIAL)
    try:
        parts.mkdir(exist_ok=True)
        for part in [part for pattern in CONTENTS.folders[parts.name] for part in parts.glob(pattern)]:
            part.unlink()
        parts.rmdir()
    except OSError as error:
        raise SwarmError(
            f"cannot write in {folder}: {str(error.strerror).lower()}; copy the run to where you may write, and smooth "
            "it there"
        ) from error


def _drawer(folder: Path, craft: list[str], file: Path) -> "SmoothedRecording | None":
    """Return the drawer of the smoothed recording, for a run with a recording that can be read."""
    if not (folder / RECORDING).exists():
        return None
    # rerun takes most of a second to import: only who records pays for it.
    from swarm.results.recording.smoothed import RecordingUnreadable, SmoothedRecording

    try:
        return SmoothedRecording(file, open_run(folder), craft, "peer_px_m" in flown_columns(folder))
    except RecordingUnreadable:
        # A kill may have torn it; the estimates can be smoothed all the same.
        return None


def _schema(folder: Path) -> pa.Schema:
    who = RowReader(folder, WHO).rows(0, 1).schema
    return pa.schema([*(who.field(name) for name in WHO), *(column.field for column in COLUMNS)])


def _smoothed(folder: Path, craft_count: int, schema: pa.Schema) -> Iterator[tuple[int, float, pa.Table]]:
    """Yield the number of each part, the share that is done with it, and its rows; the last one first.

    schema: that of the rows.
    """
    history, rows = History(folder, craft_count), RowReader(folder, (*WHO, *_TRUE, *_STATE))
    smoother, flown, parts, later = Smoother(craft_count), len(rows) // craft_count, len(history.parts), None
    for number, block in history.blocks():
        begin, past = int(block.frame[0]), int(block.frame[-1]) + 1
        if later not in (None, past) or (number == 0 and begin != 0):
            raise SwarmError(f"{folder / HISTORY}: periods before or after {begin} to {past - 1} are missing")
        later = begin
        if number == parts - 1 and past < flown:
            # A kill between two writes: of these periods there is no history.
            yield parts, 0.0, _unknown(rows.rows(past * craft_count, flown * craft_count), schema)
        if begin >= flown:
            continue
        table = rows.rows(begin * craft_count, min(past, flown) * craft_count)
        _check_rows(folder, table, block.frame, craft_count)
        try:
            estimates = _smooth_block(smoother, table, block, craft_count)
        except ValueError as error:
            raise SwarmError(f"{folder / HISTORY} does not fit the telemetry, or is damaged: {error}") from error
        yield number, (parts - number) / parts, _table(table, estimates, schema)


def _check_rows(folder: Path, table: pa.Table, frame: Ints, craft_count: int) -> None:
    there = table.column("frame").to_numpy().reshape(-1, craft_count)
    if np.any(there != frame[: len(there), None]):
        raise SwarmError(f"the telemetry in {folder} has not the rows of its {HISTORY}: one of them was changed")


def _smooth_block(smoother: Smoother, table: pa.Table, block: Block, craft_count: int) -> Estimates:
    """Return the smoothed estimates (n, C, ...) of the rows of a block."""
    filtered = np.stack([doubles(table, name) for name in _STATE], axis=1).reshape(-1, craft_count, len(_STATE))
    periods = len(filtered)
    rotation = matrix_from_quaternion(filtered[..., :4])
    covariance, ahead = block.covariance, block.prediction
    out = [
        smoother.step(
            Estimates(State(rotation[k], *_vectors(filtered[k])), covariance[k]),
            _of_period(ahead, k),
        )
        for k in reversed(range(periods))
    ]
    out.reverse()
    states = State(*(np.stack(parts) for parts in zip(*(one.state for one in out), strict=True)))
    return Estimates(states, np.stack([one.covariance for one in out]))


def _of_period(ahead: Prediction, k: int) -> Prediction:
    """Return the predictions of one period of a block."""
    state = State(*(part[k] for part in ahead.state))
    models = None if ahead.models is None else Models(*(part[k] for part in ahead.models))
    return Prediction(ahead.continued[k], state, ahead.covariance[k], ahead.transition[k], models)


def _vectors(row: Floats) -> tuple[Floats, Floats, Floats]:
    """Return position, velocity and angular rate (C, 3)."""
    p, v, w = (np.ascontiguousarray(row[:, first : first + 3]) for first in (4, 7, 10))
    return p, v, w


def _table(flown: pa.Table, estimates: Estimates, schema: pa.Schema) -> pa.Table:
    state, rows = estimates.state, len(flown)
    quaternion, values = np.empty((rows, 4)), np.empty((len(COLUMNS), rows))
    quaternions_into(state.rotation.reshape(rows, 3, 3), quaternion)
    position = state.position.reshape(rows, 3)
    fill_pose(position, quaternion, values[:7])
    values[7:10], values[10:13] = state.velocity.reshape(rows, 3).T, state.angular_rate.reshape(rows, 3).T
    truth = np.stack([doubles(flown, name) for name in _TRUE], axis=1)
    true_position, true_quaternion = np.ascontiguousarray(truth[:, :3]), np.ascontiguousarray(truth[:, 3:])
    covariance = estimates.covariance.reshape(rows, STATES, STATES)
    estimate_errors_into(true_position, true_quaternion, position, quaternion, covariance, values[13:])
    return _rows(flown, values, schema)


def _unknown(flown: pa.Table, schema: pa.Schema) -> pa.Table:
    return _rows(flown, np.full((len(COLUMNS), len(flown)), np.nan), schema)


def _rows(flown: pa.Table, values: Floats, schema: pa.Schema) -> pa.Table:
    arrays = [column.array(np.ascontiguousarray(value)) for column, value in zip(COLUMNS, values, strict=True)]
    who = [flown.column(name).unify_dictionaries().combine_chunks() for name in WHO]
    return pa.Table.from_arrays([*who, *arrays], schema=schema)


def _rewrite_summary(folder: Path, marker: Mapping[str, Any]) -> None:
    """Write the summary again, with the figures of the smoother; what a killed run is worth is known now."""
    head = dict(marker)
    if head.get("status") == "running":
        head |= {"status": "interrupted", "reason": KILLED}
    text = json.dumps({**head, **summarise_run(folder)}, indent=2, allow_nan=False)
    write_text(folder / SUMMARY, text + "\n")
