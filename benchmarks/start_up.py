"""Start-up and memory: until the first period has flown, the most memory that a run takes, and a cold cache.

    python benchmarks/start_up.py [--craft 1000 10000] [--fly 1000] [--fly-s 60] [--cold] [--out start.json]

Every figure is that of a process of its own: its wall and CPU time from the interpreter's start to the end of the first
period, and its greatest resident memory (`getrusage`). --fly: as many craft fly --fly-s seconds with everything that a
run writes; memory is read at the end. --cold: also a start with an empty numba cache (NUMBA_CACHE_DIR), whose kernels
have to be compiled first.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from harness import finish, options, show

CHILD = """
import json, resource, sys, time
began = time.perf_counter()
from swarm.scenario import load
from swarm.flight.flight import Flight
from swarm.flight.simulate import simulate
from estimators.kernel import told_of_compilation
craft, fly_s, folder = int(sys.argv[1]), float(sys.argv[2]), sys.argv[3]
compiled = [0]
scenario = load("swarm1000", [f"swarm.count={craft}", f"duration_s={fly_s or 1}"])
with told_of_compilation(lambda state: compiled.append(state.done)):
    flight = Flight(scenario)
    built = time.perf_counter() - began
    flight.period(0)
first = {"wall_s": time.perf_counter() - began, "cpu_s": time.process_time(), "built_s": built}
first["compiled"] = max(compiled)
del flight
flown = {}
if fly_s:
    began, cpu = time.perf_counter(), time.process_time()
    run = simulate(scenario, out=folder)
    flown = {"flown_wall_s": time.perf_counter() - began, "flown_cpu_s": time.process_time() - cpu}
    flown["tracking_share"] = run.summary["swarm"]["tracking_share"] if "swarm" in run.summary else None
first["peak_resident_bytes"] = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps(first | flown))
"""


def child(craft: int, fly_s: float = 0.0, cache: str | None = None) -> dict[str, Any]:
    """What a process of its own measures."""
    environment = dict(os.environ) | ({"NUMBA_CACHE_DIR": cache} if cache else {})
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", CHILD, str(craft), str(fly_s), str(Path(folder) / "run")]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return {"craft": craft, "flown_s": fly_s, **json.loads(done.stdout.splitlines()[-1])}


def main() -> None:
    """Measure, show, write."""
    chosen = options(
        __doc__,
        craft=([1000, 10_000], "craft that start"),
        fly=(1000, "craft that fly"),
        fly_s=(60.0, "for so many seconds; 0: none"),
        cold=(False, "also with an empty cache of kernels"),
        repeats=(3, "starts of each size up to 1000 craft"),
    )
    child(10)
    started = {count: [child(count) for _ in range(chosen.repeats if count <= 1000 else 1)] for count in chosen.craft}
    results = {f"{count} craft start": min(runs, key=lambda run: run["cpu_s"]) for count, runs in started.items()}
    if chosen.cold:
        with tempfile.TemporaryDirectory() as cache:
            results["100 craft start, nothing compiled"] = child(100, cache=cache)
            results["100 craft start, compiled"] = child(100, cache=cache)
    if chosen.fly_s:
        results[f"{chosen.fly} craft fly {chosen.fly_s:g} s"] = child(chosen.fly, chosen.fly_s)
    show(
        "Until the first period has flown [s]; most memory [MB]; a flight with all that it writes [s]",
        ["", "wall", "CPU", "kernels compiled", "memory", "flight, wall", "flight, CPU"],
        [
            [
                name,
                r["wall_s"],
                r["cpu_s"],
                r["compiled"],
                r["peak_resident_bytes"] / 1e6,
                r.get("flown_wall_s"),
                r.get("flown_cpu_s"),
            ]
            for name, r in results.items()
        ],
    )
    finish("start_up", {"results": results}, chosen.out)


if __name__ == "__main__":
    main()
