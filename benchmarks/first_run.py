"""A first run: the CPU time that every kernel takes to compile, its own without that of the kernels it calls.

    python benchmarks/first_run.py [--scenario formation] [--then swarm1000] [--fly-s 2] [--rows 30] [--out first.json]

Each scenario flies --fly-s seconds, with everything that a run writes, in a process of its own, whose cache of kernels
is empty for --scenario and holds that one's kernels for --then. Stages: numba's own work in Python (types, LLVM's
text), LLVM's optimisation, machine code. A function of numba's own counts as "numba".
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
import collections, json, sys, time
from numba.core import codegen, event
from estimators.kernel_compiler import KernelLibrary
began = time.process_time()
stages, running = collections.Counter(), []

def clocked(owner, name, stage):
    original = getattr(owner, name)
    def measured(*args, **kwargs):
        start = time.process_time()
        running.append(0.0)
        try:
            return original(*args, **kwargs)
        finally:
            spent = time.process_time() - start
            stages[stage] += spent - running.pop()
            if running:
                running[-1] += spent
    setattr(owner, name, measured)

clocked(codegen.CPUCodeLibrary, "_optimize_functions", "optimisation")
clocked(codegen.CPUCodeLibrary, "_optimize_final_module", "optimisation")
clocked(KernelLibrary, "_optimize_final_module", "optimisation")
clocked(codegen.JITCodeLibrary, "_finalize_specific", "machine code")

class Clock(event.Listener):
    def __init__(self):
        self.open, self.rows = [], []
    def on_start(self, e):
        self.open.append([time.process_time(), 0.0])
    def on_end(self, e):
        start, inner = self.open.pop()
        spent = time.process_time() - start
        function = e.data["dispatcher"].py_func
        name = f"{function.__module__}.{function.__qualname__}"
        self.rows.append((name, spent - inner, str(e.data["args"])))
        if self.open:
            self.open[-1][1] += spent

clock = Clock()
event.register("numba:compile", clock)
from swarm.scenario import load
from swarm.flight.simulate import simulate
scenario = load(sys.argv[1])
simulate(scenario.model_copy(update={"duration_s": float(sys.argv[2]), "criteria": ()}), out=sys.argv[3])
total = sum(spent for _, spent, _ in clock.rows)
print(json.dumps({
    "kernels": clock.rows,
    "compiling_cpu_s": total,
    "process_cpu_s": time.process_time() - began,
    "stages": {**stages, "types and LLVM's text": total - sum(stages.values())},
}))
"""


def child(scenario: str, fly_s: float, cache: str) -> dict[str, Any]:
    """Return what a process of its own tells of its kernels."""
    environment = dict(os.environ) | {"NUMBA_CACHE_DIR": cache}
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", CHILD, scenario, str(fly_s), str(Path(folder) / "run")]
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def by_kernel(kernels: list[tuple[str, float, str]]) -> dict[str, tuple[int, float]]:
    """Return how often each was compiled, and the CPU time of all its versions [s]; the dearest first."""
    found: dict[str, tuple[int, float]] = {}
    for name, spent, _ in kernels:
        name = name if name.startswith(("estimators.", "swarm.")) else "numba"
        count, before = found.get(name, (0, 0.0))
        found[name] = count + 1, before + spent
    return dict(sorted(found.items(), key=lambda item: -item[1][1]))


def main() -> None:
    """Measure, show, write."""
    chosen = options(
        __doc__,
        scenario=("formation", "flies with an empty cache"),
        then=("", "flies after it, with the same cache; empty: none"),
        fly_s=(2.0, "simulated seconds"),
        rows=(30, "kernels shown"),
    )
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as cache:
        for name in filter(None, (chosen.scenario, chosen.then)):
            result = child(name, chosen.fly_s, cache)
            kernels = by_kernel(result["kernels"])
            own = sum(count for kernel, (count, _) in kernels.items() if kernel != "numba")
            results[name] = result | {"by_kernel": kernels, "own": own, "numba": len(result["kernels"]) - own}
    show(
        "First runs [s of CPU]",
        ["", "kernels", "numba's", "compiling", "whole process", *next(iter(results.values()))["stages"]],
        [
            [name, r["own"], r["numba"], r["compiling_cpu_s"], r["process_cpu_s"], *r["stages"].values()]
            for name, r in results.items()
        ],
    )
    for name, r in results.items():
        show(
            f"{name}: compiling by kernel [s of CPU], its own",
            ["", "versions", "time"],
            [[kernel, count, spent] for kernel, (count, spent) in list(r["by_kernel"].items())[: chosen.rows]],
        )
    finish("first_run", {"results": results}, chosen.out)


if __name__ == "__main__":
    main()
