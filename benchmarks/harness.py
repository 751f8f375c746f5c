"""What every benchmark shares: options, the machine, times of interleaved repetitions, and how they are shown.

Candidates take turns, so that a load that comes and goes meets all of them. Two clocks are read: wall time, and the CPU
time of all threads of the process (`time.process_time`), which other programs on the machine disturb less; the median
CPU time is the headline. Every benchmark pins itself to one core, so that CPU time is one core's.
"""

import argparse
import json
import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

PACKAGES = (
    "mujoco",
    "numpy",
    "numba",
    "scipy",
    "filterpy",
    "rerun-sdk",
    "pyarrow",
    "opencv-python-headless",
    "poselib",
    "embreex",
)


class Times(NamedTuple):
    """Seconds of repetitions, by both clocks."""

    cpu_s: list[float]
    wall_s: list[float]

    def figures(self, per: float = 1.0) -> dict[str, float]:
        """Minimum and median of both clocks [s], divided by `per`."""
        clocks = {"cpu": self.cpu_s, "wall": self.wall_s}
        return {
            f"{clock}_{name}_s": float(of(values)) / per
            for clock, values in clocks.items()
            for name, of in (("median", np.median), ("minimum", np.min))
        }


@contextmanager
def timed(into: Times) -> Iterator[None]:
    """Add what the block takes."""
    wall, cpu = time.perf_counter(), time.process_time()
    yield
    into.cpu_s.append(time.process_time() - cpu)
    into.wall_s.append(time.perf_counter() - wall)


def interleaved(candidates: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, Times]:
    """Times of every candidate over `repeats` rounds in which each takes its turn; a first round is not counted."""
    times = {name: Times([], []) for name in candidates}
    for turn in range(repeats + 1):
        for name, run in candidates.items():
            with timed(times[name] if turn else Times([], [])):
                run()
    return times


def options(doc: str | None, **extra: tuple[Any, str]) -> argparse.Namespace:
    """The command line's options: --repeats, --core, --out, and `extra`, each with its default and its meaning."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, (default, meaning) in extra.items():
        how: dict[str, Any] = {"nargs": "+", "type": type(default[0])} if isinstance(default, list) else {}
        how = how or ({"action": "store_true"} if default is False else {"type": type(default)})
        parser.add_argument(
            f"--{name.replace('_', '-')}", default=default, help=f"{meaning} (default: {default})", **how
        )
    parser.add_argument("--core", type=int, default=None, help="pin to this core (default: the last one)")
    parser.add_argument("--out", type=Path, help="write the result as JSON")
    chosen = parser.parse_args()
    pin(chosen.core)
    return chosen


def pin(core: int | None = None) -> None:
    """Keep this process, with all threads that it will have, on one core; where the system cannot, it is not kept."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0)) if core is None else core})


def machine() -> dict[str, Any]:
    """Processor, cores, load and system; no names."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        models = [line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if "model name" in line]
        model = models[0] if models else model
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "pinned_to_one_core": hasattr(os, "sched_setaffinity"),
        "load_average": [round(load, 1) for load in os.getloadavg()],
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def versions() -> dict[str, str]:
    """Of what is installed of the packages that the figures depend on."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def show(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Print a table; floats with three significant digits."""
    cells = [[_cell(value) for value in row] for row in rows]
    widths = [max(len(row[i]) for row in [list(columns), *cells]) for i in range(len(columns))]
    print(f"\n{title}")
    for row in [list(columns), ["-" * width for width in widths], *cells]:
        print(
            "  ".join(
                cell.ljust(width) if i == 0 else cell.rjust(width)
                for i, (cell, width) in enumerate(zip(row, widths, strict=True))
            )
        )


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "-" if np.isnan(value) else f"{value:.3g}"
    return "-" if value is None else str(value)


def finish(benchmark: str, result: Mapping[str, Any], out: Path | None) -> None:
    """Name the machine, and write JSON if asked to."""
    about = machine()
    head = {"benchmark": benchmark, "machine": about, "versions": versions()}
    print(f"\n{about['processor']}, {about['cores']} cores, pinned to one; load {about['load_average']}")
    if out is not None:
        out.write_text(json.dumps({**head, **result}, indent=2, default=float) + "\n", encoding="utf-8")
