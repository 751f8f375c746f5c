"""The recording: all periods of a second, at fleet level and beside rerun's own `log` once per craft and period.

    python benchmarks/recording.py [--craft 1000] [--repeats 5] [--out recording.json]

A repetition is two seconds of flight, 120 periods, appended and closed. Baseline: for every drawn period one
`RecordingStream.log` of a `Transform3D` per craft, which is less than the recording draws, over some periods.
Found the truth: the bytes written, and that rerun reads them back with every drawn period in the crowd's entity.
"""

import tempfile
from pathlib import Path

import numpy as np
import rerun as rr
from harness import Times, finish, options, show, timed
from period import captured
from rerun.chunk import RrdReader

from estimators.rotation import xyzw_from_wxyz
from swarm.results.period import Period
from swarm.results.recording.recording import Recording
from swarm.results.records import Errors

PERIODS, BY_LOG = 120, 4


def main() -> None:
    """Measure, show, write."""
    chosen = options(__doc__, craft=(1000, "craft"), repeats=(5, "repetitions"))
    c = captured(chosen.craft)
    sight = np.minimum(c.sight[..., 0], c.sight[..., 1])
    errors = Errors(*np.abs(np.random.default_rng(0).standard_normal((7, chosen.craft))))
    turn = xyzw_from_wxyz(c.truth.quaternion)
    times = {name: Times([], []) for name in ("recording", "log per craft")}
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "recording.rrd"
        for _ in range(chosen.repeats + 1):
            with timed(times["recording"]):
                recording = Recording(file, c.flight.scene)
                for frame in range(PERIODS):
                    recording.append(Period(frame, frame / 60, c.truth, sight, c.angles, c.estimate), errors)
                recording.close()
            every = recording.draws_every
            stream = rr.RecordingStream("baseline")
            stream.save(Path(name) / "baseline.rrd")
            with timed(times["log per craft"]):
                for frame in range(BY_LOG):
                    stream.set_time("frame", sequence=frame)
                    for i, craft in enumerate(c.flight.world.names):
                        pose = rr.Transform3D(translation=c.truth.position[i], quaternion=rr.Quaternion(xyzw=turn[i]))
                        stream.log(f"world/craft/{craft}", pose)
                stream.flush()
            stream.disconnect()
        size = file.stat().st_size
        drawn = sorted({int(frame) for frame in frames(file)})
    for series in times.values():
        del series.cpu_s[0], series.wall_s[0]
    per = {
        "recording": times["recording"].figures(PERIODS),
        "log per craft, of a period that is drawn": times["log per craft"].figures(BY_LOG),
    }
    truth = {"bytes_per_period": size / PERIODS, "drawn_every": every, "periods_read_back": len(drawn)}
    show(
        f"{chosen.craft} craft; per period [us], one of {every} is drawn",
        ["", "CPU median", "CPU minimum", "wall median"],
        [[n, *(1e6 * f[k] for k in ("cpu_median_s", "cpu_minimum_s", "wall_median_s"))] for n, f in per.items()],
    )
    print("\n" + ", ".join(f"{name} {value:.0f}" for name, value in truth.items()))
    finish("recording", {"craft": chosen.craft, "per_period": per, "truth": truth}, chosen.out)


def frames(file: Path) -> list[int]:
    """The frames that the recording has of the craft's names: one for every period drawn."""
    found: list[int] = []
    for chunk in RrdReader(str(file)).stream():
        if chunk.entity_path == "/world/names" and not chunk.is_static:
            found += chunk.to_record_batch().column("frame").to_pylist()
    return found


if __name__ == "__main__":
    main()
