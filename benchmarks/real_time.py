"""How fast a scenario flies: real-time factor of the whole loop, with the recording on and off, in one process.

    python benchmarks/real_time.py [--scenario formation] [--seconds 10] [--repeats 3]

The first flight compiles the kernels and is not counted. Baseline: the same flight without navigation's result written
anywhere (no telemetry, no recording), in the same run.
"""

import argparse
import json
import platform
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

from swarm.flight.flight import Flight
from swarm.flight.simulate import simulate
from swarm.scenario import Scenario, load


def flown_s(scenario: Scenario, record: bool, folder: Path) -> float:
    """Wall time of a run with everything that it writes [s]."""
    began = time.perf_counter()
    simulate(scenario, out=folder / "run", record=record, force=True)
    return time.perf_counter() - began


def loop_s(scenario: Scenario) -> float:
    """Wall time of the loop alone, built and flown [s]."""
    began = time.perf_counter()
    flight = Flight(scenario)
    for frame in range(round(scenario.duration_s / flight.period_s)):
        flight.period(frame)
    return time.perf_counter() - began


def main() -> None:
    """Fly, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="formation")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    scenario = load(options.scenario, [f"duration_s={options.seconds}"])
    times: dict[str, list[float]] = {"recording": [], "telemetry_only": [], "loop_only": []}
    with tempfile.TemporaryDirectory() as folder:
        flown_s(scenario, True, Path(folder))
        for _ in range(options.repeats):
            times["recording"].append(flown_s(scenario, True, Path(folder)))
            times["telemetry_only"].append(flown_s(scenario, False, Path(folder)))
            times["loop_only"].append(loop_s(scenario))
    print(
        json.dumps(
            {
                "scenario": options.scenario,
                "craft": len(scenario.craft_names),
                "simulated_s": options.seconds,
                "wall_s": times,
                "best_real_time_factor": {name: options.seconds / min(every) for name, every in times.items()},
                "machine": platform.processor() or platform.machine(),
                "versions": {name: version(name) for name in ("mujoco", "numpy", "numba", "filterpy", "rerun-sdk")},
            },
            indent=2,
        )
    )


if __name__ == "__main__":
    main()
