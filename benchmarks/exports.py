"""Exports of a run, read back by the programs that they are for: evo, mcap, oem and ccsds-ndm (extra `bench`).

    python benchmarks/exports.py            # flies formation for 10 s and orbit for 5 s
    python benchmarks/exports.py --run runs/docking-1

evo's APE of every craft is compared with the RMS errors in summary.json, and every number of the other formats with the
telemetry.
"""

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from harness import finish, options, show

from estimators.rotation import matrix_from_quaternion
from swarm.exports.ccsds import epoch
from swarm.exports.export import Format, export, orbit_of
from swarm.exports.trajectory import Source, Trajectories
from swarm.flight.simulate import simulate
from swarm.results.run_folder import Run, open_run
from swarm.scenario import load

START = "2027-03-01T12:00:00"


def evo_errors(run: Run, folder: Path, to: Format) -> dict[str, float]:
    """Return the largest differences of evo's APE from the RMS errors in the summary, over the craft."""
    from evo.core import metrics, sync
    from evo.tools import file_interface as files

    export(run.folder, to, out=folder)
    found = {"position_m": 0.0, "attitude_deg": 0.0}
    for name, figures in run.summary["craft"].items():
        paths = [str(folder / f"{name}.{source}.{to}") for source in ("truth", "estimate")]
        if to is Format.TUM:
            pair = [files.read_tum_trajectory_file(path) for path in paths]
            pair = list(sync.associate_trajectories(*pair, max_diff=1e-6))
        else:
            pair = [files.read_kitti_poses_file(path) for path in paths]
        for key, relation in (
            ("position_m", metrics.PoseRelation.translation_part),
            ("attitude_deg", metrics.PoseRelation.rotation_angle_deg),
        ):
            what, unit = key.split("_")
            error = metrics.APE(relation)
            error.process_data(pair)
            ape = error.get_statistic(metrics.StatisticsType.rmse)
            found[key] = max(found[key], abs(ape - figures[f"ekf_{what}_rms_{unit}"]))
    return found


def mcap_errors(run: Run, folder: Path) -> dict[str, float]:
    """Return the largest differences of the poses in MCAP from those in the telemetry."""
    from mcap.reader import make_reader

    (file,) = export(run.folder, Format.MCAP, out=folder).files
    found = Trajectories(run.folder)
    read: dict[str, list[Any]] = {}
    with file.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            read.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
    worst = {"time_s": 0.0, "position_m": 0.0, "quaternion": 0.0}
    for name in found.craft:
        for source in (Source.TRUTH, Source.ESTIMATE):
            one, messages = found.of(name, source), read[f"/{name}/{source}"]
            poses = [message["pose"] for _, message in messages]
            place = np.array([[pose["position"][axis] for axis in "xyz"] for pose in poses])
            turn = np.array([[pose["orientation"][axis] for axis in "wxyz"] for pose in poses])
            stamps = 1e-9 * np.array([stamp for stamp, _ in messages])
            for key, difference in (
                ("time_s", stamps - one.time_s),
                ("position_m", place - one.position),
                ("quaternion", turn - one.quaternion),
            ):
                worst[key] = max(worst[key], float(np.abs(difference).max()))
    return worst


def ccsds_errors(run: Run, folder: Path) -> dict[str, float]:
    """Return the largest differences of the states in OEM and AEM from those in the telemetry."""
    from ccsds_ndm.ndm_io import NdmIo
    from oem import OrbitEphemerisMessage

    export(run.folder, Format.CCSDS, start=epoch(START), out=folder)
    found, orbit = Trajectories(run.folder), orbit_of(run)
    axes = np.eye(3) if orbit is None else orbit.axes
    worst = {"position_m": 0.0, "velocity_m_s": 0.0, "attitude_deg": 0.0, "epoch_s": 0.0}
    for name in found.craft:
        for source in (Source.TRUTH, Source.ESTIMATE):
            one = found.of(name, source)
            assert one.velocity is not None
            states = list(OrbitEphemerisMessage.open(folder / f"{name}.{source}.oem").states)
            place = 1e3 * np.array([state.position for state in states]) @ axes
            speed = 1e3 * np.array([state.velocity for state in states]) @ axes
            begin = states[0].epoch
            late = [
                (state.epoch - begin).sec - (t - one.time_s[0]) for state, t in zip(states, one.time_s, strict=True)
            ]
            message = NdmIo().from_path(folder / f"{name}.{source}.aem")
            rows = [
                row.quaternion_state.quaternion for part in message.body.segment for row in part.data.attitude_state
            ]
            turn = np.array([[row.qc, row.q1, row.q2, row.q3] for row in rows], dtype=np.float64)
            # A2B: the body's axes are the columns of this matrix, in the reference frame.
            gap = np.swapaxes(axes.T @ matrix_from_quaternion(turn), 1, 2) @ matrix_from_quaternion(one.quaternion)
            sine = 0.5 * np.linalg.norm(gap - np.swapaxes(gap, 1, 2), axis=(1, 2)) / np.sqrt(2)
            for key, difference in (
                ("position_m", place - one.position),
                ("velocity_m_s", speed - one.velocity),
                ("attitude_deg", np.degrees(sine)),
                ("epoch_s", np.array(late)),
            ):
                worst[key] = max(worst[key], float(np.abs(difference).max()))
    return worst


def main() -> None:
    """Fly, export, read back and print the differences."""
    asked = options(__doc__, run=("", "a run that is there, instead of flying"))
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        if asked.run:
            runs = [open_run(asked.run)]
        else:
            runs = [
                simulate(load(name, {"duration_s": seconds}), out=place / name, record=False)
                for name, seconds in (("formation", 10.0), ("orbit", 5.0))
            ]
        found = {}
        for run in runs:
            found[run.folder.name] = {
                "evo_tum_minus_summary": evo_errors(run, place / "out" / run.folder.name / "tum", Format.TUM),
                "evo_kitti_minus_summary": evo_errors(run, place / "out" / run.folder.name / "kitti", Format.KITTI),
                "mcap_minus_telemetry": mcap_errors(run, place / "out" / run.folder.name / "mcap"),
                "ccsds_minus_telemetry": ccsds_errors(run, place / "out" / run.folder.name / "ccsds"),
            }
    for name, each in found.items():
        rows = [(what.replace("_", " "), key, value) for what, all_ in each.items() for key, value in all_.items()]
        show(f"{name}: largest differences", ("of", "quantity", "difference"), rows)
    finish("exports", found, asked.out)


if __name__ == "__main__":
    main()
