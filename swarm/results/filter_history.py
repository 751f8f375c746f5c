"""filter.history/: what the filters predicted and believed in every period, for the smoother; a folder of Arrow files.

One row per craft and lighthouse period, in the order of the telemetry, which has the filters' estimates themselves:

    continued                      whether the estimate goes on from the one a period ago
    predicted_*                    the state before the period's measurements
    transition            (144,)   F from the period before, row by row
    predicted_covariance   (78,)   the lower triangle of P-, row by row
    covariance             (78,)   the lower triangle of P, after the measurements

and where filters run L = 4 models of motion (`estimators.filter.smoother.Models`)

    model_probability       (4,)   after the measurements
    model_mean             (48,)   of the predicted errors, model by model
    model_root            (312,)   the lower triangles of the Cholesky roots of P-, model by model, in single precision
    model_sigma             (8,)   process noises [m/s^2], [rad/s^2], model by model
    model_noise            (78,)   the lower triangle of the process noise of a unit of both
    model_mixed            (16,)   shares in which the models were made of those before the prediction, row by row
    model_moved            (16,)   likewise since the prediction
    model_last_mean        (48,)   of the errors after the measurements; where the next period does not go on from this
    model_last_root       (312,)   one, and in the last period of a file, else null; as model_root

Rows of filters that were not active are null, and so is predicted_covariance where there are models. The files are
written one after the other, and never again: however a run ends, what is there can be read, and a smoother takes them
from the last one back without having all in memory.
"""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.smoother import Models, Prediction
from estimators.lanes import LANES
from estimators.rotation import matrix_from_quaternion, quaternion_from_matrix
from estimators.state import STATES, State
from swarm.errors import SwarmError
from swarm.results.disk import replacing, writing
from swarm.results.files import HISTORY
from swarm.results.period import Period

MOST_ROWS = 100_000
"""A run of more rows keeps its history only if it is asked to: some 3 kB per row."""
ROWS, PERIODS = 16_384, 120
"""Rows, and periods, in a file: 40 MB in memory at most, and no more is lost by a run that is killed."""
LOWER = np.tril_indices(STATES)
_TRIANGLE = len(LOWER[0])
_OPTIONS = pa.ipc.IpcWriteOptions(compression="lz4")
_STATE = (
    *(f"predicted_q{a}" for a in "wxyz"),
    *(f"predicted_p{a}_m" for a in "xyz"),
    *(f"predicted_v{a}_m_s" for a in "xyz"),
    *(f"predicted_w{a}_rad_s" for a in "xyz"),
)
_LISTS = {"transition": STATES * STATES, "predicted_covariance": _TRIANGLE, "covariance": _TRIANGLE}
SCHEMA = pa.schema(
    [
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("continued", pa.bool_(), nullable=False),
        *(pa.field(name, pa.float64()) for name in _STATE),
        *(pa.field(name, pa.list_(pa.float64(), size)) for name, size in _LISTS.items()),
    ]
)


_MODELS = {
    "model_probability": LANES,
    "model_mean": LANES * STATES,
    "model_root": LANES * _TRIANGLE,
    "model_sigma": LANES * 2,
    "model_noise": _TRIANGLE,
    "model_mixed": LANES * LANES,
    "model_moved": LANES * LANES,
    "model_last_mean": LANES * STATES,
    "model_last_root": LANES * _TRIANGLE,
}
_LANE, _SQUARE = (LANES, STATES), (LANES, LANES)
_SHAPES = ((LANES,), _LANE, (LANES, _TRIANGLE), (LANES, 2), (_TRIANGLE,), _SQUARE, _SQUARE, _LANE, (LANES, _TRIANGLE))
_ROOTS = ("model_root", "model_last_root")
WITH_MODELS = pa.schema(
    [
        *SCHEMA,
        *(
            pa.field(name, pa.list_(pa.float32() if name in _ROOTS else pa.float64(), size))
            for name, size in _MODELS.items()
        ),
    ]
)


class Block(NamedTuple):
    """The history of some successive periods of C craft.

    frame: numbers of the n periods, (n,). prediction: arrays (n, C, ...). covariance: after the measurements,
    (n, C, 12, 12).
    """

    frame: Ints
    prediction: Prediction
    covariance: Floats


def keeps_history(wanted: bool | None, rows: int) -> bool:
    """Return whether a run keeps the history of its filters.

    wanted: the scenario's recording.filter. rows: rows of telemetry that the run will have.
    """
    return rows <= MOST_ROWS if wanted is None else wanted


class HistoryWriter:
    """Writes the history of one run into its folder: `append` every period, `close` at the end."""

    def __init__(self, folder: Path, craft_count: int) -> None:
        """Make the folder. Raises SwarmError where it cannot be written."""
        self._folder, self._craft_count = folder / HISTORY, craft_count
        self._periods = max(1, min(PERIODS, ROWS // max(1, craft_count)))
        self._waiting: list[tuple[int, Prediction, Floats]] = []
        self._parts = 0
        with writing(self._folder):
            self._folder.mkdir()

    def append(self, period: Period) -> None:
        """Take one period of all craft. Raises SwarmError on a full disk."""
        estimate = period.estimate
        if estimate.prediction is None:
            raise ValueError("the estimate has no prediction: the navigation was built without history")
        self._waiting.append((period.frame, estimate.prediction, np.array(estimate.covariance)))
        if len(self._waiting) == self._periods:
            self._flush()

    def _flush(self) -> None:
        if not self._waiting:
            return
        frames, predictions, covariances = zip(*self._waiting, strict=True)
        table = _table(np.array(frames), predictions, np.concatenate(covariances), self._craft_count)
        _write_part(self._folder, self._parts, table)
        self._parts += 1
        self._waiting.clear()

    def close(self) -> None:
        """Write what is left. Raises SwarmError on a full disk."""
        self._flush()


def _table(frame: Ints, predictions: tuple[Prediction, ...], covariance: Floats, craft_count: int) -> pa.Table:
    state = State(*(np.concatenate(parts) for parts in zip(*(p.state for p in predictions), strict=True)))
    continued = np.concatenate([p.continued for p in predictions])
    models = _models_in(predictions)
    wide = np.concatenate([p.covariance for p in predictions])[:, LOWER[0], LOWER[1]]
    if models:
        wide[np.isfinite(models[0][:, 0])] = np.nan
    columns = np.concatenate(
        [quaternion_from_matrix(state.rotation), state.position, state.velocity, state.angular_rate], axis=1
    )
    lists = (
        np.concatenate([p.transition for p in predictions]).reshape(len(continued), -1),
        wide,
        covariance[:, LOWER[0], LOWER[1]],
        *models,
    )
    arrays = [
        pa.array(np.repeat(frame, craft_count), pa.int32()),
        pa.array(continued),
        *(pa.array(column, from_pandas=True) for column in columns.T),
        *(
            pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1], mask=_unknown(values))
            for values in lists
        ),
    ]
    return pa.Table.from_arrays(arrays, schema=WITH_MODELS if models else SCHEMA)


def _models_in(predictions: tuple[Prediction, ...]) -> list[Floats]:
    """Return the columns of the models of motion, (n, size) each; none of filters with one model."""
    found = [p.models for p in predictions if p.models is not None]
    if not found:
        return []
    ends = np.concatenate([*(~_goes_on(p) for p in predictions[1:]), np.ones_like(predictions[-1].continued)])
    out = []
    for name, parts in zip(_MODELS, zip(*found, strict=True), strict=True):
        values = np.concatenate(parts)
        if name.startswith("model_last"):
            values = np.where(ends.reshape(-1, *[1] * (values.ndim - 1)), values, np.nan)
        if name in _ROOTS:
            values = _roots(values)
        elif name == "model_noise":
            values = values[..., LOWER[0], LOWER[1]]
        out.append(values.reshape(len(values), -1))
    return out


def _goes_on(prediction: Prediction) -> Bools:
    """Return whether the models of the craft (C,) go on from those of the period before."""
    models = prediction.models
    if models is None:
        return prediction.continued
    goes_on: Bools = np.any(models.moved, axis=(1, 2))
    return prediction.continued & goes_on


def _roots(covariance: Floats) -> NDArray[np.float32]:
    """Return the lower triangles (n, L, 78) of the roots of covariances (n, L, 12, 12), NaN where they have none."""
    out = np.full((*covariance.shape[:2], _TRIANGLE), np.nan, dtype=np.float32)
    there = np.isfinite(covariance[:, 0, 0, 0])
    try:
        out[there] = np.linalg.cholesky(covariance[there])[..., LOWER[0], LOWER[1]]
    except np.linalg.LinAlgError:  # one of many: the others are kept
        for i in np.flatnonzero(there).tolist():
            with suppress(np.linalg.LinAlgError):
                out[i] = np.linalg.cholesky(covariance[i])[..., LOWER[0], LOWER[1]]
    return out


def _unknown(values: Floats) -> pa.Array:
    return pa.array(~np.isfinite(values[:, 0]))


class History:
    """The history in a run's folder. `blocks` yields it from the last period back, a part at a time."""

    def __init__(self, folder: Path, craft_count: int) -> None:
        self._craft_count = craft_count
        self.parts = _parts_in(folder / HISTORY)

    def __bool__(self) -> bool:
        return bool(self.parts)

    def blocks(self) -> Iterator[tuple[int, Block]]:
        """Yield the number of each part and its block, the last one first. Raises SwarmError where one is damaged."""
        for number in reversed(range(len(self.parts))):
            part = self.parts[number]
            try:
                with pa.OSFile(str(part), "rb") as file:
                    table = pa.ipc.open_file(file).read_all()
                block = _block(table, self._craft_count)
            except (OSError, KeyError, ValueError, pa.ArrowException) as error:
                raise SwarmError(f"cannot read {part}: {error}") from error
            yield number, block


def _block(table: pa.Table, craft_count: int) -> Block:
    if len(table) % craft_count:
        raise ValueError(f"{len(table)} rows are not those of {craft_count} craft")
    shape = (len(table) // craft_count, craft_count)
    values = np.stack([table.column(name).to_numpy() for name in _STATE], axis=1).reshape(*shape, len(_STATE))
    rotation = matrix_from_quaternion(values[..., :4])
    state = State(rotation, values[..., 4:7], values[..., 7:10], values[..., 10:13])
    transition, *triangles = (_lists(table, name).reshape(*shape, size) for name, size in _LISTS.items())
    predicted, covariance = (_full(values) for values in triangles)
    continued = table.column("continued").to_numpy().reshape(shape)
    prediction = Prediction(continued, state, predicted, transition.reshape(*shape, STATES, STATES))
    if set(_MODELS) <= set(table.column_names):
        probability, mean, root, sigma, noise, mixed, moved, last_mean, last_root = (
            _lists(table, name).reshape(*shape, *of) for name, of in zip(_MODELS, _SHAPES, strict=True)
        )
        models = Models(
            probability, mean, _squared(root), sigma, _full(noise), mixed, moved, last_mean, _squared(last_root)
        )
        prediction = prediction._replace(models=models)
    return Block(table.column("frame").to_numpy().reshape(shape)[:, 0].astype(np.int64), prediction, covariance)


def _lists(table: pa.Table, name: str) -> Floats:
    """Return a column of lists as (rows, size), NaN where null."""
    column = table.column(name).combine_chunks()
    size = column.type.list_size
    out: Floats = np.array(column.values.to_numpy(zero_copy_only=False), dtype=np.float64).reshape(-1, size)
    out[column.is_null().to_numpy(zero_copy_only=False)] = np.nan
    return out


def _squared(root: Floats) -> Floats:
    """Return the covariances (..., 12, 12) of the lower triangles (..., 78) of roots."""
    lower = np.zeros((*root.shape[:-1], STATES, STATES))
    lower[..., LOWER[0], LOWER[1]] = root
    out: Floats = lower @ np.swapaxes(lower, -1, -2)
    return out


def _full(lower: Floats) -> Floats:
    """Return the symmetric matrices (..., 12, 12) of lower triangles (..., 78)."""
    out = np.empty((*lower.shape[:-1], STATES, STATES))
    out[..., LOWER[0], LOWER[1]] = lower
    out[..., LOWER[1], LOWER[0]] = lower
    return out


def _parts_in(folder: Path) -> list[Path]:
    """Return the parts in a folder, in order."""
    return sorted(folder.glob("part-*.arrow"))


def _write_part(folder: Path, number: int, table: pa.Table) -> None:
    """Write a part into a folder, under another name first, so that whatever is there is whole.

    Args:
        folder: The folder.
        number: Place of the part among all.
        table: Its rows.

    Raises:
        SwarmError: The disk is full.
    """
    part = folder / f"part-{number:05d}.arrow"
    with (
        replacing(part, part.with_suffix(".tmp")) as temporary,
        pa.OSFile(str(temporary), "wb") as file,
        pa.ipc.new_file(file, table.schema, options=_OPTIONS) as writer,
    ):
        writer.write_table(table)
