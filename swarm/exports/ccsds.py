"""CCSDS messages of a trajectory: an OEM (orbit ephemeris, 502.0-B-2) and an AEM (attitude ephemeris, 504.0-B-1).

Both are in keyword-value notation. In an orbit the reference frame is LVLH_ROTATING of the SANA registry, centred on
the lighthouse: z to the nadir, y against the orbit's angular momentum, x completes them, along the flight (W. Fehse's
V-bar, H-bar, R-bar). Without an orbit it is LIGHTHOUSE, the program's own frame, which does not turn. Positions and
velocities are relative to that frame, in km and km/s. The quaternion takes frame A (the reference frame) to frame B
(the body): the body's axes are those of A turned by it, q = (e sin(a/2), cos(a/2)), the scalar last.

A gap begins a new segment, so that nobody interpolates over it.
"""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.relative_orbit import RelativeOrbit
from estimators.rotation import matrix_from_quaternion, quaternion_from_matrix, xyzw_from_wxyz
from swarm.errors import SwarmError
from swarm.exports.trajectory import MEANINGS, Trajectory

ORIGINATOR, CENTRE = "LIGHTHOUSE-SWARM", "LIGHTHOUSE"
ORBIT_FRAME, OWN_FRAME = "LVLH_ROTATING", "LIGHTHOUSE"
NANOSECONDS = 1_000_000_000
KM_PER_M = 1e-3


class TimeSystem(StrEnum):
    """A time system of CCSDS messages."""

    UTC = "UTC"
    TAI = "TAI"
    GPS = "GPS"
    TT = "TT"


class Epoch(NamedTuple):
    """The date at which the run starts, in a time system, and the nanoseconds beyond its full second."""

    date: datetime
    nanoseconds: int
    system: TimeSystem

    def after(self, time_s: float) -> str:
        """Return the date so long after the start, as CCSDS writes it, to the nanosecond."""
        whole, rest = divmod(self.nanoseconds + round(time_s * NANOSECONDS), NANOSECONDS)
        return f"{self.date + timedelta(seconds=whole):%Y-%m-%dT%H:%M:%S}.{rest:09d}"

    def unix_ns(self, time_s: float) -> int:
        """Return the nanoseconds since 1970 so long after the start, counted as POSIX does in UTC."""
        seconds = int(self.date.replace(tzinfo=UTC).timestamp())
        return seconds * NANOSECONDS + self.nanoseconds + round(time_s * NANOSECONDS)


def epoch(text: str, system: TimeSystem = TimeSystem.UTC) -> Epoch:
    """Return an epoch from ISO 8601 text such as 2027-03-01T12:00:00 or 2027-03-01T12:00:00.5Z.

    Args:
        text: The date and time; a Z is allowed in UTC only.
        system: Its time system.

    Raises:
        SwarmError: The text is no such date.
    """
    said = text.strip()
    if said.endswith("Z") and system is not TimeSystem.UTC:
        raise SwarmError(f"--epoch: {text!r} ends in Z, which means UTC, and the time system is {system}")
    whole, _, fraction = said.removesuffix("Z").partition(".")
    try:
        date = datetime.fromisoformat(whole)
        if date.tzinfo is not None or len(whole) < len("2027-03-01T00:00") or (fraction and not fraction.isdecimal()):
            raise ValueError
    except ValueError:
        raise SwarmError(
            f"--epoch: {text!r} is no date and time such as 2027-03-01T12:00:00 (without an offset)"
        ) from None
    return Epoch(date, int(f"{fraction:0<9}"[:9]), system)


def oem(trajectory: Trajectory, start: Epoch, orbit: RelativeOrbit | None) -> Iterator[str]:
    """Yield the lines of an OEM.

    Args:
        trajectory: The poses, with velocities.
        start: The date of the run's start.
        orbit: The orbit of the station, or None.

    """
    assert trajectory.velocity is not None
    yield from _head("OEM", "2.0", trajectory, orbit)
    for part in trajectory.part(np.flatnonzero(np.isfinite(trajectory.velocity).all(axis=1))).stretches():
        more = {"REF_FRAME": ORBIT_FRAME if orbit else OWN_FRAME}
        yield from _metadata(part, start, more, {})
        assert part.velocity is not None
        place, speed = (KM_PER_M * _turned(vectors, orbit) for vectors in (part.position, part.velocity))
        for time_s, row in zip(part.time_s.tolist(), np.concatenate([place, speed], axis=1).tolist(), strict=True):
            yield f"{start.after(time_s)} {_numbers(row)}"
        yield ""


def aem(trajectory: Trajectory, start: Epoch, orbit: RelativeOrbit | None) -> Iterator[str]:
    """Yield the lines of an AEM.

    Args:
        trajectory: The poses.
        start: The date of the run's start.
        orbit: The orbit of the station, or None.
    """
    yield from _head("AEM", "1.0", trajectory, orbit)
    frames = {"REF_FRAME_A": ORBIT_FRAME if orbit else OWN_FRAME, "REF_FRAME_B": "SC_BODY_1", "ATTITUDE_DIR": "A2B"}
    for part in trajectory.stretches():
        yield from _metadata(part, start, frames, {"ATTITUDE_TYPE": "QUATERNION", "QUATERNION_TYPE": "LAST"})
        yield "DATA_START"
        quaternion = _continuous(_attitudes(part.quaternion, orbit))
        for time_s, row in zip(part.time_s.tolist(), xyzw_from_wxyz(quaternion).tolist(), strict=True):
            yield f"{start.after(time_s)} {_numbers(row)}"
        yield "DATA_STOP"
        yield ""


def _head(kind: str, version: str, trajectory: Trajectory, orbit: RelativeOrbit | None) -> Iterator[str]:
    yield f"CCSDS_{kind}_VERS = {version}"
    yield f"COMMENT {trajectory.craft}: {MEANINGS[trajectory.source]}"
    if orbit:
        yield "COMMENT LVLH_ROTATING is that of the lighthouse: x along V-bar, y along H-bar, z along R-bar (nadir)"
    else:
        yield "COMMENT Frame LIGHTHOUSE does not turn; a lighthouse at its origin looks along z, x right, y down"
    yield f"CREATION_DATE = {datetime.now(UTC):%Y-%m-%dT%H:%M:%S}"
    yield f"ORIGINATOR = {ORIGINATOR}"
    yield ""


def _metadata(part: Trajectory, start: Epoch, frames: dict[str, str], more: dict[str, str]) -> Iterator[str]:
    yield "META_START"
    said = {
        "OBJECT_NAME": part.craft,
        "OBJECT_ID": part.craft,
        "CENTER_NAME": CENTRE,
        **frames,
        "TIME_SYSTEM": start.system,
        "START_TIME": start.after(float(part.time_s[0])),
        "STOP_TIME": start.after(float(part.time_s[-1])),
        **more,
    }
    yield from (f"{key} = {value}" for key, value in said.items())
    yield "META_STOP"


def _turned(vectors: Floats, orbit: RelativeOrbit | None) -> Floats:
    """Return vectors (n, 3) of the lighthouse frame in the reference frame."""
    return vectors if orbit is None else vectors @ orbit.axes.T


def _attitudes(quaternion: Floats, orbit: RelativeOrbit | None) -> Floats:
    """Return attitudes (n, 4), wxyz, against the lighthouse frame as those against the reference frame."""
    return quaternion if orbit is None else quaternion_from_matrix(orbit.axes @ matrix_from_quaternion(quaternion))


def _continuous(quaternion: Floats) -> Floats:
    """Return the same attitudes (n, 4) without jumps of sign, over which a reader would interpolate."""
    steps = np.sum(quaternion[1:] * quaternion[:-1], axis=1)
    sign = np.cumprod(np.concatenate([[1.0], np.where(steps < 0, -1.0, 1.0)]))
    out: Floats = sign[:, None] * quaternion
    return out


def _numbers(row: Sequence[float]) -> str:
    return " ".join(f"{value:.16e}" for value in row)
