"""Telemetry: rows of a period, row groups on disk, and the complete file, beside pandas-free pyarrow row by row.

    python benchmarks/telemetry.py [--craft 1000] [--repeats 5] [--out telemetry.json]

A repetition is two seconds of flight, 120 periods: `append` (with the row groups that it writes), then `close`, which
writes the last one and the footer. Baseline: the same rows as Python dictionaries, `pyarrow.Table.from_pylist` and
`write_table`, for some craft.
Found the truth: the greatest difference between the file's errors and those of `estimators.rotation` and NumPy.
"""

import shutil
import tempfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from harness import Times, finish, options, show, timed
from period import captured

from estimators.rotation import angle_between, matrix_from_quaternion
from swarm.results.columns.schema import schema
from swarm.results.period import Period
from swarm.results.reading import read_telemetry
from swarm.results.table import doubles as values
from swarm.results.telemetry import Telemetry

PERIODS, BY_ROW = 120, 20


def main() -> None:
    """Measure, show, write."""
    chosen = options(__doc__, craft=(1000, "craft"), repeats=(5, "repetitions"))
    c = captured(chosen.craft)
    times = {name: Times([], []) for name in ("append", "close", "row by row")}
    columns = schema()
    doubles = [field.name for field in columns if field.type == pa.float64()]
    row = dict.fromkeys(doubles, 0.25) | {"frame": 1, "craft": "craft-1", "status": "tracking", "sensor": "lighthouse"}
    row |= {"visible": 12, "pnp_iterations": 3, "missed_sync": 0, "rejected_pulses": 0, "contact": False}
    row |= {"coupling": "loose", "rows": 0}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for _ in range(chosen.repeats):
            shutil.rmtree(folder)
            folder.mkdir()
            telemetry = Telemetry(folder, c.flight.world.names)
            with timed(times["append"]):
                for frame in range(PERIODS):
                    telemetry.append(Period(frame, frame / 60, c.truth, c.sight, c.angles, c.estimate))
            with timed(times["close"]):
                telemetry.close()
            with timed(times["row by row"]):
                table = pa.Table.from_pylist([dict(row) for _ in range(PERIODS * BY_ROW)], schema=columns)
                pq.write_table(table, folder / "rows.parquet")
        size = (folder / "telemetry.parquet").stat().st_size / PERIODS / chosen.craft
        last = read_telemetry(folder).slice((PERIODS - 1) * chosen.craft)
    turn = angle_between(matrix_from_quaternion(c.truth.quaternion), c.estimate.rotation)
    away = np.linalg.norm(c.truth.position - c.estimate.position, axis=1)
    truth = {
        "rows": last.num_rows * PERIODS,
        "position_error_m": float(np.nanmax(np.abs(values(last, "position_error_m") - away))),
        "attitude_error_deg": float(np.nanmax(np.abs(values(last, "attitude_error_deg") - np.degrees(turn)))),
    }
    rows = {"append": chosen.craft, "close": chosen.craft, "row by row": BY_ROW}
    per = {name: t.figures(PERIODS * rows[name]) for name, t in times.items()}
    show(
        f"{chosen.craft} craft; per craft and period [us]; {size:.0f} bytes each in the file",
        ["", "CPU median", "CPU minimum", "wall median"],
        [[n, *(1e6 * f[k] for k in ("cpu_median_s", "cpu_minimum_s", "wall_median_s"))] for n, f in per.items()],
    )
    print("\ngreatest differences: " + ", ".join(f"{name} {value:.2g}" for name, value in truth.items()))
    finish("telemetry", {"craft": chosen.craft, "per_row": per, "bytes_per_row": size, "truth": truth}, chosen.out)


if __name__ == "__main__":
    main()
