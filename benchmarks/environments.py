"""The PettingZoo environment: craft-steps per second on one core, and whether the same seed gives the same bits.

    python benchmarks/environments.py [--craft 8 100 1000] [--steps 60] [--out environments.json]

Needs the extra `gym`. Scenario `swarm1000` with `swarm.count` changed; every agent gets a small random wrench. A step
is one lighthouse period of all craft: physics, light, navigation, observations and PettingZoo's dictionaries. The first
steps, in which craft search, are not counted.
"""

import time

import numpy as np
from harness import finish, options, show

from swarm.environments.parallel import SwarmEnv

WARM = 12


def flown(craft: int, steps: int) -> tuple[list[float], list[np.ndarray]]:
    """Return the CPU seconds of every step, and the observations after the last one."""
    env = SwarmEnv("swarm1000", {"swarm.count": craft, "duration_s": (WARM + steps + 2) / 60})
    env.reset(seed=1)
    draw = np.random.default_rng(1)
    seconds = []
    observations: dict[str, np.ndarray] = {}
    for _ in range(WARM + steps):
        wrench = draw.uniform(-0.02, 0.02, size=(len(env.agents), 6)).astype(np.float32)
        actions = dict(zip(env.agents, wrench, strict=True))
        begin = time.process_time()
        observations, *_ = env.step(actions)
        seconds.append(time.process_time() - begin)
    return seconds[WARM:], list(observations.values())


def main() -> None:
    """Fly, time and print."""
    asked = options(__doc__, craft=([8, 100, 1000], "numbers of craft"), steps=(60, "steps that are timed"))
    rows, result = [], {}
    for craft in asked.craft:
        seconds, last = flown(craft, asked.steps)
        again = flown(craft, asked.steps)[1]
        same = all(np.array_equal(a, b) for a, b in zip(last, again, strict=True))
        median = float(np.median(seconds))
        whole = craft * len(seconds) / sum(seconds)
        rows.append((craft, 1e3 * median, craft / median, whole, "yes" if same else "NO"))
        result[str(craft)] = {
            "step_ms": 1e3 * median,
            "craft_steps_per_s": craft / median,
            "craft_steps_per_s_mean": whole,
            "same_seed_same_bits": same,
        }
    heads = ("craft", "step, ms (median)", "craft-steps/s (median)", "craft-steps/s (mean)", "same bits")
    show("PettingZoo environment, CPU time of one core", heads, rows)
    finish("environments", {"craft": result}, asked.out)


if __name__ == "__main__":
    main()
