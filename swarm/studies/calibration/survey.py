"""The observations of a survey: angles and poses of a run that wrote them, or of a recording of a real station."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from swarm.flight.recordings.contents import only_object
from swarm.flight.recordings.formats import Format, recording_format
from swarm.flight.recordings.libsurvive import read_libsurvive
from swarm.flight.replay import Playback
from swarm.results.angles import Believed, read_angles
from swarm.results.run_folder import open_run
from swarm.results.table import TelemetryTable
from swarm.scenario import for_replay


class Observations(NamedTuple):
    """The observations of a survey's craft, N rows, one per period and craft.

    source: its name. time_s, period, craft: (N,). theta, offset_s: (N, K, 2), NaN where not seen. own: each craft's own
    poses, R_l_b (N, 3, 3) and position (N, 3) [m], NaN where it had none. truth: the true ones, and true_rates: angular
    rate (N, 3) [rad/s] and velocity (N, 3) [m/s]; None where there is no truth.
    """

    source: str
    believed: Believed
    time_s: Floats
    period: Ints
    craft: Ints
    theta: Floats
    offset_s: Floats
    own: tuple[Floats, Floats]
    truth: tuple[Floats, Floats] | None = None
    true_rates: tuple[Floats, Floats] | None = None


def observe_run(folder: str | Path) -> Observations:
    """Return the survey in a run's folder. Raises SwarmError where it is no run, or one without angles."""
    run = open_run(folder)
    angles = read_angles(run.folder)
    rows = TelemetryTable.of_run(run.folder)
    craft, frames = len(angles.believed.craft), len(rows) // max(len(angles.believed.craft), 1)
    frame = rows.frame
    first = int(frame[0]) if len(frame) else 0
    # A run that was stopped may have angles of a period whose telemetry it has not, or the other way round.
    row = (angles.frame - first) * craft + angles.craft
    inside = (row >= 0) & (row < frames * craft)
    most = max((len(p) for p in angles.believed.point_m), default=0)
    theta, offset = np.full((2, frames * craft, most, 2), np.nan)
    theta[row[inside], angles.photodiode[inside]] = angles.theta[inside]
    offset[row[inside], angles.photodiode[inside]] = angles.offset_s[inside]

    def pose(prefix: str) -> tuple[Floats, Floats]:
        return rot.matrix_from_quaternion(rows.quaternion(prefix)), rows.position(prefix)

    true = pose("true")
    known = len(rows) > 0 and bool(np.isfinite(true[1]).all())
    rates = rows.stacked(*(f"true_w{a}_rad_s" for a in "xyz")), rows.stacked(*(f"true_v{a}_m_s" for a in "xyz"))
    return Observations(
        source=str(folder),
        believed=angles.believed,
        time_s=rows.column("time_s"),
        period=frame,
        craft=np.tile(np.arange(craft), frames),
        theta=theta,
        offset_s=offset,
        own=pose("pnp"),
        truth=true if known else None,
        true_rates=rates if known else None,
    )


def observe_recording(
    recording: str | Path, object_name: str | None, lighthouse: int, start: str | Path | None = None
) -> Observations:
    """Return what an object of a libsurvive recording saw of a station.

    Args:
        recording: File of the recording.
        object_name: The tracked object; None: the only one.
        lighthouse: Number of the station.
        start: Calibration file with what is believed of both.

    Raises:
        SwarmError: The file cannot be read, or has no such object or station.
    """
    # A photodiode that is not where it is believed to be is what a calibration is for: none is left out.
    settings = for_replay(Path(recording), ["navigation.integrity.residual_test=false"])
    recording_format(recording, Format.CRAZYFLIE)
    log = read_libsurvive(recording, object_name or only_object(recording))
    playback = Playback(log, settings, lighthouse, start)
    times, theta, offset, rotation, position = [], [], [], [], []
    for period in playback.fly():
        times.append(period.time_s)
        theta.append(period.angles.theta[0])
        offset.append(period.angles.offset_s[0])
        rotation.append(period.estimate.pnp.rotation[0])
        position.append(period.estimate.pnp.position[0])
    count = len(times)
    return Observations(
        source=f"{recording}, {playback.log.device}, lighthouse {lighthouse}",
        believed=playback.believed,
        time_s=np.array(times),
        period=np.arange(count),
        craft=np.zeros(count, dtype=np.int64),
        theta=np.array(theta),
        offset_s=np.array(offset),
        own=(np.array(rotation), np.array(position)),
    )
