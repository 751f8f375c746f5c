"""The whole loop, with recording and telemetry, over the number of craft: seconds per stage, real-time factor.

    python benchmarks/whole_loop.py [--craft 10 100 1000 10000] [--steps 4 8] [--blocks 5] [--out loop.json]

Scenario `swarm1000` (12 photodiodes per craft, 60 periods a second, recording at fleet level) with `swarm.count`
changed. A block is 128 periods, so that what is done now and then (parts of telemetry, batches of the recording)
counts in every block; blocks of all sizes take turns. `closing`
is what the end of the run adds: recording closed, telemetry completed, summary. Beside the times, whether
the craft found themselves: the share tracking and the median error against the truth.
"""

import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from harness import Times, finish, options, show, timed

from swarm.flight.flight import Flight
from swarm.flight.scene import scene
from swarm.onboard import lighthouse_fix
from swarm.onboard.settings import Status
from swarm.results.run_writer import RunWriter, writing_run
from swarm.scenario import load

BLOCK = 128
"""Periods of a block."""
ON_BOARD = ("visibility", "LM, DOP", "filter")
"""What issue and design count as the on-board chain."""


class Stages:
    """CPU seconds by stage, of one flight: its parts' own methods, wrapped."""

    current: "Stages | None" = None

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)

    def wrap(self, owner: Any, name: str, stage: str) -> None:
        """Let `owner.name` add its time to `stage`."""
        setattr(owner, name, self._counted(getattr(owner, name), stage))

    def _counted(self, function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        def run(*arguments: Any, **named: Any) -> Any:
            began = time.process_time()
            result = function(*arguments, **named)
            self.seconds[stage] += time.process_time() - began
            return result

        return run

    @classmethod
    def share(cls, module: Any, name: str, stage: str) -> None:
        """The same for a function of a module: its time goes to the flight that is in the air."""
        function = getattr(module, name)

        def run(*arguments: Any, **named: Any) -> Any:
            began = time.process_time()
            result = function(*arguments, **named)
            if cls.current is not None:
                cls.current.seconds[stage] += time.process_time() - began
            return result

        setattr(module, name, run)


class Loop:
    """One flight of so many craft with everything that it writes."""

    def __init__(self, craft: int, steps: int, folder: Path, blocks: int, exits: ExitStack) -> None:
        duration_s = (blocks + 1) * BLOCK / 60 + 1
        overrides = [f"swarm.count={craft}", f"physics.steps_per_period={steps}", f"duration_s={duration_s}"]
        scenario = load("swarm1000", overrides)
        self.craft, self.steps, self.frame = craft, steps, 0
        self.start = Times([], [])
        with timed(self.start):
            self.flight = Flight(scenario)
        self.stages = Stages()
        self._closing = exits.enter_context(ExitStack())
        self.writer: RunWriter = self._closing.enter_context(
            writing_run(
                scenario, folder / f"{craft}-{steps}", scene(scenario, self.flight), force=False, duration_s=1.0
            )
        )
        self.times, self.end = Times([], []), Times([], [])
        flight, writer = self.flight, self.writer
        self.stages.wrap(flight.world, "advance", "physics")
        self.stages.wrap(flight.pilot, "steer", "control")
        self.stages.wrap(flight.sensors.visibility, "state_into", "visibility")
        self.stages.wrap(flight.sensors.lighthouse, "sweep", "crossing times")
        self.stages.wrap(flight.computer.decoder, "decode", "decode")
        for name in ("predict", "update_pose", "start", "stop"):
            self.stages.wrap(flight.computer.navigator.tracks.bank, name, "filter")
        self.stages.wrap(flight.computer.navigator, "step", "navigation, all of it")
        self.stages.wrap(writer._telemetry, "append", "telemetry")
        self.stages.wrap(writer._recording, "append", "recording")
        self.errors: list[np.ndarray] = []

    def block(self, periods: int, counted: bool) -> None:
        """Fly a block."""
        Stages.current = self.stages
        with timed(self.times if counted else Times([], [])):
            for _ in range(periods):
                period = self.flight.period(self.frame)
                self.writer.append(period)
                self.frame += 1
        if not counted:
            self.stages.seconds.clear()
        truth, estimate = period.truth, period.estimate
        assert truth is not None
        known = np.isfinite(estimate.position[:, 0])
        self.errors.append(np.linalg.norm(estimate.position - truth.position, axis=1)[known])
        self.tracking = float(np.mean(estimate.status == Status.TRACKING))

    def close(self) -> None:
        """Close the run, as the end of a flight does."""
        with timed(self.end):
            self._closing.close()

    def result(self, periods: int) -> dict[str, Any]:
        """Everything, per period."""
        counted = len(self.times.cpu_s) * periods
        stage = {name: seconds / counted for name, seconds in self.stages.seconds.items()}
        figures = self.times.figures(periods)
        board = sum(stage[name] for name in ON_BOARD)
        return {
            "craft": self.craft,
            "steps_per_period": self.steps,
            "period": figures,
            "stage_cpu_mean_s": stage,
            "closing_cpu_s": self.end.cpu_s[0],
            "simulated_s": self.frame / 60,
            "on_board_us_per_craft": 1e6 * board / self.craft,
            "cpu_us_per_craft": 1e6 * figures["cpu_median_s"] / self.craft,
            "real_time_factor": 1 / 60 / figures["cpu_median_s"],
            "real_time_factor_wall": 1 / 60 / figures["wall_median_s"],
            "build_cpu_s": self.start.cpu_s[0],
            "tracking": self.tracking,
            "median_position_error_m": float(np.median(self.errors[-1])),
        }


def main() -> None:
    """Fly, show, write."""
    chosen = options(
        __doc__,
        craft=([10, 100, 1000, 10_000], "numbers of craft"),
        steps=([4, 8], "physics steps per period"),
        blocks=(5, f"blocks of {BLOCK} periods that are counted, of each; a third as many beyond 1000 craft"),
    )
    Stages.share(lighthouse_fix, "refine_with_dilution", "LM, DOP")
    Stages.share(lighthouse_fix, "dilution", "LM, DOP")
    with tempfile.TemporaryDirectory() as folder, ExitStack() as exits:
        loops = [
            Loop(craft, steps, Path(folder), chosen.blocks, exits) for craft in chosen.craft for steps in chosen.steps
        ]
        for turn in range(chosen.blocks + 1):
            for loop in loops:
                if loop.craft <= 1000 or turn <= -(-chosen.blocks // 3):
                    loop.block(BLOCK, counted=turn > 0)
        for loop in loops:
            loop.close()
    results = [loop.result(BLOCK) for loop in loops]
    stages = list(results[0]["stage_cpu_mean_s"])
    show(
        "CPU time per period [ms], all threads, by stage (mean); on-board chain [us per craft and period]",
        ["craft", "steps", *stages, "on board"],
        [
            [r["craft"], r["steps_per_period"]]
            + [1e3 * r["stage_cpu_mean_s"].get(name, float("nan")) for name in stages]
            + [r["on_board_us_per_craft"]]
            for r in results
        ],
    )
    columns = ["craft", "steps", "CPU median", "CPU min", "wall median", "real time", "by the wall", "us/craft"]
    show(
        "The whole period [ms], how many times real time (median CPU; by the wall clock), and the end of the run",
        [*columns, "tracking", "error [mm]", "build [s]", "closing [s]", "of [s]"],
        [
            [
                *(r["craft"], r["steps_per_period"]),
                *(1e3 * r["period"][name] for name in ("cpu_median_s", "cpu_minimum_s", "wall_median_s")),
                *(r["real_time_factor"], r["real_time_factor_wall"], r["cpu_us_per_craft"], r["tracking"]),
                *(1e3 * r["median_position_error_m"], r["build_cpu_s"], r["closing_cpu_s"], r["simulated_s"]),
            ]
            for r in results
        ],
    )
    finish("whole_loop", {"results": results}, chosen.out)


if __name__ == "__main__":
    main()
