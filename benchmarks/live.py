"""Latency of a replay of lines as they come: 60 s of lines through a pipe at real speed, from line to estimate.

    python benchmarks/live.py [--seconds 60] [--recording FILE] [--calibration FILE] [--stations FILE] [--record]
        [--generation 2.0]

Another process writes the lines when they are due by their own time. Without a file they are simulated: of an object
with 20 photodiodes that is moved by hand before two Lighthouse 1.0 stations (`tests/made_recording.py`), with
`--generation 2.0` of a craft that wanders between two of 2.0 (`recorded_stations.py`). A line's latency is
the time from its being read from the pipe to the writing of the estimate that it is in; the periods' own wait (33 ms or
20 ms, then a turn) is in it. Lines that came before the start had been caught up with do not count.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from harness import machine, versions

import swarm
from swarm.flight.recordings.live_lines import LiveLines

ROOT = Path(__file__).parents[1]
FEED = """
import sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[3])
from swarm.flight.recordings.text_lines import TextLines
begin = None
for _, line in TextLines(Path(sys.argv[1])):
    words = line.split(None, 1)
    try:
        due = float(words[0])
    except ValueError:
        due = None
    if due is not None:
        begin = (due, time.monotonic()) if begin is None else begin
        if due - begin[0] > float(sys.argv[2]):
            break
        wait = due - begin[0] - (time.monotonic() - begin[1])
        if wait > 0.0005:
            sys.stdout.flush()
            time.sleep(wait)
    sys.stdout.write(line + "\\n")
sys.stdout.flush()
"""


def made(folder: Path, seconds: float, generation: str) -> tuple[Path, Path]:
    """Write simulated lines of stations of a generation, and their calibration; return both files."""
    if generation == "2.0":
        from recorded_stations import recorded

        _, file, _ = recorded(folder, seconds + 2.0, 1)
        return file, file.with_name(f"{file.name}.json")
    sys.path.insert(0, str(ROOT / "tests"))
    import made_recording
    from synthetic_recording import calibration_text

    file = made_recording.write(
        folder / "hand.rec.gz", made_recording.lines(made_recording.Made(duration_s=seconds + 2.0))
    )
    calibration = folder / "hand.json"
    calibration.write_text(calibration_text())
    return file, calibration


def main() -> None:
    """Measure, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--generation", choices=("1.0", "2.0"), default="1.0", help="of the stations, without a file")
    for name in ("recording", "calibration", "stations", "out"):
        parser.add_argument(f"--{name}", type=Path)
    parser.add_argument("--record", action="store_true", help="write recording.rrd as well")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file, calibration = options.recording, options.calibration
        if file is None:
            file, calibration = made(Path(folder), options.seconds, options.generation)
        feeder = subprocess.Popen(
            [sys.executable, "-c", FEED, str(file), str(options.seconds), str(ROOT)], stdout=subprocess.PIPE
        )
        assert feeder.stdout is not None
        notes: list[str] = []
        run = swarm.replay(
            LiveLines(feeder.stdout.fileno()),
            calibration=calibration,
            stations=options.stations,
            out=Path(folder) / "run",
            record=options.record,
            tell=notes.append,
        )
        feeder.wait()
        summary = run.summary
    out = {
        "machine": machine(),
        "versions": versions(),
        "lines": file.name,
        "load_average": os.getloadavg(),
        "periods": summary["periods"],
        "duration_s": summary["duration_s"],
        "stations": [note.partition(":")[0] for note in notes if "photodiodes of a sweep agree" in note],
        **summary["live"],
    }
    text = json.dumps(out, indent=1)
    print(text)
    if options.out is not None:
        options.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
