"""Trajectories that serve as truth: motion capture arrays, and TUM and CSV files.

    .npy        (n, 4) or (n, 8): time, x, y, z [m], and a quaternion; NaN where the cameras did not see the body
    TUM         "t x y z qx qy qz qw" per line [s, m], # opens a comment
    CSV         a head with names such as time_us, x, y, z, qw, qx, qy, qz, or EuRoC's "#timestamp [ns], p_RS_R_x [m]";
                without a head the columns are TUM's

The order of a quaternion without names is TUM's, x y z w. A unit of time that is not named is the one of s, ms, us and
ns in which the rows come at 10 Hz to 2000 Hz. Rows whose time does not grow, or with damaged values, are counted and
left out; rows without a position are kept out, too, but are no damage.
"""

import math
import re
import tokenize
from array import array
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from swarm.errors import SwarmError, did_you_mean
from swarm.flight.recordings.line_values import as_rows
from swarm.flight.recordings.text_lines import TextLines
from swarm.user_text import short

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
RATES_HZ = (10.0, 2000.0)
"""Rates of motion capture systems [Hz], by which a unit of time is told."""
NPY = b"\x93NUMPY"
LARGEST_M = 1e5
"""Largest coordinate [m]: more is no room with a lighthouse in it, but damage."""
BYTES_MAX = 1 << 30
"""Size of an array that is read: a day at 300 Hz has 0.8 GB."""
MOST_DAMAGED = 1000
"""Damaged rows beyond twice the good ones at which a file is given up before its end."""
_TUM = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
_TIMES = ("t", "time", "timestamp", "stamp", "times")
_ROTATION = ("qw", "qx", "qy", "qz")
_NO_ARRAY = (
    *(OSError, ValueError, OverflowError, SyntaxError, TypeError, KeyError, IndexError, AttributeError, MemoryError),
    *(EOFError, RecursionError, tokenize.TokenError),
)
"""What NumPy raises for a damaged array: its head is a Python expression."""
_UNIT = re.compile(r"[\[(]\s*([^\])]*)[\])]")


class Trajectory(NamedTuple):
    """N poses of a body in order of time.

    time_s: on the clock of the system that measured them, from its own zero (N,) [s]. unit: of time in the file.
    position: (N, 3) [m]. quaternion: (N, 4) wxyz, NaN where the file has none. unseen: number of rows without a
    position. damaged: number of rows that could not be used. lost: why and where the file ends early.
    """

    path: Path
    time_s: Floats
    unit: str
    position: Floats
    quaternion: Floats
    unseen: int
    damaged: int
    lost: str = ""

    @property
    def rate_hz(self) -> float:
        """Return the rate of the rows [Hz], 0 for fewer than two."""
        return 1 / float(np.median(np.diff(self.time_s))) if len(self.time_s) > 1 else 0.0


def read_trajectory(path: str | Path) -> Trajectory:
    """Read a trajectory.

    Raises:
        SwarmError: the file cannot be read, or has no pose; the message names the file and the mistake.
    """
    file = Path(path)
    try:
        with file.open("rb") as opened:
            head = opened.read(len(NPY))
    except ValueError as error:
        raise SwarmError(f"{str(file)!r}: {error}") from None
    except OSError as error:
        raise SwarmError(f"{file}: {error.strerror or error}") from None
    return _of_array(file) if head == NPY else _of_text(file)


def begins_trajectory(lines: list[str]) -> bool:
    """Return whether the first lines of a text are a trajectory's: comments, then a head or a row of numbers."""
    for line in lines:
        if _is_head(line):
            return True
        if not line.lstrip().startswith("#"):
            return _numbers(line, None, 0) is not None
    return False


def _of_array(file: Path) -> Trajectory:
    try:
        if file.stat().st_size > BYTES_MAX:
            raise SwarmError(f"{file}: larger than {BYTES_MAX >> 30} GB, so no trajectory")
        data = np.load(file, mmap_mode="r", allow_pickle=False)
    except _NO_ARRAY as error:
        reason = short(str(error).splitlines()[0]) if str(error) else "damaged"
        raise SwarmError(f"{file}: not a whole NumPy array: {reason}") from None
    if data.dtype.kind not in "fiu" or data.ndim != 2 or data.shape[1] not in (4, 8):
        raise SwarmError(
            f"{file}: a trajectory is an array of (n, 4) or (n, 8) numbers, "
            f"not {data.shape} of {short(str(data.dtype))}"
        )
    return _trajectory(file, np.asarray(data, dtype=np.float64), "", 0, "")


def _of_text(file: Path) -> Trajectory:
    lines = TextLines(file)
    names: tuple[str, ...] | None = None
    unit, columns, damaged, good = "", 0, 0, 0
    values = array("d")
    for number, line in lines:
        if not good and names is None and _is_head(line):
            names, unit = _head(line, f"{file}, line {number}")
            continue
        if line.lstrip().startswith("#"):
            continue
        row = _numbers(line, names, columns)
        if row is None:
            damaged += 1
            if damaged > MOST_DAMAGED + 2 * good:
                break
            continue
        good, columns = good + 1, len(row)
        values.extend(row)
    if not good:
        raise SwarmError(f"{file}: not a trajectory: no line has a time and a position")
    if damaged > good:
        raise SwarmError(f"{file}: not a trajectory: {damaged} lines are no row of numbers, and {good} are")
    return _trajectory(file, as_rows(values, columns), unit, damaged, lines.lost)


def _is_head(line: str) -> bool:
    """Return whether a line names columns: a time's first, or a position's."""
    names = [_name(word) for word in _words(line.lstrip("# \t"))]
    return len(names) >= 4 and (_time_name(names[0])[0] or {"x", "y", "z"} <= set(names))


def _head(line: str, where: str) -> tuple[tuple[str, ...], str]:
    """Return the columns' names in the common form, and the unit of time."""
    words = _words(line.lstrip("# \t"))
    if not _time_name(_name(words[0]))[0]:
        raise SwarmError(
            f"{where}: the first column is {short(words[0])!r}; it must be the time, such as t, time, timestamp, "
            "time_s, time_ms, time_us or time_ns"
        )
    bracket = _UNIT.search(words[0])
    unit = _time_name(_name(words[0]))[1] or (bracket[1].strip() if bracket else "")
    if unit and unit not in UNITS:
        raise SwarmError(f"{where}: the unit of time {short(unit)!r} is not known{did_you_mean(unit, UNITS)}")
    names = ("t", *(_name(word) for word in words[1:]))
    for needed in ("x", "y", "z"):
        if needed not in names:
            raise SwarmError(f"{where}: no column {needed!r}{did_you_mean(needed, names)}")
    return names, unit


def _words(line: str) -> list[str]:
    """Return the words of a line that are separated by commas, semicolons, or blanks."""
    for mark in ",;\t":
        if mark in line:
            return [word.strip() for word in line.split(mark)]
    return line.split()


def _name(word: str) -> str:
    """Return a column's name in the common form: EuRoC's p_RS_R_x [m] is x, q_RS_w [] is qw, pos_x_m is x."""
    name = _UNIT.sub("", word).strip().lower().strip('"')
    euroc = re.fullmatch(r"([pq])_rs(?:_r)?_([wxyz])", name)
    if euroc:
        return euroc[2] if euroc[1] == "p" else f"q{euroc[2]}"
    plain = re.fullmatch(r"(?:p|pos|position|t)?[_.]?([xyz])(?:_m)?", name)
    if plain:
        return plain[1]
    turned = re.fullmatch(r"(?:q|quat|quaternion|orientation|rot)[_.]?([wxyz])", name)
    return f"q{turned[1]}" if turned else name


def _time_name(name: str) -> tuple[bool, str]:
    """Return whether a name is a time's, and its unit."""
    base, _, unit = name.rpartition("_")
    if base in _TIMES and unit in UNITS:
        return True, unit
    return name in _TIMES, ""


def _numbers(line: str, names: tuple[str, ...] | None, columns: int) -> list[float] | None:
    """Return a row (t, x, y, z) or (t, x, y, z, qx, qy, qz, qw) of a line, None if it is damaged."""
    try:
        values = [float(word) if word else math.nan for word in _words(line.strip())]
    except ValueError:
        return None
    if names is not None:
        if len(values) != len(names):
            return None
        row = dict(zip(names, values, strict=True))
        wanted = _TUM if all(name in row for name in _ROTATION) else _TUM[:4]
        return [row[name] for name in wanted]
    if len(values) not in (4, 8) or columns not in (0, len(values)):
        return None
    return values


def _trajectory(file: Path, table: Floats, unit: str, damaged: int, lost: str) -> Trajectory:
    """Return the usable rows of a table (n, 4) or (n, 8)."""
    if not len(table):
        raise SwarmError(f"{file}: a trajectory without a row")
    timed = np.isfinite(table[:, 0])
    seen = timed & np.isfinite(table[:, 1:4]).all(axis=1)
    with np.errstate(invalid="ignore"):
        near = np.abs(table[:, 1:4]).max(axis=1) < LARGEST_M
    unseen = int(np.count_nonzero(timed & np.isnan(table[:, 1:4]).any(axis=1)))
    grows = _growing(table[:, 0], timed)
    used = seen & near & grows
    unit = unit or _unit(table[grows, 0])
    if not np.any(used):
        raise SwarmError(f"{file}: none of {len(table)} rows has a time that grows and a position")
    quaternion = np.full((int(np.count_nonzero(used)), 4), np.nan)
    if table.shape[1] == 8:
        quaternion = table[used][:, [7, 4, 5, 6]]
        with np.errstate(all="ignore"):
            length = np.linalg.norm(quaternion, axis=1, keepdims=True)
            quaternion = np.where(np.abs(length - 1) < 1e-2, quaternion / length, np.nan)
    damaged += len(table) - int(np.count_nonzero(used)) - unseen
    return Trajectory(file, table[used, 0] * UNITS[unit], unit, table[used, 1:4], quaternion, unseen, damaged, lost)


def _growing(time: Floats, timed: Bools) -> Bools:
    """Return which rows come later than all rows before them, a single time far ahead of its neighbours left aside."""
    value = np.where(timed, time, -np.inf)
    if len(value) > 2:
        ahead = (value[1:-1] >= value[2:]) & (value[:-2] < value[2:])
        timed = timed & ~np.concatenate([[False], ahead, [False]])
        value = np.where(timed, time, -np.inf)
    before = np.concatenate([[-np.inf], np.maximum.accumulate(value)[:-1]])
    out: Bools = timed & (value > before)
    return out


def _unit(time: Floats) -> str:
    """Return the unit in which rows come at a motion capture system's rate; seconds where none fits."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    for unit, size in UNITS.items():
        if step > 0 and RATES_HZ[0] <= 1 / (step * size) <= RATES_HZ[1]:
            return unit
    return "s"
