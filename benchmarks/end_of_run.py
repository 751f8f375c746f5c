"""What a run costs beside its loop: start, loop, recording and telemetry completed, summary, and their ratio.

    python benchmarks/end_of_run.py [--craft 1000] [--seconds 60] [--repeats 1] [--out end.json]

Scenario `swarm1000` with `swarm.count` changed, flown as `swarm run` flies it, in a process of its own: `start` is all
until the first period (interpreter, imports, kernels from their cache, models), `loop` all periods with what telemetry,
recording and summary take meanwhile, `telemetry` and `recording` what completes them, `summary` the figures from the
rows that were taken in flight. Beside them the summary read from the file, and whether both say the same.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from harness import finish, options, show

CHILD = """
import json, resource, sys, time
from collections import defaultdict
from pathlib import Path
from swarm.flight import simulate
from swarm.results import run_writer, telemetry
from swarm.results.recording import recording
from swarm.results.summary import summarise_run
from swarm.scenario import load
seconds = defaultdict(float)

def timed(owner, name, phase):
    function = getattr(owner, name)
    def run(*arguments, **named):
        began = time.process_time()
        result = function(*arguments, **named)
        seconds[phase] += time.process_time() - began
        return result
    setattr(owner, name, run)

timed(telemetry.Telemetry, "close", "telemetry")
timed(recording.Recording, "close", "recording")
timed(run_writer, "summarise_run", "summary")
fly = simulate.Flight.fly

def flown(flight):
    seconds["start"] = time.process_time()
    yield from fly(flight)
    seconds["loop"] = time.process_time() - seconds["start"]

simulate.Flight.fly = flown
craft, fly_s, folder = sys.argv[1:]
run = simulate.simulate(load("swarm1000", [f"swarm.count={craft}", f"duration_s={fly_s}"]), out=folder)
seconds["whole"] = time.process_time()
memory = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
began = time.process_time()
read = json.loads(json.dumps(summarise_run(Path(folder))))
seconds["summary, read"] = time.process_time() - began
same = all(run.summary[key] == value for key, value in read.items())
print(json.dumps({**seconds, "peak_resident_bytes": memory, "same": same}))
"""
PHASES = ("start", "loop", "recording", "telemetry", "summary", "whole")


def child(craft: int, seconds: float) -> dict[str, Any]:
    """Fly in a process of its own, and return its CPU seconds by phase."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", CHILD, str(craft), str(seconds), str(Path(folder) / "run")]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def main() -> None:
    """Measure, show, write."""
    chosen = options(__doc__, craft=(1000, "craft"), seconds=(60.0, "seconds of flight"), repeats=(1, "runs"))
    child(chosen.craft, 1.0)
    runs = [child(chosen.craft, chosen.seconds) for _ in range(chosen.repeats)]
    best = {name: float(np.min([run[name] for run in runs])) for name in (*PHASES, "summary, read")}
    memory = max(run["peak_resident_bytes"] for run in runs)
    show(
        f"{chosen.craft} craft, {chosen.seconds:g} s of flight: CPU time [s], least of {chosen.repeats}; memory [MB]",
        [*PHASES, "whole / loop", "memory", "summary, read from the file", "the same"],
        [
            [
                *(best[name] for name in PHASES),
                best["whole"] / best["loop"],
                memory / 1e6,
                best["summary, read"],
                str(all(run["same"] for run in runs)),
            ]
        ],
    )
    finish("end_of_run", {"runs": runs}, chosen.out)


if __name__ == "__main__":
    main()
