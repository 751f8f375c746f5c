"""Does the smoother gain what it should, and is it consistent? Scenarios against the truth, a recording by its scatter.

    python benchmarks/smoother.py [drift formation ...] [--seeds 3] [--recording FILE --calibration FILE] [--crowd 1000]

Of every scenario: RMS of the filter over RMS of the smoother, and both NEES with their 95 % band over all seeds. Of
every object and station of a recording: RMS distance of the poses from their mean over a second, by the filter and
smoothed, and the median distance from the poses that came with the recording. With --crowd: what keeping the history
costs a flight of so many craft, on disk too, and the time and memory of smoothing it, against the flight without.
"""

import argparse
import json
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from harness import machine, versions

import swarm
from swarm.errors import SwarmError
from swarm.results.summary.chi_square import consistency

KEYS = ("position_scatter_mm", "attitude_scatter_deg", "peer_position_scatter_mm")


def scenario(name: str, seeds: int, folder: Path) -> dict[str, Any]:
    """Return the gains and the consistency of some flights."""
    gains: dict[str, list[float]] = {"position": [], "attitude": []}
    nees: dict[str, list[np.ndarray]] = {"nees": [], "smooth_nees": []}
    frames: list[np.ndarray] = []
    for seed in range(seeds):
        made = swarm.smooth(swarm.simulate(swarm.load(name, seed=seed), out=folder / f"{name}-{seed}", record=False))
        table, figures = made.telemetry, made.summary["swarm"]
        for kind, values in gains.items():
            values.append(1 / figures[f"smooth_to_ekf_{kind}_ratio"])
        for column, arrays in nees.items():
            arrays.append(table.column(column).to_numpy())
        # The seeds one after the other, as if they were one flight.
        frames.append(table.column("frame").to_numpy() + (frames[-1].max() + 1 if frames else 0))
    out: dict[str, Any] = {f"{kind}_gain": float(np.mean(values)) for kind, values in gains.items()}
    frame = np.concatenate(frames).astype(np.int64)
    for column, arrays in nees.items():
        found = consistency(frame, np.concatenate(arrays), 1 / 60)
        assert found is not None
        out[column] = {key: found[key] for key in ("mean", "band_low", "band_high", "inside_band")}
    return out


def recording(file: Path, calibration: Path | None, folder: Path) -> dict[str, Any]:
    """Return the scatter of every object and station."""
    from swarm.flight.recordings.contents import contents

    out = {}
    for row in contents(file).rows:
        if row.station is None:
            continue
        name = f"{row.name}-{row.station}"
        try:
            run = swarm.replay(
                file,
                object_name=row.name,
                lighthouse=row.station,
                calibration=calibration,
                out=folder / name,
                record=False,
            )
            figures = swarm.smooth(run).summary["swarm"]
        except SwarmError as error:
            out[name] = {"error": str(error)}
            continue
        out[name] = {key: [figures[f"{source}_{key}"] for source in ("ekf", "smooth")] for key in KEYS} | {
            "gain": figures["ekf_position_scatter_mm"] / figures["smooth_position_scatter_mm"],
            "attitude_gain": figures["ekf_attitude_scatter_deg"] / figures["smooth_attitude_scatter_deg"],
        }
    return out


def crowd(count: int, folder: Path) -> dict[str, Any]:
    """Return what the history of many craft costs."""
    out: dict[str, Any] = {}
    for keep in ("false", "true"):
        overrides = [f"swarm.count={count}", "duration_s=4", f"recording.filter={keep}"]
        # The first flight compiles, and loads what it needs.
        swarm.simulate(
            swarm.load("swarm1000", [*overrides, "duration_s=0.1"]), out=folder / "warm", force=True, record=False
        )
        began = time.process_time()
        run = swarm.simulate(swarm.load("swarm1000", overrides), out=folder / f"crowd-{keep}", record=False)
        out[f"flight_cpu_s_history_{keep}"] = time.process_time() - began
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    swarm.smooth(run)
    rows = run.telemetry.num_rows
    size = sum(file.stat().st_size for file in (run.folder / "filter.history").iterdir())
    return out | {
        "rows": rows,
        "history_bytes_per_row": size / rows,
        "smooth_cpu_us_per_row": 1e6 * (time.process_time() - began) / rows,
        "peak_memory_mb_flight_and_after": [before / 1024, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024],
    }


def main() -> None:
    """Measure, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=["drift", "formation"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--recording", type=Path)
    parser.add_argument("--calibration", type=Path)
    parser.add_argument("--crowd", type=int)
    given = parser.parse_args()
    out: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name in given.scenarios:
            out[name] = scenario(name, given.seeds, folder)
        if given.recording is not None:
            out["recording"] = recording(given.recording, given.calibration, folder)
        if given.crowd:
            out["crowd"] = crowd(given.crowd, folder)
    print(json.dumps({"machine": machine(), "versions": versions(), **out}, indent=2))


if __name__ == "__main__":
    main()
